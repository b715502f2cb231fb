"""What people type wrong is named: points that people clicked, and the same mistakes with known cameras."""

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from strategies import examples, numbers
from synthetic import in_image, observe, whole_circle_markings

from fieldcalib import (
    PINHOLE_FLAGS,
    Camera,
    Status,
    calibrate_batch,
    calibrate_from_homography,
    calibrate_from_points,
    calibrate_from_segments,
    soccer,
)
from fieldcalib.assess import Verdict
from fieldcalib.assess.findings import What
from fieldcalib.fields import badminton, tennis
from fieldcalib.solve import from_segments
from fieldcalib.solve.mislabels import without_mislabels
from fieldcalib.solve.solver_options import CalibrationFlags

SIZE = (960, 540)
Z_OVER, Y_OVER, X_OVER = np.array([1, 1, -1]), np.array([1, -1, 1]), np.array([-1, 1, 1])
KNOWN = PINHOLE_FLAGS | CalibrationFlags.CALIB_FIX_FOCAL_LENGTH
PITCH = soccer()
POINTS = np.array([point.X for point in PITCH.points.values()])
CAMERAS = {
    "left": Camera.from_angles(-0.5, 1.36, 0.01, 1500.0, (1.5, 68.0, -17.0), SIZE),
    "left and middle": Camera.from_angles(-0.3, 1.36, 0.01, 1300.0, (-2.0, 62.0, -15.0), SIZE),
    "right": Camera.from_angles(0.45, 1.34, -0.01, 1200.0, (3.0, 70.0, -20.0), SIZE),
}


def causes(calibration):
    return [one.what for one in calibration.findings if one.what not in (What.EXPLAINED, What.IMPROBABLE)]


def blamed(calibration):
    """Labels that are named as wrong, by any words."""
    return {label for label in calibration.per_segment_errors if repr(label) in calibration.reason}


def seen(camera, points=POINTS, noise=1.0):
    xy = camera.project(points)
    inside = in_image(xy, camera.image_size)
    return points[inside], (xy + np.random.default_rng(0).normal(size=xy.shape) * noise)[inside]


# points from public reports


@pytest.fixture(scope="module")
def reported(shared_data):
    """The cases of ../shared/data/reported by the first word of their names."""
    cases = yaml.safe_load((shared_data / "reported" / "points.yaml").read_text(encoding="utf-8"))
    return {case["name"].split(",")[0].split(" with ")[0]: case for case in cases}


def of_volleyball(case, size):
    xy = np.array(case["pixels_normalised_y_up"])
    xy = np.column_stack([xy[:, 0], 1.0 - xy[:, 1]]) * size
    return np.array(case["world"]) * case["world_scale"], xy, size


def of_penalty_area(case):
    """The twelve points, pitch metres with the goal at the right, in pixels of the screenshot as it was taken."""
    more = case["more"]
    world = [(52.5, -9.16), (47, -9.16), (47, 9.16), (52.5, 9.16), (52.5, -20.16), (36, 7.3125), (36, 20.16), (41.5, 0)]
    X = np.array([(*xy, 0) for xy in world] + [(52.5, y, z) for z in (0, -2.44) for y in (-3.66, 3.66)])
    others = [more["penalty area corner near"], more["spot"], *more["post feet"], *more["post tops"]]
    xy = np.array([*case["pixels"], *others], dtype=float) * np.divide(case["native_size"], case["size"])
    return X, xy, tuple(case["native_size"])


def test_six_points_of_tennis_prefer_the_net_where_it_stands(reported):
    case = reported["tennis"]
    X = np.array(case["world"], dtype=float)
    as_given = calibrate_from_points(X, case["pixels"], case["size"], prior=None)
    X[2:4, 1] = 11.885
    better = calibrate_from_points(X, case["pixels"], case["size"], prior=None)
    assert as_given.verdict == better.verdict == Verdict.GOOD
    assert better.rms < 0.5 * as_given.rms
    assert better.camera.focal_length == pytest.approx(4290.0, rel=0.02)


def test_volleyball_is_good_at_its_shape_and_squashed_at_another(reported):
    X, xy, size = of_volleyball(reported["volleyball"], (1280, 720))
    found = calibrate_from_points(X, xy, size, prior=None)
    assert found.verdict == Verdict.GOOD
    assert found.camera.focal_length == pytest.approx(2453.0, rel=0.01)
    X, xy, size = of_volleyball(reported["volleyball"], (960, 720))
    squashed = calibrate_from_points(X, xy, size, prior=None)
    assert (squashed.verdict, causes(squashed), blamed(squashed)) == (Verdict.CHECK, [What.NOT_SQUARE], set())


@pytest.mark.parametrize("signs", [Z_OVER, *(pytest.param(one, marks=pytest.mark.slow) for one in (Y_OVER, X_OVER))])
def test_axes_of_reported_points_that_are_turned_over(reported, signs):
    goal = reported["goal seen from the side"]
    for X, xy, size in (
        of_volleyball(reported["volleyball"], (1280, 720)),
        (np.array(goal["world"]), goal["pixels"], goal["size"]),
    ):
        right = calibrate_from_points(X, xy, size, prior=None)
        mirrored = calibrate_from_points(X * signs, xy, size, prior=None)
        assert right.verdict == Verdict.GOOD
        assert (mirrored.verdict, causes(mirrored), blamed(mirrored)) == (Verdict.REJECT, [What.LEFT_HANDED], set())


def test_four_measured_cameras_with_a_known_lens(reported):
    case = reported["four measured indoor tennis cameras"]
    places = []
    for camera in case["cameras"]:
        fx, fy, cx, cy = camera["K"]
        K = [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]
        arguments = case["world"], camera["pixels"], case["size"], K, camera["dist"]
        found = calibrate_from_points(*arguments, flags=KNOWN, prior=None)
        assert found.verdict == Verdict.GOOD
        places.append(found.camera.C)
    for one, other in (places[:2], places[2:]):
        np.testing.assert_allclose(one, other * (1, -1, 1), atol=0.25)  # the hall is symmetric


@pytest.mark.parametrize("prior", [None, pytest.param("all", marks=pytest.mark.slow)])
def test_of_six_points_none_is_blamed_and_of_twelve_the_two_that_are_off(reported, prior):
    X, xy, size = of_penalty_area(reported["penalty area of a screenshot that was resized to another shape"])
    six = calibrate_from_points(X[:6], xy[:6], size, prior=prior)
    assert six.verdict == Verdict.CHECK
    assert What.ONE_OF in causes(six)
    assert not blamed(six)
    twelve = calibrate_from_points(X, xy, size, prior=prior)
    assert twelve.verdict == Verdict.CHECK
    assert twelve.camera.focal_length == pytest.approx(3168.0, rel=0.02)
    assert blamed(twelve) == {"point 1", "point 3"}
    (edge,) = (one for one in twelve.findings if one.what is What.AT_EDGE)
    assert edge.about == "point 3"


def test_corners_of_a_court_are_those_of_singles_and_of_doubles(reported):
    case = reported["the four corners of a tennis court"]
    far_left, far_right, near_right, near_left = case["corners"]
    base = {"Base line right": [far_left, far_right], "Base line left": [near_right, near_left]}
    sides = {"Side line top": [far_left, near_left], "Side line bottom": [far_right, near_right]}
    singles = {f"Singles s{label[1:]}": xy for label, xy in sides.items()}
    for frame in (base | sides, base | singles):
        found = calibrate_from_segments(tennis(), frame, case["size"])
        assert found.verdict == Verdict.CHECK
        assert causes(found).count(What.TWO_WIDTHS) == 1
    names = {"baseline top": "Base line right", "baseline bottom": "Base line left", "sideline left": "Side line top"}
    names |= {
        "sideline right": "Side line bottom",
        "service top": "Service line right",
        "center": "Centre service line",
    }
    names |= {"service bottom": "Service line left", "singles left": "Singles side line top"}
    names |= {"singles right": "Singles side line bottom"}
    lines = {names[name]: xy for name, xy in case["lines"].items()}
    decided = calibrate_from_segments(tennis(), lines, case["size"])
    assert decided.accepted
    assert What.TWO_WIDTHS not in causes(decided)
    assert decided.camera.focal_length == pytest.approx(3947.0, rel=0.02)
    half_length, half_width = 11.885, 5.485
    X = np.array([[x, y, 0] for x, y in ((1, -1), (1, 1), (-1, 1), (-1, -1))]) * (half_length, half_width, 0)
    by_points = calibrate_from_points(X, case["corners"], case["size"], prior=None)
    assert (by_points.verdict, causes(by_points)) == (Verdict.CHECK, [What.TWO_WIDTHS])


def test_distances_of_a_guessed_rectangle_are_checked_by_nothing(reported):
    case = reported["a rectangle guessed from the mowing stripes"]
    found = calibrate_from_points(case["world"], case["pixels"], case["size"], prior=None)
    assert (found.status, found.verdict, causes(found)) == (Status.ACCEPTED, Verdict.CHECK, [What.UNCHECKED])


# the same mistakes with known cameras


@pytest.mark.parametrize(
    "name", ["left", *(pytest.param(name, marks=pytest.mark.slow) for name in CAMERAS if name != "left")]
)
@pytest.mark.parametrize("signs", [Z_OVER, *(pytest.param(one, marks=pytest.mark.slow) for one in (Y_OVER, X_OVER))])
@pytest.mark.parametrize("prior", [None, pytest.param("all", marks=pytest.mark.slow)])
def test_points_of_a_field_with_an_axis_turned_over(name, signs, prior):
    X, xy = seen(CAMERAS[name])
    assert calibrate_from_points(X, xy, SIZE, prior=prior).verdict == Verdict.GOOD
    found = calibrate_from_points(X * signs, xy, SIZE, prior=prior)
    assert (found.verdict, causes(found), blamed(found)) == (Verdict.REJECT, [What.LEFT_HANDED], set())
    (axes,) = (one for one in found.findings if one.what is What.LEFT_HANDED)
    assert "xyz".index(axes.about) == (2 if prior is None else np.argmin(signs))  # without a field any axis does


def test_wrong_points_are_searched_for_only_as_given_and_where_a_reading_explains_all(monkeypatch):
    """The search takes most of the time, and a dozen readings are tried."""
    searched = []
    monkeypatch.setattr(from_segments, "without_mislabels", lambda *a: searched.append(a) or without_mislabels(*a))
    X, xy = seen(CAMERAS["left"])
    assert causes(calibrate_from_points(X * Z_OVER, xy, SIZE, prior=None)) == [What.LEFT_HANDED]
    assert len(searched) == 2


@pytest.mark.parametrize(("signs", "axis"), [(Y_OVER, "y"), pytest.param(X_OVER, "x", marks=pytest.mark.slow)])
def test_points_of_the_ground_tell_handedness_on_a_field(signs, axis):
    X, xy = seen(CAMERAS["left"], POINTS[POINTS[:, 2] == 0.0])
    found = calibrate_from_points(X * signs, xy, SIZE)
    assert (found.verdict, causes(found)) == (Verdict.REJECT, [What.LEFT_HANDED])
    assert found.findings[0].about == axis


@pytest.mark.parametrize("prior", [None, "all"])
def test_pixels_with_x_and_y_exchanged(prior):
    """Clicks on a tennis court: a lens explains six of them nearly as well as the right reading."""
    X = np.array([(x, y, 0.0) for x in (-11.885, 11.885) for y in (-5.485, 5.485)] + [(-6.4, 0, 0), (6.4, 0, 0)])
    clicks = [(200, 861), (1673, 855), (487, 345), (1391, 344), (938, 686), (938, 425)]
    assert calibrate_from_points(X, clicks, (1920, 1080), prior=prior).verdict == Verdict.GOOD
    found = calibrate_from_points(X, np.flip(clicks, axis=1), (1920, 1080), prior=prior)
    assert (found.verdict, causes(found)) == (Verdict.REJECT, [What.EXCHANGED_PIXELS])
    assert found.reason == f"x and y of the pixels are exchanged; {found.findings[1]}"


@pytest.mark.slow
def test_axes_of_another_system_of_the_same_hand():
    X, xy = seen(CAMERAS["left"])
    found = calibrate_from_points(X * (1, -1, -1), xy, SIZE)
    assert (found.verdict, causes(found)) == (Verdict.REJECT, [What.OTHER_AXES])


@pytest.mark.parametrize("signs", [Y_OVER, X_OVER, np.array([1, 1, 1])])
@pytest.mark.parametrize("unit", [0.9144, 0.3048, 0.0254, 0.01, 0.001])
def test_a_template_in_other_units_is_refused_by_its_unit(signs, unit):
    X, xy = seen(CAMERAS["left and middle"])
    names = {0.9144: "yards", 0.3048: "feet", 0.0254: "inches", 0.01: "centimetres", 0.001: "millimetres"}
    with pytest.raises(ValueError, match=f"object_points look like {names[unit]} from"):
        calibrate_from_points(X * signs / unit, xy, SIZE)


@pytest.mark.parametrize("of_width", [1920, *(pytest.param(width, marks=pytest.mark.slow) for width in (640, 1280))])
@pytest.mark.parametrize("prior", [None, pytest.param("all", marks=pytest.mark.slow)])
def test_pixels_of_another_size_of_the_picture_are_not_good(of_width, prior):
    """Where the points contradict the size; where they do not, those of a field reach too near or too far."""
    camera = Camera.from_angles(-0.3, 1.3, 0.01, 1000.0, (-2.0, 62.0, -22.0), SIZE)
    X, xy = seen(camera, noise=0.3)
    found = calibrate_from_points(X, xy, (of_width, of_width * 9 // 16), prior=prior)
    assert found.verdict == Verdict.CHECK
    assert causes(found) == [What.OTHER_PICTURE]
    assert found.findings[0].numbers[0] == pytest.approx(SIZE[0], rel=0.15)


@given(shift=numbers(20.0, 200.0), which=st.integers(0, 5))
@examples(10)
def test_one_gross_error_among_six_points_is_blamed_on_none(shift, which):
    X, xy = seen(CAMERAS["left"])
    X, xy = X[:6], xy[:6].copy()
    xy[which] += (shift, -0.6 * shift)
    found = calibrate_from_points(X, xy, SIZE, prior=None)
    assert not blamed(found)
    assert not found.suspect_labels
    assert found.verdict != Verdict.GOOD


def test_a_cut_by_the_edge_that_is_called_a_corner():
    camera = CAMERAS["left"]
    X, xy = seen(camera)
    corner = np.array([[-52.5, 34.0, 0.0]])  # is beyond the left edge; its touchline leaves the picture there
    line = camera.project(np.column_stack([np.linspace(-52.5, 0.0, 5000), np.full(5000, 34.0), np.zeros(5000)]))
    cut = line[np.argmin(np.abs(line[:, 0]))]
    found = calibrate_from_points([*X, *corner], [*xy, cut], SIZE, prior=None)
    assert found.verdict == Verdict.CHECK
    assert blamed(found) == {f"point {len(X)}"}
    assert What.AT_EDGE in causes(found)


@pytest.mark.parametrize("prior", [None, "all"])
def test_corners_of_the_picture_are_no_corners_of_the_pitch(prior):
    X = [(x, y, 0) for x, y in ((-52.5, -34), (52.5, -34), (52.5, 34), (-52.5, 34))]
    found = calibrate_from_points(X, [(0, 0), (1919, 0), (1919, 1079), (0, 1079)], (1920, 1080), prior=prior)
    assert (found.verdict, causes(found)) == (Verdict.REJECT, [What.PICTURE_CORNERS])


@pytest.mark.parametrize("prior", [None, "all"])
def test_pixels_that_are_not_square(prior):
    X, xy = seen(CAMERAS["left and middle"], noise=0.3)
    found = calibrate_from_points(X, xy * (0.75, 1.0), (720, 540), prior=prior)
    assert (found.verdict, causes(found), blamed(found)) == (Verdict.CHECK, [What.NOT_SQUARE], set())


@pytest.mark.parametrize("prior", [None, pytest.param("all", marks=pytest.mark.slow)])
def test_points_that_are_bent_by_a_lens(prior):
    bent = Camera.from_angles(-0.3, 1.36, 0.01, 700.0, (-2.0, 62.0, -15.0), SIZE, k=(-0.35, 0.0))
    X, xy = seen(bent)
    found = calibrate_from_points(X, xy, SIZE, prior=prior)
    assert (found.verdict, causes(found), blamed(found)) == (Verdict.CHECK, [What.WANTS_LENS], set())
    flags = PINHOLE_FLAGS & ~CalibrationFlags.CALIB_FIX_K1
    assert not causes(calibrate_from_points(X, xy, SIZE, prior=prior, flags=flags)).count(What.WANTS_LENS)


@pytest.mark.parametrize("name", CAMERAS)
@pytest.mark.parametrize(("axis", "about"), [(0, "left and right"), (1, "top and bottom")])
def test_exchanged_sides_are_said_once(name, axis, about):
    camera, names = CAMERAS[name], PITCH.mirrored[axis]
    frame = observe(whole_circle_markings(PITCH), camera, np.random.default_rng(3), noise=0.5)
    exchanged = {names[label]: xy for label, xy in frame.items()}
    found = calibrate_from_segments(PITCH, exchanged, SIZE)
    assert (found.verdict, causes(found)) == (Verdict.CHECK, [What.EXCHANGED_SIDES])
    assert found.findings[0].about == about
    assert not found.suspect_labels
    assert set(found.per_segment_errors) == set(exchanged)
    np.testing.assert_allclose(found.camera.C, camera.C, atol=2.0)


def test_exchanged_sides_of_one_frame_are_not_those_of_another():
    frame = observe(whole_circle_markings(PITCH), CAMERAS["left"], np.random.default_rng(3), noise=0.5)
    exchanged = {PITCH.mirrored[0][label]: xy for label, xy in frame.items()}
    right, wrong = calibrate_batch(PITCH, [frame, exchanged], SIZE)
    assert What.EXCHANGED_SIDES not in causes(right)
    assert causes(wrong) == [What.EXCHANGED_SIDES]


def test_exchanged_sides_are_told_beside_a_circle_that_has_none():
    """One label alone contradicts a camera of the others: it is the only right one."""
    camera = CAMERAS["left and middle"]
    frame = {label: camera.project(PITCH[label].sample(3.0)) for label in ("Side line top", "Big rect. left main")}
    frame |= {label: camera.project(PITCH[label].sample(3.0)) for label in ("Big rect. left top", "Circle left")}
    frame["Circle central"] = camera.project(PITCH["Circle central"].sample(3.0))
    found = calibrate_from_segments(PITCH, {label.replace("left", "right"): xy for label, xy in frame.items()}, SIZE)
    assert (found.verdict, causes(found)) == (Verdict.CHECK, [What.EXCHANGED_SIDES])
    assert found.remedy == "exchange these two in all labels"


def test_a_label_that_is_missed_is_named_by_the_remedy():
    camera = CAMERAS["left and middle"]
    frame = observe(whole_circle_markings(PITCH), camera, np.random.default_rng(3), noise=0.5)
    label = next(label for label in frame if label.startswith("Big rect."))
    wrong = {**frame, label: frame[label] + (0.0, 60.0)}
    found = calibrate_from_segments(PITCH, wrong, SIZE)
    assert repr(label) in found.remedy


@pytest.mark.parametrize("way", [(-1.0, 1.0, 1.0), (1.0, -1.0, 1.0), (1.0, 1.0, 1.0)])
def test_points_of_a_plane_that_are_seen_from_below_say_so(way):
    X, xy = seen(CAMERAS["left and middle"])
    flat = X[:, 2] == 0.0
    found = calibrate_from_points(X[flat] * way, xy[flat], SIZE, prior=None)
    assert ("below the plane of the points" in found.reason) == (way != (1.0, 1.0, 1.0))


def test_a_size_with_width_and_height_exchanged_is_said():
    X, xy = seen(CAMERAS["left and middle"])
    found = calibrate_from_points(X[:6], xy[:6], SIZE[::-1])  # of more, an error says it
    turned = calibrate_from_points(X[:6], xy[:6, ::-1], SIZE)
    for one in (found, turned):
        assert one.verdict is not Verdict.GOOD
        assert "of another size, or are x and y exchanged?" in one.reason


def test_a_court_of_two_widths_is_decided_by_a_fifth_line():
    court = badminton()
    camera = Camera.from_angles(np.pi / 2.0, 1.2, 0.0, 1400.0, (-14.0, 0.2, -5.0), SIZE)
    sides = ("Back line left", "Back line right", "Side line top", "Side line bottom")
    for labels, is_open in ((sides, True), ((*sides, "Short service line right"), False)):
        frame = {label: camera.project(court[label].sample()) for label in labels}
        found = calibrate_from_segments(court, frame, SIZE)
        assert found.accepted
        assert (What.TWO_WIDTHS in causes(found)) == is_open


def test_four_points_with_a_known_focal_length_check_their_distances():
    camera = CAMERAS["left"]
    X = np.array([(-52.5, -20.16, 0.0), (-36.0, -20.16, 0.0), (-36.0, 20.16, 0.0), (-52.5, 20.16, 0.0)])
    assert causes(calibrate_from_points(X, camera.project(X), SIZE, prior=None)) == [What.UNCHECKED]
    found = calibrate_from_points(X, camera.project(X), SIZE, camera.K, flags=KNOWN, prior=None)
    assert found.verdict == Verdict.GOOD
    guessed = calibrate_from_points(X * (1.3, 1.0, 1.0), camera.project(X), SIZE, camera.K, flags=KNOWN, prior=None)
    assert guessed.verdict != Verdict.GOOD


def test_a_homography_of_rank_two():
    H = CAMERAS["left"].homography
    U, values, V = np.linalg.svd(H)
    found = calibrate_from_homography(U @ np.diag([*values[:2], 0.0]) @ V, SIZE)
    assert (found.verdict, causes(found)) == (Verdict.REJECT, [What.RANK])


@pytest.mark.parametrize("width", [640, 1280, 1920])
def test_a_homography_of_another_size_of_the_picture(width):
    for camera in CAMERAS.values():
        found = calibrate_from_homography(camera.homography, (width, width * 9 // 16))
        assert found.verdict != Verdict.GOOD
        (size,) = (one.numbers for one in found.findings if one.what is What.OTHER_PICTURE)
        assert size == SIZE
