"""Cameras in the formats of other tools, one module each.

Every module has a function from frames, a mapping of ids to cameras in the order of the frames, to the files of the
format, a mapping of names to contents. None stands for a frame without camera.
"""

import lazy_loader

# The names are listed in __init__.pyi; each is imported when it is first used.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
