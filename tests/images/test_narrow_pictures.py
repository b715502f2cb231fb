"""Narrow pictures in which a network finds the field once they are padded."""

import numpy as np
from networks import CLASSES, FIELD, GRID, KnownCameras, seen_by
from pictures import picture

from fieldcalib import Camera, calibrate_from_images
from fieldcalib.assess.findings import Verdict, What
from fieldcalib.metrics.cameras import camera_difference

ANGLES, f, C = (0.45, 1.33, 0.0), 1400.0, (5.0, 66.0, -17.0)
UPRIGHT, PADDED = (Camera.from_angles(*ANGLES, f, C, size) for size in ((420, 560), (747, 560)))


class SeesWide:
    """A network that knows pictures of the padded shape, and finds nothing in others."""

    classes = CLASSES

    def __call__(self, images):
        blind = KnownCameras([None]).maps[0]
        wide = seen_by(PADDED, GRID)
        return np.stack([wide if image.shape[1::-1] == PADDED.image_size else blind for image in images])


def test_a_narrow_picture_is_looked_at_padded():
    (found,) = calibrate_from_images(FIELD, [picture(UPRIGHT)], SeesWide(), estimate_size=False)
    assert found.verdict is Verdict.CHECK
    assert found.has_finding(What.SHAPE)
    assert "no camera" not in found.message
    assert camera_difference(found.camera, UPRIGHT, FIELD).reprojection < 3.0


def test_a_picture_of_square_pixels_is_looked_at_as_it_is():
    (found,) = calibrate_from_images(FIELD, [picture(UPRIGHT)], SeesWide(), estimate_aspect=False)
    assert "the network's labels gave no camera" in found.message
