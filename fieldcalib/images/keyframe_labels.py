"""The labels that a network finds in keyframes, each calibrated by itself first."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fieldcalib._types import Array
from fieldcalib.assess.label_errors import rms_by_label
from fieldcalib.assess.misfit import LEAST_FRAMES, misfit
from fieldcalib.assess.sequence_calibration import SequenceCalibration
from fieldcalib.fields.segments import ObjectSegments
from fieldcalib.images.clip_problem import ClipOptions
from fieldcalib.images.detected_lines import line_loss
from fieldcalib.io.image import Image
from fieldcalib.localize import Network
from fieldcalib.problem.evaluation import Evaluation, Problem, evaluate
from fieldcalib.problem.layout import Layout
from fieldcalib.problem.observations import Observations
from fieldcalib.problem.pixel_table import PixelTable
from fieldcalib.solve.options import pixel_unit

EXPLAINED = 6.0  # px of 960 x 540: right cameras of nine clips have every label of their keyframes within 3 px
LEAST_CONSISTENT = 4  # labels: some camera explains any fewer, wherever they lie
LEAST_WITHOUT_WORST = 6  # labels from which on the worst of a keyframe is left out: a board may pass for a touchline


@dataclass(frozen=True, eq=False)
class KeyframeLabels:
    """Labels of a keyframe, to which a camera was fitted."""

    labels: PixelTable
    accepted: bool = True
    """Whether that camera was accepted; if not, the labels are doubtful."""
    consistent: bool = True
    """Whether that camera explains enough of the labels."""


def label_keyframes(options: ClipOptions, images: Sequence[Image], network: Network) -> list[KeyframeLabels | None]:
    """Calibrate keyframes as single images; return the labels, None where no camera could be fitted."""
    return [
        None
        if one.solved is None
        else KeyframeLabels(
            one.solved.pixels, one.accepted, one.accepted or are_consistent(one.solved.alone.evaluation)
        )
        for one in options.calibrate_alone(images, network)
    ]


def are_consistent(evaluation: Evaluation) -> bool:
    """Whether the camera of one frame explains at least four of its labels, and at least half of them.

    Otherwise the labels contradict one another, as in narrow pictures without corners.
    """
    (by_label,) = rms_by_label(evaluation)
    by_label = by_label[np.isfinite(by_label)]
    explained = int(np.count_nonzero(by_label < EXPLAINED * pixel_unit(evaluation.problem.layout.image_size)))
    return explained >= max(LEAST_CONSISTENT, 0.5 * len(by_label))


def witnesses_of(
    keyframes: Mapping[int, KeyframeLabels], frames: Sequence[int], calibration: SequenceCalibration
) -> dict[int, KeyframeLabels]:
    """The labels of keyframes that have a camera among some frames, which are numbered from 0.

    Labels that contradict one another are left out where enough keyframes were accepted by themselves.
    """
    found = {k: keyframes[t] for k, t in enumerate(frames) if t in keyframes}
    enough = sum(one.accepted for one in found.values()) >= LEAST_FRAMES
    usable = calibration.usable
    return {
        k: one
        for k, one in found.items()
        if usable[k] and one.labels.has_pixels.any() and (one.accepted or one.consistent or not enough)
    }


def with_witnesses(
    object_segments: ObjectSegments, calibration: SequenceCalibration, witnesses: Mapping[int, KeyframeLabels]
) -> SequenceCalibration:
    """A calibration with the misfit of the labels of keyframes where that is larger than its own.

    Frames in between are interpolated. The misfit of a keyframe counts up to the larger one of the keyframes before and
    after it. Labels of keyframes that were accepted by themselves agree with one another, and their misfit is that
    of `fieldcalib.assess.misfit`. Of the others a camera must explain half; if it explains fewer, the misfit is the
    median distance of the labels.
    """
    if not witnesses or calibration.layout is None:
        return calibration
    frames = np.array(sorted(witnesses), dtype=np.intp)
    segments = object_segments if calibration.field is None else calibration.field
    keyframes = [witnesses[t] for t in frames.tolist()]
    excess = _excess(segments, keyframes, calibration.layout, calibration.frames.theta[frames])
    between = np.interp(np.arange(len(calibration)), frames, _confirmed(excess))
    has_camera = np.isfinite(calibration.frames.theta).all(axis=1)
    found = np.where(has_camera, np.fmax(calibration.frames.misfit, between), np.nan)
    return replace(calibration, frames=replace(calibration.frames, misfit=found))


def _excess(
    object_segments: ObjectSegments, keyframes: Sequence[KeyframeLabels], layout: Layout, theta: Array
) -> Array:
    """Misfit (B,) in pixels of the labels of keyframes to cameras theta (B, n)."""
    pixels = PixelTable.joined(object_segments, [one.labels for one in keyframes])
    observations = Observations.of(object_segments, pixels, layout.image_size)
    all_labels = evaluate(Problem(observations, layout, line_loss(layout.image_size)), theta)
    rms, table = rms_by_label(all_labels), observations.pixels
    worst = np.where(np.sum(np.isfinite(rms), axis=1) >= LEAST_WITHOUT_WORST, np.nanargmax(rms, axis=1), -1)
    others = observations.relabelled(np.where(table.label == worst[table.frame], -1, table.label))
    evaluation = evaluate(replace(all_labels.problem, observations=others), theta)
    rms = rms_by_label(evaluation)
    labelled = np.isfinite(rms)
    explained = np.sum(labelled & (rms < EXPLAINED * pixel_unit(layout.image_size)), axis=1)
    off = np.where(explained < 0.5 * np.sum(labelled, axis=1), np.nanmedian(rms, axis=1), 0.0)
    return np.where([one.accepted for one in keyframes], misfit(evaluation).excess, off)


def _confirmed(excess: Array) -> Array:
    """Each misfit, up to the larger one of its neighbours: in one keyframe of forty, labels lie beside the paint."""
    if len(excess) < 2:
        return np.zeros_like(excess)
    before, after = np.concatenate([[0.0], excess[:-1]]), np.concatenate([excess[1:], [0.0]])
    return np.asarray(np.minimum(excess, np.maximum(before, after)))
