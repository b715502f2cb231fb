"""The hypotheses of what a picture shows of which frame (`fieldcalib.problem.picture_shape`), asked of a picture.

`borders_and_windows` and `enlarged` measure evidence in its pixels, `shape_of_picture` calibrates it by each hypothesis
and chooses; it also states what is wrong with pictures that give no camera.
"""

import lazy_loader

# For users there is nothing here, and Tab shows nothing: modules are imported by their paths.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
