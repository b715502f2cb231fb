"""Boxes of players in files of detectors and trackers, read row by row: see `open_boxes` for the kinds of files."""

import lazy_loader

# The names are listed in __init__.pyi; each is imported when it is first used.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
