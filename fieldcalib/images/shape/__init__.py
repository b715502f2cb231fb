"""Relation of a picture to the camera's frame: the frame itself, or with borders, in a window, squashed or enlarged.

`borders_and_squash` and `picture_in_picture` find the frame within the picture; `enlarged` checks whether it may be an
enlarged part of a frame; `why_no_camera` states what is wrong with pictures that give no camera.
"""

import lazy_loader

# For users there is nothing here, and Tab shows nothing: modules are imported by their paths.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
