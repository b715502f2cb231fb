"""Pictures of wide action cameras: found with k1, their cameras are refined with a fisheye lens."""

import numpy as np
import pytest

from fieldcalib import Camera, calibrate_from_images
from fieldcalib.assess.findings import Verdict
from fieldcalib.assess.probability import largest_move
from fieldcalib.draw.scene import render_field
from fieldcalib.fields import tennis
from fieldcalib.solve.solver_options import LENS_FLAGS

SIZE, COURT = (960, 540), tennis()


def action_camera(degrees):
    """An equidistant lens of a field of view, beside the court."""
    f = SIZE[0] / np.radians(degrees)
    return Camera.from_angles(0.35, 1.15, 0.01, f, (-4.0, 9.5, -5.0), SIZE, k=(0.0, 0.0, 0.0, 0.0), fisheye=True)


@pytest.mark.parametrize(
    ("degrees", "lens"),
    [(110.0, "k1"), *(pytest.param(*one, marks=pytest.mark.slow) for one in ((110.0, "fisheye"), (125.0, "k1")))],
)
def test_a_court_is_found_through_a_fisheye_lens(degrees, lens):
    truth = action_camera(degrees)
    (found,) = calibrate_from_images(COURT, [render_field(truth, COURT)], flags=LENS_FLAGS[lens])
    assert found.verdict is Verdict.GOOD
    assert found.camera.fisheye
    assert largest_move(truth, found.camera, COURT) < 0.5 * COURT.tolerance


def test_a_lens_that_the_user_chose_is_kept():
    (found,) = calibrate_from_images(COURT, [render_field(action_camera(110.0), COURT)], flags=LENS_FLAGS["k1k2"])
    assert not found.camera.fisheye
