"""Calibration of cameras from labelled pixels, points or homographies."""

from fieldcalib._modules import lazy_modules

__getattr__, __dir__, __all__ = lazy_modules(__name__, __path__)
