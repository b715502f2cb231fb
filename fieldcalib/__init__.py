"""fieldcalib: calibrate cameras from the markings of a sports field.

    >>> import fieldcalib
    >>> field = fieldcalib.soccer(length=105.0, width=68.0)
    >>> camera = fieldcalib.Camera.from_angles(0.2, 1.35, 0.0, 1500.0, (0.0, 65.0, -16.0), (960, 540))
    >>> labels = ("Side line top", "Side line right", "Big rect. right main", "Circle right")
    >>> pixels = {label: camera.project(field[label].sample(8.0)) for label in labels}
    >>> calibration = fieldcalib.calibrate_from_segments(field, pixels, (960, 540))
    >>> str(calibration.status)
    'accepted'

World: metres, origin at the centre mark, x right along the touchline as the main camera sees it, y towards the main
camera, z down. Pixels: (x, y), the first pixel's centre at (0, 0); image sizes are (width, height).
"""

import lazy_loader

__version__ = "0.1.0"

# The public names are listed in __init__.pyi, which editors and type checkers read; each is imported when first used.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
