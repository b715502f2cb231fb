"""Choice of a camera model for a run of frames, if one tripod does not explain the labels of its keyframes.

    a tripod -> do many keyframes contradict it?               -> a window that moves over the picture of a tripod,
                                                                  parts with a place of their own, a camera that moves,
                                                                  frames one by one

`CAMERA_MODELS` lists the models, with all that is special about each. Models are compared by cross-validation: each is
solved without some of the labels and matches (`HeldOut`), and must predict these (`Misprediction`). The tripod is kept
unless another model predicts clearly better. A clip that is narrower than a broadcast was cut out of one, and windows
that are cut out often follow the play; for such clips the window is tried in any case.

`Pieces` holds which frames of a clip belong together, and the camera model of each such piece.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import accumulate, groupby, pairwise
from typing import Literal, NamedTuple

import numpy as np

from fieldcalib._types import Array, BoolArray, IntArray
from fieldcalib.assess.findings import Finding, What
from fieldcalib.assess.label_errors import rms_by_label
from fieldcalib.assess.sequence_calibration import SequenceCalibration
from fieldcalib.fields.field import ObjectSegments
from fieldcalib.images.clip.clip_problem import Cells, between
from fieldcalib.problem.evaluation import evaluate_cameras
from fieldcalib.problem.frame_ties import BackgroundTerm
from fieldcalib.problem.labelled_pixels import PixelTable
from fieldcalib.solve.request import Task
from fieldcalib.solve.sequence.background_matches import Ties
from fieldcalib.solve.solver_options import CalibrationFlags, pixel_unit

LEAST_LABELS = 4  # labels that a keyframe must have for one of them to be left out
LEAST_PIXELS = 3  # pixels that a label must have to be left out
WELL_PREDICTED = 2.0  # px of 960 x 540: scale of the distances in a score
LOST = 960.0  # px of 960 x 540: distance that counts for labels and matches of a frame without a camera
CLEARLY = 0.8  # a model is better than another one if its score is below this share of the other's,
LEAST_GAIN = 0.02  # and smaller by at least that: the score of 0.3 px of 960 x 540, the accuracy of matches
WRONG = 20.0  # px of 960 x 540: labels and matches that are farther off under both of two models do not count
LEAST_TIES = 2  # matches with earlier keyframes that a keyframe must have for the farthest to be left out
LEAST_RUN = 2  # successive keyframes that make a part
NOT_LEVEL = 0.15  # m: least height of a possible crown that is reported


@dataclass(frozen=True)
class CameraModel:
    """Model of the camera of a piece: which parameters its frames share, and how the model is tried and reported."""

    name: str
    tripod: str = ""
    """Kind of tripod: pieces with the same kind may be of one tripod; if empty, a piece has a camera of its own."""
    not_shared: str = ""
    """Name of the parameter of a tripod that frames do not share, as in `calibrate_sequence`."""
    is_window: bool = False
    """Whether the picture is taken as a part of a larger one: its principal point may lie far from the middle."""
    is_alone: bool = False
    """Whether frames share nothing, and each is calibrated by itself."""
    divides: bool = False
    """Whether the piece is divided into parts, with a tripod each."""
    tried: Literal["", "if a tripod is wrong", "always"] = ""
    """When the model is compared with a tripod: always, or only if the tripod contradicts the labels; "" for never.

    No comparison is made if the tripod fits and the picture is no narrower than a broadcast.
    """
    shown_by_matches: bool = False
    """Whether matches alone must be predicted better too, as a principal point per frame absorbs errors of labels."""
    note: str = ""
    """Note to the user: a format string with the frames (`where`), the `first` frame of each part, and the `gain`."""

    @property
    def may_be_part(self) -> bool:
        """Whether the model takes frames as whole pictures, although they may be parts of larger ones."""
        return bool(self.tripod) and not self.is_window

    def is_tried(self, task: Task, *, is_wrong: bool) -> bool:
        """Whether the model is compared with a tripod for frames with this task; `is_wrong` if the tripod is."""
        fixed = task.given.camera_matrix is not None or task.chosen_flags & CalibrationFlags.CALIB_FIX_PRINCIPAL_POINT
        is_possible = not self.is_window or (task.prior is not None and not fixed)
        return is_possible and (self.tried == "always" or (is_wrong and bool(self.tried)))

    def judged(self, score: Misprediction) -> Misprediction:
        """Select the part of a misprediction by which the model is judged.

        For frames that share nothing only labels count: without a common centre, the motion of static points depends on
        their depth, so matches cannot be predicted.
        """
        return score._replace(matches=score.matches[:0]) if self.is_alone else score

    def is_preferred(self, score: Misprediction, best: Misprediction, of_tripod: Misprediction) -> bool:
        """Whether the model is taken instead of the best model so far, which is simpler."""
        shown = not self.shown_by_matches or score.of_matches.is_better(of_tripod.of_matches)
        return shown and self.judged(score).is_better(self.judged(best))

    def said(self, frames: IntArray, **found: float | str) -> str:
        """Format the note for the user on some frames; `found` are its other values."""
        first = ", ".join(map(str, frames.tolist()))
        return self.note.format(where=f"frames {frames[0]} to {frames[-1]}", first=first, **found)


TRIPOD = CameraModel("tripod", tripod="of whole pictures")
"""Frames share the place of the camera, its lens, and the size of the field."""
CUT_OUT = CameraModel(
    "cut out",
    tripod="of parts of pictures",  # these have another principal point
    is_window=True,
    note="{where}: the picture is a part of a larger one, or is shown in a part of the screen: its principal point is "
    "at ({x:.0f}, {y:.0f}), far from the middle",
)
"""A tripod with one principal point for all frames that may lie far from the middle: the picture is a fixed part of a
larger one, or is shown in a part of the screen."""
WINDOW = CameraModel(
    "window",
    tripod=TRIPOD.tripod,
    not_shared="principal point",
    is_window=True,
    tried="always",
    shown_by_matches=True,
    note="{where}: the picture is a window that moves over a larger one: each frame has a principal point of its own, "
    "which predicts lines and matches that were left out better than one for all ({gain})",
)
"""A tripod with a principal point for each frame: the picture is a window that moves over a larger one."""
PARTS = CameraModel(
    "parts",
    divides=True,
    tried="if a tripod is wrong",
    note="no one place of the camera explains the frames before and after {first}: each part has one of its own, which "
    "predicts lines and matches that were left out better ({gain}). Several cameras may take "
    "turns",
)
"""A tripod for each part of the piece; the note names the first frames of all parts but the first part."""
MOVING = CameraModel(
    "moving",
    not_shared="centre",
    tried="if a tripod is wrong",
    note="{where}: the camera moves: without a tripod, lines and matches that were kept out of the fit are predicted "
    'better ({gain}); next time give --camera moving (camera="moving")',
)
"""Frames share lens and size of the field; their centres lie on a smooth path."""
ALONE = CameraModel(
    "alone",
    is_alone=True,
    tried="if a tripod is wrong",
    note="{where} are calibrated one by one: each by itself predicts lines that were left out better than one place of "
    "the camera ({gain})",
)
"""Frames share nothing: each is calibrated by itself."""
CAMERA_MODELS = (TRIPOD, CUT_OUT, WINDOW, PARTS, MOVING, ALONE)  # the simplest one first


@dataclass(frozen=True, eq=False)
class Pieces:
    """Division of the frames of a clip into pieces: runs of frames that matches connect, or parts of such runs."""

    number: IntArray
    """Number of the piece of each frame, (T,), from 0 and ascending."""
    models: Mapping[int, CameraModel] = field(default_factory=dict)
    """Camera models by number of the piece; pieces without an entry have a tripod."""

    @property
    def numbers(self) -> list[int]:
        """The numbers of all pieces, ascending."""
        return sorted(set(self.number.tolist()))

    def frames(self, members: Sequence[int]) -> IntArray:
        """The frames of some pieces, in order."""
        return np.flatnonzero(np.isin(self.number, members))

    def models_of(self, members: Iterable[int]) -> set[CameraModel]:
        """The camera models of some pieces."""
        return {self.models.get(piece, TRIPOD) for piece in members}

    def model_of(self, members: Iterable[int]) -> CameraModel:
        """The camera model for some pieces together: their common one, or else the most complex one on a tripod."""
        found = self.models_of(members)
        on_tripod = [one for one in CAMERA_MODELS if one in found and (one.tripod or len(found) == 1)]
        return on_tripod[-1] if on_tripod else TRIPOD

    def with_model(self, piece: int, model: CameraModel) -> Pieces:
        """Change the camera model of one piece."""
        return replace(self, models={**self.models, piece: model})

    def divided(self, first: Sequence[int]) -> Pieces:
        """Divide pieces before each of the frames `first`."""
        return replace(self, number=self.number + np.searchsorted(first, np.arange(len(self.number)), "right"))

    def joined(self, piece: int) -> Pieces:
        """Join a piece to the one before it."""
        return replace(self, number=self.number - (self.number >= piece))


def loose_at_end(piece: Sequence[int], linked: Sequence[bool]) -> list[bool]:
    """Find the untied frames at the end of each piece, as in a dissolve or a pan too fast to follow.

    They may show the next camera already, so their labels are no evidence about the frames before.

    Parameters
    ----------
    piece : (T,) sequence of int
        Ascending.
    linked : (T,) sequence of bool
        Whether each frame is tied to its piece; the first frame of a piece always is.

    Examples
    --------
    >>> loose_at_end([0, 0, 0, 0, 3, 3], [True, False, True, False, True, True])
    [False, False, False, True, False, False]
    """
    last = {p: t for t, (p, is_linked) in enumerate(zip(piece, linked, strict=True)) if is_linked}
    return [t > last[p] for t, p in enumerate(piece)]


def numbered(piece: Sequence[int], loose: Sequence[bool]) -> list[int]:
    """Number pieces consecutively from 0, with runs of loose frames as pieces of their own.

    Examples
    --------
    >>> numbered([0, 0, 0, 0, 3, 3], [False, False, False, True, False, False])
    [0, 0, 0, 1, 2, 2]
    """
    both = list(zip(piece, loose, strict=True))
    return list(accumulate((one != other for one, other in pairwise(both)), initial=0))[: len(both)]


class Misprediction(NamedTuple):
    """Distances of labels and matches that were left out from where they are predicted, pixels of 960 x 540.

    Mispredictions by several models are in the same order; NaN where a model predicts nothing.

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
    """Root mean square distance of the pixels of each label."""
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
        """Distance which, if all distances were equal to it, would give this score."""
        return WELL_PREDICTED * float(np.sqrt(np.expm1(self.score)))

    @property
    def of_matches(self) -> Misprediction:
        """The misprediction of matches alone."""
        return self._replace(labels=self.labels[:0])

    def is_better(self, than: Misprediction) -> bool:
        """Whether this is clearly better than another one; labels and matches wrong under both do not count."""
        before, after = than.unless_wrong(self).score, self.unless_wrong(than).score
        return after < min(CLEARLY * before, before - LEAST_GAIN)

    def unless_wrong(self, other: Misprediction) -> Misprediction:
        """Leave out the labels and matches that are far off in another misprediction too."""
        return Misprediction(*(np.where(np.minimum(a, b) > WRONG, np.nan, a) for a, b in zip(self, other, strict=True)))


@dataclass(frozen=True)
class HeldOut:
    """Labels and matches of keyframes that are left out, to measure how well a camera model predicts them."""

    kept: Mapping[int, PixelTable]
    """Labels that are not left out, by frame."""
    left: Mapping[int, PixelTable]
    """Label that is left out, by frame."""
    pairs: Mapping[tuple[int, int], Cells] = field(default_factory=dict)
    """Matches that are left out, by pair of frames."""

    @classmethod
    def of(cls, labels: Mapping[int, PixelTable], matches: Mapping[tuple[int, int], Cells] | None = None) -> HeldOut:
        """Leave one label out of each frame, a different one from frame to frame.

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
        """Measure the distances of the labels and matches left out from where cameras predict them.

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
    """Divide keyframes into parts; returns the first keyframe of each part except the first part.

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


def misfit_note(frames: IntArray) -> str:
    """Note for the user on frames that no single place of the camera explains."""
    return (
        f"frames {frames[0]} to {frames[-1]}: no place of the camera explains the lines of all of them; they can be "
        f"calibrated one by one (clip=False, --independent)"
    )


def crown_notes(tripods: Iterable[SequenceCalibration]) -> list[str]:
    """Notes for the user on a clip whose field is not level."""
    members = list(tripods)
    estimated = [tripod.shared["crown"] for tripod in members if "crown" in tripod.shared]
    if estimated:
        return [str(Finding(What.RAISED, numbers=max(estimated)))]
    if max((tripod.crown for tripod in members), default=0.0) < NOT_LEVEL:
        return []
    return [
        "the ground may be higher in the middle of the field than at its touchlines, which these frames do not tell: "
        "places between markings are known less well (probability_right_1m); --crown gives its height if you know it"
    ]


def gain_note(model: CameraModel, frames: IntArray, before: Misprediction, after: Misprediction) -> str:
    """Note for the user on frames whose camera model is not a tripod, and how much better it predicts."""
    before, after = model.judged(before), model.judged(after)
    one, other = after.unless_wrong(before).typical, before.unless_wrong(after).typical
    return model.said(frames, gain=f"typically to {one:.1f} instead of {other:.1f} px of a picture 960 wide")
