"""Calibration objects: segments, fields with their sizes and symmetry, and where their cameras stand.

The field of every sport is a function here, `fieldcalib.fields.basketball("fiba")`, and has a name:
`fieldcalib.field("basketball-fiba")`.
"""

import lazy_loader

# The names are listed in __init__.pyi; each is imported when it is first used.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
