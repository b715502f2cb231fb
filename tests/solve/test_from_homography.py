"""From the homography of the ground to a calibration."""

import numpy as np
import pytest
from hypothesis import assume, given
from objects import SIZE, points_in_view, relative_error, without_focal_length
from strategies import cameras, numbers

from fieldcalib import Camera, Status, calibrate_from_homography, soccer
from fieldcalib.fields import Ground
from fieldcalib.fields.ground_homography import pixels_of_ground
from fieldcalib.geometry.homography import dehomogenize, homogenize
from fieldcalib.solve.from_homography import on_level_ground

CAMERA = Camera.from_angles(-0.35, 1.36, 0.01, 1500.0, (1.5, 68.0, -17.0), SIZE)


@given(camera=cameras(lens=False))
def test_a_homography_gives_its_camera(camera):
    assume(len(points_in_view(camera, 0.1)) >= 3)
    calibration = calibrate_from_homography(camera.homography, camera.image_size)
    assert calibration.accepted
    assert relative_error(calibration.camera, camera) < 1e-5
    assert calibration.rms < 1e-3
    assert calibration.loss_ndc < 1e-5
    assert set(calibration.per_segment_errors) == points_in_view(camera, 0.1)


def test_rms_says_how_far_a_homography_is_from_being_a_cameras():
    H = CAMERA.homography * (1.0 + 0.003 * np.random.default_rng(5).normal(size=(3, 3)))
    calibration = calibrate_from_homography(H, SIZE)
    X = np.array([soccer()[name].X for name in calibration.per_segment_errors])
    xy = dehomogenize(homogenize(X[:, :2]) @ H.T)
    distance = np.linalg.norm(calibration.camera.project(X) - xy, axis=1)
    np.testing.assert_allclose(list(calibration.per_segment_errors.values()), distance)
    assert calibration.rms == pytest.approx(np.sqrt(np.mean(distance**2)))
    assert calibration.rms > 0.03


def test_a_homography_without_focal_length_has_no_camera():
    calibration = calibrate_from_homography(without_focal_length(), SIZE, principal_point=(0.0, 0.0))
    assert calibration.status is Status.IMPLAUSIBLE
    assert calibration.camera is None
    assert "no real focal length" in calibration.message


def test_a_rejected_homography_has_the_closed_form():
    camera = Camera.from_angles(0.2, 1.36, 0.0, 12000.0, (1.5, 68.0, -17.0), SIZE)
    calibration = calibrate_from_homography(camera.homography, SIZE)
    assert calibration.status is Status.IMPLAUSIBLE
    assert relative_error(calibration.camera, camera) < 1e-6
    assert calibration.message.startswith("not refined: of ")


def test_a_field_seen_from_below_is_implausible():
    """The camera above the ground of that homography has the field behind it."""
    camera = Camera.from_angles(0.3, np.pi - 1.3, 0.0, 900.0, (2.0, 70.0, 18.0), SIZE)
    calibration = calibrate_from_homography(camera.homography, SIZE)
    assert calibration.status is Status.IMPLAUSIBLE
    assert "the camera of the homography has 0 within" in calibration.message
    np.testing.assert_allclose(calibration.camera.C, camera.C * (1, 1, -1), rtol=1e-6)


@pytest.mark.parametrize(
    ("camera", "complaint"),
    [
        (Camera.from_angles(-0.35, 1.36, np.radians(60.0), 1500.0, (1.5, 68.0, -17.0), SIZE), "rolled by more than 45"),
        (Camera.from_angles(0.0, 1.36, 0.0, 9000.0, (0.0, 380.0, -80.0), SIZE), "more than 300 m away"),
    ],
)
def test_a_homography_is_of_a_field(camera, complaint):
    """What no camera of a stadium is, an object of another kind could have been seen by."""
    calibration = calibrate_from_homography(camera.homography, SIZE)
    assert calibration.status is Status.IMPLAUSIBLE
    assert complaint in calibration.message
    assert relative_error(calibration.camera, camera) < 1e-4


def test_a_homography_from_pixels_to_metres_is_said_to_be_one():
    calibration = calibrate_from_homography(-3.0 * np.linalg.inv(CAMERA.homography), SIZE)
    assert calibration.status is Status.IMPLAUSIBLE
    assert calibration.message.endswith("H seems to map pixels to metres, give np.linalg.inv(H)")
    singular = calibrate_from_homography([[1.0, 0.0, 2.0], [0.0, 1.0, 3.0], [0.0, 0.0, 0.0]], SIZE)
    assert "pixels to metres" not in singular.message


@pytest.mark.parametrize("scale", [-1.0, 1e-12, -1e12])
def test_scale_and_sign_of_a_homography_do_not_matter(scale):
    truth = Camera.from_angles(0.3, 1.3, 0.01, 1800.0, (2.0, 70.0, -18.0), SIZE)
    found = calibrate_from_homography(scale * truth.homography, SIZE)
    np.testing.assert_allclose(found.camera.C, truth.C, rtol=1e-6)
    assert found.camera.focal_length == pytest.approx(truth.focal_length, rel=1e-6)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_homography_that_is_not_finite_is_told(value):
    H = Camera.from_angles(0.3, 1.3, 0.01, 1800.0, (2.0, 70.0, -18.0), SIZE).homography
    H[1, 2] = value
    with pytest.raises(ValueError, match="finite"):
        calibrate_from_homography(H, SIZE)


@pytest.mark.parametrize(
    "H",
    [
        np.zeros((3, 3)),
        np.ones((3, 3)),  # rank one
        [[10.0, 5.0, 480.0], [2.0, 1.0, 270.0], [0.0, 0.0, 1.0]],  # rank two
        np.eye(3),  # parallel to the picture: any focal length
        [
            [8.0, 2.0, 480.0],
            [0.0, 3.0, 270.0],
            [0.0, 0.0, 1.0],
        ],  # affine
        [[8.0, 2.0, 480.0], [0.0, 3.0, 270.0], [0.004, 0.004, 1.0]],
    ],
)
def test_a_homography_without_a_camera_has_a_reason(H):
    found = calibrate_from_homography(H, SIZE)
    assert not found
    assert found.message
    assert found.camera is None or np.isfinite(found.camera.K).all()


@given(camera=cameras(), crown=numbers(0.05, 0.5))
def test_a_camera_on_level_ground_is_nearer_than_that_of_raised_ground(camera, crown):
    raised = soccer().with_ground(Ground(crown=crown))
    xy, X = pixels_of_ground(camera, raised)
    assume(len(X) > 20)
    level = on_level_ground(camera, raised)
    np.testing.assert_array_equal((*level.K.flat, *level.dist.flat), (*camera.K.flat, *camera.dist.flat))
    off = [np.linalg.norm(one.project(np.insert(X, 2, 0.0, axis=1)) - xy) for one in (camera, level)]
    assert off[1] < off[0]
    assert on_level_ground(camera, soccer()) is camera
    assert on_level_ground(camera, None) is camera


def test_where_no_camera_of_level_ground_is_found_the_camera_stays():
    """It stands a millimetre above the raised ground: the nearest pose would be far below it."""
    camera = Camera.from_angles(-1.0606, 0.1341, -0.1109, 4947.0, (-16.778, 0.7787, -0.5254), SIZE, k=(0.1918, 0.0))
    raised = soccer().with_ground(Ground(crown=0.5225))
    assert len(pixels_of_ground(camera, raised)[1]) > 20
    level = on_level_ground(camera, raised)
    assert np.linalg.norm(level.C - camera.C) < 5.0
