"""What a picture is of: a whole frame, or one with borders, in a window, squashed or enlarged.

`borders_and_squash` and `picture_in_picture` find the frame; `enlarged` doubts that it is a whole one; `why_no_camera`
says what is wrong with pictures that give no camera.
"""

from fieldcalib._modules import lazy_modules

__getattr__, __dir__, __all__ = lazy_modules(__name__, __path__)
