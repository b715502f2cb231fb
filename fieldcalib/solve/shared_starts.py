"""Several starts of what frames share: the best solution wins, and others that explain the labels as well are told of.

Place of the tripod, size of the field and lens trade off, so that frames together have several minima. Labels that
contradict a start are outliers to a narrow loss and never pull the solution out of its minimum. So the loss is wide at
first, where they do, and becomes narrow.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fieldcalib._types import Array
from fieldcalib.problem.evaluation import Evaluation
from fieldcalib.problem.layout import CENTER, Role
from fieldcalib.problem.levenberg_marquardt import FAR, levenberg_marquardt
from fieldcalib.problem.prior import GaussianPrior

WIDTHS = (25.0, 5.0)  # times the loss, one after the other: wrong starts leave lines 20 to 100 px off
FEW = 30  # iterations with each,
APPROACHED = 1e-3  # or share of the cost, at which the next loss takes over
HELD = 1e-6  # standard deviation, in any unit, of what is to stay
SAME = 0.3  # m: centres that are this near are the same minimum
APART = 11.3  # squared distance in standard deviations: 99 % of chi-squared with three degrees of freedom
AS_GOOD = 4.0  # difference in cost that noise explains: three standard deviations, a probability of one in fifty


def narrowing(start: Evaluation, widths: Sequence[float], max_iterations: int, tolerance: float) -> Evaluation:
    """The solution of frames together, with losses that are so many times wider first."""
    problem, found = start.problem, start
    for width in widths:
        wide = replace(problem, loss=replace(problem.loss, scale=width * problem.loss.scale))
        found = levenberg_marquardt(
            found.of(wide),
            max_iterations=min(FEW, max_iterations),
            tolerance=max(tolerance, APPROACHED),
            initial_damping=FAR,
        ).evaluation
    return levenberg_marquardt(found.of(problem), max_iterations=max_iterations, tolerance=tolerance).evaluation


def followed(start: Evaluation, max_iterations: int) -> Evaluation:
    """The frames' own parameters where what they share stays as it is."""
    layout, theta = start.problem.layout, start.theta
    prior = start.problem.prior or GaussianPrior(theta, np.full_like(theta, np.inf))
    held = layout.roles == Role.SHARED
    prior = GaussianPrior(np.where(held, theta, prior.mean), np.where(held, HELD, prior.sigma))
    problem = replace(start.problem, prior=prior)
    return narrowing(start.of(problem), WIDTHS, max_iterations, APPROACHED)


def elsewhere(found: Sequence[Evaluation], best: Evaluation, covariance: Array) -> tuple[Array, ...]:
    """Centres (3,) of other solutions that explain the same labels as well as the best one, of covariance (3, 3)."""
    others: list[Array] = []
    least, V = float(np.sum(best.cost)), covariance + SAME**2 * np.eye(3)
    for one in sorted(found, key=lambda one: float(np.sum(one.cost))):
        centre = one.theta[0, CENTER]
        away = [centre - known for known in (best.theta[0, CENTER], *others)]
        if all(way @ np.linalg.solve(V, way) > APART for way in away) and np.sum(one.cost) - least < AS_GOOD:
            others.append(centre)
    return tuple(others)
