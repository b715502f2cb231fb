"""Pictures: markings and labelled pixels drawn onto an image, the field from above, and clips at one glance.

Images are OpenCV's: uint8, (height, width, 3), blue, green, red. Every function returns a new image.
"""

import lazy_loader

# The names are listed in __init__.pyi; each is imported when it is first used.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
