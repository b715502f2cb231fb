"""Cameras of others: their lens is OpenCV's and SoccerNet's, and absurd numbers are projected as they are."""

import pickle

import cv2
import numpy as np
import pytest
from hypothesis import given
from numdiff import central_differences
from scipy.spatial.transform import Rotation
from strategies import anywhere, cameras, lenses, unchecked_cameras, vectors
from synthetic import visible_field_points

from fieldcalib.geometry.camera import Camera
from fieldcalib.geometry.lens.brown_conrady import brown_conrady, brown_conrady_jacobian, undistorted
from fieldcalib.geometry.lens.model import COEFFICIENTS
from fieldcalib.io.soccernet import camera_to_record

# (x, y, depth) within 45 degrees of the optical axis, 1 to 100 m away
in_front = vectors((-0.7, -0.7, 1.0), (0.7, 0.7, 100.0), count=5)


def points_in_front(camera, places):
    """World points of places (..., 3) that `in_front` draws."""
    x, y, depth = places.T
    return camera.C + np.column_stack([x * depth, y * depth, depth]) @ camera.R


# --- the lens ---


@given(camera=unchecked_cameras(), places=in_front)
def test_projects_as_opencv_does(camera, places):
    X = points_in_front(camera, places)
    rvec = Rotation.from_matrix(np.array(camera.R)).as_rotvec()
    expected, _ = cv2.projectPoints(X, rvec, -camera.R @ camera.C, camera.K, camera.dist)
    np.testing.assert_allclose(camera.project(X), expected[:, 0], rtol=0, atol=1e-7)


@pytest.fixture(scope="module")
def soccernet():
    from SoccerNet.Evaluation import utils_calibration

    return utils_calibration


@given(camera=unchecked_cameras(), places=in_front)
def test_projects_as_soccernets_evaluation_does(soccernet, camera, places):
    theirs = soccernet.Camera(*camera.image_size)
    theirs.from_json_parameters(camera_to_record(camera))
    X = points_in_front(camera, places)
    expected = np.array([theirs.project_point(point)[:2] for point in X])
    # theirs rounds distorted normalised coordinates, up to 1, to single precision: 6e-8 of up to 10000 px
    np.testing.assert_allclose(camera.project(X), expected, rtol=0, atol=2e-3)


@pytest.mark.parametrize("index", range(len(COEFFICIENTS)), ids=COEFFICIENTS)
def test_every_coefficient_moves_points(index):
    x = np.array([0.3, -0.4])
    moved = brown_conrady(x, 0.1 * np.eye(12)[index])
    expected, _ = cv2.projectPoints(np.array([[*x, 1.0]]), np.zeros(3), np.zeros(3), np.eye(3), 0.1 * np.eye(12)[index])
    assert np.linalg.norm(moved - x) > 1e-4
    np.testing.assert_allclose(moved, expected[0, 0], rtol=0, atol=1e-14)


def numeric_jacobian(x, dist):
    return central_differences(lambda x: brown_conrady(x.T, dist).T, x, 1e-4)


def jacobian(x, dist):
    return np.moveaxis(brown_conrady_jacobian(np.moveaxis(x, -1, 0), dist), (0, 1), (-2, -1))


@given(x=vectors((-0.7, -0.7), (0.7, 0.7), count=5), dist=lenses)
def test_jacobian_is_the_derivative(x, dist):
    np.testing.assert_allclose(jacobian(x, dist), numeric_jacobian(x, dist), rtol=0, atol=1e-8)


@pytest.mark.parametrize("index", range(len(COEFFICIENTS)), ids=COEFFICIENTS)
def test_a_wrong_jacobian_would_be_noticed(index):
    x, dist = np.array([0.3, -0.4]), np.full(12, 0.05)
    other = dist + 1e-4 * np.eye(12)[index]
    error = jacobian(x, other) - numeric_jacobian(x, dist)
    assert np.max(np.abs(error)) > 1e-6


@given(x=vectors((-0.6, -0.6), (0.6, 0.6), count=5), dist=lenses.map(lambda k: k / 3.0))
def test_undistortion_is_the_inverse(x, dist):
    # a third of the coefficients and radii up to 0.85: far from where such a lens folds back
    found = undistorted(brown_conrady(x.T, dist), dist)
    np.testing.assert_allclose(found.T, x, rtol=0, atol=1e-12)


def test_what_no_ray_reaches():
    barrel = np.array([-0.3, *np.zeros(11)])  # folds back at radius 1.054, where it maps to 0.703
    found = undistorted(np.array([[0.7, 0.71, 0.0], [0.0, 0.0, 5.0]]), barrel)
    assert found[0, 0] < 1.0541
    assert np.isnan(found[:, 1:]).all()


# --- the camera ---


@given(camera=anywhere() | cameras(), X=vectors([-60.0] * 3, [60.0] * 3, count=20))
def test_a_camera_of_this_package_projects_alike(camera, X):
    other = unchecked(camera)
    own, others = camera.project(X), other.project(X)
    seen = ~np.isnan(own)
    np.testing.assert_allclose(others[seen], own[seen], rtol=1e-12, atol=1e-9)
    # what only the unchecked camera projects are points in front, where the lens folds back
    assert np.all(camera.depth(X)[np.isnan(own[:, 0]) & ~np.isnan(others[:, 0])] > 0.0)
    np.testing.assert_array_equal(np.isnan(others[:, 0]), camera.depth(X) <= 0.0)
    np.testing.assert_allclose(other.pinhole_homography, camera.pinhole_homography)
    assert other.image_size == camera.image_size


@given(camera=cameras())
def test_pixels_go_back_to_the_field(camera):
    other = unchecked(camera)
    X = visible_field_points(camera)
    np.testing.assert_allclose(other.image_to_field(other.project(X)), X, rtol=0, atol=1e-6)


@given(camera=cameras(lens=False))
def test_the_sky_is_not_on_the_field(camera):
    up = camera.R @ (0.0, 0.0, -1.0)
    sky = camera.principal_point + 1e4 * camera.focal_length * up[:2]
    np.testing.assert_array_equal(unchecked(camera).image_to_field(sky), np.full(3, np.nan))


@given(camera=unchecked_cameras())
def test_what_is_made_of_an_unchecked_camera_is_unchecked(camera):
    assert pickle.loads(pickle.dumps(camera)) == camera
    assert camera.cropped((10, 20), (80, 60)).cropped((-10, -20), camera.image_size).checked is False
    assert camera.scaled(camera.image_size) == camera != unchecked(camera.scaled((10, 10)))


def test_a_checked_camera_differs_from_an_unchecked_one():
    camera = Camera.from_angles(0.1, 1.3, 0.0, 1500.0, (0.0, 60.0, -15.0), (960, 540))
    assert camera != unchecked(camera)


@given(camera=unchecked_cameras(), places=in_front)
def test_nothing_behind_the_camera_has_a_pixel(camera, places):
    behind = 2 * camera.C - points_in_front(camera, places)
    assert np.isnan(camera.project(behind)).all()
    assert np.isnan(camera.project(camera.C)).all()
    assert camera.project(np.zeros((0, 4, 3))).shape == (0, 4, 2)


@pytest.mark.parametrize(
    "changes",
    [
        {"C": np.array([1e200, 1e200, -1e200])},
        {"k": np.full(12, 1e300)},
        {"k": np.array([0, 0, 0, 0, 0, -4.0, 0, 0, 0, 0, 0, 0])},  # denominator 0 at radius 0.5
        {"K": np.diag([1e308, -1e308, 1.0])},
        {"K": np.diag([0.0, 0.0, 1.0])},
    ],
)
def test_absurd_numbers_give_pixels_or_none(changes):
    camera = valid(**changes)
    X = np.array([(0.5, 0.0, 1.0), (30.0, 30.0, 1.0), (0.0, 0.0, 1e-300)])
    xy = camera.project(X)
    assert not np.isinf(xy).any()
    np.testing.assert_array_equal(np.isnan(xy[:, 0]), np.isnan(xy[:, 1]))
    assert not np.isinf(camera.image_to_field(np.array([(480.0, 270.0), (0.0, 0.0)]))).any()


def valid(**changes):
    values = {
        "K": np.array([[900.0, 0.0, 480.0], [0.0, -800.0, 270.0], [0.0, 0.0, 1.0]]),
        "R": np.eye(3),
        "C": np.zeros(3),
        "image_size": (960, 540),
    }
    return Camera(**(values | changes), checked=False)


def unchecked(camera):
    return Camera(camera.K, camera.R, camera.C, camera.image_size, camera.dist, checked=False)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"K": np.eye(2)}, "K must be a finite array of shape"),
        ({"K": np.array([[900.0, 1.0, 480.0], [0.0, 900.0, 270.0], [0.0, 0.0, 1.0]])}, r"K must be \[\[fx, 0, cx\]"),
        ({"R": np.full((3, 3), np.nan)}, "R must be a finite array of shape"),
        ({"C": np.array([0.0, np.inf, 0.0])}, "C must be a finite array of shape"),
        ({"k": np.zeros(3)}, "k must be a finite array of 1, 2, 4, 5, 8, 12 or 14 coefficients"),
        ({"image_size": (960, 0)}, "image_size must be"),
    ],
)
def test_what_is_no_camera(changes, message):
    with pytest.raises(ValueError, match=message):
        valid(**changes)


def test_points_of_another_shape():
    with pytest.raises(ValueError, match=r"expected world points of shape \(\.\.\., 3\), got shape \(2,\)"):
        valid().project([1.0, 2.0])
    with pytest.raises(ValueError, match=r"expected pixels of shape \(\.\.\., 2\), got shape \(3,\)"):
        valid().image_to_field([1.0, 2.0, 3.0])


def test_arrays_are_copies_and_read_only():
    K = np.array([[900.0, 0.0, 480.0], [0.0, 900.0, 270.0], [0.0, 0.0, 1.0]])
    camera = valid(K=K)
    K[0, 0] = 1.0
    assert camera.K[0, 0] == 900.0
    with pytest.raises(ValueError, match="read-only"):
        camera.dist[0, 0] = 1.0


def test_absurd_cameras_have_a_homography_without_warnings():
    K = np.array([[1e300, 0.0, 480.0], [0.0, 1e300, 270.0], [0.0, 0.0, 1.0]])
    camera = Camera(K, np.eye(3), (0.0, 1e300, -1e300), (960, 540), np.full(12, 1e300), checked=False)
    assert not np.all(np.isfinite(camera.pinhole_homography))  # warnings are errors here
    assert np.all(np.isnan(camera.project([0.0, 0.0, 0.0])))
