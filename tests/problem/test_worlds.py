"""Fields that are no soccer pitch: nothing of soccer's stands, sizes, lines or probabilities reaches them."""

import ast
import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import examples
from synthetic import observe

import fieldcalib
from fieldcalib.assess.findings import Verdict, What
from fieldcalib.assess.ndc import ndc_loss
from fieldcalib.assess.probability import largest_move
from fieldcalib.assess.result import doubted
from fieldcalib.draw.scene import render_field
from fieldcalib.fields.field import Field
from fieldcalib.fields.segments import Arc, Line, Point
from fieldcalib.fields.sports.soccer import PROBABILITY, soccer
from fieldcalib.fields.traits import (
    ALL_STANDS,
    MAIN_CENTER,
    CameraDistribution,
    Halves,
    LineLook,
    ProbabilityModel,
    SizePrior,
    stands_around,
)
from fieldcalib.geometry.camera import Camera
from fieldcalib.images.paint.line_profiles import Markings, find_lines, profiles_along
from fieldcalib.images.refinement import line_support, refine_on_image
from fieldcalib.problem.evaluation import Problem, evaluate
from fieldcalib.problem.labelled_pixels import split_circles
from fieldcalib.problem.layout import Layout, theta_from_camera
from fieldcalib.problem.levenberg_marquardt import levenberg_marquardt
from fieldcalib.problem.losses import RobustLoss
from fieldcalib.problem.observations import pack
from fieldcalib.solve.batch import calibrate_batch
from fieldcalib.solve.field_size import estimate_field_size
from fieldcalib.solve.from_segments import calibrate_from_segments

SIZE = (960, 540)
PITCH = soccer()

# A basketball court, 28 x 15 m, with a gantry on one side of it.
SIDE = CameraDistribution("sideline", (-50, 50), (45, 90), (-5, 5), (15, 70), (-8, 8), (12, 32), (-12, -2))


def court_segments(length=28.0, width=15.0):
    """The lines of FIBA's court; the free-throw line is 5.8 m from the base line, the key 4.9 m wide."""
    x, y = length / 2.0, width / 2.0
    segments = {
        "Side line far": Line((-x, -y, 0.0), (x, -y, 0.0)),
        "Side line near": Line((-x, y, 0.0), (x, y, 0.0)),
        "Centre line": Line((0.0, -y, 0.0), (0.0, y, 0.0)),
        "Centre circle": Arc((0.0, 0.0, 0.0), 1.8),
    }
    for side, sign in (("left", -1.0), ("right", 1.0)):
        base, throw = sign * x, sign * (x - 5.8)
        segments[f"Base line {side}"] = Line((base, -y, 0.0), (base, y, 0.0))
        segments[f"Key {side} far"] = Line((base, -2.45, 0.0), (throw, -2.45, 0.0))
        segments[f"Key {side} near"] = Line((base, 2.45, 0.0), (throw, 2.45, 0.0))
        segments[f"Key {side} main"] = Line((throw, -2.45, 0.0), (throw, 2.45, 0.0))
        segments[f"Free throw circle {side}"] = Arc((throw, 0.0, 0.0), 1.8)
    return segments


def court(length=28.0, width=15.0):
    sizes = SizePrior(((22.0, 29.0), (13.0, 16.0)), ((26.0, 28.0), (14.0, 15.0)), build=court)
    return Field(length, width, court_segments(length, width), stands=(SIDE,), farthest_camera=60.0, size_model=sizes)


COURT = court()
SEEN = ("Side line far", "Side line near", "Centre line", "Centre circle")


def court_camera(x=1.0, y=22.0, z=-6.0, pan=None, f=1100.0, k=(0.0, 0.0)):
    """A camera of 960 x 540 that looks at the centre of the court, unless it is panned elsewhere."""
    pan = np.arctan2(-x, y) if pan is None else pan
    return Camera.from_angles(pan, np.arctan2(np.hypot(x, y), -z), 0.01, f, (x, y, z), SIZE, k=k)


def labelled(field, camera, labels, rng=None, noise=0.0):
    return observe({label: field[label] for label in labels}, camera, rng, noise)


@examples(15)
@given(st.floats(-6.0, 6.0), st.floats(16.0, 28.0), st.floats(-9.0, -4.0), st.floats(900.0, 1300.0))
def test_three_lines_and_a_circle_of_a_court_give_its_camera(x, y, z, f):
    """And not one of a stadium, three times as far away."""
    truth = court_camera(x, y, z, f=f)
    found = calibrate_from_segments(COURT, labelled(COURT, truth, SEEN), SIZE)
    assert found.accepted, found.message
    assert np.linalg.norm(found.camera.C - truth.C) < 2.5  # zoom and lens are poorly determined by so few labels
    assert found.camera.focal_length == pytest.approx(f, rel=0.12)
    assert found.alternatives == ()  # nobody films from the other side


def test_one_court_and_many_are_calibrated_alike():
    rng = np.random.default_rng(4)
    truths = [court_camera(x, 20.0 + x, -6.0) for x in (-4.0, 0.0, 3.0)]
    frames = [labelled(COURT, truth, SEEN, rng, 0.5) for truth in truths]
    for truth, one in zip(truths, calibrate_batch(COURT, frames, SIZE), strict=True):
        assert one.accepted
        assert np.linalg.norm(one.camera.C - truth.C) < 1.0


def test_few_labels_leave_the_camera_on_the_stand_of_the_court():
    """Soccer's prior has it 66 m away."""
    truth = court_camera()
    frame = labelled(COURT, truth, SEEN[:2])
    on_court = calibrate_from_segments(COURT, frame, SIZE).camera
    in_stadium = calibrate_from_segments(COURT, frame, SIZE, prior=ALL_STANDS).camera
    assert 12.0 < on_court.C[1] < 32.0
    assert in_stadium.C[1] > 40.0


def test_the_camera_of_a_field_without_stands_may_be_anywhere():
    bare = Field(28.0, 15.0, court_segments())
    frame = labelled(COURT, court_camera(), SEEN)
    with pytest.raises(ValueError, match="the object is not a Field: make it one"):
        calibrate_from_segments(dict(bare), frame, SIZE)
    (batched,) = calibrate_batch(bare, [frame], SIZE)
    assert np.linalg.norm(batched.camera.C - court_camera().C) < 1.0
    corner = Camera.from_angles(0.8, 1.1, 0.0, 1500.0, (-32.0, 36.0, -30.0), SIZE)  # far from stands around the court
    found = calibrate_from_segments(bare, labelled(COURT, corner, SEEN), SIZE)
    assert found.verdict is Verdict.GOOD
    assert np.linalg.norm(found.camera.C - corner.C) < 1.0
    for prior in ("all", ["all", SIDE], SIDE, None):
        found = calibrate_from_segments(bare, frame, SIZE, prior=prior)
        assert np.linalg.norm(found.camera.C - court_camera().C) < 1.0


@pytest.mark.parametrize("prior", ["all", None])
def test_points_of_a_court_are_enough_without_a_place(prior):
    """The principal point stays near the middle, whatever is unknown of the place."""
    corners = {f"{x} {y}": Point((x, y, 0.0)) for x in (-14.0, -8.2, 8.2, 14.0) for y in (-7.5, -2.4, 2.4, 7.5)}
    field, truth = Field(28.0, 15.0, corners), Camera.from_angles(0.3, 1.2, 0.0, 900.0, (-5.0, 30.0, -12.0), SIZE)
    rng = np.random.default_rng(0)
    for _ in range(6):
        seen = list(corners)[::2] + list(corners)[:2]
        clicks = {name: truth.project([corners[name].X]) + rng.normal(0.0, 1.0, (1, 2)) for name in seen}
        (found,) = fieldcalib.calibrate(clicks, field, image_size=SIZE, prior=prior, progress=False).values()
        assert found.verdict is Verdict.GOOD, found.reason
        assert largest_move(truth, found.camera, field) < 1.0
        four = dict(list(clicks.items())[:4])
        (found,) = fieldcalib.calibrate(
            four, field, image_size=SIZE, prior=prior, flags=fieldcalib.PINHOLE_FLAGS, progress=False
        ).values()
        assert found.verdict is not Verdict.GOOD
        assert found.has_finding(What.UNCHECKED)


def test_stands_are_known_by_the_names_of_the_field():
    frame = labelled(COURT, court_camera(), SEEN)
    by_name = calibrate_from_segments(COURT, frame, SIZE, prior="sideline")
    assert by_name.camera == calibrate_from_segments(COURT, frame, SIZE, prior=SIDE).camera
    with pytest.raises(ValueError, match="unknown camera distribution 'main center': expected 'all', 'sideline'"):
        calibrate_from_segments(COURT, frame, SIZE, prior="main center")
    assert "main tribune" in PITCH.named_stands
    assert "main tribune" not in {stand.name for stand in PITCH.stands}


def test_a_camera_farther_away_than_those_of_the_field_is_implausible():
    truth = court_camera(0.0, 70.0, -20.0, f=3500.0)
    frame = labelled(COURT, truth, SEEN)
    anywhere = replace(SIDE, y=(20.0, 100.0), z=(-30.0, -2.0), fov=(5.0, 70.0))
    for farthest, accepted in ((60.0, False), (np.inf, True)):
        found = calibrate_from_segments(replace(COURT, farthest_camera=farthest), frame, SIZE, prior=anywhere)
        assert found.accepted is accepted, found.message
    assert "it stands more than 60 m away" in calibrate_from_segments(COURT, frame, SIZE, prior=anywhere).message


def test_a_field_whose_probabilities_nobody_fitted_has_none():
    found = calibrate_from_segments(COURT, labelled(COURT, court_camera(), SEEN), SIZE)
    assert found.accepted
    assert not found.has_probability
    for ask in (found.probability, lambda: doubted(found, 0.5)):
        with pytest.raises(ValueError, match="a Field with a probability model, as soccer"):
            ask()
    assert np.isfinite(found.field_uncertainty((480.0, 270.0)).rms)
    fitted = replace(found, field=replace(COURT, probability=ProbabilityModel((9.0, 0.0, 0.0, 0.0, 0.0))))
    assert fitted.probability() == pytest.approx(1.0 / (1.0 + np.exp(-9.0)))


def test_the_other_side_of_a_symmetric_field_is_told_and_of_another_one_is_not():
    assert COURT.symmetric["Key left far"] == "Key right near"
    assert {"Centre line", "Centre circle"} == COURT.self_symmetric
    both = replace(COURT, stands=(SIDE, replace(SIDE, name="opposite", pan=(130, 230), y=(-32, -12))))
    frame = labelled(COURT, court_camera(), ("Centre line", "Centre circle"))
    (other,) = calibrate_from_segments(both, frame, SIZE).alternatives
    assert other.C[1] < 0.0
    half = Field(14.0, 15.0, {label: s for label, s in court_segments().items() if "right" in label}, stands=(SIDE,))
    assert half.symmetric == {}
    assert half.self_symmetric == frozenset()


def test_the_size_of_a_court_is_estimated_under_its_own_rules():
    truth = court(27.2, 14.6)
    rng = np.random.default_rng(1)
    cameras = [court_camera(0.0, 20.0, -7.0, pan, 700.0) for pan in (-0.4, -0.2, 0.0, 0.2, 0.4)]
    frames = [observe(truth, camera, rng, 0.5) for camera in cameras]
    found = estimate_field_size(COURT, frames, SIZE)
    assert (found.length, found.width) == pytest.approx((27.2, 14.6), abs=0.2)
    assert np.all(found.interval[0] >= (22.0, 13.0))
    with pytest.raises(ValueError, match=r"22 to 29 x 13 to 16 m \(the rules\)"):
        estimate_field_size(court(30.0, 15.0), frames, SIZE)
    with pytest.raises(ValueError, match="how other segments move is not known"):
        estimate_field_size(replace(COURT, size_model=None), frames, SIZE)


def test_halves_of_a_circle_are_what_the_field_says():
    halves = {name: Arc((0.0, 0.0, 0.0), 1.8, *ends) for name, ends in (("l", (1.6, 4.7)), ("r", (-1.5, 1.5)))}
    split = replace(
        COURT, segments={**court_segments(), **halves}, halves={"Centre circle": Halves("l", "r", "Centre line")}
    )
    frame = {"Centre line": np.array([[480.0, 100], [480, 400]]), "Centre circle": np.array([[450.0, 250], [500, 250]])}
    found = split_circles(split, frame, SIZE)
    np.testing.assert_array_equal(found["l"], [[450.0, 250.0]])
    np.testing.assert_array_equal(found["r"], [[500.0, 250.0]])
    for whole in (COURT, dict(split)):
        assert split_circles(whole, frame, SIZE) == frame
    assert split.half_labels == {"l", "r"}
    assert COURT.half_labels == frozenset()
    truth = court_camera()
    loss = ndc_loss([truth], split, [labelled(split, truth, SEEN)])
    assert loss[0] < 0.005  # 128 samples of the circle
    with pytest.raises(ValueError, match="halves name 'east', which is no segment"):
        replace(COURT, halves={"Centre circle": Halves("east", "west", "Centre line")})


# --- an ice rink: lines darker than the ice ---

RINK_STAND = CameraDistribution("gantry", (-60, 60), (40, 85), (-5, 5), (15, 90), (-10, 10), (35, 60), (-25, -8))
ICE = LineLook(width=0.3, lighter=False, ground_difference=0.05)


def rink(lines=ICE):
    """61 x 26 m: boards as straight lines, the red and the blue ones, five circles."""
    x, y = 30.5, 13.0
    segments = {
        "Boards far": Line((-x + 8.5, -y, 0.0), (x - 8.5, -y, 0.0)),
        "Boards near": Line((-x + 8.5, y, 0.0), (x - 8.5, y, 0.0)),
        "Red line": Line((0.0, -y, 0.0), (0.0, y, 0.0)),
        "Centre circle": Arc((0.0, 0.0, 0.0), 4.5),
    }
    for side, sign in (("left", -1.0), ("right", 1.0)):
        segments[f"Blue line {side}"] = Line((sign * 7.5, -y, 0.0), (sign * 7.5, y, 0.0))
        segments[f"Goal line {side}"] = Line((sign * 26.5, -11.5, 0.0), (sign * 26.5, 11.5, 0.0))
        for end, y_sign in (("far", -1.0), ("near", 1.0)):
            segments[f"Circle {side} {end}"] = Arc((sign * 20.5, y_sign * 7.0, 0.0), 4.5)
    return Field(61.0, 26.0, segments, stands=(RINK_STAND,), lines=lines)


RINK = rink()
RINK_CAMERA = Camera.from_angles(0.1, 1.25, 0.0, 1000.0, (0.0, 46.0, -16.0), SIZE)


def ice_picture(camera, field=RINK):
    """Black lines on nearly white ice: the negative of painted lines."""
    return 255 - render_field(camera, replace(field, lines=replace(field.lines, lighter=True)))


def test_dark_lines_are_found_where_the_field_says_that_they_are_dark():
    picture = ice_picture(RINK_CAMERA)
    dark, light = (
        find_lines(picture, profiles_along(RINK_CAMERA, Markings.of(field)), 4.0)
        for field in (RINK, rink(replace(ICE, lighter=True)))
    )
    assert np.mean(np.isfinite(dark)) > 0.7
    assert np.nanmedian(np.abs(dark)) < 0.3
    assert np.mean(np.isfinite(light)) < 0.2
    assert line_support(picture, RINK_CAMERA, Markings.of(RINK)) > 0.5


def test_a_rink_is_refined_on_its_image():
    labels = ("Boards far", "Red line", "Blue line right", "Centre circle", "Circle right far")
    frame = {label: xy + (4.0, 2.0) for label, xy in labelled(RINK, RINK_CAMERA, labels).items()}
    first = calibrate_from_segments(RINK, frame, SIZE)
    refined = refine_on_image(RINK, ice_picture(RINK_CAMERA), first)
    X = np.array([(0.0, 0.0, 0.0), (7.5, 3.0, 0.0), (-7.5, -9.0, 0.0)])
    before, after = (np.abs(one.camera.project(X) - RINK_CAMERA.project(X)).max() for one in (first, refined))
    assert before > 2.0
    assert after < 0.5


def test_profiles_are_as_wide_and_as_dense_as_the_lines_of_the_field():
    wide, narrow = (
        profiles_along(RINK_CAMERA, Markings.of(rink(replace(ICE, width=width)))).width for width in (0.3, 0.05)
    )
    np.testing.assert_allclose(wide, 6.0 * narrow, rtol=1e-3)
    fine, coarse = (len(Markings.of(replace(RINK, scale=scale)).X) for scale in (10.0, 40.0))
    assert fine > 3.5 * coarse


@pytest.mark.parametrize("name", ["width", "contrast", "contrast_raised", "ground_difference"])
@pytest.mark.parametrize("value", [0.0, -1.0, np.nan])
def test_a_look_without_a_size_is_refused(name, value):
    with pytest.raises(ValueError, match=f"the {name} of a LineLook must be positive, got {value}"):
        LineLook(**{name: value})


# --- a table, which is no field ---


def test_a_table_with_a_tray_is_no_field():
    """A mapping of segments stays one: a prior of its own, no verdict of a field, no probability."""
    z = -0.75
    table = {
        "edge": Arc((0.0, 0.0, z), 0.6),
        "tray front": Line((-0.25, 0.15, z), (0.25, 0.15, z)),
        "tray left": Line((-0.25, 0.15, z), (-0.25, -0.2, z)),
        "tray back": Line((-0.25, -0.2, z), (0.25, -0.2, z)),
    }
    below = Camera.from_angles(0.2, np.pi - 1.15, 0.03, 1200.0, (-0.5, 2.2, 0.4), SIZE)  # under a glass table
    room = CameraDistribution("in the room", (-40, 40), (80, 135), (-10, 10), (30, 90), (-2, 2), (1, 4), (-0.2, 1))
    found = calibrate_from_segments(table, observe(table, below), SIZE, prior=room)
    assert found.accepted, found.message
    assert np.linalg.norm(found.camera.C - below.C) < 0.1
    assert found.field is None
    assert not found.has_probability
    with pytest.raises(ValueError, match="the object is not a Field"):
        calibrate_from_segments(table, observe(table, below), SIZE)


# --- what a field is ---


def test_defaults_know_nothing_but_the_segments():
    bare = Field(28.0, 15.0, court_segments())
    assert bare.stands == ()
    assert bare.farthest_camera == np.inf
    assert bare.lines == LineLook()
    assert bare.halves == {}
    assert bare.size_model is None
    assert bare.probability is None
    assert bare.size_known is False
    assert bare.scale == pytest.approx(10.2, abs=0.05)  # a third of the diagonal
    with pytest.raises(ValueError, match="how other segments move is not known"):
        bare.resized(27.0, 15.0)


def test_soccer_knows_all_of_it():
    assert PITCH.stands == ALL_STANDS
    assert (PITCH.farthest_camera, PITCH.scale, PITCH.lines.width) == (300.0, 40.0, 0.12)
    assert PITCH.size_model.legal == ((90.0, 120.0), (45.0, 90.0))
    np.testing.assert_allclose(PITCH.size_model.limits, [(90.0, 45.0), (120.0, 90.0)])
    np.testing.assert_allclose(PITCH.size_model.sigma, (10.0 / 3.92, 11.0 / 3.92))
    assert PITCH.probability == PROBABILITY
    assert not PITCH.size_known
    assert soccer(100.0, 64.0, size_known=True).size_known


@pytest.mark.parametrize("field", [PITCH, COURT, RINK, soccer(101.0, 66.0, size_known=True)])
def test_fields_can_be_compared_hashed_and_sent_to_another_process(field):
    other = pickle.loads(pickle.dumps(field))
    assert other == field
    assert hash(other) == hash(field)
    assert dict(other.symmetric) == dict(field.symmetric)
    for changed in (
        {"scale": 1.0},
        {"farthest_camera": 5.0},
        {"stands": (MAIN_CENTER,), "more_stands": ()},
        {"lines": LineLook(width=0.2)},
        {"probability": ProbabilityModel((1.0, 0.0, 0.0, 0.0, 0.0))},
        {"size_known": not field.size_known},
    ):
        assert replace(field, **changed) != field, changed


def test_more_segments_and_another_size_keep_the_world():
    more = COURT.with_segments({"hoop": Arc((12.4, 0.0, -3.05), 0.225)})
    assert replace(more, segments=COURT.segments) == COURT
    exact = replace(COURT, size_known=True)
    assert exact.resized(27.0, 14.5) == replace(court(27.0, 14.5), size_known=True)
    with pytest.raises(ValueError, match="how other segments move is not known"):
        more.resized(27.0, 14.5)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"length": 0.0}, "a Field needs a positive length in metres, got 0.0"),
        ({"width": np.nan}, "positive width in metres, got nan"),
        ({"scale": -1.0}, "positive scale in metres"),
        ({"farthest_camera": 0.0}, "positive farthest_camera in metres"),
        ({"stands": (SIDE, SIDE)}, "the stands of a Field need different names"),
        ({"more_stands": (SIDE,)}, "the stands of a Field need different names"),
    ],
)
def test_impossible_fields_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        replace(COURT, **changes)


def test_impossible_sizes_and_models_are_refused():
    with pytest.raises(
        ValueError, match=r"the legal sizes must be \(low, high\) with 0 < low < high, got \(29.0, 22.0"
    ):
        SizePrior(((29.0, 22.0), (13.0, 16.0)), ((26.0, 28.0), (14.0, 15.0)), build=court)
    with pytest.raises(ValueError, match="five finite coefficients"):
        ProbabilityModel((1.0, 2.0))
    with pytest.raises(ValueError, match="must be a probability"):
        ProbabilityModel((1.0, 0.0, 0.0, 0.0, 0.0), least_in_picture=50.0)


@given(st.floats(90.0, 120.0), st.floats(45.0, 90.0))
def test_a_pitch_is_given_in_metres_the_touchline_first(length, width):
    soccer(length, width)
    for factor in (100.0, 1000.0):
        with pytest.raises(ValueError, match="larger than any: expected metres"):
            soccer(factor * length, factor * width)
    if width > 2.0 * (16.5 + 9.15) and width < 90.0:
        with pytest.raises(ValueError, match=r"longer than wide, .* give both in metres, the touchline first"):
            soccer(width, length)


@pytest.mark.parametrize(("size", "message"), [((68, 105), r"soccer\(105, 68\)"), ((10500, 6800), "not centimetres")])
def test_swapped_sides_and_centimetres_say_how_to_mend_them(size, message):
    with pytest.raises(ValueError, match=message):
        soccer(*size)


# --- the scale ---


@given(st.floats(-3.0, 3.0))
def test_a_field_in_other_units_is_solved_in_the_same_steps(log_factor):
    """Lengths, stands and scale times a factor: the cameras are the same, with their centres times it."""
    factor = float(np.exp(log_factor))

    def scaled(X):
        return tuple(factor * x for x in X)

    segments = {
        label: Line(scaled(s.start), scaled(s.end)) if isinstance(s, Line) else Arc(scaled(s.center), factor * s.radius)
        for label, s in court_segments().items()
    }
    stand = replace(SIDE, x=scaled(SIDE.x), y=scaled(SIDE.y), z=scaled(SIDE.z))
    other = Field(factor * 28.0, factor * 15.0, segments, stands=(stand,))
    assert other.scale == pytest.approx(factor * COURT.scale)
    truth = court_camera(k=(0.02, 0.0))
    frame = labelled(COURT, truth, [*SEEN, "Key left main", "Key right main"], np.random.default_rng(3), 1.0)
    here, there = (calibrate_batch(field, [frame], SIZE)[0] for field in (COURT, other))
    assert here.status is there.status
    np.testing.assert_allclose(there.camera.C / factor, here.camera.C, rtol=1e-3)
    assert there.camera.focal_length == pytest.approx(here.camera.focal_length, rel=1e-3)


def test_the_centre_moves_no_further_than_the_scale_in_one_step():
    frame, start = labelled(COURT, court_camera(), SEEN), theta_from_camera(court_camera(0.0, 60.0, -20.0))[None]
    layout = Layout.of(SIZE).fixed("lens", "principal point", "aspect")
    for scale in (0.5, 5.0):
        problem = Problem(pack(COURT, [frame], SIZE), layout, RobustLoss("cauchy", 20.0), scale=scale)
        moved = levenberg_marquardt(evaluate(problem, start), max_iterations=1, tolerance=1e-9).theta - start
        assert np.abs(moved[0, 4:7]).max() <= scale * (1.0 + 1e-12)
        assert np.any(moved)


def test_stands_around_an_object_of_a_pitchs_size_are_those_of_a_pitch():
    assert stands_around(40.0) == ALL_STANDS
    tenth = stands_around(4.0)[0]
    assert (tenth.y, tenth.z) == ((4.0, 11.0), (-4.0, -0.5))
    assert tenth.fov == ALL_STANDS[0].fov


# --- and nothing else knows soccer's ---

PACKAGE = Path(fieldcalib.__file__).parent
KNOW_SOCCER = ("fields/sports/", "io/")  # the field itself, others that have such lines too, formats of others


def strings_of_code(path):
    """String constants of a module, docstrings left out."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    documented = (ast.Module, ast.ClassDef, ast.FunctionDef)
    docs = {
        id(statement.value)
        for node in ast.walk(tree)
        if isinstance(node, documented)
        for statement in node.body
        if isinstance(statement, ast.Expr)
    }
    return {
        node.value
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in docs
    }


def test_no_other_module_names_a_marking_of_soccer():
    names = set(PITCH.markings)
    files = {path.relative_to(PACKAGE).as_posix(): path for path in PACKAGE.rglob("*.py")}
    naming = {name: path for name, path in files.items() if any(map(path.read_text("utf-8").__contains__, names))}
    knowing = {name for name, path in naming.items() if names & strings_of_code(path)}
    assert "fields/sports/soccer.py" in knowing  # the search finds what there is
    assert {name for name in knowing if not name.startswith(KNOW_SOCCER)} == set()
