"""Levenberg-Marquardt on many frames at once, each by itself or several with shared parameters.

Steps are those of iteratively reweighted least squares: the quadratic with weights rho' is an upper bound of the loss,
so steps do not overshoot. (With Triggs' second-order correction, as in SciPy, they do where residuals reach the scale
of the loss: on annotated frames the wide loss took 10 iterations instead of 4.)

With H_tt the Hessian of a frame's own parameters, H_ss that of the shared ones and H_ts their coupling, the system of a
group of frames is a block arrow. Each frame is eliminated by itself (the Schur complement),

    (H_ss - sum_t H_st H_tt^-1 H_ts) ds = -(g_s - sum_t H_st H_tt^-1 g_t),    H_tt dt = -g_t - H_ts ds.

Frames that share nothing are groups of one with an empty border. Terms that link frames with each other, common
background points or a smooth path of their centres, couple their own parameters too: the frames of a group are then
eliminated together.

SciPy's trust region reflective solver (`least_squares`) finishes single frames, and is an independent check.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fieldcalib._types import Array, BoolArray, IntArray
from fieldcalib.fields.ground import Terrain
from fieldcalib.problem.compilation import kernels, no_points, packed_frames, unknowns
from fieldcalib.problem.cost_term import LENS_TAILS, Coupling, prior_costs
from fieldcalib.problem.damping import LARGEST_DAMPING, LEAST_DAMPING, LEAST_DIAGONAL, SETTLED, STILL
from fieldcalib.problem.evaluation import LOG_F_RANGE, Evaluation, Problem, evaluate
from fieldcalib.problem.layout import Bounds, GaussianPrior

FAR, NEAR = 1e-2, 1e-4  # initial damping, share of the Hessian's diagonal: far from the solution, and near it
LEAST_CURVATURE = 1e-14  # share of the largest curvature that a direction has which nothing determines
COMPACTED = 0.8  # share of the frames below which finished ones leave the batch


@dataclass(frozen=True, eq=False)
class Solution:
    """Result of a solver for B frames."""

    evaluation: Evaluation
    """The problem evaluated at the solution."""
    converged: BoolArray
    """Whether the solver converged, (B,): not if iterations ran out or the cost of the start was not finite."""
    iterations: IntArray
    """Number of evaluations after the first, (B,)."""

    @property
    def theta(self) -> Array:
        """Parameters of the cameras, (B, n)."""
        return self.evaluation.theta

    @property
    def cost(self) -> Array:
        """Cost of each frame, (B,)."""
        return self.evaluation.cost

    def take(self, index: IntArray) -> Solution:
        """The solutions of some frames."""
        return Solution(self.evaluation.take(index), self.converged[index], self.iterations[index])


@dataclass(frozen=True, eq=False)
class Groups:
    """G groups of consecutive frames that share parameters."""

    of_frame: IntArray
    """Group of each frame, (B,), ascending."""

    @classmethod
    def of(cls, problem: Problem) -> Groups:
        """The groups of a problem; by default each frame is a group."""
        return cls(np.arange(len(problem)) if problem.group is None else problem.group)

    @property
    def is_trivial(self) -> bool:
        """Whether every frame is a group."""
        return len(self.of_frame) == 0 or int(self.of_frame[-1]) == len(self.of_frame) - 1

    def reduced(self, function: np.ufunc, values: Array) -> Array:
        """Values (B, ...) of the frames of each group reduced to one by a function, (G, ...)."""
        if self.is_trivial:
            return values
        first = np.searchsorted(self.of_frame, np.arange(self.of_frame[-1] + 1))
        return np.asarray(function.reduceat(values, first))

    def sum(self, values: Array) -> Array:
        """Sums (G, ...) over the frames (B, ...) of each group."""
        return self.reduced(np.add, values)

    def spread(self, values: NDArray[Any]) -> NDArray[Any]:
        """Values (G, ...) for each frame, (B, ...)."""
        return values if self.is_trivial else values[self.of_frame]

    def take(self, frames: IntArray) -> Groups:
        """The groups of some frames, renumbered; groups must be whole."""
        return Groups(np.unique(self.of_frame[frames], return_inverse=True)[1])


@np.errstate(over="ignore", invalid="ignore")  # a step with an infinite cost is rejected
def levenberg_marquardt(
    start: Evaluation, *, max_iterations: int, tolerance: float, initial_damping: float = NEAR
) -> Solution:
    """Minimise the cost of B frames at once, each group with its own damping; finished groups leave the batch.

    The damping follows Nielsen's rule: it falls by a factor of up to nine where the linear model predicts the cost
    well, and grows by ever larger factors while steps fail. It is relative to the diagonal of the Hessian (Marquardt),
    so that radians, metres and log f need no scaling.

    Parameters
    ----------
    start : Evaluation
        The problem at its initial cameras; parameters that are not free keep their values.
    max_iterations : int
        Largest number of evaluations after the first.
    tolerance : float
        A group is done when a step lowers its cost, and was predicted to lower it, by less than this share. A step that
        is predicted to lower it by less than `SETTLED` of that is not taken.
    initial_damping : float
        `FAR` or `NEAR`.

    Returns
    -------
    Solution

    References
    ----------
    Madsen, Nielsen, Tingleff: Methods for Non-Linear Least Squares Problems, 2nd edition, 2004, section 3.2. Triggs et
    al.: Bundle Adjustment - A Modern Synthesis, 2000, section 6.1 (the Schur complement).
    """
    compiled = _compiled_solution(start, max_iterations, tolerance, initial_damping)
    if compiled is not None:
        return compiled
    bounds = start.problem.layout.bounds(start.problem.scale)
    start = _brought_inside(start, bounds)
    best, batch = start, _Batch.at(start, initial_damping)
    converged, iterations = np.zeros(len(start.theta), dtype=bool), np.zeros(len(start.theta), dtype=np.intp)
    for left in reversed(range(max_iterations)):
        step, predicted = batch.step(bounds)
        # a step that was cut at a bound may be predicted to raise the cost: a shorter one is not
        settled = batch.running & (np.abs(predicted) <= max(SETTLED * tolerance, STILL) * batch.cost)
        if settled.any():
            converged[batch.frames(settled)] = True
            batch = batch.without(settled)
        if not batch.running.any():
            break
        batch, step, predicted = batch.compacted(step, predicted)
        moved = batch.theta.copy()
        moved[:, bounds.free] += step
        trial = evaluate(batch.problem, moved)
        trial_cost = batch.groups.sum(trial.cost)
        better = batch.running & (trial_cost < batch.cost)
        small = np.maximum(batch.cost - np.where(better, trial_cost, batch.cost), np.abs(predicted))
        done = batch.running & ((small <= tolerance * batch.cost) | ~better & (batch.damping > LARGEST_DAMPING))
        taken = batch.groups.spread(better)
        if taken.all() and len(taken) == len(best.theta):
            best = trial
        elif taken.any():
            best = best.replaced(batch.index[taken], trial.theta[taken], trial.points.take(taken))
        iterations[batch.frames(batch.running)] += 1
        converged[batch.frames(done)] = True
        if not (left and (batch.running & ~done).any()):
            break
        batch = batch.after(trial, better, predicted).without(done)
    return Solution(best, converged, iterations)


def _brought_inside(start: Evaluation, bounds: Bounds) -> Evaluation:
    """The evaluation with its cameras moved to within the bounds."""
    theta = start.theta.copy()
    theta[:, bounds.free] = np.clip(theta[:, bounds.free], bounds.least, bounds.largest)
    return start if np.array_equal(theta, start.theta) else evaluate(start.problem, theta)


@dataclass(frozen=True, eq=False)
class _Batch:
    """The B frames that are still iterated, in G groups, at their best cameras so far."""

    index: IntArray
    """Indices of the frames in the start, (B,)."""
    problem: Problem
    groups: Groups
    theta: Array
    gradient: Array
    hessian: Array
    coupling: Coupling | None
    cost: Array
    """(G,)."""
    damping: Array
    growth: Array
    """Factor by which the damping grows after the next failed step, (G,)."""
    running: BoolArray
    """Groups that have not ended, (G,)."""

    @classmethod
    def at(cls, start: Evaluation, damping: float) -> _Batch:
        """All frames at their start; those whose cost is not finite have ended."""
        groups = Groups.of(start.problem)
        cost = groups.sum(start.cost)
        running = np.isfinite(cost)
        return cls(
            np.arange(len(start.theta)),
            start.problem,
            groups,
            start.theta,
            start.gradient,
            start.hessian,
            start.coupling,
            np.where(running, cost, 0.0),
            np.full(len(cost), damping),
            np.full(len(cost), 2.0),
            running,
        )

    def frames(self, groups: BoolArray) -> IntArray:
        """Numbers of the frames of some groups (G,)."""
        return np.asarray(self.index[self.groups.spread(groups)])

    def without(self, ended: BoolArray) -> _Batch:
        """The batch in which some groups (G,) have ended."""
        return replace(self, running=self.running & ~ended)

    def step(self, bounds: Bounds) -> tuple[Array, Array]:
        """The damped step (B, P) within the bounds, and the predicted change of the cost, (G,)."""
        at, shared, groups = self.theta[:, bounds.free], self.problem.layout.shared, self.groups
        gradient, hessian = self.gradient, self.hessian
        # parameters at a bound that would leave it are held: they are taken out of the linear system
        held = ((at <= bounds.least) & (gradient > 0.0)) | ((at >= bounds.largest) & (gradient < 0.0))
        step = block_arrow_steps(hessian, gradient, groups.spread(self.damping), held, shared, groups, self.coupling)
        shorter = groups.reduced(np.maximum, np.max(np.abs(step) / bounds.longest, axis=1))
        step /= groups.spread(np.maximum(shorter, 1.0))[:, None]
        step = np.clip(at + step, bounds.least, bounds.largest) - at
        curvature = _times(hessian, self.coupling, step, shared)
        return step, groups.sum(np.sum(step * (gradient + 0.5 * curvature), axis=1))

    def compacted(self, step: Array, predicted: Array) -> tuple[_Batch, Array, Array]:
        """The batch without ended groups, if these are many, with its steps and predictions."""
        kept = self.running
        if np.count_nonzero(kept) >= COMPACTED * len(kept):
            return self, step, predicted
        frames = np.flatnonzero(self.groups.spread(kept))
        of_frames = {name: getattr(self, name)[frames] for name in ("index", "theta", "gradient", "hessian")}
        of_groups = {name: getattr(self, name)[kept] for name in ("cost", "damping", "growth", "running")}
        problem, groups = self.problem.take(frames), self.groups.take(frames)
        return replace(self, problem=problem, groups=groups, **of_frames, **of_groups), step[frames], predicted[kept]

    def after(self, trial: Evaluation, better: BoolArray, predicted: Array) -> _Batch:
        """The batch after a trial that groups `better` (G,) accept, with the damping of Nielsen's rule."""
        trial_cost, taken = self.groups.sum(trial.cost), self.groups.spread(better)
        gain = (self.cost - trial_cost) / np.maximum(-predicted, 1e-300)
        shrink = np.maximum(1.0 / 9.0, 1.0 - (2.0 * np.clip(gain, 0.0, 1.0) - 1.0) ** 3)
        failed = self.running & ~better  # groups that have ended keep their damping
        less, more = np.maximum(self.damping * shrink, LEAST_DAMPING), self.damping * self.growth
        return replace(
            self,
            theta=np.where(taken[:, None], trial.theta, self.theta),
            gradient=np.where(taken[:, None], trial.gradient, self.gradient),
            hessian=np.where(taken[:, None, None], trial.hessian, self.hessian),
            # coupled frames are one group
            coupling=trial.coupling if taken.any() else self.coupling,
            cost=np.where(better, trial_cost, self.cost),
            damping=np.where(better, less, np.where(failed, more, self.damping)),
            growth=np.where(better, 2.0, np.where(failed, 2.0 * self.growth, self.growth)),
        )


def _compiled_solution(
    start: Evaluation, max_iterations: int, tolerance: float, initial_damping: float
) -> Solution | None:
    """`levenberg_marquardt` where Numba is installed and frames share nothing; None otherwise."""
    problem, layout = start.problem, start.problem.layout
    module = kernels(layout, problem.observations)
    is_independent = problem.group is None or Groups.of(problem).is_trivial
    if module is None or not is_independent or problem.background or problem.path:
        return None
    theta, bounds, terrain = unknowns(layout, start.theta), layout.bounds(problem.scale), problem.terrain(start.theta)
    converged, iterations = np.zeros(len(problem), dtype=bool), np.zeros(len(problem), dtype=np.intp)
    points = no_points(problem.observations)
    module.levenberg_marquardt(
        *compiled_cost(module, problem, theta, terrain),
        bounds,
        module.Criteria(max_iterations, tolerance, initial_damping),
        theta,
        converged,
        iterations,
        points,
    )
    solved = start.theta.copy()
    solved[:, : theta.shape[1]] = theta
    return Solution(Evaluation(problem, solved, points), converged, iterations)


def compiled_cost(
    module: ModuleType, problem: Problem, theta: Array, terrain: Terrain | None = None
) -> tuple[Any, Any]:
    """The cost of a problem as arguments of `fieldcalib.problem.compiled`: `Frames` and `Terms`."""
    layout, prior = problem.layout, problem.prior or GaussianPrior(theta, np.ones_like(theta))
    terms = module.Terms(
        module.loss_of(problem.loss),
        module.loss_of(LENS_TAILS),
        problem.prior is not None,
        np.ascontiguousarray(prior.mean),
        np.ascontiguousarray(prior.sigma),
        np.flatnonzero(layout.free),
        np.log(layout.image_size[0]) + np.array(LOG_F_RANGE),
    )
    return packed_frames(module, layout, problem.observations, terrain, problem.noise), terms


def block_arrow_steps(
    hessian: Array,
    gradient: Array,
    damping: Array,
    held: BoolArray,
    shared: BoolArray,
    groups: Groups,
    coupling: Coupling | None = None,
) -> Array:
    """Damped Gauss-Newton steps (B, P) of frames that share the parameters `shared` (P,) within their group.

    Parameters
    ----------
    hessian : (B, P, P) array
    gradient : (B, P) array
    damping : (B,) array
        Share of the Hessian's diagonal that is added to it.
    held : (B, P) bool array
        Parameters that do not move.
    shared : (P,) bool array
    groups : Groups
    coupling : Coupling, optional
        Hessian between the own parameters of frames, which are one group.
    """
    diagonal = np.arange(hessian.shape[1])
    damped = hessian.copy()
    damped[:, diagonal, diagonal] += damping[:, None] * (hessian[:, diagonal, diagonal] + LEAST_DIAGONAL)
    downhill = np.where(held, 0.0, -gradient)
    if held.any():
        damped = np.where(held[:, :, None] | held[:, None, :], 0.0, damped)
        damped[:, diagonal, diagonal] += held
    if coupling is not None:
        moves = ~held[:, ~shared]
        blocks = coupling.blocks * moves[coupling.first][:, :, None] * moves[coupling.second][:, None]
        coupling = coupling._replace(blocks=blocks)
    elif not shared.any():
        return np.asarray(np.linalg.solve(damped, downhill[..., None])[..., 0])
    own = ~shared
    H_st = damped[:, shared][:, :, own]
    following, alone = eliminated(damped, downhill, own, coupling)
    border = groups.sum(damped[:, shared][:, :, shared] - H_st @ following)
    right = groups.sum(downhill[:, shared] - (H_st @ alone[..., None])[..., 0])
    # at absurd cameras derivatives differ by many magnitudes
    unit = np.sqrt(np.abs(np.diagonal(border, axis1=1, axis2=2)))[..., None]
    scaled = border / (unit * np.swapaxes(unit, 1, 2))
    ds = groups.spread((np.linalg.solve(scaled, right[..., None] / unit) / unit)[..., 0])
    step = np.empty_like(downhill)
    step[:, shared] = ds
    step[:, own] = alone - (following @ ds[..., None])[..., 0]
    return step


def eliminated(
    hessian: Array, downhill: Array, own: BoolArray, coupling: Coupling | None = None
) -> tuple[Array, Array]:
    """``H_tt^-1 H_ts`` (B, P_t, P_s) and ``H_tt^-1 downhill_t`` (B, P_t), where t are the frames' `own` parameters.

    With a coupling, H_tt is the matrix of all frames together.
    """
    H_tt, H_ts = hessian[:, own][:, :, own], hessian[:, own][:, :, ~own]
    right = np.concatenate([H_ts, downhill[:, own, None]], axis=-1)
    solved = np.linalg.solve(H_tt, right) if coupling is None else _solved_together(H_tt, coupling, right)
    return solved[..., :-1], solved[..., -1]


def _solved_together(blocks: Array, coupling: Coupling, right: Array) -> Array:
    """Solve the system of all frames, with the blocks (B, o, o) on its diagonal, for right sides (B, o, k).

    Frames are tied to others near them, so that the matrix is a band: its Cholesky factor is found without BLAS, whose
    threads wait for one another longer than such a small system takes.
    """
    from scipy.linalg import solveh_banded  # a slow import

    whole, columns = coupled(blocks, coupling), right.reshape(-1, right.shape[-1])
    width = blocks.shape[1] * (1 + int(np.max(np.abs(coupling.first - coupling.second), initial=0)))
    band = np.zeros((min(width, len(whole)), len(whole)))
    for k, diagonal in enumerate(band):
        diagonal[: len(whole) - k] = np.diagonal(whole, -k)
    try:
        return np.asarray(solveh_banded(band, columns, lower=True, check_finite=False)).reshape(right.shape)
    except np.linalg.LinAlgError:  # by rounding it is not positive definite
        return np.asarray(np.linalg.solve(whole, columns)).reshape(right.shape)


def coupled(blocks: Array, coupling: Coupling) -> Array:
    """The matrix (B o, B o) with the blocks (B, o, o) on its diagonal and those of the coupling beside it."""
    B, o = blocks.shape[:2]
    whole = np.zeros((B, B, o, o))
    whole[np.arange(B), np.arange(B)] = blocks
    np.add.at(whole, (coupling.first, coupling.second), coupling.blocks)
    np.add.at(whole, (coupling.second, coupling.first), np.swapaxes(coupling.blocks, 1, 2))
    return np.swapaxes(whole, 1, 2).reshape(B * o, B * o)


def _times(hessian: Array, coupling: Coupling | None, step: Array, shared: BoolArray) -> Array:
    """The Hessian times steps (B, P)."""
    product = np.asarray((hessian @ step[..., None])[..., 0])
    if coupling is not None:
        own = np.flatnonzero(~shared)
        first, second, blocks = coupling
        np.add.at(product, (first[:, None], own), (blocks @ step[second][:, own, None])[..., 0])
        np.add.at(product, (second[:, None], own), (np.swapaxes(blocks, 1, 2) @ step[first][:, own, None])[..., 0])
    return product


def least_squares(start: Evaluation, *, max_iterations: int, tolerance: float) -> Solution:
    """Minimise the cost of one frame, with the arguments of `levenberg_marquardt`.

    Parameters
    ----------
    start : Evaluation
        A problem of one frame at its initial camera.
    max_iterations : int
        Largest number of evaluations after the first.
    tolerance : float
        The solver stops when a step lowers the cost by less than this share.

    Returns
    -------
    Solution
    """
    import scipy.optimize  # a slow import

    problem, free = start.problem, start.problem.free
    weight = problem.observations.weight[0] / problem.noise**2
    if not np.isfinite(start.cost[0]):
        return Solution(start, np.array([False]), np.array([0], dtype=np.intp))
    bounds, theta, hessian = problem.layout.bounds(problem.scale), start.theta[0].copy(), start.hessian[0]
    theta[free] = np.clip(theta[free], bounds.least, bounds.largest)
    is_bounded = bool(np.any(np.isfinite([bounds.least, bounds.largest])))
    curvature, axes = (np.diag(hessian), np.eye(len(hessian))) if is_bounded else np.linalg.eigh(hessian)
    to_theta = axes / np.sqrt(np.maximum(curvature, LEAST_CURVATURE * np.max(curvature)))
    # where the Hessian is the identity, half of the squared gradient is the decrease of the cost that is left
    least_gradient = 0.0 if is_bounded else np.sqrt(2.0 * tolerance * start.cost[0] / len(curvature))

    @lru_cache(maxsize=2)  # SciPy asks for the residuals at a point, then for the Jacobian there
    def evaluated(y: bytes) -> Evaluation:
        moved = theta[None].copy()
        moved[0, free] += to_theta @ np.frombuffer(y)
        return start if np.array_equal(moved, start.theta) else evaluate(problem, moved)

    def residuals(y: Array) -> Array:
        at = evaluated(y.tobytes())
        r = np.concatenate([at.r[0], problem.prior_residuals(at.theta)[0]])
        # SciPy takes a shorter step where residuals are not finite
        return r if problem.is_possible(at.theta)[0] else np.full_like(r, np.inf)

    def jacobian(y: Array) -> Array:
        at = evaluated(y.tobytes())
        J = at.JT[0].T
        J = J if at.prior is None else np.concatenate([J, np.diag(1.0 / at.prior.sigma[0])])
        return np.asarray(J @ to_theta)

    def rho(squared: Array) -> Array:
        values = np.zeros((3, len(squared)))  # the last row, rho'', stays zero: no correction of second order
        values[:2, : len(weight)] = weight * problem.loss.evaluate(squared[: len(weight)])
        if problem.prior is not None:
            values[:2, len(weight) :] = prior_costs(squared[len(weight) :], problem.layout)
        return values

    with np.errstate(all="ignore"):
        found = scipy.optimize.least_squares(
            residuals,
            np.zeros(len(curvature)),
            jacobian,
            bounds=[(bound - theta[free]) / np.abs(np.diag(to_theta)) for bound in (bounds.least, bounds.largest)],
            x_scale="jac",
            loss=rho,
            ftol=tolerance,
            xtol=1e-15,
            gtol=max(least_gradient, 1e-15),
            max_nfev=max_iterations + 1,  # the start counts here
        )
    return Solution(
        evaluated(found.x.tobytes()), np.array([found.status > 0]), np.array([found.nfev - 1], dtype=np.intp)
    )
