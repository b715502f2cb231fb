"""A camera from the homography of its ground plane."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from strategies import cameras, generators, visible_field_points

from fieldcalib.camera import Camera
from fieldcalib.homography import decompose_homography

signed_scales = st.builds(
    lambda exponent, sign: sign * 10.0**exponent, st.floats(-6.0, 6.0), st.sampled_from([-1.0, 1.0])
)


def a_point_in_view(camera, rng):
    points = visible_field_points(camera, rng, count=1)
    assume(len(points))
    return points[0, :2]


def moved_principal_point(camera, rng):
    """The same camera with its principal point anywhere in the middle of the image."""
    K = camera.K.copy()
    K[:2, 2] += rng.uniform(-0.1, 0.1, size=2) * camera.image_size
    return Camera(K, camera.R, camera.C, camera.image_size)


def assert_same_camera(f, R, C, camera):
    assert f == pytest.approx(camera.focal_length, rel=1e-7)
    np.testing.assert_allclose(R, camera.R, atol=1e-8)
    np.testing.assert_allclose(C, camera.C, rtol=1e-7, atol=1e-6)


@given(camera=cameras(lens=False), scale=signed_scales, rng=generators())
def test_a_camera_comes_back_from_its_homography(camera, scale, rng):
    camera = moved_principal_point(camera, rng)
    reference = a_point_in_view(camera, rng)
    f, R, C = decompose_homography(scale * camera.homography, camera.principal_point, reference)
    assert_same_camera(f, R, C, camera)


@given(drawn=st.lists(cameras(lens=False), min_size=6, max_size=6), rng=generators())
def test_a_batch_is_every_homography_on_its_own(drawn, rng):
    principal_point = np.array([500.0, 300.0])
    H = np.array([rng.normal() * camera.homography for camera in drawn]).reshape(2, 3, 3, 3)
    reference = np.array([a_point_in_view(camera, rng) for camera in drawn]).reshape(2, 3, 2)
    f, R, C = decompose_homography(H, principal_point, reference)
    assert f.shape == (2, 3)
    assert R.shape == (2, 3, 3, 3)
    assert C.shape == (2, 3, 3)
    for index in np.ndindex(2, 3):
        alone = decompose_homography(H[index], principal_point, reference[index])
        for together, single in zip((f, R, C), alone, strict=True):
            np.testing.assert_allclose(together[index], single, rtol=1e-9, atol=1e-9)


@given(camera=cameras(lens=False), rng=generators())
def test_the_reference_point_is_in_front(camera, rng):
    """A point behind the camera turns the scene around: the homography is the same up to its sign."""
    reference = a_point_in_view(camera, rng)
    behind = 2.0 * camera.C[:2] - reference
    assume(camera.depth([*behind, 0.0]) < -1.0)
    for point in (reference, behind):
        _, R, C = decompose_homography(camera.homography, camera.principal_point, point)
        assert R[2] @ (np.array([*point, 0.0]) - C) > 0.0


@given(camera=cameras(lens=False), rng=generators(), noise=st.floats(0.0, 0.3))
def test_with_noise_the_rotation_is_one_still(camera, rng, noise):
    reference = a_point_in_view(camera, rng)
    H = camera.homography * (1.0 + noise * rng.normal(size=(3, 3)))
    _, R, _ = decompose_homography(H, camera.principal_point, reference)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1.0)


def without_focal_length():
    """h2 is longer than h1 in the image's plane and along the optical axis: no weight of the axis makes them equal."""
    return np.array([[1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.1, 1.0]])


def straight_down():
    """From straight above every focal length fits, each at its height."""
    return Camera.from_angles(0.3, 0.0, 0.0, 900.0, (0.0, 0.0, -60.0), (960, 540), (0.0, 0.0)).homography


@pytest.mark.parametrize(
    "H", [without_focal_length(), -3.0 * without_focal_length(), straight_down(), np.zeros((3, 3))]
)
def test_no_real_focal_length(H):
    f, _, _ = decompose_homography(H, np.zeros(2), np.zeros(2))
    assert np.isnan(f)


def test_homographies_without_focal_length_do_not_spoil_the_others():
    camera = Camera.from_angles(0.3, 1.3, 0.01, 1800.0, (2.0, 70.0, -18.0), (960, 540), (0.0, 0.0))
    H = np.array([without_focal_length(), camera.homography, np.full((3, 3), np.nan), np.zeros((3, 3))])
    f, R, C = decompose_homography(H, np.zeros(2), np.zeros((4, 2)))
    np.testing.assert_array_equal(np.isnan(f), [True, False, True, True])
    assert_same_camera(f[1], R[1], C[1], camera)


def test_the_homography_is_not_changed():
    H = Camera.from_angles(0.3, 1.3, 0.01, 1800.0, (2.0, 70.0, -18.0), (960, 540)).homography
    H.flags.writeable = False
    before = H.copy()
    decompose_homography(H, np.array([480.0, 270.0]), np.zeros(2))
    np.testing.assert_array_equal(H, before)
