"""Paint beside projected markings: found where it is, on rendered pictures, and nothing where markings lie on paint."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pictures import picture
from strategies import examples, numbers
from synthetic import observe, whole_circle_markings
from views import camera

from fieldcalib.assess.findings import Finding, Status, Verdict, What
from fieldcalib.assess.paint_in_view import MarkingInView, contradiction, paint_findings
from fieldcalib.assess.result import Calibration
from fieldcalib.assess.sequence_calibration import SequenceCalibration
from fieldcalib.fields.catalogue import field as field_named
from fieldcalib.fields.catalogue import tennis, volleyball
from fieldcalib.fields.field import Field
from fieldcalib.fields.ground import Ground
from fieldcalib.fields.segments import Line
from fieldcalib.fields.sports.ice_hockey import ice_hockey
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.fields.traits import LineLook
from fieldcalib.geometry.camera import Camera
from fieldcalib.images.paint.line_profiles import Markings, profiles_along
from fieldcalib.images.paint.paint_evidence import (
    Ridges,
    evidence_of,
    missing_net,
    paint_evidence,
    paint_past_ends,
    with_extents,
)
from fieldcalib.images.refinement import ToRefine, refine_all
from fieldcalib.solve.from_segments import calibrate_from_segments
from fieldcalib.solve.request import Task
from fieldcalib.solve.sequence.sequence_solver import calibrate_sequence
from fieldcalib.solve.solver_options import DEFAULT_FLAGS

FIELD = soccer()
MARKINGS = Markings.of(FIELD)
PENALTY_AREA = camera(24, 78, 1400, (0, 68, -17), k=(0.06, 0.0))


PICTURE = picture(PENALTY_AREA)


def evidence(image, camera, markings):
    return paint_evidence(image, profiles_along(camera, markings), markings)


def turned(truth, pan=0.0, tilt=0.0):
    """A camera that looks some pixels aside."""
    a, b, c = truth.angles
    f = truth.focal_length
    return Camera.from_angles(a + pan / f, b + tilt / f, c, f, truth.C, truth.image_size, k=truth.dist[0, :2])


@pytest.mark.parametrize(
    ("field", "truth"),
    [
        (FIELD, PENALTY_AREA),
        (FIELD, camera(3, 75, 1000, (-2, 66, -16), roll=0.5)),
        (tennis(), camera(0, 65, 1400, (0, 28, -9))),
        (ice_hockey(), camera(0, 65, 700, (0, 35, -14))),  # dark lines on ice
    ],
    ids=["penalty area", "midfield", "tennis", "ice hockey"],
)
def test_true_camera_lies_on_its_paint(field, truth):
    found = evidence(picture(truth, field), truth, Markings.of(field))
    assert len(found.markings) > 4
    assert not len(found.beside.xy)
    assert paint_findings(found.markings) == ()
    assert np.mean([one.share for one in found.markings]) > 0.8


@given(numbers(6.0, 12.0))
def test_paint_that_bends_away_from_its_marking_lies_beside_it(end):
    """The lines of a pitch that is not flat: most of one lies on its marking, and its end beside that."""
    ridges = Ridges.of(PICTURE, profiles_along(PENALTY_AREA, MARKINGS))
    at = np.flatnonzero(ridges.profiles.member == MARKINGS.labels.index("Big rect. right main"))
    t = np.linspace(-1.0, 1.0, len(at))
    bend = end * np.square((t - 0.3) / 1.3)  # 0.3 of it at the other end
    xy = ridges.xy.copy()
    xy[at] += (bend[:, None] * ridges.profiles.normal[at])[:, None].astype(np.float32)
    found = {one.label: one for one in evidence_of(replace(ridges, xy=xy), MARKINGS).markings}
    front = found.pop("Big rect. right main")
    assert 0.4 < front.share < 0.8
    assert front.offset == pytest.approx(end, abs=1.0)
    assert front.is_bent
    assert not contradiction([front])
    assert not any(one.is_beside for one in found.values())


def test_a_line_that_the_motion_of_the_camera_may_have_skewed_is_not_beside_its_paint():
    """Rows are exposed one after another: across the motion lines are skewed, along it they are not."""
    ridges = Ridges.of(PICTURE, profiles_along(PENALTY_AREA, MARKINGS))
    at = np.flatnonzero(ridges.profiles.member == MARKINGS.labels.index("Big rect. right main"))
    xy = ridges.xy.copy()
    xy[at] += (3.9 * ridges.profiles.normal[at])[:, None].astype(np.float32)
    across = 14.0 * np.median(ridges.profiles.normal[at], axis=0)
    for motion, is_beside in (((0.0, 0.0), True), (across, False), (across[::-1] * (1.0, -1.0), True)):
        found = {one.label: one for one in evidence_of(replace(ridges, xy=xy), MARKINGS, motion).markings}
        assert found["Big rect. right main"].is_beside == is_beside
    far = replace(ridges, xy=xy + (xy - ridges.xy))
    found = {one.label: one for one in evidence_of(far, MARKINGS, across).markings}
    assert found["Big rect. right main"].is_beside


@examples(15)
@given(pan=numbers(-22.0, 22.0), tilt=numbers(-22.0, 22.0))
def test_what_is_found_beside_markings_is_paint(pan, tilt):
    """A camera that looks aside: all that is found lies where the true camera projects markings.

    But for two pixels: the wrong camera's profiles cross the end of an arc, and where markings meet, at a slant.
    """
    found = evidence(PICTURE, turned(PENALTY_AREA, pan, tilt), MARKINGS)
    paint = PENALTY_AREA.project(np.concatenate([s.sample(0.1) for s in FIELD.markings.values()]))
    paint = paint[np.isfinite(paint).all(axis=1)]
    for label, xy in found.beside.by_label(0).items():
        distance = np.min(np.linalg.norm(xy[:, None] - paint, axis=-1), axis=1)
        assert np.sort(distance)[:-2].max() < 1.5, label
        assert distance.max() < 5.0, label


@examples(10)
@given(pan=numbers(-9.0, 9.0), tilt=numbers(-9.0, 9.0))
def test_ridges_are_judged_by_another_camera_without_the_image(pan, tilt):
    ridges = Ridges.of(PICTURE, profiles_along(turned(PENALTY_AREA, pan, tilt), MARKINGS))
    again = {one.label: one for one in evidence_of(ridges.seen_by(PENALTY_AREA, MARKINGS), MARKINGS).markings}
    for one in evidence(PICTURE, PENALTY_AREA, MARKINGS).markings:
        if one.places > 10 and one.label in again:
            assert again[one.label].share == pytest.approx(one.share, abs=0.25), one.label
            assert not again[one.label].is_beside, one.label


@examples(15)
@given(tilt=numbers(5.0, 15.0))
def test_distance_of_paint_is_that_of_the_projections(tilt):
    wrong, label = turned(PENALTY_AREA, tilt=tilt), "Side line top"  # nothing is painted beyond
    (found,) = (one for one in evidence(PICTURE, wrong, MARKINGS).markings if one.label == label)
    X = FIELD[label].sample(0.2)
    at, true = wrong.project(X), PENALTY_AREA.project(X)
    seen = np.all((at > 2.0) & (at < np.subtract(wrong.image_size, 3.0)), axis=1)
    along = np.gradient(at[seen], axis=0)
    normal = np.column_stack([-along[:, 1], along[:, 0]]) / np.linalg.norm(along, axis=1, keepdims=True)
    distance = np.abs(np.sum((true[seen] - at[seen]) * normal, axis=1))
    assert found.offset == pytest.approx(np.max(distance), abs=1.5)


def test_the_tape_of_a_net_is_no_paint_of_the_line_behind_it():
    """From low behind a court it is nearly parallel to the far lines, which may be hidden or worn."""
    court, behind = tennis(), camera(90, 82, 800, (-21, 1, -2.2))
    worn = replace(court, segments={label: one for label, one in court.items() if label != "Service line right"})
    shown = picture(behind, worn)
    tape = np.rint(behind.project(court["Net top"].sample(0.5))).astype(np.int32)
    cv2.polylines(shown, [tape], isClosed=False, color=(235, 240, 235), thickness=2)
    assert not any(one.is_beside for one in evidence(shown, behind, Markings.of(court)).markings)
    without_net = replace(court, segments={label: one for label, one in court.items() if not label.startswith("Net")})
    beside = [one.label for one in evidence(shown, behind, Markings.of(without_net)).markings if one.is_beside]
    assert beside == ["Service line right"]


@examples(10)
@given(side=st.sampled_from((-1.0, 1.0)), pixels=numbers(8.0, 22.0))
def test_camera_that_looks_aside_paint_contradicts(side, pixels):
    found = evidence(PICTURE, turned(PENALTY_AREA, tilt=side * pixels), MARKINGS)
    assert contradiction(found.markings)


def test_refinement_uses_paint_beyond_its_search_range():
    """The far touchline and the goal line are 16 px and more beside a camera that fits the penalty area alone."""
    labels = ("Big rect. right main", "Big rect. right bottom", "Circle right")
    pixels = observe(whole_circle_markings(FIELD), PENALTY_AREA)
    rng = np.random.default_rng(4)
    near = {label: pixels[label] + rng.normal(0.0, 2.5, pixels[label].shape) for label in labels}
    start = calibrate_from_segments(FIELD, near, PENALTY_AREA.image_size)
    before = evidence(PICTURE, start.camera, MARKINGS)
    assert len(before.beside.xy), "the case has no marking beside its paint"
    given_ = ToRefine(PICTURE, replace(start, status=Status.ACCEPTED))
    (refined,) = refine_all(Task(FIELD, flags=DEFAULT_FLAGS), MARKINGS, [given_])
    assert refined.judged.accepted
    assert not any(one.is_beside for one in refined.judged.markings)
    X = FIELD["Side line top"].sample(2.0)
    at, true = refined.calibration.camera.project(X), PENALTY_AREA.project(X)
    seen = np.all((true > 0.0) & (true < PENALTY_AREA.image_size), axis=1)
    assert np.max(np.linalg.norm(at[seen] - true[seen], axis=1)) < 1.5


def accepted():
    labels = ("Side line top", "Side line right", "Big rect. right main", "Big rect. right top", "Circle right")
    pixels = {label: PENALTY_AREA.project(FIELD[label].sample(4.0)) for label in labels}
    found = calibrate_from_segments(FIELD, pixels, PENALTY_AREA.image_size)
    assert found.verdict is Verdict.GOOD
    return found


def test_no_paint_is_expected_on_grass_in_glaring_sun():
    """White paint on overexposed grass is hardly lighter; in shadow, where it would be seen, it is missing."""
    line = FIELD["Side line right"].sample(0.5)
    band = np.concatenate([PENALTY_AREA.project(line + (x, 0.0, 0.0)) for x in (-1.5, 1.5)])
    hull = cv2.convexHull(band[np.all(np.abs(band) < 1e4, axis=1)].astype(np.float32)).astype(int)
    is_unseen = {}
    for light, grass in (("sun", (110, 250, 225)), ("shadow", (60, 141, 80))):
        image = cv2.fillConvexPoly(PICTURE.copy(), hull, grass)
        seen = {one.label: one for one in evidence(image, PENALTY_AREA, MARKINGS).markings}
        is_unseen[light] = "Side line right" in seen and seen["Side line right"].is_unseen
        assert seen["Big rect. right main"].share > 0.9
    assert is_unseen == {"sun": False, "shadow": True}


def test_marking_beside_its_paint_is_a_concern():
    on = MarkingInView("Side line top", 700.0, 30, 0.95, 0.0)
    found = accepted().seen_in_image([on, MarkingInView("Middle line", 200.0, 12, 0.1, 17.2)])
    assert found.verdict is Verdict.CHECK
    assert found.reason.startswith("'Middle line' lies 17 px beside its paint; ")
    assert accepted().seen_in_image([on]).verdict is Verdict.GOOD


def test_long_marking_without_paint_is_a_concern():
    unseen = MarkingInView("Side line bottom", 700.0, 30, 0.1, 0.0)
    assert accepted().seen_in_image([unseen]).verdict is Verdict.CHECK
    assert accepted().seen_in_image([replace(unseen, places=8)]).verdict is Verdict.GOOD
    assert accepted().seen_in_image([replace(unseen, is_expected=False)]).verdict is Verdict.GOOD


def test_camera_with_most_of_its_paint_elsewhere_is_rejected():
    on, beside = MarkingInView("A", 90.0, 9, 1.0, 0.0), MarkingInView("B", 300.0, 25, 0.1, 21.4)
    found = accepted().seen_in_image([on, beside])
    assert found.status is Status.IMPROBABLE
    assert not found
    assert accepted().seen_in_image([replace(on, places=30), beside]).accepted


def test_markings_are_written_and_read():
    found = accepted().seen_in_image(evidence(PICTURE, accepted().camera, MARKINGS).markings)
    again = Calibration.from_dict(json.loads(json.dumps(found.to_dict())))
    assert again.markings == found.markings
    assert len(again.markings) > 4


def test_paint_has_the_last_word_on_frames_of_a_sequence():
    """Labels of a network that contradict what frames share are wrong where the image shows paint at all markings."""
    cameras = [turned(PENALTY_AREA, pan=pan) for pan in (0.0, 20.0, 40.0)]
    labelled = [observe(whole_circle_markings(FIELD), one) for one in cameras]
    found = calibrate_sequence(soccer(size_known=True), labelled, PENALTY_AREA.image_size)
    assert {str(one.verdict) for one in found} == {"good"}
    pulled = replace(found, frames=replace(found.frames, misfit=np.full(3, 30.0)))
    assert [one.findings for one in pulled] == 3 * [(Finding(What.SHARED_MISFIT, numbers=(30.0,)),)]
    on = tuple(MarkingInView(name, 400.0, 30, share=0.95, offset=0.0) for name in ("front", "side", "arc"))
    off = (*on, MarkingInView("near", 400.0, 30, share=0.1, offset=9.0))
    seen = pulled.seen_in_images({0: on, 1: off, 2: on[:2]})
    assert [str(one.verdict) for one in seen] == ["good", "check", "check"]
    again = SequenceCalibration.from_dict(json.loads(json.dumps(seen.to_dict())))
    assert [one.markings for one in again] == [on, off, on[:2]]


def test_frames_with_most_of_their_paint_elsewhere_are_rejected():
    labelled = [observe(whole_circle_markings(FIELD), PENALTY_AREA)] * 2
    found = calibrate_sequence(soccer(size_known=True), labelled, PENALTY_AREA.image_size)
    beside = (MarkingInView("front", 400.0, 30, share=0.1, offset=9.0),)
    seen = found.seen_in_images({1: beside})
    assert [str(one.status) for one in seen] == ["accepted", "probably wrong"]
    assert seen[1].message.startswith("most of the paint lies beside the markings: 'front' lies 9 px beside its paint")


def test_lines_as_wide_as_the_band_have_fewer_ridges():
    line = Line((-20.0, 0.0, 0.0), (20.0, 0.0, 0.0))
    field = Field(40.0, 20.0, {"border": line}, lines=LineLook(width=3.0))
    near = Camera.from_angles(0.0, 1.2, 0.0, 900.0, (0.0, 9.0, -4.0), (960, 540))
    plain = np.full((540, 960, 3), 90, np.uint8)
    (found,) = evidence(plain, near, Markings.of(field)).markings
    assert found.share == 0.0


COURT = camera(-12, 76, 1150, (5, 16.4, -5.1))


def placed(truth, by):
    """A camera that stands elsewhere."""
    return Camera(truth.K, truth.R, truth.C + by, truth.image_size, truth.dist)


def missing_of(seen_by):
    image, markings = picture(COURT, tennis()), Markings.of(tennis())
    return missing_net(image, seen_by, markings, evidence(image, seen_by, markings).markings)


@given(height=numbers(-0.3, 0.3), pan=numbers(-4, 4))
@examples(5)
def test_a_net_near_its_projection_is_not_missing(height, pan):
    assert missing_of(turned(placed(COURT, (0.0, 0.0, height)), pan)) == []


def test_a_camera_that_takes_the_net_for_a_service_line_projects_it_where_none_is():
    """Moved by a service box along the court, its service line lies on the net, and its net on bare ground."""
    (missing,) = missing_of(placed(COURT, (-4.3, 0.0, 0.0)))
    assert missing.label in Markings.of(tennis()).net
    assert missing.is_unseen
    assert list(map(str, paint_findings([missing]))) == [f"the image shows no paint at {missing.label!r}"]


def test_no_net_is_missing_where_few_lines_show():
    image, markings = picture(COURT, tennis()), Markings.of(tennis())
    assert missing_net(np.full_like(image, 90), COURT, markings, ()) == []


def test_paint_is_expected_if_one_other_line_shows_as_narrow_paint():
    """Several lines on bare ground do not excuse one another."""
    few = ("Side line bottom", "Singles side line top", "Base line right")
    field, court = tennis(), camera(8, 70, 1300, (6, 22, -9))
    shown = Field(field.length, field.width, {label: field[label] for label in few}, lines=field.lines)
    seen = {one.label: one for one in evidence(picture(court, shown), court, Markings.of(field)).markings}
    missing = [one.label for one in seen.values() if one.is_unseen]
    assert "Centre service line" in missing
    assert not set(missing) & set(few)


def test_what_some_courts_lack_is_no_evidence_where_it_is_not_seen():
    """A floor of the NBA without the lines of the college lane; missing lines of the lane itself are evidence."""
    field, high = field_named("basketball-nba"), camera(25, 55, 1500, (-12, 24, -16))

    def unseen(lacking):
        shown = {label: one for label, one in field.items() if not label.startswith(lacking)}
        image = picture(high, Field(field.length, field.width, shown, lines=field.lines))
        return {one.about for one in paint_findings(evidence(image, high, Markings.of(field)).markings)}

    assert unseen("Inner") == set()
    assert unseen("Lane") >= {"Lane left bottom", "Lane left top"}


def test_lines_of_a_pitch_may_be_covered_although_one_other_shows():
    """A touchline lies under a carpet, and what is far shows little paint."""
    field, above = soccer(), camera(0, 66, 1000, (0, 55, -14))
    shown = Field(field.length, field.width, {"Middle line": field["Middle line"]}, lines=field.lines)
    seen = evidence(picture(above, shown), above, Markings.of(field)).markings
    assert {one.label for one in seen if one.is_confirmed} == {"Middle line"}
    assert not any(one.is_unseen for one in seen)


def test_a_net_is_not_looked_for_from_above():
    """There its edges are as thin as its cord, and where they lie is hardly known."""
    above, markings = camera(0, 2, 700, (0, 0.5, -25)), Markings.of(tennis())
    ground = Field(tennis().length, tennis().width, {k: s for k, s in tennis().items() if "Net" not in k})
    image = picture(above, ground)
    assert missing_net(image, above, markings, evidence(image, above, markings).markings) == []
    beside, low = picture(COURT, ground), evidence(picture(COURT, ground), COURT, markings).markings
    assert missing_net(beside, COURT, markings, low)


# --- past the ends ---


def past_ends(image, camera, field):
    """Lines whose paint goes on past an end of their projections, and for how many pixels."""
    markings = Markings.of(field)
    profiles = profiles_along(camera, markings)
    seen = paint_evidence(image, profiles, markings).markings
    found = with_extents(seen, {}, paint_past_ends(Ridges.past_ends(image, camera, markings), markings))
    return {one.label: one.past_end for one in found if one.past_end}


def shifted(camera, y):
    """A camera that sees the field displaced across it by metres."""
    C = camera.C + (0.0, y, 0.0)
    return Camera.from_angles(*camera.angles, camera.focal_length, C, camera.image_size, k=camera.dist[0, :2])


@pytest.mark.parametrize(
    ("field", "truth"),
    [
        (FIELD, PENALTY_AREA),
        (FIELD, camera(3, 75, 1000, (-2, 66, -16), roll=0.5)),
        (FIELD.with_ground(Ground(0.4)), PENALTY_AREA),
        (field_named("rugby-league"), camera(0, 65, 700, (0, 65, -24))),
    ],
    ids=["penalty area", "middle", "crowned", "rugby league"],
)
def test_no_paint_goes_on_past_ends_of_a_right_camera(field, truth):
    assert past_ends(picture(truth, field), truth, field) == {}


@given(y=numbers(6.0, 8.0), far=st.booleans())
@examples(10)
def test_paint_goes_on_where_a_camera_is_off_along_a_line(y, far):
    """The goal line and the lines along it lie on paint, but end too early on one side."""
    found = past_ends(PICTURE, shifted(PENALTY_AREA, y if far else -y), FIELD)
    assert {"Big rect. right main", "Small rect. right main"} & set(found)
    assert all(px > 20.0 for px in found.values())


def test_a_light_border_of_the_picture_is_no_paint():
    """A line of the penalty area ends along the last rows of the picture."""
    truth = camera(0, 70, 900, (40, 52, -16))
    x, y = truth.project((36.0, 20.16, 0.0)).round().astype(int)
    image, height = picture(truth), int(y) + 7
    image[y - 1 : y + 2, :x] = 255
    assert set(past_ends(image, truth, FIELD)) == {"Big rect. right bottom"}
    assert past_ends(image[:height], truth.cropped((0, 0), (960, height)), FIELD) == {}


def test_lines_of_other_sports_go_on_in_a_hall():
    """A volleyball court is laid out on one of handball, whose goal lines are longer than its side lines."""
    truth, court = camera(0, 65, 1000, (0, 24, -11)), volleyball()
    image = picture(truth, court)
    ends = [truth.project((x, 4.5, 0.0)).round().astype(int).tolist() for x in (-13.0, 13.0)]
    cv2.line(image, *ends, (255, 255, 255), 2)
    assert past_ends(image, truth, court) == {}
    finite = replace(court, lines=replace(court.lines, ground_difference=0.05))
    assert past_ends(image, truth, finite)


def test_a_camera_with_paint_past_an_end_is_to_be_checked():
    pixels = observe(whole_circle_markings(FIELD), PENALTY_AREA, np.random.default_rng(0), 0.3)
    found = calibrate_from_segments(FIELD, pixels, PENALTY_AREA.image_size)
    line = MarkingInView("Side line right", 400.0, 20, 1.0, 0.0)
    good, doubted = (found.seen_in_image([replace(line, past_end=px)]) for px in (0.0, 43.2))
    assert (good.verdict, doubted.verdict) == (Verdict.GOOD, Verdict.CHECK)
    assert doubted.findings[0] == Finding(What.PAST_END, "Side line right", (43.2,))
    assert doubted.reason.startswith("the paint of 'Side line right' goes on for 43 px past its end")
