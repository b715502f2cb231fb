"""What stands still between the frames of a video: matches of its background, which tie frames to one another.

`background_motion` estimates how the picture moves; `matching_frame` prepares a frame for matching and compares two;
`matches` are those of two frames; `keyframe_tracking` ties all frames of a video to keyframes.
"""

import lazy_loader

# For users there is nothing here, and Tab shows nothing: modules are imported by their paths.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
