"""From points to a calibration."""

import tracemalloc

import cv2
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from objects import SIZE, any_object, objects, relative_error
from strategies import any_angles, cameras, examples, numbers, vectors
from synthetic import displaced, in_image, random_camera

from fieldcalib import PINHOLE_FLAGS, Camera, Status, calibrate_from_points, soccer
from fieldcalib.fields import DISTRIBUTIONS, CameraDistribution
from fieldcalib.geometry.rotation import rotation_from_angles
from fieldcalib.solve.solver_options import CalibrationFlags

FIELD_POINTS = np.array([point.X for point in soccer().points.values()])
CAMERA = Camera.from_angles(-0.35, 1.36, 0.01, 1500.0, (1.5, 68.0, -17.0), SIZE)
F = CalibrationFlags


def seen(camera, points=FIELD_POINTS):
    """Points that a camera has in its image, and their pixels."""
    xy = camera.project(points)
    inside = in_image(xy, camera.image_size)
    return points[inside], xy[inside]


# points of a field


def test_points_of_a_field_with_the_default_prior():
    X, xy = seen(CAMERA)
    calibration = calibrate_from_points(X, xy, SIZE)
    assert calibration.accepted
    assert relative_error(calibration.camera, CAMERA) < 5e-3  # the weak prior moves it a little
    assert calibration.rms < 0.1
    assert calibration.message == f"rms {calibration.rms:.2f} px over {len(X)} points"
    assert list(calibration.per_segment_errors) == [f"point {i}" for i in range(len(X))]
    rms, K, _dist, rvec, tvec = calibration
    projected = cv2.projectPoints(X, rvec, tvec, K, None)[0][:, 0]
    assert np.sqrt(np.mean(np.sum((projected - xy) ** 2, axis=1))) == pytest.approx(rms)


@given(camera=cameras(lens=False))
@examples(30)
def test_cameras_of_all_stands_come_back(camera):
    X, xy = seen(camera)
    assume(len(X) >= 6 and np.linalg.svd(X - X.mean(axis=0))[1][1] > 10.0)
    calibration = calibrate_from_points(X, xy, camera.image_size, prior=None)
    assert relative_error(calibration.camera, camera) < 1e-6
    assert relative_error(calibrate_from_points(X, xy, camera.image_size).camera, camera) < 0.2


def test_opencv_shapes_are_one_view():
    X, xy = seen(CAMERA)
    expected = calibrate_from_points(X, xy, SIZE)
    for given_as, images in (
        (X.tolist(), xy.tolist()),
        ([X.astype(np.float64)], [xy]),
        (X[:, None], xy[:, None]),
    ):
        assert calibrate_from_points(given_as, images, SIZE).camera == expected.camera


@pytest.mark.parametrize("prior", ["all", pytest.param(None, marks=pytest.mark.slow)])
def test_gross_errors_are_named_and_do_no_harm(prior):
    rng = np.random.default_rng(4)
    X, xy = seen(CAMERA)
    moved = xy + rng.normal(size=xy.shape)
    wrong = rng.choice(len(X), len(X) // 5, replace=False)
    moved[wrong] = rng.uniform((0, 0), SIZE, size=(len(wrong), 2))
    calibration = calibrate_from_points(X, moved, SIZE, prior=prior)
    assert calibration.accepted
    accused = {int(suspect.label.split()[1]) for suspect in calibration.suspect_labels}
    assert all(f"'point {i}' lies" in calibration.reason for i in accused)
    assert relative_error(calibration.camera, CAMERA) < 0.05
    far = {int(name.split()[1]) for name, error in calibration.per_segment_errors.items() if error > 20.0}
    assert far == accused == {i for i in wrong if np.linalg.norm(moved[i] - xy[i]) > 20.0}


@pytest.mark.slow
def test_gross_errors_under_the_prior_call_for_the_dlt():
    """Among many frames with a fifth of the points anywhere, the stands alone leave twice as many cameras wrong."""
    rng, wrong, names = np.random.default_rng(0), 0, ("main center", "behind left goal", "opposite tribune")
    frames = 0
    while frames < 60:
        camera = random_camera(DISTRIBUTIONS[names[frames % 3]], rng)
        X, xy = seen(camera)
        if len(X) < 8:
            continue
        xy = xy + rng.normal(size=xy.shape)
        xy[rng.choice(len(X), len(X) // 4, replace=False)] = rng.uniform((0, 0), SIZE, size=(len(X) // 4, 2))
        wrong += relative_error(calibrate_from_points(X, xy, SIZE).camera, camera) > 0.2
        frames += 1
    assert wrong <= 2


def test_a_lens_is_estimated_if_asked_for():
    camera = Camera.from_angles(-0.35, 1.36, 0.01, 900.0, (1.5, 68.0, -17.0), SIZE, k=(0.2, 0.0))
    X, xy = seen(camera)
    calibration = calibrate_from_points(X, xy, SIZE, flags=PINHOLE_FLAGS & ~F.CALIB_FIX_K1, prior=None)
    assert calibration.camera.k[0] == pytest.approx(0.2, abs=1e-6)
    assert relative_error(calibration.camera, camera) < 1e-6


def test_tau_rejects():
    X, xy = seen(CAMERA)
    calibration = calibrate_from_points(X, xy + np.random.default_rng(0).normal(size=xy.shape), SIZE, tau=1e-6)
    assert calibration.status is Status.REJECTED
    assert relative_error(calibration.camera, CAMERA) < 0.05


def test_points_alone_do_not_say_where_the_touch_line_is():
    """Nor then whether the camera stands on the field."""
    X = np.array([point.X for name, point in soccer().points.items() if name.startswith("L_")])
    truth = Camera.from_angles(-0.5, 1.35, 0.0, 1000.0, (0.0, 58.0, -18.0), SIZE)
    assert calibrate_from_points(X, truth.project(X), SIZE).accepted


@pytest.mark.parametrize("size", [(640, 640), pytest.param((480, 270), marks=pytest.mark.slow)])
def test_points_of_a_resized_image_are_spoken_of(size):
    X, xy = seen(CAMERA)
    shrunk = xy * np.divide(size, SIZE)
    given = (1920, 1080)
    assert "of another size" in calibrate_from_points(X, shrunk, given).reason
    assert "another size" not in calibrate_from_points(X, xy, SIZE).reason
    assert "another size" not in calibrate_from_points(X, 2.0 * xy, given).reason


@pytest.mark.slow
def test_points_past_the_image_are_spoken_of():
    """Of a frame of 16:9 that was squashed to a square, given with the height of the frame."""
    X, xy = seen(CAMERA)
    message = calibrate_from_points(X, xy * np.divide((640, 640), SIZE), (640, 360)).message
    assert "in an image of 640 x 360: were they found in one of another size" in message


# points of anything


@pytest.mark.parametrize(
    ("planar", "count", "unit"),
    [
        (True, 4, 1e3),  # mm
        (False, 6, 1e-3),  # km
        (True, 12, 1.0),
        *(pytest.param(True, 4, unit, marks=pytest.mark.slow) for unit in (1e-3, 1.0)),
        *(pytest.param(False, 6, unit, marks=pytest.mark.slow) for unit in (1.0, 1e3)),
        pytest.param(False, 12, 1.0, marks=pytest.mark.slow),
    ],
)
@given(data=st.data())
@examples(15)
def test_any_object_in_any_unit(planar, count, unit, data):
    X, camera, distance = data.draw(objects(planar=planar, count=count, unit=unit))
    calibration = calibrate_from_points(X, camera.project(X), SIZE, prior=None)
    assert calibration.rms < 1e-6
    assert relative_error(calibration.camera, camera, distance) < 1e-4


@given(
    drawn=objects(planar=False, count=12),
    noise=numbers(0.0, 2.0),
    angles=any_angles(),
    shift=vectors([-10.0] * 3, [10.0] * 3),
)
def test_the_unit_and_the_place_of_the_object_do_not_matter(drawn, noise, angles, shift):
    X, camera, _ = drawn
    xy, turn = displaced({"points": camera.project(X)}, noise)["points"], rotation_from_angles(angles)
    first = calibrate_from_points(X, xy, SIZE, prior=None)
    second = calibrate_from_points(1000.0 * X @ turn.T + shift, xy, SIZE, prior=None)
    assert second.status is first.status
    assert second.rms == pytest.approx(first.rms, rel=1e-6, abs=1e-6)
    assert second.camera.focal_length == pytest.approx(first.camera.focal_length, rel=1e-4)
    np.testing.assert_allclose(second.camera.R @ turn, first.camera.R, atol=1e-4)
    np.testing.assert_allclose(second.camera.C, 1000.0 * turn @ first.camera.C + shift, rtol=1e-3)


@pytest.mark.parametrize("planar", [True, False])
def test_without_a_robust_loss_it_is_cv2_calibratecamera(planar):
    rng = np.random.default_rng(8)
    X, camera, _ = any_object(rng, planar=planar, count=20, placed=False)  # OpenCV wants planes at z = 0
    xy = camera.project(X) + rng.normal(size=(20, 2))
    ours = calibrate_from_points(X, xy, SIZE, prior=None, loss="linear")
    flags = (
        cv2.CALIB_USE_INTRINSIC_GUESS
        | cv2.CALIB_FIX_ASPECT_RATIO
        | cv2.CALIB_FIX_PRINCIPAL_POINT
        | cv2.CALIB_ZERO_TANGENT_DIST
        | cv2.CALIB_FIX_K1
        | cv2.CALIB_FIX_K2
        | cv2.CALIB_FIX_K3
    )
    K = ours.camera.K.copy()
    rms, K, *_ = cv2.calibrateCamera([X.astype(np.float32)], [xy.astype(np.float32)], SIZE, K, np.zeros(5), flags=flags)
    assert ours.rms == pytest.approx(rms, rel=1e-4)
    assert ours.camera.focal_length == pytest.approx(K[0, 0], rel=1e-3)


def test_a_board_seen_head_on():
    """Its focal length cannot be told from its distance; pan and roll of a field's camera would be one angle here."""
    x, y = np.meshgrid(np.arange(9.0), np.arange(6.0))
    X = np.column_stack([x.ravel(), y.ravel(), np.zeros(54)]) * 0.025
    camera = Camera(np.array([[900.0, 0, 480], [0, 900.0, 270], [0, 0, 1]]), np.eye(3), (0.1, 0.06, -0.5), SIZE)
    calibration = calibrate_from_points(X, camera.project(X), SIZE, prior=None)
    assert calibration.status is Status.DEGENERATE
    assert calibration.rms < 1.0
    known = calibrate_from_points(
        X, camera.project(X), SIZE, camera.K, flags=PINHOLE_FLAGS | F.CALIB_FIX_FOCAL_LENGTH, prior=None
    )
    assert known.accepted
    assert relative_error(known.camera, camera) < 1e-6


@pytest.mark.parametrize("turn", [0.0, 0.4, 1.3])
def test_four_points_seen_head_on_have_a_camera_still(turn):
    """Where the homography has no real focal length, one must be assumed."""
    X = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]) - (0.5, 0.5, 0.0)
    R = rotation_from_angles(np.array([turn, 0.0, 0.0]))
    camera = Camera(np.array([[900.0, 0, 480], [0, 900.0, 270], [0, 0, 1]]), R, (0.0, 0.0, -3.0), SIZE)
    calibration = calibrate_from_points(X, camera.project(X), SIZE, prior=None)
    assert calibration.status is Status.DEGENERATE
    assert calibration.rms < 1.0


@pytest.mark.parametrize("planar", [True, False])
@given(data=st.data(), offset=vectors((-30.0, -30.0), (30.0, 30.0)))
@examples(10)
def test_known_intrinsics(planar, data, offset):
    """A lens, pixels that are not square and a principal point off the centre are taken out before the DLT."""
    X, camera, distance = data.draw(objects(planar=planar, count=14))
    K = camera.K * [[1.0], [1.05], [1.0]]
    K[:2, 2] += offset
    camera = Camera(K, camera.R, camera.C, SIZE, (-0.15, 0.01))
    xy = camera.project(X)
    xy[:3] += (150.0, -90.0)
    flags = PINHOLE_FLAGS | F.CALIB_FIX_FOCAL_LENGTH
    calibration = calibrate_from_points(X, xy, SIZE, K, (-0.15, 0.01), flags=flags, prior=None)
    np.testing.assert_allclose(calibration.camera.K, K)
    np.testing.assert_allclose(calibration.camera.k, camera.k, atol=1e-9)
    assert relative_error(calibration.camera, camera, distance) < 2e-2


def test_a_given_pose_is_the_start():
    X, xy = seen(CAMERA)
    rvec, tvec, K, _ = Camera.from_angles(-0.33, 1.34, 0.0, 1400.0, (2.0, 66.0, -16.0), SIZE).to_opencv()
    flags = PINHOLE_FLAGS | F.CALIB_USE_INTRINSIC_GUESS | F.CALIB_USE_EXTRINSIC_GUESS
    calibration = calibrate_from_points(X, xy, SIZE, K, None, rvec, tvec, flags=flags, prior=None)
    assert relative_error(calibration.camera, CAMERA) < 1e-6


@pytest.mark.parametrize("prior", ["all", None])
def test_a_known_position_is_kept(prior):
    X, xy = seen(CAMERA)
    rvec, tvec, _, _ = CAMERA.to_opencv()
    flags = PINHOLE_FLAGS | F.CALIB_FIX_POSITION
    calibration = calibrate_from_points(X, xy + 1.0, SIZE, None, None, rvec, tvec, flags=flags, prior=prior)
    np.testing.assert_allclose(calibration.camera.C, CAMERA.C, atol=1e-6)
    assert calibration.accepted


@pytest.mark.parametrize("prior", ["all", None])
def test_a_known_rotation_is_kept(prior):
    X, xy = seen(CAMERA)
    rvec, *_ = CAMERA.to_opencv()
    noisy = xy + np.random.default_rng(0).normal(size=xy.shape)
    flags = PINHOLE_FLAGS | F.CALIB_FIX_ROTATION
    calibration = calibrate_from_points(X, noisy, SIZE, None, None, rvec, flags=flags, prior=prior)
    np.testing.assert_allclose(calibration.camera.R, CAMERA.R, atol=1e-9)
    assert calibration.accepted


def test_a_roll_that_is_fixed_is_about_the_axes_of_the_object():
    camera = Camera.from_angles(-0.35, 1.36, 0.0, 1500.0, (1.5, 68.0, -17.0), SIZE)
    X, xy = seen(camera)
    noisy = xy + np.random.default_rng(0).normal(size=xy.shape)
    calibration = calibrate_from_points(X, noisy, SIZE, flags=PINHOLE_FLAGS | F.CALIB_FIX_ROLL, prior=None)
    assert calibration.camera.angles[2] == pytest.approx(0.0, abs=1e-9)
    assert relative_error(calibration.camera, camera) < 0.05


def test_a_distribution_of_ones_own_needs_no_stadium():
    """From below a ceiling, say: nothing is wrong with a camera at z > 0 then."""
    X = np.column_stack([np.random.default_rng(0).uniform(-3, 3, size=(10, 2)), np.zeros(10)])
    camera = Camera.from_angles(0.1, np.pi - 0.6, 0.02, 800.0, (0.5, 2.0, 4.0), SIZE)
    X, xy = seen(camera, X)
    below = CameraDistribution("below", (-40, 40), (120, 175), (-10, 10), (30, 100), (-3, 3), (-1, 5), (3, 5))
    calibration = calibrate_from_points(X, xy, SIZE, prior=below)
    assert calibration.accepted
    assert relative_error(calibration.camera, camera) < 0.05


# what cannot be calibrated


@pytest.mark.parametrize("count", [0, 1, 2, 3])
def test_few_points_are_said_to_be_few(count):
    X, xy = (values[:count] for values in seen(CAMERA))
    alone = calibrate_from_points(X, xy, SIZE, prior=None)
    assert alone.status is Status.TOO_FEW_SEGMENTS
    assert alone.camera is None
    with_prior = calibrate_from_points(X, xy, SIZE)
    assert with_prior.status is Status.TOO_FEW_SEGMENTS
    assert (with_prior.camera is None) == (count == 0)
    for calibration in (alone, with_prior):
        assert "segment" not in calibration.message
    rvec, tvec, K, _ = CAMERA.to_opencv()
    flags = PINHOLE_FLAGS | F.CALIB_USE_INTRINSIC_GUESS | F.CALIB_USE_EXTRINSIC_GUESS
    started = calibrate_from_points(X, xy, SIZE, K, None, rvec, tvec, flags=flags, prior=None)
    assert started.status is Status.TOO_FEW_SEGMENTS
    assert (started.camera is None) == (count == 0)


@pytest.mark.parametrize("prior", ["all", None])
def test_points_on_a_line_are_degenerate(prior):
    X = np.column_stack([np.linspace(-30, 0, 9), np.full(9, -34.0), np.zeros(9)])
    X, xy = seen(CAMERA, X)
    calibration = calibrate_from_points(X, xy, SIZE, prior=prior)
    assert calibration.status is Status.DEGENERATE
    assert (calibration.camera is None) == (prior is None)


@pytest.mark.parametrize("origin", [(0.0, 0.0, 0.0), (-14.0, -7.5, 0.0)])
def test_points_of_another_court_need_no_prior(origin):
    corners = np.array([(x, y, 0.0) for x in (-14.0, 0.0, 14.0) for y in (-7.5, 7.5)]) - origin
    camera = Camera.from_angles(0.1, 1.2, 0.0, 900.0, np.array((0.0, 20.0, -6.0)) - origin, SIZE)
    inside = [corners.astype(np.float32)], [camera.project(corners)[:, None].astype(np.float32)]  # as cv2 takes them
    found = calibrate_from_points(*inside, SIZE)
    assert found.verdict == "good"
    np.testing.assert_allclose(found.camera.C, camera.C, atol=0.01)


@pytest.mark.slow
def test_points_of_another_camera_everywhere_are_implausible():
    rng = np.random.default_rng(0)
    X, _ = seen(CAMERA)
    calibration = calibrate_from_points(X, rng.uniform((0, 0), SIZE, size=(len(X), 2)), SIZE)
    assert calibration.status is Status.IMPLAUSIBLE


def test_twice_is_the_same():
    rng = np.random.default_rng(1)
    X, xy = seen(CAMERA)
    xy = xy + rng.normal(size=xy.shape)
    first, second = (calibrate_from_points(X, xy, SIZE, prior=None) for _ in range(2))
    assert first == second


X4, XY4 = [[0.0, 0, 0], [9, 0, 0], [9, 9, 0], [0, 9, 0]], [[100.0, 100], [800, 120], [850, 500], [80, 480]]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((X4, XY4[:3], SIZE), "must be of one length, got 4 and 3"),
        (([[0.0, 0], [9, 0], [9, 9]], XY4[:3], SIZE), r"object_points: expected .* \(N, 3\).*z = 0 is to be appended"),
        (([X4, X4], [XY4, XY4], SIZE), r"one view, got shape \(2, 4, 3\)"),
        ((["corner"], [[1.0, 2.0]], SIZE), "object_points: expected an array"),
        ((X4, [*XY4[:3], [np.nan, 0]], SIZE), "image_points: point 3 is not finite"),
        (([*X4[:3], [np.inf, 0, 0]], XY4, SIZE), "object_points: point 3 is not finite"),
        (
            (np.multiply(X4, 10.0), XY4, SIZE),
            "point 1 at .* is on no soccer field: expected metres from the centre mark",
        ),
        ((X4, XY4, (960, 540, 3)), "image_size must be"),
        ((X4, XY4, SIZE, np.eye(3)), "camera_matrix and the flags"),
    ],
)
def test_mistakes_raise(arguments, message):
    with pytest.raises(ValueError, match=message):
        calibrate_from_points(*arguments)


@pytest.mark.parametrize(
    ("prior", "message"),
    [
        ("nowhere", "unknown camera distribution 'nowhere'"),
        (3, "prior must be the name of a camera distribution, .* or None, got 3"),
    ],
)
def test_an_unknown_prior_raises(prior, message):
    with pytest.raises(ValueError, match=message):
        calibrate_from_points(X4, XY4, SIZE, prior=prior)


# weights


@pytest.mark.parametrize("prior", ["all", None])
def test_a_point_of_weight_2_counts_as_two(prior):
    X, xy = seen(CAMERA)
    xy = displaced({"points": xy}, 3.0)["points"]
    twice = np.r_[np.arange(len(X)), 2, 5]
    weights = np.ones(len(X))
    weights[[2, 5]] = 2.0
    plain = calibrate_from_points(X, xy, SIZE, prior=prior)
    weighted = calibrate_from_points(X, xy, SIZE, prior=prior, weights=weights)
    repeated = calibrate_from_points(X[twice], xy[twice], SIZE, prior=prior)
    assert relative_error(weighted.camera, repeated.camera) < 1e-5
    assert relative_error(plain.camera, repeated.camera) > 1e-3


@pytest.mark.parametrize("prior", ["all", None])
def test_points_of_weight_0_are_not_there(prior):
    X, xy = seen(CAMERA)
    kept = np.arange(len(X)) % 3 != 1
    xy = np.where(kept[:, None], xy, 0.0)
    weighted = calibrate_from_points(X, xy, SIZE, prior=prior, weights=1.0 * kept)
    without = calibrate_from_points(X[kept], xy[kept], SIZE, prior=prior)
    assert weighted.camera == without.camera
    assert list(weighted.per_segment_errors) == [f"point {i}" for i in np.flatnonzero(kept)]


@given(scale=st.sampled_from([1e-3, 0.2, 50.0]))
@examples(3)
def test_without_a_prior_only_the_ratio_of_the_weights_matters(scale):
    X, xy = seen(CAMERA)
    xy = displaced({"points": xy}, 2.0)["points"]
    weights = np.linspace(0.2, 1.0, len(X))
    first, second = (calibrate_from_points(X, xy, SIZE, prior=None, weights=w) for w in (weights, scale * weights))
    assert relative_error(first.camera, second.camera) < 1e-5
    one, none = (calibrate_from_points(X, xy, SIZE, weights=w) for w in (1.0, None))
    assert one.camera == none.camera


@pytest.mark.slow
def test_doubted_points_do_little_harm():
    """Four gross errors of eleven: more than a robust loss takes among equals."""
    X, xy = seen(CAMERA)
    rng = np.random.default_rng(5)
    wrong = rng.choice(len(X), len(X) // 2, replace=False)
    xy[wrong] += (90.0, 60.0)
    weights = np.ones(len(X))
    weights[wrong] = 0.05
    trusted, doubted = (calibrate_from_points(X, xy, SIZE, prior=None, weights=w) for w in (None, weights))
    assert relative_error(doubted.camera, CAMERA) < 0.02 < relative_error(trusted.camera, CAMERA)


@pytest.mark.parametrize(
    ("weights", "message"),
    [
        ([1.0, 2.0], r"weights: expected one weight or 4, one for each point, got shape \(2,\)"),
        ([1.0, 1.0, -1.0, 1.0], "weights: a weight must be finite and not negative, got -1.0; 0 leaves a point out"),
        ([1.0, np.nan, 1.0, 1.0], "weights: a weight must be finite"),
        ("heavy", "weights: expected a weight, or one for each point, got 'heavy'"),
        (np.zeros(4), "every point has the weight 0"),
    ],
)
def test_weights_that_are_none_raise(weights, message):
    with pytest.raises(ValueError, match=message):
        calibrate_from_points(X4, XY4, SIZE, weights=weights)


# very many points


@pytest.mark.slow
@pytest.mark.parametrize("prior", ["all", None])
def test_memory_grows_linearly_with_the_points(prior):
    """Comparing every point with every other one would take 400 MB for the boxes of the points alone."""
    rng = np.random.default_rng(5)
    few, _ = seen(CAMERA)
    X = few[rng.integers(0, len(few), 3000)]
    xy = CAMERA.project(X) + rng.normal(size=(len(X), 2))
    xy[::9] = rng.uniform((0, 0), SIZE, size=(len(xy[::9]), 2))
    tracemalloc.start()
    try:
        calibration = calibrate_from_points(X, xy, SIZE, prior=prior)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 200e6
    assert calibration.accepted
    assert not calibration.suspect_labels
    assert relative_error(calibration.camera, CAMERA) < 0.05
