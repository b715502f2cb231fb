"""Clips whose frames do not share one place: parts with places of their own, a camera that moves, or nothing."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from pictures import picture
from tripods import SIZE, chain, matched, panned

from data_tools.synthetic.clips import labelled
from fieldcalib import Camera, calibrate_from_segments, soccer
from fieldcalib.assess.advice import WHICH_PART
from fieldcalib.assess.findings import Verdict, What
from fieldcalib.assess.label_errors import is_contradicted
from fieldcalib.assess.paint_in_view import MarkingInView
from fieldcalib.images.clip.clip_models import ALONE, CUT_OUT, MOVING, TRIPOD, WINDOW, HeldOut, Pieces, parts
from fieldcalib.images.clip.finished_clip import (
    UNTIED,
    ClipLines,
    FramePaint,
    _with_place_of_picture,
    find_clip_lines,
    finish_clip,
    finish_clip_again,
    off_paint,
)
from fieldcalib.images.clip.keyframes import KeyframeLabels, Keyframes, Shots, are_consistent
from fieldcalib.images.clip.solved_shots import solve_shots, solve_tripods
from fieldcalib.images.from_images import How
from fieldcalib.images.paint.line_profiles import Markings, profiles_along
from fieldcalib.problem.evaluation import evaluate_camera
from fieldcalib.problem.labelled_pixels import PixelTable
from fieldcalib.problem.picture_shape import Declared
from fieldcalib.solve.request import Task
from fieldcalib.solve.sequence.background_matches import cell_means

FIELD = soccer()
CUT = (304, 540)  # out of the middle of `SIZE`


def clip_of(cameras, seed=0, noise=0.5, piece=None, loose=None):
    """What is read of a clip with these cameras, all keyframes: labels, and matches of each with the two before."""
    rng, size, count = np.random.default_rng(seed), cameras[0].image_size, len(cameras)
    pieces = Pieces(np.array(piece or [0] * count))
    found = matched(cameras, chain(count, 1, 2), rng)
    matches = {pair: cell_means(p, q, size) for pair, (p, q) in found.items() if np.ptp(pieces.number[list(pair)]) == 0}
    frames = [frame.pixels for frame in labelled(cameras, FIELD, rng, noise)]
    labels = {t: KeyframeLabels(PixelTable.of(FIELD, [pixels])) for t, pixels in enumerate(frames)}
    shots = Shots(0, size, pieces, np.array(loose or [False] * count), matches)
    return Keyframes(How(Task(FIELD)), shots, labels)


def solved(clip):
    return solve_tripods(solve_shots(clip))


@cache
def of_one_place(count):
    """A clip of a camera that pans on its tripod, solved."""
    return solved(clip_of(panned(count, -0.4, 0.4)))


def finished(found, paint=None):
    """All frames, from the labels of keyframes."""
    members = tuple(one.pieces for one in found.tripods)
    return finish_clip(ClipLines(found, members, found.keyframes.accepted, paint or {}))


def together(clip, labels=None):
    """All frames of a clip from one tripod."""
    return clip.calibrate(clip.shots.pieces, [0], clip.accepted if labels is None else labels)


def calibrated(found):
    """The calibration of each frame."""
    tripods = [(found.pieces.frames(one.pieces).tolist(), one.calibration) for one in found.tripods]
    return {t: one for frames, calibration in tripods for t, one in zip(frames, calibration, strict=True)}


def test_frames_that_were_cut_out_have_the_focal_length_of_their_whole_ones():
    """The prior of whole pictures 608 px wide, in each of 40 frames, outweighs the labels: a third too short."""
    pans = np.linspace(-0.05, 0.05, 40)
    whole = [Camera.from_angles(pan, 1.38, 0.0, 6000.0, (0.0, 95.0, -18.0), (1920, 1080)) for pan in pans]
    found = together(clip_of([camera.cropped((656, 0), (608, 1080)) for camera in whole], noise=1.0))
    f = [one.required_camera.focal_length for one in found]
    np.testing.assert_allclose(f, 6000.0, rtol=0.05)


def test_the_prior_of_zoom_and_angles_does_not_count_in_every_frame():
    """Those of tilt and zoom, off in all 40 frames alike, had moved the place by 4.9 standard deviations, 80 m."""
    pans, place = np.linspace(0.0, 0.1, 40), (0.0, 75.0, -18.0)
    whole = [Camera.from_angles(pan, 1.38, -0.02, 3000.0, place, (1920, 1080)) for pan in pans]
    found = together(clip_of([one.cropped((1200, 0), (608, 1080)) for one in whole], noise=1.0, seed=1)).shared
    truth = dict(zip(("x", "y", "z", "cx", "cy"), (*place, 960.0 - 1200.0, 540.0), strict=True))
    assert all(abs(found[name][0] - value) < 2.0 * found[name][1] for name, value in truth.items())


@cache
def of_part(size):
    """The frames of a short clip, or of a part that is cut out of it."""
    return together(clip_of([one if size == SIZE else one.cropped((328, 0), CUT) for one in panned(4, -0.02, 0.02)]))


@pytest.mark.parametrize(
    ("width", "sigma", "size", "is_doubted"),
    [
        (62.0, 0.9, CUT, True),
        (62.0, 0.3, CUT, False),
        (66.0, 0.9, CUT, False),
        (62.0, 0.9, SIZE, False),
    ],
)
def test_a_part_whose_size_of_the_field_is_odd_and_hardly_told_is_doubted(width, sigma, size, is_doubted):
    """A wrong line may be the reason, where the principal point is open."""
    found, how = of_part(size), How(Task(FIELD))
    found = replace(found, names=("width",), values=np.array([width]), covariance=np.array([[sigma**2]]))
    judged = _with_place_of_picture(found, how, TRIPOD)
    assert all(one.has_finding(What.PART) == is_doubted for one in judged if one.camera is not None)
    declared = replace(how, declared=Declared.FRAME)
    assert _with_place_of_picture(found, declared, TRIPOD) is found


@pytest.mark.parametrize(
    ("told", "is_doubted"),
    [(104.0, False), *(pytest.param(*one, marks=pytest.mark.slow) for one in ((105.0, False), (101.0, True)))],
)
def test_a_told_size_that_the_labels_contradict_is_a_doubt(told, is_doubted):
    """Lines near the markings of a pitch of that size would not tell; to the tolerance it may be off."""
    how = How(Task(soccer(told, size_known=True)), estimate_size=False)
    found = finished(solved(replace(clip_of(panned(8, -0.05, 0.4)), how=how)))
    others = [one for frame in found for one in frame.findings if one.what is What.OTHER_SIZE]
    assert len(others) == is_doubted * len(found)
    assert all(one.numbers == pytest.approx((105.0, 68.0), abs=0.6) for one in others)
    assert not is_doubted or all(frame.verdict is not Verdict.GOOD for frame in found)


def without_sense(clip, frames, **how):
    """A clip with doubtful labels of another view in some keyframes."""
    labels = dict(clip.labels)
    for t in frames:
        table = labels[t].labels
        elsewhere = replace(table, xy=table.xy + (150.0, 60.0))
        labels[t] = KeyframeLabels(elsewhere, accepted=False, **how)
    return replace(clip, labels=labels)


def seen_through(camera, left, top, size):
    """The part of a picture that a window shows."""
    K = camera.K.copy()
    K[:2, 2] -= left, top
    return Camera(K, camera.R, camera.C, size)


def moved(camera, way):
    return Camera(camera.K, camera.R, np.add(camera.C, way), camera.image_size)


def far_off(found, camera):
    """Pixels by which the ground in the middle of the picture is elsewhere."""
    middle = np.multiply(camera.image_size, (0.5, 0.55))
    return float(np.linalg.norm(found.camera.project(camera.image_to_field(middle)) - middle))


def test_one_place_that_holds_stays():
    found = of_one_place(10)
    (tripod,) = found.tripods
    assert (found.notes, found.pieces.models, tripod.pieces) == ((), {}, (0,))
    assert not is_contradicted(tripod.calibration.frames.misfit, SIZE).any()


@pytest.mark.slow
def test_parts_have_places_of_their_own():
    cameras = panned(14, -0.45, 0.45)
    cameras = [*cameras[:6], *(moved(camera, (25.0, 0.0, 0.0)) for camera in cameras[6:])]
    found = solved(clip_of(cameras))
    (note,) = found.notes
    assert "each part" in note
    frames = calibrated(found)
    assert sum(far_off(frames[t], camera) < 1.5 for t, camera in enumerate(cameras)) >= 12
    number = found.pieces.number.tolist()
    assert number[0] != number[13]
    assert sorted(number) == number
    video = finished(found)
    assert video.notes == (note,)
    assert type(video).from_dict(video.to_dict()).notes == video.notes


WAY = 210.0 - 200.0 * np.cos(np.linspace(0.0, 2.0 * np.pi, 16))


@pytest.mark.slow
@pytest.mark.parametrize("size", [(540, 540), (640, 360)])
def test_a_window_that_moves_is_found_out(size):
    tops = np.linspace(40.0, 100.0, 16) if size == (640, 360) else np.zeros(16)
    lefts = WAY * (960 - size[0]) / 420.0
    whole = panned(16, -0.3, 0.3)
    cameras = [seen_through(one, *place, size) for one, *place in zip(whole, lefts, tops, strict=True)]
    result = solved(clip_of(cameras))
    (tripod,) = result.tripods
    assert result.pieces.models == {0: WINDOW}
    assert "window that moves" in result.notes[0]
    found = tripod.calibration
    np.testing.assert_allclose(found.values[:3], whole[0].C, atol=1.0)
    off = [one.camera.principal_point - truth.principal_point for one, truth in zip(found, cameras, strict=True)]
    assert np.median(np.abs(off)) < 12.0
    assert max(far_off(one, camera) for one, camera in zip(found, cameras, strict=True)) < 1.0
    assert [one.verdict for one in found] == [Verdict.GOOD] * 16


PENALTY_AREA = [Camera.from_angles(0.55 + 0.01 * k, 1.36, 0.0, 1500.0, (0.0, 66.0, -16.0), SIZE) for k in range(5)]


@cache
def of_penalty_area():
    return solved(clip_of(PENALTY_AREA))


@cache
def paint_of_penalty_area(k, off):
    """What a frame shows along its markings, whose paint lies some metres beside them."""
    camera, markings = PENALTY_AREA[k], Markings.of(FIELD)
    image = picture(moved(camera, (0.0, off, 0.0)), FIELD)
    return FramePaint.of(image, camera, profiles_along(camera, markings), markings)


@pytest.mark.parametrize(("off", "is_doubted"), [(5, True), (4, True), (2, False), (0, False)])
def test_paint_past_an_end_counts_in_a_clip_where_most_frames_show_it(off, is_doubted):
    """The lines of a penalty area lie on paint, but in some frames it goes on by seven metres."""
    paint = {k: paint_of_penalty_area(k, 7.0 * (k < off)) for k in range(5)}
    video = finished(of_penalty_area(), paint)
    assert [one.has_finding(What.PAST_END) for one in video] == 5 * [is_doubted]
    assert not is_doubted or all(one.verdict is Verdict.CHECK for one in video)


def test_a_second_look_that_loses_cameras_is_not_taken(monkeypatch):
    result = of_one_place(10)
    found = finished(result)
    beside = MarkingInView("Middle line", 300.0, 25, share=0.1, offset=21.4)
    found = replace(found, tripods=tuple(one.seen_in_images({0: (beside,)}) for one in found.tripods))
    nothing = finished(replace(result, tripods=()))
    monkeypatch.setattr("fieldcalib.images.clip.finished_clip.find_clip_lines", lambda *_: None)
    monkeypatch.setattr("fieldcalib.images.clip.finished_clip.finish_clip", lambda *_: nothing)
    assert off_paint(found) > off_paint(nothing) == 0.0
    assert finish_clip_again(found, ClipLines(result, ((0,),), {}, {}), []) is found


@pytest.mark.slow
def test_static_points_alone_do_not_tell_where_a_window_is():
    whole = panned(16, -0.3, 0.3)
    cameras = [seen_through(one, left, 0.0, (540, 540)) for one, left in zip(whole, WAY, strict=True)]
    clip = clip_of(cameras)
    found = solved(replace(clip, labels={t: one for t, one in clip.labels.items() if t != 8}))
    (tripod,) = found.tripods
    assert found.pieces.models == {0: WINDOW}
    assert "window that moves" in found.notes[0]
    found = tripod.calibration
    np.testing.assert_allclose(found.values[:3], whole[0].C, atol=1.0)
    labelled = [(one, camera) for t, (one, camera) in enumerate(zip(found, cameras, strict=True)) if t != 8]
    assert max(far_off(one, camera) for one, camera in labelled) < 1.2
    assert found[8].accepted
    assert [t for t, one in enumerate(found) if one.verdict is not Verdict.GOOD] == [8]
    assert "position of its window is uncertain" in found[8].reason


@pytest.mark.slow
def test_a_window_that_stays_is_a_tripod():
    cameras = [seen_through(one, 60.0, 0.0, (540, 540)) for one in panned(16, -0.3, 0.3)]
    found = solved(clip_of(cameras))
    (tripod,) = found.tripods
    assert (found.pieces.models, found.notes) == ({}, ())
    assert max(far_off(one, camera) for one, camera in zip(tripod.calibration, cameras, strict=True)) < 1.0


@pytest.mark.slow
def test_labels_without_sense_are_no_witnesses_where_others_tell_the_camera():
    clip = without_sense(clip_of(panned(12, -0.4, 0.4)), (5, 6, 7), consistent=False)
    assert not is_contradicted(together(clip).frames.misfit, SIZE).any()
    kept = {*sorted(clip.accepted)[:4], *clip.doubtful}
    few = replace(clip, labels={t: one for t, one in clip.labels.items() if t in kept})
    assert is_contradicted(together(few, clip.accepted).frames.misfit, SIZE)[5:8].any()


@pytest.mark.slow
def test_what_the_network_saw_contradicts_cameras_that_lines_confirm():
    clip = clip_of(panned(12, -0.4, 0.4))
    (tripod,) = solved(clip).tripods
    # what is seen in the second half is of another view: these keyframes had no camera by themselves
    calibration = together(without_sense(clip, range(6, 12)))
    contradicted = is_contradicted(calibration.frames.misfit, SIZE)
    assert contradicted[6:].all()
    assert not contradicted[:5].any()
    assert calibration[8].verdict is not Verdict.GOOD
    assert calibration[2].verdict is Verdict.GOOD
    assert not is_contradicted(tripod.calibration.frames.misfit, SIZE).any()


@pytest.mark.slow
def test_a_camera_that_moves_is_found_out():
    cameras = [moved(camera, (0.4 * t, 0.0, 0.0)) for t, camera in enumerate(panned(16, -0.3, 0.3))]
    found = solved(clip_of(cameras))
    (tripod,) = found.tripods
    assert found.pieces.models == {0: MOVING}
    assert "--camera moving" in found.notes[0]
    # from one place, which explains the labels to 2 px, the middle of the picture is 3 to 8 px off in most frames
    assert max(far_off(one, camera) for one, camera in zip(tripod.calibration, cameras, strict=True)) < 0.7
    assert [one.verdict for one in tripod.calibration] == [Verdict.GOOD] * 16
    video = finished(found)
    assert max(far_off(one, camera) for one, camera in zip(video, cameras, strict=True)) < 0.7


@pytest.mark.slow
def test_frames_that_share_nothing_are_calibrated_one_by_one(monkeypatch):
    rng = np.random.default_rng(3)
    cameras = [moved(camera, rng.normal(scale=(8.0, 8.0, 2.4))) for camera in panned(14, -0.3, 0.3)]
    clip = clip_of(cameras)
    found = solved(clip)
    assert found.pieces.models == {0: ALONE}
    assert "one by one" in found.notes[0]
    images, by_itself = np.zeros((14, *SIZE[::-1], 3), np.uint8), iter(range(14))
    monkeypatch.setattr(
        "fieldcalib.images.clip.finished_clip.calibrate_frames_alone",
        lambda how, images: [
            calibrate_from_segments(FIELD, clip.accepted[next(by_itself)].by_label(0), SIZE) for _ in images
        ],
    )
    lines = find_clip_lines(found, images)
    assert set(lines.labels) == set(lines.paint) == set(range(14))
    video = finish_clip(replace(lines, paint={}))
    assert np.median([far_off(one, camera) for one, camera in zip(video, cameras, strict=True)]) < 1.0
    assert video.basis == ["lines"] * 14


@pytest.mark.parametrize(("right", "wrong", "expected"), [(6, 0, True), (4, 3, True), (3, 0, False), (4, 5, False)])
def test_labels_agree_that_one_camera_explains(right, wrong, expected):
    (camera,) = panned(1)
    seen = {label: camera.project(FIELD[label].sample(2.0)) for label in FIELD}
    seen = {label: xy[((xy > 0.0) & (xy < SIZE)).all(axis=1)] for label, xy in seen.items()}
    names = [label for label, xy in seen.items() if len(xy) > 2]
    assert len(names) >= right + wrong
    labels = {label: seen[label] + (0.0, 90.0 * (k >= right)) for k, label in enumerate(names[: right + wrong])}
    assert are_consistent(evaluate_camera(camera, FIELD, labels)) is expected


@pytest.mark.slow
def test_alternating_places_make_two_tripods():
    """Parts of one run of frames that are of one place are one tripod, however often it comes back."""
    one, other = panned(8, -0.4, 0.4), [moved(camera, (25.0, 0.0, 0.0)) for camera in panned(8, -0.35, 0.35)]
    cameras = [*one[:4], *other[:4], *one[4:], *other[4:]]
    found = solved(clip_of(cameras))
    assert sorted(tripod.pieces for tripod in found.tripods) == [(0, 2), (1, 3)]
    assert "each part" in found.notes[0]
    frames = calibrated(found)
    assert sum(far_off(frames[t], camera) < 1.0 for t, camera in enumerate(cameras)) >= 15


@pytest.mark.slow
def test_a_piece_that_contradicts_the_others_is_no_part_of_their_tripod(monkeypatch):
    """Whatever the places of the pieces say."""
    monkeypatch.setattr("fieldcalib.images.clip.solved_shots.grouped_by_tripod", lambda shots: [sorted(shots)])
    one = panned(10, -0.4, 0.4)
    cameras = [*one[:6], *(moved(camera, (9.0, 6.0, 0.0)) for camera in panned(8, -0.3, 0.3)), *one[6:]]
    clip = clip_of(cameras, piece=[0] * 6 + [1] * 8 + [2] * 4)
    assert sorted(tripod.pieces for tripod in solved(clip).tripods) == [(0, 2), (1,)]


@pytest.mark.parametrize(("way", "pieces"), [(0.0, [(0,)]), pytest.param(25.0, [(0,), (1,)], marks=pytest.mark.slow)])
def test_frames_that_nothing_ties_join_the_piece_before_where_it_explains_them(way, pieces):
    cameras = panned(10, -0.4, 0.4)
    cameras = [*cameras[:7], *(moved(camera, (way, 0.0, 0.0)) for camera in cameras[7:])]
    clip = clip_of(cameras, piece=[0] * 7 + [1] * 3, loose=[False] * 7 + [True] * 3)
    shots = replace(clip.shots, matches={(i, j): one for (i, j), one in clip.shots.matches.items() if j < 7})
    found = solved(replace(clip, shots=shots))
    assert sorted(tripod.pieces for tripod in found.tripods) == pieces
    assert set(found.pieces.numbers) == {number for one in pieces for number in one}


def test_left_out_labels_are_predicted_by_the_right_cameras_only():
    cameras = panned(8, -0.4, 0.4)
    clip = clip_of(cameras)
    left_out = HeldOut.of(clip.accepted)
    assert all(not left_out.left[t].by_label(0).keys() & left_out.kept[t].by_label(0).keys() for t in left_out.left)
    assert len(left_out.left) >= 6
    calibration = together(clip, left_out.kept)
    frames = clip.shots.pieces.frames([0])
    right = left_out.misprediction(FIELD, [(frames, calibration)])
    assert right.score < np.log1p(0.5)
    assert left_out.misprediction(FIELD, [(frames[::-1], calibration)]).score > 3.0 * right.score


@pytest.mark.parametrize(
    ("contradicted", "expected"),
    [
        ("..", []),
        ("xx....", [24]),
        ("....xx", [48]),
        ("..x...", []),
        ("x.....", []),
        ("..xx..", [24, 48]),
        ("x.xx", []),
    ],
)
def test_runs_of_keyframes_are_parts(contradicted, expected):
    some = np.array([one == "x" for one in contradicted])
    assert parts(12 * np.arange(len(some)), some) == expected


@pytest.mark.slow
def test_a_zoom_off_the_middle_is_found_out():
    """A part of the picture, enlarged: the principal point is far from the middle, and cameras are right with it."""
    size, corner = (720, 405), (0, 0)
    cameras = [one.cropped(corner, size).scaled(SIZE) for one in panned(12, -0.4, 0.4)]
    found = solved(clip_of(cameras))
    assert found.pieces.models == {0: CUT_OUT}
    (note,) = found.notes
    assert "part of a larger one" in note
    video = finished(found)
    assert {one.verdict for one in video} == {Verdict.GOOD}
    assert max(far_off(one, camera) for one, camera in zip(video, cameras, strict=True)) < 0.3


@pytest.mark.slow
def test_a_principal_point_that_its_prior_holds_back_is_to_be_checked(monkeypatch):
    monkeypatch.setattr("fieldcalib.images.clip.solved_shots._cut_out", lambda solved, piece: solved)
    cameras = [one.cropped((0, 0), (720, 405)).scaled(SIZE) for one in panned(12, -0.4, 0.4)]
    clip = clip_of(cameras)
    video = finished(solved(clip))
    assert {one.verdict for one in video} == {Verdict.CHECK}
    assert "part of a frame" in video[0].reason
    assert video[0].remedy == WHICH_PART.text
    answered = finished(solved(replace(clip, how=replace(clip.how, declared=Declared.FRAME))))
    assert not any(one.has_finding(What.PART) for one in answered)
    assert {one.verdict for one in answered} == {Verdict.GOOD}


def test_a_frame_that_nothing_ties_does_not_say_that_it_shows_no_marking():
    """As in a dissolve, of which lines were not even looked for."""
    clip = clip_of(panned(8, -0.4, 0.4))
    matches = {pair: one for pair, one in clip.shots.matches.items() if 7 not in pair}
    loose = np.arange(8) == 7
    labels = {t: one for t, one in clip.labels.items() if t != 7}
    found = finished(solved(replace(clip, labels=labels, shots=replace(clip.shots, matches=matches, loose=loose))))
    assert found[7].camera is None
    assert found[7].message == UNTIED
    assert "no marking" not in found[7].reason
    assert all(found[t].accepted for t in range(7))
