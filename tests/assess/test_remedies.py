"""Every remedy works: where it is printed, following it makes the verdict better, or answers the question.

Each test follows the remedies of its `@follows`; one test holds that none is left out.
"""

import json
import re
from dataclasses import replace

import cv2
import numpy as np
import pytest
from commands import run
from networks import Blind
from pictures import picture
from synthetic import in_image, observe, whole_circle_markings

from data_tools.crown import crowned
from data_tools.pictures_in_pictures import WAYS, View, arranged
from fieldcalib import (
    PINHOLE_FLAGS,
    Arc,
    Camera,
    Editor,
    Line,
    Point,
    Status,
    calibrate_from_homography,
    calibrate_from_images,
    calibrate_from_points,
    calibrate_from_segments,
    soccer,
)
from fieldcalib.assess import Verdict, advice
from fieldcalib.assess.advice import CAUSE_REMEDIES, OF_LABELS, REMEDIES, Advice, Remedy
from fieldcalib.assess.findings import What
from fieldcalib.assess.result import doubted, in_picture
from fieldcalib.fields import Field, Ground, badminton, tennis
from fieldcalib.geometry.homography import homography_from_points
from fieldcalib.images.paint.line_profiles import Markings, profiles_along
from fieldcalib.images.paint.paint_evidence import paint_evidence
from fieldcalib.images.shape.borders_and_windows import windows_of
from fieldcalib.localize import SegmentationNetwork
from fieldcalib.problem.picture_shape import Crop, Declared, Placement
from fieldcalib.run_folder.record import calibration_line, camera_content
from fieldcalib.solve.solver_options import CalibrationFlags
from fieldcalib.web.report import UNREADABLE, remedy_of

SIZE = (960, 540)
PITCH, KNOWN_PITCH = soccer(), soccer(size_known=True)
NETWORK = SegmentationNetwork.load()
POINTS = np.array([point.X for point in PITCH.points.values()])
LEFT = Camera.from_angles(-0.5, 1.36, 0.004, 1500.0, (1.5, 68.0, -17.0), SIZE)
BOTH = Camera.from_angles(-0.3, 1.36, 0.004, 1300.0, (-2.0, 62.0, -15.0), SIZE)
WIDE = Camera.from_angles(-0.3, 1.30, 0.004, 900.0, (-2.0, 62.0, -15.0), SIZE)
COURT = Camera.from_angles(np.radians(90), np.radians(72), 0.0, 1500.0, (-34.0, 1.0, -10.0), SIZE)
KNOWN = PINHOLE_FLAGS | CalibrationFlags.CALIB_FIX_FOCAL_LENGTH
FOLLOWED = {}
ORDER = list(Verdict)  # good, check, reject


def follows(*remedies):
    """Mark a test as one that follows some remedies."""

    def marked(test):
        for remedy in remedies:
            FOLLOWED[remedy] = test.__name__
        return test

    return marked


def frame_of(camera, labels=None, noise=0.5, field=PITCH):
    seen = observe(whole_circle_markings(field), camera, np.random.default_rng(3), noise=noise)
    return seen if labels is None else {label: seen[label] for label in labels}


def seen(camera, points=POINTS, noise=0.5):
    xy = camera.project(points)
    inside = in_image(xy, camera.image_size)
    return points[inside], (xy + np.random.default_rng(0).normal(size=xy.shape) * noise)[inside]


def is_better(after, before):
    return ORDER.index(after.verdict) < ORDER.index(before.verdict)


def scaled_pitch(scale):
    """A smaller field with the markings of a pitch, whose lines are as wide as on one."""

    def scaled(segment):
        at = {Line: ("start", "end"), Arc: ("center",), Point: ("X",)}[type(segment)]
        moved = {name: tuple(scale * np.array(getattr(segment, name))) for name in at}
        return replace(segment, **moved, **({"radius": scale * segment.radius} if segment.is_arc else {}))

    def nearer(stand):
        return replace(stand, **{axis: tuple(scale * np.array(getattr(stand, axis))) for axis in "xyz"})

    kept = {name: getattr(PITCH, name) for name in ("lines", "paint", "probability", "farthest_camera", "surface")}
    segments = {label: scaled(segment) for label, segment in PITCH.items()}
    length, width = scale * PITCH.length, scale * PITCH.width
    return Field(length, width, segments, stands=tuple(map(nearer, PITCH.stands)), scale=scale * PITCH.scale, **kept)


def test_no_remedy_is_left_out():
    of_module = [one for one in vars(advice).values() if isinstance(one, Remedy) and one != advice.NOTHING]
    of_status = [*REMEDIES.values(), *OF_LABELS.values(), *CAUSE_REMEDIES.values()]
    assert {*of_module, *of_status, UNREADABLE} == set(FOLLOWED)


# labels


@follows(REMEDIES[Status.REJECTED])
def test_a_larger_tau():
    before = calibrate_from_segments(PITCH, frame_of(LEFT), SIZE, tau=1e-5)
    assert before.remedy == REMEDIES[Status.REJECTED].text
    assert is_better(calibrate_from_segments(PITCH, frame_of(LEFT), SIZE, tau=0.019), before)
    spoiled = frame_of(LEFT)
    spoiled["Big rect. left main"] = spoiled["Big rect. left main"] + (60.0, 0.0)
    worst = calibrate_from_segments(PITCH, spoiled, SIZE, tau=0.005)
    assert worst.remedy == REMEDIES[Status.REJECTED].text
    errors = worst.per_segment_errors
    assert max(errors, key=errors.get) == "Big rect. left main"
    assert is_better(calibrate_from_segments(PITCH, frame_of(LEFT), SIZE, tau=0.005), worst)


FEW = ("Side line top", "Big rect. left main", "Big rect. left top", "Small rect. left top")


@follows(REMEDIES[Status.IMPROBABLE])
def test_more_markings_a_known_camera_and_nothing_wrong_that_is_given():
    few = frame_of(LEFT, FEW, noise=1.0)
    before = doubted(calibrate_from_segments(PITCH, few, SIZE), 0.5)
    assert before.remedy == REMEDIES[Status.IMPROBABLE].text
    assert is_better(doubted(calibrate_from_segments(PITCH, frame_of(LEFT, noise=1.0), SIZE), 0.5), before)
    rvec, tvec, K, _ = LEFT.to_opencv()
    flags = KNOWN | CalibrationFlags.CALIB_FIX_POSITION
    known = calibrate_from_segments(PITCH, few, SIZE, K, rvec=rvec, tvec=tvec, flags=flags)
    assert is_better(doubted(known, 0.5), before)
    wrong = doubted(calibrate_from_segments(PITCH, frame_of(LEFT), SIZE, K * (2, 2, 1), flags=KNOWN), 0.5)
    assert wrong.remedy == REMEDIES[Status.IMPROBABLE].text
    assert is_better(doubted(calibrate_from_segments(PITCH, frame_of(LEFT), SIZE), 0.5), wrong)


@follows(advice.MORE_LABELS)
def test_more_labels_or_a_known_camera_where_only_the_probability_is_low():
    few = frame_of(LEFT, FEW, noise=1.0)
    before = calibrate_from_segments(KNOWN_PITCH, few, SIZE)
    assert [one.what for one in before.findings] == [What.IMPROBABLE]
    assert before.remedy == advice.MORE_LABELS.text
    rvec, tvec, K, _ = LEFT.to_opencv()
    flags = KNOWN | CalibrationFlags.CALIB_FIX_POSITION
    for after in (
        calibrate_from_segments(KNOWN_PITCH, frame_of(LEFT), SIZE),
        calibrate_from_segments(KNOWN_PITCH, few, SIZE, K, rvec=rvec, tvec=tvec, flags=flags),
    ):
        assert (after.verdict, after.remedy) == (Verdict.GOOD, "")


@follows(advice.IF_ON_PAINT)
def test_a_picture_to_look_at_that_is_labelled():
    few = frame_of(LEFT, FEW, noise=1.0)
    before = calibrate_from_segments(KNOWN_PITCH, few, SIZE, trust_labels=True)
    assert (before.verdict, before.remedy) == (Verdict.CHECK, advice.IF_ON_PAINT.text)
    assert remedy_of(calibration_line("frame", before, None)) == advice.IF_ON_PAINT
    assert is_better(calibrate_from_segments(KNOWN_PITCH, frame_of(LEFT), SIZE), before)


@follows(advice.RIGHT_SIZE)
@pytest.mark.parametrize("size", [(98.0, 62.0), (112.0, 75.0), (120.0, 80.0)])
def test_the_right_size_where_labels_tell_another_one(size):
    labels = frame_of(WIDE, field=soccer(*size))
    before = calibrate_from_segments(PITCH, labels, SIZE)
    assert before.remedy == advice.RIGHT_SIZE.text
    after = calibrate_from_segments(soccer(*size, size_known=True), labels, SIZE)
    assert not after.has_finding(What.OTHER_SIZE)
    assert is_better(after, before)


@follows(advice.WITHOUT_GIVEN)
def test_a_given_value_that_the_labels_contradict_is_left_out():
    before = calibrate_from_segments(KNOWN_PITCH, frame_of(LEFT), SIZE, LEFT.K * [[1.06], [1.06], [1.0]], flags=KNOWN)
    assert before.remedy == advice.WITHOUT_GIVEN.text
    assert is_better(calibrate_from_segments(KNOWN_PITCH, frame_of(LEFT), SIZE), before)


@follows(advice.MENDED_LABELS)
def test_suspect_labels_that_are_corrected_or_left_out():
    right = frame_of(BOTH)
    wrong = {**right, "Big rect. left main": right["Big rect. left main"] + (40.0, 20.0)}
    before = calibrate_from_segments(KNOWN_PITCH, wrong, SIZE)
    assert before.remedy == "correct 'Big rect. left main', or leave it out"
    without = {label: xy for label, xy in right.items() if label != "Big rect. left main"}
    for labels in (right, without):
        after = calibrate_from_segments(KNOWN_PITCH, labels, SIZE)
        assert is_better(after, before)
        assert after.remedy == ""


@follows(advice.MENDED_LABELS)
def test_a_stray_mark_that_is_taken_away():
    with Editor([picture(LEFT)], KNOWN_PITCH) as editor:
        frame = editor[0].clear()
    for label, xy in frame_of(LEFT).items():
        frame = frame.mark(label, xy[[0, -1]], snap=False)
    before = frame.mark("Circle central", [(300.0, 400.0)], snap=False).calibration
    assert before.has_finding(What.STRAY)
    assert before.reason.count("'Circle central'") == 1  # also suspect, and told once
    assert before.remedy == "correct 'Circle central', or leave it out"
    assert is_better(frame.calibration, before)


@follows(REMEDIES[Status.TOO_FEW_SEGMENTS])
def test_more_markings():
    before = calibrate_from_segments(PITCH, frame_of(LEFT, FEW[:2]), SIZE)
    assert before.remedy == REMEDIES[Status.TOO_FEW_SEGMENTS].text
    assert is_better(calibrate_from_segments(PITCH, frame_of(LEFT), SIZE), before)


@follows(REMEDIES[Status.DEGENERATE])
def test_a_marking_that_is_not_parallel():
    parallel = ("Side line top", "Big rect. left top", "Big rect. left bottom", "Small rect. left top")
    before = calibrate_from_segments(PITCH, frame_of(LEFT, parallel), SIZE)
    assert before.remedy == REMEDIES[Status.DEGENERATE].text
    across = frame_of(LEFT, (*parallel, "Side line left", "Big rect. left main"))
    assert is_better(calibrate_from_segments(PITCH, across, SIZE), before)


@follows(advice.MORE_THAN_GROUND)
def test_a_focal_length_or_a_goal():
    above = Camera.from_angles(0.1, 0.0, 0.0, 800.0, (2.0, 1.0, -90.0), SIZE)
    whole = {label: above.project(segment.sample(1.0)) for label, segment in PITCH.markings.items()}
    flat = {label: xy for label, xy in whole.items() if "Goal" not in label and "central " not in label}
    before = calibrate_from_segments(PITCH, flat, SIZE)
    assert before.verdict is Verdict.GOOD
    assert before.remedy == advice.MORE_THAN_GROUND.text
    known = calibrate_from_segments(PITCH, flat, SIZE, above.K, flags=KNOWN)
    crossbars = {label: xy for label, xy in whole.items() if "crossbar" in label}
    for after in (known, calibrate_from_segments(PITCH, {**flat, **crossbars}, SIZE)):
        assert not after.has_finding(What.GROUND_ONLY)
        assert after.camera.C[2] == pytest.approx(-90.0, rel=0.05)


@follows(REMEDIES[Status.NOT_CONVERGED], OF_LABELS[Status.NOT_CONVERGED])
@pytest.mark.parametrize("by_hand", [True, False])
def test_more_iterations_for_labels_and_labels_for_a_picture(by_hand):
    """Labels of a network are trusted: nobody can check them or give them more iterations."""
    hasty = {"criteria": (3, 1, 1e-15), "trust_labels": not by_hand}
    before = calibrate_from_segments(PITCH, frame_of(LEFT, noise=3.0), SIZE, **hasty)
    assert before.status is Status.NOT_CONVERGED
    assert before.remedy == (OF_LABELS if by_hand else REMEDIES)[Status.NOT_CONVERGED].text
    assert ("iterations" in before.remedy) == by_hand
    noise = 3.0 if by_hand else 0.5
    assert is_better(calibrate_from_segments(PITCH, frame_of(LEFT, noise=noise), SIZE), before)


@follows(REMEDIES[Status.IMPLAUSIBLE], OF_LABELS[Status.IMPLAUSIBLE])
@pytest.mark.parametrize("by_hand", [True, False])
def test_right_labels_and_what_the_picture_is_of(by_hand):
    remedy = (OF_LABELS if by_hand else REMEDIES)[Status.IMPLAUSIBLE].text
    right = frame_of(BOTH)
    shuffled = dict(zip(right, [*right.values()][3:] + [*right.values()][:3], strict=True))
    narrow = {label: xy * (0.26, 1.0) for label, xy in right.items()}
    for labels, size in ((shuffled, SIZE), (narrow, (250, 540))):
        before = calibrate_from_segments(PITCH, labels, size, trust_labels=not by_hand)
        assert (before.status, before.remedy) == (Status.IMPLAUSIBLE, remedy)
        assert is_better(calibrate_from_segments(PITCH, right, SIZE), before)


def test_the_known_length():
    """The remedy of positions relative to the markings in view (`fieldcalib.assess.estimate.in_words`)."""
    image = picture(LEFT, soccer(98.0, 62.0))
    (before,) = calibrate_from_images(PITCH, [image], NETWORK)
    assert "the length is not visible" in before.remedy
    assert Advice.FIELD_SIZE in before.advice
    (known,) = calibrate_from_images(soccer(98.0, 62.0, size_known=True), [image], NETWORK)
    assert (known.verdict, known.remedy) == (Verdict.GOOD, "")


# what a picture is of


def parts_of_frames(*parts):
    """Labels of parts (corner and size) of frames of several cameras, with their places in the frames."""
    rng = np.random.default_rng(0)
    for _ in range(12):
        pan, tilt, f = rng.uniform(-0.6, 0.6), rng.uniform(1.25, 1.42), rng.uniform(900.0, 2000.0)
        C = rng.normal(), rng.uniform(58.0, 75.0), rng.uniform(-22.0, -10.0)
        camera = Camera.from_angles(pan, tilt, 0.005 * rng.normal(), f, C, SIZE)
        for corner, size in parts:
            labels = frame_of(camera.cropped(corner, size), noise=1.0)
            if len(labels) >= 5:
                yield labels, Placement(size, size, Crop(SIZE, corner))


def in_frame(placement, labels):
    """Labels of a picture in pixels of its frame."""
    return {label: placement.to_frame(xy) for label, xy in labels.items()}


@pytest.mark.parametrize(
    ("remedy", "parts"),
    [
        (advice.WHICH_PART, [((320, 180), (640, 360)), ((0, 0), (640, 360))]),
        (advice.NOT_WHOLE, [((0, 0), (480, 540)), ((0, 100), (960, 340))]),
    ],
)
@follows(advice.WHICH_PART, advice.NOT_WHOLE)
def test_which_part_of_a_frame_it_is(remedy, parts):
    """Nothing is asked any more, and the camera of the frame is better than that of the part, or as good."""
    asked, better = 0, 0
    for labels, placement in parts_of_frames(*parts):
        before = calibrate_from_segments(PITCH, labels, placement.size)
        if before.remedy != remedy.text:
            continue
        found = calibrate_from_segments(PITCH, in_frame(placement, labels), placement.frame_size)
        after = replace(in_picture(found, placement), declared=Declared.FRAME)
        assert not after.has_finding(What.PART, What.SHAPE)
        assert not is_better(before, after)
        asked, better = asked + 1, better + is_better(after, before)
    assert asked >= 3
    assert better >= 1


def cameras_of(size, count=12):
    rng = np.random.default_rng(1)
    for _ in range(count):
        pan, tilt, f = rng.uniform(-0.6, 0.6), rng.uniform(1.25, 1.42), rng.uniform(700.0, 1500.0)
        C = rng.normal(), rng.uniform(58.0, 75.0), rng.uniform(-22.0, -10.0)
        yield Camera.from_angles(pan, tilt, 0.005 * rng.normal(), f, C, size)


@follows(advice.NOT_WHOLE)
def test_a_whole_picture_of_another_shape():
    asked = 0
    for camera in cameras_of((640, 640)):
        before = calibrate_from_segments(PITCH, frame_of(camera, noise=1.0), camera.image_size)
        if before.remedy == advice.NOT_WHOLE.text:
            after = replace(before, declared=Declared.FRAME)  # a part that is all of its frame
            assert not after.has_finding(What.SHAPE, What.PART)
            asked += 1
    assert asked >= 3


@follows(advice.NOT_WHOLE)
def test_a_squashed_picture():
    asked, better = 0, 0
    placement = Placement((640, 640), (1138, 640), None)
    for camera in cameras_of((1138, 640)):
        labels = {label: xy / placement.scale for label, xy in frame_of(camera, noise=1.0).items()}
        before = calibrate_from_segments(PITCH, labels, placement.size, estimate_aspect=False)
        if before.remedy == advice.NOT_WHOLE.text:
            found = calibrate_from_segments(PITCH, in_frame(placement, labels), placement.frame_size)
            after = replace(in_picture(found, placement), declared=Declared.PIXELS)
            assert not after.has_finding(What.SHAPE)
            asked, better = asked + 1, better + is_better(after, before)
            if asked == 4:
                break
    assert asked >= 2
    assert better >= 0.5 * asked


@pytest.mark.slow
@follows(advice.ONE_VIEW)
def test_one_view_that_is_cut_out():
    views = [View(picture(camera, KNOWN_PITCH), camera, KNOWN_PITCH) for camera in (LEFT, BOTH)]
    image = arranged(views, WAYS["split, two thirds"], np.random.default_rng(0)).image
    (before,) = calibrate_from_images(KNOWN_PITCH, [image], NETWORK)
    assert before.remedy == advice.ONE_VIEW.text
    left, *_ = windows_of(image)
    (after,) = calibrate_from_images(KNOWN_PITCH, [image[left.top : left.bottom, left.left : left.right]], NETWORK)
    assert not after.has_finding(What.SEVERAL_VIEWS)
    assert is_better(after, before)


# the field


@follows(advice.OFF_PAINT)
@pytest.mark.parametrize("size", [(98.0, 62.0), (112.0, 75.0)])
def test_the_known_size_of_the_field(size):
    image = picture(LEFT, soccer(*size))
    (before,) = calibrate_from_images(PITCH, [image], NETWORK, estimate_size=False)
    assert before.remedy == advice.OFF_PAINT.text
    (after,) = calibrate_from_images(soccer(*size, size_known=True), [image], NETWORK)
    assert after.verdict == Verdict.GOOD


@follows(advice.OFF_PAINT_OF_KNOWN_GROUND)
def test_the_known_size_of_a_field_whose_ground_is_known():
    """The height of its middle, which is given, is not asked for again."""
    low = Ground(crown=0.1)
    image = picture(LEFT, soccer(98.0, 62.0).with_ground(low))
    (before,) = calibrate_from_images(PITCH.with_ground(low), [image], NETWORK, estimate_size=False)
    assert before.remedy == advice.OFF_PAINT_OF_KNOWN_GROUND.text
    (after,) = calibrate_from_images(soccer(98.0, 62.0, size_known=True).with_ground(low), [image], NETWORK)
    assert after.verdict == Verdict.GOOD


@follows(CAUSE_REMEDIES[What.NOT_LEVEL])
def test_the_height_of_the_middle_of_a_field():
    labels = frame_of(WIDE, field=crowned(PITCH, 0.4, roof=True))
    before = calibrate_from_segments(PITCH, labels, SIZE)
    assert before.remedy == CAUSE_REMEDIES[What.NOT_LEVEL].text
    (height,) = next(one.numbers for one in before.findings if one.what is What.NOT_LEVEL)
    after = calibrate_from_segments(PITCH.with_ground(Ground(crown=height)), labels, SIZE)
    assert after.verdict == Verdict.GOOD
    assert after.rms < before.rms


@follows(advice.OFF_PAINT_OF_KNOWN_SIZE)
def test_markings_by_hand_where_a_field_has_one_size():
    court = tennis()
    image, labels = picture(COURT, court), frame_of(COURT, field=court)

    def with_paint(frame):
        found = calibrate_from_segments(court, frame, SIZE)
        markings = Markings.of(court)
        return found.seen_in_image(paint_evidence(image, profiles_along(found.camera, markings), markings).markings)

    few = {label: labels[label] for label in list(labels)[:6]}
    few["Base line right"] = labels["Base line right"] + (0.0, 9.0)
    before = with_paint(few)
    assert before.accepted
    assert before.remedy == advice.OFF_PAINT_OF_KNOWN_SIZE.text
    assert is_better(with_paint(labels), before)


@pytest.mark.slow
@follows(advice.SMALLER)
def test_a_smaller_field_by_its_name():
    small = scaled_pitch(0.5)
    camera = Camera.from_angles(-0.3, 1.34, 0.0, 1800.0, (0.75, 33.0, -8.5), (1920, 1080))
    image = picture(camera, small)
    (before,) = calibrate_from_images(KNOWN_PITCH, [image], NETWORK)
    assert before.remedy == advice.SMALLER.text
    (after,) = calibrate_from_images(small, [image], NETWORK)
    assert not after.has_finding(What.WIDE_PAINT)
    assert is_better(after, before)


@pytest.mark.slow
@follows(advice.NOT_SOCCER, advice.OTHER_SPORT)
def test_another_sport_by_its_name():
    camera = Camera.from_angles(np.radians(92), np.radians(76), 0.01, 2300.0, (-38.0, 1.0, -10.0), (1280, 720))
    image = picture(camera, tennis())
    for before, remedy in (
        (calibrate_from_images(PITCH, [image], Blind())[0], advice.NOT_SOCCER),
        (calibrate_from_images(badminton(), [image])[0], advice.OTHER_SPORT),
    ):
        assert before.remedy.endswith(remedy.text)
        (after,) = calibrate_from_images(tennis(), [image])
        assert is_better(after, before)


# what a report says


@follows(UNREADABLE)
def test_a_file_that_is_got_again(tmp_path):
    path, whole = tmp_path / "frame.png", cv2.imencode(".png", picture(LEFT))[1].tobytes()
    (tmp_path / "other.png").write_bytes(whole)
    said = []
    for name, data in (("first", whole[:2000]), ("second", whole)):
        path.write_bytes(data)
        assert run("run", path, tmp_path / "other.png", "--out", tmp_path / name) in (0, 1)
        said.append(json.loads((tmp_path / name / "cameras.jsonl").read_text(encoding="utf-8").splitlines()[0]))
    assert remedy_of(said[0]) == UNREADABLE
    assert said[1]["verdict"] == Verdict.GOOD


# what was typed wrong


def corners_of(width):
    half = 0.5 * width
    return np.array([(x, y, 0.0) for x, y in ((-11.885, -half), (11.885, -half), (11.885, half), (-11.885, half))])


X, XY = seen(BOTH)
LEFT_PART = XY[:, 0] < SIZE[1]  # of pixels that are farther right it is said at once that they lie outside
AREA = np.array([(-52.5, -20.16, 0.0), (-36.0, -20.16, 0.0), (-36.0, 20.16, 0.0), (-52.5, 20.16, 0.0)])
OFF = XY + np.where(np.arange(len(X)) == 2, 25.0, 0.0)[:, None]
BENT = Camera.from_angles(-0.3, 1.36, 0.01, 700.0, (-2.0, 62.0, -15.0), SIZE, k=(-0.35, 0.0))
K_FREE = PINHOLE_FLAGS & ~CalibrationFlags.CALIB_FIX_K1
AT_EDGE = np.array([[-52.5, 34.0, 0.0]]), np.array([[0.5, 400.0]])
TYPED = {
    What.LEFT_HANDED: ((X * (1, 1, -1), XY, {"prior": None}), (X, XY, {"prior": None})),
    What.OTHER_AXES: ((X * (1, -1, -1), XY, {}), (X, XY, {})),
    What.EXCHANGED_PIXELS: ((X[LEFT_PART], XY[LEFT_PART, ::-1], {}), (X, XY, {})),
    What.OTHER_PICTURE: ((X, 0.5 * XY, {}), (X, XY, {})),
    What.WANTS_LENS: ((*seen(BENT), {"prior": None}), (*seen(BENT), {"prior": None, "flags": K_FREE})),
    What.PICTURE_CORNERS: ((X[:4], [(0, 0), (959, 0), (959, 539), (0, 539)], {}), (X, XY, {})),
    What.TWO_WIDTHS: (
        (corners_of(10.97), COURT.project(corners_of(10.97)), {"prior": None}),
        (
            [*corners_of(10.97), (6.4, 0.0, 0.0), (-6.4, 0.0, 0.0)],
            COURT.project(np.array([*corners_of(10.97), (6.4, 0.0, 0.0), (-6.4, 0.0, 0.0)])),
            {"prior": None},
        ),
    ),
    What.UNCHECKED: (
        (AREA, LEFT.project(AREA), {"prior": None}),
        (AREA, LEFT.project(AREA), {"prior": None, "camera_matrix": LEFT.K, "flags": KNOWN}),
    ),
    What.AT_EDGE: (
        (np.concatenate([X, AT_EDGE[0]]), np.concatenate([XY, AT_EDGE[1]]), {"prior": None}),
        (X, XY, {"prior": None}),
    ),
    What.ONE_OF: ((X[:6], OFF[:6], {"prior": None}), (X, OFF, {"prior": None})),
}


@pytest.mark.parametrize("what", TYPED)
def test_points_that_are_mended(what):
    (X_before, xy_before, how_before), (X_after, xy_after, how_after) = TYPED[what]
    before = calibrate_from_points(X_before, xy_before, SIZE, **how_before)
    assert before.remedy == CAUSE_REMEDIES[what].text
    after = calibrate_from_points(X_after, xy_after, SIZE, **how_after)
    assert not after.has_finding(what)
    if what is What.ONE_OF:
        assert [one.label for one in after.suspect_labels] == ["point 2"]  # which is then named
    elif what is What.WANTS_LENS:
        assert after.rms < 0.5 * before.rms
    else:
        assert is_better(after, before)


for _what in TYPED:
    follows(CAUSE_REMEDIES[_what])(test_points_that_are_mended)


@follows(CAUSE_REMEDIES[What.EXCHANGED_SIDES])
def test_labels_with_their_sides_exchanged_back():
    names = PITCH.mirrored[0]
    before = calibrate_from_segments(PITCH, {names[label]: xy for label, xy in frame_of(LEFT).items()}, SIZE)
    assert before.remedy == CAUSE_REMEDIES[What.EXCHANGED_SIDES].text
    assert is_better(calibrate_from_segments(PITCH, frame_of(LEFT), SIZE), before)


@follows(CAUSE_REMEDIES[What.EXCHANGED_SIZE])
def test_width_and_height_in_their_order():
    upright = {label: xy * (540 / 960, 960 / 540) for label, xy in frame_of(LEFT).items()}
    before = calibrate_from_segments(PITCH, upright, SIZE[::-1], estimate_aspect=True)
    assert before.remedy == CAUSE_REMEDIES[What.EXCHANGED_SIZE].text
    assert is_better(calibrate_from_segments(PITCH, frame_of(LEFT), SIZE), before)


@follows(CAUSE_REMEDIES[What.RANK])
def test_a_homography_that_is_computed_again():
    before = calibrate_from_homography(BOTH.homography * (1.0, 0.0, 1.0), SIZE)
    assert before.remedy == CAUSE_REMEDIES[What.RANK].text
    ground = X[:, 2] == 0.0
    H = homography_from_points(X[ground, :2], BOTH.project(X[ground]), np.ones(np.sum(ground)))
    assert is_better(calibrate_from_homography(H, SIZE), before)


@follows(CAUSE_REMEDIES[What.FARTHEST])
def test_points_that_are_farther_off_are_left_out():
    rng = np.random.default_rng(5)
    rough = XY + rng.normal(size=XY.shape) * 4.0
    rough[3] += (14.0, 10.0)
    before = calibrate_from_points(X, rough, SIZE, prior=None)
    assert before.remedy == CAUSE_REMEDIES[What.FARTHEST].text
    (named,) = (one.about for one in before.findings if one.what is What.FARTHEST)
    kept = [f"point {i}" not in named.split("'") for i in range(len(X))]
    after = calibrate_from_points(X[kept], rough[kept], SIZE, prior=None)
    assert not all(kept)
    assert after.rms < 0.8 * before.rms


# expressions that are to be given instead


def told(message, **names):
    """What the expression after "give" in a message is worth."""
    (expression,) = re.findall(r"give (.+?)(?:, with y|, or prior|$)", message)
    return eval(expression, {"np": np, "length": 105.0, "width": 68.0, **names})  # ours, for users to type


@pytest.mark.parametrize("unit", [1.0, 0.9144, 0.3048, 0.0254, 0.01, 0.001])
@pytest.mark.parametrize("corner", [True, False])
def test_points_in_another_unit_or_from_a_corner(unit, corner):
    typed = (X + (52.5, 34.0, 0.0) * np.array(corner)) / unit
    if unit == 1.0 and not corner:
        return
    with pytest.raises(ValueError, match="object_points look like") as error:
        calibrate_from_points(typed, XY, SIZE)
    mended = told(str(error.value), X=typed)
    np.testing.assert_allclose(mended, X, atol=1e-3)
    assert calibrate_from_points(mended, XY, SIZE).verdict == Verdict.GOOD


MIDDLE = Camera.from_angles(0.05, 1.32, 0.0, 1400.0, (2.0, 66.0, -16.0), SIZE)
OF_CORNER = np.array([[1.0, 0.0, 52.5], [0.0, 1.0, 34.0], [0.0, 0.0, 1.0]])
HOMOGRAPHIES = {
    "inverse": np.linalg.inv(MIDDLE.homography),
    "centimetres": MIDDLE.homography @ np.diag([0.01, 0.01, 1.0]),
    "feet from a corner": MIDDLE.homography @ np.linalg.inv(OF_CORNER) @ np.diag([0.3048, 0.3048, 1.0]),
    "a corner": MIDDLE.homography @ np.linalg.inv(OF_CORNER),
}


@pytest.mark.parametrize("name", HOMOGRAPHIES)
def test_a_homography_of_other_coordinates(name):
    before = calibrate_from_homography(HOMOGRAPHIES[name], SIZE)
    after = calibrate_from_homography(told(before.message, H=HOMOGRAPHIES[name]), SIZE)
    assert after.accepted
    assert "give" not in after.message
    np.testing.assert_allclose(after.camera.C, MIDDLE.C, atol=0.01)


# what the command line tells to do

CORNER_OF_FRAME = ["--crop-of", "900x500+0+0"], ["--crop-of", "1000x600+0+0"]
COMMANDS = {  # what is refused, the remedy in words, and what is given instead
    "leave out --field-length": (["--field", "tennis", "--field-length", "24"], ["--field", "tennis"]),
    "leave --lens out": (["--intrinsics", "camera_a.json", "--lens", "k1"], ["--intrinsics", "camera_a.json"]),
    "leave one out": (
        ["--intrinsics", "camera_a.json", "--position", "0,66,-17", "--rotation", "0,78,0"],
        ["--intrinsics", "camera_a.json", "--position", "0,66,-17"],
    ),
    "images with --clip": (["--camera", "moving"], ["--camera", "moving", "--clip"]),
    "with --clip": (["--same-camera"], ["--clip"]),
    "--shard writes": (["--shard", "1/2", "--format", "parquet"], ["--shard", "1/2"]),
    "it is width x height": (["--display-size", "540x960"], ["--display-size", "960x540"]),
    "does not fit": CORNER_OF_FRAME,
    "did you mean": (["--field", "soccr"], ["--field", "soccer"]),
}


@pytest.mark.parametrize("words", COMMANDS)
def test_what_the_command_line_tells_to_give(words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    cv2.imwrite("a.png", picture(LEFT))
    (tmp_path / "camera_a.json").write_bytes(camera_content(LEFT.to_dict()))
    refused, told_to_give = COMMANDS[words]
    if "parquet" in refused:
        import pyarrow  # noqa: F401 (skipped where it is not installed)
    before = run("run", "a.png", "--out", "before", "--no-pictures", *refused)
    assert words in capsys.readouterr().err
    after = run("run", "a.png", "--out", "after", "--no-pictures", *told_to_give)
    assert words not in capsys.readouterr().err
    assert before in (1, 2)
    assert after == 0


def test_a_folder_that_is_used_is_replaced_or_resumed(tmp_path, capsys):
    image = tmp_path / "a.png"
    cv2.imwrite(str(image), picture(LEFT))
    again = "run", image, "--out", tmp_path / "out", "--no-pictures"
    assert run(*again) == 0
    assert run(*again) == 2
    assert "--overwrite" in capsys.readouterr().err
    assert run(*again, "--overwrite") == run(*again, "--resume") == 0


@pytest.mark.slow
def test_a_whole_clip_whose_principal_point_is_off_the_middle(shared_data, tmp_path):
    """The remedy of the real clip for which it was made: saying that nothing is cut off ends the question."""
    clip, good = shared_data / "clips" / "gdynia.mp4", []
    for name, told in (("asked", ()), ("told", ("--crop-of", "1280x720+0+0"))):
        assert run("run", clip, "--out", tmp_path / name, "--end", 60, "--no-pictures", *told) == 0
        lines = [json.loads(one) for one in (tmp_path / name / "cameras.jsonl").read_text("utf-8").splitlines()]
        asked = sum(one["what"] == What.PART for line in lines for one in line["findings"])
        good.append(sum(line["verdict"] == Verdict.GOOD for line in lines))
    assert asked == 0
    assert good[0] <= good[1]
    assert good[1] >= 50
