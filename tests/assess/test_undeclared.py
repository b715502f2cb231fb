"""Pictures that are not what they seem: parts of frames, sizes that are not theirs, and how they are measured."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pictures import picture
from strategies import examples
from synthetic import observe, whole_circle_markings

from data_tools.simulated import observe as demo_labels
from data_tools.simulated import pan_over_field
from data_tools.undeclared import basketball_cameras, calibrated, changed, changed_image, counts, part_of
from fieldcalib import calibrate_from_segments, soccer
from fieldcalib.assess.camera_errors import (
    _freed,
    largest_error_of_part,
    principal_point_of,
    score_above,
    seems_part,
)
from fieldcalib.assess.findings import CUT, SHAPE, Verdict, What
from fieldcalib.assess.probability import surprises
from fieldcalib.assess.result import Calibration, in_picture
from fieldcalib.fields.catalogue import field_named
from fieldcalib.fields.segments import Line
from fieldcalib.fields.traits import DISTRIBUTIONS
from fieldcalib.geometry.camera import Camera
from fieldcalib.images.shape.borders_and_windows import borders_of, parts_of, within_borders
from fieldcalib.problem.layout import ROLL
from fieldcalib.problem.picture_shape import (
    PART_SCALE,
    Declared,
    Placement,
    frame_around,
    log_ratio_of_cut,
    principal_point_sigma,
    score_of_part,
)
from fieldcalib.solve.batch import calibrate_batch
from fieldcalib.solve.likelier_shape import likelier
from fieldcalib.solve.solver_options import DEFAULT_FLAGS, CalibrationFlags

FIELD, KNOWN, SIZE = soccer(), soccer(size_known=True), (960, 540)
GROUND = np.array([[0.0, 0.0, 0.0], [30.0, 0.0, 0.0]])
CAMERA = Camera.from_angles(0.3, 1.35, 0.0, 1300.0, (0.0, 62.0, -15.0), SIZE)
OVERVIEW = Camera.from_angles(0.45, 1.33, 0.0, 900.0, (0.0, 65.0, -16.0), SIZE)  # its labels tell the shape


def frame_of(camera=CAMERA, noise=1.0, seed=0):
    return observe(whole_circle_markings(FIELD), camera, np.random.default_rng(seed), noise)


@given(st.integers(100, 4000), st.integers(100, 4000))
def test_a_picture_fits_into_its_frame_which_is_one_of_16_to_9(width, height):
    frame = frame_around((width, height))
    assert frame[0] / frame[1] == pytest.approx(16.0 / 9.0)
    assert min(frame[0] - width, frame[1] - height) == pytest.approx(0.0, abs=1e-9)
    assert frame[0] >= width
    assert frame[1] >= height


@given(st.floats(0.01, 0.3), st.integers(1, 120))
def test_a_principal_point_of_16_to_9_is_as_its_camera_has_it_and_further_off_in_a_part(share, unit):
    whole, half = (16 * unit, 9 * unit), (8 * unit, 9 * unit)
    np.testing.assert_allclose(principal_point_sigma(share, whole), share * whole[0])
    x, y = principal_point_sigma(share, half)
    assert x > half[0] / 2.0  # that of a half lies at its border
    assert y == pytest.approx(share * whole[0])


def test_without_the_narrow_prior_the_camera_moves_as_first_order_says():
    """A frame whose principal point is off, solved with a prior that is ten times as wide: the same to a half."""
    frame = frame_of(CAMERA.cropped((8, -4), SIZE), 0.1)
    narrow = DISTRIBUTIONS["main center"]
    wide = replace(narrow, principal_point=PART_SCALE * narrow.principal_point)
    found, other = (calibrate_from_segments(KNOWN, frame, SIZE, prior=prior) for prior in (narrow, wide))
    uncertainty = found.uncertainty
    own, _, shift, _ = _freed(uncertainty, 1.0 / PART_SCALE**2)
    free = np.flatnonzero(uncertainty.problem.free)
    moved = (other.uncertainty.theta - uncertainty.theta)[free] / uncertainty.unit[free]
    assert np.linalg.norm(moved[own]) > 0.05
    np.testing.assert_allclose(shift[own], moved[own], rtol=0.5, atol=0.02)
    assert largest_error_of_part(uncertainty) > 0.5 * np.max(other.uncertainty.at_field(GROUND).rms)
    _, _, shift, covariance = _freed(uncertainty, 1.0)
    np.testing.assert_allclose(shift, 0.0, atol=1e-12)
    unit = uncertainty.unit[free]
    as_it_is = uncertainty.determined[np.ix_(free, free)] / (unit[:, None] * unit)
    np.testing.assert_allclose(covariance, as_it_is, rtol=1e-6, atol=1e-9)


def test_what_depends_on_the_principal_point_is_doubted_sooner():
    scores = [score_of_part(0.9, 0.0, (0.0, 0.0), error) for error in (0.01, 0.05, 0.5, 2.0, 9.0)]
    assert scores[0] == scores[1] < scores[2] < scores[3] == scores[4]
    uncertainty = calibrate_from_segments(FIELD, frame_of(), SIZE).uncertainty
    point, roll = principal_point_of(uncertainty), (uncertainty.theta[ROLL], uncertainty.covariance[ROLL, ROLL])
    error = largest_error_of_part(uncertainty) / FIELD.tolerance
    low, high = (score_of_part(probability, point.log_ratio_of_part, roll, error) for probability in (0.9, 0.5))
    assert low < high
    for probability, value in ((0.9, low), (0.5, high)):
        assert score_above(value - 1e-6, uncertainty, point, probability) == pytest.approx(value)
        largest = score_of_part(probability, point.log_ratio_of_part, roll, 9.0)
        assert score_above(largest, uncertainty, point, probability) == -np.inf


def test_a_roll_speaks_for_a_part_where_heads_are_level():
    """Broadcasts from lawns have level tripods, halls rails; of tennis people's pictures had a part in the fit."""
    court = field_named("tennis")
    in_the_hand = Camera.from_angles(0.5, 1.25, np.radians(1.5), 900.0, (-3.0, 17.0, -4.0), SIZE)
    labels = observe(court, in_the_hand, np.random.default_rng(0), 0.5)
    uncertainty = calibrate_from_segments(court, labels, SIZE).uncertainty
    on_rails = replace(court, probability=replace(court.probability, least_in_picture=None))
    places = court, on_rails, replace(on_rails, surface="grass")
    point = principal_point_of(uncertainty)
    hand, rail, tripod = (score_above(-99.0, uncertainty.on(one), point, 0.9) for one in places)
    assert tripod > rail + 1.0 > hand + 2.0


def test_labels_of_a_whole_frame_speak_against_a_part():
    evidence = principal_point_of(calibrate_from_segments(FIELD, frame_of(), SIZE).uncertainty)
    assert evidence.log_ratio_of_part < -1.0


@examples(10)
@given(st.integers(0, 1000))
def test_the_principal_point_lies_where_labels_put_it_within_what_they_tell(seed):
    """Half of the prior's width off the middle: the offset to first order is that, within three sigma."""
    camera = CAMERA.cropped((40, 0), SIZE)  # its principal point is 40 px, two standard deviations, to the left
    found = calibrate_from_segments(FIELD, frame_of(camera, 0.5, seed), SIZE, flags=DEFAULT_FLAGS)
    evidence = principal_point_of(found.uncertainty)
    off = evidence.offset - [-40.0 / 19.2, 0.0]
    assert np.all(np.abs(off) < 4.0 * np.sqrt(np.diagonal(evidence.covariance)) + 0.2)


def test_a_principal_point_that_is_known_is_not_asked_for():
    flags = DEFAULT_FLAGS | CalibrationFlags.CALIB_FIX_PRINCIPAL_POINT
    found = calibrate_from_segments(FIELD, frame_of(), SIZE, flags=flags)
    assert principal_point_of(found.uncertainty) is None
    assert seems_part(found.uncertainty, 0.5) == ()


def test_a_part_must_be_surer_of_its_camera_than_a_whole_frame():
    whole = calibrate_from_segments(FIELD, frame_of(), SIZE)
    assert seems_part(whole.uncertainty, 0.8) == ()
    part = part_of(frame_of(), CAMERA, (240, 0), (720, 540))
    uncertainty = calibrate_from_segments(FIELD, part.pixels, part.image_size).uncertainty
    square, squashed = (replace(uncertainty, offsets={"log aspect": (off, 0.02)}) for off in (0.0, np.log(4.0 / 3.0)))
    assert seems_part(square, 0.8) == (SHAPE,)
    assert seems_part(square, 0.95) == seems_part(square, 0.8, sure=0.75) == ()
    assert seems_part(squashed, 0.95) == (SHAPE,)


@pytest.mark.parametrize("size", [(960, 540), (960, 640), (720, 540)])
def test_pixels_are_as_square_in_pictures_of_all_shapes(size):
    """What is no squash of a known shape is an error of the lines, unless it is large."""
    uncertainty = calibrate_from_segments(FIELD, frame_of(OVERVIEW), size).uncertainty
    squash = np.log(16.0 / 9.0 * size[1] / size[0])
    asked = [
        What.NOT_SQUARE in {one.what for one in surprises(replace(uncertainty, offsets={"log aspect": (off, 0.009)}))}
        for off in (-0.06, 0.06, -0.12, squash or 0.12)
    ]
    assert asked == [False, False, True, True]


def test_a_corner_whose_labels_tell_the_principal_point_is_no_good_whole_frame():
    corner = part_of(frame_of(noise=0.5), CAMERA, (240, 135), (720, 405))
    found = calibrate_from_segments(FIELD, corner.pixels, corner.image_size)
    assert principal_point_of(found.uncertainty).log_ratio_of_part > 2.0
    assert found.verdict is not Verdict.GOOD


def test_a_large_roll_is_no_sign_of_a_part():
    rolled = Camera.from_angles(0.3, 1.35, np.radians(4.0), 1300.0, (0.0, 62.0, -15.0), SIZE)
    found = calibrate_from_segments(FIELD, frame_of(rolled), SIZE)
    assert CUT not in found.findings


def labelled_to_the_border(camera=CAMERA, count=6):
    """A few pixels along each straight marking, from border to border."""
    found = {}
    for label, segment in whole_circle_markings(FIELD).items():
        xy = camera.project(segment.sample(0.05))
        xy = xy[np.all((xy >= 0.0) & (xy <= np.subtract(SIZE, 1)), axis=1)]
        if len(xy) > 1 and isinstance(segment, Line):
            found[label] = xy[np.linspace(0, len(xy) - 1, count).astype(int)]
    return found


@given(st.floats(-0.6, 0.6), st.integers(0, 240), st.integers(0, 135))
def test_labels_that_stop_short_tell_that_they_were_cut(pan, x, y):
    camera = Camera.from_angles(pan, 1.35, 0.0, 1300.0, (0.0, 62.0, -15.0), SIZE)
    labels = labelled_to_the_border(camera)
    whole = log_ratio_of_cut(FIELD, labels, camera)
    assert np.log(0.5) - 1e-9 <= whole <= 0.0
    part = part_of(labels, camera, (x, y), (720, 405))
    assert log_ratio_of_cut(FIELD, part.pixels, part.truth) >= np.log(0.5) - 1e-9


def test_the_sides_that_were_cut_are_told():
    camera = Camera.from_angles(-0.4, 1.35, 0.0, 800.0, (0.0, 62.0, -15.0), SIZE)
    part = part_of(labelled_to_the_border(camera, 4), camera, (0, 0), (720, 540))
    assert log_ratio_of_cut(FIELD, part.pixels, part.truth) > 3.0


def test_one_marking_that_was_not_followed_to_the_border_is_no_cut():
    """Nor are circles, of which nobody clicks the ends: the labels of the demonstration are of whole pictures."""
    for camera in pan_over_field(6):
        pixels = demo_labels(camera, FIELD, np.random.default_rng(0), 1.0)
        assert calibrate_from_segments(FIELD, pixels, SIZE).verdict is Verdict.GOOD


def test_who_clicks_here_and_there_on_a_marking_reaches_no_border():
    inside = {}
    for label, xy in labelled_to_the_border(count=9).items():
        inside[label] = xy[2:-2]
    assert log_ratio_of_cut(FIELD, inside, CAMERA) == 0.0
    assert log_ratio_of_cut(FIELD, {}, CAMERA) == 0.0
    assert (
        log_ratio_of_cut(FIELD, {"Goal left post left": np.zeros((2, 2)), "nothing": np.zeros((1, 2))}, CAMERA) == 0.0
    )


def test_ends_of_labels_count_in_the_verdict():
    found = calibrate_from_segments(FIELD, frame_of(), SIZE)
    assert seems_part(found.uncertainty, 0.9) == ()
    assert seems_part(found.uncertainty, 0.9, 20.0) == (CUT,)


def test_only_labels_by_hand_end_where_their_picture_does():
    labels = labelled_to_the_border()
    found = calibrate_from_segments(FIELD, labels, SIZE)
    assert found.are_annotated
    assert Calibration.from_dict(json.loads(json.dumps(found.to_dict()))).are_annotated
    (again,) = calibrate_batch(FIELD, [labels], SIZE)
    assert again.are_annotated
    assert not calibrate_from_segments(FIELD, labels, SIZE, trust_labels=True).are_annotated
    alike, weighted = dict.fromkeys(labels, 1.0), dict.fromkeys(labels, 0.5)
    assert calibrate_from_segments(FIELD, labels, SIZE, weights=alike).are_annotated
    assert not calibrate_from_segments(FIELD, labels, SIZE, weights=weighted).are_annotated


@pytest.mark.parametrize(
    ("size", "declared", "doubts"),
    [
        (SIZE, Declared.NOTHING, (CUT,)),
        (SIZE, Declared.PIXELS, (CUT,)),
        (SIZE, Declared.FRAME, ()),
        ((640, 540), Declared.NOTHING, (SHAPE,)),
        ((640, 540), Declared.PIXELS, (CUT,)),
        ((640, 540), Declared.FRAME, ()),
    ],
)
def test_what_is_declared_is_not_asked(size, declared, doubts):
    camera = CAMERA.cropped((320, 0), size) if size != SIZE else CAMERA
    labels = {label: xy[np.all((xy > 0.0) & (xy < size), axis=1)] for label, xy in frame_of(camera).items()}
    found = calibrate_from_segments(FIELD, {label: xy for label, xy in labels.items() if len(xy)}, size)
    assert seems_part(found.uncertainty, 0.6, 20.0, declared) == doubts
    said = replace(found, declared=declared)
    assert Calibration.from_dict(json.loads(json.dumps(said.to_dict()))).declared == declared


@pytest.mark.parametrize("estimate_aspect", [True, False])
def test_where_labels_end_is_told_in_pixels_of_the_picture(estimate_aspect):
    """Of a squashed picture too, which is calibrated as it would be shown."""
    size, end = (640, 640), 480
    squashed = CAMERA.scaled(size)
    labels = observe(whole_circle_markings(FIELD), squashed, np.random.default_rng(0), 0.0, per_line=200)
    cut = {label: xy[xy[:, 0] <= end - 1.0] for label, xy in labels.items()}
    cut["Side line top"] = np.concatenate(
        [cut["Side line top"], [squashed_point(squashed, "Side line top", end - 1.0)]]
    )
    (found,) = calibrate_batch(FIELD, [cut], size, estimate_aspect=estimate_aspect)
    (said,) = [one for one in found.findings if one.what is What.BORDER]
    assert str(said) == "the labels end at column 479 of 640: are they of a picture that is 480 pixels wide?"
    assert found.has_finding(What.WAS_SQUASHED) is estimate_aspect


def squashed_point(camera, label, column):
    """Where a segment is in a column."""
    xy = camera.project(FIELD[label].sample(0.01))
    return xy[np.argmin(np.abs(xy[:, 0] - column))]


@pytest.mark.parametrize("factor", [4.0 / 3.0, 2.0 / 3.0])
def test_labels_of_another_size_end_where_its_picture_ends(factor):
    rng, markings = np.random.default_rng(0), whole_circle_markings(FIELD)
    size = round(factor * SIZE[0]), round(factor * SIZE[1])
    clipped = {}
    for label, segment in markings.items():
        xy = CAMERA.project(segment.sample(0.05))
        xy = xy[np.all((xy >= 0.0) & (xy <= np.subtract(SIZE, 1)), axis=1)]
        if len(xy) > 20:
            clipped[label] = xy[np.linspace(0, len(xy) - 1, 5).astype(int)] + rng.normal(0.0, 0.1, (5, 2))
    as_it_is = calibrate_from_segments(FIELD, clipped, SIZE)
    assert not [one for one in as_it_is.findings if one.what is What.BORDER]
    found = calibrate_from_segments(FIELD, clipped, size)
    (border,) = [one for one in found.findings if one.what is What.BORDER]
    assert (border.numbers[0] // 10, border.numbers[2]) == (95, SIZE[0])
    assert found.verdict is not Verdict.GOOD


def test_pictures_are_counted():
    kinds = changed(frame_of(), CAMERA, np.random.default_rng(0))
    assert {"as they are", "left half", "corner", "upright", "squashed to 3:2"} <= kinds.keys()
    pictures = [kinds["as they are"], kinds["corner"]]
    rows = counts(pictures, calibrated(pictures, FIELD), FIELD)
    assert rows["count"] == 2
    assert rows["good_and_wrong_percent"] <= rows["good_percent"]


def test_changed_pictures_have_their_cameras():
    """A bright spot of the field is where the camera of the changed picture sees it."""
    mark = CAMERA.project((20.0, 0.0, 0.0))
    image = np.zeros((540, 960, 3), np.uint8)
    cv2.circle(image, tuple(np.rint(mark).astype(int).tolist()), 6, (255, 255, 255), -1)
    made = changed_image(image, CAMERA)
    assert {"letterboxed", "squashed to 3:2", "right two thirds", "upper left corner"} <= made.keys()
    for shown, camera in made.values():
        x, y = camera.project((20.0, 0.0, 0.0))
        width, height = camera.image_size
        assert shown.shape == (height, width, 3)
        if 10 < x < width - 10 and 10 < y < height - 10:
            assert shown[round(y), round(x)].min() > 128


def test_a_squashed_picture_has_its_camera():
    picture = changed(frame_of(noise=0.0), CAMERA, np.random.default_rng(0))["squashed to a square"]
    assert picture.image_size == (540, 540)
    label, xy = next(iter(picture.pixels.items()))
    np.testing.assert_allclose(xy, frame_of(noise=0.0)[label] * (540 / 960, 1.0))
    assert picture.truth.K[0, 0] / picture.truth.K[1, 1] == pytest.approx(540 / 960)


def test_cameras_of_basketball_games_are_read():
    court = field_named("basketball-fiba")
    camera = Camera.from_angles(0.1, 1.1, 0.02, 1500.0, (0.0, 22.0, -9.0), SIZE, principal_point=(700.0, 200.0))
    T = 100.0 * (-camera.R @ (camera.C + (14.0, 7.5, 0.0)))
    record = {"K": camera.K.ravel().tolist(), "R": camera.R.ravel().tolist(), "T": T.tolist()}
    (found,) = basketball_cameras(json.loads(json.dumps([{"width": 960, "height": 540}, record])))
    np.testing.assert_allclose(
        found.project(court["Centre line"].sample(1.0)), camera.project(court["Centre line"].sample(1.0))
    )


@pytest.mark.parametrize("shape", [(540, 540), (810, 540), (960, 720)])
def test_a_squashed_picture_is_told_by_its_labels(shape):
    pixels = {label: xy * np.divide(shape, SIZE) for label, xy in frame_of(OVERVIEW, noise=0.5).items()}
    found = calibrate_from_segments(FIELD, pixels, shape, estimate_aspect=True)
    assert found.has_finding(What.WAS_SQUASHED)
    aspect = found.camera.K[1, 1] / found.camera.K[0, 0]
    assert aspect == pytest.approx(SIZE[0] / SIZE[1] * shape[1] / shape[0], rel=0.01)
    assert found.camera.C[2] == pytest.approx(OVERVIEW.C[2], rel=0.1)
    (again,) = calibrate_batch(FIELD, [pixels], shape, estimate_aspect=True)
    assert again.camera.C[2] == pytest.approx(found.camera.C[2], rel=0.01)


def test_what_was_squashed_was_a_whole_frame():
    """The same labels are doubted to be of a part less where the picture was squashed."""
    found = calibrate_from_segments(FIELD, frame_of(), SIZE)
    thin = in_picture(found, Placement((540, 540), SIZE))
    solved = found.uncertainty.camera
    assert not Placement.of_cameras(found.camera, solved).is_squashed
    assert Placement.of_cameras(thin.camera, solved) == Placement((540, 540), SIZE)
    assert Placement.of_cameras(thin.camera, solved).is_squashed
    assert not Placement.of_cameras(found.camera.cropped((0, -90), (960, 720)), solved).is_squashed


def test_a_frame_of_16_to_9_is_calibrated_as_it_is():
    one, other = (
        calibrate_from_segments(FIELD, frame_of(), SIZE, estimate_aspect=estimated) for estimated in (True, False)
    )
    assert one == other


def test_of_two_ways_the_likelier_one_counts_and_doubt_is_said():
    found = calibrate_from_segments(FIELD, frame_of(), SIZE)
    squashed = likelier(found, found, 5.0, (640, 640))
    assert squashed.has_finding(What.WAS_SQUASHED)
    assert squashed.camera.image_size == (640, 640)
    assert likelier(found, found, -5.0, (640, 640)) is found
    assert likelier(found, found, 1.0, (640, 640)).verdict is Verdict.CHECK
    assert likelier(found, found, -1.0, (640, 640)).verdict is Verdict.CHECK


@pytest.mark.parametrize(("size", "lacks_little"), [((880, 540), True), ((720, 540), True), ((640, 540), False)])
@pytest.mark.parametrize("log_ratio", [-1.0, 1.0])
def test_a_shape_that_moves_no_place_in_view_is_not_asked_for(size, lacks_little, log_ratio):
    found = calibrate_from_segments(KNOWN, frame_of(), SIZE)
    moved = Camera.from_angles(0.3, 1.35, 0.0, 1300.0, (3.0, 62.0, -15.0), SIZE)
    same, other = (  # as in a picture whose pixels are not square
        in_picture(one, Placement(size, SIZE)) for one in (found, calibrate_from_segments(KNOWN, frame_of(moved), SIZE))
    )
    assert (SHAPE in likelier(same, found, log_ratio, size).findings) is not lacks_little
    assert SHAPE in likelier(other, found, log_ratio, size).findings


def bordered(image, border, noise=0):
    """A picture between black bars above and below (border > 0) or left and right."""
    x, y = (0, border) if border > 0 else (-border, 0)
    picture = np.zeros((image.shape[0] + 2 * y, image.shape[1] + 2 * x, 3), np.uint8)
    picture[y : y + image.shape[0], x : x + image.shape[1]] = image
    bright = np.random.default_rng(0).integers(0, noise + 1, picture.shape)
    return cv2.imdecode(cv2.imencode(".jpg", np.clip(picture + bright, 0, 255).astype(np.uint8))[1], cv2.IMREAD_COLOR)


@pytest.mark.parametrize("border", [90, -160])
@pytest.mark.parametrize("noise", [0, 8])
def test_black_borders_are_seen(border, noise):
    image = picture(CAMERA)
    (shown,) = parts_of([bordered(image, border, noise)])
    corner = (0, border) if border > 0 else (-border, 0)
    assert np.abs(np.add(shown.corner, corner)).max() <= 1
    assert np.abs(np.subtract(shown.frame_size, SIZE)).max() <= 2
    assert shown.image_in_frame(bordered(image, border, noise)).shape[1::-1] == shown.frame_size


@pytest.mark.parametrize("where", ["sky", "stands", "all"])
def test_a_dark_part_of_a_picture_is_no_border(where):
    image = picture(CAMERA)
    rng = np.random.default_rng(0)
    if where == "sky":
        image[:150] = 3
    elif where == "stands":  # above and below, dark with lights
        image[:100], image[-100:] = (rng.integers(0, 60, (100, 960, 1)) for _ in range(2))
    else:
        image[:] = 0
    assert borders_of(image) == (0, 0)


def test_a_camera_of_what_is_shown_sees_the_same_in_the_whole_picture():
    found = calibrate_from_segments(FIELD, frame_of(), SIZE)
    moved = in_picture(found, within_borders((960, 720), (0, 90)))
    X = FIELD["Middle line"].sample(3.0)
    np.testing.assert_allclose(moved.camera.project(X), found.camera.project(X) + (0.0, 90.0))
    assert moved.camera.image_size == (960, 720)


def test_a_label_outside_the_picture_is_told_but_not_a_line_that_is_continued_past_it():
    """Shifted by a part of the picture, labels fit the camera that is tilted: what was not seen there tells."""
    frame = frame_of(CAMERA)
    on = calibrate_from_segments(FIELD, frame, SIZE)
    along = frame["Side line top"][[0, -1]]
    longer = {**frame, "Side line top": along + np.array([[-0.3], [0.3]]) * (along[1] - along[0])}
    assert [one.verdict for one in (on, calibrate_from_segments(FIELD, longer, SIZE))] == ["good", "good"]
    shifted = calibrate_from_segments(FIELD, {label: xy + (0.0, 180.0) for label, xy in frame.items()}, SIZE)
    below = {label for label, xy in frame.items() if np.min(xy[:, 1]) + 180.0 > SIZE[1] * 1.04}
    assert below
    assert {one.about for one in shifted.findings if one.what is What.OUTSIDE} == below
    assert (shifted.verdict, shifted.advice) == ("check", ())
    assert all(repr(label) in shifted.remedy for label in below)
