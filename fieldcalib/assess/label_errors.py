"""Errors of labelled pixels: their root mean square distances from their segments, the misfit of a model, their noise.

The misfit is the error of the model that frames share parameters: labels that fit a camera with a position of its own
much better. Both fits contain the noise of the labels, so their difference is the error of the model. If it is large,
the model does not hold: the camera moves, the picture is a moving window of a larger one, the ground is not flat, or
the shared parameters are in a wrong minimum.

The noise has a size, relative to the weights of the pixels, and a share that is common to a segment.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache, cached_property
from typing import Any

import numpy as np

from fieldcalib._types import Array, BoolArray
from fieldcalib.problem.evaluation import Evaluation, evaluate
from fieldcalib.problem.layout import POSE_AND_ZOOM, Role
from fieldcalib.problem.levenberg_marquardt import levenberg_marquardt
from fieldcalib.problem.losses import RobustLoss

# Share of the image's diagonal, 2.5 px of 960 x 540. On eight clips from a tripod, with labels of a network, 329 of 330
# keyframes have at most 2.2 px, most of them 0.5; if the tripod is 5 m off, most have 2.5 to 40 px.
LARGEST_EXCESS = 2.5 / 1101.0
LEAST_FRAMES = 5  # with fewer the model is not judged
LEAST_SHARE = 0.15  # of the frames: if as many are contradicted, the model does not hold
SOMEWHAT = 0.4  # of the largest excess: the median of keyframes of such clips is 0.6 px at most
ITERATIONS = 8  # of the fit of each frame by itself, from the common solution
TOLERANCE = 1e-3  # of its cost
# Share of a pixel's variance that is common to its segment: annotators keep to one side of a line. With it, distances
# of segments left out of SoccerNet's and WC14's frames are as predicted in the median, and 91 % are in 95 % intervals
# (with 0, 88 %). 3 to 4 % have wrong labels.
SHARED_NOISE = 0.15
# Share of the image's width, 0.1 px of 960, by which a far line is off in all frames of a clip: root mean square of 15
# lines in filmed clips on which a pixel shows 0.3 m or more. For nearer lines the error of the paint is larger.
FOUND_BESIDE = 0.1 / 960.0
NODES, NOISE_STEPS = 21, 4  # nodes of the quadrature over the noise, steps of the search for its size


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


def excess(together: Array, alone: Array) -> Array:
    """Distance due to a model of B frames, pixels, (B,), from the distances of their labels with and without it."""
    return np.asarray(np.sqrt(np.maximum(np.square(together) - np.square(alone), 0.0)))


def is_contradicted(misfit: Array, image_size: tuple[int, int]) -> BoolArray:
    """Mask (B,) of the frames that the model does not explain, from their `misfit`, pixels.

    Examples
    --------
    >>> is_contradicted(np.array([0.9, 3.0, np.nan]), (960, 540))
    array([False,  True, False])
    """
    with np.errstate(invalid="ignore"):
        return np.asarray(misfit > LARGEST_EXCESS * np.hypot(*image_size))


def is_of_wrong_model(misfit: Array, image_size: tuple[int, int]) -> bool:
    """Whether a model does not hold, from the `misfit` of frames, pixels.

    That is if it contradicts many frames, or more than half of them to a smaller extent; NaN does not count.

    Examples
    --------
    >>> is_of_wrong_model(np.array([0.5, 0.9, 0.4, 9.0, 8.0]), (960, 540))
    True
    """
    known = misfit[np.isfinite(misfit)]
    if len(known) < LEAST_FRAMES:
        return False
    many = np.count_nonzero(is_contradicted(known, image_size)) >= LEAST_SHARE * len(known)
    return bool(many or np.any(is_contradicted(np.array([np.median(known) / SOMEWHAT]), image_size)))


def misfit(evaluation: Evaluation) -> Array:
    """Misfit (B,), pixels, of frames at their common solution: each is fitted again by itself. NaN without labels.

    Lens, principal point and size of the field are kept, so that they cannot compensate for a wrong position.
    """
    layout = evaluation.problem.layout
    roles = np.full(layout.size, Role.FIXED)
    roles[POSE_AND_ZOOM] = np.where(layout.roles[POSE_AND_ZOOM] != Role.FIXED, Role.FRAME, Role.FIXED)
    own = replace(layout, roles=roles)
    observations = evaluation.problem.observations.without_ends
    if layout.field_size is not None and layout.has_free_size:
        size = evaluation.theta[:, layout.field_size_block]
        observations = observations.moved(size - layout.field_size.given)
    nothing: dict[str, Any] = dict.fromkeys(("prior", "group", "considered", "background", "path"))
    problem = replace(evaluation.problem, observations=observations, layout=own, **nothing)
    start = evaluate(problem, evaluation.theta)
    alone = levenberg_marquardt(start, max_iterations=ITERATIONS, tolerance=TOLERANCE).evaluation
    return excess(rms_of_labels(evaluation), rms_of_labels(alone))


class Noise:
    """The noise of the pixels of B frames, relative to the noise of a pixel of weight 1."""

    def __init__(self, evaluation: Evaluation) -> None:
        self.evaluation = evaluation
        observations = evaluation.problem.observations
        label = observations.label
        sharing = np.where(observations.shares_noise, label, -1)  # points share none, and there may be very many
        self.lines = np.unique(sharing[sharing >= 0])  # their labels, by number
        self.segment = (sharing[..., None] == self.lines).astype(float)  # (B, M, L)
        self.shared = SHARED_NOISE * np.sum(self.segment, axis=-1)
        # a weight is one over a variance, divided among the N pixels of a segment
        count = observations.pixels_by_label[np.arange(len(label))[:, None], label]
        self.relative_sigma = 1.0 / np.sqrt(np.where(label >= 0, observations.weight * count, 1.0))

    @cached_property
    def gradient_factor(self) -> Array:
        """Factors (B, M) by which the gradient takes the noise of the residuals, in units of sigma."""
        return np.asarray(self.evaluation.irls_weight * self.relative_sigma)

    @cached_property
    def square(self) -> Array:
        """Squares of ``rho'`` in units of the pixels' own noise, (B, M): weight of a pixel in the estimate of the
        noise."""
        evaluation = self.evaluation
        slope = evaluation.problem.loss.evaluate(np.square(evaluation.r))[1]
        return np.asarray(np.square(slope / self.relative_sigma) * (evaluation.problem.observations.weight > 0.0))

    def covariance(self, JT: Array, left: Array | None = None) -> Array:
        """``J^T diag(left) C diag(g) J``, (B, P, P): C is the correlation of the noise, g the factor of the gradient.

        `left` (B, M) is g too by default: then it is the covariance of the gradient in units of sigma squared.
        """
        right = self.gradient_factor
        left = right if left is None else left
        left_sum, right_sum = ((JT * factor[:, None]) @ self.segment for factor in (left, right))
        own = gram(JT, left * right * (1.0 - self.shared))
        return np.asarray(own + SHARED_NOISE * left_sum @ np.swapaxes(right_sum, 1, 2))

    def of_paint(self, JT: Array, irls_weight: Array) -> Array:
        """``J^T W S W J`` (B, P, P), with S the covariance of the residuals due to misplaced lines."""
        summed = self.by_line(JT, irls_weight)
        return np.asarray(summed @ np.swapaxes(summed, 1, 2))

    def by_line(self, JT: Array, irls_weight: Array) -> Array:
        """``J^T W`` times the residuals of each line, (B, P, L), if it is misplaced by one standard deviation.

        It may be painted or detected off its position, equally in all frames. A line that is off by one metre changes
        its residuals by the length of ``n dxy_dX`` on the ground. The L lines are `lines`.
        """
        problem, paint = self.evaluation.problem, self.evaluation.problem.paint
        if paint == 0.0:
            return np.zeros((len(JT), JT.shape[1], len(self.lines)))
        by_metre = np.linalg.norm(self.evaluation.by_centre[:, :2], axis=1)
        off = np.hypot(paint * by_metre, FOUND_BESIDE * problem.layout.image_size[0])
        return np.asarray((JT * (irls_weight * off)[:, None]) @ self.segment)


def size_and_curvature(loss: RobustLoss, variance: Array) -> tuple[Array, Array]:
    """Standard deviation of normal noise whose ``E psi^2 / E rho'^2`` is `variance`, and ``E psi' / E rho'``, (B,).

    The expectations E are over normal noise, not over the residuals of a frame: the residuals of few labels are
    smaller than their noise, since the camera is fitted to them.
    """
    nodes, weights = _normal_nodes()
    sigma = np.sqrt(variance)
    largest = np.maximum(sigma, loss.scale)  # residuals in the flat part of the loss give no information
    for _ in range(NOISE_STEPS):
        squared = np.square(sigma[:, None] * nodes)
        _, slope = loss.evaluate(squared)
        wider = np.sqrt(variance * (np.square(slope) @ weights) / (np.square(nodes * slope) @ weights))
        sigma = np.minimum(wider, largest)
    _, slope = loss.evaluate(np.square(sigma[:, None] * nodes))
    # by parts: E psi'(r) = E r psi(r) / sigma^2 for normal r
    return sigma, ((np.square(nodes) * slope) @ weights) / (slope @ weights)


@cache
def _normal_nodes() -> tuple[Array, Array]:
    """Nodes and weights (`NODES`,) of Gauss's quadrature for means over the standard normal distribution."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(NODES)
    return nodes, weights / np.sum(weights)


def gram(JT: Array, weight: Array) -> Array:
    """``J^T diag(weight) J``, (B, P, P)."""
    return (JT * weight[:, None]) @ np.swapaxes(JT, 1, 2)


def pooled_noise(evaluation: Evaluation) -> tuple[Array, Array]:
    """Standard deviation (T,) of the pixels of T frames of one camera, and kappa of `fieldcalib.assess.uncertainty`.

    All frames have the same annotator or network, so both are estimated from all frames and equal in all.
    """
    problem, noise = evaluation.problem, Noise(evaluation)
    own = int(np.count_nonzero(~problem.layout.shared))
    equations = np.sum(noise.square * np.square(noise.relative_sigma))
    labelled = np.count_nonzero(np.any(problem.observations.weight > 0.0, axis=1))  # other frames rest on these
    redundancy = max(equations - own * labelled, 1.0)
    variance = np.full(len(problem), np.sum(noise.square * np.square(evaluation.r)) / redundancy)
    _, kappa = size_and_curvature(problem.loss, variance)
    return np.sqrt(variance), kappa
