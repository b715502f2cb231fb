"""Shots that were taken from the same place."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import any_angles, bounded, numbers

from data_tools.synthetic.clips import labelled
from fieldcalib import Camera, calibrate_sequence, soccer
from fieldcalib.geometry.rotation import rotation_from_angles
from fieldcalib.images.clip.clip_models import Pieces
from fieldcalib.images.clip.keyframes import KeyframeLabels, Keyframes, Shots
from fieldcalib.images.clip.solved_shots import (
    LEAST_LOG_RATIO,
    grouped_by_tripod,
    same_tripod_log_ratio,
    solve_shots,
    solve_tripods,
)
from fieldcalib.images.from_images import How
from fieldcalib.problem.labelled_pixels import PixelTable
from fieldcalib.solve.request import Task

PLACE = ("x", "y", "z")
SIZED = (*PLACE, "length", "width")
NOTHING = calibrate_sequence(soccer(), [{}], (960, 540))
HERE = np.array([1.0, 66.0, -16.0])


def place(values, covariance, names=PLACE):
    """What a shot of one frame says."""
    return replace(NOTHING, names=names, values=np.array(values, dtype=float), covariance=covariance, layout=None)


def covariance(sigma, axes):
    """A covariance whose standard deviations go from a third of sigma to sigma along the rows of a rotation."""
    return axes.T * np.square(np.linspace(sigma / 3.0, sigma, 3)) @ axes


def seen(rng, true, sigma):
    V = covariance(sigma, rotation_from_angles(rng.uniform(-np.pi, np.pi, 3)))
    return place(rng.multivariate_normal(true, V), V)


@st.composite
def estimates(draw, true, sigma):
    """A place that errs by up to two standard deviations along each axis of its covariance."""
    axes = rotation_from_angles(draw(any_angles()))
    off = draw(bounded(3, -2.0, 2.0)) * np.linspace(sigma / 3.0, sigma, 3)
    return place(true + off @ axes, covariance(sigma, axes))


def test_shots_of_one_tripod_are_one_group():
    """Nearly always: an estimate that errs by three standard deviations may be of another place."""
    rng, whole = np.random.default_rng(0), 0
    for _ in range(100):
        sigmas = rng.choice([0.1, 0.2, 0.4, 0.8], size=4)
        whole += len(grouped_by_tripod({k: seen(rng, HERE, sigma) for k, sigma in enumerate(sigmas)})) == 1
    assert whole >= 85


@pytest.mark.parametrize("sigma", [0.02, 0.1, 0.15])
def test_a_camera_beside_is_another_one(sigma):
    rng, apart = np.random.default_rng(1), 0
    for _ in range(100):
        angle = rng.uniform(0.0, 2.0 * np.pi)
        beside = HERE + 1.2 * np.array([np.cos(angle), np.sin(angle), 0.0])
        shots = {k: seen(rng, true, sigma) for k, true in enumerate((HERE, beside, HERE, beside))}
        apart += grouped_by_tripod(shots) in ([[0, 2], [1, 3]], [[1, 3], [0, 2]])
    assert apart >= 90


@given(st.data(), numbers(0.05, 0.3), numbers(10.0, 60.0))
def test_a_camera_elsewhere_is_another_one(data, sigma, distance):
    there = HERE + (distance, 0.0, 0.0)
    assert len(grouped_by_tripod({k: data.draw(estimates(true, sigma)) for k, true in enumerate((HERE, there))})) == 2


@given(numbers(0.0, 1.0))
def test_places_that_are_hardly_known_are_not_joined(distance):
    vague = place(HERE + (distance, 0.0, 0.0), 400.0 * np.eye(3))
    assert sorted(map(tuple, grouped_by_tripod({0: place(HERE, 0.01 * np.eye(3)), 1: vague}))) == [(0,), (1,)]


def test_the_direction_that_is_not_known_may_differ():
    """Along the view distance and zoom trade off: there an estimate may be off by metres, across it not."""
    long = np.diag([0.1, 3.0, 0.1]) ** 2
    sure = place(HERE, 0.01 * np.eye(3))
    assert grouped_by_tripod({0: sure, 1: place(HERE + (0.0, 2.5, 0.0), long)}) == [[0, 1]]
    assert grouped_by_tripod({0: sure, 1: place(HERE + (2.5, 0.0, 0.0), long)}) == [[0], [1]]


def test_places_that_are_very_sure_still_agree_to_a_decimetre():
    sure = 1e-4 * np.eye(3)
    assert grouped_by_tripod({0: place(HERE, sure), 1: place(HERE + (0.15, -0.1, 0.05), sure)}) == [[0, 1]]
    assert grouped_by_tripod({0: place(HERE, sure), 1: place(HERE + (1.0, 0.0, 0.0), sure)}) == [[0], [1]]


def test_shots_whose_place_was_not_found_are_in_no_group():
    sure = place(HERE, 0.01 * np.eye(3))
    assert grouped_by_tripod({}) == []
    assert grouped_by_tripod({0: NOTHING, 1: NOTHING}) == []
    assert grouped_by_tripod({5: NOTHING, 7: sure, 2: NOTHING, 3: sure}) == [[3, 7]]


def test_the_most_certain_place_comes_first():
    axes = rotation_from_angles(np.array([0.5, 1.0, -0.3]))
    there = HERE + (20.0, 0.0, 0.0)
    shots = {
        0: place(HERE, covariance(0.5, axes)),
        4: place(there, covariance(0.1, axes)),
        9: place(HERE, 0.16 * np.eye(3)),
    }
    assert grouped_by_tripod(shots) == [[4], [0, 9]]
    assert grouped_by_tripod(dict(reversed(shots.items()))) == [[4], [0, 9]]


def test_a_shot_joins_the_group_that_it_most_probably_belongs_to():
    near = HERE + (1.5, 0.0, 0.0)
    shots = {
        0: place(HERE, 0.01 * np.eye(3)),
        1: place(near, 0.011 * np.eye(3)),
        2: place(near - (0.3, 0.0, 0.0), np.eye(3)),
    }
    assert grouped_by_tripod(shots) == [[0], [1, 2]]


def test_the_size_of_the_field_is_the_same_in_any_case():
    """A place that is off because the size is, is not another one."""
    V = np.diag([0.1, 0.5, 0.1, 0.3, 0.5]) ** 2
    V[1, 4] = V[4, 1] = 0.95 * 0.5 * 0.5
    off = np.array([0.0, 1.0, 0.0, 0.0, 1.0])
    one, two = (place([*HERE, 105.0, 68.0] + k * off, V, SIZED) for k in (-0.5, 0.5))
    assert grouped_by_tripod({0: one, 1: two}) == [[0, 1]]
    alone = same_tripod_log_ratio(off[:3], 2.0 * V[:3, :3])
    assert same_tripod_log_ratio(off, 2.0 * V) > alone  # than the place by itself says
    assert grouped_by_tripod({0: one, 1: place(HERE, V[:3, :3])}) == [[0, 1]]  # of which one tells no size


def test_what_else_is_shared_is_no_matter():
    names = ("x", "y", "z", "cx", "width", "axis offset")
    V = 0.01 * np.eye(6)
    one = place([*HERE, 960.0, 68.0, 0.3], V, names)
    two = place([*HERE, 900.0, 68.05, 2.0], V, names)
    assert grouped_by_tripod({0: one, 1: two}) == [[0, 1]]


@pytest.mark.slow
def test_shots_that_do_not_tell_the_size_of_the_pitch_take_it_from_others():
    """One of two cameras sees a penalty area and the middle of a pitch of 98 m, the other one only a penalty area."""
    views = [(0.2 + 0.04 * k, (0.0, 60.0, -14.0)) for k in range(5)]
    views += [(-0.55 - 0.03 * k, (12.0, 70.0, -8.0)) for k in range(5)]
    cameras = [Camera.from_angles(pan, 1.3, 0.0, 1700.0, place, (960, 540)) for pan, place in views]
    frames = labelled(cameras, soccer(98.0), np.random.default_rng(0), 0.5)
    labels = {t: KeyframeLabels(PixelTable.of(soccer(), [one.pixels])) for t, one in enumerate(frames)}
    pieces = Pieces(np.repeat([0, 1], 5))
    keyframes = Keyframes(How(Task(soccer())), Shots(0, (960, 540), pieces, np.zeros(10, dtype=bool), {}), labels)
    shots = solve_shots(keyframes, only_tripods=True)
    assert shots.calibrations[1].field.length == 105.0
    found = solve_tripods(shots)
    assert [one.pieces for one in found.tripods] == [(0,), (1,)]
    for one in found.tripods:
        assert one.calibration.field.length == pytest.approx(98.0, abs=0.5)
    assert "length" not in found.tripods[1].calibration.names  # it is as uncertain as before


@given(numbers(0.05, 2.0), any_angles(), any_angles(), numbers(0.1, 3.0))
def test_the_ratio_falls_with_the_distance_and_is_symmetric(sigma, axes, turn, distance):
    V = covariance(sigma, rotation_from_angles(axes))
    direction = distance * rotation_from_angles(turn)[2]
    ratios = [same_tripod_log_ratio(k * direction, V) for k in (0.0, 0.5, 1.0, 2.0)]
    assert np.all(np.diff(ratios) < 0.0)
    np.testing.assert_allclose(same_tripod_log_ratio(-direction, V), ratios[2], rtol=1e-9)


def test_the_ratio_says_how_often_it_is_one_tripod():
    """Of places drawn as the model has it, those with a ratio of more than e are one tripod in more than half."""
    rng, right, all_of_them = np.random.default_rng(3), 0, 0
    for _ in range(2000):
        same, sigma = rng.random() < 0.5, rng.choice([0.1, 0.3, 1.0])
        V = sigma**2 * np.eye(3)
        apart = 0.0 if same else rng.choice([1.5, 15.0])
        difference = rng.normal(size=3) * np.sqrt(sigma**2 + 2.0 * 0.1**2 + apart**2)
        ratio = same_tripod_log_ratio(difference, V)
        if ratio >= LEAST_LOG_RATIO:
            right, all_of_them = right + same, all_of_them + 1
    assert all_of_them > 500
    assert right / all_of_them > np.exp(LEAST_LOG_RATIO) / (1.0 + np.exp(LEAST_LOG_RATIO))
