"""Pictures of courts of another shape than 16:9 by search: their shape is asked for only where it matters."""

import pytest
from pictures import picture

from data_tools.probability import largest_true_error
from fieldcalib.assess.findings import Verdict, What
from fieldcalib.fields.catalogue import tennis
from fieldcalib.geometry.camera import Camera
from fieldcalib.images.from_images import calibrate_from_images

COURT = tennis()


@pytest.mark.parametrize(
    ("size", "y"), [((960, 640), 14.0), pytest.param((960, 720), 16.0, marks=pytest.mark.slow)], ids=["3:2", "4:3"]
)
def test_a_court_is_good_if_its_shape_moves_no_place(size, y):
    truth = Camera.from_angles(0.2, 1.25, 0.0, 1100.0, (0.0, y, -4.2), size)
    shown = picture(truth, COURT)
    (found,) = calibrate_from_images(COURT, [shown])
    assert found.verdict is Verdict.GOOD
    assert largest_true_error(found.camera, truth, COURT) < COURT.tolerance
    (open_one,) = calibrate_from_images(COURT, [shown], estimate_aspect=False)
    assert open_one.has_finding(What.SHAPE)
