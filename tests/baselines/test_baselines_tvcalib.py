"""The paper's method: its loss against `ndc_loss`, its gradient and its optimiser, and that it finds cameras."""

from math import cos, pi, sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numdiff import central_differences, column_errors
from strategies import bounded, cameras, labelled_frames, numbers, thetas, vectors
from synthetic import observe, random_frames, whole_circle_markings

from baselines.adamw import minimise, one_cycle
from baselines.tvcalib import CHUNK, DISTRIBUTIONS, FOV, calibrate, loss_with_gradient, pack_tensors, theta_from_phi
from fieldcalib.assess.findings import Status
from fieldcalib.assess.ndc import ndc_loss
from fieldcalib.fields.segments import Point, PointCloud
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.io.soccernet import parse_annotation
from fieldcalib.problem.labelled_pixels import check_segments
from fieldcalib.problem.layout import ANGLES, CENTER, LOG_F, PAN, camera_from_theta, theta_from_camera

FIELD = soccer()
MARKINGS = whole_circle_markings(FIELD)
SIZE = (960, 540)
MAIN = ("main center", "main left", "main right")


def phi_of(theta, image_size):
    """(pan, tilt, roll, field of view, x, y, z) of a theta without lens."""
    phi = np.empty(7)
    phi[ANGLES], phi[CENTER] = theta[ANGLES], theta[CENTER]
    phi[FOV] = 2.0 * np.arctan(0.5 * image_size[0] / np.exp(theta[LOG_F]))
    return phi


def problem(seed, count=3, noise=8.0, per_line=3, per_curve=8):
    """`count` main cameras, phi (count, 7), and frames that do not quite fit them."""
    rng = np.random.default_rng(seed)
    _, found = random_frames(count, rng, stands=MAIN)
    frames = [observe(MARKINGS, camera, rng, noise, per_line, per_curve) for camera in found]
    return np.array([phi_of(theta_from_camera(camera), SIZE) for camera in found]), frames


@st.composite
def problems(draw, image_sizes):
    """Main cameras, phi (T, 7), frames that do not fit them, and the size of their images.

    No pixel lies on its segment, where the loss has a kink that central differences do not see.
    """
    image_size = draw(st.sampled_from(image_sizes))
    found = draw(st.lists(cameras(False, MAIN, (image_size,)), min_size=1, max_size=3))
    seen = [observe(MARKINGS, camera, per_curve=8) for camera in found]
    frames = [draw(labelled_frames(frame, numbers(1.0, 20.0))) for frame in seen]
    return np.array([phi_of(theta_from_camera(camera), image_size) for camera in found]), frames, image_size


# --- the loss ---


def inside(frame, image_size):
    """The frame with the pixels in the image alone."""
    kept = {label: xy[np.all((xy > 0.0) & (xy < image_size), axis=1)] for label, xy in frame.items()}
    return {label: xy for label, xy in kept.items() if len(xy)}


@given(drawn=problems([(960, 540), (1280, 720), (640, 640)]))
def test_the_loss_is_the_papers(drawn):
    phi, frames, image_size = drawn
    frames = [inside(frame, image_size) for frame in frames]
    phi[:, PAN] = np.clip(phi[:, PAN], -1.0, 1.0)  # ndc_loss splits the circle only where the camera sees halves
    loss, _ = loss_with_gradient(phi, pack_tensors(FIELD, frames, image_size))
    cameras = [camera_from_theta(theta, image_size) for theta in theta_from_phi(phi, image_size)]
    expected = ndc_loss(cameras, FIELD, frames)
    np.testing.assert_allclose(loss, expected, rtol=1e-9, atol=1e-12)


def test_points_and_clouds_count_with_the_circles():
    (phi, *_), _ = problem(0)
    objects = {**FIELD, "balls": PointCloud([(-10.0, 5.0, -0.1), (0.0, 0.0, -0.1), (20.0, -5.0, -0.1)])}
    objects["flag"] = Point((0.0, -34.0, -1.5))
    camera = camera_from_theta(theta_from_phi(phi[None], SIZE)[0], SIZE)
    frame = {label: camera.project(objects[label].sample(30.0)) + 5.0 for label in ("balls", "flag", "Circle left")}
    frame = inside(frame, SIZE)
    assert len(frame) > 1
    loss, _ = loss_with_gradient(phi[None], pack_tensors(objects, [frame], SIZE))
    expected = ndc_loss([camera], objects, [frame])
    np.testing.assert_allclose(loss, expected, rtol=1e-9)


def test_pixels_outside_the_image_count_nothing():
    phi, (frame, *_) = problem(1, count=1)
    frame = inside(frame, SIZE)
    label = next(label for label, xy in frame.items() if len(xy) < 4)
    loss, _ = loss_with_gradient(phi, pack_tensors(FIELD, [frame], SIZE))
    for x, y in ((-1e-6, 300.0), (960.0, 300.0), (400.0, 0.0), (400.0, 540.0)):
        more = {**frame, label: np.array([*frame[label], (x, y)])}
        again, _ = loss_with_gradient(phi, pack_tensors(FIELD, [more], SIZE))
        assert again == pytest.approx(loss, rel=1e-12)
    for x, y in ((0.0, 300.0), (400.0, 1e-6)):
        more = {**frame, label: np.array([*frame[label], (x, y)])}
        again, _ = loss_with_gradient(phi, pack_tensors(FIELD, [more], SIZE))
        assert abs(again[0] - loss[0]) > 1e-6


def test_a_few_pixels_of_each_segment():
    _, (frame, *_) = problem(2, count=1, per_line=30, per_curve=50, noise=1.0)
    frame = inside({label: xy for label, xy in frame.items() if label != "Circle central"}, SIZE)
    tensors = pack_tensors(FIELD, [frame], SIZE)
    lines = [xy for label, xy in frame.items() if not label.startswith("Circle")]
    circles = [xy for label, xy in frame.items() if label.startswith("Circle")]
    late, total = 0, 0
    for kind, pixels, most in ((tensors.lines, lines, 4), (tensors.circles, circles, 8)):
        seen = kind.weight[0] > 0.0
        np.testing.assert_array_equal(seen.sum(axis=1), [min(len(xy), most) for xy in pixels])
        np.testing.assert_allclose(kind.weight[0][seen], 1.0 / seen.sum())
        for s, xy in enumerate(pixels):
            chosen = (kind.p[:, 0, s][:, seen[s]].T + 1.0) / 2.0 * SIZE
            distance = np.linalg.norm(chosen[:, None] - xy, axis=2)
            assert distance.min(axis=1).max() < 1e-9
            indices = distance.argmin(axis=1)
            assert len(set(indices.tolist())) == len(chosen)  # none twice
            late += int(np.sum(indices >= len(xy) / 2))
            total += len(indices)
    assert 0.3 < late / total < 0.7  # from the whole of each segment
    again = pack_tensors(FIELD, [{}, frame], SIZE)
    np.testing.assert_array_equal(again.lines.p[:, 1], tensors.lines.p[:, 0])  # companions change nothing


# --- the gradient ---

STEP = 1e-6  # z-scores: about 1e-3 px
SCALES = np.array([0.9, 0.45, 0.2, 0.8, 14.0, 40.0, 20.0])  # about the sigmas of the z-scores


def differences(phi, tensors):
    """Derivatives (T, 7) of the losses by the z-scores, and where they step on a kink: half the step gives others."""
    numeric, halved = (
        SCALES * central_differences(lambda phi: loss_with_gradient(phi, tensors)[0], phi, step * SCALES)
        for step in (STEP, STEP / 2.0)
    )
    return numeric, np.abs(numeric - halved) > 3e-7 * (np.abs(numeric) + 1e-2)


def gradient_errors(gradient, numeric, kinked):
    """Relative error of each column against central differences, (T, 7); 0 where a pixel sits on a kink."""
    errors = column_errors((gradient * SCALES)[:, None], numeric[:, None], floor=1e-2)
    return np.where(kinked, 0.0, errors)


@given(drawn=problems([(960, 540), (1280, 720)]))
def test_gradient_equals_central_differences_column_by_column(drawn):
    phi, frames, image_size = drawn
    tensors = pack_tensors(FIELD, frames, image_size)
    _, gradient = loss_with_gradient(phi, tensors)
    assert gradient_errors(gradient, *differences(phi, tensors)).max() < 1e-6


def test_gradient_holds_at_the_start():
    """Far from the truth, where the optimiser begins."""
    _, frames = problem(3, count=6)
    phi = np.tile([0.0, np.radians(67.5), 0.0, np.radians(49.1), 0.0, 75.0, -22.5], (6, 1))
    tensors = pack_tensors(FIELD, frames, SIZE)
    _, gradient = loss_with_gradient(phi, tensors)
    assert gradient_errors(gradient, *differences(phi, tensors)).max() < 1e-6


def test_the_checker_finds_a_wrong_gradient_and_few_kinks():
    phi, frames = problem(4, count=6)
    tensors = pack_tensors(FIELD, frames, SIZE)
    _, gradient = loss_with_gradient(phi, tensors)
    numeric, kinked = differences(phi, tensors)
    assert np.all(np.mean(kinked, axis=0) < 0.2)
    for column in range(7):
        wrong = gradient.copy()
        wrong[:, column] *= 1.0 + 1e-4
        assert np.flatnonzero(gradient_errors(wrong, numeric, kinked).max(axis=0) > 1e-6).tolist() == [column]


def test_degenerate_pixels_are_no_nan():
    """A pixel on its sample, lines through the camera, samples in its plane."""
    phi = np.array([[0.0, pi / 2.0, 0.0, 1.0, 0.0, 0.0, 0.0]])  # on the centre mark, level
    frame = {"Middle line": np.array([(480.0, 270.0)]), "CENTER_MARK": np.array([(480.0, 270.0)])}
    frame |= {"Circle central": np.array([(480.0, 270.0), (100.0, 300.0)]), "Side line top": np.array([(1.0, 1.0)])}
    loss, gradient = loss_with_gradient(phi, pack_tensors(FIELD, [frame], SIZE))
    assert np.isfinite(loss).all()
    assert np.isfinite(gradient).all()


# --- the optimiser ---


def test_one_cycle_ends_and_peak():
    rate, beta1 = one_cycle(100)
    np.testing.assert_allclose(rate[[0, 49, 99]], [0.002, 0.05, 2e-7], rtol=1e-9)
    np.testing.assert_allclose(beta1[[0, 49, 99]], [0.95, 0.85, 0.95], rtol=1e-12)
    assert rate[24] == pytest.approx(0.002 + 0.048 * (1.0 - cos(pi * 24 / 49)) / 2.0)
    assert np.all(np.diff(rate[:50]) > 0.0)
    assert np.all(np.diff(rate[49:]) < 0.0)
    assert np.all(np.diff(beta1[:50]) < 0.0)
    assert np.all(np.diff(beta1[49:]) > 0.0)


def test_fewer_than_three_steps_are_no_cycle():
    assert len(one_cycle(3)[0]) == 3
    with pytest.raises(ValueError, match="steps must be at least 3, a rise and a fall; got 2"):
        one_cycle(2)


def adamw(gradient, z, steps):
    """The algorithm of the paper of Loshchilov and Hutter, one number at a time."""
    m = v = 0.0
    rate, beta1 = one_cycle(steps)
    for t in range(steps):
        g = gradient(z)
        z -= rate[t] * 0.01 * z
        m = beta1[t] * m + (1.0 - beta1[t]) * g
        v = 0.999 * v + 0.001 * g * g
        m_hat, v_hat = m / (1.0 - beta1[t] ** (t + 1)), v / (1.0 - 0.999 ** (t + 1))
        z -= rate[t] * m_hat / (sqrt(v_hat) + 1e-8)
    return z


@given(
    scale=bounded((2, 3), -6.0, 3.0).map(lambda exponent: 10.0**exponent),
    at=bounded((2, 3), -3.0, 3.0),
    start=bounded((2, 3), -3.0, 3.0),
    steps=st.integers(3, 60),
)
def test_adamw_is_the_algorithm(scale, at, start, steps):
    found = minimise(lambda z: scale * (z - at) ** 3, start, steps)
    for i in np.ndindex(2, 3):
        expected = adamw(lambda z, i=i: scale[i] * (z - at[i]) ** 3, start[i], steps)
        assert found[i] == pytest.approx(expected, rel=1e-9, abs=1e-12)


# --- the method ---


def main_frames(count, seed, noise=0.0):
    return random_frames(count, seed, noise, stands=("main center",))


@pytest.mark.slow
def test_it_finds_cameras():
    """Weight decay and the samples' spacing leave the loss a little above zero; some starts end elsewhere."""
    frames, cameras = main_frames(20, 0)
    found = calibrate(FIELD, frames, SIZE)
    losses = np.array([calibration.loss_ndc for calibration in found])
    assert np.median(losses) < 2e-3
    thetas = np.array([theta_from_camera(calibration.camera) for calibration in found])
    truth = np.array([theta_from_camera(camera) for camera in cameras])
    good = losses < 2e-3
    assert good.sum() >= 10
    errors = np.median(np.abs(thetas - truth)[good], axis=0)
    assert np.degrees(errors[ANGLES]).max() < 0.1
    assert errors[LOG_F] < 0.01
    assert errors[CENTER].max() < 0.3
    for calibration in np.array(found, dtype=object)[good]:
        assert calibration.status is Status.ACCEPTED
        assert calibration.rms < 3.0
        assert max(calibration.per_segment_errors.values()) < 10.0


def test_first_steps_are_as_long_as_the_distribution_is_wide():
    """AdamW goes by its learning rate in units of sigma, 1.96 (b - a) / sqrt(12), whatever the gradient."""
    low = np.array([*np.radians([-45.0, 45.0, -10.0, 8.2]), -12.0, 40.0, -40.0])
    high = np.array([*np.radians([45.0, 90.0, 10.0, 90.0]), 12.0, 110.0, -5.0])
    frames, _ = main_frames(10, 6)
    thetas = [theta_from_camera(calibration.camera) for calibration in calibrate(FIELD, frames, SIZE, steps=3)]
    phi = np.array([phi_of(theta, SIZE) for theta in thetas])
    z = (phi - (low + high) / 2.0) / (1.96 * (high - low) / np.sqrt(12.0))
    constant_slope = minimise(np.ones_like, np.zeros(7), 3)
    np.testing.assert_allclose(np.median(np.abs(z), axis=0), -constant_slope, rtol=0.05)


def test_rms_and_errors_are_those_of_all_pixels():
    frames, _ = main_frames(2, 1, noise=2.0)
    for frame, calibration in zip(frames, calibrate(FIELD, frames, SIZE, steps=50), strict=True):
        assert list(calibration.per_segment_errors) == list(frame)
        camera = calibration.camera
        for label in ("Side line top", "Middle line"):
            if label not in frame:
                continue
            a, b = camera.R @ (FIELD[label].start - camera.C), camera.R @ (FIELD[label].end - camera.C)
            line = np.linalg.inv(camera.K).T @ np.cross(a, b)
            distance = (frame[label] @ line[:2] + line[2]) / np.hypot(*line[:2])
            assert calibration.per_segment_errors[label] == pytest.approx(np.sqrt(np.mean(distance**2)))
        squares = [calibration.per_segment_errors[label] ** 2 * len(xy) for label, xy in frame.items()]
        assert calibration.rms == pytest.approx(np.sqrt(sum(squares) / sum(map(len, frame.values()))))


def test_frames_together_or_one_by_one():
    """A few steps only: rounding grows among the kinks."""
    frames, _ = main_frames(5, 2, noise=3.0)
    together = calibrate(FIELD, [*frames, {}], SIZE, steps=20)
    for frame, calibration in zip([*frames, {}], together, strict=True):
        (alone,) = calibrate(FIELD, [frame], SIZE, steps=20)
        assert alone.status is calibration.status
        if frame:
            np.testing.assert_allclose(
                theta_from_camera(alone.camera), theta_from_camera(calibration.camera), rtol=1e-6, atol=1e-6
            )


def test_the_best_of_several_starts():
    frames, _ = random_frames(6, 3, stands=("main left", "main right"))
    single = [calibrate(FIELD, frames, SIZE, steps=200, distributions=(name,)) for name in DISTRIBUTIONS]
    best = calibrate(FIELD, frames, SIZE, steps=200, distributions=tuple(DISTRIBUTIONS))
    least = np.min([[calibration.loss_ndc for calibration in found] for found in single], axis=0)
    np.testing.assert_array_equal([calibration.loss_ndc for calibration in best], least)
    winners = np.argmin([[calibration.loss_ndc for calibration in found] for found in single], axis=0)
    assert len(set(winners.tolist())) > 1


def test_a_camera_whenever_there_is_a_pixel():
    outside = {"Middle line": np.array([(480.0, -3.0)])}
    empty, seen_nowhere = calibrate(FIELD, [{}, outside], SIZE, steps=5)
    assert empty.camera is None
    assert empty.status is Status.TOO_FEW_SEGMENTS
    np.testing.assert_allclose(seen_nowhere.camera.C, (0.0, 75.0, -22.5))  # nothing moves it from the mean
    assert seen_nowhere.loss_ndc == 0.0
    assert calibrate(FIELD, [], SIZE) == []


def test_tau_rejects_but_the_camera_is_given():
    frames, _ = main_frames(2, 4)
    for calibration in calibrate(FIELD, frames, SIZE, steps=5, tau=0.019):  # five steps lead nowhere
        assert calibration.status is Status.REJECTED
        assert calibration.message == f"the loss in NDC is {calibration.loss_ndc:.4f}, above tau = 0.019"
        assert calibration.camera.image_size == SIZE


def test_an_unknown_distribution_is_named():
    for names in (("main centre",), ()):
        with pytest.raises(ValueError, match="must name some of main center, main left, main right, got"):
            calibrate(FIELD, [], SIZE, distributions=names)


def test_every_frame_with_pixels_gets_a_camera_however_many_there_are():
    frames, _ = main_frames(2, 5)
    found = calibrate(FIELD, [frames[i % 2] for i in range(CHUNK + 1)] + [{}], SIZE, steps=3)
    assert [calibration.camera is not None for calibration in found] == [True] * (CHUNK + 1) + [False]


@given(drawn=thetas(lens=False), X=vectors((-50.0, -30.0, -3.0), (50.0, 30.0, 0.0), count=5))
def test_a_negative_focal_length_is_half_a_turn_of_roll(drawn, X):
    """It mirrors every image point at the principal point."""
    theta, image_size = drawn
    phi = phi_of(theta, image_size)
    mirrored = phi.copy()
    mirrored[FOV] *= -1.0
    found = theta_from_phi(np.array([phi, mirrored]), image_size)
    np.testing.assert_allclose(found[0], theta, rtol=1e-9, atol=1e-12)
    xy, turned = (camera_from_theta(t, image_size).project(X) for t in found)
    np.testing.assert_allclose(turned, image_size - xy, rtol=1e-9, atol=1e-6)


@pytest.mark.slow
def test_annotated_frames_pass_the_papers_threshold_as_often(shared_data):
    """The public code rejects 7 % of SoccerNet's frames of the main camera by tau."""
    files = sorted((shared_data / "sncalib-test-center").glob("[0-9]*.json"))[: 2 * CHUNK]
    frames = [check_segments(FIELD, parse_annotation(file.read_bytes(), SIZE), SIZE) for file in files]
    found = calibrate(FIELD, frames, SIZE, tau=0.019)
    assert 0.88 < np.mean([calibration.accepted for calibration in found]) < 0.99
    assert 0.0075 < np.median([calibration.loss_ndc for calibration in found]) < 0.0105
