"""What a calibration says: errors, statuses and messages, uncertainty."""

import copy
import pickle
from dataclasses import replace

import numpy as np
import pytest
from objects import relative_error
from one_camera import CAMERA, FIELD, FRAME, MARKINGS, SIZE, F
from synthetic import observe, random_frames

from fieldcalib import (
    Camera,
    Line,
    Point,
    Status,
    calibrate_batch,
    calibrate_from_homography,
    calibrate_from_segments,
    locate_on_ground,
)
from fieldcalib.assess.advice import NoCameraError
from fieldcalib.solve import compute_errors
from fieldcalib.solve.solver_options import DEFAULT_FLAGS

# --- what comes back ---


def test_unpacks_to_what_opencv_returns_for_one_view():
    import cv2

    calibration = calibrate_from_segments(FIELD, FRAME, SIZE)
    rms, K, dist, rvec, tvec = calibration
    assert (K.shape, dist.shape, rvec.shape, tvec.shape) == ((3, 3), (1, 5), (3, 1), (3, 1))
    assert rms == calibration.rms
    X = np.array([(0.0, 0.0, 0.0), (-30.0, -10.0, -1.0)])
    xy, _ = cv2.projectPoints(X, rvec, tvec, K, dist)
    np.testing.assert_allclose(xy[:, 0], calibration.camera.project(X), atol=1e-6)


def test_errors_are_those_of_the_pixels():
    shifted = {**FRAME, "Side line top": FRAME["Side line top"] + (0.0, 2.0)}
    found = calibrate_from_segments(FIELD, shifted, SIZE)
    X = FIELD["Side line top"].sample(0.01)
    gaps = [np.nanmin(np.linalg.norm(found.camera.project(X) - xy, axis=1)) for xy in shifted["Side line top"]]
    assert found.per_segment_errors["Side line top"] == pytest.approx(np.sqrt(np.mean(np.square(gaps))), abs=0.01)
    counts = [len(xy) for xy in shifted.values()]
    mean_square = np.average(np.square(list(found.per_segment_errors.values())), weights=counts)
    assert found.rms == pytest.approx(np.sqrt(mean_square))


@pytest.mark.parametrize(
    ("frame", "status", "message"),
    [
        ({}, Status.TOO_FEW_SEGMENTS, "no labelled pixels"),
        ({"Middle line": []}, Status.TOO_FEW_SEGMENTS, "no labelled pixels"),
        ({"Middle line": [(480, 100), (490, 400)]}, Status.TOO_FEW_SEGMENTS, "1 segment: 2 equations for 7 unknowns"),
        ({"Side line top": [(5, 100), (900, 90)]}, Status.TOO_FEW_SEGMENTS, "label more segments"),
    ],
)
def test_too_few_labels(frame, status, message):
    found = calibrate_from_segments(FIELD, frame, SIZE)
    assert found.status is status
    assert message in found.message
    assert not found.accepted
    assert (found.camera is None) == (not any(len(xy) for xy in frame.values()))


USES_OF_A_CAMERA = {
    "unpacked": list,
    "required": lambda found: found.required_camera,
    "K": lambda found: found.K,
    "project": lambda found: found.project([0.0, 0.0, 0.0]),
    "image_to_field": lambda found: found.image_to_field([480.0, 300.0]),
    "located": lambda found: locate_on_ground(found, [480.0, 300.0]),
    "uncertainty": lambda found: found.uncertainty,
    "covariance": lambda found: found.covariance,
    "std_deviations": lambda found: found.std_deviations,
    "observability": lambda found: found.observability,
    "field_uncertainty": lambda found: found.field_uncertainty([480.0, 300.0]),
}


@pytest.mark.parametrize("use", USES_OF_A_CAMERA.values(), ids=USES_OF_A_CAMERA)
def test_the_use_of_a_missing_camera_is_an_error_that_says_why(use):
    nothing = calibrate_from_segments(FIELD, {}, SIZE)
    assert nothing.camera is None
    assert not nothing
    with pytest.raises(NoCameraError, match=r"no labelled pixels.*\(too few segments\).*more markings") as raised:
        use(nothing)
    error = pickle.loads(pickle.dumps(raised.value))
    assert (error.status, error.reason, error.remedy) == (nothing.status, nothing.message, nothing.remedy)


def test_a_camera_is_used_through_its_calibration_too():
    found = calibrate_from_segments(FIELD, FRAME, SIZE)
    assert found.required_camera is found.camera
    np.testing.assert_array_equal(found.K, found.camera.K)
    np.testing.assert_array_equal(found.project([0.0, 0.0, 0.0]), found.camera.project([0.0, 0.0, 0.0]))
    np.testing.assert_array_equal(found.image_to_field([480, 300]), found.camera.image_to_field([480, 300]))


def test_what_a_calibration_holds_cannot_be_written_to():
    found = calibrate_from_segments(FIELD, FRAME, SIZE)
    errors = dict(found.per_segment_errors)
    for numbers in (found.per_segment_errors, found.pixel_counts):
        with pytest.raises(TypeError):
            numbers["Side line top"] = 0.0
    assert found.per_segment_errors == errors
    for copied in (pickle.loads(pickle.dumps(found)), copy.deepcopy(found), replace(found)):
        assert copied == found
        assert list(copied.per_segment_errors) == list(errors)


def seen_by_a_wide_camera(labels):
    camera = Camera.from_angles(0.1, 1.2, 0.0, 520.0, (0.0, 70.0, -30.0), SIZE)
    frame = observe({label: FIELD[label] for label in labels}, camera, per_curve=12)
    assert set(frame) == set(labels)
    return frame


@pytest.mark.parametrize(
    ("labels", "message"),
    [
        (("Side line top", "Big rect. left top", "Big rect. left bottom", "Small rect. left top"), "parallel"),
        (("Circle central", "Circle central left", "Circle central right"), "only one circle"),
    ],
)
def test_degenerate_labels_are_named(labels, message):
    frame = seen_by_a_wide_camera(labels)
    if "only one circle" in message:  # where its halves end would tell from where it is seen
        frame = {label: xy[2:-2] for label, xy in frame.items()}
    found = calibrate_from_segments(FIELD, frame, SIZE)
    assert found.status is Status.DEGENERATE
    assert message in found.message
    assert np.isfinite(found.camera.project(found.camera.image_to_field((480.0, 500.0)))).all()


def test_lines_through_one_point_are_degenerate():
    corner = Point((0.0, 0.0, 0.0)).X
    star = {f"ray {i}": Line(corner, (10.0 * np.cos(a), 10.0 * np.sin(a), 0.0)) for i, a in enumerate((0, 1, 2, 2.5))}
    camera = Camera.from_angles(0.0, 1.3, 0.0, 1500.0, (0.0, 60.0, -15.0), SIZE)
    found = calibrate_from_segments(star, observe(star, camera), SIZE, prior="main center")
    assert found.status is Status.DEGENERATE
    assert "meet in one point" in found.message


def test_tau_rejects_and_still_gives_the_camera():
    frame = observe(MARKINGS, CAMERA, np.random.default_rng(1), noise=4.0)
    found = calibrate_from_segments(FIELD, frame, SIZE)
    assert found.accepted
    low, high = (calibrate_from_segments(FIELD, frame, SIZE, tau=t * found.loss_ndc) for t in (0.99, 1.01))
    assert low.status is Status.REJECTED
    assert "above tau" in low.message
    assert high.accepted
    assert low.camera == high.camera == found.camera


@pytest.mark.slow
def test_pixels_of_no_camera_are_never_accepted():
    rng = np.random.default_rng(3)
    frames = [{label: rng.uniform((0, 0), SIZE, size=(3, 2)) for label in FRAME} for _ in range(10)]
    found = calibrate_batch(FIELD, frames, SIZE)
    assert not any(calibration.accepted for calibration in found)
    assert all(calibration.camera is not None for calibration in found)
    assert any("segments agree with the best fit" in calibration.message for calibration in found)
    assert all(c.status is Status.REJECTED for c in calibrate_batch(FIELD, frames[:2], SIZE, tau=0.019))


def test_a_camera_below_the_ground_is_implausible():
    below = Camera.from_angles(-0.35, 1.9, 0.01, 1400.0, (1.5, 68.0, 17.0), SIZE)
    frame = observe(MARKINGS, below)
    rms, K, dist, rvec, tvec = 0.0, below.K, None, *below.to_opencv()[:2]
    guess = F.CALIB_USE_INTRINSIC_GUESS | F.CALIB_USE_EXTRINSIC_GUESS
    found = calibrate_from_segments(FIELD, frame, SIZE, K, dist, rvec, tvec, flags=DEFAULT_FLAGS | guess, prior=None)
    assert found.status is Status.IMPLAUSIBLE
    assert "below the ground" in found.message
    assert found.rms == pytest.approx(rms, abs=1e-6)


def test_iterations_that_do_not_suffice_are_said_so():
    frame = observe(MARKINGS, CAMERA, np.random.default_rng(4), noise=3.0)
    found = calibrate_from_segments(FIELD, frame, SIZE, criteria=(1, 1, 0.0))
    assert found.status is Status.NOT_CONVERGED
    assert relative_error(found.camera, CAMERA) < 0.2


@pytest.mark.parametrize(
    ("frame", "message"),
    [
        ({"Midle line": [(1, 2)]}, "did you mean 'Middle line'"),
        ({"Middle line": [(0.5, 0.1), (0.5, 0.9)]}, "normalised"),
        ({"Middle line": [(480, np.nan)]}, "'Middle line': pixel 0 is not finite"),
    ],
)
def test_what_cannot_be_right_is_an_error(frame, message):
    with pytest.raises(ValueError, match=message):
        calibrate_from_segments(FIELD, frame, SIZE)
    with pytest.raises(ValueError, match=f"frame 1: .*{message}"):
        calibrate_batch(FIELD, [FRAME, frame], SIZE)


# --- uncertainty ---


def test_a_calibration_knows_how_far_it_may_be_off():
    frame = observe(MARKINGS, CAMERA, np.random.default_rng(3), noise=1.0)
    one = calibrate_from_segments(FIELD, frame, SIZE)
    (many,) = calibrate_batch(FIELD, [frame], SIZE)
    intrinsics, extrinsics = one.std_deviations
    assert (intrinsics.shape, extrinsics.shape) == ((18, 1), (6, 1))
    assert 0.0 < intrinsics[0, 0] < 0.05 * CAMERA.focal_length
    assert abs(one.camera.focal_length - CAMERA.focal_length) < 4.0 * intrinsics[0, 0]
    np.testing.assert_allclose(many.std_deviations[0], intrinsics, rtol=1e-2, atol=1e-9)
    assert one.covariance.shape == (15, 15)  # length, width and crown of the field, which are considered, come last
    error = one.field_uncertainty([[480.0, 300.0], [480.0, -2000.0]])
    assert 0.0 < error.rms[0] < 1.0
    assert np.isnan(error.rms[1])  # above the horizon
    assert len(one.observability) == 10  # what is free: pose and zoom, principal point, k1
    assert one == calibrate_from_segments(FIELD, frame, SIZE)  # whatever has been asked of them


def test_errors_of_several_are_those_of_each_alone():
    frames, _ = random_frames(6, seed=3, noise=1.0)
    one_by_one, together = (calibrate_batch(FIELD, frames, SIZE) for _ in range(2))
    nothing = calibrate_batch(FIELD, [{}], SIZE)
    compute_errors([*reversed(together[1:]), *nothing])
    for alone, other in zip(one_by_one, together, strict=True):
        scale = np.sqrt(np.outer(np.diagonal(alone.covariance), np.diagonal(alone.covariance)))
        assert np.max(np.abs(other.covariance - alone.covariance)) < 1e-9 * np.max(scale)
        assert other.probability() == pytest.approx(alone.probability(), rel=1e-9)
        assert other.uncertainty is other.uncertainty


def test_more_noise_makes_less_certain():
    noisy = [
        calibrate_from_segments(FIELD, observe(MARKINGS, CAMERA, np.random.default_rng(1), noise=noise), SIZE)
        for noise in (0.3, 3.0)
    ]
    sharp, blurred = (float(c.field_uncertainty([480.0, 300.0]).rms) for c in noisy)
    assert blurred > 2.0 * sharp


def test_cameras_that_were_not_fitted_know_no_errors():
    (empty,) = calibrate_batch(FIELD, [{}], SIZE)
    with pytest.raises(NoCameraError, match="there is no camera: no labelled pixels"):
        _ = empty.uncertainty
    of_homography = calibrate_from_homography([[8.0, 2, 480], [0, 3, 270], [0, 0.004, 1]], SIZE)
    with pytest.raises(ValueError, match="expected a calibration from labelled pixels"):
        _ = of_homography.uncertainty
    assert np.isnan(of_homography.probability())


# --- labels that lie ---

BOX = Camera.from_angles(-0.62, 1.36, 0.01, 1500.0, (1.5, 68.0, -17.0), SIZE)


@pytest.mark.parametrize(
    ("true", "given"),
    [
        ("Big rect. left top", "Big rect. right bottom"),
        ("Small rect. left main", "Small rect. right main"),
        ("Circle left", "Circle right"),
        ("Goal left post left", "Goal right post left"),
    ],
)
def test_a_label_that_lies_is_named_and_does_no_harm(true, given):
    frame = observe(MARKINGS, BOX, np.random.default_rng(5), noise=0.5)
    assert len(frame) >= 8
    lying = {given if label == true else label: xy for label, xy in frame.items()}
    clean = calibrate_from_segments(FIELD, frame, SIZE)
    for found in (calibrate_from_segments(FIELD, lying, SIZE), *calibrate_batch(FIELD, [lying], SIZE)):
        assert [(suspect.label, suspect.fits) for suspect in found.suspect_labels] == [(given, true)]
        assert found.accepted
        assert f"{given!r} lies" in found.reason
        assert list(found.per_segment_errors) == list(lying)  # as given
        assert relative_error(found.camera, clean.camera) < 1e-3
    assert clean.suspect_labels == ()


def test_clean_frames_are_not_accused():
    frames, _ = random_frames(60, seed=9, noise=1.0, least_segments=5)
    assert [c.suspect_labels for c in calibrate_batch(FIELD, frames, SIZE)] == [()] * 60
