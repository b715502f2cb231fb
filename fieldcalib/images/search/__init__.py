"""Search for the camera of a picture without a network: from stripes and lines to ranked and refined cameras.

`court_search` has the steps, with a drawing; `place_search` does the same where the place of the camera is known.
"""

import lazy_loader

# For users there is nothing here, and Tab shows nothing: modules are imported by their paths.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
