"""What a picture is of: a whole frame, or one with borders, in a window, squashed or enlarged.

`borders_and_squash` and `picture_in_picture` find the frame; `enlarged` doubts that it is a whole one; `why_no_camera`
says what is wrong with pictures that give no camera.
"""

import lazy_loader

# For users there is nothing here, and Tab shows nothing: modules are imported by their paths.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
