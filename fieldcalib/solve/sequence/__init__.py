"""Frames of one camera, calibrated together: `from_sequence` is the entry, `sequence_solver` draws the way."""

from fieldcalib._modules import lazy_modules

__getattr__, __dir__, __all__ = lazy_modules(__name__, __path__)
