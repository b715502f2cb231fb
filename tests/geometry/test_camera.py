"""The camera: projection and its inverse, agreement with OpenCV, the signs of the angles, and what is refused."""

import copy
import dataclasses
import json
import pickle

import cv2
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from strategies import anywhere, cameras, numbers, vectors
from synthetic import in_image, visible_field_points

from fieldcalib.geometry.camera import Camera, checked_image_size
from fieldcalib.geometry.homography import dehomogenize, homogenize
from fieldcalib.geometry.lens import BrownConradyLens, Pinhole, RadialLens

SIZE = (1920, 1080)
CENTRE = np.array([960.0, 540.0])


def main_camera(pan=0.0, tilt=np.pi / 2, roll=0.0, **kwargs):
    """On the main stand, 15 m up; by default level."""
    return Camera.from_angles(pan, tilt, roll, 1500.0, (0.0, 56.0, -15.0), SIZE, **kwargs)


def level_camera(k=(0.0, 0.0)):
    """The main camera at tilt 90 degrees to the last bit, which cos(pi / 2) is not."""
    return Camera(main_camera().K, [[1, 0, 0], [0, 0, 1], [0, -1, 0]], (0.0, 56.0, -15.0), SIZE, k)


def from_camera_frame(camera, Xc):
    """World points of points in the camera frame."""
    return np.asarray(Xc) @ camera.R + camera.C


# (x, y, depth): pixels in the image and up to half its size around it, in units of that size, and 1 to 200 m
in_front = vectors((-0.5, -0.5, 1.0), (1.5, 1.5, 200.0), count=6)


def points_in_front(camera, places):
    """World points of places (..., 3) that `in_front` draws."""
    rays = (places[:, :2] * camera.image_size - camera.principal_point) / camera.K[[0, 1], [0, 1]]
    return from_camera_frame(camera, homogenize(rays) * places[:, 2:])


# --- projection ---


@given(anywhere(), in_front)
def test_project_equals_opencv_in_front_of_the_camera(camera, places):
    X = points_in_front(camera, places)
    xy = camera.project(X)
    sharp = np.all(np.isfinite(xy), axis=1)  # beyond the fold of a barrel lens OpenCV goes on
    assume(np.any(sharp))
    t = -camera.R @ camera.C
    rvec = cv2.Rodrigues(np.array(camera.R))[0]
    assume(np.max(np.abs(cv2.Rodrigues(rvec)[0] - camera.R)) < 1e-12)  # near half a turn OpenCV's own rvec is off
    expected, _ = cv2.projectPoints(X, rvec, t, camera.K, np.array([*camera.k, 0.0, 0.0, 0.0]))
    np.testing.assert_allclose(xy[sharp], expected.reshape(-1, 2)[sharp], atol=1e-6)


@given(cameras(lens=False))
def test_project_is_the_textbook_pinhole(camera):
    X = visible_field_points(camera, z=-2.44)
    P = camera.K @ camera.R @ np.column_stack([np.eye(3), -camera.C])
    np.testing.assert_allclose(camera.project(X), dehomogenize(homogenize(X) @ P.T), atol=1e-8)


@given(anywhere(), in_front)
def test_nothing_behind_the_camera_has_an_image(camera, places):
    X = points_in_front(camera, places)
    mirrored = 2.0 * camera.C - X  # on the same line through the centre, behind: OpenCV gives it the same pixel
    assert np.all(camera.depth(X) > 0.0)
    assert np.all(camera.depth(mirrored) < 0.0)
    assert np.all(np.isnan(camera.project(mirrored)))


@pytest.mark.parametrize("k", [(0.0, 0.0), (0.1, 0.0)])
def test_points_in_the_plane_of_the_camera_have_no_image(k):
    camera = level_camera(k=k)  # its own plane is y = 56
    X = [(0.0, 56.0, -15.0), (3.0, 56.0, -15.0), (0.0, 56.0, 0.0)]
    np.testing.assert_array_equal(camera.depth(X), 0.0)
    assert np.all(np.isnan(camera.project(X)))


@pytest.mark.parametrize(
    ("k", "q_fold"),
    [
        ((-0.3, 0.0), 1.0 / 0.9),  # root of 1 - 0.9 q
        ((0.0, -0.1), np.sqrt(2.0)),  # 1 - 0.5 q^2
        ((0.3, -0.2), (0.9 + np.sqrt(4.81)) / 2.0),  # 1 + 0.9 q - q^2
        ((-0.5, 0.08), (1.5 - np.sqrt(0.65)) / 0.8),  # 1 - 1.5 q + 0.4 q^2, the nearer root
    ],
)
def test_points_beyond_the_fold_of_the_lens_have_no_image(k, q_fold):
    fold = np.sqrt(q_fold)
    camera = main_camera(k=k)
    direction = np.array([[0.6, 0.8]])
    inside, outside = (homogenize(factor * fold * direction) for factor in (0.999, 1.001))
    assert np.all(np.isfinite(camera.project(from_camera_frame(camera, inside))))
    assert np.all(np.isnan(camera.project(from_camera_frame(camera, outside))))
    assert np.all(np.isfinite(main_camera().project(from_camera_frame(camera, outside))))


@given(cameras())
def test_project_keeps_the_shape_of_a_batch(camera):
    X = visible_field_points(camera)
    xy = camera.project(X[:6].reshape(3, 1, 2, 3))
    assert xy.shape == (3, 1, 2, 2)
    np.testing.assert_allclose(xy.reshape(6, 2), camera.project(X[:6]), rtol=1e-12)
    np.testing.assert_allclose(camera.project(X[0]), xy[0, 0, 0], rtol=1e-12)
    assert camera.project(np.zeros((0, 3))).shape == (0, 2)


def test_project_takes_lists_of_integers():
    assert np.all(np.isfinite(main_camera().project([0, 0, 0])))


# --- back to the field ---


@pytest.mark.parametrize("z", [0.0, -2.44])
@given(cameras())
def test_image_to_field_inverts_project(z, camera):
    X = visible_field_points(camera, z=z)
    assume(len(X) and abs(camera.C[2] - z) > 0.1)
    np.testing.assert_allclose(camera.image_to_field(camera.project(X), z=z), X, atol=1e-6)


@given(cameras(), vectors((0.0, 0.0), (1.0, 1.0), count=20))
def test_project_inverts_image_to_field_all_over_the_image(camera, places):
    xy = places * camera.image_size
    X = camera.image_to_field(xy)
    assert np.all(X[np.isfinite(X[:, 0]), 2] == 0.0)
    below_horizon = np.isfinite(X[:, 0]) & (np.linalg.norm(X, axis=1) < 1e4)
    assume(np.any(below_horizon))
    np.testing.assert_allclose(camera.project(X[below_horizon]), xy[below_horizon], atol=1e-6)


@given(cameras(), numbers(0.1, 50.0))
def test_image_to_field_is_nan_above_the_horizon(camera, higher):
    above = camera.C[2] - higher
    x, y = np.meshgrid(np.linspace(-300.0, 300.0, 41), np.linspace(-300.0, 300.0, 41))
    xy = camera.project(np.stack([x, y, np.full_like(x, above)], axis=-1))
    xy = xy[in_image(xy, camera.image_size)]
    assume(len(xy))
    assert np.all(np.isfinite(camera.image_to_field(xy, z=above)))  # the pixels have rays, and they go up
    assert np.all(np.isnan(camera.image_to_field(xy)))


def test_the_horizon_of_a_level_camera_is_its_middle_row():
    camera = level_camera()
    assert np.all(np.isnan(camera.image_to_field([[100.0, 540.0], [960.0, 540.0], [960.0, 539.9]])))
    assert np.all(np.isfinite(camera.image_to_field([960.0, 540.1])))


def test_image_to_field_is_nan_where_no_ray_of_the_lens_arrives():
    camera = main_camera(tilt=0.0, k=(-0.3, 0.0))  # straight down: without the lens, every pixel sees the ground
    farthest = np.sqrt(1.0 / 0.9) * (1.0 - 0.3 / 0.9)
    rim = CENTRE + 1500.0 * farthest * np.array([[0.98, 0.0], [1.001, 0.0]])
    np.testing.assert_array_equal(np.isnan(camera.image_to_field(rim)[:, 0]), [False, True])


def test_world_points_have_a_height():
    camera = Camera.from_angles(0.0, 1.3, 0.0, 1500.0, (0.0, 56.0, -15.0), (960, 540))
    with pytest.raises(ValueError, match=r"\(5, 2\); points on level ground have z = 0: append a column of zeros"):
        camera.project(np.zeros((5, 2)))
    with pytest.raises(ValueError, match=r"shape \(\.\.\., 2\), got shape \(5, 3\)$"):
        camera.image_to_field(np.zeros((5, 3)))


def test_image_to_field_keeps_the_shape_of_a_batch():
    camera = main_camera(tilt=1.2)
    xy = np.random.default_rng(0).uniform(400, 900, size=(3, 1, 2, 2))
    X = camera.image_to_field(xy)
    assert X.shape == (3, 1, 2, 3)
    np.testing.assert_allclose(X[2, 0, 1], camera.image_to_field(xy[2, 0, 1]), rtol=1e-12)


@given(cameras(lens=False))
def test_homography_maps_the_ground_as_project_does_and_its_inverse_back(camera):
    X = visible_field_points(camera)
    field_points, xy = homogenize(X[:, :2]), camera.project(X)
    np.testing.assert_allclose(dehomogenize(field_points @ camera.homography.T), xy, atol=1e-8)
    np.testing.assert_allclose(dehomogenize(homogenize(xy) @ camera.inverse_homography.T), X[:, :2], atol=1e-6)


@given(cameras(lens=True))
def test_homography_leaves_the_lens_out(camera):
    pinhole = Camera(camera.K, camera.R, camera.C, camera.image_size)
    np.testing.assert_array_equal(camera.pinhole_homography, pinhole.homography)


# --- other sizes of the image, other libraries ---


@given(cameras(), st.tuples(st.integers(100, 4000), st.integers(100, 4000)))
def test_scaled_camera_sees_the_pixels_of_the_scaled_image(camera, new_size):
    X = visible_field_points(camera)
    scale = np.array(new_size) / camera.image_size
    scaled = camera.scaled(new_size)
    assert scaled.image_size == new_size
    np.testing.assert_allclose(scaled.project(X), camera.project(X) * scale, atol=1e-8)


@given(cameras())
def test_scaling_back_gives_the_same_camera(camera):
    back = camera.scaled((123, 456)).scaled(camera.image_size)
    np.testing.assert_allclose(back.K, camera.K, rtol=1e-14)
    np.testing.assert_array_equal(back.k, camera.k)


@given(cameras(), st.tuples(st.integers(-500, 500), st.integers(-500, 500)))
def test_cropped_camera_sees_the_pixels_of_the_part(camera, offset):
    X = visible_field_points(camera)
    part = camera.cropped(offset, (123, 456))
    assert part.image_size == (123, 456)
    np.testing.assert_allclose(part.project(X), camera.project(X) - offset, atol=1e-8)


@pytest.mark.parametrize("offset", [480, (480,), (480, 0, 0), (np.nan, 0)])
def test_an_offset_that_is_no_pixel_is_refused(offset):
    with pytest.raises(ValueError, match=r"offset must be a pixel \(x, y\), got "):
        main_camera().cropped(offset, SIZE)


@given(cameras())
def test_lens_at_the_corner_does_not_change_with_the_size_of_the_image(camera):
    doubled = camera.scaled((2 * camera.image_size[0], 2 * camera.image_size[1]))
    np.testing.assert_allclose(doubled.corner_distortion, camera.corner_distortion, rtol=1e-12)


@given(cameras())
def test_to_and_from_opencv_round_trip(camera):
    back = Camera.from_opencv(*camera.to_opencv(), camera.image_size)
    np.testing.assert_allclose(back.R, camera.R, atol=1e-12)
    np.testing.assert_allclose(back.C, camera.C, atol=1e-10)
    np.testing.assert_array_equal(back.K, camera.K)
    np.testing.assert_array_equal(back.k, camera.k)


@given(st.floats(-9.0, -2.0), vectors([-1.0] * 3, [1.0] * 3))
def test_to_and_from_opencv_round_trip_of_the_opposite_stand(log_offset, turn):
    """A level camera on the far stand is turned by exactly 180 degrees against the world; 1e-9 rad are 1e-5 px."""
    pan, tilt, roll = (np.pi, np.pi / 2, 0.0) + 10.0**log_offset * turn
    camera = Camera.from_angles(pan, tilt, roll, 3000.0, (0.0, -56.0, -15.0), SIZE)
    back = Camera.from_opencv(*camera.to_opencv(), camera.image_size)
    np.testing.assert_allclose(back.R, camera.R, atol=1e-9)


@given(cameras())
def test_to_opencv_is_what_project_points_takes(camera):
    X = visible_field_points(camera)
    expected, _ = cv2.projectPoints(X, *camera.to_opencv())
    np.testing.assert_allclose(camera.project(X), expected.reshape(-1, 2), atol=1e-6)


@given(cameras(lens=False))
def test_the_projection_matrix_projects_as_the_pinhole(camera):
    X = from_camera_frame(camera, [(0.3, -0.2, 1.0), (2.0, 5.0, 30.0), (-9.0, 1.0, 80.0)])
    np.testing.assert_allclose(dehomogenize(homogenize(X) @ camera.P.T), camera.project(X), rtol=1e-9, atol=1e-6)
    rvec, tvec, _, _ = camera.to_opencv()
    np.testing.assert_array_equal(camera.rvec, rvec)
    np.testing.assert_array_equal(camera.tvec, tvec)


@pytest.mark.parametrize("k", [(-0.25, 0.05), (0.1, 0.0)])
def test_an_undistorted_picture_is_that_of_the_pinhole(k):
    """A bright disc at a place on the ground is found where the pinhole has it."""
    camera = main_camera(tilt=1.25, k=k)
    image, X = np.zeros((1080, 1920, 3), np.uint8), (14.0, 12.0, 0.0)
    cv2.circle(image, tuple(np.rint(camera.project(X)).astype(int).tolist()), 12, (255, 255, 255), -1)
    rows, columns = np.nonzero(camera.undistort(image)[..., 0] > 127)
    (expected,) = dehomogenize(homogenize(np.array([X])) @ camera.P.T)
    np.testing.assert_allclose((columns.mean(), rows.mean()), expected, atol=1.5)
    assert np.linalg.norm(camera.project(X) - expected) > 3.0
    with pytest.raises(ValueError, match="960x540 pixels, and its camera is of 1920x1080"):
        camera.undistort(image[:540, :960])
    for other in (None, "frame.png", image.astype(float), image[None]):
        with pytest.raises(ValueError, match="image must be"):
            camera.undistort(other)


def test_to_opencv_has_the_shapes_of_opencv_and_hands_out_copies():
    camera = main_camera(k=(0.1, 0.02))
    rvec, tvec, K, dist = camera.to_opencv()
    assert [a.shape for a in (rvec, tvec, K, dist)] == [(3, 1), (3, 1), (3, 3), (1, 5)]
    np.testing.assert_array_equal(dist, [[0.1, 0.02, 0.0, 0.0, 0.0]])
    K[0, 0] = 1.0
    assert camera.focal_length == 1500.0


@pytest.mark.parametrize("shape", [(3,), (3, 1), (1, 3)])
def test_from_opencv_takes_every_shape_of_rvec_and_tvec(shape):
    rvec, tvec, K, _ = main_camera().to_opencv()
    back = Camera.from_opencv(rvec.reshape(shape), tvec.reshape(shape), K, None, SIZE)
    np.testing.assert_allclose(back.C, main_camera().C, atol=1e-12)


@pytest.mark.parametrize(
    ("dist", "expected"),
    [
        (None, (0.0, 0.0)),
        ([0.1], (0.1, 0.0)),
        ([[0.1, 0.02, 0.0, 0.0, 0.0]], (0.1, 0.02)),
        (np.array([[0.1], [0.02], [0.0], [0.0]]), (0.1, 0.02)),
        ([0.1, 0.02] + 12 * [0.0], (0.1, 0.02)),
    ],
)
def test_radial_coefficients_of_every_length_of_opencv(dist, expected):
    np.testing.assert_array_equal(RadialLens(1.0).from_opencv(dist, 1.0), expected)


@pytest.mark.parametrize("index", range(2, 14))
def test_coefficients_that_are_not_modelled_are_refused(index):
    dist = np.zeros(14)
    dist[index] = 1e-3
    with pytest.raises(ValueError, match=r"(no coefficients but k1, k2|a tilted sensor).*0\.001.*undistort"):
        RadialLens(1.0).from_opencv(dist, 1.0)


# --- every lens of OpenCV ---

WHOLE = np.array([0.04, -0.01, 0.003, -0.002, 0.006, 0.03, 0.01, -0.004, 0.002, 0.001, -0.003, 0.002])


@pytest.mark.parametrize(("length", "stored"), [(1, 5), (2, 5), (4, 5), (5, 5), (8, 8), (12, 12), (14, 12)])
def test_coefficients_of_every_length_of_opencv(length, stored):
    dist = np.concatenate([WHOLE, np.zeros(2)])[:length]
    rvec, tvec, K, _ = main_camera().to_opencv()
    camera = Camera.from_opencv(rvec, tvec, K, dist[:, None], SIZE)
    assert camera == Camera(camera.K, camera.R, camera.C, SIZE, dist)
    assert camera.dist.shape == (1, stored)
    np.testing.assert_array_equal(camera.dist[0, : min(length, 12)], dist[:12])
    np.testing.assert_array_equal(camera.dist[0, min(length, 12) :], 0.0)
    np.testing.assert_array_equal(camera.k, (*dist[:2], 0.0)[:2])
    np.testing.assert_array_equal(camera.to_opencv()[3], camera.dist)
    assert camera.scaled((640, 360)).dist.tolist() == camera.dist.tolist()


@pytest.mark.parametrize(
    ("dist", "lens", "stored"),
    [
        ((0.0, 0.0, 0.0, 0.0, 0.0), Pinhole, 5),
        ((0.1, 0.0, 0.0, 0.0, 0.0), RadialLens, 5),
        ((0.0, 0.1), RadialLens, 5),
        ((0.1, 0.0, 0.0, 1e-9), BrownConradyLens, 5),
        ((0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1e-9), BrownConradyLens, 8),
        ((*14 * [0.0],), Pinhole, 5),
    ],
)
def test_the_lens_is_the_smallest_that_has_the_coefficients(dist, lens, stored):
    camera = main_camera(k=dist)
    assert camera.lens == lens(camera.half_diagonal)
    assert camera.dist.shape == (1, stored)
    assert len(camera.lens_coefficients) == len(camera.lens.names)


@pytest.mark.parametrize("index", [12, 13])
def test_a_tilted_sensor_is_refused(index):
    dist = np.zeros(14)
    dist[index] = 1e-3
    rvec, tvec, K, _ = main_camera().to_opencv()
    with pytest.raises(ValueError, match=r"a tilted sensor .* got dist_coeffs = .*0\.001.*undistort"):
        Camera.from_opencv(rvec, tvec, K, dist, SIZE)
    with pytest.raises(ValueError, match=r"a tilted sensor .* got k = .*0\.001.*undistort"):
        main_camera(k=dist)


def any_lens():
    """OpenCV's vectors of 4, 5, 8 and 12, up to a third at the corner of a camera with a focal length of 1920."""
    small = st.floats(-1.0, 1.0, allow_subnormal=False)
    scale = np.array([0.2, 0.2, 0.03, 0.03, 0.2, 0.1, 0.1, 0.1, 0.03, 0.03, 0.03, 0.03])
    return st.sampled_from((2, 4, 5, 8, 12)).flatmap(
        lambda n: st.lists(small, min_size=n, max_size=n).map(lambda values: np.array(values) * scale[:n])
    )


@given(any_lens(), anywhere(), st.floats(0.9, 7.0), st.floats(0.9, 1.1), in_front)
def test_every_lens_projects_as_opencv_does_and_back(dist, placed, zoom, aspect, places):
    K = np.array([[zoom * 1920, 0.0, 950.0], [0.0, aspect * zoom * 1920, 545.0], [0.0, 0.0, 1.0]])
    camera = Camera(K, placed.R, placed.C, SIZE, dist)
    X = points_in_front(camera, places)
    rvec, tvec, _, coefficients = camera.to_opencv()
    expected = cv2.projectPoints(X, rvec, tvec, K, coefficients)[0][:, 0]
    xy = camera.project(X)
    seen = np.all(np.isfinite(xy), axis=1)
    assume(np.any(seen))
    np.testing.assert_allclose(xy[seen], expected[seen], rtol=0.0, atol=1e-9)
    in_view = X[seen & in_image(xy, SIZE)]
    x = camera.normalized(camera.project(in_view))
    Xc = (in_view - camera.C) @ camera.R.T
    steep = np.array([condition(dist, point) for point in dehomogenize(Xc)]).reshape(-1)
    np.testing.assert_allclose(x[steep < 20.0], dehomogenize(Xc)[steep < 20.0], rtol=0.0, atol=1e-10)


def condition(dist, x):
    """By how much undistortion magnifies an error at the normalised point x, from OpenCV's numbers alone."""
    points = np.array([[*(x + step), 1.0] for step in 1e-5 * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])])
    pixels = cv2.projectPoints(points, np.zeros(3), np.zeros(3), np.eye(3), np.pad(dist, (0, max(0, 5 - len(dist)))))
    right, left, down, up = pixels[0][:, 0]
    return 1.0 / np.linalg.svd(np.array([right - left, down - up]) / 2e-5, compute_uv=False)[-1]


@pytest.mark.parametrize("dist", [(-0.3, 0.0, 0.003, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0, -0.1), (-0.4, *11 * [1e-5])])
def test_every_lens_has_its_fold(dist):
    """No pixel beyond the radius where OpenCV's own projection turns round; pixels up to it."""
    camera = level_camera(k=dist)
    radii = np.linspace(0.0, 3.0, 3001)
    x = radii[:, None] * (0.6, 0.8)
    xy = camera.project(from_camera_frame(camera, homogenize(x)))
    theirs = cv2.projectPoints(homogenize(x), np.zeros(3), np.zeros(3), np.eye(3), np.pad(dist, (0, 12 - len(dist))))
    fold = np.argmax(np.diff(np.linalg.norm(theirs[0][:, 0], axis=1)) < 0.0)
    assert 0 < fold < 2000
    assert np.all(np.isfinite(xy[: fold - 10]))
    assert np.all(np.isnan(xy[fold + 10 :]))


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda camera: pickle.loads(pickle.dumps(camera))])
def test_copies_keep_the_whole_lens(copied):
    camera = main_camera(k=WHOLE)
    assert copied(camera) == camera
    assert copied(camera) != main_camera(k=WHOLE[:8])
    with pytest.raises(ValueError, match="read-only"):
        copied(camera).dist[0, 0] = 1.0
    assert "k=(0.04, -0.01, 0.003, -0.002, 0.006)" in repr(main_camera(k=WHOLE[:5]))


# --- the signs of the angles ---


@given(st.floats(0.01, 1.5), st.floats(0.2, np.pi / 2))
def test_positive_pan_looks_right(pan, tilt):
    camera = main_camera(pan, tilt)
    axis = camera.R[2]  # the optical axis in the world
    assert axis[0] > 0.0
    # what was in the middle of the image has moved to its left
    middle = camera.C + 50.0 * main_camera(0.0, tilt).R[2]
    assert camera.project(middle)[0] < CENTRE[0] or camera.depth(middle) <= 0.0


def test_pan_of_a_right_angle_looks_along_the_touchline():
    np.testing.assert_allclose(main_camera(pan=np.pi / 2).R[2], [1.0, 0.0, 0.0], atol=1e-15)


def test_pan_zero_looks_away_from_the_main_stand():
    np.testing.assert_allclose(main_camera().R[2], [0.0, -1.0, 0.0], atol=1e-15)


def test_tilt_zero_looks_straight_down_with_the_far_side_up():
    camera = main_camera(tilt=0.0)
    np.testing.assert_allclose(camera.R[2], [0.0, 0.0, 1.0], atol=1e-15)
    np.testing.assert_allclose(camera.project([0.0, 56.0, 0.0]), CENTRE, atol=1e-9)
    np.testing.assert_allclose(
        camera.project([0.0, 55.0, 0.0]), CENTRE - np.array([0.0, 100.0]), atol=1e-9
    )  # 1 m at 15 m
    np.testing.assert_allclose(camera.project([1.0, 56.0, 0.0]), CENTRE + np.array([100.0, 0.0]), atol=1e-9)


def test_tilt_of_90_degrees_looks_at_the_horizon_with_the_sky_up():
    camera = main_camera(tilt=np.pi / 2)
    assert camera.R[2, 2] == pytest.approx(0.0, abs=1e-15)
    np.testing.assert_allclose(camera.project([0.0, -44.0, -15.0]), CENTRE, atol=1e-9)
    assert camera.project([0.0, -44.0, -16.0])[1] < CENTRE[1]


@given(st.floats(0.01, 1.5))
def test_positive_roll_turns_the_camera_clockwise_seen_from_behind_and_the_image_counter_clockwise(roll):
    level, rolled = main_camera(), main_camera(roll=roll)
    assert rolled.R[0, 2] == pytest.approx(np.sin(roll))  # the camera's right side dips: z is down
    # a point to the right of the middle moves up, counter-clockwise on the screen, by the angle of the roll
    right = level.project([10.0, -44.0, -15.0]) - CENTRE
    np.testing.assert_allclose(right, [150.0, 0.0], atol=1e-9)
    moved = rolled.project([10.0, -44.0, -15.0]) - CENTRE
    np.testing.assert_allclose(moved, 150.0 * np.array([np.cos(roll), -np.sin(roll)]), atol=1e-9)


@given(anywhere())
def test_angles_are_those_of_the_rotation(camera):
    back = Camera.from_angles(*camera.angles, camera.focal_length, camera.C, camera.image_size)
    np.testing.assert_allclose(back.R, camera.R, atol=1e-12)


# --- what a camera is ---


def test_principal_point_defaults_to_half_the_size_of_the_image():
    np.testing.assert_array_equal(main_camera().principal_point, CENTRE)
    np.testing.assert_array_equal(main_camera(principal_point=(950, 530)).principal_point, [950.0, 530.0])
    np.testing.assert_array_equal(main_camera().K, [[1500.0, 0, 960], [0, 1500, 540], [0, 0, 1]])


@given(st.floats(0.1, 3.0))
def test_field_of_view_is_the_angle_between_the_left_and_the_right_edge(fov):
    f = 960.0 / np.tan(fov / 2.0)
    camera = Camera.from_angles(0.0, 1.4, 0.0, f, (0, 56, -15), SIZE)
    assert camera.field_of_view == pytest.approx(fov)
    left, right = (from_camera_frame(camera, [[x, 0.0, 1.0]]) for x in (-np.tan(fov / 2), np.tan(fov / 2)))
    np.testing.assert_allclose(camera.project(left), [[0.0, 540.0]], atol=1e-6)
    np.testing.assert_allclose(camera.project(right), [[1920.0, 540.0]], atol=1e-6)


def test_corner_distortion_is_the_displacement_at_the_corner():
    camera = main_camera(k=(0.05, 0.01))
    corner = np.array([[960.0, 540.0]]) / 1500.0
    xy = camera.project(from_camera_frame(camera, homogenize(corner)))
    assert camera.half_diagonal == np.hypot(960.0, 540.0)
    np.testing.assert_allclose(xy - CENTRE, (1.0 + camera.corner_distortion.sum()) * 1500.0 * corner, rtol=1e-12)


@pytest.mark.parametrize("name", ["K", "R", "C", "k", "dist", "image_size"])
def test_attributes_are_frozen(name):
    camera = main_camera()
    with pytest.raises(dataclasses.FrozenInstanceError):
        setattr(camera, name, getattr(camera, name))


@pytest.mark.parametrize("name", ["K", "R", "C", "k", "dist", "principal_point"])
def test_arrays_are_frozen(name):
    with pytest.raises(ValueError, match="read-only"):
        getattr(main_camera(), name)[...] = 0.0


def test_a_camera_does_not_change_with_the_arrays_that_it_was_made_of():
    K, R, C, k = np.array(main_camera().K), np.eye(3), np.array([0.0, 50.0, -10.0]), np.zeros(2)
    camera = Camera(K, R, C, SIZE, k)
    before = copy.deepcopy(camera)
    for array in (K, R, C, k):
        array += 1.0
    assert camera == before


def test_equality():
    camera = main_camera(k=(0.1, 0.0))
    assert camera == main_camera(k=(0.1, 0.0))
    for other in (
        main_camera(),
        main_camera(roll=1e-9, k=(0.1, 0.0)),
        main_camera(principal_point=(960, 541), k=(0.1, 0.0)),
        Camera(camera.K, camera.R, camera.C + 1.0, SIZE, camera.k),
        Camera(camera.K, camera.R, camera.C, (1920, 1081), camera.k),
    ):
        assert camera != other
    assert camera != "camera"
    with pytest.raises(TypeError, match="unhashable"):
        hash(camera)


def test_repr_reads_in_degrees_pixels_and_metres():
    camera = Camera.from_angles(*np.radians([12.5, 78.25, -1.0]), 1500.0, (0.5, 56, -15), SIZE, k=(0.1, 0.0))
    assert repr(camera) == (
        "Camera(f=1500.0 px, pan=12.50°, tilt=78.25°, roll=-1.00°, C=(0.50, 56.00, -15.00) m, k=(0.1, 0), "
        "image_size=1920x1080)"
    )


GOOD = {"K": np.diag([1500.0, 1500.0, 1.0]), "R": np.eye(3), "C": (0.0, 0.0, -10.0), "image_size": SIZE}


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"K": np.eye(4)}, r"K must be a finite array of shape \(3, 3\), got array"),
        ({"R": np.zeros(3)}, r"R must be a finite array of shape \(3, 3\), got array\(\[0., 0., 0.\]\)"),
        ({"C": (0.0, 0.0)}, r"C must be a finite array of shape \(3,\)"),
        ({"C": (0.0, 0.0, np.nan)}, r"C must be a finite array .* got array\(\[ 0.,  0., nan\]\)"),
        (
            {"k": (0.1, 0.0, 0.0)},
            r"k must be a finite array of 1, 2, 4, 5, 8, 12 or 14 coefficients .*0\.1, 0\.0, 0\.0",
        ),
        ({"k": np.zeros(15)}, "k must be a finite array of"),
        ({"k": (np.inf, 0.0)}, "k must be a finite array"),
        ({"K": np.diag([-1500.0, 1500.0, 1.0])}, "positive focal lengths, got -1500.0 and 1500.0"),
        ({"K": np.diag([1500.0, 0.0, 1.0])}, "positive focal lengths"),
        ({"K": np.diag([1500.0, 1500.0, 2.0])}, r"K must be \[\[fx, 0, cx\]"),
        ({"K": [[1500.0, 3.0, 0.0], [0.0, 1500.0, 0.0], [0.0, 0.0, 1.0]]}, r"K must be \[\[fx, 0, cx\].*3\.0"),
        ({"R": np.diag([1.0, 1.0, -1.0])}, "R must be a rotation matrix"),  # a mirror
        ({"R": 1.1 * np.eye(3)}, "R must be a rotation matrix"),
        ({"image_size": (1920,)}, r"image_size must be \(width, height\) in whole pixels, got \(1920,\)"),
        ({"image_size": 1920}, "image_size must be"),
        ({"image_size": (1080, 1920, 3)}, r"image_size must be .* got \(1080, 1920, 3\)"),
        ({"image_size": (1920.5, 1080)}, "image_size must be"),
        ({"image_size": (1920, 0)}, "image_size must be"),
        ({"image_size": (1920, np.nan)}, "image_size must be"),
    ],
)
def test_bad_input_is_refused_with_what_was_expected_and_what_came(wrong, message):
    Camera(**GOOD)
    with pytest.raises(ValueError, match=message):
        Camera(**{**GOOD, **wrong})


def test_the_shape_of_an_image_array_is_refused_as_image_size():
    with pytest.raises(
        ValueError, match=r"image_size must be \(width, height\) in whole pixels, got \(1080, 1920, 3\)"
    ):
        Camera.from_angles(0.0, 1.4, 0.0, 1500.0, (0, 56, -15), (1080, 1920, 3))


def test_angles_in_degrees():
    with pytest.raises(ValueError, match=r"tilt: expected radians, got 80: of degrees, np\.deg2rad\(80\)"):
        Camera.from_angles(0.0, 80.0, 0.0, 1500.0, (0.0, 56.0, -15.0), SIZE)


def test_image_size_comes_back_as_two_plain_integers():
    for size in ((1920, 1080), [1920.0, 1080.0], np.array([1920, 1080])):
        checked = checked_image_size(size)
        assert checked == (1920, 1080)
        assert all(type(v) is int for v in checked)


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda camera: pickle.loads(pickle.dumps(camera))])
def test_copies_are_equal_and_read_only(copied):
    camera = Camera.from_angles(0.1, 1.3, 0.0, 1500.0, (0.0, 60.0, -15.0), (960, 540), k=(0.1, 0.0))
    other = copied(camera)
    assert other == camera
    with pytest.raises(ValueError, match="read-only"):
        other.K[0, 0] = 1.0


@pytest.mark.parametrize("fisheye", [False, True])
def test_a_camera_is_kept_in_a_file(tmp_path, fisheye):
    plain = main_camera(0.2, 1.35)
    camera = Camera(plain.K, plain.R, plain.C, SIZE, (0.1, 0.02, 0.0, 0.0), fisheye=fisheye)
    camera.save(tmp_path / "camera.json")
    assert Camera.from_dict(json.loads((tmp_path / "camera.json").read_text())) == camera


def test_a_file_is_no_folder_for_a_camera(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(FileNotFoundError, match="there is no such folder"):
        main_camera(0.2, 1.35).save(tmp_path / "file" / "camera.json")
    with pytest.raises(IsADirectoryError, match="is a folder"):
        main_camera(0.2, 1.35).save(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
