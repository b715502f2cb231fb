"""The camera of a picture without a network, by search: from stripes and lines to ranked and refined cameras.

`court_search` draws the way; `place_search` goes it from a known place of the camera.
"""

from fieldcalib._modules import lazy_modules

__getattr__, __dir__, __all__ = lazy_modules(__name__, __path__)
