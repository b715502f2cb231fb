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

from importlib import import_module
from types import ModuleType

from fieldcalib.calibrate import calibrate_batch, calibrate_from_segments
from fieldcalib.calibrate_homography import calibrate_from_homography
from fieldcalib.calibrate_images import calibrate_from_images
from fieldcalib.calibrate_points import calibrate_from_points
from fieldcalib.camera import Camera
from fieldcalib.field import Arc, Field, Line, Point, PointCloud, soccer
from fieldcalib.field_size import FieldSize, estimate_field_size
from fieldcalib.homography import ALIGNMENTS, Alignment, Decomposition, camera_from_homography
from fieldcalib.localize import SegmentationNetwork
from fieldcalib.losses import RobustLoss
from fieldcalib.options import DEFAULT_FLAGS, PINHOLE_FLAGS, CalibrationFlags
from fieldcalib.parameters import DISTRIBUTIONS, CameraDistribution
from fieldcalib.refine import refine_on_image
from fieldcalib.result import Calibration, Status


def __getattr__(name: str) -> ModuleType:
    """Subpackages that are imported when they are used: `fieldcalib.draw`, `fieldcalib.io`, `fieldcalib.metrics`."""
    if name in ("draw", "io", "metrics"):
        return import_module(f"fieldcalib.{name}")
    raise AttributeError(f"module 'fieldcalib' has no attribute {name!r}")


__version__ = "0.1.0"

__all__ = [
    "ALIGNMENTS",
    "DEFAULT_FLAGS",
    "DISTRIBUTIONS",
    "PINHOLE_FLAGS",
    "Alignment",
    "Arc",
    "Calibration",
    "CalibrationFlags",
    "Camera",
    "CameraDistribution",
    "Decomposition",
    "Field",
    "FieldSize",
    "Line",
    "Point",
    "PointCloud",
    "RobustLoss",
    "SegmentationNetwork",
    "Status",
    "calibrate_batch",
    "calibrate_from_homography",
    "calibrate_from_images",
    "calibrate_from_points",
    "calibrate_from_segments",
    "camera_from_homography",
    "estimate_field_size",
    "refine_on_image",
    "soccer",
]
