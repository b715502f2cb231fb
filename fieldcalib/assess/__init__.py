"""Assessment of solved problems: uncertainty, probability, the paper's losses, the verdict, the result."""

from fieldcalib._modules import lazy_modules

__getattr__, __dir__, __all__ = lazy_modules(__name__, __path__)
