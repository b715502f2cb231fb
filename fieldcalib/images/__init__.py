"""Cameras from images and clips: labels of a network or a search for the field, and refinement on the lines."""

import lazy_loader

# The names are listed in __init__.pyi; each is imported when it is first used.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
