"""What a run of frames of a clip shares, where one place of a tripod does not explain what is seen in its keyframes.

    one place -> does it bring the lines of many keyframes off? -> a window that moves over the picture of one place,
                                                                   parts with a place of their own, a camera that moves,
                                                                   frames one by one

Each of them is solved without some of the labels and matches, and predicts these. The one that predicts best wins, the
first one unless another is clearly better. A clip that is narrower than a broadcast was cut out of one, and windows
that are cut out often follow the play: there the window is tried in any case.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby
from typing import NamedTuple

import numpy as np

from fieldcalib._types import Array, BoolArray, IntArray
from fieldcalib.assess.misfit import rms_by_label
from fieldcalib.assess.sequence_calibration import SequenceCalibration
from fieldcalib.fields.field import Field
from fieldcalib.fields.segments import ObjectSegments
from fieldcalib.images.frames_together import Cells
from fieldcalib.problem.background import BackgroundEvaluation
from fieldcalib.problem.evaluation import evaluate_camera
from fieldcalib.problem.prior import is_whole_shape
from fieldcalib.solve.options import Prior, checked_prior, pixel_unit
from fieldcalib.solve.ties import Ties
from fieldcalib.solve.tripod import Labels

LEAST_LABELS = 4  # in a keyframe of which one is left out
LEAST_PIXELS = 3  # of a label that is left out
NEAR = 2.0  # px of 960 x 540: labels that are predicted to that are predicted well
LOST = 960.0  # px of these: as far off a frame without a camera has its labels
CLEARLY = 0.8  # share of the mean logarithm of the misprediction, below which a model is better than another one,
LEAST_GAIN = 0.02  # if that is also so much less: 0.3 px of 960 x 540 from none, as far as matches err anyway
MOST_KEPT = 2  # matches of a keyframe with earlier ones, of which the farthest is left out
WINDOW_SHARE = 0.15  # of the width: principal point in a window cut out of a broadcast and shown as large as that
LEAST_RUN = 2  # keyframes in a row that make a part
NOT_LEVEL = 0.15  # m: a crown that a user is told of; lines of level fields are off by a tenth of that


class Model(NamedTuple):
    """What the frames of a clip share."""

    piece: list[int]
    """Number of the piece of each frame."""
    moving: frozenset[int] = frozenset()
    """Pieces whose camera moves,"""
    windows: frozenset[int] = frozenset()
    """those that are a window which moves,"""
    alone: frozenset[int] = frozenset()
    """and those whose frames share nothing."""


Said = Callable[[IntArray, "Misprediction", "Misprediction"], str]
"""What a user is told of frames, from the mispredictions at one place of the camera and by another model."""


class Misprediction(NamedTuple):
    """How far what was left out lies from where it is predicted, pixels of 960 x 540.

    Examples
    --------
    >>> near, far = (Misprediction(np.full(9, d), np.full(9, d)) for d in (0.5, 1.0))
    >>> near.is_better(far), far.is_better(near), near.of_labels.is_better(near.of_matches)
    (True, False, False)
    """

    labels: Array
    """Of each label."""
    matches: Array
    """Of each pair of frames, the median."""

    @property
    def score(self) -> float:
        """Mean ``log(1 + (d / NEAR)^2)`` of distances d; infinite without any."""
        distances = np.concatenate(self)
        return float(np.mean(np.log1p(np.square(distances / NEAR)))) if len(distances) else np.inf

    @property
    def typical(self) -> float:
        """The distance that has this score."""
        return NEAR * float(np.sqrt(np.expm1(self.score)))

    @property
    def of_labels(self) -> Misprediction:
        """That of the labels alone."""
        return self._replace(matches=self.matches[:0])

    @property
    def of_matches(self) -> Misprediction:
        """That of the matches alone."""
        return self._replace(labels=self.labels[:0])

    def is_better(self, than: Misprediction) -> bool:
        """Whether it is clearly less than another one."""
        return self.score < min(CLEARLY * than.score, than.score - LEAST_GAIN)


@dataclass(frozen=True)
class LeftOut:
    """Labels and matches of keyframes without one of each, and those."""

    kept: Mapping[int, Labels]
    left: Mapping[int, tuple[str, Array]]
    pairs: Mapping[tuple[int, int], Cells] = field(default_factory=dict)
    """Matches that are left out."""

    @classmethod
    def of(cls, labels: Mapping[int, Labels], matches: Mapping[tuple[int, int], Cells] | None = None) -> LeftOut:
        """Leave one label out of each frame; which one changes from frame to frame.

        Of frames that are matched with several others, the match with the farthest one is left out too.

        Examples
        --------
        >>> xy, names = np.zeros((3, 2)), ("a", "b", "c", "d")
        >>> some = {t: ({name: xy for name in names}, {name: np.ones(3) for name in names}) for t in (0, 5)}
        >>> found = LeftOut.of(some)
        >>> [(t, label) for t, (label, _) in found.left.items()], sorted(found.kept[0][0])
        ([(0, 'a'), (5, 'b')], ['b', 'c', 'd'])
        """
        kept, left = dict(labels), {}
        for number, t in enumerate(sorted(labels)):
            pixels, weights = labels[t]
            names = sorted(label for label, xy in pixels.items() if len(xy) >= LEAST_PIXELS)
            if len(pixels) < LEAST_LABELS or not names:
                continue
            out = names[number % len(names)]
            left[t] = out, pixels[out]
            some, of_these = ({label: one[label] for label in one if label != out} for one in (pixels, weights))
            kept[t] = some, of_these
        by_frame = groupby(sorted(matches or {}, key=lambda pair: pair[::-1]), key=lambda pair: pair[1])
        ties = [list(pairs) for _, pairs in by_frame]
        return cls(kept, left, {pairs[0]: matches[pairs[0]] for pairs in ties if matches and len(pairs) >= MOST_KEPT})

    def misprediction(
        self, object_segments: ObjectSegments, found: Sequence[tuple[IntArray, SequenceCalibration]]
    ) -> Misprediction:
        """How far the labels and matches left out lie from where cameras have them.

        Parameters
        ----------
        found : sequence of (frames, calibration)
            Numbers of frames (T,), and their calibration without these labels. A frame without a camera is as bad as
            one that is a picture's width off.
        """
        labels: list[float] = []
        matches: list[float] = []
        for frames, calibration in found:
            segments = object_segments if calibration.field is None else calibration.field
            for k, t in enumerate(frames.tolist()):
                if t not in self.left:
                    continue
                label, xy = self.left[t]
                camera = calibration[k].camera if calibration.usable[k] else None
                off = LOST
                if camera is not None:
                    by_label = rms_by_label(evaluate_camera(camera, segments, {label: xy}))
                    off = min(float(np.nanmax(by_label)) / pixel_unit(camera.image_size), LOST)
                labels.append(off)
            matches += self._of_matches(object_segments, frames, calibration)
        return Misprediction(np.array(labels), np.array(matches))

    def _of_matches(
        self, object_segments: ObjectSegments, frames: IntArray, calibration: SequenceCalibration
    ) -> list[float]:
        """How far the matches left out lie off, the median of each pair of frames, pixels of 960 x 540."""
        number = {t: k for k, t in enumerate(frames.tolist())}
        inside = {(number[i], number[j]): one for (i, j), one in self.pairs.items() if i in number and j in number}
        usable = calibration.usable
        known = {pair: one for pair, one in inside.items() if usable[list(pair)].all()}
        lost = (len(inside) - len(known)) * [LOST]
        if not known or calibration.layout is None:
            return lost
        size = calibration.layout.image_size
        index = np.array(sorted({t for pair in known for t in pair}))
        pairs = Ties.of(object_segments, known, len(frames), size).among(index)
        if pairs is None:
            return lost
        r = BackgroundEvaluation(pairs, calibration.layout, calibration.frames.theta[index]).r
        off = np.where(pairs.weight > 0.0, np.linalg.norm(r, axis=0), np.nan) / pixel_unit(size)
        return [*lost, *np.minimum(np.nanmedian(off, axis=1), LOST).tolist()]


def of_window(prior: Prior, object_segments: ObjectSegments, image_size: tuple[int, int]) -> Prior:
    """The prior of cameras that are seen through a window which moves: of a whole shape, it was cut out and enlarged.

    That of narrower pictures allows for what is cut off already (`fieldcalib.problem.prior`).

    Examples
    --------
    >>> from fieldcalib import soccer
    >>> of_window("main center", soccer(), (960, 540))[0].principal_point
    0.15
    """
    if prior is None or not is_whole_shape(image_size):
        return prior
    stands = checked_prior(prior, object_segments if isinstance(object_segments, Field) else None)
    return tuple(replace(one, principal_point=max(one.principal_point, WINDOW_SHARE)) for one in stands)


def parts(keyframes: IntArray, contradicted: BoolArray) -> list[int]:
    """First keyframes of all parts but the first one: runs of keyframes that are contradicted, and of the others.

    Shorter runs than `LEAST_RUN` belong to the part before.

    Examples
    --------
    >>> parts(np.array([0, 12, 24, 36, 48, 60]), np.array([True, True, False, False, True, False]))
    [24]
    """
    runs = np.split(np.arange(len(keyframes)), np.flatnonzero(np.diff(contradicted)) + 1)
    state, first = None, []
    for run in runs:
        if len(run) >= LEAST_RUN and bool(contradicted[run[0]]) is not state:
            if state is not None:
                first.append(int(keyframes[run[0]]))
            state = bool(contradicted[run[0]])
    return first


def said_of_parts(first: IntArray, before: Misprediction, after: Misprediction) -> str:
    """What a user is told of a run of frames that is divided before these keyframes."""
    where = ", ".join(map(str, first.tolist()))
    return (
        f"no one place of the camera explains the frames before and after {where}: each part has one of its own, "
        f"which predicts lines and matches that were left out better ({_gain(before, after)}). Several cameras "
        f"may take turns, or the ground may not be flat"
    )


def said_of_motion(frames: IntArray, before: Misprediction, after: Misprediction) -> str:
    """What a user is told of frames whose camera moves."""
    return (
        f"frames {frames[0]} to {frames[-1]}: the camera moves, which predicts lines and matches that were left out "
        f"better than a tripod ({_gain(before, after)}); --camera moving says so from the beginning"
    )


def said_of_window(frames: IntArray, before: Misprediction, after: Misprediction) -> str:
    """What a user is told of frames that are a window which moves."""
    return (
        f"frames {frames[0]} to {frames[-1]}: the picture is a window that moves over a larger one: each frame has a "
        f"principal point of its own, which predicts lines and matches that were left out better than one for all "
        f"({_gain(before, after)})"
    )


def said_of_frames_alone(frames: IntArray, before: Misprediction, after: Misprediction) -> str:
    """What a user is told of frames that are calibrated one by one."""
    return (
        f"frames {frames[0]} to {frames[-1]} are calibrated one by one, as with --independent: each by itself predicts "
        f"lines that were left out better than one place of the camera ({_gain(before.of_labels, after.of_labels)})"
    )


def said_of_misfit(frames: IntArray) -> str:
    """What a user is told of frames that nothing explains together."""
    return (
        f"frames {frames[0]} to {frames[-1]}: no place of the camera explains the lines of all of them; --independent "
        f"calibrates them one by one"
    )


def said_of_crown(tripods: Iterable[SequenceCalibration]) -> list[str]:
    """What a user is told of clips whose field is not level, if it is not."""
    crown = max((tripod.crown for tripod in tripods), default=0.0)
    if crown < NOT_LEVEL:
        return []
    return [
        f"the ground seems to be higher in the middle of the field than at its touchlines, by about {crown:.1f} m: "
        "cameras of a level field lie on its markings all the same, but places between them are known less well "
        "(probability_right_1m)"
    ]


def _gain(before: Misprediction, after: Misprediction) -> str:
    return f"typically to {after.typical:.1f} instead of {before.typical:.1f} px of a picture 960 wide"


def is_taken(said: Said, score: Misprediction, best: Misprediction, at_one_place: Misprediction) -> bool:
    """Whether the model of which that is said is taken instead of the best one so far, a simpler one.

    A principal point of its own absorbs what is wrong with the labels of a frame, so the matches must tell by
    themselves that a window moves. Matches say nothing of frames that share no place: points before and behind one
    another move differently.
    """
    if said is said_of_frames_alone:
        return score.of_labels.is_better(best.of_labels)
    tells = said is not said_of_window or score.of_matches.is_better(at_one_place.of_matches)
    return tells and score.is_better(best)
