"""Cameras that stand on no tripod: a smooth path of the centre, and the ground alone as background."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from networks import KnownCameras, looked_at
from strategies import bounded, generators
from tripods import SIZE, far_off

from data_tools.synthetic.clips import background_matches, labelled
from data_tools.synthetic.film import Scene, film
from data_tools.synthetic.paths import camera_path, flight
from fieldcalib import Camera, calibrate_batch, calibrate_sequence, calibrate_video, soccer
from fieldcalib.assess.frame_table import Basis
from fieldcalib.images.background.background_motion import background_motion, mapped, plane_motion
from fieldcalib.io.samples import TrueFrame
from fieldcalib.problem.layout import CENTER, GaussianPrior
from fieldcalib.solve.sequence.sequence_problem import SHARED_IN_MOTION
from fieldcalib.solve.sequence.sequence_solver import OFF_PATH
from fieldcalib.solve.sequence.tripod_position import (
    ACCELERATION,
    SPEED,
    Centres,
    KnownCentres,
    expected_centres,
    on_path,
)

FIELD = soccer(size_known=True)
COUNT = 61


@pytest.fixture(scope="module")
def cameras():
    rng = np.random.default_rng(4)
    return camera_path(rng, COUNT, centre=flight(rng, COUNT), image_size=SIZE)


@pytest.fixture(scope="module")
def frames(cameras):
    """Labels in every sixth frame."""
    found = labelled(cameras, FIELD, np.random.default_rng(1), 0.5)
    return [frame.pixels if t % 6 == 0 else {} for t, frame in enumerate(found)]


@pytest.fixture(scope="module")
def matches(cameras):
    rng = np.random.default_rng(2)
    ground = np.pad(rng.uniform((-60.0, -40.0), (60.0, 40.0), (3000, 2)), ((0, 0), (0, 1)))
    pairs = [(key, t) for key in range(0, COUNT, 6) for t in (*range(key + 1, key + 7), key + 12) if t < COUNT]
    return {
        (one.first, one.second): (one.xy_first, one.xy_second)
        for one in background_matches(cameras, pairs, ground, rng)
    }


def off(found, cameras):
    """Distances of the centres that were found, metres."""
    return np.array([np.linalg.norm(c.camera.C - t.C) for c, t in zip(found, cameras, strict=True) if c.camera])


# a sequence


@pytest.mark.slow
def test_every_frame_of_a_flight_is_calibrated(cameras, frames, matches):
    found = calibrate_sequence(FIELD, frames, SIZE, shared=SHARED_IN_MOTION, matches=matches)
    assert found.accepted.all()
    assert {"x", "y", "z"}.isdisjoint(found.names)
    assert np.median(off(found, cameras)) < 0.15
    assert np.ptp([frame.camera.C for frame in found], axis=0).max() > 0.5
    errors = [np.median(far_off(frame.camera, truth)) for frame, truth in zip(found, cameras, strict=True)]
    assert max(errors) < 2.0
    inside = [
        (frame.camera.C - truth.C) @ np.linalg.solve(frame.covariance[CENTER, CENTER], frame.camera.C - truth.C) < 7.8
        for frame, truth in zip(found, cameras, strict=True)
    ]
    assert np.mean(inside) > 0.85
    # on a tripod they cannot all be
    fixed = calibrate_sequence(FIELD, frames, SIZE, matches=matches)
    assert np.median(off(fixed, cameras)) > 3.0 * np.median(off(found, cameras))


@pytest.mark.slow
def test_a_path_tells_more_than_single_frames(cameras):
    labels = [frame.pixels for frame in labelled(cameras, FIELD, np.random.default_rng(5), 1.0)]
    on_a_path = calibrate_sequence(FIELD, labels, SIZE, shared=SHARED_IN_MOTION)
    single = [one for one, labels in zip(calibrate_batch(FIELD, labels, SIZE), labels, strict=True)]
    both = [t for t in range(COUNT) if on_a_path[t].accepted and single[t].accepted]
    assert len(both) > COUNT // 2
    errors, sigmas = (
        np.median([f(found[t], cameras[t]) for t in both])
        for found in (on_a_path,)
        for f in (
            lambda c, t: np.linalg.norm(c.camera.C - t.C),
            lambda c, _: np.sqrt(np.trace(c.covariance[CENTER, CENTER])),
        )
    )
    of_single = np.median([np.linalg.norm(single[t].camera.C - cameras[t].C) for t in both])
    assert errors < 0.7 * of_single
    assert sigmas < np.median([np.sqrt(np.trace(single[t].covariance[CENTER, CENTER])) for t in both])
    assert {on_a_path.basis[t] for t in both} == {Basis.LINES}


def test_a_frame_of_another_place_is_off_the_path(cameras):
    labels = [frame.pixels for frame in labelled(cameras[:20], FIELD, np.random.default_rng(5), 0.3)]
    far = Camera.from_angles(0.1, 1.3, 0.0, 1500.0, (-20.0, 75.0, -30.0), SIZE)
    (elsewhere,) = labelled([far], FIELD, np.random.default_rng(6), 0.3)
    assert calibrate_batch(FIELD, [elsewhere.pixels], SIZE)[0].accepted
    found = calibrate_sequence(FIELD, [*labels[:7], elsewhere.pixels, *labels[8:]], SIZE, shared=SHARED_IN_MOTION)
    assert (found[7].camera, found[7].message) == (None, OFF_PATH)
    assert not found.usable[7]  # where there is no camera, none is taken up by the next solution
    others = [t for t in range(20) if t != 7 and found[t].accepted]
    assert len(others) > 10
    assert max(np.linalg.norm(found[t].camera.C - cameras[t].C) for t in others) < 2.0


@pytest.mark.slow
def test_a_path_goes_on_between_frames_with_cameras(cameras, frames, matches):
    known = calibrate_sequence(FIELD, frames, SIZE, shared=SHARED_IN_MOTION, matches=matches)
    columns = known.frames
    theta = np.where(np.arange(COUNT)[:, None] % 6 == 0, columns.theta, np.nan)
    found = replace(known, frames=replace(columns, theta=theta)).interpolated(np.zeros(COUNT, dtype=int), 25)
    between = [t for t in range(COUNT) if t % 6]
    assert {found.basis[t] for t in between} == {Basis.INTERPOLATED}
    for t in between:
        error = found[t].camera.C - known[t].camera.C
        sigma, before = (np.sqrt(np.diagonal(one[t].covariance)[CENTER]) for one in (found, known))
        assert np.all(np.abs(error) < 3.0 * sigma)
        assert np.all(sigma > before)


@pytest.mark.slow
def test_frames_between_share_the_misfit_of_those_around_them(cameras, frames, matches):
    """Interpolated cameras were good between frames that what is shared does not explain."""
    known = calibrate_sequence(FIELD, frames, SIZE, shared=SHARED_IN_MOTION, matches=matches)
    own = np.arange(COUNT) % 6 == 0
    theta = np.where(own[:, None], known.frames.theta, np.nan)
    misfit = np.where(own, 0.1, np.nan)
    misfit[30] = 40.0
    found = replace(known, frames=replace(known.frames, theta=theta, misfit=misfit))
    found = found.interpolated(np.zeros(COUNT, dtype=int), 25)
    assert all("put its lines 40 px off" in found[t].reason for t in range(25, 36))
    assert "put its lines" not in found[20].reason


# centres


@given(velocity=bounded(3, -3.0, 3.0), done=st.lists(st.booleans(), min_size=1, max_size=12).filter(any))
def test_centres_are_expected_between_those_that_are_known(velocity, done):
    count, done = len(done), np.array(done)
    time = np.arange(count)
    C, known = 5.0 + time[:, None] * velocity, np.flatnonzero(done)
    sigma = np.full((len(known), 3), 0.1)
    found = expected_centres(KnownCentres(known, C[known], sigma), time)
    inside = (time >= known[0]) & (time <= known[-1])
    np.testing.assert_allclose(found.mean[inside], C[inside], atol=1e-9)
    np.testing.assert_allclose(found.sigma[done], 0.1)
    beyond = np.maximum(known[0] - time, time - known[-1])
    np.testing.assert_allclose(found.sigma[beyond > 0, 0], np.hypot(0.1, SPEED * beyond[beyond > 0]))
    # an acceleration of one standard deviation stays within it
    bent = 0.5 * ACCELERATION * np.square(time)
    again = expected_centres(KnownCentres(known, np.tile(bent[known, None], 3), 0.0 * sigma), time)
    assert np.all(np.abs(again.mean[inside, 0] - bent[inside]) <= again.sigma[inside, 0] + 1e-12)


def test_centres_take_the_place_of_a_prior():
    centres = Centres(np.ones((2, 3)), np.full((2, 3), 0.5))
    prior = GaussianPrior(np.zeros((2, 12)), np.full((2, 12), 9.0))
    for given_prior, other in ((prior, 9.0), (None, np.inf)):
        found = centres.of_prior(given_prior, 12)
        assert np.all(found.mean[:, CENTER] == 1.0)
        assert np.all(found.sigma[:, CENTER] == 0.5)
        assert np.all(np.delete(found.sigma, np.r_[CENTER], axis=1) == other)
    assert np.all(prior.sigma == 9.0)


def test_no_frame_is_on_no_path():
    assert on_path({}) == {}


# the ground


@given(change=bounded((3, 3), -2.0, 2.0), others=st.integers(0, 80), by=bounded(2, 8.0, 30.0), sides=generators())
def test_the_motion_of_a_plane_is_found_among_other_points(change, others, by, sides):
    H = np.eye(3) + change * ((0.03, 0.03, 8.0), (0.03, 0.03, 8.0), (5e-5, 5e-5, 1e-9))
    x = np.random.default_rng(0).uniform((0.0, 0.0), (640.0, 360.0), (200, 2))
    y = mapped(H, x) + sides.normal(scale=0.1, size=x.shape)
    wrong = np.arange(200) < others
    y[wrong] += sides.choice([-1.0, 1.0], (others, 2)) * by
    found = plane_motion(x, y, np.ones(200, bool), (640, 360))
    homography, agree, scale = found
    assert not np.any(agree & wrong)
    assert np.mean(agree[~wrong]) > 0.9
    assert scale < 0.3
    np.testing.assert_allclose(mapped(homography, x), mapped(H, x), atol=0.5)


def test_a_flight_over_the_ground_is_no_turn():
    ground = np.pad(np.random.default_rng(0).uniform((-60, -40), (60, 40), (3000, 2)), ((0, 0), (0, 1)))
    here = Camera.from_angles(-0.1, 1.2, 0.0, 1200.0, (0.0, 50.0, -16.0), SIZE)
    there = Camera.from_angles(-0.1, 1.2, 0.0, 1200.0, (3.0, 50.0, -16.0), SIZE)
    (match,) = background_matches([here, there], [(0, 1)], ground, np.random.default_rng(1), 0.1)
    every = np.ones(len(match.xy_first), bool)
    plane = plane_motion(match.xy_first, match.xy_second, every, SIZE)
    assert np.mean(plane[1]) > 0.95
    turn = background_motion(match.xy_first, match.xy_second, every, SIZE)
    assert turn is None or np.mean(turn[1]) < 0.7


def test_no_plane():
    rng = np.random.default_rng(0)
    few = rng.uniform(0.0, 300.0, (5, 2))
    assert plane_motion(few, few, np.ones(5, bool), (640, 360)) is None
    same = np.ones((40, 2))
    assert plane_motion(same, same, np.ones(40, bool), (640, 360)) is None


# a video


@pytest.mark.slow
def test_a_video_from_the_air():
    size, count = (480, 270), 16
    share = np.linspace(0.0, 1.0, count)
    cameras = [
        Camera.from_angles(-0.40 + 0.05 * s, 1.25, 0.0, 560.0, (-2.0 + 2.5 * s, 50.0 - s, -16.0), size) for s in share
    ]
    true = [TrueFrame(camera, 0, 0) for camera in cameras]
    pictures = list(film(Scene.random(FIELD, 5, cameras), true))
    keys = looked_at(pictures, moving=True)
    found = calibrate_video(FIELD, pictures, KnownCameras([cameras[t] for t in keys]), camera="moving")
    assert all(frame.accepted for frame in found)
    assert np.median(off(found, cameras)) < 0.5
    assert np.ptp([frame.camera.C[0] for frame in found]) > 1.5
    assert found.tripods[0].shared.keys().isdisjoint({"x", "y", "z"})


def test_what_takes_a_video_is_checked():
    with pytest.raises(ValueError, match="camera must be one of tripod, moving, got 'drone'"):
        calibrate_video(FIELD, [np.zeros((90, 160, 3), np.uint8)], camera="drone")
