"""The labels that a network finds in keyframes, each calibrated by itself first."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fieldcalib.assess.label_errors import rms_by_label
from fieldcalib.images.clip_problem import ClipOptions
from fieldcalib.io.image import Image
from fieldcalib.localize import Network
from fieldcalib.problem.evaluation import Evaluation
from fieldcalib.problem.pixel_table import PixelTable
from fieldcalib.solve.options import pixel_unit

EXPLAINED = 6.0  # px of 960 x 540: right cameras of nine clips have every label of their keyframes within 3 px
LEAST_CONSISTENT = 4  # labels: some camera explains any fewer, wherever they lie


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
