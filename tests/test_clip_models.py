"""Clips whose frames do not share one place: parts with places of their own, a camera that moves, or nothing."""

import numpy as np
import pytest
from tripods import SIZE, chain, matched, panned

from data_tools.synthetic.clips import labelled
from fieldcalib import Camera, soccer
from fieldcalib.assess.misfit import is_contradicted
from fieldcalib.assess.result import Verdict
from fieldcalib.calibrate.options import ALL, DEFAULT_FLAGS
from fieldcalib.calibrate.sequence_solver import SHARED
from fieldcalib.calibrate.ties import thinned
from fieldcalib.images.clip_models import LeftOut, parts
from fieldcalib.images.clip_solver import ClipSolver

FIELD = soccer()


def clip_of(cameras, seed=0, noise=0.5):
    """What is read of a clip with these cameras, all keyframes: labels, and matches of each with the two before."""
    rng = np.random.default_rng(seed)
    clip = ClipSolver(FIELD, DEFAULT_FLAGS, ALL, SHARED)
    clip.size, clip.piece = SIZE, [0] * len(cameras)
    found = matched(cameras, chain(len(cameras), 1, 2), rng)
    clip.matches = {pair: thinned(p, q, SIZE) for pair, (p, q) in found.items()}
    for t, frame in enumerate(labelled(cameras, FIELD, rng, noise)):
        clip.seen[t] = frame.pixels, {label: np.ones(len(xy)) for label, xy in frame.pixels.items()}
    return clip


def moved(camera, way):
    return Camera(camera.K, camera.R, np.add(camera.C, way), camera.image_size)


def far_off(found, camera):
    """Pixels by which the ground in the middle of the picture is elsewhere."""
    return float(np.linalg.norm(found.camera.project(camera.image_to_field([480.0, 300.0])) - [480.0, 300.0]))


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
