"""Pixels past the ends of their segments."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from strategies import angle, numbers, thetas
from synthetic import displaced, observe, random_frames
from test_evaluation import SIZES, at, jacobian_errors

from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.geometry.camera import Camera
from fieldcalib.problem.evaluation import evaluate, pixels_past_ends, with_segment_ends
from fieldcalib.problem.layout import Layout, camera_from_theta, theta_from_camera
from fieldcalib.problem.observations import pack
from fieldcalib.solve.batch import calibrate_batch

FIELD, SIZE, FAR = soccer(), (960, 540), 20.0
CAMERA = Camera.from_angles(-0.55, 1.38, 0.0, 1300.0, (0.0, 60.0, -15.0), SIZE)
THETA = theta_from_camera(CAMERA)[None]


def past(frame, theta=THETA):
    return pixels_past_ends(at(theta, pack(FIELD, [frame], SIZE)), FAR)


def beyond(label, metres):
    """The image of the point so far along a line's direction before its start."""
    segment = FIELD[label]
    direction = np.subtract(segment.end, segment.start)
    return CAMERA.project(segment.start - metres * direction / np.linalg.norm(direction))


@pytest.mark.parametrize("label", ["Side line left", "Big rect. left main", "Small rect. left main"])
def test_a_pixel_past_the_end_of_a_line_is_measured_from_that_end(label):
    start = FIELD[label].start
    inside = CAMERA.project(FIELD[label].sample(1.0)[1:4])
    ends = past({label: np.concatenate([inside, [beyond(label, 1.0)]])})
    assert ends.xy.shape == (1, 1, 2)
    np.testing.assert_allclose(ends.geometry[0, 0, 0], start, atol=1e-9)
    observations = pack(FIELD, [{label: inside}], SIZE).with_ends(ends)
    expected = np.linalg.norm(beyond(label, 1.0) - CAMERA.project(start))
    assert abs(at(THETA, observations).r[0, -1]) == pytest.approx(expected, rel=1e-6)


def test_an_arc_ends_where_the_penalty_area_begins():
    arc = FIELD["Circle left"]
    phi = arc.stop + 0.1
    spokes = np.array([arc.u, arc.v])
    beyond_arc = arc.center + arc.radius * np.array([np.cos(phi), np.sin(phi)]) @ spokes
    ends = past({"Circle left": np.concatenate([CAMERA.project(arc.sample(1.0)[1:-1]), [CAMERA.project(beyond_arc)]])})
    assert ends.xy.shape == (1, 1, 2)
    np.testing.assert_allclose(ends.geometry[0, 0, 0], arc.sample()[-1], atol=1e-9)


def test_whole_circles_have_no_end():
    assert not past({"Circle central": CAMERA.project(FIELD["Circle central"].sample(0.5))})


def test_what_lies_far_past_an_end_has_another_fault():
    label = "Side line left"
    metres = np.linspace(0.1, 20.0, 100)
    xy = np.array([beyond(label, m) for m in metres])
    found = past({label: xy}).xy.shape[1]
    assert found == np.sum(np.linalg.norm(xy - CAMERA.project(FIELD[label].start), axis=1) <= FAR)
    assert 0 < found < len(xy)


@given(thetas(lens=True), numbers(0.0, 6.0), angle(np.pi))
def test_derivatives_match_central_differences(theta_and_size, distance, direction):
    theta, size = theta_and_size
    frame = displaced(observe(FIELD, camera_from_theta(theta, size)), distance, direction)
    assume(frame)
    # the ends alone: of lines and of arcs, which move with the size of the field each in its way
    layout = Layout.of(size, field_size=SIZES)
    theta = np.concatenate([theta, SIZES.given])[None]
    evaluation = at(theta, pack(FIELD, [frame], size, motion=FIELD.motion), layout)
    ends = pixels_past_ends(evaluation, FAR)
    observations = evaluation.problem.observations
    silent = [replace(rows, weight=np.zeros_like(rows.weight)) for rows in observations.rows[:-1]]
    assert np.max(jacobian_errors(at(theta, replace(observations, rows=(*silent, ends)), layout))) < 1e-5


def test_with_ends_is_what_would_be_found_anew():
    """The ends join an evaluation without a search; given again, they take the place of the former."""
    frames, cameras = random_frames(6, seed=6, noise=4.0)
    theta = np.array([theta_from_camera(camera) for camera in cameras])
    evaluation = at(theta, pack(FIELD, frames, SIZE))
    joined = with_segment_ends(evaluation, FAR)
    assert joined.r.shape[1] > evaluation.r.shape[1]
    anew = evaluate(joined.problem, theta)
    seen = joined.problem.observations.label >= 0
    np.testing.assert_allclose(joined.r[seen], anew.r[seen], rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(joined.JT * seen[:, None], anew.JT * seen[:, None], rtol=1e-12, atol=1e-12)
    for name in ("cost", "gradient", "hessian"):
        np.testing.assert_allclose(getattr(joined, name), getattr(anew, name), rtol=1e-12, atol=1e-12, err_msg=name)
    again = with_segment_ends(joined, FAR)
    np.testing.assert_array_equal(again.r, joined.r)
    np.testing.assert_array_equal(again.problem.observations.weight, joined.problem.observations.weight)


def test_exact_pixels_leave_the_camera_alone():
    frames, cameras = random_frames(20, seed=5)
    for frame, camera in zip(frames, cameras, strict=True):
        theta = theta_from_camera(camera)[None]
        ends = past(frame, theta)
        evaluation = at(theta, pack(FIELD, [frame], SIZE)).with_ends(ends)
        assert np.max(np.abs(evaluation.r)) < 1e-6


@pytest.mark.slow
def test_noisy_cameras_get_better(monkeypatch):
    frames, cameras = random_frames(50, seed=1, noise=3.0, stands=("main center",))

    def position_errors():
        found = calibrate_batch(FIELD, frames, SIZE)
        return np.array([np.linalg.norm(c.camera.C - camera.C) for c, camera in zip(found, cameras, strict=True)])

    drawn = position_errors()
    monkeypatch.setattr("fieldcalib.problem.evaluation.WEIGHT", 0.0)
    blind = position_errors()
    assert np.median(drawn) < 0.95 * np.median(blind)
    assert np.mean(drawn < blind) > 0.5
