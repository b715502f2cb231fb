"""Clips solved around frames that are known for sure: motion links frames, and wrong labels are left out."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from panoramas import dissolved, shot
from test_clip_models import FIELD, clip_of
from tripods import panned

from fieldcalib import Camera, Editor
from fieldcalib.draw.scene import render_field
from fieldcalib.editor.clip import next_frame
from fieldcalib.editor.frame_states import Row
from fieldcalib.fields import tennis
from fieldcalib.images.background.keyframe_tracking import linked_frames, tied_frames
from fieldcalib.images.clip.clip_with_anchors import _without_contradicted
from fieldcalib.images.clip.keyframes import KeyframeLabels
from fieldcalib.io.frame_source import ArrayFrames as Arrays
from fieldcalib.problem.labelled_pixels import PixelTable

COUNT = 12
CAMERAS = panned(COUNT)


def moved(labels, off):
    return {t: KeyframeLabels(PixelTable.of(FIELD, [shifted(one, off)])) for t, one in labels.items()}


def shifted(one, off):
    return {label: xy + off for label, xy in one.labels.by_label(0).items()}


@pytest.mark.parametrize("anchors", [(), *(pytest.param(held, marks=pytest.mark.slow) for held in ((0, 11), (5,)))])
def test_spoiled_labels_are_left_out(anchors):
    """A third of the keyframes is moved by 40 px: they contradict the others, matches and the tripod."""
    clip = clip_of(CAMERAS)
    spoiled = (2, 6, 7, 10)
    wrong = moved({t: clip.labels[t] for t in spoiled}, (30.0, 26.0))
    held = {t: clip.labels[t] for t in anchors}
    found = _without_contradicted(type(clip)(clip.how, clip.shots, clip.labels | wrong), held)
    assert set(found.labels) == set(range(COUNT)) - set(spoiled)


@pytest.mark.slow
def test_labels_of_frames_that_nothing_ties_are_contradicted_by_those_around():
    clip = clip_of(CAMERAS)
    matches = {pair: cells for pair, cells in clip.shots.matches.items() if 4 not in pair}
    shots = type(clip.shots)(0, clip.shots.image_size, clip.shots.pieces, clip.shots.loose, matches)
    wrong = moved({4: clip.labels[4]}, (200.0, 0.0))
    found = _without_contradicted(type(clip)(clip.how, shots, clip.labels | wrong), {})
    assert set(found.labels) == set(range(COUNT)) - {4}


@pytest.mark.slow
def test_anchors_correct_what_most_labels_say():
    """Two thirds of the labels are wrong in the same way; frames that are known tell the cameras of all by matches."""
    clip = clip_of(CAMERAS)
    wrong = moved({t: clip.labels[t] for t in range(4, COUNT)}, (60.0, -50.0))
    held = {t: clip.labels[t] for t in (5, 10)}
    found = _without_contradicted(type(clip)(clip.how, clip.shots, clip.labels | wrong), held)
    assert set(found.labels) == {0, 1, 2, 3, 5, 10}


# --- frames that nothing else ties ---


def lost(tied):
    """A frame of one piece as if nothing tied frames 20 to 28, and a new piece began with the next one."""
    if 20 <= tied.index < 29:
        return replace(tied, key=19, ties=())
    if tied.index == 29:
        return replace(tied, key=29, ties=(), piece=1)
    return replace(tied, piece=int(tied.index > 29))


def test_a_pan_too_fast_to_follow_is_linked():
    images = shot(40, pan=0.6, zoom=1.0)
    found = [tied for _, tied in linked_frames((image, lost(tied)) for image, tied in tied_frames(images))]
    assert [tied.index for tied in found] == list(range(40))
    assert [tied.index for tied in found if not tied.ties] == [0]
    assert {tied.piece for tied in found} == {0}
    assert [tied.ties[0][0] for tied in found[20:30]] == list(range(19, 29))


@pytest.mark.slow
@pytest.mark.parametrize("length", [12, 0])
def test_cuts_and_dissolves_are_not_linked(length):
    images = dissolved(shot(30), shot(25, seed=1), length) if length else [*shot(30), *shot(25, seed=1)]
    before = [tied for _, tied in tied_frames(images)]
    found = [tied for _, tied in linked_frames(tied_frames(images))]
    assert [tied.piece for tied in found] == [tied.piece for tied in before]
    assert max(tied.piece for tied in found) == 1
    first = next(tied.index for tied in found if tied.piece == 1)
    assert not found[first].ties
    assert not found[first - 1].ties or not length


# --- the next frame ---


def rows(words):
    """Rows of frames that are good, to check, rejected, or mended."""
    of = {"g": ("good", 0.1), "c": ("check", 0.5), "r": ("reject", 0.9), "m": ("check", 0.5)}
    return [Row(of[word][0], concern=of[word][1], by_hand=word == "m") for word in words]


@pytest.mark.parametrize(
    ("words", "number"),
    [("ggg", None), ("gccgg", 2), ("cccggrrr", 6), ("rrrrrrrrrrrrrm", 4), ("mgg", None), ("rmr", 2)],
)
def test_the_next_frame_is_in_the_worst_stretch(words, number):
    frames = Arrays([np.zeros((4, 4, 3), np.uint8)] * len(words))
    assert next_frame(frames, rows(words), FIELD, None) == number


def test_the_next_frame_shows_most_markings(monkeypatch):
    frames = Arrays([np.full((4, 4, 3), k == 3, np.uint8) for k in range(9)])
    monkeypatch.setattr(
        "fieldcalib.editor.clip.network_marks",
        lambda field, image, network: type("Marks", (), {"pixels": ["line"] * int(image[0, 0, 0])}),
    )
    assert next_frame(frames, rows(9 * "r"), FIELD, object()) == 3


# --- courts, which no network knows ---


@pytest.mark.slow
def test_a_clip_of_a_court_is_solved_around_a_frame(tmp_path):
    """From the labels of one frame, matches, and the courts that are found by search."""
    count, size = 14, (960, 540)
    cameras = [Camera.from_angles(1.5 + 0.002 * k, 1.3, 0.0, 1400.0, (-32.0, 1.0, -9.0), size) for k in range(count)]
    writer = cv2.VideoWriter(str(tmp_path / "court.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, size)
    for camera in cameras:
        writer.write(render_field(camera, tennis(), rng=np.random.default_rng(0)))
    writer.release()
    with Editor(tmp_path / "court.avi", "tennis", out=tmp_path / "out") as editor:
        for label, segment in tennis().items():
            xy = cameras[7].project(segment.sample(0.5))
            xy = xy[np.all((xy > 8.0) & (xy < np.subtract(size, 8.0)), axis=1)]
            if segment.is_straight and len(xy) > 1 and not np.any(segment.sample()[:, 2]):
                editor[7] = editor[7].mark(label, xy[[0, -1]])
        found = editor.solve()
        assert found.anchors == {7}
        assert editor.keep(found) == count
        X = np.array([(x, y, 0.0) for x in (-11.885, 11.885) for y in (-4.115, 4.115)])
        off = [
            np.linalg.norm(found.calibrations[k].camera.project(X) - cameras[k].project(X), axis=1)
            for k in range(count)
        ]
        assert np.max(off) < 3.0
