"""The fisheye lens: cv2.fisheye is the referee, then its derivatives, its inverse, and cameras that have it."""

import pickle

import cv2
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numdiff import central_differences
from strategies import angle, numbers, operated_angles, vectors

from fieldcalib.geometry.camera import Camera
from fieldcalib.geometry.lens import FisheyeLens, RadialLens, common_lens

RHO = 734.0
LENS = FisheyeLens(RHO)
SIZE = (1280, 720)
COEFFICIENTS = vectors((-0.1, -0.03, -0.01, -0.003), (0.1, 0.03, 0.01, 0.003))
FOCAL_LENGTHS = numbers(300.0, 900.0)
WIDEST = np.radians(89.0)


def towards(theta, direction, f):
    """The ideal offset of a ray at an angle from the axis."""
    return f * np.tan(theta) * np.array([np.cos(direction), np.sin(direction)])


@st.composite
def seen(draw, widest=WIDEST):
    """Coefficients with their focal length, and the ideal offset of a ray: on the axis, near it, or far out."""
    k, f = draw(COEFFICIENTS), draw(FOCAL_LENGTHS)
    theta = draw(st.sampled_from((0.0, 1e-9, 1e-3, 0.0099, 0.0101)) | numbers(0.0, widest))
    return LENS.at_focal_length(k, f), towards(theta, draw(angle(np.pi)), f)


@st.composite
def fisheye_cameras(draw):
    """Cameras of 100 to 150 degrees anywhere, with nearly square pixels and a principal point off the middle."""
    f = SIZE[0] / np.radians(draw(numbers(100.0, 150.0)))
    K = np.array([[f, 0.0, 640.0], [0.0, f * draw(numbers(0.95, 1.05)), 360.0], [0.0, 0.0, 1.0]])
    K[:2, 2] += draw(vectors((-30.0, -30.0), (30.0, 30.0)))
    like = Camera.from_angles(
        *draw(operated_angles()), f, draw(vectors((-50.0, 30.0, -30.0), (50.0, 60.0, -4.0))), SIZE
    )
    return Camera(K, like.R, like.C, SIZE, draw(COEFFICIENTS), fisheye=True)


def rays(camera, widest=WIDEST):
    """World points at several distances in all directions that the camera sees."""
    theta, direction = (x.ravel() for x in np.meshgrid(np.linspace(0.0, widest, 12), np.linspace(0.0, 6.0, 7)))
    at_depth_1 = np.column_stack([*towards(theta, direction, 1.0), np.ones_like(theta)])
    return camera.C + np.linspace(1.0, 80.0, len(theta))[:, None] * at_depth_1 @ camera.R


@given(seen())
def test_it_is_cv2_fisheye(drawn):
    b, s = drawn
    f, X = b[4], np.array([[[*(s / b[4]), 1.0]]])
    theirs, _ = cv2.fisheye.projectPoints(X, np.zeros(3), np.zeros(3), np.diag([f, f, 1.0]), b[:4])
    np.testing.assert_allclose(LENS.distort(s, b), theirs[0, 0], rtol=0.0, atol=1e-9)


@given(seen(), angle(np.pi))
def test_push_pull_and_follow_are_derivatives(drawn, turn):
    b, s = drawn
    h = 1e-3 * (b[4] + np.hypot(*s))
    steps = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    J = central_differences(lambda s: LENS.distort(s, b), s, h)
    d, *images = LENS.push(s, b, *steps)
    np.testing.assert_allclose(d, LENS.distort(s, b), rtol=1e-14, atol=1e-12)
    np.testing.assert_allclose(images, steps @ J.T, rtol=0.0, atol=1e-8)
    for n in steps:
        np.testing.assert_allclose(LENS.pull(s, b, n), n @ J, rtol=0.0, atol=1e-8)
    second = central_differences(lambda t: LENS.push(s + t * steps[0], b, steps[0])[1], np.zeros(1), h)[:, 0]
    found, T, dT = LENS.follow(s, b, steps[0], steps[1])
    np.testing.assert_allclose([found, T], [d, images[0]], rtol=1e-14, atol=1e-12)
    np.testing.assert_allclose(dT - images[1], second, rtol=0.0, atol=1e-9)  # of up to 1e-3 / px


@given(seen(), angle(np.pi))
def test_pull_coefficients_and_zoom_are_derivatives(drawn, direction):
    b, s = drawn
    n = np.array([np.cos(direction), np.sin(direction)])

    def moved(change):
        return n @ LENS.distort(s, np.append(b[:4] + change[:4], b[4] * np.exp(change[4])))

    numeric = central_differences(moved, np.zeros(5), 1e-3)
    found = [*LENS.pull_coefficients(s, b, n), LENS.pull_zoom(s, b, n)]
    np.testing.assert_allclose(found, numeric, rtol=0.0, atol=1e-6)  # px, of up to thousands


@given(seen())
def test_undistort_is_the_inverse_where_the_lens_is_monotone(drawn):
    b, s = drawn
    assume(LENS.is_monotone(s, b))
    length = np.hypot(*s)
    least = np.linalg.svd(np.array(LENS.push(s, b, *np.eye(2))[1:]), compute_uv=False)[-1]
    assume(least > 1e-5)  # at 89 degrees it is 3e-4 of an equidistant lens
    np.testing.assert_allclose(LENS.undistort(LENS.distort(s, b), b), s, rtol=0.0, atol=1e-11 * (1.0 + length) / least)


@given(COEFFICIENTS, FOCAL_LENGTHS, numbers(0.0, 3.0), angle(np.pi))
def test_undistort_is_a_preimage_before_the_fold_or_nan_beyond_90_degrees(k, f, radius, direction):
    b = LENS.at_focal_length(k, f)
    d = f * radius * np.array([np.cos(direction), np.sin(direction)])
    s, near = LENS.undistort(d, b), LENS.nearly_undistort(d, b)
    assert np.all(np.isfinite(near))
    angles = np.linspace(0.0, 0.5 * np.pi, 2000)
    distance = angles * (1.0 + sum(k_i * angles ** (2 * i) for i, k_i in enumerate(k, start=1)))
    widest = distance[np.argmax(np.diff(distance, append=-np.inf) <= 0.0)]
    if np.all(np.isnan(s)):
        assert radius > widest - 0.01
        return
    assert radius < widest + 0.01
    np.testing.assert_allclose(LENS.distort(s, b), d, rtol=0.0, atol=1e-6)
    assert LENS.is_monotone(s, b)


def test_where_distances_fall_the_lens_has_no_more_rays():
    """With k1 = -0.3 distances grow up to 60.4 degrees, ``1 + 3 k1 theta^2 = 0``."""
    b = LENS.at_focal_length(np.array([-0.3, 0.0, 0.0, 0.0]), 500.0)
    inside, outside = (towards(np.radians(degrees), 0.3, 500.0) for degrees in (59.0, 62.0))
    assert LENS.is_monotone(inside, b)
    assert not LENS.is_monotone(outside, b)
    assert np.all(np.isnan(LENS.undistort(1.01 * LENS.distort(towards(np.radians(60.4), 0.3, 500.0), b), b)))


@given(fisheye_cameras())
def test_cameras_project_as_cv2_fisheye_and_back(camera):
    X = rays(camera)
    rvec, tvec, K, dist = camera.to_opencv()
    assert dist.shape == (1, 4)
    expected = cv2.fisheye.projectPoints(X[:, None], rvec, tvec, K, dist)[0][:, 0]
    xy = camera.project(X)
    one_to_one = np.isfinite(xy[:, 0])
    np.testing.assert_allclose(xy[one_to_one], expected[one_to_one], rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(
        Camera(camera.K, camera.R, camera.C, SIZE, dist, False, True).project(X), expected, rtol=0.0, atol=1e-6
    )
    inside = one_to_one & np.all((xy > 0.0) & (xy < SIZE), axis=1)
    ray = np.column_stack([camera.normalized(xy[inside]), np.ones(np.sum(inside))]) @ camera.R
    cosine = np.sum(ray * (X[inside] - camera.C), axis=1)
    cosine /= np.linalg.norm(ray, axis=1) * np.linalg.norm(X[inside] - camera.C, axis=1)
    assert np.all(cosine > 1.0 - 1e-12)
    again = Camera.from_opencv(rvec, tvec, K, dist, SIZE, fisheye=True)
    np.testing.assert_allclose(again.project(X), xy, rtol=0.0, atol=1e-6)


@given(fisheye_cameras(), numbers(0.3, 2.0), numbers(0.3, 2.0))
def test_cameras_of_scaled_and_cropped_pictures(camera, wider, higher):
    X, size = rays(camera), (round(1280 * wider), round(720 * higher))
    scale = np.divide(size, SIZE)
    np.testing.assert_allclose(camera.scaled(size).project(X), scale * camera.project(X), rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(
        camera.cropped((30, -20), (400, 300)).project(X), camera.project(X) - (30, -20), rtol=0.0, atol=1e-6
    )
    assert pickle.loads(pickle.dumps(camera)) == camera
    assert camera != Camera(camera.K, camera.R, camera.C, SIZE, camera.dist)
    assert not camera.is_pinhole


def test_points_from_90_degrees_on_have_no_image():
    camera = Camera.from_angles(0.0, np.pi / 2, 0.0, 400.0, (0.0, 0.0, -5.0), SIZE, k=4 * [0.0], fisheye=True)
    just, at, behind = (
        camera.C + 10.0 * np.array([np.sin(a), -np.cos(a), 0.0]) for a in np.radians([89.9, 90.0, 91.0])
    )
    np.testing.assert_allclose(camera.project(just), (640.0 + 400.0 * np.radians(89.9), 360.0), atol=1e-9)
    assert np.all(np.isnan(camera.project([at - [0.0, -1e-9, 0.0], behind])))
    assert np.all(np.isnan(camera.normalized((640.0 + 400.0 * np.radians(90.1), 360.0))))
    assert np.degrees(camera.field_of_view) == pytest.approx(180.0)  # 183 degrees with what is behind
    assert np.degrees(camera.scaled((640, 360)).cropped((120, 0), (400, 360)).field_of_view) == pytest.approx(
        2.0 * np.degrees(200.0 / 200.0)
    )


def test_bad_coefficients_are_named():
    for k in ((0.1, 0.0), 5 * [0.0], (np.nan, 0.0, 0.0, 0.0)):
        with pytest.raises(ValueError, match="k of a fisheye lens must be the four finite coefficients"):
            Camera.from_angles(0.0, 1.4, 0.0, 500.0, (0.0, 50.0, -10.0), SIZE, k=k, fisheye=True)
    camera = Camera.from_angles(0.0, 1.4, 0.0, 500.0, (0.0, 50.0, -10.0), SIZE, k=4 * [0.0], fisheye=True)
    with pytest.raises(ValueError, match="the lens is a fisheye, which has no coefficients k1, k2, p1"):
        _ = camera.opencv_coefficients
    with pytest.raises(ValueError, match="some of the cameras have a fisheye lens"):
        common_lens([LENS, RadialLens(RHO)])
    assert common_lens([LENS, LENS]) == LENS
