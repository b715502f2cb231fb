"""The noise of labelled pixels: its size relative to their weights, and the share that is common to a segment."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from fieldcalib._types import Array
from fieldcalib.problem.evaluation import Evaluation
from fieldcalib.problem.losses import RobustLoss

# Share of a pixel's variance that is common to its segment: annotators keep to one side of a line. With it, distances
# of segments left out of SoccerNet's and WC14's frames are as predicted in the median, and 91 % are in 95 % intervals
# (with 0, 88 %). 3 to 4 % have wrong labels.
SHARED_NOISE = 0.15
# Share of the image's width, 0.1 px of 960, by which a far line is off in all frames of a clip: root mean square of 15
# lines in filmed clips on which a pixel shows 0.3 m or more. For nearer lines the error of the paint is larger.
FOUND_BESIDE = 0.1 / 960.0
NODES, NOISE_STEPS = 21, 4  # nodes of the quadrature over the noise, steps of the search for its size


class Noise:
    """The noise of the pixels of B frames, relative to the noise of a pixel of weight 1."""

    def __init__(self, evaluation: Evaluation) -> None:
        self.evaluation = evaluation
        observations = evaluation.problem.observations
        label = observations.label
        sharing = np.where(observations.shares_noise, label, -1)  # points share none, and there may be very many
        self.segment = (sharing[..., None] == np.unique(sharing[sharing >= 0])).astype(float)  # (B, M, segments)
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
        its residuals by the length of ``n dxy_dX`` on the ground. The L lines are in the order of their labels.
        """
        problem, paint = self.evaluation.problem, self.evaluation.problem.paint
        if paint == 0.0 or not self.segment.shape[-1]:
            return np.zeros((len(JT), JT.shape[1], 1))
        by_metre = np.linalg.norm(self.evaluation.by_centre[:, :2], axis=1)
        off = np.hypot(paint * by_metre, FOUND_BESIDE * problem.layout.image_size[0])
        return np.asarray((JT * (irls_weight * off)[:, None]) @ self.segment)


def size_and_curvature(loss: RobustLoss, variance: Array) -> tuple[Array, Array]:
    """Standard deviation of normal noise whose ``E psi^2 / E rho'^2`` is `variance`, and ``E psi' / E rho'``, (B,).

    The expectations E are over normal noise, not over the residuals of a frame: the residuals of few labels are
    smaller than their noise, since the camera is fitted to them.
    """
    nodes, weights = np.polynomial.hermite_e.hermegauss(NODES)
    weights = weights / np.sum(weights)
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
