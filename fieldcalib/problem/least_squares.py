"""SciPy's trust region reflective solver on one frame: the finish of single frames, and an independent check."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from fieldcalib._types import Array
from fieldcalib.problem.cost_term import prior_costs
from fieldcalib.problem.evaluation import Evaluation, evaluate
from fieldcalib.problem.levenberg_marquardt import Solution


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

    problem, theta, free = start.problem, start.theta, start.problem.free
    weight = problem.observations.weight[0] / problem.noise**2
    bounds = problem.layout.bounds(problem.scale)

    @lru_cache(maxsize=2)  # SciPy asks for the residuals at a point, then for the Jacobian there
    def evaluated(x: bytes) -> Evaluation:
        moved = theta.copy()
        moved[0, free] = np.frombuffer(x)
        return start if np.array_equal(moved, theta) else evaluate(problem, moved)

    def residuals(x: Array) -> Array:
        at = evaluated(x.tobytes())
        r = np.concatenate([at.r[0], problem.prior_residuals(at.theta)[0]])
        # SciPy takes a shorter step where residuals are not finite
        return r if problem.is_possible(at.theta)[0] else np.full_like(r, np.inf)

    def jacobian(x: Array) -> Array:
        at = evaluated(x.tobytes())
        J = at.JT[0].T
        return J if at.prior is None else np.concatenate([J, np.diag(1.0 / at.prior.sigma[0])])

    def rho(squared: Array) -> Array:
        values = np.zeros((3, len(squared)))  # the last row, rho'', stays zero: no correction of second order
        values[:2, : len(weight)] = weight * problem.loss.evaluate(squared[: len(weight)])
        if problem.prior is not None:
            values[:2, len(weight) :] = prior_costs(squared[len(weight) :], problem.layout)
        return values

    x = np.clip(theta[0, free], bounds.least, bounds.largest)
    if not np.isfinite(start.cost[0]):
        return Solution(start, np.array([False]), np.array([0], dtype=np.intp))
    with np.errstate(all="ignore"):
        found = scipy.optimize.least_squares(
            residuals,
            x,
            jacobian,
            bounds=(bounds.least, bounds.largest),
            x_scale="jac",
            loss=rho,
            ftol=tolerance,
            xtol=1e-15,
            gtol=1e-15,
            max_nfev=max_iterations + 1,  # the start counts here
        )
    return Solution(
        evaluated(found.x.tobytes()), np.array([found.status > 0]), np.array([found.nfev - 1], dtype=np.intp)
    )
