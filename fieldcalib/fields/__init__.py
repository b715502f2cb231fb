"""Calibration objects: segments, fields with their sizes and symmetry, and where their cameras stand.

The fields of all sports are functions of this package: `fieldcalib.fields.basketball("fiba")`.
"""

import lazy_loader

# What there is stands in __init__.pyi; it is imported when it is used.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
