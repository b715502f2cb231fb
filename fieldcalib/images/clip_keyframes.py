"""The first pass over a part of a video: its shots, what ties their frames, and the labels in keyframes."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fieldcalib._types import BoolArray
from fieldcalib.assess.sequence_calibration import SequenceCalibration
from fieldcalib.images.clip_models import window_prior
from fieldcalib.images.clip_problem import Cells, ClipOptions, ClipProblem, cells_of
from fieldcalib.images.keyframe_labels import KeyframeLabels, label_keyframes, with_witnesses, witnesses_of
from fieldcalib.images.keyframes import TiedFrame
from fieldcalib.images.pieces import CameraModel, Pieces, loose_at_end, numbered
from fieldcalib.io.image import Image, size_of
from fieldcalib.io.images import IMAGES_AT_ONCE
from fieldcalib.localize import Network
from fieldcalib.problem.pixel_table import PixelTable
from fieldcalib.solve.sequence_solver import calibrate_one_by_one, solve_sequence

EXTRA_OFFSETS = (4, 8)  # frames after a keyframe that the network sees too until a keyframe of the piece is accepted
MOST_EXTRA = 6  # such frames of a piece: most pieces without a camera show no field


@dataclass(frozen=True, eq=False)
class Shots:
    """The pieces of a part of a video, and the matches between their frames."""

    begin: int
    """Number of the first frame in the video; in this part frames are numbered from 0."""
    image_size: tuple[int, int]
    pieces: Pieces
    loose: BoolArray
    """Whether each frame is untied, and at the end of its shot, (T,); such frames make pieces of their own."""
    matches: Mapping[tuple[int, int], Cells]
    """Matches by the numbers of the keyframe and of the other frame."""


@dataclass(frozen=True, eq=False)
class Keyframes:
    """Shots, with the labels that a network found in their keyframes, and in some other frames."""

    options: ClipOptions
    shots: Shots
    labels: Mapping[int, KeyframeLabels]

    @property
    def accepted(self) -> dict[int, PixelTable]:
        """Labels of keyframes whose camera was accepted."""
        return {t: one.labels for t, one in self.labels.items() if one.accepted}

    @property
    def doubtful(self) -> dict[int, PixelTable]:
        """Labels of keyframes whose camera was not accepted."""
        return {t: one.labels for t, one in self.labels.items() if not one.accepted}

    def calibrate(
        self,
        pieces: Pieces,
        members: Sequence[int],
        labels: Mapping[int, PixelTable],
        start: SequenceCalibration | None = None,
        left_out: Collection[tuple[int, int]] = (),
    ) -> SequenceCalibration:
        """Calibrate all frames of some pieces, from the lines in some frames and from matches that are not left out.

        The labels of keyframes are witnesses for or against their cameras.
        """
        options, size = self.options, self.shots.image_size
        frames, models = pieces.frames(members).tolist(), pieces.models_of(members)
        if CameraModel.WINDOW in models:
            prior = window_prior(options.prior, options.object_segments, size)
            options = replace(options.not_sharing("principal point"), prior=prior)
        elif models == {CameraModel.MOVING}:
            options = options.not_sharing("centre")
        matches = {pair: cells for pair, cells in self.shots.matches.items() if pair not in left_out}
        problem = ClipProblem(options, size, frames, labels, matches).from_zero
        if models == {CameraModel.ALONE}:
            calibration = calibrate_one_by_one(problem)
        else:
            calibration = solve_sequence(problem, start).calibration
        witnesses = witnesses_of(self.labels, frames, calibration)
        return with_witnesses(options.object_segments, calibration, witnesses)


def read_keyframes(frames: Iterable[tuple[Image, TiedFrame]], options: ClipOptions, network: Network) -> Keyframes:
    """Read the frames of a part of a video once; the network sees keyframes, and some others of unsure pieces.

    Frames are numbered from the first one; matches with frames before it are left out.
    """
    begin, size = 0, (0, 0)
    piece: list[int] = []
    linked: list[bool] = []
    matches: dict[tuple[int, int], Cells] = {}
    labels: dict[int, KeyframeLabels] = {}
    waiting: dict[int, Image] = {}  # frames that the network is to see
    extra: dict[int, int] = {}  # frames between keyframes that the network may still see, by piece

    def look() -> None:
        found = label_keyframes(options, list(waiting.values()), network)
        labels.update({t: one for t, one in zip(waiting, found, strict=True) if one is not None})
        waiting.clear()

    for t, (image, tied) in enumerate(frames):
        if t == 0:
            begin, size = tied.index, size_of(image)
        piece.append(tied.piece)
        linked.append(tied.is_key or bool(tied.ties))
        ties = {
            (key - begin, t): cells
            for key, found in tied.ties
            if key >= begin and (cells := cells_of(found, size)) is not None
        }
        matches |= ties
        unsure = not any(one.accepted and piece[key] == tied.piece for key, one in labels.items())
        is_extra = unsure and extra.get(tied.piece, 0) > 0 and tied.index - tied.key in EXTRA_OFFSETS
        if tied.is_key or not ties or is_extra:  # an untied frame can only be calibrated from its own labels
            waiting[t] = image
            extra[tied.piece] = extra.get(tied.piece, MOST_EXTRA) - is_extra
            if len(waiting) == IMAGES_AT_ONCE or unsure:
                look()
    look()
    loose = loose_at_end(piece, linked)
    pieces = Pieces(np.array(numbered(piece, loose), dtype=np.intp))
    return Keyframes(options, Shots(begin, size, pieces, np.array(loose, dtype=bool), matches), labels)
