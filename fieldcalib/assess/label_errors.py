"""Root mean square distances of labelled pixels from their segments, in pixels.

Errors of the model that frames share parameters: labels that fit a camera with a position of its own much better.

Both fits contain the noise of the labels, so their difference is the error of the model. If it is large, the model does
not hold: the camera moves, the picture is a moving window of a larger one, the ground is not flat, or the shared
parameters are in a wrong minimum.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fieldcalib._types import Array, BoolArray
from fieldcalib.problem.evaluation import Evaluation, evaluate
from fieldcalib.problem.layout import POSE_AND_ZOOM, Role
from fieldcalib.problem.levenberg_marquardt import levenberg_marquardt

# Share of the image's diagonal, 2.5 px of 960 x 540. On eight clips from a tripod, with labels of a network, 329 of 330
# keyframes have at most 2.2 px, most of them 0.5; if the tripod is 5 m off, most have 2.5 to 40 px.
LARGEST_EXCESS = 2.5 / 1101.0
LEAST_FRAMES = 5  # with fewer the model is not judged
LEAST_SHARE = 0.15  # of the frames: if as many are contradicted, the model does not hold
SOMEWHAT = 0.4  # of the largest excess: the median of keyframes of such clips is 0.6 px at most
ITERATIONS = 8  # of the fit of each frame by itself, from the common solution
TOLERANCE = 1e-3  # of its cost


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


@dataclass(frozen=True, eq=False)
class Misfit:
    """Root mean square distances, pixels, of the labels of B frames from two fits; NaN without labels."""

    together: Array
    """Distances (B,) from the cameras with shared parameters."""
    alone: Array
    """Distances (B,) from cameras with their own positions and zooms."""

    @property
    def excess(self) -> Array:
        """Distance due to the model, pixels, (B,)."""
        return np.asarray(np.sqrt(np.maximum(np.square(self.together) - np.square(self.alone), 0.0)))


def is_contradicted(excess: Array, image_size: tuple[int, int]) -> BoolArray:
    """Mask (B,) of the frames that the model does not explain, from `Misfit.excess`, pixels.

    Examples
    --------
    >>> is_contradicted(np.array([0.9, 3.0, np.nan]), (960, 540))
    array([False,  True, False])
    """
    with np.errstate(invalid="ignore"):
        return np.asarray(excess > LARGEST_EXCESS * np.hypot(*image_size))


def is_of_wrong_model(excess: Array, image_size: tuple[int, int]) -> bool:
    """Whether a model does not hold, from `Misfit.excess`, pixels.

    That is if it contradicts many frames, or more than half of them to a smaller extent; NaN does not count.

    Examples
    --------
    >>> is_of_wrong_model(np.array([0.5, 0.9, 0.4, 9.0, 8.0]), (960, 540))
    True
    """
    known = excess[np.isfinite(excess)]
    if len(known) < LEAST_FRAMES:
        return False
    many = np.count_nonzero(is_contradicted(known, image_size)) >= LEAST_SHARE * len(known)
    return bool(many or np.any(is_contradicted(np.array([np.median(known) / SOMEWHAT]), image_size)))


def misfit(evaluation: Evaluation) -> Misfit:
    """Misfit of frames at their common solution: each is fitted again by itself.

    Lens, principal point and size of the field are kept, so that they cannot compensate for a wrong position.
    """
    layout = evaluation.problem.layout
    roles = np.full(layout.size, Role.FIXED)
    roles[POSE_AND_ZOOM] = np.where(layout.roles[POSE_AND_ZOOM] != Role.FIXED, Role.FRAME, Role.FIXED)
    own = replace(layout, roles=roles)
    observations = evaluation.problem.observations.without_ends
    if layout.field_size is not None and np.any(layout.free[layout.field_size_block]):
        size = evaluation.theta[:, layout.field_size_block]
        observations = observations.moved(size - layout.field_size.given)
    nothing: dict[str, Any] = dict.fromkeys(("prior", "group", "considered", "background", "path"))
    problem = replace(evaluation.problem, observations=observations, layout=own, **nothing)
    start = evaluate(problem, evaluation.theta)
    alone = levenberg_marquardt(start, max_iterations=ITERATIONS, tolerance=TOLERANCE).evaluation
    return Misfit(rms_of_labels(evaluation), rms_of_labels(alone))
