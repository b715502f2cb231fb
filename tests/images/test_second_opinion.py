"""Pictures whose network sees too little, or other lines than they show: the field is searched for."""

import re

import numpy as np
import pytest
from networks import FIELD, KnownCameras
from pictures import picture
from views import camera

from fieldcalib import KNOWN_INTRINSICS_FLAGS, Camera, calibrate_from_images, soccer
from fieldcalib.assess.findings import Status
from fieldcalib.metrics.cameras import camera_difference

TRUTHS = [camera(pan, 78, 1400, (0, 68, -17), k=(0.06, 0.0)) for pan in (24, -22)]


class Blind:
    """A network that finds nothing."""

    classes = ("background", "Middle line")

    def __call__(self, images):
        return np.zeros((len(images), 2, 90, 160), np.float32)


VIEW = Camera.from_angles(0.1, 1.3, 0.0, 1000.0, (0.0, 60.0, -20.0), (960, 540))


def test_a_pitch_is_searched_for_where_the_network_sees_nothing():
    image = picture(VIEW, soccer())
    (found,) = calibrate_from_images(soccer(), [image], Blind())
    assert found.accepted
    assert "the network's labels gave no camera" in found.message
    X = np.array([[0.0, 0.0, 0.0], [10.0, 5.0, 0.0], [-20.0, -10.0, 0.0]])
    np.testing.assert_allclose(found.camera.project(X), VIEW.project(X), atol=1.5)


KNOWN = {"camera_matrix": VIEW.K, "flags": KNOWN_INTRINSICS_FLAGS}


@pytest.mark.parametrize("how", [{"refine": False}, KNOWN], ids=["not refined", "with a matrix"])
def test_nothing_is_searched_for_where_more_is_asked(how):
    (found,) = calibrate_from_images(soccer(), [picture(VIEW, soccer())], Blind(), **how)
    assert found.status == Status.TOO_FEW_SEGMENTS


def test_a_network_that_lies_is_corrected_by_a_search():
    (calibration,) = calibrate_from_images(FIELD, [picture(TRUTHS[1])], KnownCameras([TRUTHS[0]]))
    assert calibration.accepted
    assert "the network's labels gave no camera" in calibration.message
    assert camera_difference(calibration.camera, TRUTHS[1], FIELD).reprojection < 1.5


def test_a_network_that_lies_is_found_out_where_a_search_finds_nothing():
    grass = picture(TRUTHS[1])
    grass[:] = np.median(grass, axis=(0, 1))
    (calibration,) = calibrate_from_images(FIELD, [grass], KnownCameras([TRUTHS[0]]))
    assert str(calibration.status) == "probably wrong"
    assert re.match(
        r"only \d % line support: the image has few lines at the projected markings; rms", calibration.message
    )
    assert camera_difference(calibration.camera, TRUTHS[0], FIELD).reprojection < 10.0  # given all the same
