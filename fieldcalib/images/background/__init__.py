"""Matches of the static background between frames of a video, which tie the cameras of the frames to one another.

`background_motion` estimates how the picture moves; `matching_frame` prepares frames for matching and matches two of
them; `matches` holds the resulting pairs of points; `keyframe_tracking` matches all frames of a video to keyframes.
"""

import lazy_loader

# For users there is nothing here, and Tab shows nothing: modules are imported by their paths.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
