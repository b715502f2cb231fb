"""Further lens coefficients where the labels require them: k2, then k3 and the tangential coefficients; or a fisheye.

A coefficient is freed for the frames that it makes much more likely: the cost, a negative log-likelihood, must fall by
more than one for each coefficient (Akaike), and by `CERTAIN` beyond that.

Where the labels still lie beside their markings, or are bent as strongly as by a fisheye lens, the frame is calibrated
with that. Labels that miss their marking then cost at most as much as a wrong label: otherwise the lens would be bent
towards a few wrong ones.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from fieldcalib._types import Array, BoolArray, IntArray
from fieldcalib.geometry.camera import Camera
from fieldcalib.geometry.lens import FisheyeLens, lens_with
from fieldcalib.problem.evaluation import Evaluation, with_segment_ends
from fieldcalib.problem.layout import GaussianPrior, Layout, Role
from fieldcalib.problem.levenberg_marquardt import Solution, levenberg_marquardt
from fieldcalib.solve.request import Options
from fieldcalib.solve.solver_options import CERTAIN

LEVELS = (("k2",), ("k2", "k3", "p1", "p2"))
FISHEYE = ("a fisheye lens",)
WRONG_LABEL = 6.5  # cost of a label that another one of some twenty should replace (`fieldcalib.solve.mislabels`)
# Mean cost of the labels from which on the lens may be another one, that of a distance of 1.4 px; and a1 of barrel
# lenses that may be a fisheye as well. Cameras of 100 degrees have -0.12: k1 and k2 hide the difference but for 1 px.
MISFIT, STRONG = 1.0, -0.1


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


def as_fisheye(options: Options) -> Options:
    """The options with a fisheye lens whose coefficients are estimated."""
    old = options.layout
    return _with_layout(options, Layout.of(old.image_size, FisheyeLens(old.lens.rho), old.field_size))[0]


def _with_layout(options: Options, layout: Layout) -> tuple[Options, IntArray]:
    """Options with a layout of another lens, and the indices (n,) in it of those of their parameters that it has."""
    names, kept = options.layout.names, np.flatnonzero(np.isin(options.layout.names, layout.names))
    index = np.array([layout.names.index(names[k]) for k in kept])
    roles, known = layout.roles.copy(), np.zeros(layout.size)
    roles[index], known[index] = options.layout.roles[kept], options.known[kept]
    return replace(options, layout=replace(layout, roles=roles), known=known), index


def with_fisheye_lens(camera: Camera) -> Camera:
    """The camera with a fisheye lens like its own near the axis: ``tan(theta) = theta + theta^3 / 3 + ...``."""
    k = (camera.k[0] + 1.0 / 3.0, 0.0, 0.0, 0.0)
    return camera if camera.fisheye else Camera(camera.K, camera.R, camera.C, camera.image_size, k, fisheye=True)


def may_be_fisheye(evaluation: Evaluation) -> BoolArray:
    """Mask (B,) of the frames whose labels lie beside their markings, or whose lens bends them like a fisheye."""
    count = np.sum(evaluation.problem.observations.rank >= 0, axis=1)
    a1 = evaluation.theta[:, evaluation.problem.layout.lens_block.start]
    return np.asarray((np.sum(_label_costs(evaluation), axis=1) > MISFIT * count) | (a1 < STRONG))


def more_likely(fisheye: Evaluation, other: Evaluation) -> BoolArray:
    """Mask (B,) of the frames whose labels are certainly better explained by a fisheye lens than by another."""
    found, count = [], []
    for one in (fisheye, other):
        prior = 0.0 if one.prior is None else one.prior.cost
        cost = np.sum(_label_costs(one), axis=1) + prior
        found.append(np.where(one.problem.is_possible(one.theta) & np.isfinite(cost), cost, np.inf))
        count.append(np.count_nonzero(one.problem.free))
    return np.asarray(found[1] - found[0] > CERTAIN + count[0] - count[1])


def _label_costs(evaluation: Evaluation) -> Array:
    """Cost (B, L) of each label, at most that of a wrong one."""
    label, costs = evaluation.problem.observations.label, evaluation.costs
    found = np.zeros(evaluation.problem.observations.rank.shape)
    frame = np.broadcast_to(np.arange(len(label))[:, None], label.shape)
    np.add.at(found, (frame[label >= 0], label[label >= 0]), costs[label >= 0])
    return np.minimum(found, WRONG_LABEL)


def _solved_with(part: Part, freed: tuple[str, ...]) -> Part:
    """Solve the frames of a part with further lens coefficients."""
    layout = part.options.layout
    if any(name not in layout.blocks for name in freed):
        lens = lens_with({*layout.lens.opencv_names, *freed}, layout.lens.rho)
        layout = Layout.of(layout.image_size, lens, layout.field_size).fixed("lens")
    options, index = _with_layout(part.options, layout)
    layout = options.layout.with_roles(Role.FRAME, *freed)

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
    return replace(part, solution=solution, prior=prior, options=replace(options, layout=layout), freed=freed)


def _with_ends_anew(part: Part) -> Part:
    """Solve frames again after choosing the pixels past ends of segments by their present cameras."""
    options = part.options
    start = with_segment_ends(part.solution.evaluation, options.wide_loss.scale)
    solution = levenberg_marquardt(start, max_iterations=options.max_iterations, tolerance=options.tolerance)
    return replace(part, solution=solution)


def _take(part: Part, index: IntArray) -> Part:
    solution, prior = part.solution.take(index), part.prior.take(index)
    return replace(part, frames=part.frames[index], solution=solution, prior=prior)
