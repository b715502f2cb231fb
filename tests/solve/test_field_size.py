"""The size of the pitch: derivatives, recovery, what the labels do not say, coverage of the truth."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from numdiff import central_differences, column_errors
from strategies import angle, cameras, examples, numbers, vectors
from synthetic import displaced, in_image, observe, random_frames, whole_circle_markings

from fieldcalib.assess.label_errors import Noise
from fieldcalib.fields.ground import Ground
from fieldcalib.fields.segments import Point
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.geometry.camera import Camera
from fieldcalib.problem.evaluation import Problem, evaluate
from fieldcalib.problem.layout import Layout, Role, SizeBlock, theta_from_camera
from fieldcalib.problem.losses import RobustLoss
from fieldcalib.problem.observations import pack
from fieldcalib.solve.field_size import SILENT, _joint, _uncertainty, estimate_field_size
from fieldcalib.solve.from_segments import calibrate_from_segments
from fieldcalib.solve.solver_options import PINHOLE_FLAGS

SIZE = (960, 540)
MEAN, SIGMA = np.array([105.0, 68.0]), soccer().size_model.sigma
MIDDLE = ("Middle line", "Circle central", "Side line top")
PANS = (-0.6, -0.2, 0.2, 0.6)


def panned(pitch, pans=PANS, rng=None, noise=0.0, k1=0.0, per_line=3):
    """Frames of a camera on the main stand that sees a lot of a pitch at every pan."""
    frames = []
    for pan in pans:
        camera = Camera.from_angles(pan, 1.35, 0.01, 900.0, (2.0, 68.0, -17.0), SIZE, k=(k1, 0.0))
        frames.append(observe(whole_circle_markings(pitch), camera, rng, noise, per_line))
    return frames


def pitch_and_frames(rng, count, noise):
    """A pitch from the prior and what random cameras on the main stand, with lenses, see of it."""
    truth = np.clip(MEAN + SIGMA * rng.normal(size=2), *soccer().size_model.limits)
    frames, _ = random_frames(count, rng, noise, stands=("main center",), a1=(0.025, 0.02), field=soccer(*truth))
    return truth, frames


def size_of(found):
    return np.array([found.length, found.width])


# derivatives


sizes = vectors((95.0, 55.0), (115.0, 80.0))


@given(cameras(), sizes, numbers(0.0, 6.0), angle(np.pi))
def test_derivative_by_the_size_is_that_of_central_differences(camera, size, distance, direction):
    """Lines, circles and points, pixels beside them."""
    theta, image_size, pitch = theta_from_camera(camera), camera.image_size, soccer(*size)
    frame = observe(pitch.markings, camera)
    points = {name: camera.project(point.sample()) for name, point in pitch.points.items()}
    frame |= {name: xy for name, xy in points.items() if in_image(xy, image_size).all()}
    frame = displaced(frame, distance, direction)
    assume(frame)

    def packed(size):
        return pack(soccer(*size), [frame], image_size)

    given = SizeBlock(size, SIGMA, pitch.size_model.limits)
    layout = Layout.of(image_size, field_size=given)
    problem = Problem(pack(pitch, [frame], image_size, motion=pitch.motion), layout, RobustLoss("cauchy", 6.0))
    JT = evaluate(problem, np.append(theta, size)[None]).derivatives(np.isin(layout.names, ["length", "width"]))

    def residuals(size):
        alone = Problem(packed(size), Layout.of(image_size), RobustLoss("cauchy", 6.0))
        return evaluate(alone, theta[None]).r[0]

    numeric = central_differences(residuals, size, 1e-3)
    assert column_errors(JT[0].T, numeric, floor=1.0).max() < 1e-5  # 1e-6 where the focal length is 6000 px


def test_the_covariance_is_the_sandwich_of_a_camera_and_the_size_together():
    """Without the size it would be the camera's own."""
    rng = np.random.default_rng(3)
    (frame,) = panned(soccer(), PANS[:1], rng, noise=3.0, per_line=5)
    frame = {label: xy[1:-1] for label, xy in frame.items()}  # none past the end of its segment
    calibration = calibrate_from_segments(soccer(size_known=True).with_ground(Ground()), frame, SIZE)
    known, sizes = calibration.uncertainty, soccer().size_model
    size_prior = SizeBlock(MEAN, sizes.sigma, sizes.limits)
    together = _joint([calibration], size_prior, Role.CONSIDERED)
    assert not together.problem.observations.ends
    free = calibration.solved.evaluation.problem.free
    P = np.count_nonzero(free)
    np.testing.assert_array_equal(np.flatnonzero(together.problem.layout.shared), [P, P + 1])
    np.testing.assert_allclose(together.prior.sigma[0, P:], SIGMA)

    prior = np.diag(1.0 / np.square(together.prior.effective_sigma[0]))
    noise = Noise(together)
    A = known.curvature * together.information[0] + prior
    V = known.robust_sigma**2 * noise.covariance(together.JT)[0] + prior
    sandwich = np.linalg.solve(A, np.linalg.solve(A, V).T)
    covariance, share, _ = _uncertainty([calibration], together, size_prior)
    np.testing.assert_allclose(covariance, sandwich[P:, P:], rtol=1e-6)
    np.testing.assert_allclose(share, 1.0 - np.diagonal(np.linalg.inv(A))[P:] / SIGMA**2, rtol=1e-6)
    A, V = A[:P, :P], V[:P, :P]
    np.testing.assert_allclose(
        np.linalg.solve(A, np.linalg.solve(A, V).T), known.covariance[np.ix_(free, free)], rtol=1e-3
    )


# what the labels determine


@examples(8)
@given(vectors((97.0, 60.0), (113.0, 76.0)))
def test_without_noise_only_the_prior_keeps_the_estimate_from_the_truth(truth):
    """It goes the share of the way from the prior's mean to the truth that comes from the labels."""
    frames = panned(soccer(*truth))
    found = estimate_field_size(soccer(), frames, SIZE, flags=PINHOLE_FLAGS, prior=None)
    assert np.all(found.from_labels > 0.97)
    np.testing.assert_allclose(size_of(found), truth, atol=0.3)
    way = MEAN + found.from_labels * (truth - MEAN)
    np.testing.assert_allclose(size_of(found), way, atol=0.012 * np.abs(truth - MEAN).max() + 2e-3)
    assert all(calibration.accepted for calibration in found.calibrations)
    assert max(calibration.rms for calibration in found.calibrations) < 0.4


def test_calibrations_are_on_the_field_that_was_found():
    (frame,) = panned(soccer(100.0, 65.0), PANS[:1])
    found = estimate_field_size(soccer(), [frame], SIZE)
    (calibration,) = found.calibrations
    again = calibrate_from_segments(soccer(found.length, found.width), frame, SIZE)
    assert dict(found.field) == dict(soccer(found.length, found.width))
    np.testing.assert_allclose(calibration.camera.C, again.camera.C, atol=1e-3)
    fixed = calibrate_from_segments(soccer(), frame, SIZE)
    assert calibration.rms < 0.3 * fixed.rms
    off, fixed_off = (np.linalg.norm(one.camera.C - (2.0, 68.0, -17.0)) for one in (calibration, fixed))
    assert off < fixed_off


def test_errors_have_those_of_the_size():
    """One end says nothing of the length: places from the centre mark are unknown by half of it."""
    pitch = soccer()
    (frame,) = panned(pitch, (-0.75,))
    end = {label: xy for label, xy in frame.items() if "left" in label}
    (found,) = estimate_field_size(soccer(), [end], SIZE).calibrations
    (known,) = estimate_field_size(soccer(size_known=True), [end], SIZE).calibrations
    xy = end["Big rect. left main"].mean(axis=0)
    sd, sd_known = (
        np.sqrt(one.field_uncertainty(xy, relative_to="centre mark").covariance[..., 0, 0]) for one in (found, known)
    )
    assert sd > 0.45 * SIGMA[0] > 3.0 * sd_known
    relative, of_known = (np.sqrt(one.field_uncertainty(xy).covariance[..., 0, 0]) for one in (found, known))
    assert relative < 2.0 * of_known < 0.5
    assert found.probability() <= known.probability() + 1e-9
    np.testing.assert_array_equal(found.camera.C, known.camera.C)


def test_the_middle_says_nothing_about_the_length():
    frame = {label: xy for label, xy in panned(soccer(110.0, 64.0), (0.05,))[0].items() if label in MIDDLE}
    assert len(frame) == 3
    found = estimate_field_size(soccer(), [frame], SIZE, flags=PINHOLE_FLAGS)
    assert found.length == pytest.approx(105.0, abs=1e-9)
    assert found.from_labels[0] == pytest.approx(0.0, abs=1e-9)
    assert found.std_deviations[0] == pytest.approx(SIGMA[0])
    np.testing.assert_allclose(found.interval[:, 0], (100.0, 110.0), atol=1e-3)
    assert str(found).startswith("length: the labels say nothing, 105.0 ± 2.6 m is from the prior; width: ")
    assert found.from_labels[1] > SILENT
    assert "m mostly from the prior (11 % from the labels)" in str(found)
    assert found.width < 68.0


def test_many_frames_of_one_half_say_no_more_about_the_length_than_one():
    """What they have in common is the prior of where the camera stands; the width they do tell."""
    rng = np.random.default_rng(2)
    frames = panned(soccer(100.0, 65.0), (0.5, 0.55, 0.6, 0.65) * 5, rng, noise=0.5)
    half = [{label: xy for label, xy in frame.items() if "right" in label or "Side" in label} for frame in frames]
    one, many = (estimate_field_size(soccer(), part, SIZE) for part in (half[:1], half))
    assert all(found.from_labels[0] < 0.05 and found.std_deviations[0] > 2.4 for found in (one, many))
    assert many.width == pytest.approx(65.0, abs=0.3)
    assert many.std_deviations[1] < 0.5 * one.std_deviations[1]
    assert "width: " in str(many)
    assert "m from the labels" in str(many)


def test_more_frames_narrow_it():
    rng = np.random.default_rng(4)
    frames = panned(soccer(102.0, 70.0), np.linspace(-0.7, 0.7, 16), rng, noise=1.0, k1=0.05)
    found = [estimate_field_size(soccer(), frames[8 - n : 8 + n], SIZE) for n in (1, 3, 8)]
    deviations = np.array([one.std_deviations for one in found])
    assert np.all(np.diff(deviations, axis=0) < 0.0)
    assert np.all(deviations[2] < 0.5 * deviations[0])
    assert np.all(np.diff([one.from_labels for one in found], axis=0) > 0.0)
    np.testing.assert_allclose(size_of(found[2]), (102.0, 70.0), atol=0.3)


@pytest.mark.slow
@pytest.mark.parametrize(("count", "pitches"), [(1, 30), (10, 8)])
def test_intervals_hold_the_truth(count, pitches):
    rng = np.random.default_rng(5)
    holds, errors = [], []
    for _ in range(pitches):
        truth, frames = pitch_and_frames(rng, count, 1.0)
        found = estimate_field_size(soccer(), frames, SIZE)
        low, high = found.interval
        holds.append((low <= truth) & (truth <= high))
        errors.append((size_of(found) - truth) / found.std_deviations)
    assert 0.90 <= np.mean(holds) <= 1.0
    assert 0.75 <= np.sqrt(np.mean(np.square(errors))) <= 1.25  # too wide intervals would hold everything


# pitches that are far from what was expected


@pytest.fixture(scope="module")
def of_a_small_pitch():
    """Frames of many labels of a pitch of 94 x 58 m."""
    return random_frames(26, 2, 0.5, least_segments=7, stands=("main center",), field=soccer(94.0, 58.0))[0]


def test_labels_that_seemed_to_lie_fit_the_pitch_that_was_found(of_a_small_pitch):
    frame = of_a_small_pitch[18]
    assert calibrate_from_segments(soccer(), frame, SIZE).suspect_labels
    found = estimate_field_size(soccer(), [frame], SIZE)
    assert not found.calibrations[0].suspect_labels
    np.testing.assert_allclose(size_of(found), (94.0, 58.0), atol=1.0)


def test_a_frame_that_no_camera_explains_on_the_expected_pitch(of_a_small_pitch):
    found = estimate_field_size(soccer(), [of_a_small_pitch[25]], SIZE)
    np.testing.assert_allclose(size_of(found), (94.0, 58.0), atol=1.0)
    assert found.calibrations[0].accepted


def test_the_law_limits_the_estimate():
    found = estimate_field_size(soccer(), panned(soccer(88.0, 60.0)), SIZE)
    assert found.length == 90.0
    assert found.width == pytest.approx(60.0, abs=1.0)
    assert found.interval[0, 0] == 90.0


# no estimate, no field


@pytest.mark.parametrize("frames", [[], [{}], [{"Middle line": [(480.0, 100.0), (470.0, 500.0)]}]])
def test_without_a_camera_there_is_the_prior(frames):
    found = estimate_field_size(soccer(103.0, 66.0), frames, SIZE)
    assert (found.length, found.width) == (103.0, 66.0)
    np.testing.assert_allclose(found.from_labels, 0.0, atol=1e-12)
    np.testing.assert_allclose(found.covariance, np.diag(SIGMA**2))
    np.testing.assert_allclose(found.interval, ((98.0, 60.5), (108.0, 71.5)), atol=1e-3)
    assert len(found.calibrations) == len(frames)


def test_frames_that_are_not_accepted_do_not_move_the_prior():
    """Labels at random places, to which a larger or smaller pitch would fit a little better."""
    rng = np.random.default_rng(0)
    labels = list(panned(soccer(), PANS[:1])[0])[:8]
    frame = {label: rng.uniform((0.0, 0.0), SIZE, size=(3, 2)) for label in labels}
    found = estimate_field_size(soccer(), [frame], SIZE)
    assert not found.calibrations[0].accepted
    assert (found.length, found.width) == (105.0, 68.0)
    np.testing.assert_allclose(found.covariance, np.diag(SIGMA**2))


@pytest.mark.parametrize(
    ("field", "message"),
    [
        (soccer(85.0, 60.0), r"90 to 120 x 45 to 90 m \(law 1\).*got 85 x 60"),
        (soccer(100.0, 91.0), "got 100 x 91"),
        (soccer().with_segments({"corner flag": Point((-52.5, -34.0, -1.5))}), "how other segments move is not known"),
        (dict(soccer()), "expected a field as soccer"),
        (replace(soccer(), length=100.0), "expected a field as soccer"),
    ],
)
def test_what_is_no_pitch_is_refused(field, message):
    with pytest.raises(ValueError, match=message):
        estimate_field_size(field, [], SIZE)


def test_frames_are_checked():
    with pytest.raises(ValueError, match="frame 1: unknown label 'Midle line'; did you mean 'Middle line'"):
        estimate_field_size(soccer(), [{}, {"Midle line": [(480.0, 100.0)]}], SIZE)
