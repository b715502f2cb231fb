"""Joint calibration of frames of one camera: `sequence_solver` has the entry, and outlines the steps."""

import lazy_loader

# For users there is nothing here, and Tab shows nothing: modules are imported by their paths.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
