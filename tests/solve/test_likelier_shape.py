"""Pictures of other shapes than 16:9: whole, squashed or cut out, their ground is known where all of these agree."""

from functools import partial

import numpy as np
import pytest
from synthetic import whole_circle_markings

from fieldcalib.assess.findings import Verdict, What
from fieldcalib.assess.probability import largest_move
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.geometry.camera import Camera
from fieldcalib.solve.batch import calibrate_batch
from fieldcalib.solve.likelier_shape import with_likely_aspect

FIELD = soccer()
MARKINGS = whole_circle_markings(FIELD)
NOISE = 0.7  # px


def found(camera):
    """The calibration of all markings in view, with the shape of the picture estimated."""
    rng, frame, last = np.random.default_rng(0), {}, np.subtract(camera.image_size, 1.0)
    for label, segment in MARKINGS.items():
        xy = camera.project(segment.sample(2.0))
        xy = xy[np.all((xy >= 0.0) & (xy <= last), axis=1)]
        if len(xy) > 2:
            frame[label] = xy + rng.normal(0.0, NOISE, xy.shape)
    calibrate = partial(calibrate_batch, FIELD)
    return with_likely_aspect(FIELD, calibrate, [frame], camera.image_size, estimated=True)[0]


def seen(pan, size):
    return Camera.from_angles(pan, 1.33, 0.0, 900.0, (0.0, 65.0, -16.0), size)


@pytest.mark.parametrize(
    "camera",
    [
        seen(0.15, (810, 540)),
        seen(0.15, (720, 540)),
        seen(0.15, (960, 540)).cropped((90, 0), (720, 540)),
        seen(0.15, (960, 540)).scaled((720, 540)),
    ],
    ids=["3:2", "4:3", "cut to 4:3", "squashed to 4:3"],
)
def test_the_ground_is_known_whatever_was_done_to_a_picture_of_midfield(camera):
    one = found(camera)
    assert one.verdict is Verdict.GOOD
    assert one.has_finding(What.GROUND_ONLY)
    assert "only the ground is known" in one.message
    assert largest_move(camera, one.camera, FIELD) < FIELD.tolerance


def test_heights_are_known_where_the_labels_tell_the_shape():
    truth = seen(0.45, (720, 540))
    one = found(truth)
    assert one.verdict is Verdict.GOOD
    assert not one.has_finding(What.GROUND_ONLY)
    np.testing.assert_allclose(one.camera.C, truth.C, rtol=0, atol=0.5)


def test_a_half_of_a_frame_is_asked_for():
    one = found(seen(0.15, (960, 540)).cropped((0, 0), (480, 540)))
    assert one.verdict is Verdict.CHECK
    assert one.has_finding(What.SHAPE)
