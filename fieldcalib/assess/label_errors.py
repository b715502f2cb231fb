"""Root mean square distances of labelled pixels from their segments, in pixels."""

from __future__ import annotations

import numpy as np

from fieldcalib._types import Array
from fieldcalib.problem.evaluation import Evaluation


def rms_of_labels(evaluation: Evaluation) -> Array:
    """Root mean square distance of the labelled pixels of each frame, (B,); NaN where there are none."""
    squares, count = squares_by_label(evaluation)
    with np.errstate(invalid="ignore"):
        return np.asarray(np.sqrt(np.sum(squares, axis=1) / np.sum(count, axis=1)))


def rms_by_label(evaluation: Evaluation) -> Array:
    """Root mean square distance of the pixels of each label, (B, L)."""
    squares, count = squares_by_label(evaluation)
    with np.errstate(invalid="ignore"):
        return np.asarray(np.sqrt(squares / count))


def squares_by_label(evaluation: Evaluation) -> tuple[Array, Array]:
    """Sums of squared distances, and numbers of pixels, (B, L)."""
    observations = evaluation.problem.observations
    is_counted = (observations.label >= 0) & (observations.pixel_share > 0.0)  # no padding, no ends
    return observations.by_label(np.where(is_counted, np.square(evaluation.r), 0.0)), observations.pixels_by_label
