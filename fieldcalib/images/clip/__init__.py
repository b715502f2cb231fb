"""Calibration of a clip: all frames together (`from_video`), or live, frame by frame (`tracker`).

frames -> `keyframes` -> `solved_shots` by the `clip_models` -> lines in all frames -> `finished_clip`
"""

import lazy_loader

# For users there is nothing here, and Tab shows nothing: modules are imported by their paths.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
