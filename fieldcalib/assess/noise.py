"""The noise of labelled pixels: relative to their weights, what a segment shares of it, and how large it is."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from fieldcalib._types import Array
from fieldcalib.problem.evaluation import Evaluation
from fieldcalib.problem.losses import RobustLoss

# Share of a pixel's variance that its whole segment has in common: annotators keep to one side of a line. Segments left
# out of SoccerNet's and WC14's frames lie as far off as it makes expected (median), and 91 % of them in 95 % intervals;
# with 0 it is 88 %. 3 to 4 % have wrong labels.
SHARED_NOISE = 0.15
# Share of the image's width, 0.1 px of 960, by which a far line is found beside where it is, in all frames of a clip:
# root mean square of 15 lines in filmed clips on which a pixel shows 0.3 m or more. Of nearer ones paint is more.
FOUND_BESIDE = 0.1 / 960.0
NODES, NOISE_STEPS = 21, 4  # of the quadrature over the noise, and of the search for its size


class Noise:
    """The noise of B frames' pixels, relative to that of a pixel of weight 1: its size, and what segments share."""

    def __init__(self, evaluation: Evaluation) -> None:
        self.evaluation = evaluation
        observations = evaluation.problem.observations
        label, share = observations.label, observations.pixel_share
        self.segment = (label[..., None] == np.unique(label[label >= 0])).astype(float)  # (B, M, segments)
        count = (self.segment @ (np.swapaxes(self.segment, 1, 2) @ share)[..., None])[..., 0]
        self.segment[:, ~observations.shares_noise] = 0.0
        self.shared = SHARED_NOISE * np.sum(self.segment, axis=-1)
        # a weight is one over a variance; a pixel of N has an Nth of it
        self.relative_sigma = 1.0 / np.sqrt(np.where(label >= 0, observations.weight * count, 1.0))

    @cached_property
    def pull(self) -> Array:
        """Weights (B, M) of the residuals in the gradient, for noise of one sigma."""
        return np.asarray(self.evaluation.pull * self.relative_sigma)

    @cached_property
    def square(self) -> Array:
        """Squares of ``rho'`` in units of the pixels' own noise, (B, M): how much a pixel tells of the noise."""
        evaluation = self.evaluation
        slope = evaluation.problem.loss.evaluate(np.square(evaluation.r))[1]
        return np.asarray(np.square(slope / self.relative_sigma) * (evaluation.problem.observations.weight > 0.0))

    def covariance(self, JT: Array, left: Array, right: Array) -> Array:
        """``J^T diag(left) C diag(right) J``, (B, P, P), C being the correlation of the noise."""
        left_sum, right_sum = ((JT * factor[:, None]) @ self.segment for factor in (left, right))
        own = gram(JT, left * right * (1.0 - self.shared))
        return np.asarray(own + SHARED_NOISE * left_sum @ np.swapaxes(right_sum, 1, 2))

    def of_paint(self, JT: Array, pull: Array) -> Array:
        """``J^T W S W J`` (B, P, P) of lines that are painted elsewhere as a whole, S in pixels squared."""
        summed = self.by_line(JT, pull)
        return np.asarray(summed @ np.swapaxes(summed, 1, 2))

    def by_line(self, JT: Array, pull: Array) -> Array:
        """``J^T W`` times the residuals of each line (B, P, L) that is one standard deviation elsewhere.

        It may be painted or found elsewhere, and either is so in all frames. A line that is off by one metre moves its
        residuals by the length of ``n dxy_dX`` on the ground. The order of the lines is that of their labels, for all
        frames alike.
        """
        problem, paint = self.evaluation.problem, self.evaluation.problem.paint
        if paint == 0.0:
            return np.zeros((len(JT), JT.shape[1], 1))
        by_metre = np.linalg.norm(self.evaluation.derivatives(problem.layout.is_centre)[:, :2], axis=1)
        off = np.hypot(paint * by_metre, FOUND_BESIDE * problem.layout.image_size[0])
        return np.asarray((JT * (pull * off)[:, None]) @ self.segment)


def size_and_curvature(loss: RobustLoss, variance: Array) -> tuple[Array, Array]:
    """Standard deviation of normal noise whose ``E psi^2 / E rho'^2`` is `variance`, and ``E psi' / E rho'``, (B,).

    The mean over the noise, not over a frame's own residuals: few of them are smaller than the noise was.
    """
    nodes, weights = np.polynomial.hermite_e.hermegauss(NODES)
    weights = weights / np.sum(weights)
    sigma = np.sqrt(variance)
    largest = np.maximum(sigma, loss.scale)  # residuals beyond the bend of the loss do not tell how large the noise is
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
    """Standard deviation of the pixels of T frames of one camera, as `fieldcalib.assess.uncertainty` has it, and kappa.

    All frames have the same annotator or network, so that they tell it together, (T,) alike.
    """
    problem = evaluation.problem
    noise = Noise(evaluation)
    own = int(np.count_nonzero(~problem.layout.shared))
    equations = np.sum(noise.square * np.square(noise.relative_sigma))
    labelled = np.count_nonzero(np.any(problem.observations.weight > 0.0, axis=1))  # the others follow from these
    redundancy = max(equations - own * labelled, 1.0)
    variance = np.full(len(problem), np.sum(noise.square * np.square(evaluation.r)) / redundancy)
    _, kappa = size_and_curvature(problem.loss, variance)
    return np.sqrt(variance), kappa
