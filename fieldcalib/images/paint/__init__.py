"""Search for the paint of projected markings in an image: its lines, its place and its width.

`line_profiles` samples the markings of a field, and the image across them where a camera projects them;
`detected_lines` finds their lines as labelled pixels; `paint_evidence` decides which markings lie on paint and which
beside it.
"""

import lazy_loader

# For users there is nothing here, and Tab shows nothing: modules are imported by their paths.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
