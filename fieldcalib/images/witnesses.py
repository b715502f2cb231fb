"""What a network saw in keyframes, held against the cameras that all frames have together.

Lines are searched near the markings that a camera projects, and found lines confirm it: a line that lies elsewhere is
not found, and contradicts nothing. The labels of the network were found without that camera. So they are its witnesses.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from fieldcalib._types import Array, IntArray
from fieldcalib.assess.misfit import misfit, rms_by_label
from fieldcalib.assess.sequence_calibration import SequenceCalibration
from fieldcalib.fields.segments import ObjectSegments
from fieldcalib.images.frame_lines import per_pixel
from fieldcalib.images.refinement import LOSS_SCALE
from fieldcalib.problem.evaluation import Evaluation, Problem, evaluate
from fieldcalib.problem.losses import RobustLoss
from fieldcalib.problem.observations import pack
from fieldcalib.solve.options import pixel_unit
from fieldcalib.solve.tripod import Labels

ENOUGH = (
    6  # labels in a keyframe, of which the worst does not count: a board is taken for the far touchline for a while
)
EXPLAINED = 6.0  # px of 960 x 540: right cameras of nine clips have every label of their keyframes within 3 px

LEAST_AGREEING = 4  # labels: fewer are explained by some camera wherever they lie


def agree(alone: Evaluation) -> bool:
    """Whether the camera of a keyframe by itself explains enough of its labels, and half of them, for a witness.

    Otherwise they contradict one another, as those of a narrow picture without corners often do, whatever the camera.
    """
    (by_label,) = rms_by_label(alone)
    by_label = by_label[np.isfinite(by_label)]
    explained = int(np.count_nonzero(by_label < EXPLAINED * pixel_unit(alone.problem.layout.image_size)))
    return explained >= max(LEAST_AGREEING, 0.5 * len(by_label))


def witnessed_misfit(
    object_segments: ObjectSegments,
    calibration: SequenceCalibration,
    seen: Mapping[int, Labels],
    doubtful: Mapping[int, Labels],
) -> tuple[IntArray, Array]:
    """The frames in which something was seen and that have a camera, and how far the cameras contradict it, pixels.

    What one keyframe says counts as far as the one before or after it says so too.

    Parameters
    ----------
    seen : mapping of int to Labels
        By frame, of keyframes that had a camera by themselves: their labels agree with one another, and count as those
        of `fieldcalib.assess.misfit`.
    doubtful : mapping of int to Labels
        Of others, some of whose labels contradict the others. A camera is contradicted by these where it explains fewer
        than half of them, by as much as their median lies off.
    """
    usable = set(np.flatnonzero(calibration.usable).tolist())
    found = {t: labels for t, labels in {**doubtful, **seen}.items() if t in usable and labels[0]}
    frames = np.array(sorted(found), dtype=np.intp)
    layout = calibration.layout
    if layout is None or not len(frames):
        return frames[:0], np.zeros(0)
    segments = object_segments if calibration.field is None else calibration.field
    unit = pixel_unit(layout.image_size)
    theta = calibration.frames.theta[frames]

    def at_cameras(labels: list[Labels]) -> Evaluation:
        pixels, weights = zip(*labels, strict=True)
        observations = pack(segments, pixels, layout.image_size, weights)
        return evaluate(Problem(observations, layout, RobustLoss("cauchy", LOSS_SCALE * unit)), theta)

    labels = [per_pixel(found[t]) for t in frames.tolist()]
    by_label = rms_by_label(at_cameras(labels))
    names = list(segments)
    spared = [
        _without(one, names[int(np.nanargmax(of_frame))]) if len(one[0]) >= ENOUGH else one
        for one, of_frame in zip(labels, by_label, strict=True)
    ]
    evaluation = at_cameras(spared)
    by_label = rms_by_label(evaluation)
    labelled = np.isfinite(by_label)
    explained = np.sum(labelled & (by_label < EXPLAINED * unit), axis=1)
    off = np.where(explained < 0.5 * np.sum(labelled, axis=1), np.nanmedian(by_label, axis=1), 0.0)
    excess = np.where([t in seen for t in frames.tolist()], misfit(evaluation).excess, off)
    return frames, _confirmed(excess)


def _without(labels: Labels, label: str) -> Labels:
    pixels, weights = ({name: one[name] for name in one if name != label} for one in labels)
    return pixels, weights


def _confirmed(excess: Array) -> Array:
    """No more than the larger one of the two beside each: in one keyframe of forty labels lie beside the paint."""
    if len(excess) < 2:
        return np.zeros_like(excess)
    before, after = np.concatenate([[0.0], excess[:-1]]), np.concatenate([excess[1:], [0.0]])
    return np.asarray(np.minimum(excess, np.maximum(before, after)))


def with_witnesses(calibration: SequenceCalibration, frames: IntArray, excess: Array) -> SequenceCalibration:
    """With the misfit of `witnessed_misfit` where it is larger; frames in between are between these."""
    if not len(frames):
        return calibration
    between = np.interp(np.arange(len(calibration)), frames, excess)
    has_camera = np.isfinite(calibration.frames.theta).all(axis=1)
    found = np.where(has_camera, np.fmax(calibration.frames.misfit, between), np.nan)
    return replace(calibration, frames=replace(calibration.frames, misfit=found))
