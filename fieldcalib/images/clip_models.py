"""What a run of frames of a clip shares, where one place of a tripod does not explain what is seen in its keyframes.

    one place -> does it bring the lines of many keyframes off? -> parts with a place of their own, a camera that moves

Each of them is solved without some of the labels and predicts these. The one that predicts best wins, the first one
unless another is clearly better.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fieldcalib._types import Array, BoolArray, IntArray
from fieldcalib.assess.misfit import rms_by_label
from fieldcalib.assess.sequence import SequenceCalibration
from fieldcalib.calibrate.options import pixel_unit
from fieldcalib.calibrate.tripod import Labels
from fieldcalib.fields.segments import ObjectSegments
from fieldcalib.problem.evaluation import evaluate_camera

LEAST_LABELS = 4  # in a keyframe of which one is left out
LEAST_PIXELS = 3  # of a label that is left out
NEAR = 2.0  # px of 960 x 540: labels that are predicted to that are predicted well
LOST = 960.0  # px of these: as far off a frame without a camera has its labels
CLEARLY = 0.8  # share of the mean logarithm of the misprediction, below which a model is better than another one
LEAST_RUN = 2  # keyframes in a row that make a part


@dataclass(frozen=True)
class LeftOut:
    """Labels of keyframes without one of each, and those."""

    kept: Mapping[int, Labels]
    left: Mapping[int, tuple[str, Array]]

    @classmethod
    def of(cls, labels: Mapping[int, Labels]) -> LeftOut:
        """Leave one label out of each frame; which one changes from frame to frame.

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
        return cls(kept, left)

    def misprediction(
        self, object_segments: ObjectSegments, found: Sequence[tuple[IntArray, SequenceCalibration]]
    ) -> float:
        """Mean ``log(1 + (d / NEAR)^2)`` of the labels left out, which lie d from where cameras have them.

        Parameters
        ----------
        found : sequence of (frames, calibration)
            Numbers of frames (T,), and their calibration without these labels. A frame without a camera is as bad as
            one that is a picture's width off.
        """
        scores = []
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
                scores.append(np.log1p(np.square(off / NEAR)))
        return float(np.mean(scores)) if scores else np.inf


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


def said_of_parts(first: Sequence[int], before: float, after: float) -> str:
    """What a user is told of a run of frames that is divided before these keyframes."""
    where = ", ".join(map(str, first))
    return (
        f"no one place of the camera explains the frames before and after {where}: each part has one of its own, "
        f"which predicts lines that were left out better ({_gain(before, after)}). The ground may not be flat, or the "
        f"picture a window that moves"
    )


def said_of_motion(frames: IntArray, before: float, after: float) -> str:
    """What a user is told of frames whose camera moves."""
    return (
        f"frames {frames[0]} to {frames[-1]}: the camera moves, which predicts lines that were left out better than a "
        f"tripod ({_gain(before, after)}); --camera moving says so from the beginning"
    )


def said_of_misfit(frames: IntArray) -> str:
    """What a user is told of frames that nothing explains together."""
    return (
        f"frames {frames[0]} to {frames[-1]}: no place of the camera explains the lines of all of them; --independent "
        f"calibrates them one by one"
    )


def _gain(before: float, after: float) -> str:
    def typical(score: float) -> float:
        return NEAR * float(np.sqrt(np.expm1(score)))

    return f"typically to {typical(after):.1f} instead of {typical(before):.1f} px of a picture 960 wide"
