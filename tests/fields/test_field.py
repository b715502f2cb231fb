"""The football field against numbers written down from the Laws of the Game, and the checks of every segment type."""

import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import cKDTree
from strategies import examples

from fieldcalib.fields.field import Field
from fieldcalib.fields.segments import Arc, Line, Point, PointCloud
from fieldcalib.fields.sports.soccer import soccer

FIELD = soccer()


def field_sizes():
    """(length, width) that the laws allow, in whole millimetres."""
    return st.tuples(st.integers(90_000, 120_000), st.integers(45_000, 90_000)).map(
        lambda size: (size[0] / 1e3, size[1] / 1e3)
    )


def of_type(field, kind):
    return {name for name, segment in field.items() if isinstance(segment, kind)}


def ends(line):
    return {line.start, line.end}


def test_number_and_kinds_of_segments():
    assert len(of_type(FIELD, Line)) == 23
    assert of_type(FIELD, Arc) == {
        f"Circle {part}" for part in ("left", "right", "central", "central left", "central right")
    }
    assert len(of_type(FIELD, Point)) == 39
    assert len(FIELD) == 23 + 5 + 39
    assert len(FIELD.markings) == 23 + 5
    assert set(FIELD.points) == of_type(FIELD, Point)
    assert set(FIELD.points) | set(FIELD.markings) == set(FIELD)


def test_the_26_labels_of_soccernet_are_there():
    sides = ("left", "right")
    expected = {"Side line top", "Side line bottom", "Side line left", "Side line right", "Middle line"}
    expected |= {
        f"{rect} rect. {s} {line}" for rect in ("Big", "Small") for s in sides for line in ("top", "bottom", "main")
    }
    expected |= {f"Goal {s} {part}" for s in sides for part in ("crossbar", "post left", "post left ", "post right")}
    expected |= {"Circle central", "Circle left", "Circle right"}
    assert len(expected) == 26 + 2  # one post with its trailing blank and the other likewise
    assert all(label in FIELD for label in expected)


@pytest.mark.parametrize(
    ("name", "X"),
    [
        ("CENTER_MARK", (0, 0, 0)),
        ("L_PENALTY_MARK", (-41.5, 0, 0)),
        ("R_PENALTY_MARK", (41.5, 0, 0)),
        ("TL_PITCH_CORNER", (-52.5, -34, 0)),
        ("BR_PITCH_CORNER", (52.5, 34, 0)),
        ("T_TOUCH_AND_HALFWAY_LINES_INTERSECTION", (0, -34, 0)),
        ("B_TOUCH_AND_HALFWAY_LINES_INTERSECTION", (0, 34, 0)),
        ("T_HALFWAY_LINE_AND_CENTER_CIRCLE_INTERSECTION", (0, -9.15, 0)),
        ("B_HALFWAY_LINE_AND_CENTER_CIRCLE_INTERSECTION", (0, 9.15, 0)),
        ("L_PENALTY_AREA_TL_CORNER", (-52.5, -20.16, 0)),
        ("L_PENALTY_AREA_BR_CORNER", (-36, 20.16, 0)),
        ("R_PENALTY_AREA_TL_CORNER", (36, -20.16, 0)),
        ("R_PENALTY_AREA_BR_CORNER", (52.5, 20.16, 0)),
        ("L_GOAL_AREA_TR_CORNER", (-47, -9.16, 0)),
        ("R_GOAL_AREA_BL_CORNER", (47, 9.16, 0)),
        ("L_GOAL_TL_POST", (-52.5, 3.66, -2.44)),  # facing the left goal, its left post is the one near the camera
        ("L_GOAL_BR_POST", (-52.5, -3.66, 0)),
        ("R_GOAL_TL_POST", (52.5, -3.66, -2.44)),
        ("R_GOAL_BR_POST", (52.5, 3.66, 0)),
        ("TL_16M_LINE_AND_PENALTY_ARC_INTERSECTION", (-36, -7.3125, 0)),  # sqrt(9.15^2 - 5.5^2) = 7.3125...
        ("BR_16M_LINE_AND_PENALTY_ARC_INTERSECTION", (36, 7.3125, 0)),
    ],
)
def test_named_points_by_hand(name, X):
    np.testing.assert_allclose(FIELD[name].X, X, atol=1e-4)


@pytest.mark.parametrize(
    ("label", "expected"),
    [
        ("Side line top", {(-52.5, -34.0, 0.0), (52.5, -34.0, 0.0)}),
        ("Side line bottom", {(-52.5, 34.0, 0.0), (52.5, 34.0, 0.0)}),
        ("Side line left", {(-52.5, -34.0, 0.0), (-52.5, 34.0, 0.0)}),
        ("Middle line", {(0.0, -34.0, 0.0), (0.0, 34.0, 0.0)}),
        ("Big rect. left main", {(-36.0, -20.16, 0.0), (-36.0, 20.16, 0.0)}),
        ("Big rect. right top", {(36.0, -20.16, 0.0), (52.5, -20.16, 0.0)}),
        ("Big rect. right bottom", {(36.0, 20.16, 0.0), (52.5, 20.16, 0.0)}),
        ("Small rect. left top", {(-52.5, -9.16, 0.0), (-47.0, -9.16, 0.0)}),
        ("Small rect. right main", {(47.0, -9.16, 0.0), (47.0, 9.16, 0.0)}),
        ("Goal left crossbar", {(-52.5, -3.66, -2.44), (-52.5, 3.66, -2.44)}),
        ("Goal left post left", {(-52.5, 3.66, -2.44), (-52.5, 3.66, 0.0)}),
        ("Goal left post right", {(-52.5, -3.66, -2.44), (-52.5, -3.66, 0.0)}),
        ("Goal right post left", {(52.5, -3.66, -2.44), (52.5, -3.66, 0.0)}),
        ("Goal right post right", {(52.5, 3.66, -2.44), (52.5, 3.66, 0.0)}),
    ],
)
def test_lines_by_hand(label, expected):
    assert ends(FIELD[label]) == expected


@given(field_sizes())
def test_posts_are_left_and_right_as_seen_facing_their_goal(size):
    field = soccer(*size)
    for side, facing in (("left", (-1.0, 0.0, 0.0)), ("right", (1.0, 0.0, 0.0))):
        to_the_right = np.cross((0.0, 0.0, 1.0), facing)  # down x forward = right
        left, right = (np.array(field[f"Goal {side} post {post}"].start) for post in ("left", "right"))
        assert (right - left) @ to_the_right == pytest.approx(7.32)


@pytest.mark.parametrize(("side", "sign"), [("left", -1.0), ("right", 1.0)])
@given(field_sizes())
def test_penalty_arcs_end_on_the_line_of_the_penalty_area_and_bulge_towards_the_centre(side, sign, size):
    x_main = sign * (size[0] / 2.0 - 16.5)
    X = soccer(*size)[f"Circle {side}"].sample(spacing=0.1)
    np.testing.assert_allclose(X[[0, -1], 0], x_main, atol=1e-9)
    np.testing.assert_allclose(np.sort(X[[0, -1], 1]), [-7.3125, 7.3125], atol=1e-4)
    assert np.all(sign * X[1:-1, 0] < sign * x_main)
    np.testing.assert_allclose(np.hypot(X[:, 0] - sign * (size[0] / 2.0 - 11.0), X[:, 1]), 9.15, atol=1e-9)


@pytest.mark.parametrize(("half", "sign"), [("left", -1.0), ("right", 1.0)])
def test_halves_of_the_centre_circle_lie_on_their_side_and_make_up_the_circle(half, sign):
    X = FIELD[f"Circle central {half}"].sample(spacing=0.1)
    assert np.all(sign * X[1:-1, 0] > 0.0)
    np.testing.assert_allclose(np.sort(X[[0, -1], 1]), [-9.15, 9.15], atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(X, axis=1), 9.15, atol=1e-12)


@given(field_sizes())
def test_touchlines_follow_the_size_and_the_boxes_keep_theirs(size):
    length, width = size
    field = soccer(length, width)
    assert (field.length, field.width) == size
    for name, segment in field.points.items():
        X, Y, _ = np.abs(segment.X)
        if name.endswith("PITCH_CORNER"):
            np.testing.assert_allclose((X, Y), (length / 2.0, width / 2.0), atol=1e-12)
        elif "AREA" in name or "GOAL" in name or "16M" in name:
            np.testing.assert_allclose(X - length / 2.0, abs(FIELD[name].X[0]) - 52.5, atol=1e-9)
            assert abs(FIELD[name].X[1]) == Y
    for label in ("Side line top", "Side line bottom"):
        assert np.abs(np.subtract(field[label].end, field[label].start))[0] == pytest.approx(length)
    assert field["Middle line"].end[1] == width / 2.0
    assert field["Circle central"] == FIELD["Circle central"]


@given(field_sizes())
def test_symmetric_is_an_involution(size):
    symmetric = soccer(*size).symmetric
    assert set(symmetric) == set(FIELD)
    assert all(symmetric[symmetric[name]] == name for name in symmetric)


@examples(10)
@given(field_sizes())
def test_symmetric_maps_the_geometry_by_half_a_turn(size):
    field = soccer(*size)
    for name, other in field.symmetric.items():
        turned = field[name].sample(spacing=0.5) * (-1.0, -1.0, 1.0)
        X = field[other].sample(spacing=0.05)
        gaps, _ = cKDTree(X).query(turned)
        assert type(field[name]) is type(field[other])
        assert np.max(gaps) < 0.05, (name, other)  # sampled every 5 cm; different segments are metres apart


@pytest.mark.parametrize(
    ("label", "other"),
    [
        ("Side line top", "Side line bottom"),
        ("Middle line", "Middle line"),
        ("Goal left post left", "Goal right post left"),  # left stays left: both are seen facing the goal
        ("Circle central left", "Circle central right"),
        ("Circle left", "Circle right"),
        ("L_GOAL_TL_POST", "R_GOAL_TL_POST"),
        ("TL_PITCH_CORNER", "BR_PITCH_CORNER"),
    ],
)
def test_symmetric_by_hand(label, other):
    assert FIELD.symmetric[label] == other


def test_self_symmetric_are_the_middle_line_and_what_lies_about_the_centre_mark():
    markings = {label for label in FIELD.self_symmetric if label in FIELD.markings}
    assert markings == {"Middle line", "Circle central", "Circle central left", "Circle central right"}
    assert "CENTER_MARK" in FIELD.self_symmetric


def test_labels_are_found_with_and_without_surrounding_blanks():
    assert FIELD["Goal left post left "] == FIELD["Goal left post left"]
    assert "Goal left post left " in FIELD
    assert FIELD.get("Goal left post left ") is FIELD.get("Goal left post left")
    assert all(label == label.strip() for label in FIELD)


def test_unknown_labels_are_not_found():
    assert "Midle line" not in FIELD
    with pytest.raises(KeyError, match="Midle line"):
        FIELD["Midle line"]


@pytest.mark.parametrize(("length", "width"), [(51.0, 68.0), (105.0, 40.0), (0.0, 0.0), (-105.0, 68.0), (np.nan, 68.0)])
def test_a_field_without_room_for_its_areas_is_refused(length, width):
    with pytest.raises(ValueError, match=rf"{length} x {width} m has no room .* expected metres"):
        soccer(length, width)


def test_fields_of_one_size_are_equal_and_others_are_not():
    assert soccer(100.0, 64.0) == soccer(100.0, 64.0)
    assert soccer(100.0, 64.0) != soccer(100.0, 65.0)


def test_a_field_is_frozen():
    with pytest.raises(AttributeError):
        FIELD.length = 100.0
    with pytest.raises(TypeError):
        FIELD.segments["Middle line"] = Point((0.0, 0.0, 0.0))


def test_any_mapping_of_segments_makes_a_field():
    field = Field(10.0, 5.0, {"left": Line((-5, 0, 0), (-5, 1, 0)), "right": Line((5, 0, 0), (5, -1, 0))})
    assert list(field) == ["left", "right"]
    assert field.symmetric == {"left": "right", "right": "left"}


@given(st.floats(0.01, 30.0), st.floats(0.1, 100.0), st.floats(0.05, 7.0))
def test_samples_are_no_farther_apart_than_asked_and_hold_both_ends(spacing, size, span):
    line = Line((1.0, 2.0, 0.0), (1.0 + size, 2.0, 0.0))
    arc = Arc((1.0, 2.0, -3.0), size, start=-span, stop=0.5)
    for segment, step in ((line, spacing), (arc, spacing * (size / 10.0))):
        X = segment.sample(step)
        assert np.max(np.linalg.norm(np.diff(X, axis=0), axis=1)) <= step * (1.0 + 1e-9)
    np.testing.assert_allclose(line.sample(spacing)[[0, -1]], [line.start, line.end], rtol=1e-14)
    on_circle = arc.sample(spacing) - arc.center
    np.testing.assert_allclose(np.linalg.norm(on_circle, axis=1), size, rtol=1e-12)
    np.testing.assert_allclose(np.arctan2(on_circle[-1, 1], on_circle[-1, 0]), 0.5, rtol=1e-9)


def test_an_arc_may_stand_upright():
    upright = Arc((0.0, 0.0, -1.0), 0.5, 0.0, np.pi / 2, u=(0.0, 1.0, 0.0), v=(0.0, 0.0, -1.0))
    np.testing.assert_allclose(upright.sample(10.0)[[0, -1]], [(0.0, 0.5, -1.0), (0.0, 0.0, -1.5)], atol=1e-15)


def test_samples_of_points_are_the_points():
    np.testing.assert_array_equal(Point((1.0, 2.0, 3.0)).sample(), [[1.0, 2.0, 3.0]])
    cloud = PointCloud(np.arange(12.0).reshape(4, 3))
    np.testing.assert_array_equal(cloud.sample(), np.arange(12.0).reshape(4, 3))
    np.testing.assert_array_equal(cloud.X, np.arange(12.0).reshape(4, 3))


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (
            lambda: Line((1.0, 2.0, 0.0), (1.0, 2.0, 0.0)),
            r"two different end points, got start = end = \(1.0, 2.0, 0.0\)",
        ),
        (lambda: Arc((0, 0, 0), 0.0), "radius of an Arc must be a positive number, got 0.0"),
        (lambda: Arc((0, 0, 0), -9.15), "radius of an Arc must be a positive number, got -9.15"),
        (lambda: Arc((0, 0, 0), 9.15, u=(1, 0, 0), v=(1, 0, 0)), "orthogonal unit vectors"),
        (lambda: Arc((0, 0, 0), 9.15, u=(2, 0, 0)), r"orthogonal unit vectors u and v, got u = \(2.0, 0.0, 0.0\)"),
        (lambda: PointCloud([(0.0, 0.0)]), r"\(N, 3\) array with at least one point, got shape \(1, 2\)"),
        (lambda: PointCloud(np.zeros((0, 3))), r"at least one point, got shape \(0, 3\)"),
        (lambda: PointCloud([(0, 0, 0), (1, 0, 0)], ordered=True), r"at least three points .*got shape \(2, 3\)"),
    ],
)
def test_impossible_segments_are_refused(build, message):
    with pytest.raises(ValueError, match=message):
        build()


def test_segments_are_values():
    assert Line((0, 0, 0), (1, 0, 0)) == Line((0, 0, 0), (1, 0, 0))
    assert len({Arc((0, 0, 0), 1.0), Arc((0, 0, 0), 1.0), Arc((0, 0, 0), 2.0)}) == 2
    assert PointCloud(np.eye(3)) == PointCloud(((1, 0, 0), (0, 1, 0), (0, 0, 1)))
    with pytest.raises(AttributeError):
        Point((0, 0, 0)).X = (1, 0, 0)


def test_a_field_can_be_sent_to_another_process():
    field = soccer(100.0, 64.0)
    other = pickle.loads(pickle.dumps(field))
    assert other == field
    assert dict(other.symmetric) == dict(field.symmetric)
    with pytest.raises(TypeError):
        other.segments["new"] = field["Middle line"]
