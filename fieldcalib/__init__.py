"""Camera calibration from the markings of a sports field."""

__version__ = "0.1.0"
