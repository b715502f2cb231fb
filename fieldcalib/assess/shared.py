"""Uncertainty of the parameters that frames share.

Noise is independent from frame to frame, but a misplaced line is misplaced in every frame: that error stays, however
many frames there are. Errors of the model are similar in consecutive frames, so that the shared parameters are more
uncertain than white noise of the pixels would make them. Therefore the frames are divided into runs. At the solution
the gradients of all runs by the shared parameters cancel; the size of each gradient shows how much the estimate would
move without that run (a block jackknife).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fieldcalib._types import Array, IntArray
from fieldcalib.assess.noise import Noise
from fieldcalib.problem.evaluation import Evaluation
from fieldcalib.problem.layout import Role
from fieldcalib.problem.levenberg_marquardt import eliminated
from fieldcalib.problem.prior import GaussianPrior

RUNS = 8  # of frames, whose errors are assumed to be independent
UNDETERMINED = 1e-12  # of the curvatures of the parameters: a direction of less is not determined


@dataclass(frozen=True, eq=False)
class ReducedSystem:
    """Normal equations of S shared parameters of T frames, from which the frames' own parameters are eliminated.

    References
    ----------
    Triggs et al.: Bundle Adjustment - A Modern Synthesis, 2000, section 6.1 (the Schur complement).
    """

    hessian: Array
    """Hessian of the cost of all frames, (S, S)."""
    gradient: Array
    """Gradient of the cost of all frames, (S,)."""
    spread: Array
    """Covariance of the gradient, (S, S)."""
    by_frame: Array
    """Gradient of the cost of each frame's labels, (T, S); at the solution prior and links balance their sum."""

    @classmethod
    def of(cls, evaluation: Evaluation, sigma: Array, kappa: Array) -> ReducedSystem:
        """Eliminate the own parameters of one group of frames.

        Parameters that the layout considers, which are kept at their values, count as shared ones without a prior.

        Parameters
        ----------
        evaluation : Evaluation
            T frames at their solution.
        sigma : (T,) array
            Noise of the pixels after robust weighting.
        kappa : (T,) array
            Curvature of the loss relative to the Gauss-Newton Hessian.
        """
        evaluation = _with_considered_as_shared(evaluation)
        shared = evaluation.problem.layout.shared
        prior = np.zeros_like(evaluation.information) if evaluation.prior is None else evaluation.prior.hessian
        hessian = kappa[:, None, None] * evaluation.information + prior + evaluation.links_hessian
        following, _ = eliminated(hessian, evaluation.gradient, ~shared, evaluation.coupling)
        # L maps the gradient to that by the shared parameters while the own ones follow
        L = np.zeros((len(hessian), int(np.count_nonzero(shared)), len(shared)))
        L[:, :, ~shared], L[:, :, shared] = -np.swapaxes(following, 1, 2), np.eye(L.shape[1])
        noise = Noise(evaluation)
        between = np.square(sigma)[:, None, None] * noise.covariance(evaluation.JT) + prior
        painted = np.sum(L @ noise.by_line(evaluation.JT, evaluation.irls_weight), axis=0)
        # terms that link frames are weighted by inverse variances
        spread = np.sum(L @ (between + evaluation.links_hessian) @ np.swapaxes(L, 1, 2), axis=0) + painted @ painted.T
        if evaluation.coupling is not None:
            first, second, blocks = evaluation.coupling
            crossed = np.sum(L[first][:, :, ~shared] @ blocks @ np.swapaxes(L[second][:, :, ~shared], 1, 2), axis=0)
            spread += crossed + crossed.T
        return cls(
            np.sum(L @ hessian[:, :, shared], axis=0),
            np.sum(evaluation.gradient[:, shared], axis=0),
            spread,
            (L @ evaluation.pixels.gradient[..., None])[..., 0],
        )

    @property
    def determined(self) -> ReducedSystem:
        """The system with a weak prior on what nothing determines, without which it has no inverse.

        Without a prior, frames of one zoom do not tell how the lens follows the zoom: its errors are large then.
        """
        diagonal = np.diagonal(self.hessian)
        unit = np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
        values, vectors = np.linalg.eigh(self.hessian / np.outer(unit, unit))
        if np.all(values > UNDETERMINED):
            return self
        directions = unit[:, None] * vectors * np.sqrt(np.maximum(UNDETERMINED - values, 0.0))
        prior = directions @ directions.T
        return replace(self, hessian=self.hessian + prior, spread=self.spread + prior)

    def take(self, index: IntArray) -> ReducedSystem:
        """The system of some of the parameters; the others are fixed."""
        both = np.ix_(index, index)
        return ReducedSystem(self.hessian[both], self.gradient[index], self.spread[both], self.by_frame[:, index])

    @cached_property
    def inverse(self) -> Array:
        """Inverse of the Hessian, (S, S)."""
        return np.asarray(np.linalg.inv(self.hessian))

    @cached_property
    def white_covariance(self) -> Array:
        """Covariance (S, S) if the noise is independent from frame to frame: the sandwich of the gradient's spread."""
        return np.asarray(self.inverse @ self.spread @ self.inverse)

    @cached_property
    def covariance(self) -> Array:
        """Covariance (S, S), inflated if gradients of runs of frames are larger than independent noise explains.

        The factor is the variance between runs in units of `white_covariance`, averaged over all directions.
        """
        runs = [run for run in np.array_split(np.arange(len(self.by_frame)), RUNS) if len(run)]
        if len(runs) < 3 or not len(self.hessian):
            return self.white_covariance
        moved = np.array([np.sum(self.by_frame[run], axis=0) for run in runs]) @ self.inverse
        squares = float(np.sum(moved * np.linalg.solve(self.white_covariance, moved.T).T))
        return max(1.0, squares * len(runs) / (len(runs) - 1) / len(self.hessian)) * self.white_covariance


def _with_considered_as_shared(evaluation: Evaluation) -> Evaluation:
    problem = evaluation.problem
    layout, prior = problem.layout, problem.prior
    if not np.any(layout.considered):
        return evaluation
    if prior is not None:
        prior = GaussianPrior(prior.mean, np.where(layout.considered, np.inf, prior.sigma))
    layout = layout.with_roles_of(layout.considered, Role.SHARED)
    return evaluation.of(replace(problem, layout=layout, prior=prior))
