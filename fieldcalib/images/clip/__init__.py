"""A clip from its frames: all of it at once (`from_video`), or live, frame by frame (`tracker`).

frames -> `keyframes` -> `solved_shots` by the `clip_models` -> lines in all frames -> `finished_clip`
"""

from fieldcalib._modules import lazy_modules

__getattr__, __dir__, __all__ = lazy_modules(__name__, __path__)
