"""Runs over many frames: reading files, processing them in units, writing and resuming the folder of results."""

import lazy_loader

# For users there is nothing here, and Tab shows nothing: modules are imported by their paths.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
