"""Clips whose frames do not share one place: parts with places of their own, a camera that moves, or nothing."""

from dataclasses import replace

import numpy as np
import pytest
from tripods import SIZE, chain, matched, panned

from data_tools.synthetic.clips import labelled
from fieldcalib import Camera, calibrate_from_segments, soccer
from fieldcalib.assess.markings import MarkingInView
from fieldcalib.assess.misfit import is_contradicted
from fieldcalib.assess.result import Verdict
from fieldcalib.images.clip_models import LeftOut, parts
from fieldcalib.images.clip_solver import ClipSolver, off_paint
from fieldcalib.images.witnesses import agree
from fieldcalib.problem.evaluation import evaluate_camera
from fieldcalib.solve.options import ALL, DEFAULT_FLAGS
from fieldcalib.solve.sequence_problem import SHARED
from fieldcalib.solve.ties import thinned

FIELD = soccer()


def clip_of(cameras, seed=0, noise=0.5):
    """What is read of a clip with these cameras, all keyframes: labels, and matches of each with the two before."""
    rng = np.random.default_rng(seed)
    clip = ClipSolver(FIELD, DEFAULT_FLAGS, ALL, SHARED)
    clip.size, clip.piece = cameras[0].image_size, [0] * len(cameras)
    found = matched(cameras, chain(len(cameras), 1, 2), rng)
    clip.matches = {pair: thinned(p, q, clip.size) for pair, (p, q) in found.items()}
    for t, frame in enumerate(labelled(cameras, FIELD, rng, noise)):
        clip.seen[t] = frame.pixels, {label: np.ones(len(xy)) for label, xy in frame.pixels.items()}
    return clip


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
    cameras = panned(10, -0.4, 0.4)
    clip = clip_of(cameras)
    (tripod,) = clip.tripods()
    assert (clip.notes, clip.moving, tripod.pieces) == ([], set(), [0])
    assert not is_contradicted(tripod.calibration.frames.misfit, SIZE).any()


def test_parts_have_places_of_their_own():
    cameras = panned(14, -0.45, 0.45)
    cameras = [*cameras[:6], *(moved(camera, (25.0, 0.0, 0.0)) for camera in cameras[6:])]
    clip = clip_of(cameras)
    tripods = clip.tripods()
    assert len(clip.notes) == 1
    assert "parts" in clip.notes[0] or "each part" in clip.notes[0]
    calibrated = {t: one.calibration[k] for one in tripods for k, t in enumerate(clip.frames(one.pieces).tolist())}
    assert sum(far_off(calibrated[t], camera) < 1.5 for t, camera in enumerate(cameras)) >= 12
    assert len({clip.piece[t] for t in (0, 13)}) == 2
    assert sorted(clip.piece) == clip.piece
    video = clip.finished(tripods, clip.seen, {})
    assert video.notes == tuple(clip.notes)
    assert type(video).from_dict(video.to_dict()).notes == video.notes


WAY = 210.0 - 200.0 * np.cos(np.linspace(0.0, 2.0 * np.pi, 16))


@pytest.mark.parametrize("size", [(540, 540), (640, 360)])
def test_a_window_that_moves_is_found_out(size):
    tops = np.linspace(40.0, 100.0, 16) if size == (640, 360) else np.zeros(16)
    lefts = WAY * (960 - size[0]) / 420.0
    whole = panned(16, -0.3, 0.3)
    cameras = [seen_through(one, *place, size) for one, *place in zip(whole, lefts, tops, strict=True)]
    clip = clip_of(cameras)
    (tripod,) = clip.tripods()
    assert clip.windows == {0}
    assert "window that moves" in clip.notes[0]
    found = tripod.calibration
    np.testing.assert_allclose(found.values[:3], whole[0].C, atol=1.0)
    off = [one.camera.principal_point - truth.principal_point for one, truth in zip(found, cameras, strict=True)]
    assert np.median(np.abs(off)) < 12.0
    assert max(far_off(one, camera) for one, camera in zip(found, cameras, strict=True)) < 1.0
    assert [one.verdict for one in found] == [Verdict.GOOD] * 16


def test_a_second_look_that_loses_cameras_is_not_taken(monkeypatch):
    clip = clip_of(panned(10, -0.4, 0.4))
    tripods = clip.tripods()
    found = clip.finished(tripods, clip.seen, {})
    beside = MarkingInView("Middle line", 300.0, 25, share=0.1, offset=21.4)
    found = replace(found, tripods=tuple(one.seen_in_images({0: (beside,)}) for one in found.tripods))
    nothing = clip.finished([], {}, {})
    monkeypatch.setattr(clip, "lines_in", lambda images, tripods: ({}, {}))
    monkeypatch.setattr(clip, "finished", lambda *_: nothing)
    assert off_paint(found) > off_paint(nothing) == 0.0
    assert clip.looked_at_again(found, tripods, []) is found


def test_static_points_alone_do_not_tell_where_a_window_is():
    whole = panned(16, -0.3, 0.3)
    cameras = [seen_through(one, left, 0.0, (540, 540)) for one, left in zip(whole, WAY, strict=True)]
    clip = clip_of(cameras)
    del clip.seen[8]
    (tripod,) = clip.tripods()
    assert clip.windows == {0}
    found = tripod.calibration
    assert found[8].accepted
    assert [t for t, one in enumerate(found) if one.verdict is not Verdict.GOOD] == [8]
    assert "no line of it" in found[8].reason


@pytest.mark.parametrize("seed", [0, 1])
def test_a_window_that_stays_is_a_tripod(seed):
    cameras = [seen_through(one, 60.0, 0.0, (540, 540)) for one in panned(16, -0.3, 0.3)]
    clip = clip_of(cameras, seed)
    (tripod,) = clip.tripods()
    assert (clip.windows, clip.notes) == (set(), [])
    assert max(far_off(one, camera) for one, camera in zip(tripod.calibration, cameras, strict=True)) < 1.0


def test_labels_without_sense_are_no_witnesses_where_others_tell_the_camera():
    clip = clip_of(panned(12, -0.4, 0.4))
    for t in (5, 6, 7):
        pixels, weights = clip.seen.pop(t)
        clip.doubtful[t] = {label: xy + (150.0, 60.0) for label, xy in pixels.items()}, weights
    clip.garbled = {5, 6, 7}
    assert not is_contradicted(clip.together([0], clip.seen).frames.misfit, SIZE).any()
    few = {t: clip.seen.pop(t) for t in sorted(clip.seen)[4:]}
    assert is_contradicted(clip.together([0], {**clip.seen, **few}).frames.misfit, SIZE)[5:8].any()


def test_what_the_network_saw_contradicts_cameras_that_lines_confirm():
    cameras = panned(12, -0.4, 0.4)
    clip = clip_of(cameras)
    (tripod,) = clip.tripods()
    for t in range(6, 12):  # what is seen there is of another view: these keyframes had no camera by themselves
        pixels, weights = clip.seen.pop(t)
        clip.doubtful[t] = {label: xy + (150.0, 60.0) for label, xy in pixels.items()}, weights
    calibration = clip.together([0], clip.seen)
    contradicted = is_contradicted(calibration.frames.misfit, SIZE)
    assert contradicted[6:].all()
    assert not contradicted[:5].any()
    assert calibration[8].verdict is not Verdict.GOOD
    assert calibration[2].verdict is Verdict.GOOD
    assert not is_contradicted(tripod.calibration.frames.misfit, SIZE).any()


def test_a_camera_that_moves_is_found_out():
    cameras = [moved(camera, (0.4 * t, 0.0, 0.0)) for t, camera in enumerate(panned(16, -0.3, 0.3))]
    clip = clip_of(cameras)
    (tripod,) = clip.tripods()
    assert clip.moving == {0}
    assert "--camera moving" in clip.notes[0]
    # from one place, which explains the labels to 2 px, the middle of the picture is 3 to 8 px off in most frames
    assert max(far_off(one, camera) for one, camera in zip(tripod.calibration, cameras, strict=True)) < 0.7
    assert [one.verdict for one in tripod.calibration] == [Verdict.GOOD] * 16
    video = clip.finished([tripod], clip.seen, {})
    assert max(far_off(one, camera) for one, camera in zip(video, cameras, strict=True)) < 0.7


def test_frames_that_share_nothing_are_calibrated_one_by_one(monkeypatch):
    rng = np.random.default_rng(3)
    cameras = [moved(camera, rng.normal(scale=(8.0, 8.0, 2.4))) for camera in panned(14, -0.3, 0.3)]
    clip = clip_of(cameras)
    clip.network = object()
    tripods = clip.tripods()
    assert (clip.alone, clip.moving, clip.windows) == ({0}, set(), set())
    assert "one by one" in clip.notes[0]
    images, by_itself = np.zeros((14, *SIZE[::-1], 3), np.uint8), iter(range(14))
    monkeypatch.setattr(
        ClipSolver,
        "_by_themselves",
        lambda self, images: [calibrate_from_segments(FIELD, clip.seen[next(by_itself)][0], SIZE) for _ in images],
    )
    lines, ridges = clip.lines_in(images, tripods)
    assert set(lines) == set(ridges) == set(range(14))
    video = clip.finished(tripods, lines, {})
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
    assert agree(evaluate_camera(camera, FIELD, labels)) is expected


def test_alternating_places_make_two_tripods():
    """Parts of one run of frames that are of one place are one tripod, however often it comes back."""
    one, other = panned(12, -0.4, 0.4), [moved(camera, (25.0, 0.0, 0.0)) for camera in panned(12, -0.35, 0.35)]
    cameras = [*one[:6], *other[:6], *one[6:], *other[6:]]
    clip = clip_of(cameras)
    tripods = clip.tripods()
    assert sorted(tripod.pieces for tripod in tripods) == [[0, 2], [1, 3]]
    assert "each part" in clip.notes[0]
    calibrated = {t: one.calibration[k] for one in tripods for k, t in enumerate(clip.frames(one.pieces).tolist())}
    assert sum(far_off(calibrated[t], camera) < 1.0 for t, camera in enumerate(cameras)) >= 22


def test_a_piece_that_contradicts_the_others_is_no_part_of_their_tripod(monkeypatch):
    """Whatever the places of the pieces say."""
    monkeypatch.setattr("fieldcalib.images.clip_solver.grouped", lambda shots: [sorted(shots)])
    one = panned(10, -0.4, 0.4)
    cameras = [*one[:6], *(moved(camera, (9.0, 6.0, 0.0)) for camera in panned(8, -0.3, 0.3)), *one[6:]]
    clip = clip_of(cameras)
    clip.piece = [0] * 6 + [1] * 8 + [2] * 4
    clip.matches = {(i, j): one for (i, j), one in clip.matches.items() if clip.piece[i] == clip.piece[j]}
    assert sorted(tripod.pieces for tripod in clip.tripods()) == [[0, 2], [1]]


@pytest.mark.parametrize(("way", "pieces"), [(0.0, [[0]]), (25.0, [[0], [1]])])
def test_frames_that_nothing_ties_join_the_piece_before_where_it_explains_them(way, pieces):
    cameras = panned(10, -0.4, 0.4)
    cameras = [*cameras[:7], *(moved(camera, (way, 0.0, 0.0)) for camera in cameras[7:])]
    clip = clip_of(cameras)
    clip.piece, clip.in_transition = [0] * 7 + [1] * 3, [False] * 7 + [True] * 3
    clip.matches = {(i, j): one for (i, j), one in clip.matches.items() if j < 7}
    assert sorted(tripod.pieces for tripod in clip.tripods()) == pieces
    assert set(clip.piece) == {number for one in pieces for number in one}


def test_left_out_labels_are_predicted_by_the_right_cameras_only():
    cameras = panned(8, -0.4, 0.4)
    clip = clip_of(cameras)
    left_out = LeftOut.of(clip.seen)
    assert all(left_out.left[t][0] not in left_out.kept[t][0] for t in left_out.left)
    assert len(left_out.left) >= 6
    calibration = clip.together([0], left_out.kept)
    frames = clip.frames([0])
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
