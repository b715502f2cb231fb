"""What stands still between the frames of a video: matches of its background, which tie frames to one another.

`background_motion` estimates how the picture moves; `matching_frame` prepares a frame for matching and compares two;
`matches` are those of two frames; `keyframe_tracking` ties all frames of a video to keyframes.
"""

from fieldcalib._modules import lazy_modules

__getattr__, __dir__, __all__ = lazy_modules(__name__, __path__)
