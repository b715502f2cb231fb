"""The whole flow: from labelled pixels to a camera."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from strategies import labelled_frames, numbers
from synthetic import observe, random_frames, whole_circle_markings

from fieldcalib import (
    Arc,
    Camera,
    CameraDistribution,
    Line,
    Point,
    PointCloud,
    Status,
    calibrate_batch,
    calibrate_from_segments,
    soccer,
)
from fieldcalib.calibrate.options import DEFAULT_FLAGS, PINHOLE_FLAGS, CalibrationFlags, checked_options
from fieldcalib.calibrate.search import _best, _without_lens
from fieldcalib.fields.stands import MAIN_CENTER
from fieldcalib.geometry.lens import RADIAL_MEAN, RadialLens
from fieldcalib.io.soccernet import parse_annotation
from fieldcalib.problem.evaluation import Problem, evaluate
from fieldcalib.problem.observations import pack
from fieldcalib.problem.prior import GaussianPrior, gaussian_prior

FIELD, SIZE = soccer(), (960, 540)
MARKINGS = whole_circle_markings(FIELD)
CAMERA = Camera.from_angles(-0.35, 1.36, 0.01, 1700.0, (1.5, 68.0, -17.0), SIZE)
LITTLE_OF_THE_LENS = ("Side line top", "Side line left", "Big rect. left top", "Circle left")
FRAME = observe(MARKINGS, CAMERA)
F = CalibrationFlags


def relative_error(camera, truth):
    """The largest of the relative errors of focal length and position and of the rotation."""
    return max(
        abs(camera.focal_length / truth.focal_length - 1.0),
        np.linalg.norm(camera.C - truth.C) / np.linalg.norm(truth.C),
        np.linalg.norm(camera.R - truth.R),
    )


@pytest.mark.slow
def test_frames_without_noise_give_back_their_cameras():
    """Five or more segments, from every distribution, no prior in the final solve: 99 % to 1e-6."""
    frames, cameras = random_frames(50, seed=11)
    errors = []
    for frame, truth in zip(frames, cameras, strict=True):
        camera = calibrate_from_segments(FIELD, frame, SIZE, prior=None).camera
        errors.append(relative_error(camera, truth))
    assert np.mean(np.array(errors) < 1e-6) >= 0.99, sorted(errors)[-3:]


@pytest.mark.slow
def test_a_batch_of_them_too():
    frames, cameras = random_frames(400, seed=12)
    found = calibrate_batch(FIELD, frames, SIZE, prior=None)
    errors = [relative_error(c.camera, truth) for c, truth in zip(found, cameras, strict=True)]
    assert np.mean(np.array(errors) < 1e-6) >= 0.99, sorted(errors)[-8:]


def test_one_frame_and_a_batch_agree():
    frames, _ = random_frames(40, seed=13, noise=1.0, stands=("main center", "main left"))
    for together, frame in zip(calibrate_batch(FIELD, frames, SIZE), frames, strict=True):
        alone = calibrate_from_segments(FIELD, frame, SIZE)
        assert alone.status is together.status
        assert alone.rms == pytest.approx(together.rms, rel=1e-3)
        assert relative_error(alone.camera, together.camera) < 1e-3
        assert alone.loss_ndc == pytest.approx(together.loss_ndc, rel=1e-2)
        assert list(alone.per_segment_errors) == list(frame)


def test_twice_is_the_same():
    frames, _ = random_frames(5, seed=14, noise=1.0)
    first, second = (calibrate_batch(FIELD, frames, SIZE) for _ in range(2))
    assert [c.camera for c in first] == [c.camera for c in second]
    assert calibrate_from_segments(FIELD, frames[0], SIZE) == calibrate_from_segments(FIELD, frames[0], SIZE)


# Frames as annotators leave them: most of what the camera sees, some pixels off.
frames_of_the_camera = labelled_frames(FRAME, numbers(0.0, 3.0), least=6)


@settings(max_examples=15)
@given(data=st.data(), frame=frames_of_the_camera)
def test_the_order_of_labels_and_pixels_does_not_matter(data, frame):
    labels = data.draw(st.permutations(list(frame)))
    shuffled = {label: np.array(data.draw(st.permutations(frame[label].tolist()))) for label in labels}
    one, other = calibrate_batch(FIELD, [frame, shuffled], SIZE)
    assert relative_error(one.camera, other.camera) < 1e-5


@settings(max_examples=15)
@given(frame=frames_of_the_camera, factor=st.sampled_from([2, 3]))
def test_an_enlarged_frame_has_the_same_camera(frame, factor):
    enlarged = {label: factor * xy for label, xy in frame.items()}
    size = (factor * SIZE[0], factor * SIZE[1])
    small, large = (calibrate_from_segments(FIELD, f, s) for f, s in ((frame, SIZE), (enlarged, size)))
    assert relative_error(large.camera, small.camera.scaled(size)) < 1e-5
    assert large.rms == pytest.approx(factor * small.rms, rel=1e-4)


@settings(max_examples=15)
@given(frame=frames_of_the_camera)
def test_a_mirrored_frame_has_the_mirrored_camera(frame):
    """Left and right exchanged, in the image and in the labels."""
    swap = str.maketrans({"<": "right", ">": "left"})
    mirrored = {}
    for label, xy in frame.items():
        name = label.replace("left", "<").replace("right", ">").translate(swap)
        mirrored[name] = (SIZE[0] - xy[:, 0])[:, None] * (1.0, 0.0) + xy * (0.0, 1.0)
    one, other = calibrate_batch(FIELD, [frame, mirrored], SIZE)
    assert other.camera.focal_length == pytest.approx(one.camera.focal_length, rel=1e-4)
    np.testing.assert_allclose(other.camera.C, one.camera.C * (-1.0, 1.0, 1.0), atol=0.01)


def test_noise_moves_the_camera_little():
    errors = []
    for seed in range(20):
        frame = observe(MARKINGS, CAMERA, np.random.default_rng(seed), noise=1.0)
        found = calibrate_from_segments(FIELD, frame, SIZE, flags=PINHOLE_FLAGS)
        errors.append(found.camera.focal_length / CAMERA.focal_length - 1.0)
    assert np.median(np.abs(errors)) < 0.01


def test_a_wrong_label_among_many_hardly_moves_the_camera():
    frame = observe(MARKINGS, CAMERA, np.random.default_rng(0), noise=0.5)
    wrong = {**frame, "Small rect. left top": frame["Big rect. left top"]}
    found = calibrate_from_segments(FIELD, wrong, SIZE)
    assert relative_error(found.camera, CAMERA) < 0.03
    assert max(found.per_segment_errors, key=found.per_segment_errors.get) == "Small rect. left top"


def test_a_camera_below_the_ground_does_not_win():
    """Seen from below, a plane without posts looks the same: the start below must lose although it fits as well."""
    flat = {label: xy for label, xy in FRAME.items() if "Goal" not in label}
    found = calibrate_from_segments(FIELD, flat, SIZE, prior=None)
    assert found.accepted
    assert found.camera.C[2] < 0.0


def test_a_plausible_start_goes_before_a_cheaper_one_below_the_ground():
    """Lines on a plane have the same image for the camera mirrored in it, which would look at them from behind."""
    how = {"flags": DEFAULT_FLAGS, "criteria": (3, 50, 1e-9), "prior": "all", "loss": "cauchy", "tau": None}
    options = checked_options(SIZE, None, None, None, None, field=FIELD, **how)
    theta = options.layout.theta(CAMERA)
    below = Camera(CAMERA.K, CAMERA.R @ np.diag([-1.0, -1.0, 1.0]), CAMERA.C * (1.0, 1.0, -1.0), SIZE)
    flat = {label: xy for label, xy in FRAME.items() if "Goal" not in label and "Circle" not in label}
    observations = pack(FIELD, [flat], SIZE)
    pair = np.array([theta, options.layout.theta(below)])
    sigma = np.tile(gaussian_prior(MAIN_CENTER, options.layout).sigma, (2, 1))
    prior = GaussianPrior(pair - np.array([[0.5], [0.0]]) * sigma, sigma)  # the one below is cheaper by its prior
    frame = np.array([0, 0])
    wide = Problem(observations.take(frame), _without_lens(options), options.wide_loss, options.noise, prior)
    evaluation = evaluate(wide, pair)
    above, cheaper = evaluation.cost
    assert cheaper < above
    (best,) = _best(evaluation, frame, 1, options)
    np.testing.assert_array_equal(evaluation.theta[best], pair[0])


def test_densely_labelled_frames_are_solved_a_few_at_a_time():
    from fieldcalib.calibrate.from_segments import CHUNK, CHUNK_PIXELS, _chunks

    frames = [{"Middle line": np.zeros((count, 2))} for count in [0, 3, 100, 5000, 20000, *[30] * 200]]
    chunks = list(_chunks(FIELD, frames))
    assert sorted(np.concatenate(chunks).tolist()) == list(range(1, len(frames)))
    for chunk in chunks:
        assert len(chunk) <= CHUNK
        largest = max(len(frames[t]["Middle line"]) for t in chunk)
        assert len(chunk) == 1 or len(chunk) * largest <= CHUNK_PIXELS


def test_an_object_that_is_no_field_needs_to_say_where_its_camera_stands():
    line = {"edge": Line((0.0, 0.0, 0.0), (1.0, 0.0, 0.0))}
    with pytest.raises(ValueError, match="the object is not a Field: say where its camera may stand by prior"):
        calibrate_from_segments(line, {"edge": [(1, 2), (300, 4)]}, SIZE)


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


def test_nothing_to_unpack_is_an_error_that_says_why():
    with pytest.raises(ValueError, match="no camera to unpack: no labelled pixels"):
        list(calibrate_from_segments(FIELD, {}, SIZE))


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
    assert found.camera is not None


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
    assert found.camera is not None


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


# --- what is known, and from where ---


def test_a_guess_is_enough_to_start_from():
    rvec, tvec, K, _ = CAMERA.to_opencv()
    guess = F.CALIB_USE_INTRINSIC_GUESS | F.CALIB_USE_EXTRINSIC_GUESS
    near = K * [[1.02, 1.0, 1.0], [1.0, 1.02, 1.0], [1.0, 1.0, 1.0]]
    flags = DEFAULT_FLAGS | F.CALIB_FIX_PRINCIPAL_POINT | guess  # these few labels do not tell it
    found = calibrate_from_segments(FIELD, FRAME, SIZE, near, None, rvec + 0.01, tvec + 0.5, flags=flags, prior=None)
    assert relative_error(found.camera, CAMERA) < 1e-6


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


# --- objects that are no field ---


def test_a_table_can_be_calibrated_against():
    """A round table 1.2 m wide with a tray, a pole and a scratch: lines, a circle, points, clouds, in metres."""
    s = np.linspace(0.0, 1.0, 40)
    table = {
        "edge": Arc((0.0, 0.0, -0.75), 0.6),
        "tray front": Line((-0.25, 0.15, -0.75), (0.25, 0.15, -0.75)),
        "tray left": Line((-0.25, 0.15, -0.75), (-0.25, -0.2, -0.75)),
        "pole": Line((0.3, -0.1, -0.75), (0.3, -0.1, -1.6)),
        "screw": Point((0.1, -0.05, -0.75)),
        "scratch": PointCloud(np.stack([0.5 * s - 0.3, 0.3 * s**2 - 0.4, 0.0 * s - 0.75], axis=1), ordered=True),
        "crumbs": PointCloud([(-0.1, 0.0, -0.75), (-0.15, 0.05, -0.75), (0.0, 0.3, -0.75)]),
    }
    camera = Camera.from_angles(0.2, 1.15, 0.03, 1200.0, (-0.5, 2.2, -1.9), (1280, 720))
    frame = observe({label: table[label] for label in ("edge", "tray front", "tray left", "pole")}, camera)
    frame |= {label: camera.project(table[label].sample()) for label in ("screw", "scratch", "crumbs")}
    room = CameraDistribution("in the room", (-40, 40), (45, 90), (-10, 10), (30, 90), (-2, 2), (1, 4), (-2.5, -1))
    found = calibrate_from_segments(table, frame, (1280, 720), prior=room)
    assert found.accepted, found.message
    assert relative_error(found.camera, camera) < 1e-2
    rvec, tvec, K, _ = found.camera.to_opencv()
    guess = F.CALIB_USE_INTRINSIC_GUESS | F.CALIB_USE_EXTRINSIC_GUESS
    exact = calibrate_from_segments(
        table, frame, (1280, 720), K, None, rvec, tvec, flags=DEFAULT_FLAGS | guess, prior=None
    )
    assert relative_error(exact.camera, camera) < 1e-6


def test_field_points_can_be_labelled_by_name():
    names = [name for name, xy in ((n, CAMERA.project(p.X)) for n, p in FIELD.points.items()) if 0 < xy[0] < 960]
    points = {name: CAMERA.project(FIELD[name].X)[None] for name in names}
    inside = {name: xy for name, xy in points.items() if 0 < xy[0, 1] < 540}
    assert len(inside) >= 6
    assert relative_error(calibrate_from_segments(FIELD, inside, SIZE, prior=None).camera, CAMERA) < 1e-6


# --- real annotations ---


@pytest.mark.parametrize(
    ("folder", "size", "median_rms", "below_tau"),
    [("sncalib-test-center", (960, 540), 1.6, 0.94), ("wc14-test", (1280, 720), 1.9, 0.99)],
)
def test_real_annotations(shared_data, folder, size, median_rms, below_tau):
    files = sorted(f for f in (shared_data / folder).glob("*.json") if f.stem.isdigit())
    frames = [parse_annotation(f.read_text(), size) for f in files]
    found = calibrate_batch(FIELD, frames, size)
    assert all(c.camera is not None for c in found)
    assert np.median([c.rms for c in found]) < median_rms
    assert np.mean([c.loss_ndc < 0.019 for c in found]) > below_tau
    assert np.mean([c.accepted for c in found]) > 0.98
    # the main stand's camera stands above ground near the middle line's extension, wherever it looks
    C = np.array([c.camera.C for c in found])
    assert np.mean((np.abs(C[:, 0]) < 20.0) & (C[:, 1] > 30.0) & (C[:, 2] < -3.0)) > 0.95


# --- the lens ---


def with_lens(camera, a1):
    """The same camera with a lens that moves the corner by a1."""
    k = RadialLens(camera.half_diagonal).to_opencv(np.array([a1, 0.0]), camera.focal_length)
    return Camera(camera.K, camera.R, camera.C, camera.image_size, k)


@pytest.mark.parametrize("a1", [-0.04, 0.0, 0.03, 0.06])
def test_the_lens_is_found_by_default(a1):
    truth = with_lens(CAMERA, a1)
    found = calibrate_from_segments(FIELD, observe(MARKINGS, truth), SIZE, prior=None).camera
    assert relative_error(found, truth) < 1e-6
    assert found.corner_distortion[0] == pytest.approx(a1, abs=1e-6)


@pytest.mark.parametrize("flags", [DEFAULT_FLAGS, DEFAULT_FLAGS & ~CalibrationFlags.CALIB_FIX_K2])
def test_no_lens_folds_whatever_the_frame(flags):
    frames, _ = random_frames(40, seed=11, noise=2.0, least_segments=4)
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
    assert one.covariance.shape == (14, 14)  # length and width of the field, which are considered, come last
    error = one.field_uncertainty([[480.0, 300.0], [480.0, -2000.0]])
    assert 0.0 < error.rms[0] < 1.0
    assert np.isnan(error.rms[1])  # above the horizon
    assert len(one.observability) == 10  # what is free: pose and zoom, principal point, k1
    assert one == calibrate_from_segments(FIELD, frame, SIZE)  # whatever has been asked of them


def test_more_noise_makes_less_certain():
    noisy = [
        calibrate_from_segments(FIELD, observe(MARKINGS, CAMERA, np.random.default_rng(1), noise=noise), SIZE)
        for noise in (0.3, 3.0)
    ]
    sharp, blurred = (float(c.field_uncertainty([480.0, 300.0]).rms) for c in noisy)
    assert blurred > 2.0 * sharp


def test_cameras_that_were_not_fitted_know_no_errors():
    (empty,) = calibrate_batch(FIELD, [{}], SIZE)
    with pytest.raises(ValueError, match="expected a calibration from labelled pixels"):
        _ = empty.uncertainty


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
        assert f"{given!r} lies" in found.message
        assert list(found.per_segment_errors) == list(lying)  # as given
        assert relative_error(found.camera, clean.camera) < 1e-3
    assert clean.suspect_labels == ()


def test_clean_frames_are_not_accused():
    frames, _ = random_frames(60, seed=9, noise=1.0, least_segments=5)
    assert [c.suspect_labels for c in calibrate_batch(FIELD, frames, SIZE)] == [()] * 60
