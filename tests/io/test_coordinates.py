"""Field points whose origin is a corner, or whose unit is not the metre, are found out; others are left alone."""

import json
import time

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from strategies import bounded, examples, moved, numbers

from fieldcalib import Camera, calibrate_from_homography, calibrate_from_points, soccer
from fieldcalib.fields import CameraDistribution
from fieldcalib.io.wc14 import parse_homography
from fieldcalib.solve.origin_and_unit import LEAST_POINTS, UNITS, looks_like_a_quadrant, other_reading

SIZE = (960, 540)
CAMERA = Camera.from_angles(-0.35, 1.36, 0.01, 1500.0, (1.5, 68.0, -17.0), SIZE)
LEFT_AREA = np.array([p.X for name, p in soccer().points.items() if name.startswith(("L_PENALTY", "L_GOAL_AREA"))])
XY = CAMERA.project(LEFT_AREA)


def points_of(length, width):
    return np.array([point.X for point in soccer(length, width).points.values()])


lengths, widths = numbers(90.0, 120.0), numbers(46.0, 89.0)


def some_of(least):
    """Indices of `least` or more of the 39 points of a pitch."""
    return st.sets(st.integers(0, 38), min_size=least).map(sorted)


@given(
    length=lengths,
    width=widths,
    points=some_of(1),
    quadrant=st.sampled_from([None, (1, 1), (1, -1), (-1, 1), (-1, -1)]),
)
@examples(80)
def test_true_points_are_never_complained_about(length, width, points, quadrant):
    """Any part of any field, from one point to all of them, of one quadrant too."""
    X = points_of(length, width)[points]
    if quadrant is not None:
        X = X[np.all(X[:, :2] * quadrant >= 0.0, axis=1)]
    assume(len(X))
    assert other_reading(X) is None
    assert not looks_like_a_quadrant(X)


# Of one point, of few and of many: no grid and no marking.
SCATTERED = np.random.default_rng(0).uniform(-0.8, 0.8, (30, 3))


@given(
    X=st.integers(1, 30).flatmap(lambda count: moved(SCATTERED[:count], 0.2)),
    middle=bounded(3, -30.0, 30.0),
    extent=numbers(0.1, 60.0),
    digits=st.integers(0, 3),
)
@examples(80)
def test_points_of_anything_else_are_left_alone(X, middle, extent, digits):
    X = (middle + extent * X).round(digits)
    assert other_reading(X) is None


@pytest.mark.parametrize("spacing", [0.025, 0.5, 1.0, 5.0, 10.0])
def test_a_grid_is_left_alone(spacing):
    x, y = np.meshgrid(np.arange(6.0), np.arange(5.0))
    grid = spacing * np.column_stack([x.ravel(), y.ravel(), np.zeros(30)])
    for origin in ((0.0, 0.0, 0.0), (24.0, 26.0, 0.0), (-20.0, -12.0, 0.0)):
        assert other_reading(grid + origin) is None


@given(
    unit=st.sampled_from(list(UNITS)),
    corner=st.booleans(),
    length=lengths,
    width=widths,
    points=some_of(15),
)
@examples(60)
def test_other_origins_and_units_are_named(unit, corner, length, width, points):
    assume(corner or unit != "metres")
    X = points_of(length, width)[points]
    given_as = (X + (corner * length / 2.0, corner * width / 2.0, 0.0)) / UNITS[unit]
    reading = other_reading(given_as)
    assert (reading.unit, reading.corner) == (unit, corner)
    if corner:
        assert reading.width == pytest.approx(width, abs=0.3)
        if np.max(X[:, 0]) > 0.0 > np.min(X[:, 0]):  # markings of one half alone do not tell where the other goal is
            assert reading.length == pytest.approx(length, abs=0.3)


@pytest.mark.parametrize(
    ("factor", "origin", "message"),
    [
        (1.0, (52.5, 34.0, 0.0), r"look like metres from a corner: 9 of 9 lie on markings then, and [01] as metres .* "
         r"give X - \(52.5, 34, 0\), with y growing towards the main camera"),
        (1.0 / 0.9144, (52.5, 34.0, 0.0), r"look like yards from a corner: .* give 0.9144 \* X - "),
        (100.0, (52.5, 34.0, 0.0), r"look like centimetres from a corner: .* give 0.01 \* X - \(52.5, 34, 0\)"),
        (100.0, (0.0, 0.0, 0.0), r"look like centimetres from the centre mark: .* give 0.01 \* X, with"),
        (1.0 / 0.3048, (0.0, 0.0, 0.0), r"look like feet from the centre mark: .* give 0.3048 \* X, with"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("prior", ["all", "main center"])
def test_the_message_says_what_to_subtract_and_to_multiply(factor, origin, message, prior):
    X = factor * (LEFT_AREA + origin)
    with pytest.raises(ValueError, match=message):
        calibrate_from_points(X, XY, SIZE, prior=prior)


@pytest.mark.parametrize("unit", ["metres", "centimetres"])
def test_the_points_of_roboflow_are_better_named(unit):
    """Its `vertices`: 41 x 20.15 m penalty areas on 120 x 70 m."""
    metres = np.array(
        [(0.0, 14.5), (0.0, 25.84), (5.5, 25.84), (11.0, 35.0), (20.15, 14.5), (20.15, 55.5), (60.0, 25.85)]
    )
    X = np.column_stack([metres, np.zeros(7)]) / UNITS[unit]
    with pytest.raises(ValueError, match=rf"look like {unit} from a corner: 7 of 7 .* `key_points` has its points"):
        calibrate_from_points(X, XY[:7], SIZE)


def test_without_a_field_in_mind_nothing_is_asked():
    X = LEFT_AREA + (52.5, 34.0, 0.0)
    assert calibrate_from_points(X, XY, SIZE, prior=None).accepted
    own = CameraDistribution("tower", (-45, 45), (45, 90), (-10, 10), (8.2, 90), (30, 80), (80, 120), (-40, -5))
    assert calibrate_from_points(X, XY, SIZE, prior=own).accepted


def test_points_that_hit_no_marking_but_reach_beyond_half_a_field_get_a_warning():
    X = np.array([(1.0, 2.0, 0.0), (30.0, 20.0, 0.0), (3.0, 60.0, 0.0), (27.0, 52.0, 0.0), (8.0, 40.0, 0.0)])
    xy = Camera.from_angles(-0.35, 1.36, 0.01, 900.0, (52.5, 102.0, -17.0), SIZE).project(X)
    with pytest.warns(UserWarning, match="if their origin is a corner of the field, subtract half its length"):
        calibrate_from_points(X - (0.0, 2.0, 0.0), xy, SIZE)


def test_many_points_take_no_time():
    X = np.random.default_rng(0).uniform(-30.0, 30.0, size=(20_000, 3))
    start = time.perf_counter()
    assert other_reading(X) is None
    assert time.perf_counter() - start < 1.0  # each against each would take minutes


FROM_CORNER = np.array([[1.0, 0.0, -52.5], [0.0, 1.0, -34.0], [0.0, 0.0, 1.0]])


@pytest.mark.parametrize("pan", [-0.35, 0.0, 0.3])
def test_a_homography_from_a_corner_is_said_to_be_one(pan):
    camera = Camera.from_angles(pan, 1.36, 0.01, 1500.0, (1.5, 68.0, -17.0), SIZE)
    assert "origin" not in calibrate_from_homography(camera.homography, SIZE).message
    moved = calibrate_from_homography(camera.homography @ FROM_CORNER, SIZE)
    assert moved.message.endswith("give H @ [[1, 0, length / 2], [0, 1, width / 2], [0, 0, 1]]")


@pytest.mark.parametrize(("unit", "per_metre"), [("feet", 3.28084), ("centimetres", 100), ("millimetres", 1000)])
@pytest.mark.parametrize("corner", [False, True])
def test_a_homography_in_another_unit_is_said_to_be_one(unit, per_metre, corner):
    moved = (
        CAMERA.homography @ (FROM_CORNER if corner else np.eye(3)) @ np.diag([1.0 / per_metre, 1.0 / per_metre, 1.0])
    )
    message = calibrate_from_homography(moved, SIZE).message
    origin = "far left corner" if corner else "centre mark"
    remedy = f"give H @ np.diag([{per_metre:g}, {per_metre:g}, 1])" + corner * (
        " @ [[1, 0, length / 2], [0, 1, width / 2], [0, 0, 1]]"
    )
    assert message.endswith(f"if H maps {unit} from the {origin}: then {remedy}")
    names = {"length": 105.0, "width": 68.0, "np": np, "H": moved}
    mended = eval(remedy.removeprefix("give "), names)  # what the message says, to the letter
    np.testing.assert_allclose(calibrate_from_homography(mended, SIZE).camera.C, CAMERA.C, rtol=1e-4)


def test_a_homography_in_yards_could_be_of_metres():
    message = calibrate_from_homography(CAMERA.homography @ np.diag([0.9144, 0.9144, 1.0]), SIZE).message
    assert "if H maps" not in message


@pytest.mark.slow
def test_real_homographies_from_a_corner(shared_data):
    said = accepted = 0
    paths = sorted((shared_data / "wc14-test").glob("*.homographyMatrix"))
    for path in paths:
        H = parse_homography(path.read_bytes())
        assert "origin of H" not in calibrate_from_homography(H, (1280, 720)).message
        for unit in UNITS:
            scaled = calibrate_from_homography(H @ np.diag([UNITS[unit], UNITS[unit], 1.0]), (1280, 720))
            assert (f"maps {unit} from the centre mark" in scaled.message) == (unit not in ("metres", "yards"))
            assert "pixels to metres" not in scaled.message
        assert "pixels to metres" in calibrate_from_homography(np.linalg.inv(H), (1280, 720)).message
        moved = calibrate_from_homography(H @ FROM_CORNER, (1280, 720))
        accepted += moved.accepted
        said += moved.accepted and "origin of H" in moved.message
    assert len(paths) == 93
    assert said > 0.85 * accepted > 30


@pytest.mark.slow
def test_real_points_from_a_corner(shared_data):
    """Labelled points of real frames, as every other tool would give them."""
    folder = shared_data / "pitch-keypoints"
    places = json.loads((folder / "keypoints_105x68.json").read_text())
    places = np.array([[*places[str(index)], 0.0] for index in range(len(places))])
    frames = missed = 0
    for path in sorted((folder / "valid").glob("*.txt")):
        seen = np.array(path.read_text().split(), dtype=float)[5:].reshape(-1, 3)[:, 2] == 2
        X = places[seen]
        if len(X) < LEAST_POINTS:
            continue
        frames += 1
        assert other_reading(X - (52.5, 34.0, 0.0)) is None
        missed += sum(other_reading(factor * X) is None for factor in (1.0, 1.0 / 0.9144, 100.0))
    assert frames > 50
    assert missed <= 0.05 * 3 * frames
