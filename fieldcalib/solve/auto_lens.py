"""Further lens coefficients where the labels require them: k2, then k3 and the tangential coefficients.

A coefficient is freed for the frames that it makes much more likely: the cost, a negative log-likelihood, must fall by
more than one for each coefficient (Akaike), and by `CERTAIN` beyond that.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from fieldcalib._types import IntArray
from fieldcalib.geometry.lens import lens_with
from fieldcalib.problem.evaluation import Evaluation, with_segment_ends
from fieldcalib.problem.layout import Layout, Role
from fieldcalib.problem.levenberg_marquardt import Solution, levenberg_marquardt
from fieldcalib.problem.prior import GaussianPrior
from fieldcalib.solve.solver_options import CERTAIN, Options

LEVELS = (("k2",), ("k2", "k3", "p1", "p2"))


@dataclass(frozen=True, eq=False)
class Part:
    """Frames that were solved with the same lens."""

    frames: IntArray
    solution: Solution
    prior: GaussianPrior
    options: Options
    freed: tuple[str, ...] = ()
    """Lens coefficients estimated in addition to those that the user asked for."""


def with_required_lens(solution: Solution, prior: GaussianPrior, options: Options) -> Iterator[Part]:
    """Divide solved frames into parts, each solved with the lens coefficients that its labels require."""
    part = Part(np.arange(len(prior.mean)), solution, prior, options)
    for freed in LEVELS:
        more = _solved_with(part, freed)
        count = np.count_nonzero(more.options.layout.free) - np.count_nonzero(part.options.layout.free)
        better = part.solution.cost - more.solution.cost > CERTAIN + count
        if count == 0 or not np.any(better):
            continue
        yield _take(part, np.flatnonzero(~better))
        part = _with_ends_anew(_take(more, np.flatnonzero(better)))
    yield part


def _solved_with(part: Part, freed: tuple[str, ...]) -> Part:
    """Solve the frames of a part with further lens coefficients."""
    options = part.options
    layout = options.layout
    if any(name not in layout.blocks for name in freed):
        lens = lens_with({*layout.lens.opencv_names, *freed}, layout.lens.rho)
        layout = Layout.of(layout.image_size, lens, layout.field_size).fixed("lens")
    index = [layout.names.index(name) for name in options.layout.names]
    roles = layout.roles.copy()
    roles[index] = options.layout.roles
    layout = replace(layout, roles=roles).with_roles(Role.FRAME, *freed)

    start = part.solution.evaluation
    theta = np.zeros((len(start.theta), layout.size))
    mean, sigma = np.zeros_like(theta), np.ones_like(theta)
    mean[:, layout.lens_block], sigma[:, layout.lens_block] = layout.lens.mean, layout.lens.sigma
    theta[:, index], mean[:, index], sigma[:, index] = start.theta, part.prior.mean, part.prior.sigma
    prior = GaussianPrior(mean, sigma)
    problem = replace(start.problem, layout=layout, prior=None if start.problem.prior is None else prior)
    solution = levenberg_marquardt(
        Evaluation(problem, theta, start.points), max_iterations=options.max_iterations, tolerance=options.tolerance
    )
    known = np.zeros(layout.size)
    known[index] = options.known
    return replace(
        part, solution=solution, prior=prior, options=replace(options, layout=layout, known=known), freed=freed
    )


def _with_ends_anew(part: Part) -> Part:
    """Solve frames again after choosing the pixels past ends of segments by their present cameras."""
    options = part.options
    start = with_segment_ends(part.solution.evaluation, options.wide_loss.scale)
    solution = levenberg_marquardt(start, max_iterations=options.max_iterations, tolerance=options.tolerance)
    return replace(part, solution=solution)


def _take(part: Part, index: IntArray) -> Part:
    solution = part.solution
    solution = Solution(solution.evaluation.take(index), solution.converged[index], solution.iterations[index])
    return replace(part, frames=part.frames[index], solution=solution, prior=part.prior.take(index))
