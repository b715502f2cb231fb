"""Rinks and turf: numbers of the rule books, recovery of cameras, symmetry, real frames of the NHL."""

import warnings
from importlib import import_module
from importlib.util import find_spec
from types import SimpleNamespace

import numpy as np
import pytest
from objects import relative_error
from synthetic import SIZE, observe, random_frames

from fieldcalib.assess.findings import Verdict
from fieldcalib.fields import american_football
from fieldcalib.fields.catalogue import FIELDS, field_named
from fieldcalib.fields.records import field_from_record, field_to_record
from fieldcalib.fields.segments import Point
from fieldcalib.fields.sports.ice_hockey import ice_hockey, ice_hockey_iihf
from fieldcalib.fields.sports.rugby_union import rugby_union
from fieldcalib.geometry.camera import Camera
from fieldcalib.solve.batch import calibrate_batch
from fieldcalib.solve.field_size import estimate_field_size
from fieldcalib.solve.from_segments import calibrate_from_segments
from fieldcalib.solve.solver_options import DEFAULT_FLAGS, CalibrationFlags

NAMES = (
    "american-football-ncaa",
    "american-football-nfl",
    "field-hockey",
    "ice-hockey-iihf",
    "ice-hockey-nhl",
    "ice-hockey-nhl-2013",
    "rugby-union",
)
every_field = pytest.mark.parametrize("name", NAMES)
# of what solves many frames; on the other fields it is slow
AT_ONCE = ("american-football-nfl", "ice-hockey-nhl")
solved_field = pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name in AT_ONCE else pytest.mark.slow) for name in NAMES]
)
FT, IN = 0.3048, 0.0254


# The rule books: where an edge of the paint is. x, y of a line or a point, radius r or centre cx, cy of an arc.

NHL = [
    ("Side board bottom", "y", 42.5 * FT, 0.0),
    ("End board right", "x", 100.0 * FT, 0.0),
    ("Corner board right bottom", "r", 28.0 * FT, 0.0),
    ("Corner board right bottom", "cx", 21.9456, 0.0),
    ("Corner board right bottom", "cy", 4.4196, 0.0),
    ("Goal line right", "x", 89.0 * FT, 0.0),
    ("Goal line and boards right bottom", "y", 11.2010, 0.0),
    ("Blue line right inner edge", "x", 7.620, 0.0),
    ("Blue line right outer edge", "x", 7.9248, 0.0),
    ("Blue line right", "x", 25.0 * FT, -6.0 * IN),
    ("Centre line right edge", "x", 0.5 * FT, 0.0),
    ("Centre circle", "r", 15.0 * FT, 1.0 * IN),
    ("Face-off circle right bottom", "r", 15.0 * FT, 1.0 * IN),
    ("Face-off circle right bottom", "cx", 69.0 * FT, 0.0),
    ("Face-off spot right bottom", "x", 69.0 * FT, 0.0),
    ("Face-off spot right bottom", "y", 22.0 * FT, 0.0),
    ("Neutral spot right bottom", "x", 20.0 * FT, 0.0),
    ("L mark right bottom BR across", "x", 71.0 * FT, -1.0 * IN),
    ("L mark right bottom BR along", "y", 22.75 * FT, -1.0 * IN),
    ("L mark right bottom TL across", "x", 67.0 * FT, 1.0 * IN),
    ("L mark right bottom TL along", "y", 21.25 * FT, 1.0 * IN),
    ("Hash mark right bottom BR outer end", "y", 39.0 * FT, 0.0),
    ("Crease right", "r", 6.0 * FT, 1.0 * IN),
    ("Crease right bottom", "y", 4.0 * FT, 1.0 * IN),
    ("Referee crease bottom", "r", 10.0 * FT, 1.0 * IN),
    ("Goal right post bottom", "y", 3.0 * FT, -0.03),
]
PAINT = {
    "ice-hockey-nhl": [
        *NHL,
        ("Hash mark right bottom BR", "x", (69.0 + 67.0 / 24.0) * FT, -1.0 * IN),  # 5 ft 7 in between the inner edges
        ("Goal line and trapezoid right bottom", "y", 11.0 * FT, 0.0),
    ],
    "ice-hockey-nhl-2013": [
        *NHL,
        ("Hash mark right bottom BR", "x", 70.5 * FT, -1.0 * IN),
        ("Goal line and trapezoid right bottom", "y", 9.0 * FT, 0.0),
    ],
    "ice-hockey-iihf": [
        ("Side board bottom", "y", 15.0, 0.0),
        ("Goal line right", "x", 26.0, 0.0),
        ("Blue line right", "x", 7.14, 0.0),  # 22.86 m from the end boards
        ("Blue line right inner edge", "x", 6.99, 0.0),
        ("Neutral spot right top", "x", 5.49, 0.0),
        ("Face-off spot right bottom", "x", 20.0, 0.0),
        ("Face-off spot right bottom", "y", 7.0, 0.0),
        ("Face-off circle right bottom", "r", 4.5, 0.025),
        ("Hash mark right bottom BR", "x", 20.9, 0.025),  # 1.80 m between the outer edges
        ("L mark right bottom BR across", "x", 20.6, -0.025),
        ("L mark right bottom BR along", "y", 7.225, -0.025),
        ("Crease right", "r", 1.80, 0.025),
        ("Goal right post bottom", "y", 0.915, -0.03),
    ],
    "american-football-nfl": [
        ("Side line bottom", "y", 24.384, 0.0),
        ("End line right", "x", 54.864, 0.0),
        ("Goal line right", "x", 45.720, -4.0 * IN),
        ("Goal line right", "x", 45.923, 4.0 * IN),
        ("Yard line right 45", "x", 4.572, 0.0),
        ("Yard line right 5", "x", 41.148, 0.0),
        ("Hash row bottom inner", "y", 2.8194, 0.0),
        ("Hash row bottom outer", "y", 3.429, 0.0),
        ("Number row bottom outer", "y", 13.411, 0.0),
        ("Try mark right", "x", 45.72 - 1.829, 0.0),
        ("Goal right post bottom", "y", 9.25 * FT, -2.0 * IN),
    ],
    "american-football-ncaa": [
        ("Hash row bottom inner", "y", 6.096, 0.0),
        ("Number row bottom outer", "y", 24.384 - 6.401, 0.0),
        ("Number row bottom inner", "y", 24.384 - 8.230, 0.0),
        ("Try mark right", "x", 45.72 - 2.743, 0.0),
    ],
    "rugby-union": [
        ("Touchline bottom", "y", 35.0, -0.05),
        ("Goal line right", "x", 50.0, -0.05),
        ("22-metre line right", "x", 28.0, -0.05),
        ("10-metre line right", "x", 10.0, 0.0),
        ("5-metre line bottom", "y", 30.0, 0.0),
        ("15-metre line bottom", "y", 20.0, 0.0),
        ("5-metre dashes right", "x", 45.0, 0.0),
        ("Dead-ball line right", "x", 60.0, -0.05),
        ("Goal right post bottom", "y", 2.8, -0.06),
    ],
    "field-hockey": [
        ("Side line bottom", "y", 27.5, 0.0375),
        ("Back line right", "x", 45.7, 0.0375),
        ("23-metre line right", "x", 22.8, -0.0375),
        ("Circle right line", "x", 31.07, -0.0375),
        ("Circle right arc bottom", "r", 14.63, 0.0375),
        ("Circle right arc bottom", "cy", 1.83, 0.0),
        ("Broken circle right arc bottom", "r", 19.63, 0.0375),
        ("Penalty spot right", "x", 39.225, 0.0),
        ("Side mark right bottom 5 m", "x", 40.7, -0.0375),
        ("Goal right post bottom", "y", 1.83, -0.025),
    ],
}


def position(segment, what):
    """A coordinate of all of a segment, or the radius or a coordinate of the centre of an arc."""
    if what == "r":
        return segment.radius
    if what in ("cx", "cy"):
        return segment.center["xy".index(what[1])]
    ends = [segment.X] if isinstance(segment, Point) else [segment.start, segment.end]
    (value,) = {X["xy".index(what)] for X in ends}
    return value


@pytest.mark.parametrize(
    ("name", "label", "what", "edge", "inwards"),
    [(name, *row) for name, rows in PAINT.items() for row in rows],
    ids=lambda value: str(value).replace(" ", "_"),
)
def test_the_middle_of_the_paint_is_half_a_line_from_its_edge(name, label, what, edge, inwards):
    """`inwards` is half of the line's width where the rule gives the edge that faces away from the middle."""
    assert position(field_named(name)[label], what) == pytest.approx(
        edge - inwards, abs=6e-4
    )  # millimetres of the table


@pytest.mark.parametrize(
    ("name", "height"),
    [
        ("american-football-nfl", 10.0 * FT - 2.0 * IN),
        ("field-hockey", 2.14 + 0.025),
        ("ice-hockey-iihf", 1.22 + 0.03),
        ("ice-hockey-nhl", 4.0 * FT + 0.03),
        ("rugby-union", 3.0 - 0.06),
    ],
)
def test_crossbars_are_at_the_middle_of_the_tube(name, height):
    assert -field_named(name)["Goal left crossbar"].start[2] == pytest.approx(height)


def test_lines_end_on_the_boards_and_arcs_where_they_meet():
    for rink in (ice_hockey("nhl"), ice_hockey_iihf(60.0, 28.0, corner_radius=7.0)):
        corner, goal_line, crease = rink["Corner board right bottom"], rink["Goal line right"], rink["Crease right"]
        assert np.linalg.norm(np.subtract(goal_line.end, corner.center)) == pytest.approx(corner.radius)
        np.testing.assert_allclose(corner.sample()[-1], rink["Side board bottom"].end, atol=1e-9)
        np.testing.assert_allclose(corner.sample()[0], rink["End board right"].end, atol=1e-9)
        side = rink.get("Crease right bottom")
        end = crease.sample()[0]
        np.testing.assert_allclose(end, side.start if side else (*goal_line.start[:1], crease.radius, 0.0), atol=1e-9)
    hockey = field_named("field-hockey")
    for circle in ("Circle", "Broken circle"):
        X = hockey[f"{circle} right arc bottom"].sample()
        assert X[0][0] == pytest.approx(0.5 * hockey.length)
        np.testing.assert_allclose(X[-1], hockey[f"{circle} right line"].end, atol=1e-9)


# Symmetry


@every_field
def test_a_field_that_is_turned_by_180_degrees_is_the_same(name):
    field = field_named(name)
    assert set(field.symmetric) == set(field)
    for label, other in field.symmetric.items():
        assert field.symmetric[other] == label
        X, Y = field[label].sample(0.02) * (-1.0, -1.0, 1.0), field[other].sample(0.02)
        np.testing.assert_allclose([X.min(axis=0), X.max(axis=0)], [Y.min(axis=0), Y.max(axis=0)], atol=1e-3)
    assert field.symmetric["Goal left post top"] == "Goal right post bottom"


def test_half_centimetres_do_not_hide_a_counterpart():
    """The circles of an IIHF rink end at y = 2.525 m."""
    rink = ice_hockey("iihf")
    assert rink.symmetric["Face-off circle left top"] == "Face-off circle right bottom"


# Cameras


@solved_field
def test_cameras_of_the_stands_are_recovered(name):
    """Without noise and without a prior in the final solve; a wide camera may end in a false minimum."""
    field = field_named(name)
    frames, cameras = random_frames(20, seed=21, field=field, stands=tuple(field.named_stands))
    found = calibrate_batch(field, frames, SIZE, prior=None)
    errors = [relative_error(one.camera, truth) for one, truth in zip(found, cameras, strict=True)]
    assert np.sum(np.array(errors) < 1e-6) >= 19, sorted(errors)[-3:]


@solved_field
def test_the_prior_of_the_stands_is_weak(name):
    field = field_named(name)
    frames, cameras = random_frames(20, seed=22, noise=0.3, field=field, stands=tuple(field.named_stands))
    found = calibrate_batch(field, frames, SIZE)
    errors = [relative_error(one.camera, truth) for one, truth in zip(found, cameras, strict=True)]
    assert np.median(errors) < 0.03
    assert sum(one.accepted for one in found) >= 19


@every_field
def test_points_alone_are_enough(name):
    field = field_named(name)
    camera = Camera.from_angles(0.3, 1.2, 0.0, 450.0, (0.0, 0.5 * field.width + 20.0, -15.0), SIZE)
    frame = {label: [camera.project(point.X)] for label, point in field.points.items()}
    inside = {label: xy for label, xy in frame.items() if np.all((xy[0] >= 0.0) & (xy[0] < SIZE))}
    found = calibrate_from_segments(field, inside, SIZE, prior=None)
    assert relative_error(found.camera, camera) < 1e-6


# what a camera sees of parallel lines, of one circle, of lines through one point
DEGENERATE = {
    "american-football-nfl": ("Yard line left 20", "Yard line left 25", "Yard line left 30", "Yard line left 35"),
    "american-football-ncaa": ("Hash row bottom inner", "Hash row top inner", "Side line top", "Number row top inner"),
    "field-hockey": ("Back line left", "Centre line", "23-metre line left", "Circle left line"),
    "ice-hockey-iihf": ("Centre circle",),
    "ice-hockey-nhl": ("Blue line left", "Blue line right", "Centre line", "Goal line left"),
    "ice-hockey-nhl-2013": ("Goal left post top", "Goal left post bottom"),
    "rugby-union": ("Touchline top", "5-metre line top", "15-metre line top", "Touchline bottom"),
}


@every_field
def test_a_degenerate_view_gets_no_good_verdict(name):
    field = field_named(name)
    camera = Camera.from_angles(-0.3, 1.2, 0.0, 400.0, (0.0, 0.5 * field.width + 20.0, -15.0), SIZE)
    seen = observe(field.markings, camera)
    frame = {label: seen[label] for label in DEGENERATE[name]}
    assert calibrate_from_segments(field, frame, SIZE).verdict is not Verdict.GOOD


def test_the_middle_of_a_rink_does_not_tell_the_sides_apart():
    """Centre circle and centre line are the same from the other side, and the calibration says so."""
    rink = ice_hockey("nhl")
    camera = Camera.from_angles(0.1, 1.2, 0.0, 900.0, (3.0, 35.0, -13.0), SIZE)
    seen = observe(rink.markings, camera)
    found = calibrate_from_segments(rink, {label: seen[label] for label in ("Centre circle", "Centre line")}, SIZE)
    assert len(found.alternatives) == 1
    np.testing.assert_allclose(found.alternatives[0].C[:2], -found.camera.C[:2])


def test_labels_that_are_5_yards_off_fit_a_camera_that_is_5_yards_off():
    """Only goal lines and what stands at them tell, and the message says that nothing does."""
    field = american_football("nfl")
    camera = Camera.from_angles(0.1, 1.25, 0.0, 1200.0, (-10.0, 60.0, -22.0), SIZE)
    seen = observe(field.markings, camera)
    labels = {f"Yard line left {yards}": f"Yard line left {yards - 5}" for yards in (35, 40, 45)}
    rows = ("Hash row bottom inner", "Hash row top inner", "Side line top")
    frame = {labels.get(label, label): seen[label] for label in (*labels, *rows)}
    found = calibrate_from_segments(field, frame, SIZE, prior=None)
    assert found.verdict is Verdict.GOOD
    np.testing.assert_allclose(found.camera.C, camera.C - (4.572, 0.0, 0.0), atol=1e-3)
    assert "all 4.572 m off along the field fit as well" in found.message
    known = calibrate_from_segments(
        field,
        frame,
        SIZE,
        rvec=np.zeros(3),
        tvec=-found.camera.C,
        flags=DEFAULT_FLAGS | CalibrationFlags.CALIB_FIX_POSITION,
    )
    assert known.accepted
    assert "fit as well" not in known.message  # where the camera stands is known


@pytest.mark.parametrize("side", [0, 1])
def test_what_is_alike_further_on_has_a_segment_there(side):
    field = american_football("nfl")
    alike = field.alike_further_on[side]
    step = np.array([(-1.0, 1.0)[side] * field.repeats, 0.0, 0.0])
    for label in alike:
        ends = field[label].sample(1e3)[[0, -1]] + step
        there = [one.sample(1e3)[[0, -1]] for one in field.values() if type(one) is type(field[label])]
        lies_along = np.ptp(ends[:, 1]) == np.ptp(ends[:, 2]) == 0.0 and np.ptp(ends[:, 0]) > 2.0 * field.repeats
        assert lies_along or min(np.abs(ends - one).max() for one in there) < 0.01, label
    ends_of_field = {"Goal line left", "Goal line right", "End line left", "Goal left crossbar", "Try mark right"}
    assert not alike & ends_of_field
    assert ("Yard line left 5" in alike, "Yard line right 5" in alike) == ((False, True), (True, False))[side]
    assert not any(ice_hockey("nhl").alike_further_on)


# Names, sizes and records


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ice_hockey("khl"), "rules of ice hockey must be one of nhl, nhl-2013, iihf, got 'khl'"),
        (lambda: american_football("cfl"), "rules of American football must be one of nfl, ncaa, got 'cfl'"),
        (lambda: ice_hockey_iihf(200.0, 85.0), "a rink of the IIHF is 56 to 61 m long, got 200.0"),
        (lambda: ice_hockey_iihf(60.0, 35.0), "a rink of the IIHF is 26 to 30 m wide, got 35.0"),
        (lambda: ice_hockey_iihf(corner_radius=9.0), "a radius of 7.0 to 8.5 m, got 9.0"),
        (lambda: rugby_union(120.0), "94 to 100 m long, got 120.0"),
        (lambda: rugby_union(in_goal=5.0), "6 to 22 m deep in goal, got 5.0"),
    ],
)
def test_what_no_rule_knows_is_said(make, message):
    with pytest.raises(ValueError, match=message):
        make()


@every_field
def test_records_bring_the_field_back(name):
    field = field_named(name)
    assert field_from_record(field_to_record(field)) == field


def test_fields_that_vary_are_records_by_name_and_others_know_their_size():
    assert field_to_record(rugby_union(98.0, 69.0))["builder"] == "rugby-union"
    assert field_to_record(ice_hockey("iihf"))["builder"] == "ice-hockey-iihf"
    assert {name for name in NAMES if not FIELDS[name]().size_known} == {"rugby-union", "ice-hockey-iihf"}


@pytest.mark.parametrize(
    ("truth", "likely"), [(ice_hockey_iihf(60.0, 28.0), ice_hockey_iihf()), (rugby_union(98.0, 69.0), rugby_union())]
)
def test_the_size_is_found_with_the_cameras(truth, likely):
    frames = [
        observe(truth.markings, Camera.from_angles(pan, 1.2, 0.0, 500.0, (2.0, 50.0, -18.0), SIZE), per_line=5)
        for pan in (-0.5, 0.0, 0.5)
    ]
    found = estimate_field_size(likely, frames, SIZE)  # the prior pulls a little
    assert abs(found.length - truth.length) < 0.1
    assert abs(found.width - truth.width) < 0.4 * abs(likely.width - truth.width)


# sportypy's numbers. Known to be wrong there: the blue lines of the IIHF, which it has at 7.5 m.


@pytest.fixture
def sportypy():
    if find_spec("sportypy") is None:  # GPL: no extra brings it
        pytest.skip("compares with the numbers of sportypy, which is not installed")
    names = ("football", "hockey")
    with warnings.catch_warnings(action="ignore"):  # of what is deprecated by now
        yield SimpleNamespace(**{name: import_module(f"sportypy.surfaces.{name}") for name in names})


@pytest.mark.parametrize(("name", "unit"), [("NHL", FT), ("IIHF", 1.0)])
def test_rinks_agree_with_sportypy(sportypy, name, unit):
    theirs, rink = getattr(sportypy.hockey, f"{name}Rink")().rink_params, ice_hockey(name.lower())
    half_line, end = 0.5 * theirs["minor_line_thickness"], 0.5 * theirs["rink_length"]
    spot = end - theirs["odzone_faceoff_spot_to_boards"]
    blue = 0.5 * theirs["nzone_length"] + (0.5 * theirs["major_line_thickness"] if name == "NHL" else -0.36)
    l_x, l_y = theirs["faceoff_line_dist_x"] + half_line, theirs["faceoff_line_dist_y"] + half_line
    expected = {
        ("End board right", "x"): end,
        ("Side board bottom", "y"): 0.5 * theirs["rink_width"],
        ("Corner board right bottom", "r"): theirs["corner_radius"],
        ("Goal line right", "x"): end - theirs["goal_line_to_boards"],
        ("Blue line right", "x"): blue,
        ("Face-off spot right bottom", "x"): spot,
        ("Face-off spot right bottom", "y"): theirs["noncenter_faceoff_spot_y"],
        ("Face-off circle right bottom", "r"): theirs["faceoff_circle_radius"] - half_line,
        ("Hash mark right bottom BR", "x"): spot + 0.5 * theirs["hashmark_ext_spacing"] - half_line,
        ("L mark right bottom BR across", "x"): spot + l_x,
        ("L mark right bottom BR along", "y"): theirs["noncenter_faceoff_spot_y"] + l_y,
        ("Goal line and trapezoid right bottom", "y"): 0.5 * theirs["short_base_width"],
        ("Referee crease bottom", "r"): theirs["referee_crease_radius"] - half_line,
    }
    for (label, what), value in expected.items():
        assert position(rink[label], what) == pytest.approx(unit * value, abs=2e-4), label


@pytest.mark.parametrize("name", ["NFL", "NCAA"])
def test_american_football_agrees_with_sportypy(sportypy, name):
    theirs, field = getattr(sportypy.football, f"{name}Field")().field_params, american_football(name.lower())
    goal, side = 0.5 * theirs["field_length"], 0.5 * theirs["field_width"]
    expected = {
        ("End line right", "x"): goal + theirs["endzone_length"],
        ("Side line bottom", "y"): side,
        ("Hash row bottom inner", "y"): 0.5 * theirs["inbound_hashmark_separation"],
        ("Hash row bottom outer", "y"): 0.5 * theirs["inbound_hashmark_separation"] + theirs["minor_yard_line_height"],
        ("Number row bottom outer", "y"): side - theirs["sideline_to_bottom_of_numbers"],
        ("Number row bottom inner", "y"): side - theirs["sideline_to_bottom_of_numbers"] - theirs["number_height"],
        ("Try mark right", "x"): goal - theirs["try_mark_distance"],
        ("Yard line right 45", "x"): theirs["major_yard_line_distance"],
    }
    for (label, what), value in expected.items():
        assert position(field[label], what) == pytest.approx(0.9144 * value, abs=2e-4), label
    end = side - theirs["sideline_to_major_yard_line"]
    assert field["Yard line 50"].end[1] == pytest.approx(0.9144 * end, abs=2e-4)


# Real frames of the NHL, season 2013-14, with points set by hand

HD = (1920, 1080)
PLACES = {
    "bottom_left_circle_center": "Face-off spot left bottom",
    "top_left_circle_center": "Face-off spot left top",
    "bottom_right_circle": "Face-off spot right bottom",
    "top_right_circle": "Face-off spot right top",
    "bottom_left_small_circle": "Neutral spot left bottom",
    "top_left_small_circle": "Neutral spot left top",
    "bottom_right_small_circle": "Neutral spot right bottom",
    "top_right_small_circle": "Neutral spot right top",
    "center_circle_bottom": "Centre line and centre circle bottom",
    "center_circle_top": "Centre line and centre circle top",
    "center_red_line": "Centre line and boards top",
    "left_blue_line": "Blue line and boards left top",
    "right_blue_line": "Blue line and boards right top",
    "top_left_corner": "Goal line and boards left top",
    "top_right_corner": "Goal line and boards right top",
    "bottom_left_intersection_line": "Goal line and trapezoid left bottom",
    "top_left_intersection_line": "Goal line and trapezoid left top",
}
# seen in the pictures: names that are another point's
EXCHANGED = {
    ("image1096", "11_top_left_vertical_line_1"): "11_top_right_vertical_line_1",
    ("image1096", "11_top_right_vertical_line_1"): "11_top_left_vertical_line_1",
    ("image422", "01_top_left_vertical_line_1"): "01_top_right_vertical_line_1",
    ("image422", "01_top_right_vertical_line_1"): "01_top_left_vertical_line_1",
    ("image466", "10_top_left_arrow_1"): "10_top_left_arrow_3",
    ("image466", "10_top_left_arrow_3"): "10_top_left_arrow_1",
    ("image466", "11_top_right_vertical_line_1"): "11_top_left_vertical_line_1",
    ("image1521", "01_bottom_left_vertical_line_1"): "01_bottom_right_vertical_line_1",
    ("image1521", "01_bottom_left_vertical_line_2"): "01_bottom_right_vertical_line_2",
}


def label_of(name):
    """Our label of a point: arrows are L marks, numbered clockwise, vertical lines are hash marks."""
    if name in PLACES:
        return PLACES[name]
    circle, vertical, horizontal, kind, *_, number = name.split("_")
    spot = f"{('left', 'right')[int(circle[0])]} {('bottom', 'top')[int(circle[1])]}"
    quarter = vertical[0].upper() + horizontal[0].upper()
    if kind == "vertical":
        return f"Hash mark {spot} {quarter} {'inner' if number == '1' else 'outer'} end"
    if number == "2":
        return f"L mark {spot} {quarter} corner"
    return f"L mark {spot} {quarter} {'along' if (number == '1') == (quarter in ('BL', 'TR')) else 'across'} end"


@pytest.fixture(scope="module")
def nhl_frames(shared_data):
    """Labelled points of each picture."""
    frames = {}
    for path in sorted((shared_data / "hockey-points").glob("t*/*.txt")):
        rows = [line.split() for line in path.read_text().splitlines() if line]
        frames[path.stem] = {label_of(name): np.array([[float(x), float(y)]]) for name, x, y in rows}
    assert len(frames) == 18
    return frames


def test_exchanged_names_of_real_points_are_found_and_no_others(nhl_frames):
    found = calibrate_batch(ice_hockey("nhl-2013"), list(nhl_frames.values()), HD)
    assert all(one.accepted for one in found)
    suspects = {
        (frame, suspect.label): suspect.fits
        for frame, one in zip(nhl_frames, found, strict=True)
        for suspect in one.suspect_labels
    }
    assert suspects == {(frame, label_of(name)): label_of(fits) for (frame, name), fits in EXCHANGED.items()}


@pytest.mark.slow
def test_points_that_were_left_out_are_where_the_others_say(nhl_frames):
    """2.3 px at 1920 x 1080, of which 1.6 px are the hand's; the hash marks of today's rules are 30 px off."""
    medians = {rules: np.median(left_out_distances(ice_hockey(rules), nhl_frames)) for rules in ("nhl-2013", "nhl")}
    assert medians["nhl-2013"] < 2.5
    assert medians["nhl"] > 1.5 * medians["nhl-2013"]


def renamed(frame, suspects):
    """A frame under the labels that fit its segments, without those that none fits."""
    fits, parts = {suspect.label: suspect.fits for suspect in suspects}, {}
    for given, xy in frame.items():
        parts.setdefault(fits.get(given, given), []).append(xy)
    return {label: np.concatenate(xy) for label, xy in parts.items() if label is not None}


def left_out_distances(rink, frames):
    """Distance in pixels of each point from where a camera puts it that was calibrated without it."""
    others, left_out = [], []
    found = calibrate_batch(rink, list(frames.values()), HD)
    for frame, one in zip(frames.values(), found, strict=True):
        fits = {suspect.label: suspect.fits for suspect in one.suspect_labels}
        believed = {fits.get(label, label): xy for label, xy in frame.items() if fits.get(label, label) is not None}
        others += [{name: xy for name, xy in believed.items() if name != label} for label in believed]
        left_out += [(rink[label].X, xy[0]) for label, xy in believed.items()]
    cameras = [one.camera for one in calibrate_batch(rink, others, HD, trust_labels=True)]
    return [np.linalg.norm(camera.project(X) - xy) for camera, (X, xy) in zip(cameras, left_out, strict=True)]
