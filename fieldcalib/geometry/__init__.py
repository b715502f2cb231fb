"""Geometry without fields: rotations, projective maps, the lens, the camera, homographies."""

from fieldcalib._modules import lazy_modules

__getattr__, __dir__, __all__ = lazy_modules(__name__, __path__)
