"""What an image shows of the paint of known markings, and how wide it is.

`line_profiles` samples the image across projected markings; `detected_lines` finds their lines as labelled pixels;
`paint_evidence` says which markings lie on paint and which beside it; `field_markings` holds the markings of a field as
these need them.
"""

import lazy_loader

# For users there is nothing here, and Tab shows nothing: modules are imported by their paths.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
