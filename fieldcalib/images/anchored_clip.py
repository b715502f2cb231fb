"""A clip solved again around frames whose lines are known for sure, as where a person has labelled them.

The stages are those of `fieldcalib.images.from_video`. What takes longest, matches and the labels of the network, does
not depend on the anchors: `Keyframes` of an earlier solution serve again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from dataclasses import field as attribute

import numpy as np

from fieldcalib.assess.video import VideoCalibration
from fieldcalib.images.clip_keyframes import KeyframeLabels, Keyframes
from fieldcalib.images.detected_lines import with_replaced
from fieldcalib.images.finished_clip import ClipLines, find_clip_lines, finish_clip
from fieldcalib.images.pieces import Pieces
from fieldcalib.images.solved_shots import solve_shots
from fieldcalib.images.solved_tripods import solve_tripods
from fieldcalib.io.image import Image
from fieldcalib.localize import Network
from fieldcalib.problem.pixel_table import NO_PIXELS, PixelTable

WEIGHT = 8.0  # of a segment in an anchor, beside 1 of one that a network found


@dataclass(frozen=True, eq=False)
class Anchors:
    """What is known of a clip."""

    labels: Mapping[int, PixelTable] = attribute(default_factory=dict)
    """Lines by frame."""
    cuts: Sequence[int] | None = None
    """First frames of the shots; None where matches tell them."""


def solve_around(
    keyframes: Keyframes, anchors: Anchors, images: Callable[[], Iterable[Image]], network: Network
) -> VideoCalibration:
    """Calibrate the frames of a part of a clip, given what is known of some.

    Parameters
    ----------
    keyframes : Keyframes
        Matches and labels of the part.
    anchors : Anchors
        Frames are numbered from the first one of the part.
    images : callable
        Gives the images of the part, from the first one on.
    network : Network
    """
    held = {t: replace(one, weight=WEIGHT * one.weight) for t, one in anchors.labels.items()}
    known = _with_labels(_with_cuts(keyframes, anchors.cuts), held)
    lines = find_clip_lines(solve_tripods(solve_shots(known)), images(), network)
    return finish_clip(_with_lines(lines, held))


def _with_labels(keyframes: Keyframes, held: Mapping[int, PixelTable]) -> Keyframes:
    """Keyframes with the labels of anchors in the place of those that the network found there."""
    return replace(keyframes, labels={**keyframes.labels, **{t: KeyframeLabels(one) for t, one in held.items()}})


def _with_cuts(keyframes: Keyframes, cuts: Sequence[int] | None) -> Keyframes:
    """Keyframes with other shots; matches across a cut are left out."""
    if cuts is None:
        return keyframes
    shots = keyframes.shots
    count = len(shots.pieces.number)
    number = np.searchsorted(sorted({cut for cut in cuts if 0 < cut < count}), np.arange(count), side="right")
    matches = {(i, j): cells for (i, j), cells in shots.matches.items() if number[i] == number[j]}
    return replace(
        keyframes,
        shots=replace(shots, pieces=Pieces(number), loose=np.zeros(count, dtype=bool), matches=matches),
    )


def _with_lines(lines: ClipLines, held: Mapping[int, PixelTable]) -> ClipLines:
    """Lines with those of anchors in the place of what was found at the same markings."""
    replaced = {t: with_replaced(lines.labels.get(t, NO_PIXELS), one) for t, one in held.items()}
    return replace(lines, labels={**lines.labels, **replaced})
