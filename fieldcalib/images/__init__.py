"""Cameras from images: line profiles, refinement on the image, hypotheses; matches between frames."""

from fieldcalib._modules import lazy_modules

__getattr__, __dir__, __all__ = lazy_modules(__name__, __path__)
