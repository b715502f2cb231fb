"""Clips solved around frames that are known for sure: motion links frames, and wrong labels are left out."""

import cv2
import numpy as np
import pytest
from test_clip_models import FIELD, clip_of
from test_keyframes import dissolved, shot
from tripods import panned

from fieldcalib.editor.next_frame import next_frame
from fieldcalib.editor.table import Row
from fieldcalib.images.anchored_clip import Anchors, _without_contradicted, solve_around
from fieldcalib.images.clip_keyframes import KeyframeLabels
from fieldcalib.images.keyframes import tied_frames
from fieldcalib.images.linked_frames import linked_frames
from fieldcalib.problem.pixel_table import PixelTable
from fieldcalib.run_folder.numbered_frames import NumberedArrays as Arrays

COUNT = 12
CAMERAS = panned(COUNT)


def moved(labels, off):
    return {t: KeyframeLabels(PixelTable.of(FIELD, [shifted(one, off)])) for t, one in labels.items()}


def shifted(one, off):
    return {label: xy + off for label, xy in one.labels.by_label(0).items()}


@pytest.mark.parametrize("anchors", [(), (5,), (0, 11)])
def test_spoiled_labels_are_left_out(anchors):
    """A third of the keyframes is moved by 40 px: they contradict the others, matches and the tripod."""
    clip = clip_of(CAMERAS)
    spoiled = (2, 6, 7, 10)
    wrong = moved({t: clip.labels[t] for t in spoiled}, (30.0, 26.0))
    held = {t: clip.labels[t] for t in anchors}
    found = _without_contradicted(type(clip)(clip.options, clip.shots, clip.labels | wrong), held)
    assert set(found.labels) == set(range(COUNT)) - set(spoiled)


def test_labels_of_frames_that_nothing_ties_are_contradicted_by_those_around():
    clip = clip_of(CAMERAS)
    matches = {pair: cells for pair, cells in clip.shots.matches.items() if 4 not in pair}
    shots = type(clip.shots)(0, clip.shots.image_size, clip.shots.pieces, clip.shots.loose, matches)
    wrong = moved({4: clip.labels[4]}, (200.0, 0.0))
    found = _without_contradicted(type(clip)(clip.options, shots, clip.labels | wrong), {})
    assert set(found.labels) == set(range(COUNT)) - {4}


def test_an_anchor_corrects_what_all_labels_say():
    """Most labels are wrong in the same way; the frame that is known tells the cameras of all by matches."""
    clip = clip_of(CAMERAS)
    wrong = moved({t: clip.labels[t] for t in range(4, COUNT)}, (40.0, 0.0))
    spoiled = type(clip)(clip.options, clip.shots, clip.labels | wrong)
    images = [np.zeros((540, 960, 3), np.uint8)] * COUNT  # no line is found anywhere
    labels = _without_contradicted(spoiled, {5: clip.labels[5], 10: clip.labels[10]}).labels
    assert set(labels) == {0, 1, 2, 3, 5, 10}
    video = solve_around(spoiled, Anchors({5: clip.labels[5], 10: clip.labels[10]}), lambda: images, None)
    assert len(video) == COUNT


# --- frames that nothing else ties ---


def linked(images):
    return [tied for _, tied in linked_frames(tied_frames(images))]


def blurred(images, widths, first=18):
    """Frames from `first` on blurred across so many pixels."""
    return [
        cv2.blur(image, (widths[k - first], 1)) if 0 <= k - first < len(widths) else image
        for k, image in enumerate(images)
    ]


def test_a_pan_too_fast_to_follow_is_linked():
    """Its frames match their neighbours, and hardly any keyframe."""
    images = blurred(shot(50, pan=0.6, zoom=1.0), [1, 1, 5, 9, 15, 21, 27, 27, 21, 15, 9, 5])
    before, after = [tied for _, tied in tied_frames(images)], linked(images)
    assert sum(not tied.ties for tied in before) > 1
    assert [tied.index for tied in after] == list(range(50))
    assert [tied.index for tied in after if not tied.ties] == [0]
    assert {tied.piece for tied in after} == {0}


@pytest.mark.parametrize("length", [0, 12])
def test_cuts_and_dissolves_are_not_linked(length):
    images = dissolved(shot(50), shot(45, seed=1), length) if length else [*shot(50), *shot(45, seed=1)]
    found = linked(images)
    assert [tied.index for tied in found] == list(range(len(images)))
    assert found[10].piece == 0
    assert found[-1].piece == 1
    before = [tied for _, tied in tied_frames(images)]
    assert [tied.piece for tied in found] == [tied.piece for tied in before]
    assert [len(tied.ties) for tied in found] == [len(tied.ties) for tied in before]


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
        "fieldcalib.editor.next_frame.network_marks",
        lambda field, image, network: type("Marks", (), {"pixels": ["line"] * int(image[0, 0, 0])}),
    )
    assert next_frame(frames, rows(9 * "r"), FIELD, object()) == 3
