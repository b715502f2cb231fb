"""The page that shows, mends and labels frames: its server, and reports of one file."""

from fieldcalib._modules import lazy_modules

__getattr__, __dir__, __all__ = lazy_modules(__name__, __path__)
