"""Pitches of any size and shape, and whether a probability holds on them."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from data_tools import pitches
from data_tools.crown import crowned, crowned_ground, on_crown
from data_tools.probability import largest_true_error
from fieldcalib import Camera, soccer
from fieldcalib.assess.result import Calibration
from fieldcalib.draw.ground import Ground, rays

CAMERA = Camera.from_angles(0.3, 1.3, 0.01, 500.0, (3.0, 60.0, -15.0), (320, 180), k=(0.1, 0.0))
FIELD = soccer()


@given(crown=st.floats(0.0, 0.5))
def test_rays_meet_the_crowned_ground_where_the_camera_sees_it(crown):
    ground = crowned_ground(CAMERA, rays(CAMERA), FIELD, crown)
    rows, columns = np.nonzero(np.isfinite(ground.xy).all(axis=0))
    X = np.column_stack([ground.xy[:, rows, columns].T, np.zeros(len(rows))])
    near = np.abs(X[:, 1]) < 60.0
    xy = CAMERA.project(on_crown(X[near], FIELD, crown))
    np.testing.assert_allclose(xy, np.column_stack([columns, rows])[near], atol=0.02)


def test_a_level_ground_is_no_crown():
    level = Ground.of_rays(CAMERA, rays(CAMERA))
    np.testing.assert_allclose(crowned_ground(CAMERA, rays(CAMERA), FIELD, 0.0).xy, level.xy, rtol=1e-5)


def test_markings_on_a_crown_keep_their_places():
    field = crowned(FIELD, 0.3)
    assert np.all(field["Side line top"].sample()[:, 2] == 0.0)
    middle = field["Circle central"].sample()
    np.testing.assert_allclose(np.hypot(middle[:, 0], middle[:, 1]), 9.15, atol=1e-6)
    assert np.all((middle[:, 2] < -0.27) & (middle[:, 2] >= -0.3))
    assert "Circle central left" not in field
    crossbar, post = field["Goal left crossbar"].sample(), field["Goal left post left "].sample()
    np.testing.assert_allclose(crossbar[:, 2], -2.74, atol=0.005)  # goals stand on the ground
    np.testing.assert_allclose(np.ptp(post[:, 2]), 2.44)


@given(crown=st.floats(0.05, 0.5))
def test_a_right_camera_is_off_by_what_the_crown_hides(crown):
    """A camera that takes a crown for level sees its points where the rays go on to the level ground."""
    error = largest_true_error(CAMERA, CAMERA, FIELD, crown=crown)
    steepest = np.hypot(*(CAMERA.C[:2] - (0.0, -20.0))) / -CAMERA.C[2]
    assert crown < error < 1.5 * crown * steepest
    assert largest_true_error(CAMERA, CAMERA, FIELD) < 1e-6


def judged(p: float, error: float) -> pitches.Judged:
    class Sure(Calibration):
        def probability(self, metres: float | None = None, *, size_known: bool = False) -> float:
            return p

    return pitches.Judged("clips", Sure.__new__(Sure), error)


def test_bins_compare_probabilities_with_shares():
    some = [judged(0.2, 2.0)] * 500 + [judged(0.9, 0.3)] * 450 + [judged(0.9, 3.0)] * 50
    found = pitches.reliability_of_bins(some, 1.0)
    assert found["probability_right"] == [[20.0, 0.0], [90.0, 90.0]]
    assert found["gap"] == [10.0, 20.0]


@pytest.mark.parametrize(
    "what", [pytest.param(("clips", "--clips", "2"), marks=pytest.mark.slow), ("pictures", "--frames", "1")]
)
def test_the_command_prints_what_it_measured(what, capsys):
    assert pitches.main([*what, "--seed", "3"]) == 0
    first, *_ = map(json.loads, capsys.readouterr().out.splitlines())
    assert first["kind"] == what[0]
    assert 0 <= first["good_and_wrong"] <= first["good"] <= first["frames"]
