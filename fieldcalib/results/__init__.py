"""Results of many frames: computed by `fieldcalib.calibrate`, saved to a folder, read by `fieldcalib.read`."""

import lazy_loader

# The names are listed in __init__.pyi; each is imported when it is first used.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
