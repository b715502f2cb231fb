"""The two solvers of the robust least squares problem: SciPy's for one frame, a batched Levenberg-Marquardt for many.

Both minimise, over the free parameters,

    cost(theta) = 1/2 sum_i w_i rho(r_i(theta)^2) / noise^2 + 1/2 sum_k ((theta_k - mean_k) / sigma_k)^2.

The robust loss acts on the data alone. The prior is quadratic but for the lens, whose tails are heavy: lenses are found
that bend the corner by a quarter. Steps are those of reweighted least squares: the quadratic
with weights rho' lies above the loss, so they do not overshoot. Triggs' second-order correction, SciPy's own way, does
where residuals reach the scale of the loss: on annotated frames it took 10 iterations of the wide loss for 4 of these.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from typing import TypeAlias

import numpy as np

from fieldcalib._types import Array, BoolArray, IntArray
from fieldcalib.fields.stands import SOCCER_SCALE
from fieldcalib.problem.losses import RobustLoss
from fieldcalib.problem.observations import Observations
from fieldcalib.problem.parameters import ANGLES, CENTER, LENS, LOG_F, PARAMETERS, GaussianPrior
from fieldcalib.problem.residuals import segment_residuals_with_jacobian

# The longest step in one iteration: beyond it the linearisation says nothing about a camera. That of the centre is in
# units of what is in view, `Problem.scale`.
LARGEST_STEP = np.full(len(PARAMETERS), np.inf)
LARGEST_STEP[ANGLES] = 0.4  # radians
LARGEST_STEP[LOG_F] = 0.7  # a factor of two
LARGEST_STEP[CENTER] = 1.0

IS_LENS = np.zeros(len(PARAMETERS), dtype=bool)
IS_LENS[LENS] = True
LENS_TAILS = RobustLoss("cauchy", 2.0)  # z-scores beyond two count less and less

LEAST = np.full(len(PARAMETERS), -np.inf)
LEAST[LENS.start + 1] = 0.0  # b2: below, the lens folds back (`fieldcalib.geometry.lens`)

# Fields of view from 0.3 to 170 degrees: outside, a fit collapses to a point or to a plane and ends in overflow.
LOG_F_RANGE = (np.log(0.04), np.log(200.0))  # of f / width


@dataclass(frozen=True)
class Problem:
    """B calibration problems that share a loss, a noise and the set of free parameters."""

    observations: Observations
    free: BoolArray
    """Which of the 12 parameters are estimated."""
    loss: RobustLoss
    noise: float = 1.0
    """Standard deviation, in pixels, of a segment of weight 1: what the labels weigh against the prior."""
    prior: GaussianPrior | None = None
    """One for each problem, (B, 12); None for none."""
    scale: float = SOCCER_SCALE
    """Size of what is in view, metres: the centre moves no further in one step."""

    def take(self, index: IntArray) -> Problem:
        """The problems `index`, in that order, repeated where `index` repeats."""
        prior = None if self.prior is None else self.prior.take(index)
        return replace(self, observations=self.observations.take(index), prior=prior)

    @property
    def largest_step(self) -> Array:
        """Of the free parameters in one iteration, (P,)."""
        step = LARGEST_STEP.copy()
        step[CENTER] *= self.scale
        return step[self.free]

    def prior_residuals(self, theta: Array) -> Array:
        """z-scores of the free parameters, (B, P); (B, 0) without a prior."""
        if self.prior is None:
            return np.zeros((len(theta), 0))
        return self.prior.z_scores(theta)[:, self.free]

    def prior_costs(self, squared: Array) -> tuple[Array, Array]:
        """What squared z-scores (..., P) of the free parameters cost, and its derivative by them."""
        cost, slope = squared.copy(), np.ones_like(squared)
        is_lens = IS_LENS[self.free]
        cost[..., is_lens], slope[..., is_lens] = LENS_TAILS.evaluate(squared[..., is_lens])
        return cost, slope

    def linearized(self, theta: Array) -> tuple[Array, Array, Array]:
        """Cost (B,), its gradient (B, P), and the Gauss-Newton approximation of its Hessian (B, P, P).

        Where the cost is not finite it is infinity, and the other two mean nothing.
        """
        r, J = segment_residuals_with_jacobian(theta, self.observations, self.free)
        rho, slope = self.loss.evaluate(np.square(r))
        weight = self.observations.weight / self.noise**2
        cost = 0.5 * np.sum(weight * rho, axis=1)
        JT = np.swapaxes(J, 1, 2) * (weight * slope)[:, None]
        gradient = (JT @ r[..., None])[..., 0]
        hessian = JT @ J
        if self.prior is not None:
            z, inverse_sigma = self.prior_residuals(theta), 1.0 / self.prior.sigma[:, self.free]
            prior_cost, prior_slope = self.prior_costs(np.square(z))
            cost += 0.5 * np.sum(prior_cost, axis=1)
            gradient += prior_slope * z * inverse_sigma
            diagonal = np.arange(hessian.shape[1])
            hessian[:, diagonal, diagonal] += prior_slope * np.square(inverse_sigma)
        possible = np.isfinite(cost) & in_range(theta, self.observations.image_size)
        return np.where(possible, cost, np.inf), gradient, hessian


def in_range(theta: Array, image_size: tuple[int, int]) -> BoolArray:
    """Whether the focal lengths are those of a camera, (B,): a fit that collapses is stopped before it overflows."""
    log_f = theta[:, LOG_F] - np.log(image_size[0])
    return np.asarray((log_f > LOG_F_RANGE[0]) & (log_f < LOG_F_RANGE[1]))


@dataclass(frozen=True)
class Solution:
    """Where a solver ended, for B problems."""

    theta: Array
    """(B, 12)."""
    cost: Array
    """(B,)."""
    converged: BoolArray
    """(B,); False where the iterations were used up, or the start had no finite cost."""
    iterations: IntArray
    """(B,); evaluations of residuals and Jacobian after the first."""

    def replaced(self, index: IntArray, other: Solution) -> Solution:
        """With `other` in place of the problems `index`."""
        merged = {field.name: getattr(self, field.name).copy() for field in fields(self)}
        for name, values in merged.items():
            values[index] = getattr(other, name)
        return Solution(**merged)


# One of the solvers with its limits set: problems and their starts (B, 12) to solutions.
Finish: TypeAlias = Callable[[Problem, Array], Solution]


def solve_batch(problem: Problem, theta: Array, *, max_iterations: int, tolerance: float) -> Solution:
    """Levenberg-Marquardt on B problems at once, each with its own damping; finished problems leave the batch.

    The damping follows Nielsen's rule: it falls by up to nine as the linear model predicts the cost well, and grows at
    a doubling rate while steps fail. It is relative to the diagonal of the Hessian (Marquardt), so that radians, metres
    and log f need no scaling.

    Parameters
    ----------
    problem : Problem
        B problems.
    theta : (B, 12) array
        Starts; parameters that are not free keep these values.
    max_iterations : int
        Evaluations allowed after the first.
    tolerance : float
        A problem is done when a step lowers its cost, or is predicted to lower it, by less than this share.

    Returns
    -------
    Solution

    References
    ----------
    Madsen, Nielsen, Tingleff: Methods for Non-Linear Least Squares Problems, 2nd edition, 2004, section 3.2.
    """
    solution = Solution(
        theta.copy(), np.empty(len(theta)), np.zeros(len(theta), dtype=bool), np.zeros(len(theta), dtype=np.intp)
    )
    free = np.flatnonzero(problem.free)
    diagonal, largest_step = np.arange(len(free)), problem.largest_step
    theta = theta.copy()
    theta[:, free] = np.maximum(theta[:, free], LEAST[free])
    cost, gradient, hessian = problem.linearized(theta)
    solution.cost[:] = cost
    index = np.arange(len(theta))  # of the problems still in the batch
    running = np.isfinite(cost)
    cost = np.where(running, cost, 0.0)  # an infinite start is given back as it is
    damping, growth = np.full(len(theta), 1e-2), np.full(len(theta), 2.0)

    for _ in range(max_iterations):
        if np.count_nonzero(running) < 0.8 * len(index):
            kept = np.flatnonzero(running)
            index, problem, theta = index[kept], problem.take(kept), theta[kept]
            cost, gradient, hessian = cost[kept], gradient[kept], hessian[kept]
            damping, growth, running = damping[kept], growth[kept], running[kept]
        if not len(index):
            break
        scale = damping[:, None] * (hessian[:, diagonal, diagonal] + 1e-12)
        damped = hessian.copy()
        damped[:, diagonal, diagonal] += scale
        # what is at its least value and would fall stays there: out of the linear system with it
        held = (theta[:, free] <= LEAST[free]) & (gradient > 0.0)
        downhill = np.where(held, 0.0, -gradient)
        if np.any(held):
            damped = np.where(held[:, :, None] | held[:, None, :], 0.0, damped)
            damped[:, diagonal, diagonal] += held
        step = np.linalg.solve(damped, downhill[..., None])[..., 0]
        step /= np.maximum(np.max(np.abs(step) / largest_step, axis=1), 1.0)[:, None]
        step = np.maximum(theta[:, free] + step, LEAST[free]) - theta[:, free]
        trial = theta.copy()
        trial[:, free] += step
        trial_cost, trial_gradient, trial_hessian = problem.linearized(trial)

        predicted = -np.sum(step * (gradient + 0.5 * (hessian @ step[..., None])[..., 0]), axis=1)
        better = running & (trial_cost < cost)
        small = np.maximum(cost - np.where(better, trial_cost, cost), predicted) <= tolerance * cost
        stuck = ~better & ((damping > 1e10) | (predicted <= 1e-14 * cost))
        done = running & (small | stuck)
        gain = (cost - trial_cost) / np.maximum(predicted, 1e-300)
        shrink = np.maximum(1.0 / 9.0, 1.0 - (2.0 * np.clip(gain, 0.0, 1.0) - 1.0) ** 3)
        failed = running & ~better  # what is finished keeps its damping
        damping = np.where(better, np.maximum(damping * shrink, 1e-12), np.where(failed, damping * growth, damping))
        growth = np.where(better, 2.0, np.where(failed, 2.0 * growth, growth))

        theta = np.where(better[:, None], trial, theta)
        cost = np.where(better, trial_cost, cost)
        gradient = np.where(better[:, None], trial_gradient, gradient)
        hessian = np.where(better[:, None, None], trial_hessian, hessian)
        solution.theta[index[running]], solution.cost[index[running]] = theta[running], cost[running]
        solution.iterations[index[running]] += 1
        solution.converged[index[done]] = True
        running &= ~done
    return solution


def solve_one(problem: Problem, theta: Array, *, max_iterations: int, tolerance: float) -> Solution:
    """SciPy's trust region reflective solver on one problem: the same cost and the same arguments as `solve_batch`.

    Parameters
    ----------
    problem : Problem
        B = 1 problem.
    theta : (1, 12) array
        Start.
    max_iterations : int
        Evaluations allowed after the first.
    tolerance : float
        Done when a step lowers the cost by less than this share.

    Returns
    -------
    Solution
    """
    from scipy.optimize import least_squares  # a slow import

    weight = problem.observations.weight[0] / problem.noise**2
    free = problem.free

    def full(x: Array) -> Array:
        moved = theta.copy()
        moved[0, free] = x
        return moved

    @lru_cache(maxsize=1)  # SciPy asks for the residuals at a point, then for the Jacobian there
    def linearized(x: bytes) -> tuple[Array, Array]:
        moved = full(np.frombuffer(x))
        r, J = segment_residuals_with_jacobian(moved, problem.observations, free)
        r, J = np.concatenate([r[0], problem.prior_residuals(moved)[0]]), J[0]
        if problem.prior is not None:
            J = np.concatenate([J, np.diag(1.0 / problem.prior.sigma[0, free])])
        # SciPy takes a shorter step where residuals are not finite
        return r if in_range(moved, problem.observations.image_size)[0] else np.full_like(r, np.inf), J

    def rho(squared: Array) -> Array:
        values = np.zeros((3, len(squared)))  # the last row, rho'', stays zero: no correction of second order
        values[:2, : len(weight)] = weight * problem.loss.evaluate(squared[: len(weight)])
        if problem.prior is not None:
            values[:2, len(weight) :] = problem.prior_costs(squared[len(weight) :])
        return values

    start, least = np.maximum(theta[0, free], LEAST[free]), LEAST[free]
    if not np.all(np.isfinite(linearized(start.tobytes())[0])):
        return Solution(theta.copy(), np.array([np.inf]), np.array([False]), np.array([0], dtype=np.intp))
    with np.errstate(all="ignore"):
        found = least_squares(
            lambda x: linearized(x.tobytes())[0],
            start,
            lambda x: linearized(x.tobytes())[1],
            bounds=(least, np.inf),
            x_scale="jac",
            loss=rho,
            ftol=tolerance,
            xtol=1e-15,
            gtol=1e-15,
            max_nfev=max_iterations + 1,  # the start counts here
        )
    return Solution(
        full(found.x), np.array([found.cost]), np.array([found.status > 0]), np.array([found.nfev - 1], dtype=np.intp)
    )
