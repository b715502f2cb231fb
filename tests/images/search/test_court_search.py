"""Courts found in pictures by search: stripes, long lines, hypotheses, and the ranked cameras."""

import json
from itertools import combinations
from pathlib import Path

import cv2
import numpy as np
import pytest
from commands import run
from hypothesis import given
from hypothesis import strategies as st
from numdiff import central_differences, column_errors
from pictures import picture
from strategies import angle, examples, numbers, operated_angles, vectors

import fieldcalib
from data_tools.court_truth import court_frames, crossing, distances
from data_tools.nonsense import nonsense
from data_tools.score_courts import Truth
from fieldcalib import KNOWN_INTRINSICS_FLAGS, Camera, Field, Line, calibrate_from_images, calibrate_video
from fieldcalib.assess.findings import Verdict, What
from fieldcalib.assess.probability import largest_move
from fieldcalib.draw import draw_field
from fieldcalib.fields import american_football, badminton, basketball, futsal, rugby_union, tennis, volleyball
from fieldcalib.fields.catalogue import field_named
from fieldcalib.fields.traits import LineLook
from fieldcalib.geometry.rotation import rotation_from_angles
from fieldcalib.images.search import cameras_from_curves
from fieldcalib.images.search.court_hypotheses import Cameras, FieldLines, hypotheses, on_canonical_side
from fieldcalib.images.search.court_search import find_courts
from fieldcalib.images.search.long_lines import Bend, LongLines, bend_of, long_lines
from fieldcalib.images.search.stripe_likelihood import (
    HALF_SEEN,
    SEEN,
    Freedom,
    MarkingPoints,
    StripeMaps,
    derivatives,
    moved,
    projected,
    pulled,
)
from fieldcalib.images.search.stripes import StripeColours, Stripes, find_stripes
from fieldcalib.io.videos import VideoReader
from fieldcalib.localize import SegmentationNetwork

SIZE = (1280, 720)
TENNIS = Camera.from_angles(np.radians(92), np.radians(76), 0.01, 2300.0, (-38.0, 1.0, -10.0), SIZE)
BADMINTON = Camera.from_angles(np.radians(104), np.radians(72), 0.0, 1700.0, (-16.0, -4.0, -6.0), SIZE)
VOLLEYBALL = Camera.from_angles(np.radians(-8), np.radians(68), -0.01, 1500.0, (-2.0, 19.0, -8.0), SIZE)
COURTS = {
    "tennis": (tennis(), TENNIS),
    "badminton": (badminton(), BADMINTON),
    "volleyball": (volleyball(), VOLLEYBALL),
    "barrel lens": (tennis(), Camera(TENNIS.K, TENNIS.R, TENNIS.C, SIZE, (-0.3, 0.0))),
}


def turned(camera):
    """The same view from the other side."""
    turn = np.array([-1.0, -1.0, 1.0])
    return Camera(camera.K, camera.R * turn, camera.C * turn, camera.image_size, camera.dist)


# Stripes and lines


def drawn(*lines, ground=90, paint=200, width=4):
    image = np.full((240, 320, 3), ground, np.uint8)
    for start, end in lines:
        cv2.line(image, start, end, (paint,) * 3, width, cv2.LINE_AA)
    return image


@pytest.mark.parametrize("degrees", [0, 10, 37, 45, 80, 90, 120, 165])
@pytest.mark.parametrize("width", [2, 5, 9])
def test_stripes_run_along_a_line_in_its_middle(degrees, width):
    along = np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])
    start, end = (tuple(np.round((160, 120) + t * along).astype(int).tolist()) for t in (-100, 100))
    stripes = find_stripes(drawn((start, end), width=width))
    towards = np.subtract(end, start) / np.linalg.norm(np.subtract(end, start))
    place = (stripes.xy - start) @ towards
    inner = (place > 15) & (place < 185)
    assert np.count_nonzero(inner) > 100
    assert np.max(np.abs((stripes.xy - start)[inner] @ (-towards[1], towards[0]))) < 0.8
    off = stripes.angle[inner] - np.arctan2(towards[1], towards[0])
    assert np.max(np.abs(off - np.pi * np.round(off / np.pi))) < np.radians(4)


def test_dark_stripes_are_found_when_they_are_asked_for():
    image = drawn(((20, 120), (300, 120)), ground=200, paint=90)
    assert not len(find_stripes(image).xy)
    assert len(find_stripes(image, lighter=False).xy) > 200


def test_stripes_of_either_kind_and_edges_of_areas_are_found_when_they_are_asked_for():
    image = drawn(((60, 20), (60, 220)), paint=200)
    image[:, 100:] = 40
    cv2.line(image, (200, 20), (200, 220), (10, 10, 10), 4)
    columns = find_stripes(image, lighter=None).xy[:, 0]
    for line in (60.0, 99.5, 200.0):
        assert np.count_nonzero(np.abs(columns - line) < 1.0) > 150


def test_the_border_of_an_area_is_no_stripe_but_a_line_between_two_areas_is():
    image = np.full((240, 320, 3), 60, np.uint8)
    image[:, 160:] = 120
    assert not len(find_stripes(image).xy)
    image[:, 158:162] = 230
    assert len(find_stripes(image).xy) > 200


def test_long_lines_come_in_the_order_of_their_lengths():
    lines = long_lines(find_stripes(drawn(((20, 60), (300, 60)), ((50, 100), (60, 230)), ((200, 100), (260, 180)))), 9)
    assert len(lines) == 3
    assert np.all(np.diff(lines.length) < 0)
    assert abs(lines.offset[0] * lines.normal[0, 1] - 60) < 0.5
    np.testing.assert_allclose(np.sort(lines.ends[0, :, 0]), (20, 300), atol=16)


# Hypotheses


def seen_lines(camera, across, along):
    """Lines of a field at these x and y, as a camera without a lens sees them."""
    homogeneous, ends = [], []
    for axis, values in enumerate((across, along)):
        for value in values:
            X = np.zeros((2, 3))
            X[:, axis], X[:, 1 - axis] = value, (-2.0, 2.0)
            xy = camera.project(X)
            line = np.cross(*np.column_stack([xy, np.ones(2)]))
            homogeneous.append(line / np.linalg.norm(line[:2]))
            ends.append(xy)
    homogeneous = np.array(homogeneous)
    return LongLines(homogeneous[:, :2], -homogeneous[:, 2], np.array(ends), np.full(len(ends), 100.0))


def nearest(cameras, truth):
    """How far the nearest of B cameras, or its twin, stands from the true one, in shares of its distance."""
    off = [np.linalg.norm(cameras.C - one.C, axis=1) for one in (truth, turned(truth))]
    return np.min(off, initial=np.inf) / np.linalg.norm(truth.C)


@pytest.mark.parametrize(("field", "camera"), list(COURTS.values())[:3], ids=list(COURTS)[:3])
def test_two_pairs_of_lines_give_the_camera(field, camera):
    lines = FieldLines.of(field)
    for x in list(combinations(lines.across, 2))[::3]:
        for y in list(combinations(lines.along, 2))[::3]:
            assert nearest(hypotheses(seen_lines(camera, x, y), field, SIZE), camera) < 1e-6, (x, y)


@pytest.mark.parametrize("camera", [VOLLEYBALL, turned(VOLLEYBALL)], ids=["near side", "far side"])
def test_a_field_that_tells_its_ends_apart_is_seen_from_both_sides(camera):
    lines = {f"across {x}": Line((x, -6.0, 0.0), (x, 6.0, 0.0)) for x in (-10.0, 2.0, 10.0)}
    lines |= {f"along {y}": Line((-10.0, y, 0.0), (10.0, y, 0.0)) for y in (-6.0, 6.0)}
    field = Field(20.0, 12.0, lines, stands=tennis().stands, farthest_camera=80.0)
    found = hypotheses(seen_lines(camera, (2.0, 10.0), (-6.0, 6.0)), field, SIZE)
    off = [np.min(np.linalg.norm(found.C - one.C, axis=1)) for one in (camera, turned(camera))]
    assert off[0] < 1e-6
    assert off[1] > 0.1


def test_the_principal_point_may_be_elsewhere():
    K = VOLLEYBALL.K + np.array([[0.0, 0.0, 0.25 * SIZE[0]], [0.0, 0.0, -0.125 * SIZE[0]], [0.0, 0.0, 0.0]])
    camera = Camera(K, VOLLEYBALL.R, VOLLEYBALL.C, SIZE)
    lines = seen_lines(camera, (-2.975, 8.975), (-4.475, 4.475))
    found = hypotheses(lines, volleyball(), SIZE, -0.125)
    assert nearest(found, camera) < 1e-6
    best = found.camera(int(np.argmin(np.linalg.norm(found.C - camera.C, axis=1))))
    np.testing.assert_allclose(best.project([1.0, 2.0, 0.0]), camera.project([1.0, 2.0, 0.0]))
    assert nearest(hypotheses(lines, volleyball(), SIZE), camera) > 1e-3


def test_hypotheses_stand_where_cameras_do():
    lines = FieldLines.of(tennis())
    found = hypotheses(seen_lines(TENNIS, lines.across, lines.along), tennis(), SIZE)
    assert len(found) > 10
    assert np.all(found.C[:, 2] < 0.0)
    assert np.max(np.linalg.norm(found.C, axis=1)) < tennis().farthest_camera
    np.testing.assert_allclose(on_canonical_side(found, tennis()).C, found.C)


@pytest.mark.parametrize(
    ("x", "y"), [((-2.975, 2.975), (4.475,)), ((8.975,), (-4.475, 4.475))], ids=["two across", "two along"]
)
def test_three_lines_and_a_focal_length_give_the_camera(x, y):
    level = Camera.from_angles(np.radians(-20), np.radians(68), 0.0, 1.0, (-3.0, 19.0, -8.0), SIZE)
    lengths = cameras_from_curves.focal_lengths(volleyball()) * SIZE[0]
    f = lengths[np.argmin(np.abs(lengths - 1500.0))]
    camera = Camera([[f, 0.0, 640.0], [0.0, f, 360.0], [0.0, 0.0, 1.0]], level.R, level.C, SIZE)
    found = cameras_from_curves.few_line_hypotheses(seen_lines(camera, x, y), volleyball(), SIZE)
    assert nearest(found, camera) < 1e-6
    assert len(found) < 400


def test_a_picture_without_the_distortion_of_a_wide_lens_is_wider_than_cameras_see():
    level = Camera.from_angles(0.0, np.radians(73), 0.0, 1.0, (0.0, 18.0, -6.5), SIZE)
    lengths = cameras_from_curves.focal_lengths(volleyball(), 1.7) * SIZE[0]
    assert lengths[0] < 0.5 * SIZE[0]
    camera = Camera([[lengths[0], 0.0, 640.0], [0.0, lengths[0], 360.0], [0.0, 0.0, 1.0]], level.R, level.C, SIZE)
    lines = seen_lines(camera, (-8.975, 8.975), (4.475,))
    assert nearest(cameras_from_curves.few_line_hypotheses(lines, volleyball(), SIZE, 1.7), camera) < 1e-6
    assert nearest(cameras_from_curves.few_line_hypotheses(lines, volleyball(), SIZE), camera) > 0.05


def test_a_line_longer_than_its_marking_is_another_line():
    lines = seen_lines(VOLLEYBALL, (-2.975, 2.975), (4.475,))
    ends = lines.ends.copy()
    ends[2] = VOLLEYBALL.project([(-14.0, 4.475, 0.0), (14.0, 4.475, 0.0)])
    longer = LongLines(lines.normal, lines.offset, ends, lines.length)
    near = nearest(cameras_from_curves.few_line_hypotheses(lines, volleyball(), SIZE), VOLLEYBALL)
    assert near < 0.1
    assert nearest(cameras_from_curves.few_line_hypotheses(longer, volleyball(), SIZE), VOLLEYBALL) > 3.0 * near


def test_cameras_are_pulled_onto_stripes():
    stripes = find_stripes(picture(VOLLEYBALL, volleyball()))
    turn = Camera.from_angles(np.radians(-8.4), np.radians(68.3), -0.01, 1560.0, (-2.3, 19.3, -8.2), SIZE)
    start = Cameras.of([turn], SIZE)
    near = pulled(start, StripeMaps.of(stripes), MarkingPoints.of(volleyball(), 60), Freedom(0.02))
    X = np.array([(x, y, 0.0) for x in (-8.975, -2.975, 2.975) for y in (-4.475, 4.475)])
    off = [np.linalg.norm(one.project(X) - VOLLEYBALL.project(X), axis=1) for one in (turn, near.camera(0))]
    assert np.median(off[0]) > 15.0
    assert np.median(off[1]) < 3.0


@given(operated_angles(), numbers(0.0, 2.0), vectors([-0.1] * 2, [0.1] * 2), st.floats(0.0, 2.0 * np.pi))
def test_derivatives_by_what_is_pulled_against_central_differences(angles, log_zoom, off, direction):
    K = np.diag([700.0 * np.exp(log_zoom)] * 2 + [1.0])
    K[:2, 2] = (0.5 + off) * SIZE
    camera = Camera(K, rotation_from_angles(angles), (3.0, 25.0, -9.0), SIZE)
    X = camera.C + 30.0 * np.array([(0.1, -0.2, 1.0), (-0.3, 0.1, 1.5), (0.2, 0.2, 0.6)]) @ camera.R
    n = np.array([np.cos(direction), np.sin(direction)])

    def seen(steps):
        cameras = moved(Cameras.of([camera] * len(steps), SIZE), steps)
        u, v, depth = np.moveaxis(cameras.projections @ np.column_stack([X, np.ones(3)]).T, 1, 0)
        return (n[0] * u + n[1] * v) / depth

    numeric = central_differences(seen, np.zeros((1, 9)), [1e-3] * 4 + [1e-2] * 5)[0]
    (J,) = derivatives(
        Cameras.of([camera], SIZE), X, camera.project(X).T[:, None], np.tile(n[:, None, None], (1, 1, 3))
    )
    assert np.all(column_errors(J.T, numeric, 1e-3) < 1e-7)


# Lenses


@pytest.mark.parametrize(
    "k", [(0.0, 0.0), (-0.35, 0.1), pytest.param((-0.7, 0.4), marks=pytest.mark.slow)], ids=["none", "barrel", "strong"]
)
def test_the_bend_of_a_picture_is_that_of_its_lens(k):
    wide = Camera.from_angles(np.radians(92), np.radians(76), 0.01, 1380.0, (-22.8, 0.6, -6.0), SIZE)
    camera = Camera(wide.K, wide.R, wide.C, SIZE, k)
    bend = bend_of(find_stripes(picture(camera, tennis())))
    a1, a2 = bend.with_lens(wide).corner_distortion
    assert a1 + a2 == pytest.approx(np.sum(camera.corner_distortion), abs=0.03)


def test_a_camera_of_the_straight_picture_gets_the_lens_of_the_bend():
    bend = Bend(0.24, SIZE)
    X = np.array([(x, y, 0.0) for x in (-11.885, 0.0, 11.885) for y in (-5.485, 5.485)])
    xy = TENNIS.project(X)
    np.testing.assert_allclose(bend.with_lens(TENNIS).project(X), bend.bent(xy), atol=1.0)


# Colours


def test_the_paints_of_a_hall_are_told_apart():
    white, blue, floor = [230.0, 235.0, 230.0], [170.0, 90.0, 60.0], [120.0, 170.0, 205.0]
    on_line = np.repeat(np.arange(7), 50)
    paint = np.where((on_line < 4)[:, None], white, blue)
    mixed = floor + np.random.default_rng(0).uniform(0.4, 1.0, (350, 1)) * (paint - floor)
    colours = StripeColours(mixed, np.tile(floor, (350, 2, 1)))
    found = colours.paints([on_line == k for k in range(7)])
    assert [np.unique(on_line[one]).tolist() for one in found] == [[0, 1, 2, 3], [4, 5, 6]]


def test_lines_are_of_one_paint_if_one_of_them_shows_it():
    """The longest line of a paint shows it least purely: a third of its stripes point elsewhere, and most clearly."""
    black, blue, floor = (np.array(one) for one in ([20.0, 20.0, 20.0], [170.0, 90.0, 60.0], [120.0, 170.0, 205.0]))
    on_line = np.repeat(np.arange(7), 50)
    paint = floor + 0.5 * np.where((on_line < 4)[:, None], black - floor, blue - floor)
    of_third = np.flatnonzero(on_line == 4)
    paint[of_third[::3]] = floor + [120.0, -60.0, -60.0]  # the pure ones, of another hue
    colours = StripeColours(paint, np.tile(floor, (350, 2, 1)))
    lines = [on_line == k for k in range(7)]
    like = colours.are_like(lines[4])
    assert np.mean(like[on_line == 5]) < 0.6 <= np.mean(colours.are_like(lines[5])[of_third])
    black_ones, blue_ones = colours.paints(lines)
    assert not np.any(black_ones & blue_ones)
    assert np.all(blue_ones[on_line > 4])


def test_projections_are_those_of_cameras():
    cameras = Cameras(np.array([2300.0]), np.array([[640.0, 360.0]]), TENNIS.R[None], TENNIS.C[None], SIZE)
    points = MarkingPoints.of(tennis(), 50)
    x, y, direction, length, seen = projected(cameras.projections.astype(np.float32), points)
    np.testing.assert_allclose(np.column_stack([x[0], y[0]]), TENNIS.project(points.X), atol=0.01)
    ahead = TENNIS.project(points.X + 1e-4 * points.along) - TENNIS.project(points.X)
    np.testing.assert_allclose(np.tan(direction[0] - np.arctan2(*ahead.T[::-1])), 0.0, atol=1e-3)
    np.testing.assert_allclose(length[0], np.linalg.norm(ahead, axis=1) / 1e-4 * points.spacing, rtol=1e-2)
    beside = TENNIS.project(points.X + 1e-4 * np.cross(points.along, (0.0, 0.0, 1.0))) - TENNIS.project(points.X)
    turn = np.column_stack([-np.sin(direction[0]), np.cos(direction[0])])
    width = np.abs(np.sum(beside * turn, axis=1)) / 1e-4 * points.width
    np.testing.assert_allclose(seen[0], SEEN * width / (width + HALF_SEEN), rtol=1e-2)


def test_points_of_dashed_markings_lie_on_dashes():
    field = rugby_union()
    points = MarkingPoints.of(field, 3000)
    dashed = field["10-metre line right"].vectors[0][0]
    on = np.flatnonzero(np.abs(points.X[:, 0] - dashed) < 0.01)
    assert len(on) > 20
    off = points.X[on, 1] - 10.0 * np.round(points.X[on, 1] / 10.0)  # dashes and gaps of 5 m
    assert np.max(np.abs(off)) < 2.6
    assert np.sum(points.spacing[on]) == pytest.approx(0.5 * field.width, rel=0.1)


def test_the_points_of_a_field_stand_for_all_of_its_lines():
    field = tennis()
    points = MarkingPoints.of(field, 100)
    ground = [s for s in field.markings.values() if not np.any(s.vectors[:, 2])]
    total = sum(np.linalg.norm(segment.vectors[1]) for segment in ground)
    assert abs(np.sum(points.spacing) - total) < 0.02 * total
    assert 80 <= len(points.X) <= 120


def test_the_true_camera_is_likelier_than_others():
    image = picture(TENNIS, tennis())
    maps, points = StripeMaps.of(find_stripes(image)), MarkingPoints.of(tennis(), 300)
    pans = np.radians(np.array([0.0, 0.3, 1.0, 3.0]))
    others = [Camera.from_angles(pan + TENNIS.angles[0], *TENNIS.angles[1:], 2300.0, TENNIS.C, SIZE) for pan in pans]
    parts = [(2300.0, (640.0, 360.0), one.R, one.C) for one in others]
    cameras = Cameras(*map(np.array, zip(*parts, strict=True)), SIZE)
    score = maps.scores(cameras, points)
    assert np.all(np.diff(score) < -10)
    assert abs(maps.score(TENNIS, points)[0] - score[0]) < 0.02 * score[0]


def test_what_is_above_the_ground_tells_cameras_apart():
    field = basketball("nba")
    camera = Camera.from_angles(0.3, np.radians(72), 0.0, 1700.0, (2.0, 28.0, -9.0), SIZE)
    points = MarkingPoints.of(field, 300, are_above=True)
    assert np.all(points.X[:, 2] < -2.0)  # rims and backboards
    ahead, xy = camera.project(points.X + 0.01 * points.along), camera.project(points.X)
    seen = np.all((xy > 0.0) & (xy < SIZE), axis=1)
    angle = np.mod(np.arctan2(*(ahead - xy).T[::-1]), np.pi)[seen]
    maps = StripeMaps.of(Stripes(xy[seen], angle, np.full(len(angle), 50.0), SIZE))
    right, weight, shown = maps.score(camera, points)
    assert right > 2.0 * shown > weight > 10.0
    assert maps.score(camera.moved(camera.R, camera.C + (1.0, 0.0, 0.0)), points)[0] < 0.2 * right


# The search


@pytest.mark.parametrize(
    ("field", "camera"),
    [
        pytest.param(*court, id=name, marks=pytest.mark.slow if name in ("badminton", "barrel lens") else ())
        for name, court in COURTS.items()
    ],
)
def test_a_rendered_court_is_found(field, camera):
    found = find_courts(picture(camera, field), field)
    assert found[0].calibration.accepted
    assert Truth(camera, field).distance(found[0].calibration.required_camera) < 1.0
    assert found[0].probability > 0.9
    assert all(one.probability <= found[0].probability for one in found)
    twin = found[0].twin
    X = np.array([1.0, 2.0, 0.0])
    np.testing.assert_allclose(twin.project(-X), found[0].calibration.required_camera.project(X))


def test_a_net_tells_a_near_camera_from_a_far_one_where_three_lines_are_in_view():
    field = field_named("beach-volleyball")  # dark lines, and a white net
    camera = Camera.from_angles(np.radians(-35), np.radians(65), 0.0, 1300.0, (2.0, 15.0, -8.0), SIZE)
    best, *others = find_courts(picture(camera, field), field)
    assert best.calibration.verdict == Verdict.GOOD
    assert Truth(camera, field).distance(best.calibration.required_camera) < 1.0
    assert Truth(camera, field).distance(others[0].calibration.required_camera) > 20.0  # explains the three lines too
    assert others[0].evidence.score > 0.9 * best.evidence.score
    assert others[0].evidence.runner_up > best.evidence.runner_up + 0.1


@pytest.mark.parametrize("width", [426, pytest.param(1920, marks=pytest.mark.slow)])
def test_pictures_of_any_size_are_searched_alike(width):
    size = (width, width * 9 // 16)
    image = cv2.resize(picture(TENNIS, tennis()), size, interpolation=cv2.INTER_AREA)
    found = find_courts(image, tennis())
    assert found[0].calibration.accepted
    assert found[0].calibration.required_camera.image_size == size
    assert Truth(TENNIS.scaled(size), tennis()).distance(found[0].calibration.required_camera) < 2.0


@pytest.mark.parametrize("size", [(1, 1), (1, 900), (900, 1), (40, 3000), (3, 5)])
def test_pictures_of_odd_shapes_have_no_court(size):
    noise = np.random.default_rng(0).integers(0, 256, (*size, 3), dtype=np.uint8)
    assert not any(one.calibration.accepted for one in find_courts(noise, tennis()))


def test_a_dark_court_is_found():
    field = tennis()
    dark = Field(field.length, field.width, field.segments, stands=field.stands, lines=LineLook(0.05, lighter=False))
    found = find_courts(255 - picture(TENNIS, tennis()), dark)
    assert Truth(TENNIS, field).distance(found[0].calibration.required_camera) < 1.0


def test_a_court_whose_areas_are_painted_is_found_without_any_line():
    field = volleyball()
    image = np.full((*SIZE[::-1], 3), 60, np.uint8)
    for half_length, level in ((9.0, 180), (3.0, 120)):
        corners = [(x, y, 0.0) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1)) * np.array([half_length, 4.5])]
        cv2.fillPoly(image, [np.round(VOLLEYBALL.project(corners)).astype(int)], (level,) * 3, cv2.LINE_AA)
    assert len(find_stripes(image).xy) < 100  # at corners
    found = find_courts(image, field)[0]
    assert found.calibration.field.lines.lighter is None
    assert Truth(VOLLEYBALL, field).distance(found.calibration.required_camera) < 3.0


@pytest.mark.parametrize(
    "other",
    [tennis(), *(pytest.param(other, marks=pytest.mark.slow) for other in (badminton(), basketball("fiba")))],
    ids=["tennis", "badminton", "basketball"],
)
def test_the_court_of_another_sport_is_not_accepted(other):
    assert not any(one.calibration.accepted for one in find_courts(picture(VOLLEYBALL, volleyball()), other))


@pytest.mark.parametrize("seed", [1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (0, 2, 3, 4, 5, 6))])
def test_pictures_without_a_field_have_no_court(seed):
    assert not any(one.calibration.accepted for one in find_courts(nonsense(seed), badminton()))


@pytest.mark.slow
def test_the_size_of_a_field_that_varies_is_estimated():
    hall, field = Camera.from_angles(0.05, 1.2, 0.0, 1000.0, (2.0, 24.0, -9.0), SIZE), futsal(42.0, 22.0)
    image = picture(hall, field)
    found = find_courts(image, futsal())[0].calibration
    assert found.accepted
    assert (found.field.length, found.field.width) == pytest.approx((42.0, 22.0), abs=0.2)
    assert Truth(hall, field).distance(found.required_camera) < 1.0
    (given,) = calibrate_from_images(futsal(), [image], estimate_size=False)
    assert (given.field or futsal()) == futsal()


@pytest.mark.slow
def test_yard_lines_that_look_alike_have_alternatives():
    stand = Camera.from_angles(0.03, 1.25, 0.0, 1500.0, (3.0, 75.0, -22.0), SIZE)
    field = american_football("nfl")  # no end is in view
    best = find_courts(picture(stand, field), field)[0]
    assert best.calibration.accepted
    assert best.calibration.verdict == Verdict.CHECK
    assert "4.572 m" in best.calibration.reason
    assert len(best.moved) > 4
    cameras = (best.calibration.required_camera, *best.moved)
    assert min(Truth(stand, field).distance(camera) for camera in cameras) < 1.0


@pytest.mark.slow
def test_images_without_a_network_are_searched():
    image = picture(TENNIS, tennis())
    boxed = np.pad(image[:, 40:-40], ((0, 0), (80, 80), (0, 0)))  # a pillarbox
    shaded = np.broadcast_to(np.linspace(40, 90, image.shape[0]).astype(np.uint8)[:, None, None], image.shape).copy()
    found = calibrate_from_images(tennis(), [image, boxed, shaded, np.zeros_like(image)])
    assert [one.accepted for one in found] == [True, True, False, False]
    assert Truth(TENNIS, tennis()).distance(found[0].required_camera) < 1.0
    shown = found[1].required_camera.cropped((40, 0), SIZE)
    assert Truth(TENNIS, tennis()).distance(shown) < 1.0
    assert found[2].camera is None
    assert "two lines across" in found[2].message
    assert found[3].camera is None
    assert "the picture shows nothing" in found[3].message


@pytest.mark.slow
def test_a_clip_of_a_court_needs_no_network():
    pans = np.radians([0.0, 0.2, 0.4])
    cameras = [Camera.from_angles(TENNIS.angles[0] + pan, *TENNIS.angles[1:], 2300.0, TENNIS.C, SIZE) for pan in pans]
    found = calibrate_video(tennis(), [picture(camera, tennis()) for camera in cameras], every=1)
    for camera, one in zip(cameras, found, strict=True):
        assert one.accepted
        assert Truth(camera, tennis()).distance(one.required_camera) < 0.5
    assert np.ptp([one.required_camera.C for one in found], axis=0).max() < 1e-4


def test_run_finds_courts_without_a_model(tmp_path, capsys):
    cv2.imwrite(str(tmp_path / "a.png"), picture(TENNIS, tennis()))
    assert run("run", tmp_path / "a.png", "--field", "tennis", "--out", tmp_path / "out") == 0
    assert "the court is found by search" in capsys.readouterr().err
    found = fieldcalib.read(tmp_path / "out")["a"]
    assert found.accepted
    assert Truth(TENNIS, tennis()).distance(found.required_camera) < 1.0


def test_calibrate_finds_courts_without_a_network():
    found = fieldcalib.calibrate(picture(TENNIS, tennis()), field="tennis", progress=False)
    assert Truth(TENNIS, tennis()).distance(found["000000"].required_camera) < 1.0


def test_without_a_network_nothing_of_the_camera_may_be_given():
    with pytest.raises(ValueError, match="nothing may be given"):
        calibrate_from_images(tennis(), [picture(TENNIS, tennis())], None, TENNIS.K, flags=KNOWN_INTRINSICS_FLAGS)
    with pytest.raises(ValueError, match="searched for a Field"):
        calibrate_from_images(dict(tennis()), [picture(TENNIS, tennis())], prior=None)


def test_what_is_no_picture_is_an_error():
    with pytest.raises(ValueError, match="image must be"):
        find_courts(np.zeros((10, 10)), tennis())


FRAMES = court_frames()
FIRST = list({frame.clip: frame for frame in reversed(FRAMES)}.values())


def images_of(shared_data, frames):
    with VideoReader(shared_data / "courts" / f"{frames[0].clip}.mp4") as video:
        for number, image in enumerate(video):
            yield from ((frame, image) for frame in frames if frame.number == number)
            if number >= frames[-1].number:
                break


@pytest.mark.parametrize(  # of each clip the slow part takes all frames
    "frame", FIRST[::6], ids=[frame.clip for frame in FIRST[::6]]
)
def test_a_broadcast_frame_is_right_and_accepted(frame, shared_data):
    ((frame, image),) = images_of(shared_data, [frame])
    best = find_courts(image, field_named(frame.field))[0]
    assert frame.is_right(best.calibration.required_camera)
    assert best.calibration.accepted


@pytest.mark.slow
@pytest.mark.parametrize("clip", [frame.clip for frame in FIRST])
def test_all_frames_of_a_clip_are_right_and_accepted(clip, shared_data):
    frames = [frame for frame in FRAMES if frame.clip == clip]
    for frame, image in images_of(shared_data, frames):
        best = find_courts(image, field_named(frame.field))[0]
        assert frame.is_right(best.calibration.required_camera), frame.number
        assert best.calibration.accepted, frame.number


# From above


@pytest.mark.slow
@given(
    name=st.sampled_from(["tennis", "badminton", "soccer"]),
    turn=st.sampled_from([0.0, 0.5 * np.pi]),
    pan=angle(0.4),
    tilt=numbers(0.0, 0.17),
    fov=numbers(45.0, 80.0),
    share=numbers(0.6, 0.9),
)
@examples(8)
def test_a_field_seen_from_above_is_found(name, turn, pan, tilt, fov, share):
    """Its long side lies along the picture or up in it, and the camera leans a little: as from a drone."""
    field, size = field_named(name), (1280, 720) if turn == 0.0 else (720, 1280)
    f = 0.5 * size[0] / np.tan(np.radians(fov) / 2.0)
    up = f * max(field.length / max(size), field.width / min(size)) / share
    pan, roll = (turn + pan, -0.8 * pan)  # most of it is taken back: the picture is nearly upright
    C = (-up * np.tan(tilt) * np.sin(pan), up * np.tan(tilt) * np.cos(pan), -up)
    truth = Camera.from_angles(pan, tilt, roll, f, C, size)
    best = find_courts(picture(truth, field), field)[0].calibration
    assert best.verdict is Verdict.GOOD, best.reason
    assert min(largest_move(truth, camera, field) for camera in (best.camera, turned(best.camera))) < field.tolerance


@pytest.mark.slow
def test_a_picture_from_above_is_no_window():
    """The areas of a pitch are upright rectangles, as windows are; the network has not seen it from there."""
    truth = Camera.from_angles(0.0, 0.01, 0.0, 1000.0, (3.0, 2.0, -110.0), SIZE)
    (found,) = calibrate_from_images(fieldcalib.soccer(), [picture(truth)], SegmentationNetwork.load())
    assert found.verdict is Verdict.GOOD
    assert found.has_finding(What.GROUND_ONLY)
    assert largest_move(truth, found.camera, found.field) < 1.0


@pytest.mark.slow
def test_a_drawing_from_above_is_no_picture_of_a_camera():
    overhead = Camera.from_angles(0.0, 0.0, 0.0, 1000.0, (0.0, 0.0, -110.0), SIZE)
    board = draw_field(
        np.full((720, 1280, 3), (40, 140, 30), np.uint8), overhead, fieldcalib.soccer(), colour=(240, 240, 240)
    )
    (found,) = calibrate_from_images(fieldcalib.soccer(), [board], SegmentationNetwork.load())
    assert found.verdict is Verdict.REJECT
    assert "a drawing" in found.reason


QUICK = ("tex-ten-21.jpg",)
DRONES = json.loads((Path(__file__).parents[2] / "from_above.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize("name", [one if one in QUICK else pytest.param(one, marks=pytest.mark.slow) for one in DRONES])
def test_pictures_of_drones_are_right_and_good(name, shared_data):
    """Crossings of their lines were set by hand, in enlarged pictures: coordinates only."""
    one, image = DRONES[name], cv2.imread(str(shared_data / "wild" / name))
    field = field_named(one["field"])
    network = SegmentationNetwork.load() if one["field"] == "soccer" else None
    (found,) = calibrate_from_images(field, [image], network)
    assert found.verdict is Verdict.GOOD, found.reason
    X = [crossing(found.field, *at) if len(at) == 2 else found.field[at[0]].X for at in one["crossings"]]
    off = distances(found.camera, np.array(X), np.array(one["pixels"]), image.shape[1])
    assert max(off) < 6.0
    assert np.median(off) < 3.0
