"""Errors of the own parameters of frames of one tripod: pan, tilt, roll and zoom; all others are shared.

To first order the error of a frame's own parameters is

    own = e - F s,

with s the error of the shared parameters, of covariance V, and e the error that remains if these are exact, of
covariance E. A frame that is tied to others by points of the background inherits their errors e_k - F_k s through the
coupling C between the frames. Misplaced lines are misplaced for all parameters: e = A d and s = S d, with d the
displacements of the lines in standard deviations, correlate by A S^T. What s tells of e is part of F, so that the rest
of e, of covariance E, is independent of s.

Uncertainty of the parameters that frames share.

Noise is independent from frame to frame, but a misplaced line is misplaced in every frame: that error stays, however
many frames there are. Errors of the model are similar in consecutive frames, so that the shared parameters are more
uncertain than white noise of the pixels would make them. Therefore the frames are divided into runs. At the solution
the gradients of all runs by the shared parameters cancel; the size of each gradient shows how much the estimate would
move without that run (a block jackknife).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from fieldcalib._types import Array, IntArray
from fieldcalib.assess.estimate import relative_to_markings
from fieldcalib.assess.ground import Considered, ground_derivatives, ground_of_pixels, projection_on
from fieldcalib.assess.label_errors import Noise, gram
from fieldcalib.fields.field import Field
from fieldcalib.problem.evaluation import Evaluation
from fieldcalib.problem.layout import GaussianPrior, Role
from fieldcalib.problem.levenberg_marquardt import coupled, eliminated

RUNS = 8  # of frames, whose errors are assumed to be independent
FAINT = 1e-9  # of the largest variance, in units of the parameters: a direction of less tells nothing
UNDETERMINED = 1e-12  # of the curvatures of the parameters: a direction of less is not determined

GRID = (7, 5)  # pixels across and down the picture


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
    painted: Array
    """Gradient of the cost (S, L) for each line if it is misplaced by one standard deviation."""
    lines: IntArray
    """Numbers of the labels of these lines, (L,)."""

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
            painted,
            noise.lines,
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
        kept = self.by_frame[:, index], self.painted[index], self.lines
        return ReducedSystem(self.hessian[both], self.gradient[index], self.spread[both], *kept)

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


class OwnErrors(NamedTuple):
    """Errors of the o own parameters of B frames, which share S others."""

    own: Array
    """E, (B, o, o)."""
    following: Array
    """F, (B, o, S)."""


def own_errors(
    evaluation: Evaluation,
    sigma: float,
    kappa: float,
    of_first: OwnErrors | None = None,
    shared: Considered | None = None,
) -> OwnErrors:
    """Errors of frames at their solution, which background points tie to one another or to known frames.

    Parameters
    ----------
    evaluation : Evaluation
        B frames, in a layout whose free parameters are the frames' own and whose considered ones are shared.
    sigma, kappa : float
        Size of the noise and curvature, as in `fieldcalib.assess.sequence_errors`.
    of_first : OwnErrors, optional
        Errors of the first frame of each of K pairs, where these frames are not in the evaluation.
    shared : Considered, optional
        Errors of the shared parameters; by default they are independent of the lines of these frames.
    """
    noise = Noise(evaluation)
    hessian, between, border, painted = _of_labels(noise, sigma, kappa)
    hessian, between = hessian + evaluation.links_hessian, between + evaluation.links_hessian
    if evaluation.background is not None:
        pairs, layout = evaluation.background.pairs, evaluation.problem.layout
        of_each = evaluation.background.jacobians(layout.free | layout.considered)
        own = layout.free[layout.free | layout.considered]
        by_shared = np.swapaxes(of_each[0][:, ~own] + of_each[1][:, ~own], 1, 2)
        first, second = (J[:, own] * evaluation.background.irls_weight[:, None] for J in of_each)
        np.add.at(border, pairs.second, second @ by_shared)
        if pairs.known is None:
            np.add.at(border, pairs.first, first @ by_shared)
        else:
            assert of_first is not None
            coupling = second @ np.swapaxes(of_each[0][:, own], 1, 2)
            np.add.at(between, pairs.second, coupling @ of_first.own @ np.swapaxes(coupling, 1, 2))
            np.add.at(border, pairs.second, -coupling @ of_first.following)
    if evaluation.coupling is None:
        inverse = np.linalg.inv(hessian)
        return _independent(inverse @ between @ inverse, inverse @ border, inverse @ painted, noise, shared)
    B, o = hessian.shape[:2]
    inverse = np.linalg.inv(coupled(hessian, evaluation.coupling))
    spread = (inverse @ coupled(between, evaluation.coupling) @ inverse).reshape(B, o, B, o)
    # a misplaced line is misplaced in all frames: ties do not average its error out
    by_line, following = ((inverse @ of_all.reshape(B * o, -1)).reshape(of_all.shape) for of_all in (painted, border))
    return _independent(spread[np.arange(B), :, np.arange(B)], following, by_line, noise, shared)


def _independent(E: Array, F: Array, A: Array, noise: Noise, shared: Considered | None) -> OwnErrors:
    """Errors with those of misplaced lines, A (B, o, L), as far as errors of the shared parameters do not tell them."""
    E = E + A @ np.swapaxes(A, 1, 2)
    problem = noise.evaluation.problem
    if shared is None or shared.by_line is None or problem.paint == 0.0:
        return OwnErrors(E, F)
    labels, unmoved = problem.observations.labels, np.zeros(len(shared.covariance))
    S = [shared.by_line.get(labels[line], unmoved) for line in noise.lines]
    crossed = A @ np.reshape(S, (-1, len(unmoved)))
    unit = np.sqrt(np.diagonal(shared.covariance))
    unit = np.where(unit > 0.0, unit, 1.0)
    inverse = np.linalg.pinv(shared.covariance / np.outer(unit, unit), rcond=FAINT, hermitian=True)
    told = crossed @ (inverse / np.outer(unit, unit))
    return OwnErrors(E - told @ np.swapaxes(crossed, 1, 2), F - told)


def _of_labels(noise: Noise, sigma: float, kappa: float) -> tuple[Array, Array, Array, Array]:
    """Derivatives of the cost of labels and prior by the own parameters.

    These are the Hessian (B, o, o), the covariance of the gradient (B, o, o), the Hessian by own and shared parameters
    (B, o, S), and the gradient (B, o, L) for each line if it is misplaced by one standard deviation.
    """
    evaluation, JT = noise.evaluation, noise.evaluation.JT
    by_shared = evaluation.derivatives(evaluation.problem.layout.considered)
    between = sigma**2 * noise.covariance(JT)
    hessian = kappa * gram(JT, evaluation.irls_weight)
    if evaluation.prior is not None:
        between, hessian = between + evaluation.prior.hessian, hessian + evaluation.prior.hessian
    border = kappa * (JT * evaluation.irls_weight[:, None]) @ np.swapaxes(by_shared, 1, 2)
    return hessian, between, border, noise.by_line(JT, evaluation.irls_weight)


def whole_covariance(E: Array, F: Array, considered: Considered) -> Array:
    """Covariance (n, n) of all parameters of one frame, from E (o, o), F (o, S) and that of the shared parameters."""
    layout, V = considered.layout, considered.covariance
    own, shared = np.flatnonzero(layout.free), np.flatnonzero(layout.considered)
    covariance = np.zeros((layout.size, layout.size))
    covariance[np.ix_(own, own)] = E + F @ V @ F.T
    covariance[np.ix_(own, shared)] = -F @ V
    covariance[np.ix_(shared, own)] = -V @ F.T
    covariance[np.ix_(shared, shared)] = V
    return covariance


def ground_errors(theta: Array, errors: OwnErrors, considered: Considered, field: Field | None) -> Array:
    """Root mean square error (B,), metres, of the field points that each camera sees, relative to the markings in view.

    It is the median over the pixels of a grid that show the field, or the ground if no field is given, and NaN if none
    does.
    """
    layout = considered.layout
    half = np.full(2, np.inf) if field is None else np.array([field.length, field.width]) / 2.0
    width, height = layout.image_size
    x, y = np.meshgrid(np.linspace(0.0, width - 1.0, GRID[0]), np.linspace(0.0, height - 1.0, GRID[1]))
    xy = np.broadcast_to(np.stack([x, y], axis=-1).reshape(-1, 2), (len(theta), GRID[0] * GRID[1], 2))
    projection = projection_on(field, theta, layout)
    X, seen = ground_of_pixels(projection, xy)
    seen &= np.all(np.abs(X[..., :2]) <= half, axis=-1)
    some = layout.free | layout.considered
    moved = relative_to_markings(ground_derivatives(projection, X, seen, some), projection, field, some)
    own = moved[..., layout.free[some]]
    shared = moved[..., layout.considered[some]] - own @ errors.following[:, None]
    V = considered.covariance
    squares = np.einsum("bnij,bjk,bnik->bn", own, errors.own, own) + np.einsum("bnij,jk,bnik->bn", shared, V, shared)
    ordered = np.sort(np.where(seen, squares, np.inf), axis=1)
    count = np.sum(seen, axis=1)
    middle = ordered[np.arange(len(theta)), np.maximum(count - 1, 0) // 2]
    return np.where(count > 0, np.sqrt(middle), np.nan)
