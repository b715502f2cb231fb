"""Choice of a camera model for a run of frames, where one tripod does not explain the labels of its keyframes.

    a tripod -> do many keyframes contradict it?               -> a window that moves over the picture of a tripod,
                                                                  parts with a place of their own, a camera that moves,
                                                                  frames one by one

Each model (`fieldcalib.images.clip.clip_models.CameraModel`) is solved without some of the labels and matches, and
predicts these. The tripod is kept unless another model predicts clearly better. A clip that is narrower than a
broadcast was cut out of one, and windows that are cut out often follow the play: there the window is tried in any case.

Which frames of a clip belong together, and what the cameras of each such piece share.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from itertools import accumulate, groupby, pairwise
from typing import NamedTuple

import numpy as np

from fieldcalib._types import Array, BoolArray, IntArray
from fieldcalib.assess.label_errors import rms_by_label
from fieldcalib.assess.sequence_calibration import SequenceCalibration
from fieldcalib.fields.segments import ObjectSegments
from fieldcalib.images.clip.clip_problem import Cells, between
from fieldcalib.problem.background import BackgroundTerm
from fieldcalib.problem.evaluation import evaluate_cameras
from fieldcalib.problem.pixel_table import PixelTable
from fieldcalib.solve.sequence.background_matches import Ties
from fieldcalib.solve.solver_options import pixel_unit

LEAST_LABELS = 4  # that a keyframe must have for one of them to be left out
LEAST_PIXELS = 3  # of a label that is left out
WELL_PREDICTED = 2.0  # px of 960 x 540: scale of the distances in a score
LOST = 960.0  # px of 960 x 540: distance that counts for labels and matches of a frame without a camera
CLEARLY = 0.8  # a model is better than another one if its score is below this share of the other's,
LEAST_GAIN = 0.02  # and smaller by at least that: the score of 0.3 px of 960 x 540, the accuracy of matches
WRONG = (
    20.0  # px of 960 x 540: labels and matches that lie farther off under each of two models tell nothing about them
)
LEAST_TIES = 2  # matches with earlier keyframes that a keyframe must have for the farthest to be left out
LEAST_RUN = 2  # keyframes in a row that make a part
NOT_LEVEL = 0.15  # m: least height of a crown that is reported; level fields seem to have a tenth of it


class CameraModel(StrEnum):
    """Model of the camera: the parameters that the frames of a piece share."""

    TRIPOD = "tripod"
    """One place of the camera, its lens, and the size of the field."""
    WINDOW = "window"
    """A tripod, but a principal point for each frame: the picture is a window that moves over a larger one."""
    CUT_OUT = "cut out"
    """A tripod, with a principal point for all that may lie far from the middle: the picture is a fixed part of a
    larger one, or is shown in a part of the screen."""
    PARTS = "parts"
    """A tripod for each part of the piece, which is divided."""
    MOVING = "moving"
    """Lens and size of the field, and centres along a smooth path."""
    ALONE = "alone"
    """Nothing: each frame is calibrated by itself."""


@dataclass(frozen=True, eq=False)
class Pieces:
    """The frames of a clip by piece: runs of frames that matches connect, or parts of these."""

    number: IntArray
    """Number of the piece of each frame, (T,), from 0 and ascending."""
    models: Mapping[int, CameraModel] = field(default_factory=dict)
    """Camera models of pieces; pieces without one have a tripod."""

    @property
    def numbers(self) -> list[int]:
        """The numbers of all pieces, ascending."""
        return sorted(set(self.number.tolist()))

    def frames(self, members: Sequence[int]) -> IntArray:
        """The frames of some pieces, in order."""
        return np.flatnonzero(np.isin(self.number, members))

    def models_of(self, members: Iterable[int]) -> set[CameraModel]:
        """The camera models of some pieces."""
        return {self.models.get(piece, CameraModel.TRIPOD) for piece in members}

    def with_model(self, piece: int, model: CameraModel) -> Pieces:
        """The pieces, one of them with another camera model."""
        return replace(self, models={**self.models, piece: model})

    def divided(self, first: Sequence[int]) -> Pieces:
        """The pieces, divided before some frames."""
        return replace(self, number=self.number + np.searchsorted(first, np.arange(len(self.number)), "right"))

    def joined(self, piece: int) -> Pieces:
        """The pieces, one of them joined to the one before."""
        return replace(self, number=self.number - (self.number >= piece))


def loose_at_end(piece: Sequence[int], linked: Sequence[bool]) -> list[bool]:
    """Which frames are untied, as are all after them in their piece: in a dissolve or a pan too fast to follow.

    They may show the next camera, so labels in them say nothing of the frames before.

    Parameters
    ----------
    piece : (T,) sequence of int
        Ascending.
    linked : (T,) sequence of bool
        Whether something ties a frame to its piece; the first frame of a piece is tied to it.

    Examples
    --------
    >>> loose_at_end([0, 0, 0, 0, 3, 3], [True, False, True, False, True, True])
    [False, False, False, True, False, False]
    """
    last = {p: t for t, (p, is_linked) in enumerate(zip(piece, linked, strict=True)) if is_linked}
    return [t > last[p] for t, p in enumerate(piece)]


def numbered(piece: Sequence[int], loose: Sequence[bool]) -> list[int]:
    """Numbers of pieces from 0, with loose frames as pieces of their own.

    Examples
    --------
    >>> numbered([0, 0, 0, 0, 3, 3], [False, False, False, True, False, False])
    [0, 0, 0, 1, 2, 2]
    """
    both = list(zip(piece, loose, strict=True))
    return list(accumulate((one != other for one, other in pairwise(both)), initial=0))[: len(both)]


class Misprediction(NamedTuple):
    """Distances of labels and matches that were left out from where they are predicted, pixels of 960 x 540.

    Those of several models are in the same order; NaN where a model does not say.

    Examples
    --------
    >>> near, far = (Misprediction(np.full(9, d), np.full(9, d)) for d in (0.5, 1.0))
    >>> near.is_better(far), far.is_better(near)
    (True, False)
    >>> one_wrong = [Misprediction(np.append(one.labels, 700.0), one.matches) for one in (near, far)]
    >>> one_wrong[0].is_better(one_wrong[1])
    True
    """

    labels: Array
    """Root mean square distance of each label."""
    matches: Array
    """Median distance of the matches of each pair of frames."""

    @property
    def score(self) -> float:
        """Mean ``log(1 + (d / WELL_PREDICTED)^2)`` of distances d; infinite without any."""
        distances = np.concatenate(self)
        distances = distances[~np.isnan(distances)]
        return float(np.mean(np.log1p(np.square(distances / WELL_PREDICTED)))) if len(distances) else np.inf

    @property
    def typical(self) -> float:
        """The distance that has this score."""
        return WELL_PREDICTED * float(np.sqrt(np.expm1(self.score)))

    @property
    def of_labels(self) -> Misprediction:
        """The misprediction of labels alone."""
        return self._replace(matches=self.matches[:0])

    @property
    def of_matches(self) -> Misprediction:
        """The misprediction of matches alone."""
        return self._replace(labels=self.labels[:0])

    def is_better(self, than: Misprediction) -> bool:
        """Whether it is clearly better than another one; what is wrong under both does not count."""
        before, after = than.unless_wrong(self).score, self.unless_wrong(than).score
        return after < min(CLEARLY * before, before - LEAST_GAIN)

    def unless_wrong(self, other: Misprediction) -> Misprediction:
        """The misprediction without what is far off under another model too."""
        return Misprediction(*(np.where(np.minimum(a, b) > WRONG, np.nan, a) for a, b in zip(self, other, strict=True)))


@dataclass(frozen=True)
class HeldOut:
    """Labels and matches of keyframes that are left out, to see how well a camera model predicts them."""

    kept: Mapping[int, PixelTable]
    """The other labels, by frame."""
    left: Mapping[int, PixelTable]
    """One label of each frame."""
    pairs: Mapping[tuple[int, int], Cells] = field(default_factory=dict)
    """Matches that are left out."""

    @classmethod
    def of(cls, labels: Mapping[int, PixelTable], matches: Mapping[tuple[int, int], Cells] | None = None) -> HeldOut:
        """Leave one label out of each frame; which one changes from frame to frame.

        If a frame is matched with several others, the match with the farthest one is left out too.

        Examples
        --------
        >>> one = PixelTable.of("abcd", [{name: np.zeros((3, 2)) for name in "abcd"}])
        >>> found = HeldOut.of({0: one, 5: one})
        >>> [(t, *table.by_label(0)) for t, table in found.left.items()], list(found.kept[0].by_label(0))
        ([(0, 'a'), (5, 'b')], ['b', 'c', 'd'])
        """
        kept, left = dict(labels), dict[int, PixelTable]()
        for number, t in enumerate(sorted(labels)):
            table = labels[t]
            count = np.bincount(table.label, minlength=len(table.labels))
            many = sorted(np.flatnonzero(count >= LEAST_PIXELS).tolist(), key=lambda index: table.labels[index])
            if np.count_nonzero(count) < LEAST_LABELS or not many:
                continue
            is_left = table.label == many[number % len(many)]
            left[t], kept[t] = table.take(is_left), table.take(~is_left)
        by_frame = groupby(sorted(matches or {}, key=lambda pair: pair[::-1]), key=lambda pair: pair[1])
        ties = [list(pairs) for _, pairs in by_frame]
        return cls(kept, left, {pairs[0]: matches[pairs[0]] for pairs in ties if matches and len(pairs) >= LEAST_TIES})

    def misprediction(
        self, object_segments: ObjectSegments, found: Sequence[tuple[IntArray, SequenceCalibration]]
    ) -> Misprediction:
        """Distances of the labels and matches left out from where cameras predict them.

        Parameters
        ----------
        found : sequence of (frames, calibration)
            Numbers of frames (T,), and their calibration without these labels and matches. A frame without a camera
            counts as one that is off by the width of the picture.
        """
        labels = dict.fromkeys(self.left, np.nan)
        matches = dict.fromkeys(self.pairs, np.nan)
        for frames, calibration in found:
            segments = object_segments if calibration.field is None else calibration.field
            left = {k: t for k, t in enumerate(frames.tolist()) if t in self.left}
            labels |= dict.fromkeys(left.values(), LOST)
            usable = calibration.usable
            cameras = {k: camera for k in left if usable[k] and (camera := calibration[k].camera) is not None}
            if cameras and calibration.layout is not None:
                seen = PixelTable.joined(segments, [self.left[left[k]] for k in cameras])
                rms = np.nanmax(rms_by_label(evaluate_cameras(list(cameras.values()), segments, seen)), axis=1)
                off = np.minimum(rms / pixel_unit(calibration.layout.image_size), LOST)
                labels |= zip((left[k] for k in cameras), off.tolist(), strict=True)
            matches |= self._of_matches(object_segments, frames, calibration)
        return Misprediction(np.array(list(labels.values())), np.array(list(matches.values())))

    def _of_matches(
        self, object_segments: ObjectSegments, frames: IntArray, calibration: SequenceCalibration
    ) -> dict[tuple[int, int], float]:
        """Median distance of the matches left out of each pair of these frames, pixels of 960 x 540."""
        inside = between(frames.tolist(), self.pairs)
        usable = calibration.usable
        known = {pair: one for pair, one in inside.items() if usable[list(pair)].all()}
        found = {(int(frames[i]), int(frames[j])): np.nan if (i, j) in known else LOST for i, j in inside}
        if not known or calibration.layout is None:
            return found
        size = calibration.layout.image_size
        index = np.array(sorted({t for pair in known for t in pair}))
        pairs = Ties.of(object_segments, known, len(frames), size).among(index)
        if pairs is None:
            return found
        r = BackgroundTerm(pairs, calibration.layout, calibration.frames.theta[index]).r
        off = np.where(pairs.weight > 0.0, np.linalg.norm(r, axis=0), np.nan) / pixel_unit(size)
        numbers = zip(frames[index[pairs.first]].tolist(), frames[index[pairs.second]].tolist(), strict=True)
        return found | dict(zip(numbers, np.minimum(np.nanmedian(off, axis=1), LOST).tolist(), strict=True))


def parts(keyframes: IntArray, contradicted: BoolArray) -> list[int]:
    """The first keyframe of each part but the first part.

    A part is a run of keyframes that all contradict their camera, or all do not. Shorter runs than `LEAST_RUN` belong
    to the part before.

    Examples
    --------
    >>> parts(np.array([0, 12, 24, 36, 48, 60]), np.array([True, True, False, False, True, False]))
    [24]
    """
    runs = np.split(np.arange(len(keyframes)), np.flatnonzero(np.diff(contradicted)) + 1)
    first = [int(run[0]) for run in runs if len(run) >= LEAST_RUN]
    return [int(keyframes[k]) for before, k in pairwise(first) if contradicted[k] != contradicted[before]]


def model_note(model: CameraModel, frames: IntArray, before: Misprediction, after: Misprediction) -> str:
    """Note for the user on frames with another camera model than a tripod, and by how much it predicts better.

    For `CameraModel.PARTS`, `frames` are the first frames of all parts but the first.
    """
    where = f"frames {frames[0]} to {frames[-1]}"
    if model is CameraModel.ALONE:
        return (
            f"{where} are calibrated one by one: each by itself predicts lines that were left "
            f"out better than one place of the camera ({_gain(before.of_labels, after.of_labels)})"
        )
    gain = _gain(before, after)
    if model is CameraModel.PARTS:
        first = ", ".join(map(str, frames.tolist()))
        return (
            f"no one place of the camera explains the frames before and after {first}: each part has one of its own, "
            f"which predicts lines and matches that were left out better ({gain}). Several cameras may take turns, or "
            f"the ground may not be flat"
        )
    if model is CameraModel.MOVING:
        return (
            f"{where}: the camera moves, which predicts lines and matches that were left out better than a tripod "
            f'({gain}); say so from the beginning (camera="moving", --camera moving)'
        )
    return (
        f"{where}: the picture is a window that moves over a larger one: each frame has a principal point of its own, "
        f"which predicts lines and matches that were left out better than one for all ({gain})"
    )


def misfit_note(frames: IntArray) -> str:
    """Note for the user on frames that no camera model explains."""
    return (
        f"frames {frames[0]} to {frames[-1]}: no place of the camera explains the lines of all of them; they can be "
        f"calibrated one by one (clip=False, --independent)"
    )


def crown_notes(tripods: Iterable[SequenceCalibration]) -> list[str]:
    """Notes for the user on a clip whose field is not level."""
    crown = max((tripod.crown for tripod in tripods), default=0.0)
    if crown < NOT_LEVEL:
        return []
    return [
        f"the ground seems to be higher in the middle of the field than at its touchlines, by about {crown:.1f} m: "
        "cameras of a level field lie on its markings all the same, but places between them are known less well "
        "(probability_right_1m)"
    ]


def _gain(before: Misprediction, after: Misprediction) -> str:
    one, other = after.unless_wrong(before).typical, before.unless_wrong(after).typical
    return f"typically to {one:.1f} instead of {other:.1f} px of a picture 960 wide"


def is_preferred(model: CameraModel, score: Misprediction, best: Misprediction, of_tripod: Misprediction) -> bool:
    """Whether a camera model is taken instead of the best one so far, which is simpler.

    A principal point for each frame absorbs errors of its labels, so matches alone must also predict that a window
    moves. Matches cannot judge frames that are calibrated one by one: without a common centre, points at different
    depths move differently.
    """
    if model is CameraModel.ALONE:
        return score.of_labels.is_better(best.of_labels)
    shown = model is not CameraModel.WINDOW or score.of_matches.is_better(of_tripod.of_matches)
    return shown and score.is_better(best)
