"""What is known before a calibration: cameras to start from, fixed values, the lens, weights."""

import re

import numpy as np
import pytest
from objects import relative_error
from one_camera import CAMERA, FIELD, FRAME, LITTLE_OF_THE_LENS, MARKINGS, SIZE, F, with_lens
from synthetic import observe, random_frames, whole_circle_markings

from fieldcalib import Camera, Point, Status, calibrate_batch, calibrate_from_segments, soccer
from fieldcalib.assess.findings import Verdict, What
from fieldcalib.fields.ground import Ground
from fieldcalib.geometry.lens import RadialLens
from fieldcalib.geometry.lens.radial import RADIAL_MEAN
from fieldcalib.solve.solver_options import DEFAULT_FLAGS, PINHOLE_FLAGS, CalibrationFlags

# --- what is known, and from where ---


def test_a_guess_is_enough_to_start_from():
    rvec, tvec, K, _ = CAMERA.to_opencv()
    guess = F.CALIB_USE_INTRINSIC_GUESS | F.CALIB_USE_EXTRINSIC_GUESS
    near = K * [[1.02, 1.0, 1.0], [1.0, 1.02, 1.0], [1.0, 1.0, 1.0]]
    flags = DEFAULT_FLAGS | F.CALIB_FIX_PRINCIPAL_POINT | guess  # these few labels do not tell it
    found = calibrate_from_segments(FIELD, FRAME, SIZE, near, None, rvec + 0.01, tvec + 0.5, flags=flags, prior=None)
    assert relative_error(found.camera, CAMERA) < 1e-6


def test_a_place_that_the_labels_contradict_is_not_good():
    """The fit is bent over a wrong place; what is left is larger than any annotator's errors."""
    found = {}
    for off in (0.0, 5.0):
        tvec = -(CAMERA.C + (0.0, off, -0.6 * off))
        flags = DEFAULT_FLAGS | F.CALIB_FIX_POSITION
        found[off] = calibrate_from_segments(FIELD, FRAME, SIZE, rvec=np.zeros(3), tvec=tvec, flags=flags)
    assert found[0.0].verdict is Verdict.GOOD
    assert found[5.0].verdict is not Verdict.GOOD
    assert "check the size of field and image, and what was given of the camera" in found[5.0].reason


def seen_with_noise(camera, seed=0, noise=1.0, field=FIELD):
    rng = np.random.default_rng(seed)
    return {label: xy + rng.normal(0.0, noise, xy.shape) for label, xy in observe(field.markings, camera).items()}


def given(camera, flags):
    """The values of a camera that flags fix, as arguments."""
    rvec, tvec, K, dist = camera.to_opencv()
    known = {"flags": DEFAULT_FLAGS | flags}
    if flags & F.CALIB_FIX_FOCAL_LENGTH:
        known |= {"camera_matrix": K, "dist_coeffs": dist}
    if flags & F.CALIB_FIX_POSITION:
        known |= {"rvec": np.zeros(3), "tvec": -camera.C}
    if flags & (F.CALIB_FIX_ROLL | F.CALIB_FIX_ROTATION):
        known |= {"rvec": rvec}
    if flags & F.CALIB_FIX_ROLL:
        known |= {"tvec": tvec, "flags": DEFAULT_FLAGS | flags | F.CALIB_USE_EXTRINSIC_GUESS}
    return known


GIVEN = with_lens(CAMERA, 0.03)
INTRINSICS = F.CALIB_FIX_FOCAL_LENGTH | F.CALIB_FIX_PRINCIPAL_POINT | F.CALIB_FIX_K1
CONTRADICTED = {
    r"a focal length 1[5-8] % shorter": (F.CALIB_FIX_FOCAL_LENGTH, {"f": 1.2}),
    r"a focal length (2[3-9]|3[0-3]) % longer": (F.CALIB_FIX_FOCAL_LENGTH, {"f": 0.8}),
    "a principal point": (F.CALIB_FIX_FOCAL_LENGTH | F.CALIB_FIX_PRINCIPAL_POINT, {"c": (150.0, 0.0)}),
    "another lens": (INTRINSICS, {"lens": (-0.8, 0.0)}),
    "a position": (F.CALIB_FIX_POSITION, {"C": (0.0, 4.0, 0.0)}),
    "a roll": (F.CALIB_FIX_ROLL, {"angles": (0.0, 0.0, 0.05)}),
    "a pan": (F.CALIB_FIX_ROTATION, {"angles": (0.05, 0.0, 0.0)}),
}


def changed(camera, f=1.0, c=(0.0, 0.0), lens=(0.0, 0.0), C=(0.0, 0.0, 0.0), angles=(0.0, 0.0, 0.0)):
    K = np.diag([f, f, 1.0]) @ camera.K
    K[:2, 2] = camera.principal_point + c
    turned = Camera.from_angles(*(camera.angles + angles), 1.0, camera.C + C, SIZE)
    return Camera(K, turned.R, turned.C, SIZE, np.add(camera.dist.ravel()[:2], lens))


@pytest.mark.parametrize("words", CONTRADICTED)
def test_a_given_value_that_the_labels_contradict_is_named(words):
    flags, wrong = CONTRADICTED[words]
    frame, field = seen_with_noise(GIVEN, noise=0.3), soccer(size_known=True)
    right = calibrate_from_segments(field, frame, SIZE, **given(GIVEN, flags))
    assert right.verdict is Verdict.GOOD, right.reason
    found = calibrate_from_segments(field, frame, SIZE, **given(changed(GIVEN, **wrong), flags))
    assert found.verdict is not Verdict.GOOD
    assert re.search(f"the labels want {words}", found.reason), found.reason
    assert calibrate_from_segments(field, frame, SIZE).uncertainty.off_given == {}


def test_what_the_labels_want_is_what_they_give_once_the_value_is_freed():
    field = soccer(size_known=True).with_ground(Ground())
    wrong, frame = changed(GIVEN, f=1.02), seen_with_noise(GIVEN, noise=0.1)
    fixed = calibrate_from_segments(field, frame, SIZE, **given(wrong, INTRINSICS))
    freed = calibrate_from_segments(
        field, frame, SIZE, wrong.K, wrong.dist, flags=DEFAULT_FLAGS | (INTRINSICS & ~F.CALIB_FIX_FOCAL_LENGTH) | 1
    )
    offset, sigma = fixed.uncertainty.off_given["log f"]
    assert offset == pytest.approx(np.log(freed.camera.focal_length / wrong.focal_length), rel=0.1)
    of_freed = freed.std_deviations[0][0, 0] / freed.camera.focal_length
    assert sigma == pytest.approx(of_freed, rel=0.3)


def against(calibration):
    return {one.what for one in calibration.findings if one.what.is_against}


@pytest.mark.slow
def test_right_values_are_not_doubted_under_usual_noise():
    """Of 40 frames with 1.5 px noise and five kinds of values none is doubted that is good otherwise.

    On a pitch that is 3 m longer than thought, another size explains the labels, not a wrong focal length.
    """
    frames, truths = random_frames(40, seed=5, noise=1.5)
    kinds = F.CALIB_FIX_FOCAL_LENGTH, INTRINSICS, F.CALIB_FIX_POSITION, F.CALIB_FIX_ROTATION, F.CALIB_FIX_ROLL
    doubted = [
        flags
        for flags in kinds
        for frame, truth in zip(frames, truths, strict=True)
        if against(calibrate_from_segments(FIELD, frame, SIZE, **given(truth, flags))) == {What.CONTRADICTED}
    ]
    assert not doubted
    frame = seen_with_noise(GIVEN, field=soccer(108.0, 68.0))
    exact, open_size = (
        calibrate_from_segments(field, frame, SIZE, **given(GIVEN, F.CALIB_FIX_POSITION))
        for field in (soccer(size_known=True), FIELD)
    )
    assert "the labels want a position" in exact.reason
    assert "the labels want" not in open_size.reason


@pytest.mark.parametrize("fixed", [0, F.CALIB_FIX_FOCAL_LENGTH, F.CALIB_FIX_POSITION])
def test_a_batch_takes_an_initial_camera_of_each_frame(fixed):
    frames, truths = random_frames(6, seed=14, noise=1.0)
    cameras = [
        Camera.from_angles(*(truth.angles + 0.01), 1.02 * truth.focal_length, truth.C + 0.5, SIZE) for truth in truths
    ]
    guess = F.CALIB_USE_INTRINSIC_GUESS | F.CALIB_USE_EXTRINSIC_GUESS
    found = calibrate_batch(FIELD, frames, SIZE, cameras=cameras, flags=DEFAULT_FLAGS | fixed)
    for frame, camera, together in zip(frames, cameras, found, strict=True):
        rvec, tvec, K, dist = camera.to_opencv()
        alone = calibrate_from_segments(FIELD, frame, SIZE, K, dist, rvec, tvec, flags=DEFAULT_FLAGS | guess | fixed)
        assert relative_error(together.camera, alone.camera) < 1e-3
        if fixed == F.CALIB_FIX_FOCAL_LENGTH:
            assert together.camera.focal_length == pytest.approx(camera.focal_length, rel=1e-12)
        if fixed == F.CALIB_FIX_POSITION:
            np.testing.assert_allclose(together.camera.C, camera.C, rtol=1e-12)


@pytest.mark.parametrize("y", [1e10, 1e20, 1e100])
def test_an_absurd_initial_camera_does_not_end_the_others(y):
    far = Camera(CAMERA.K, CAMERA.R, (0.0, y, -17.0), SIZE)
    if y > 1e12:
        with pytest.raises(ValueError, match="frame 1: expected a camera within"):
            calibrate_batch(FIELD, [FRAME, FRAME], SIZE, cameras=[CAMERA, far])
    else:
        found = calibrate_batch(FIELD, [FRAME, FRAME], SIZE, cameras=[CAMERA, far])
        assert [bool(one) for one in found] == [True, False]


def test_initial_cameras_that_do_not_fit_the_frames():
    with pytest.raises(ValueError, match="expected cameras for each of 2 frames, got 1"):
        calibrate_batch(FIELD, [FRAME, FRAME], SIZE, cameras=[CAMERA])
    with pytest.raises(ValueError, match=r"frame 1: its camera is for images of 640 x 640; see Camera\.scaled"):
        calibrate_batch(FIELD, [FRAME, FRAME], SIZE, cameras=[CAMERA, CAMERA.scaled((640, 640))])
    with pytest.raises(ValueError, match="leave camera_matrix and dist_coeffs out"):
        calibrate_batch(FIELD, [FRAME], SIZE, CAMERA.K, cameras=[CAMERA])
    with pytest.raises(ValueError, match="frame 1: expected a Camera, got NoneType"):
        calibrate_batch(FIELD, [FRAME, FRAME], SIZE, cameras=[CAMERA, None])
    with pytest.raises(ValueError, match="expected cameras, one for each frame"):
        calibrate_batch(FIELD, [FRAME], SIZE, cameras=CAMERA)
    mirrored = Camera(CAMERA.K * (-1, 1, 1), CAMERA.R, CAMERA.C, SIZE, checked=False)
    with pytest.raises(ValueError, match="K must have positive focal lengths"):
        calibrate_batch(FIELD, [FRAME], SIZE, cameras=[mirrored])
    assert calibrate_batch(FIELD, [], SIZE, cameras=[]) == []


def test_a_result_is_a_camera_to_start_from_that_changes_nothing():
    frames, _ = random_frames(6, seed=15, noise=1.0)
    first = calibrate_batch(FIELD, frames, SIZE)
    again = calibrate_batch(FIELD, frames, SIZE, cameras=[c.camera for c in first])
    assert max(relative_error(a.camera, b.camera) for a, b in zip(again, first, strict=True)) < 1e-3


@pytest.mark.parametrize("what", [soccer, "soccer", {"a": ((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))}])
def test_what_is_no_field_is_refused(what):
    with pytest.raises(ValueError, match=r"did you mean soccer\(\)|got 'soccer'|'a': expected a Line"):
        calibrate_from_segments(what, FRAME, SIZE)


def test_what_is_fixed_stays():
    frame = observe(MARKINGS, CAMERA, np.random.default_rng(5), noise=1.0)
    rvec, tvec, K, _ = CAMERA.to_opencv()
    focal = calibrate_from_segments(FIELD, frame, SIZE, K, flags=DEFAULT_FLAGS | F.CALIB_FIX_FOCAL_LENGTH)
    assert focal.camera.focal_length == pytest.approx(1700.0, rel=1e-12)
    place = calibrate_from_segments(
        FIELD, frame, SIZE, None, None, rvec, tvec, flags=DEFAULT_FLAGS | F.CALIB_FIX_POSITION
    )
    np.testing.assert_allclose(place.camera.C, CAMERA.C, atol=1e-9)
    assert place.accepted
    level = calibrate_from_segments(FIELD, frame, SIZE, flags=DEFAULT_FLAGS | F.CALIB_FIX_ROLL)
    assert level.camera.angles[2] == pytest.approx(0.0, abs=1e-12)
    for found in (focal, place, level):
        assert relative_error(found.camera, CAMERA) < 0.05


def test_what_is_freed_is_found():
    K = np.array([[1700.0, 0.0, 495.0], [0.0, 1700.0, 262.0], [0.0, 0.0, 1.0]])
    wide = Camera.from_angles(-0.6, 1.3, 0.01, 620.0, (1.5, 48.0, -22.0), SIZE, (495.0, 262.0))  # posts in view
    lens = Camera(wide.K, wide.R, wide.C, SIZE, (0.06, 0.0))
    for truth, freed in (
        (wide, F.CALIB_FIX_PRINCIPAL_POINT),
        (lens, F.CALIB_FIX_PRINCIPAL_POINT | F.CALIB_FIX_K1 | F.CALIB_FIX_K2),
    ):
        frame = observe(MARKINGS, truth, per_line=6, per_curve=20)
        found = calibrate_from_segments(FIELD, frame, SIZE, flags=PINHOLE_FLAGS & ~freed, prior=None)
        assert relative_error(found.camera, truth) < 1e-5
        np.testing.assert_allclose(found.camera.principal_point, K[:2, 2], atol=1e-2)
        np.testing.assert_allclose(found.camera.k, truth.k, atol=1e-5)


def test_a_plane_cannot_tell_the_principal_point():
    frame = observe({label: s for label, s in MARKINGS.items() if "Goal" not in label}, CAMERA)
    found = calibrate_from_segments(FIELD, frame, SIZE, flags=PINHOLE_FLAGS & ~F.CALIB_FIX_PRINCIPAL_POINT, prior=None)
    assert found.status is Status.DEGENERATE  # eight numbers of a homography, nine of a camera
    assert "open" in found.message
    assert found.rms < 1e-3


def test_a_known_lens_is_used():
    lens = Camera(CAMERA.K, CAMERA.R, CAMERA.C, SIZE, (0.35, 0.0))
    frame = observe(MARKINGS, lens)
    flags = PINHOLE_FLAGS | F.CALIB_FIX_FOCAL_LENGTH
    with_lens = calibrate_from_segments(FIELD, frame, SIZE, CAMERA.K, [0.35, 0.0], flags=flags, prior=None)
    without = calibrate_from_segments(FIELD, frame, SIZE, CAMERA.K, flags=flags, prior=None)
    assert relative_error(with_lens.camera, lens) < 1e-6
    np.testing.assert_allclose(with_lens.camera.k, (0.35, 0.0), atol=1e-9)
    assert without.rms > 0.5


def test_the_kind_of_camera_can_be_named():
    behind = Camera.from_angles(np.radians(80), np.radians(72), 0.0, 800.0, (-75.0, -4.0, -14.0), SIZE)
    frame = observe(MARKINGS, behind)
    known = calibrate_from_segments(FIELD, frame, SIZE, prior="behind left goal")
    assert relative_error(known.camera, behind) < 0.02
    assert relative_error(calibrate_from_segments(FIELD, frame, SIZE, prior=None).camera, behind) < 1e-6


def test_labels_turned_by_half_a_turn_are_a_camera_on_the_opposite_stand():
    turned = {FIELD.symmetric[label]: xy for label, xy in FRAME.items()}
    found = calibrate_from_segments(FIELD, turned, SIZE, prior=None)
    np.testing.assert_allclose(found.camera.C, CAMERA.C * (-1.0, -1.0, 1.0), atol=1e-4)


def test_other_sizes_of_field():
    field = soccer(100.0, 64.0)
    frame = observe(whole_circle_markings(field), CAMERA)
    assert relative_error(calibrate_from_segments(field, frame, SIZE, prior=None).camera, CAMERA) < 1e-6


# --- the lens ---


@pytest.mark.parametrize("a1", [-0.04, 0.0, 0.03, 0.06])
def test_the_lens_is_found_by_default(a1):
    truth = with_lens(CAMERA, a1)
    found = calibrate_from_segments(FIELD, observe(MARKINGS, truth), SIZE, prior=None).camera
    assert relative_error(found, truth) < 1e-6
    assert found.corner_distortion[0] == pytest.approx(a1, abs=1e-6)


@pytest.mark.parametrize("flags", [DEFAULT_FLAGS, DEFAULT_FLAGS & ~CalibrationFlags.CALIB_FIX_K2])
def test_no_lens_folds_whatever_the_frame(flags):
    frames, _ = random_frames(20, seed=11, noise=2.0, least_segments=4)
    for calibration in calibrate_batch(FIELD, frames, SIZE, flags=flags):
        camera = calibration.camera
        assert camera.lens.is_monotone(np.array([1e3 * camera.half_diagonal, 0.0]), camera.lens_coefficients)
        assert abs(calibration.camera.corner_distortion).max() < 0.3


def test_a_second_coefficient_is_found_if_asked_for():
    a = np.array([0.02, 0.015])
    k = RadialLens(CAMERA.half_diagonal).to_opencv(a, CAMERA.focal_length)
    truth = Camera(CAMERA.K, CAMERA.R, CAMERA.C, SIZE, k)
    frame = observe(MARKINGS, truth, per_line=9, per_curve=20)
    flags = DEFAULT_FLAGS & ~CalibrationFlags.CALIB_FIX_K2
    found = calibrate_from_segments(FIELD, frame, SIZE, flags=flags, prior=None).camera
    np.testing.assert_allclose(found.corner_distortion, a, atol=1e-5)


def test_frames_that_do_not_tell_the_lens_say_so_and_stay_near_the_prior():
    middle = {label: xy for label, xy in observe(MARKINGS, CAMERA).items() if label in LITTLE_OF_THE_LENS}
    few = calibrate_from_segments(FIELD, middle, SIZE)
    assert "the lens is poorly determined by the labels" in few.message
    assert few.camera.corner_distortion[0] == pytest.approx(RADIAL_MEAN[0], abs=0.02)
    # a free principal point takes part of what a lens does to a narrow view
    flags = DEFAULT_FLAGS | F.CALIB_FIX_PRINCIPAL_POINT
    narrow = calibrate_from_segments(FIELD, observe(MARKINGS, CAMERA, per_line=9), SIZE, flags=flags)
    wide = Camera.from_angles(-0.6, 1.3, 0.01, 620.0, (1.5, 48.0, -22.0), SIZE)
    for many in (narrow, calibrate_from_segments(FIELD, observe(MARKINGS, wide, per_line=9), SIZE)):
        assert "lens" not in many.message


def test_a_lens_that_is_given_is_the_prior():
    """With few labels the camera keeps the lens that the user knows, not that of most broadcasts."""
    truth = with_lens(CAMERA, -0.1)
    frame = {label: xy for label, xy in observe(MARKINGS, truth).items() if label in LITTLE_OF_THE_LENS}
    flags = DEFAULT_FLAGS | CalibrationFlags.CALIB_USE_INTRINSIC_GUESS
    found = calibrate_from_segments(FIELD, frame, SIZE, truth.K, truth.k, flags=flags).camera
    assert found.corner_distortion[0] == pytest.approx(-0.1, abs=0.01)


# --- points of one's own ---


def test_points_of_ones_own_are_labels_like_others():
    """How they move with the size of the field is not known: it is taken as it is."""
    field = FIELD.with_segments({"corner flag": Point((-52.5, -34.0, -1.5))})
    frame = observe(MARKINGS, CAMERA)
    frame["corner flag"] = CAMERA.project([field["corner flag"].X])
    found = calibrate_from_segments(field, frame, SIZE, flags=PINHOLE_FLAGS)
    assert found.accepted
    assert found.per_segment_errors["corner flag"] < 0.5


# --- weights ---


def test_weights_say_what_counts():
    rng = np.random.default_rng(0)
    frame = observe(MARKINGS, CAMERA, rng, noise=0.5)
    wrong = {**frame, "Circle left": frame["Circle left"] + (12.0, 0.0)}
    trusted, doubted = (
        calibrate_from_segments(FIELD, wrong, SIZE, flags=PINHOLE_FLAGS, loss="linear", weights={"Circle left": w})
        for w in (1.0, 0.01)
    )
    assert relative_error(doubted.camera, CAMERA) < 0.3 * relative_error(trusted.camera, CAMERA)
    assert doubted.per_segment_errors["Circle left"] > 5.0  # errors are not weighted
    without = calibrate_from_segments(FIELD, {k: xy for k, xy in wrong.items() if k != "Circle left"}, SIZE)
    zero = calibrate_from_segments(FIELD, wrong, SIZE, weights={"Circle left": 0.0})
    assert zero.camera == without.camera


def test_weights_of_a_batch_are_those_of_its_frames():
    frames, _ = random_frames(3, seed=2, noise=0.5, stands=("main center",))
    weights = [{label: 0.2 + 0.3 * (i % 3) for i, label in enumerate(frame)} for frame in frames]
    alone = [calibrate_from_segments(FIELD, f, SIZE, weights=w) for f, w in zip(frames, weights, strict=True)]
    for one, many in zip(alone, calibrate_batch(FIELD, frames, SIZE, weights=weights), strict=True):
        np.testing.assert_allclose(many.camera.C, one.camera.C, atol=1e-2)
    with pytest.raises(ValueError, match="expected weights for each of 3 frames, got 2"):
        calibrate_batch(FIELD, frames, SIZE, weights=weights[:2])
    with pytest.raises(ValueError, match=r"^frame 1: "):
        calibrate_batch(FIELD, frames, SIZE, weights=[{}, {"Middle lin": 1.0}, {}])


def test_a_strong_barrel_is_found_although_broadcasts_have_none():
    """Eleven sigmas from the prior's mean: a quadratic prior would pull it to -0.194."""
    wide = with_lens(Camera.from_angles(-0.2, 1.3, 0.0, 700.0, (0.0, 60.0, -17.0), SIZE), -0.2)
    frame = observe(MARKINGS, wide, per_line=9, per_curve=20)
    for found in (calibrate_from_segments(FIELD, frame, SIZE), *calibrate_batch(FIELD, [frame], SIZE)):
        assert found.camera.corner_distortion[0] == pytest.approx(-0.2, abs=1e-3)
        assert relative_error(found.camera, wide) < 2e-3
