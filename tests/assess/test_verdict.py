"""The verdict: plausibility, what the labels determine, and the words for it."""

from dataclasses import replace

import numpy as np
import pytest
from synthetic import observe, whole_circle_markings

from fieldcalib.assess.findings import Status
from fieldcalib.assess.observability import READABLE, Direction, Information
from fieldcalib.assess.verdict import Evidence, implausibilities, verdict
from fieldcalib.fields.segments import Arc, Line, Point, PointCloud
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.geometry.camera import Camera
from fieldcalib.problem.evaluation import Problem, evaluate
from fieldcalib.problem.layout import LOG_F, Layout, theta_from_camera
from fieldcalib.problem.losses import RobustLoss
from fieldcalib.problem.observations import pack

FIELD, SIZE = soccer(), (960, 540)
PINHOLE = Layout.of(SIZE).fixed("lens", "principal point", "aspect")
CAMERA = Camera.from_angles(-0.3, 1.35, 0.0, 1500.0, (0.0, 65.0, -16.0), SIZE)
FRAME = observe(whole_circle_markings(FIELD), CAMERA)


def labels_of(frame, objects=FIELD):
    return pack(objects, [frame], SIZE).labels_in(0)


GOOD = Evidence(
    rms=1.0,
    loss_ndc=lambda: 0.005,
    errors=dict.fromkeys(FRAME, 1.0),
    labels=labels_of(FRAME),
    given=labels_of(FRAME),
    suspects=(),
    far=20.0,
    unknowns=7,
    implausible=[],
    weakest=Direction(5.0, "focal length"),
    ground_error=lambda: 0.1,
    converged=True,
)
OPEN = Direction(1e-4, "x")
FEW = ("Side line top", "Big rect. left main", "Big rect. left top", "Side line left")
FOUR = replace(
    GOOD, errors=dict.fromkeys(FEW, 1.0), **dict.fromkeys(("labels", "given"), labels_of({k: FRAME[k] for k in FEW}))
)


def seen(camera, frame, objects=FIELD):
    problem = Problem(pack(objects, [frame], SIZE), Layout.of(SIZE), RobustLoss("linear", 1.0))
    return evaluate(problem, theta_from_camera(camera)[None])


def complaints(camera, frame=None, *, objects=FIELD, far=20.0, field=FIELD, may_be_inside=True):
    frame = observe(whole_circle_markings(FIELD), camera) if frame is None else frame
    reasons = implausibilities(seen(camera, frame, objects), far=far, field=field, may_be_inside=may_be_inside)
    return [reason for reason, mask in reasons.items() if mask[0]]


def rms_of(camera, frame):
    return np.sqrt(np.mean(np.square(seen(camera, frame).r)))


def test_a_camera_on_the_stand_is_plausible():
    assert complaints(CAMERA) == []


@pytest.mark.parametrize(
    ("inside", "outside", "complaint"),
    [
        ({"roll": np.radians(44.0)}, {"roll": np.radians(46.0)}, "rolled by more than 45 degrees"),
        ({"C": (0.0, 65.0, -0.1)}, {"C": (0.0, 65.0, 0.1)}, "below the ground"),
        ({"C": (0.0, 295.0, -40.0)}, {"C": (0.0, 299.0, -40.0)}, "more than 300 m away"),
        ({"fov": 149.0}, {"fov": 151.0}, "above 150 degrees"),
        ({"fov": 0.51}, {"fov": 0.49}, "below 0.5 degrees"),
    ],
)
def test_limits(inside, outside, complaint):
    def camera(roll=0.0, C=(0.0, 65.0, -16.0), fov=40.0):
        f = 480.0 / np.tan(np.radians(fov) / 2.0)
        return Camera.from_angles(0.0, 1.4, roll, f, C, SIZE)

    centre = {"CENTER_MARK": camera(**inside).project([[0.0, 0.0, 0.0]])}
    assert not any(complaint in reason for reason in complaints(camera(**inside), centre))
    assert any(complaint in reason for reason in complaints(camera(**outside), centre))
    on_no_field = complaints(camera(**outside), centre, field=None)
    assert any(complaint in reason for reason in on_no_field) == ("fov" in outside)


def test_what_fits_must_lie_in_front():
    """A camera that looks the other way: to lines, homogeneous as they are, the same image, but upside down."""
    backwards = Camera(CAMERA.K, np.diag([-1.0, 1.0, -1.0]) @ CAMERA.R, CAMERA.C, SIZE)
    lines = {label: FRAME[label] for label in ("Side line top", "Big rect. left main", "Side line left")}
    flipped = {label: (0.0, 540.0) + xy * (1.0, -1.0) for label, xy in lines.items()}
    assert rms_of(CAMERA, lines) < 1e-6
    assert "labelled segments lie behind it" not in complaints(CAMERA, lines)
    assert rms_of(backwards, flipped) < 1e-6
    assert "labelled segments lie behind it" in complaints(backwards, flipped)


def test_every_frame_of_a_batch_is_judged_by_itself():
    backwards = Camera(CAMERA.K, np.diag([-1.0, 1.0, -1.0]) @ CAMERA.R, CAMERA.C, SIZE)
    flipped = {label: (0.0, 540.0) + xy * (1.0, -1.0) for label, xy in FRAME.items() if "Circle" not in label}
    below = Camera(CAMERA.K, CAMERA.R, CAMERA.C * (1.0, 1.0, -1.0), SIZE)
    seen = [CAMERA, backwards, below]
    observations = pack(FIELD, [FRAME, flipped, FRAME], SIZE)
    theta = np.array([theta_from_camera(camera) for camera in seen])
    problem = Problem(observations, Layout.of(SIZE), RobustLoss("linear", 1.0))
    reasons = implausibilities(evaluate(problem, theta), far=20.0, field=FIELD)
    alone = [complaints(camera, frame) for camera, frame in zip(seen, (FRAME, flipped, FRAME), strict=True)]
    assert alone[0] == []
    assert "labelled segments lie behind it" in alone[1]
    for t, expected in enumerate(alone):
        assert [reason for reason, mask in reasons.items() if mask[t]] == expected


def test_a_wrong_label_that_would_lie_behind_does_not_speak_against_a_camera():
    assert "Side line bottom" not in FRAME
    behind = Line((-50.0, 90.0, 0.0), (50.0, 90.0, 0.0))
    field = {**FIELD, "behind": behind}
    frame = {**FRAME, "behind": np.array([(100.0, 500.0), (800.0, 520.0)])}
    assert "labelled segments lie behind it" not in complaints(CAMERA, frame, objects=field)


def test_a_good_fit_is_accepted():
    assert verdict(GOOD, None) == (Status.ACCEPTED, f"rms 1.00 px over {len(FRAME)} segments")


def test_the_segment_that_fits_least_is_named():
    errors = {**GOOD.errors, "Side line left": 40.0, "Side line top": 80.0, "Big rect. left main": 30.0}
    status, message = verdict(replace(GOOD, errors=errors), None)
    assert status is Status.ACCEPTED
    assert f"{len(FRAME) - 3} of {len(FRAME)} segments agree" in message
    assert "'Side line top' lies 80 px off" in message


@pytest.mark.parametrize(
    ("changes", "tau", "status", "words"),
    [
        ({"loss_ndc": lambda: 0.02}, 0.019, Status.REJECTED, "0.0200, is above tau = 0.019"),
        ({"loss_ndc": lambda: float("nan")}, 0.019, Status.REJECTED, "tau"),
        ({"unknowns": 99}, None, Status.TOO_FEW_SEGMENTS, "for 99 unknowns"),
        (
            {"weakest": Direction(1e-4, "focal length with y"), "ground_error": lambda: 1.1},
            None,
            Status.DEGENERATE,
            "leave focal length with y open",
        ),
        ({"implausible": ["it stands below the ground"]}, None, Status.IMPLAUSIBLE, "it stands below the ground"),
        ({"converged": False}, None, Status.NOT_CONVERGED, "iterations"),
    ],
)
def test_what_speaks_against_a_fit(changes, tau, status, words):
    found, message, *_ = verdict(replace(GOOD, **changes), tau)
    assert found is status
    assert words in message


def test_what_leaves_the_ground_determined_is_accepted_unless_it_is_implausible():
    """From straight above focal length and height are open against one another."""
    above = replace(GOOD, weakest=Direction(1e-4, "focal length with z"))
    assert verdict(above, None)[0] is Status.ACCEPTED
    assert verdict(replace(above, implausible=["it stands below the ground"]), None)[0] is Status.DEGENERATE
    assert verdict(replace(above, ground_error=lambda: float("nan")), None)[0] is Status.DEGENERATE


@pytest.mark.parametrize(("missed", "accepted"), [(0.30, True), (0.40, False)])
def test_two_thirds_of_the_segments_must_agree(missed, accepted):
    wrong = list(FRAME)[: round(missed * len(FRAME))]
    status, message = verdict(replace(GOOD, errors={**GOOD.errors, **dict.fromkeys(wrong, 90.0)}), None)
    assert (status is Status.ACCEPTED) == accepted
    assert ("only" in message) != accepted


def test_segments_that_agree_must_suffice():
    errors = {**FOUR.errors, "Side line top": 90.0}
    assert verdict(FOUR, None)[0] is Status.ACCEPTED
    assert verdict(replace(FOUR, errors=errors), None)[0] is Status.IMPLAUSIBLE


@pytest.mark.parametrize(
    "changes",
    [{}, {"implausible": ["it stands inside the field"]}, {"weakest": OPEN, "ground_error": lambda: 1.1}],
    ids=["disagreement", "implausible", "degenerate"],
)
def test_a_rejected_fit_names_the_segment_that_it_misses_most(changes):
    errors = {**FOUR.errors, "Side line left": 40.0, "Side line top": 80.0}
    missing = replace(FOUR, errors=errors, **changes)
    assert verdict(missing, None)[1].endswith("; 'Side line top' lies 80 px off: this label or another one is wrong")
    suspect = replace(missing, suspects=["Side line left"])  # which is told anyway
    for other in (suspect, replace(missing, errors=FOUR.errors)):
        assert "Side line top" not in verdict(other, None)[1]


@pytest.mark.parametrize(
    ("segment", "pixels", "equations"),
    [
        (Point((0.0, 0.0, 0.0)), 1, 2),
        (Line((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)), 1, 1),
        (Line((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)), 5, 2),
        (Arc((0.0, 0.0, 0.0), 1.0), 3, 3),
        (Arc((0.0, 0.0, 0.0), 1.0), 9, 5),
        (PointCloud(np.eye(3), ordered=True), 9, 9),
        (PointCloud(np.eye(3)), 9, 18),
    ],
)
def test_equations_of_a_segment(segment, pixels, equations):
    xy = np.arange(2.0 * pixels).reshape(-1, 2)
    assert labels_of({"it": xy}, {"it": segment}).equations == {"it": equations}
    repeated = {"it": np.repeat(xy, 2, axis=0)}  # pixels that are given twice add nothing
    assert labels_of(repeated, {"it": segment}).equations == {"it": equations}


def information(matrix, has_prior=True, layout=PINHOLE):
    names = tuple(READABLE.get(name, name) for name, free in zip(layout.names, layout.free, strict=True) if free)
    return Information(matrix[None], names, has_prior)


def test_the_weakest_direction_is_found_and_named():
    matrix = 9.0 * np.eye(7)
    matrix[LOG_F, LOG_F] = 1e-5
    assert information(matrix).weakest(0) == Direction(pytest.approx(1e-5), "focal length")
    assert information(np.ones((7, 7))).weakest(0).parameters
    directions = information(np.diag([5.0, 4.0, 3.0, 2.0, 1.0, 6.0, 7.0])).directions(0)
    names = [direction.parameters for direction in directions]
    assert names == ["x", "focal length", "roll", "tilt", "pan", "y", "z"]
    assert directions[0].share == pytest.approx(0.5)


def test_sigma_is_the_scale_of_what_counts_as_determined():
    """Information has the unit of the standard deviations that it is asked for, squared."""
    evaluation = seen(CAMERA, FRAME)
    evaluation = evaluation.of(replace(evaluation.problem, layout=PINHOLE))
    one, tenth = (Information.of(evaluation, np.full((1, 7), unit)) for unit in (1.0, 0.1))
    np.testing.assert_allclose(one.matrix, evaluation.information)
    assert tenth.weakest(0).information == pytest.approx(0.01 * one.weakest(0).information)
    assert tenth.weakest(0).parameters == one.weakest(0).parameters


def test_what_is_not_asked_for_is_under_its_prior():
    """By hand: two parameters of information 4, coupled by 3; the other one has a prior of 1."""
    matrix = np.diag([4.0] * 7)
    matrix[0, 1] = matrix[1, 0] = 3.0
    about_pan = np.arange(7) == 0
    assert information(matrix).about(about_pan).matrix[0, 0, 0] == pytest.approx(4.0 - 9.0 / (4.0 + 1.0))
    assert information(matrix, has_prior=False).about(about_pan).matrix[0, 0, 0] == 4.0  # the others are known
    assert information(matrix).about(about_pan).weakest(0).parameters == "pan"


@pytest.mark.parametrize(("y", "inside"), [(33.9, True), (34.1, False)])
def test_a_camera_on_the_field_is_implausible_unless_the_user_says_so(y, inside):
    camera = Camera.from_angles(0.0, 1.3, 0.0, 900.0, (0.0, y, -5.0), SIZE)
    centre = {"CENTER_MARK": camera.project([[0.0, 0.0, 0.0]])}
    assert ("it stands inside the field" in complaints(camera, centre, may_be_inside=False)) == inside
    assert "it stands inside the field" not in complaints(camera, centre)


def test_labels_that_were_given_up_do_not_agree():
    """Two thirds of the labels as given must agree: suspects were renamed or left out, and count against."""
    wrong = list(FRAME)[: round(0.4 * len(FRAME))]
    believed = {label: xy for label, xy in FRAME.items() if label not in wrong}
    evidence = replace(GOOD, labels=labels_of(believed), errors=dict.fromkeys(believed, 1.0), suspects=wrong)
    status, message = verdict(evidence, None)
    assert status is Status.IMPLAUSIBLE
    assert "only" in message
    assert verdict(replace(evidence, suspects=wrong[:1]), None)[0] is Status.ACCEPTED


def test_information_beside_which_the_prior_is_rounded_away_is_no_error():
    lots = Information(1e20 * np.ones((1, 3, 3)), ("x", "y", "z"), has_prior=True)
    assert np.all(np.isfinite(lots.about(np.array([True, False, False])).matrix))
