"""Synthetic clips without pictures: paths of one tripod, labels along them, and static points that are matched."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import generators, numbers

from data_tools.measured_cameras import read_zoom
from data_tools.synthetic.clips import DISTANCES, OUTLIER_REACH, background_matches, background_points, labelled
from data_tools.synthetic.paths import (
    LEAN,
    MEASURED_RATE,
    SIZE,
    PolynomialLaw,
    camera_between,
    camera_path,
    flight,
    operated,
)
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.geometry.camera import Camera
from fieldcalib.geometry.homography import dehomogenize, homogenize


def angles_of(cameras):
    return np.array([camera.angles for camera in cameras])


def log_f(cameras):
    return np.log([camera.focal_length for camera in cameras])


def misfit(x, y, degree):
    """The largest residual of a polynomial through the points."""
    x = x - x.mean()
    return np.abs(np.polynomial.Polynomial.fit(x, y, degree)(x) - y).max()


@pytest.fixture(scope="module")
def path():
    return camera_path(np.random.default_rng(1), 90)


@pytest.fixture
def measured(tmp_path):
    """A file of 200 frames whose focal length grows by a pixel a frame, in a world with z up."""
    law = PolynomialLaw(
        np.array([[12.0, -50.0], [9.0, 11.0]]), np.array([0.04, -0.02, -0.03]), np.array([0.01, -0.02, 0.02])
    )
    K, k = law.at(np.arange(4000.0, 4200.0))
    camera = Camera.from_angles(0.1, 1.35, 0.0, 4000.0, (1.0, 66.0, -16.0), SIZE)
    y_and_z = np.diag([1.0, -1.0, -1.0])
    R, t = camera.R @ y_and_z, -camera.R @ camera.C
    file = tmp_path / "camera.npz"
    np.savez(file, K=K, k=np.pad(k, ((0, 0), (0, 3))), R=R[None], t=t[None])
    return file


# paths


@given(generators(), st.integers(1, 300))
def test_an_operator_goes_from_end_to_end_without_jumps(rng, frames):
    values = operated(rng, frames)
    assert values.shape == (frames,)
    assert np.all((values >= 0.0) & (values <= 1.0))
    if frames > 100:
        assert np.ptp(values) > 0.999
        assert np.abs(np.diff(values, 2)).max() < 0.03
        assert np.mean(np.abs(np.diff(values)) < 1e-4) > 0.15  # rests


@given(generators())
def test_principal_point_and_lens_follow_the_zoom(rng):
    cameras = camera_path(rng, 30)
    u = log_f(cameras)
    assert np.ptp(u) > 0.29
    points = np.array([camera.principal_point for camera in cameras])
    corners = np.array([camera.corner_distortion for camera in cameras])
    assert np.all(np.abs(points - np.array(SIZE) / 2.0) < (50.0, 85.0))  # px, with some room for those not measured
    assert np.all((corners.sum(axis=1) > 0.0) & (corners.sum(axis=1) < 0.06))
    assert max(misfit(u, points[:, axis], 1) for axis in (0, 1)) < 1e-6
    assert max(misfit(u, corners[:, power], 2) for power in (0, 1)) < 1e-9
    assert all(np.isfinite(camera.normalized([[0.0, 0.0], np.array(SIZE) - 1.0])).all() for camera in cameras[::10])


@given(generators(), numbers(-0.6, 0.3), numbers(0.05, 0.6))
def test_the_pan_fills_its_range(rng, low, extent):
    pan = angles_of(camera_path(rng, 60, pan_range=(low, low + extent)))[:, 0]
    # where the tripod leans and the hand shakes
    assert pan.min() == pytest.approx(low, abs=4.0 * LEAN * np.cos(1.3) + 0.001)
    assert pan.max() == pytest.approx(low + extent, abs=4.0 * LEAN * np.cos(1.3) + 0.001)


def test_one_tripod_has_one_centre_and_looks_at_the_field(path):
    assert not np.ptp([camera.C for camera in path], axis=0).any()
    middle = np.array([camera.image_to_field(np.array(SIZE) / 2.0) for camera in path])
    assert np.all(np.abs(middle[:, :2]) < (52.5, 34.0))


def test_a_path_is_a_function_of_its_seed(path):
    assert camera_path(np.random.default_rng(1), 90) == path
    assert camera_path(np.random.default_rng(2), 90)[0] != path[0]


def test_image_sizes_show_the_same(path):
    smaller = camera_path(np.random.default_rng(1), 90, image_size=(960, 540))
    X = [[0.0, 0.0, 0.0], [10.0, -20.0, 0.0]]
    np.testing.assert_allclose(2.0 * smaller[40].project(X), path[40].project(X), atol=1e-9)


def test_a_measured_camera_is_played_at_its_own_speed(measured):
    cameras = camera_path(np.random.default_rng(0), 400, read_zoom(measured))
    np.testing.assert_allclose(cameras[0].C, (1.0, 66.0, -16.0), atol=1e-9)
    f = np.array([camera.focal_length for camera in cameras])
    assert 4000.0 <= f.min() < 4002.0
    assert 4197.0 < f.max() <= 4199.0
    steps = np.abs(np.diff(f))
    assert np.median(steps) == pytest.approx(MEASURED_RATE / 30.0)  # px a frame of the path
    assert steps.max() < MEASURED_RATE / 30.0 + 1e-6
    points = np.array([camera.principal_point for camera in cameras])
    assert misfit(np.log(f), points[:, 1], 1) < 0.001


def test_measured_files_are_read(shared_data):
    for file in sorted((shared_data / "worldcup2022-cameras").glob("*.npz")):
        cameras = camera_path(np.random.default_rng(0), 30, read_zoom(file))
        assert 2000.0 < cameras[0].focal_length < 8000.0
        assert -25.0 < cameras[0].C[2] < -8.0
        assert np.abs(np.diff(log_f(cameras))).max() < 0.02


@given(generators(), numbers(0.0, 1.0))
def test_between_two_frames_the_camera_turns_evenly(rng, share):
    a, b = camera_path(rng, 2, centre=flight(rng, 2))
    camera = camera_between(a, b, share)
    turned, whole = (np.arccos(np.clip((np.trace(R @ a.R.T) - 1.0) / 2.0, -1.0, 1.0)) for R in (camera.R, b.R))
    assert turned == pytest.approx(share * whole, abs=1e-6)
    np.testing.assert_allclose(camera.C, (1.0 - share) * a.C + share * b.C, atol=1e-12)
    for end, original in ((0.0, a), (1.0, b)):
        np.testing.assert_allclose(
            camera_between(a, b, end).project([0.0, 0.0, 0.0]), original.project([0.0, 0.0, 0.0])
        )


# labels


def test_labels_lie_on_their_markings(path):
    field = soccer()
    for frame in labelled(path[::30], field, np.random.default_rng(0), noise=0.0):
        assert frame.pixels
        for label, xy in frame.pixels.items():
            on_it = frame.camera.project(field[label].sample(spacing=0.1))
            assert np.nanmin(np.linalg.norm(on_it - xy[:, None], axis=-1), axis=1).max() < 1e-9


def test_wrong_and_missing_labels_have_their_shares(path):
    field, rng = soccer(), np.random.default_rng(0)
    frames = labelled(path, field, rng, wrong_share=0.5, empty_share=0.2)
    assert [frame.camera for frame in frames] == path
    empty = [not frame.pixels for frame in frames]
    assert 0.1 < np.mean(empty) < 0.3
    wrong = [len(frame.wrong) for frame in frames if frame.pixels]
    assert set(wrong) == {0, 1}
    assert 0.3 < np.mean(wrong) < 0.7
    for frame in frames:
        for label, right in frame.wrong.items():
            assert label in frame.pixels
            assert right not in frame.pixels


# matches


@given(generators())
def test_points_lie_beyond_or_on_the_ground(rng):
    cameras = camera_path(rng, 20)
    X = background_points(cameras, 20, rng)
    assert np.all(X[:, 2] <= 1e-9)
    distance = np.linalg.norm(X - cameras[0].C, axis=1)
    nearest, farthest = DISTANCES
    assert distance.max() < farthest + 1e-9
    assert np.all((distance > nearest - 1e-9) | (np.abs(X[:, 2]) < 1e-9))


@given(generators(), st.integers(0, 29), st.integers(0, 29))
def test_matches_of_one_centre_obey_the_rotation(rng, first, second):
    cameras = camera_path(rng, 30)
    X = background_points(cameras, 40, rng)
    (match,) = background_matches(cameras, [(first, second)], X, rng, noise=0.0)
    a, b = cameras[first], cameras[second]
    turned = dehomogenize(homogenize(a.normalized(match.xy_first)) @ (b.R @ a.R.T).T)
    np.testing.assert_allclose(turned, b.normalized(match.xy_second), atol=1e-9)
    assert match.right.all()


def test_noise_and_outliers_are_what_is_asked_for(path):
    rng = np.random.default_rng(0)
    X = background_points(path, 4000, rng)
    (match,) = background_matches(path, [(10, 14)], X, rng, noise=0.5, outlier_share=0.2)
    off = match.xy_second - background_matches(path, [(10, 14)], X, rng, noise=0.0)[0].xy_second
    assert len(off) > 200
    assert np.mean(~match.right) == pytest.approx(0.2, abs=0.05)
    assert np.std(off[match.right]) == pytest.approx(0.5, rel=0.1)
    assert 0.5 * OUTLIER_REACH < np.std(off[~match.right]) < OUTLIER_REACH
