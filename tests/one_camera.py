"""A camera in the stand, and what it sees of the field."""

import numpy as np
from synthetic import observe, whole_circle_markings

from fieldcalib import Camera, soccer
from fieldcalib.geometry.lens import RadialLens
from fieldcalib.solve.solver_options import CalibrationFlags

FIELD, SIZE = soccer(), (960, 540)
MARKINGS = whole_circle_markings(FIELD)
CAMERA = Camera.from_angles(-0.35, 1.36, 0.01, 1700.0, (1.5, 68.0, -17.0), SIZE)
LITTLE_OF_THE_LENS = ("Side line top", "Side line left", "Big rect. left top", "Circle left")
FRAME = observe(MARKINGS, CAMERA)
F = CalibrationFlags


def with_lens(camera, a1):
    """The same camera with a lens that moves the corner by a1."""
    k = RadialLens(camera.half_diagonal).to_opencv(np.array([a1, 0.0]), camera.focal_length)
    return Camera(camera.K, camera.R, camera.C, camera.image_size, k)
