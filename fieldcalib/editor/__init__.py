"""Labelling and mending of frames by hand: the model behind an editor, without any user interface."""

from fieldcalib._modules import lazy_modules

__getattr__, __dir__, __all__ = lazy_modules(__name__, __path__)
