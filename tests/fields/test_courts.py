"""Courts against numbers written down from the rule books, as edges of the paint, and cameras that look at them."""

import importlib.util
import json
import pickle
import warnings
from itertools import islice

import numpy as np
import pytest
from objects import relative_error
from synthetic import SIZE, observe, random_camera, random_frames

import fieldcalib
from fieldcalib import calibrate_batch, calibrate_from_segments, fields
from fieldcalib.fields.catalogue import FIELDS, field_named
from fieldcalib.fields.records import field_from_record, field_to_record
from fieldcalib.fields.segments import Arc, Line
from fieldcalib.solve.solver_options import PINHOLE_FLAGS

NAMES = (
    "badminton",
    "basketball-fiba",
    "basketball-nba",
    "futsal",
    "handball",
    "padel",
    "tennis",
    "volleyball",
)
COURTS = {name: field_named(name) for name in NAMES}
OF_FILES = (
    "basketball-3x3",
    "basketball-half",
    "beach-volleyball",
    "lacrosse-men",
    "pickleball",
    "rugby-league",
    "soccer-5v5",
    "soccer-7v7",
    "soccer-9v9",
)
MORE = {name: field_named(name) for name in ("basketball-ncaa", "basketball-nfhs", *OF_FILES)}
every_court = pytest.mark.parametrize("field", COURTS.values(), ids=COURTS)
# of what solves many frames; on the other courts it is slow
AT_ONCE = ("handball", "padel", "pickleball", "tennis")


def solved(courts):
    return pytest.mark.parametrize(
        "field",
        [
            pytest.param(court, id=name, marks=() if name in AT_ONCE else pytest.mark.slow)
            for name, court in courts.items()
        ],
    )


solved_court = solved(COURTS)
needs_sportypy = pytest.mark.skipif(
    importlib.util.find_spec("sportypy") is None,
    reason="sportypy, whose numbers are compared, is not installed: GPL, of no extra",
)
FOOT = 0.3048


def axis_of(line):
    """What is the same in both ends of a line along an axis: (which coordinate, its value) on the ground."""
    start, end = np.array(line.start[:2]), np.array(line.end[:2])
    (axis,) = np.flatnonzero(start == end)
    return axis, start[axis]


def outer_edge(field, label, width=None):
    """How far the edge of a line is from the middle of the field that is farther away; the radius of an arc."""
    return _edge(field, label, width, 0.5)


def inner_edge(field, label, width=None):
    return _edge(field, label, width, -0.5)


def _edge(field, label, width, share):
    segment = field[label]
    middle = segment.radius if isinstance(segment, Arc) else abs(axis_of(segment)[1])
    return middle + share * (field.lines.width if width is None else width)


# --- the rule books ---

OUT, IN = outer_edge, inner_edge  # outer and inner: seen from the middle of the field, or of the circle


@pytest.mark.parametrize(
    ("name", "edge", "label", "metres"),
    [
        # FIBA, art. 2: 28 x 15 m between inner edges
        ("basketball-fiba", IN, "End line right", 14.0),
        ("basketball-fiba", IN, "Side line bottom", 7.5),
        ("basketball-fiba", OUT, "Centre circle", 1.80),
        ("basketball-fiba", OUT, "Three-point arc right", 6.75),
        ("basketball-fiba", OUT, "Three-point line right bottom", 6.60),
        ("basketball-fiba", OUT, "Lane right bottom", 2.45),
        ("basketball-fiba", IN, "Free-throw line right", 14.0 - 5.80),
        ("basketball-fiba", OUT, "Free-throw circle right", 1.80),
        ("basketball-fiba", IN, "No-charge arc right", 1.25),
        ("basketball-fiba", IN, "No-charge line right top", 1.25),
        ("basketball-fiba", IN, "Throw-in line right bottom", 14.0 - 8.325),
        ("basketball-fiba", IN, "Team bench line left top", 5.0),
        # NBA, rule 1: 94 x 50 ft
        ("basketball-nba", IN, "End line right", 47 * FOOT),
        ("basketball-nba", IN, "Side line bottom", 25 * FOOT),
        ("basketball-nba", OUT, "Centre circle", 6 * FOOT),
        ("basketball-nba", IN, "Inner centre circle", 2 * FOOT),
        ("basketball-nba", OUT, "Three-point arc right", 23.75 * FOOT),
        ("basketball-nba", OUT, "Three-point line right bottom", 22 * FOOT),
        ("basketball-nba", OUT, "Lane right bottom", 8 * FOOT),
        ("basketball-nba", OUT, "Inner lane right bottom", 6 * FOOT),
        ("basketball-nba", IN, "Free-throw line right", 28 * FOOT),
        ("basketball-nba", OUT, "Free-throw circle right", 6 * FOOT),
        ("basketball-nba", IN, "No-charge arc right", 4 * FOOT),
        ("basketball-nba", OUT, "28-foot mark right bottom", 19 * FOOT),
        ("basketball-nba", IN, "Substitution mark right bottom", (4 + 1 / 12) * FOOT),
        # NCAA, rule 1: as large; the three-point line of FIBA
        ("basketball-ncaa", IN, "End line right", 47 * FOOT),
        ("basketball-ncaa", OUT, "Three-point arc right", (22 + 1.75 / 12) * FOOT),
        ("basketball-ncaa", OUT, "Three-point line right bottom", (21 + 7.875 / 12) * FOOT),
        ("basketball-ncaa", OUT, "Lane right bottom", 6 * FOOT),
        ("basketball-ncaa", IN, "Free-throw line right", 28 * FOOT),
        # NFHS, rule 1: 84 x 50 ft
        ("basketball-nfhs", IN, "End line right", 42 * FOOT),
        ("basketball-nfhs", OUT, "Three-point arc right", 19.75 * FOOT),
        ("basketball-nfhs", OUT, "Three-point line right bottom", 19.75 * FOOT),
        ("basketball-nfhs", IN, "Free-throw line right", 23 * FOOT),
        # FIBA 3x3, art. 1, and half a court; distances from the middle of what is played on
        ("basketball-3x3", IN, "End line", 5.5),
        ("basketball-3x3", IN, "Far line", 5.5),
        ("basketball-3x3", IN, "Side line top", 7.5),
        ("basketball-3x3", OUT, "Three-point arc", 6.75),
        ("basketball-3x3", OUT, "Three-point line top", 6.60),
        ("basketball-3x3", OUT, "Lane top", 2.45),
        ("basketball-3x3", IN, "No-charge arc", 1.25),
        ("basketball-half", IN, "End line", 7.0),
        ("basketball-half", OUT, "Centre circle", 1.80),
        ("basketball-half", OUT, "Free-throw circle", 1.80),
        # pickleball, section 2: 44 x 20 ft between outer edges
        ("pickleball", OUT, "Base line left", 22 * FOOT),
        ("pickleball", OUT, "Side line top", 10 * FOOT),
        ("pickleball", OUT, "Non-volley line left", 7 * FOOT),
        # beach volleyball, rule 1
        ("beach-volleyball", OUT, "End line left", 8.0),
        ("beach-volleyball", OUT, "Side line top", 4.0),
        # lacrosse, rule 1
        ("lacrosse-men", OUT, "Crease left", 9 * FOOT),
        # rugby league, section 1: 100 x 68 m between inner edges
        ("rugby-league", IN, "Goal line left", 50.0),
        ("rugby-league", IN, "Touchline top", 34.0),
        ("rugby-league", IN, "Dead-ball line left", 58.0),
        # futsal, law 1: 40 x 20 m between outer edges
        ("futsal", OUT, "Goal line right", 20.0),
        ("futsal", OUT, "Side line bottom", 10.0),
        ("futsal", OUT, "Centre circle", 3.0),
        ("futsal", IN, "Penalty area right line", 14.0),
        ("futsal", OUT, "Penalty area right arc bottom", 6.0),
        ("futsal", OUT, "Corner arc right bottom", 0.25),
        ("futsal", IN, "Inner substitution mark right bottom", 5.0),
        ("futsal", OUT, "Outer substitution mark right bottom", 10.0),
        # IHF, rule 1: 40 x 20 m between outer edges
        ("handball", OUT, "Outer goal line right bottom", 20.0),
        ("handball", OUT, "Side line bottom", 10.0),
        ("handball", IN, "Goal area right line", 14.0),
        ("handball", OUT, "Goal area right arc bottom", 6.0),
        ("handball", IN, "Free-throw right line", 11.0),
        ("handball", OUT, "Free-throw right arc bottom", 9.0),
        ("handball", IN, "Seven-metre line right", 13.0),
        ("handball", IN, "Four-metre line right", 16.0),
        ("handball", OUT, "Substitution mark right bottom", 4.5),
        ("handball", OUT, "Throw-off circle", 2.0),
        # FIVB: 18 x 9 m between outer edges
        ("volleyball", OUT, "End line right", 9.0),
        ("volleyball", OUT, "Side line bottom", 4.5),
        ("volleyball", OUT, "Attack line right", 3.0),
        ("volleyball", OUT, "Attack line extension right bottom", 3.0),
        ("volleyball", OUT, "Service mark right bottom", 4.5),
        # BWF: 13.40 x 6.10 m between outer edges
        ("badminton", OUT, "Back line right", 6.70),
        ("badminton", OUT, "Side line bottom", 3.05),
        ("badminton", OUT, "Singles side line bottom", 2.59),
        ("badminton", OUT, "Long service line right", 5.94),
        ("badminton", IN, "Short service line right", 1.98),
        # FIP: 6.95 m from the net to the line, 3 m from the line to the wall
        ("padel", IN, "Service line right", 6.95),
        ("padel", OUT, "Service line right", 7.0),
        # ITF, rule 1: 23.77 x 10.97 m between outer edges
        ("tennis", OUT, "Side line bottom", 5.485),
        ("tennis", OUT, "Singles side line bottom", 4.115),
        ("tennis", OUT, "Service line right", 6.40),
    ],
)
def test_edges_of_the_paint(name, edge, label, metres):
    rounded = 1e-4 if name in OF_FILES else 1e-9  # m: numbers of files have four decimals
    assert edge((COURTS | MORE)[name], label) == pytest.approx(metres, abs=rounded)


@pytest.mark.parametrize(
    ("name", "label", "width", "metres"),
    [("tennis", "Base line right", 0.10, 11.885), ("handball", "Goal line right", 0.08, 20.0)],
)
def test_lines_that_are_wider_than_the_others(name, label, width, metres):
    assert outer_edge(COURTS[name], label, width) == pytest.approx(metres, abs=1e-9)


@pytest.mark.parametrize(
    ("name", "label", "center"),
    [
        ("basketball-fiba", "Three-point arc right", (12.425, 0.0, 0.0)),
        ("basketball-fiba", "Rim right", (12.425, 0.0, -3.05)),
        ("basketball-fiba", "No-charge arc right", (12.425, 0.0, 0.0)),
        ("basketball-fiba", "Free-throw circle right", (8.225, 0.0, 0.0)),  # the middle of the free-throw line
        ("basketball-nba", "Three-point arc left", (-41.75 * FOOT, 0.0, 0.0)),
        ("basketball-nba", "Rim left", (-41.75 * FOOT, 0.0, -10 * FOOT)),
        ("basketball-nba", "Free-throw circle right", (28 * FOOT + 0.0254, 0.0, 0.0)),
        ("futsal", "Penalty area right arc bottom", (20.0, 1.58, 0.0)),
        ("futsal", "Corner arc left top", (-20.0, -10.0, 0.0)),
        ("handball", "Goal area right arc bottom", (20.0, 1.5, 0.0)),
        ("handball", "Free-throw left arc top", (-20.0, -1.5, 0.0)),
    ],
)
def test_centres_of_arcs(name, label, center):
    np.testing.assert_allclose(COURTS[name][label].center, center, atol=1e-9)


@pytest.mark.parametrize(
    ("name", "label", "start", "end"),
    [
        ("basketball-fiba", "Centre line", (0, -7.70), (0, 7.70)),  # 0.15 beyond the side lines
        ("basketball-fiba", "No-charge line right bottom", (12.425, 1.275), (12.80, 1.275)),  # to the board's plane
        ("basketball-fiba", "Free-throw line right", (8.225, -2.425), (8.225, 2.425)),
        ("basketball-nba", "28-foot mark right bottom", (5.7658, 22 * FOOT), (5.7658, 7.6454)),
        ("handball", "Seven-metre line right", (13.025, -0.5), (13.025, 0.5)),
        ("handball", "Four-metre line right", (16.025, -0.075), (16.025, 0.075)),
        ("handball", "Substitution mark right bottom", (4.475, 9.80), (4.475, 10.15)),
        ("futsal", "Penalty area right line", (14.04, -1.58), (14.04, 1.58)),  # 3.16 m
        ("volleyball", "Service mark right bottom", (9.20, 4.475), (9.35, 4.475)),
        ("volleyball", "Attack line extension right bottom", (2.975, 4.70), (2.975, 6.25)),
        ("padel", "Central service line", (-7.20, 0.0), (7.20, 0.0)),
        ("tennis", "Centre mark right", (11.685, 0.0), (11.785, 0.0)),  # 0.10 m inside the base line
    ],
)
def test_ends_of_lines(name, label, start, end):
    line = COURTS[name][label]
    np.testing.assert_allclose([line.start[:2], line.end[:2]], [start, end], atol=1e-9)


@pytest.mark.parametrize(
    ("name", "label", "heights"),
    [
        ("basketball-fiba", "Backboard right upper", (3.95, 3.95)),
        ("basketball-fiba", "Backboard right lower", (2.90, 2.90)),
        ("basketball-nba", "Backboard left top", (13 * FOOT, 9.5 * FOOT)),
        ("futsal", "Goal right crossbar", (2.04, 2.04)),
        ("handball", "Goal left post top", (2.04, 0.0)),
        ("volleyball", "Net upper edge", (2.43, 2.43)),
        ("volleyball", "Net lower edge", (1.43, 1.43)),
        ("volleyball", "Antenna bottom", (3.23, 1.43)),
        ("badminton", "Net bottom", (1.524, 1.55)),
        ("tennis", "Net top", (0.914, 1.07)),
        ("tennis", "Net post top", (1.07, 0.0)),
        ("padel", "Net bottom", (0.88, 0.92)),
        ("padel", "Corner left top", (4.0, 0.0)),
        ("padel", "Glass right", (3.0, 3.0)),
    ],
)
def test_heights(name, label, heights):
    line = COURTS[name][label]
    np.testing.assert_allclose([-line.start[2], -line.end[2]], heights, atol=1e-9)


@pytest.mark.parametrize(
    ("name", "label", "joint"),
    [
        ("basketball-fiba", "Three-point line right bottom", 12.425 - np.sqrt(6.725**2 - 6.575**2)),
        ("basketball-nba", "Three-point line right bottom", 41.75 * FOOT - np.sqrt(7.2136**2 - 6.6802**2)),
    ],
)
def test_three_point_lines_join_their_arc(name, label, joint):
    line, arc = COURTS[name][label], COURTS[name]["Three-point arc right"]
    assert line.start[0] == pytest.approx(joint, abs=1e-4)
    X = arc.sample(0.1)
    np.testing.assert_allclose(X[X[:, 1].argmax()], line.start, atol=1e-9)
    assert X[:, 0].min() == pytest.approx(arc.center[0] - arc.radius, abs=1e-3)  # it bulges away from the basket


@pytest.mark.parametrize(
    ("name", "area", "end"),
    [
        ("futsal", "Penalty area", (20.0, 7.54)),
        ("handball", "Goal area", (20.0, 7.475)),
        ("handball", "Free-throw", (20.0 - np.sqrt(8.975**2 - 8.475**2), 9.975)),  # on the side line
    ],
)
def test_areas_are_closed(name, area, end):
    straight, arc = COURTS[name][f"{area} right line"], COURTS[name][f"{area} right arc bottom"]
    X = arc.sample(0.1)
    np.testing.assert_allclose(X[[0, -1]], [(*end, 0.0), straight.end], atol=1e-9)


def test_posts_of_nets_and_goals():
    assert COURTS["tennis"]["Net post bottom"].start[1] == pytest.approx(6.399)  # 0.914 m outside
    assert COURTS["badminton"]["Net post top"].start[1] == pytest.approx(-3.03)  # on the doubles side line
    for name in ("futsal", "handball"):
        assert COURTS[name]["Goal right post bottom"].start[:2] == pytest.approx((19.96, 1.54))  # 3 m inside
    for name, radius in (("basketball-fiba", 0.225), ("basketball-nba", 0.2286)):
        assert COURTS[name]["Rim right"].radius - 0.009 == pytest.approx(radius)


def test_marks_of_futsal_are_points():
    points = COURTS["futsal"].points
    assert {label: point.X[0] for label, point in points.items()} == {
        "Centre mark": 0.0,
        "Penalty mark right": 14.0,
        "Penalty mark left": -14.0,
        "Second penalty mark right": 10.0,
        "Second penalty mark left": -10.0,
    }
    assert not any(COURTS[name].points for name in NAMES if name != "futsal")


@needs_sportypy
@pytest.mark.parametrize("league", ["fiba", "nba"])
def test_basketball_is_as_sportypy_has_it(league):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the libraries that it imports
        from sportypy.surfaces.basketball import BasketballCourt

        params = BasketballCourt(league_code=league).court_params
    unit = {"m": 1.0, "ft": FOOT}[params["court_units"]]

    def first(name):
        return unit * np.atleast_1d(params[name])[0]

    court, end = COURTS[f"basketball-{league}"], 0.5 * first("court_length")
    expected = {
        "width of lines": (court.lines.width, first("line_thickness")),
        "width": (court.width, first("court_width")),
        "end line": (inner_edge(court, "End line right"), end),
        "side line": (inner_edge(court, "Side line bottom"), 0.5 * first("court_width")),
        "circle": (outer_edge(court, "Centre circle"), first("center_circle_radius")),
        "basket": (court["Rim right"].center[0], end - first("basket_center_to_baseline")),
        "ring": (court["Rim right"].radius - 0.009, first("basket_ring_inner_radius")),
        "three-point arc": (outer_edge(court, "Three-point arc right"), first("basket_center_to_three_point_arc")),
        "straight": (outer_edge(court, "Three-point line right bottom"), first("basket_center_to_corner_three")),
        "board": (court["Backboard right lower"].start[0], end - first("backboard_face_to_baseline")),
        "its width": (2.0 * court["Backboard right lower"].end[1], first("backboard_width")),
        "lane": (outer_edge(court, "Lane right bottom"), 0.5 * first("lane_width")),
        "free-throw line": (inner_edge(court, "Free-throw line right"), end - first("lane_length")),
        "free-throw circle": (outer_edge(court, "Free-throw circle right"), first("free_throw_circle_radius")),
        "no charge": (inner_edge(court, "No-charge arc right"), first("restricted_arc_radius")),
    }
    if league == "fiba":
        beyond = 0.5 * first("court_width") + first("line_thickness") + first("division_line_extension")
        expected |= {
            "throw-in": (outer_edge(court, "Throw-in line right top"), end - first("inbounding_line_to_baseline")),
            "bench": (2.0 * outer_edge(court, "Team bench line right top"), first("substitution_line_ext_sep")),
            "centre line": (court["Centre line"].end[1], beyond),
        }
    else:
        circle, lane = unit * params["center_circle_radius"][1], 0.5 * unit * params["lane_width"][1]
        marks = 2.0 * outer_edge(court, "Substitution mark right top")
        expected |= {
            "inner circle": (outer_edge(court, "Inner centre circle"), circle),
            "inner lane": (outer_edge(court, "Inner lane right bottom"), lane),
            "28-foot mark": (outer_edge(court, "28-foot mark right top"), end - first("inbounding_line_to_baseline")),
            "substitution marks": (marks, first("substitution_line_ext_sep")),
        }
    ours, theirs = np.array(list(expected.values())).T
    np.testing.assert_allclose(ours, theirs, atol=2e-4, err_msg=str(list(expected)))  # theirs: 2 in are 0.1667 ft


@needs_sportypy
def test_tennis_is_as_sportypy_has_it():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from sportypy.surfaces.tennis import TennisCourt

        params = TennisCourt("itf").court_params
    court = COURTS["tennis"]
    expected = [
        (2.0 * outer_edge(court, "Base line right", 0.10), FOOT * params["court_length"]),
        (2.0 * outer_edge(court, "Side line bottom"), FOOT * params["doubles_width"]),
        (2.0 * outer_edge(court, "Singles side line bottom"), FOOT * params["singles_width"]),
        (outer_edge(court, "Service line right"), FOOT * params["serviceline_distance"]),
        (2.0 * court["Net post bottom"].start[1], FOOT * params["net_length"]),
    ]
    np.testing.assert_allclose(*np.array(expected).T, atol=6e-3)  # theirs: feet, ours: rounded to metres by the ITF


# --- every court ---


def box(segment, turn=(1.0, 1.0, 1.0)):
    X = segment.sample(0.05) * turn
    return np.concatenate([X.min(axis=0), X.max(axis=0)])


@every_court
def test_turned_by_180_degrees_a_court_is_the_same(field):
    assert set(field.symmetric) == set(field.symmetric.values()) == set(field)
    for label, other in field.symmetric.items():
        turned = box(field[label], turn=(-1.0, -1.0, 1.0))
        np.testing.assert_allclose(turned, box(field[other]), atol=2e-3, err_msg=label)  # samples of a rim: 1 mm
        assert type(field[label]) is type(field[other])
        assert field.symmetric[other] == label


@every_court
def test_labels_say_where_a_segment_is(field):
    for label, segment in field.items():
        x, y, _ = segment.sample(0.05).mean(axis=0)
        words = label.split()
        for word, value in (("right", x), ("left", -x), ("bottom", y), ("top", -y)):
            assert word not in words or value > 0.0, label


@every_court
def test_all_is_on_the_court_or_close_to_it(field):
    low, high = field.boxes
    reach = np.array([field.length, field.width]) / 2.0
    assert np.all(np.abs(low[:, :2]) <= reach + 2.6)
    assert np.all(np.abs(high[:, :2]) <= reach + 2.6)
    assert np.all(low[:, 2] >= -4.0)
    assert np.all(high[:, 2] <= 0.0)


@every_court
def test_stands_are_around_the_court(field):
    for stand in field.stands:
        x, y, z = np.mean([stand.x, stand.y, stand.z], axis=1)
        assert abs(x) > field.length / 2.0 or abs(y) > field.width / 2.0
        corner = np.max(np.abs([stand.x, stand.y, stand.z]), axis=1)
        assert np.linalg.norm(corner) < field.farthest_camera
        assert z < 0.0


@every_court
def test_a_court_is_written_and_read(field):
    assert field_from_record(json.loads(json.dumps(field_to_record(field)))) == field
    assert pickle.loads(pickle.dumps(field)) == field


def test_courts_are_known_by_name_and_by_function():
    assert {*NAMES, *MORE} <= set(FIELDS)
    assert fields.basketball() == fields.basketball("fiba") == COURTS["basketball-fiba"]
    assert fields.basketball("nba") == COURTS["basketball-nba"]
    assert all(getattr(fields, name)() == COURTS[name] for name in NAMES if "-" not in name)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: fields.basketball("wnba"), "rules of a basketball court must be one of fiba, .*nfhs, got 'wnba'"),
        (lambda: fields.volleyball("mixed"), "net of a volleyball court must be one of men, women, got 'mixed'"),
        (lambda: fields.futsal(20.0, 40.0), "no room for its penalty areas"),
        (lambda: fields.futsal(25.0, 30.0), r"longer than wide.*futsal\(30.0, 25.0\)"),
        (lambda: fields.futsal(4000.0, 2000.0), "larger than any: expected metres"),
        (lambda: fields.futsal(np.nan, 20.0), "no room for its penalty areas"),
        (
            lambda: field_named("basketball"),
            "got .basketball.; did you mean basketball-",
        ),
        (
            lambda: fieldcalib.field("football"),
            "got 'football'; did you mean soccer, american-football-ncaa or american",
        ),
        (lambda: fieldcalib.field("Tenis"), "got 'Tenis'; did you mean tennis"),
        (lambda: fieldcalib.field("chess"), "got 'chess'$"),
        (lambda: fieldcalib.field(None), "got None$"),
    ],
)
def test_what_no_rule_book_has_is_refused(build, message):
    with pytest.raises(ValueError, match=message):
        build()


@pytest.mark.parametrize("name", MORE)
def test_further_fields_are_whole(name):
    """The markings that are mirrored are there, and the field of a file takes no arguments."""
    field = MORE[name]
    assert all(label.replace("bottom", "top") in field for label in field if "bottom" in label.split(" "))
    assert all(label.replace("right", "left") in field for label in field if "right" in label.split(" "))
    assert field.stands
    assert field.probability is not None
    assert field.moves_with_size is False
    if name in OF_FILES:
        with pytest.raises(TypeError, match="unexpected keyword argument 'length'"):
            fieldcalib.field(name, length=30.0)


def test_a_field_takes_the_arguments_of_its_function():
    assert fieldcalib.field("futsal", length=38.0, width=18.0) == fields.futsal(38.0, 18.0)
    assert fieldcalib.field("soccer", length=104) == fieldcalib.soccer(length=104)
    with pytest.raises(TypeError, match="length"):
        fieldcalib.field("tennis", length=24.0)


def test_futsal_of_another_size_keeps_its_areas():
    small, usual = fields.futsal(38.0, 18.0, size_known=True), COURTS["futsal"]
    assert usual.resized(38.0, 18.0).segments == small.segments
    assert outer_edge(small, "Goal line right") == pytest.approx(19.0)
    assert inner_edge(small, "Penalty area right line") == pytest.approx(13.0)
    assert small["Centre circle"] == usual["Centre circle"]
    assert field_to_record(small) == {"builder": "futsal", "length": 38.0, "width": 18.0, "size_known": True}


def test_the_net_of_women_is_lower():
    women = fields.volleyball("women")
    assert women["Net upper edge"].start[2] == -2.24
    assert women["Antenna top"].start[2] == pytest.approx(-3.04)
    assert women["Attack line right"] == COURTS["volleyball"]["Attack line right"]


# --- cameras ---


@solved(COURTS | MORE)
def test_frames_without_noise_give_back_their_cameras(field):
    frames, cameras = random_frames(12, seed=21, stands=tuple(field.named_stands), field=field)
    found = calibrate_batch(field, frames, SIZE, prior=None)
    errors = [relative_error(one.camera, truth) for one, truth in zip(found, cameras, strict=True)]
    assert max(errors) < 1e-6


@solved_court
def test_the_stands_of_a_court_are_its_prior(field):
    frames, cameras = random_frames(6, seed=5, least_segments=7, stands=tuple(field.named_stands), field=field)
    found = calibrate_batch(field, frames, SIZE, flags=PINHOLE_FLAGS)
    errors = [relative_error(one.camera, truth) for one, truth in zip(found, cameras, strict=True)]
    assert np.median(errors) < 0.01  # a weak prior moves cameras a little
    assert all(one.verdict == "good" for one in found)


@solved_court
def test_a_single_line_makes_no_good_camera(field):
    rng, seen = np.random.default_rng(3), 0
    for _ in range(40):
        camera = random_camera(field.stands[0], rng)
        for label, xy in observe({label: s for label, s in field.items() if isinstance(s, Line)}, camera).items():
            seen += 1
            assert calibrate_from_segments(field, {label: xy}, SIZE).verdict != "good", label
        if seen > 6:
            break
    assert seen > 6


def parallel_lines(field, axis):
    """The lines across the court (0) or along it (1), on the ground."""
    lines = {label: s for label, s in field.items() if isinstance(s, Line) and not s.start[2] and not s.end[2]}
    return {label: line for label, line in lines.items() if axis_of(line)[0] == axis}


def frames_of_lines(field, lines, count):
    """What the first cameras see, of a thousand random ones, that have two or more of the lines in view."""
    rng = np.random.default_rng(4)
    seen = (observe(lines, random_camera(field.stands[0], rng)) for _ in range(1000))
    frames = list(islice((frame for frame in seen if len(frame) >= 2), count))
    assert len(frames) == count
    return frames


@pytest.mark.parametrize("axis", [0, 1], ids=["across", "along"])
@solved_court
def test_parallel_lines_without_ends_make_no_good_camera(field, axis):
    lines, reach = parallel_lines(field, axis), 1e4 * np.eye(3)[1 - axis]
    endless = {label: Line(np.minimum(s.start, s.end) - reach, s.end + reach) for label, s in lines.items()}
    found = calibrate_batch(endless, frames_of_lines(field, lines, 12), SIZE, prior=list(field.stands))
    assert all(one.verdict != "good" for one in found)


@pytest.mark.parametrize("axis", [0, 1], ids=["across", "along"])
@solved_court
def test_parallel_lines_make_no_good_camera(field, axis):
    frames = frames_of_lines(field, parallel_lines(field, axis), 8)
    assert all(one.verdict != "good" for one in calibrate_batch(field, frames, SIZE))


def test_a_file_in_the_place_of_a_name_is_told_how_it_is_read():
    with pytest.raises(ValueError, match=r"got 'court.yaml'; fieldcalib.io.field_files.read_field reads a file"):
        field_named("court.yaml")
