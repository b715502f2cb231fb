"""The camera of a picture without a network, by search: from stripes and lines to ranked and refined cameras.

`court_search` draws the way; `place_search` goes it from a known place of the camera.
"""

import lazy_loader

# For users there is nothing here, and Tab shows nothing: modules are imported by their paths.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
