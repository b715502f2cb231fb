"""Simulated labels of a pan over a field, and the errors of cameras against the truth."""

from dataclasses import astuple

import numpy as np
import pytest

from data_tools.simulated import IMAGE_SIZE, observe, pan_over_field
from fieldcalib.fields.segments import Arc
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.geometry.camera import Camera
from fieldcalib.metrics.cameras import camera_difference

FIELD = soccer()


def test_errors_of_the_true_camera_are_zero():
    truth = pan_over_field(3)[1]
    np.testing.assert_allclose(astuple(camera_difference(truth, truth, FIELD)), 0.0, atol=1e-9)


def test_errors_of_known_displacements():
    truth = Camera.from_angles(np.radians(179.9), np.radians(75), 0.0, 1000.0, (0, -60, -15), IMAGE_SIZE)
    other = Camera.from_angles(np.radians(-179.9), np.radians(76), 0.01, 1010.0, (3, -56, -15), IMAGE_SIZE)
    errors = camera_difference(other, truth, FIELD)
    expected = (1.0, 5.0, 0.2, 1.0, np.degrees(0.01))
    np.testing.assert_allclose(astuple(errors)[:5], expected, atol=1e-9)
    shifted = Camera(truth.K + np.array([[0, 0, 3], [0, 0, 4], [0, 0, 0]]), truth.R, truth.C, IMAGE_SIZE)
    assert camera_difference(shifted, truth, FIELD).reprojection == pytest.approx(5.0)
    behind = Camera.from_angles(0.0, np.radians(75), 0.0, 1000.0, (0, -60, -15), IMAGE_SIZE)
    assert camera_difference(behind, truth, FIELD).reprojection == np.inf


# what is labelled


def test_every_frame_of_the_pan_has_enough_labels_and_goals_are_seen():
    labels = [set(observe(camera, FIELD, np.random.default_rng(0), 1.0)) for camera in pan_over_field(12)]
    assert min(len(frame) for frame in labels) >= 6
    goals = [any(label.startswith("Goal") for label in frame) for frame in labels]
    assert goals[0]
    assert goals[-1]
    assert "Circle central" in labels[5]
    for frame in labels:
        assert frame <= set(FIELD)
        assert not {"Circle central left", "Circle central right"} & frame


@pytest.mark.parametrize("camera", pan_over_field(5))
def test_labels_without_noise_lie_on_the_markings(camera):
    for label, xy in observe(camera, FIELD, np.random.default_rng(0), 0.0).items():
        curve = camera.project(FIELD[label].sample(0.005))
        distance = np.linalg.norm(xy[:, None] - curve[None], axis=-1).min(axis=1)
        assert distance.max() < 0.1
        assert len(xy) == 9 if isinstance(FIELD[label], Arc) else len(xy) in (2, 3)
        assert len(np.unique(xy.round(3), axis=0)) == len(xy)


@pytest.mark.slow
def test_the_noise_is_as_asked_for():
    camera, offsets = pan_over_field(3)[0], []
    curve = camera.project(FIELD["Circle left"].sample(0.005))
    rng = np.random.default_rng(0)
    for _ in range(200):
        xy = observe(camera, FIELD, rng, 2.0)["Circle left"]
        nearest = np.linalg.norm(xy[:, None] - curve[None], axis=-1).argmin(axis=1)
        offsets.append(xy - curve[nearest])  # across the curve, so one of the two dimensions
    assert np.sqrt(np.mean(np.sum(np.square(offsets), axis=-1))) == pytest.approx(2.0, rel=0.1)


def test_labels_are_inside_the_image():
    rng = np.random.default_rng(0)
    for camera in pan_over_field(4):
        for _ in range(20):
            xy = np.concatenate(list(observe(camera, FIELD, rng, 4.0).values()))
            assert np.all((xy >= 0.0) & (xy <= np.array(IMAGE_SIZE) - 1.0))
