"""Joint solution of frames of one camera, with the covariance of the parameters that they share.

It starts from the cameras of frames that were solved one by one, as one problem with shared parameters (`joint_start`).

The ground of a field may be crowned: its middle is higher than its touchlines. Frames are first solved on a level
field. To first order their labels give an estimate h of the crown, with a variance v from the noise of the pixels and
the freedom of all shared parameters. Where v is small and h far from 0, the crown is estimated with the other shared
parameters. Otherwise the cameras stay those of a level field, and the second moment of the crown enters their
covariance: a priori a share of the fields is level; on the other fields the crown is normal around 0 with variance p
(`fieldcalib.fields.traits.Crown`). So h has variance v on a level field and ``p + v`` on the others, which gives the
posterior probabilities of both. Given that the field is not level, the second moment of its crown is
``(p / (p + v))^2 h^2 + p v / (p + v)``.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from fieldcalib._types import Array, BoolArray, IntArray
from fieldcalib.assess.ground import Considered, given_crown
from fieldcalib.assess.label_errors import misfit, pooled_noise
from fieldcalib.assess.result import Calibration
from fieldcalib.assess.sequence_errors import ReducedSystem
from fieldcalib.assess.size_evidence import possible_values
from fieldcalib.fields.field import Field, ObjectSegments
from fieldcalib.fields.ground import Ground
from fieldcalib.fields.traits import Crown
from fieldcalib.problem.evaluation import Evaluation, Problem, evaluate
from fieldcalib.problem.frame_ties import SmoothPath
from fieldcalib.problem.labelled_pixels import NO_PIXELS, PixelTable
from fieldcalib.problem.layout import CENTER, CROWN, LOG_F, Layout, Role, SizeBlock, ZoomLaw, gaussian_priors
from fieldcalib.problem.levenberg_marquardt import levenberg_marquardt
from fieldcalib.problem.observations import Observations, pack
from fieldcalib.solve.initial_cameras import given_cameras
from fieldcalib.solve.request import Options
from fieldcalib.solve.sequence.background_matches import with_tied
from fieldcalib.solve.sequence.sequence_problem import PixelNoise, SequenceProblem, SharedParameters
from fieldcalib.solve.sequence.tripod_position import ACCELERATION

# The parameter that each part of the zoom law changes; the part is fixed unless the frames share this parameter.
CHANGED = {"cx slope": "cx", "cy slope": "cy", "a1 slope": "a1", "a1 bend": "a1"}
LARGEST_SIZE_SIGMA = 0.4  # m: largest sigma of a size to be estimated; clips of a penalty area and the middle reach 0.2
OTHER_SIZE = 4.0  # sigmas from the given size at which it is estimated in any case: the given one would be wrong
LARGEST_CROWN_SIGMA = 0.15  # m: largest sigma of a crown to be estimated: less than the spread of crowns, 0.2
PROFILE = 0.06  # standard deviation of a crown by its profile, as a share: drawn roofs and parabolas are off by so much
RAISED = 3.0  # sigmas: least height of a crown that is estimated


def joint_evaluation(
    problem: Problem, object_segments: ObjectSegments, pixels: PixelTable, theta: Array, once: BoolArray
) -> Evaluation:
    """Evaluate the labelled pixels of T frames as one group at the cameras theta (T, n).

    Everything except the observations is taken from `problem`. Pixels past the end of a segment get no second residual,
    as annotators place ends too carelessly for estimates of shared parameters. The prior (T, n) of the parameters in
    the mask `once` (n,) counts once for all frames: that of a shared position, say, must not count in every frame.
    """
    layout, prior, count = problem.layout, problem.prior, pixels.count
    if prior is not None:
        prior = replace(prior, sigma=np.where(once, np.sqrt(count), 1.0) * prior.sigma)
    motion = object_segments.motion if isinstance(object_segments, Field) and layout.is_sized else None
    observations = Observations.of(object_segments, pixels, layout.image_size, motion)
    group = np.zeros(count, dtype=np.intp)
    return evaluate(replace(problem, observations=observations, prior=prior, group=group), theta)


class Start(NamedTuple):
    """Initial cameras of some frames for a joint solution."""

    layout: Layout
    theta: Mapping[int, Array]
    """Parameters (n,) by number of the frame."""
    labels: Mapping[int, PixelTable]
    """Labels of some of these frames."""

    @classmethod
    def of(cls, found: Mapping[int, Calibration]) -> Start | None:
        """Start from frames that were calibrated by themselves; None if none has a solution."""
        parts = {t: c.solved for t, c in found.items() if c.solved is not None}
        if not parts:
            return None
        layout = next(iter(parts.values())).evaluation.problem.layout
        theta = {t: part.evaluation.theta[part.frame] for t, part in parts.items()}
        return cls(layout, theta, {t: part.pixels for t, part in parts.items()})

    def moved(self, centre: Array, size: tuple[float, float]) -> Start:
        """Change the centre to another one (3,), and enlarge length and width of the field by `size`."""
        theta, model = {t: one.copy() for t, one in self.theta.items()}, self.layout.field_size
        for one in theta.values():
            one[CENTER] = centre
            if model is not None:
                block = self.layout.field_size_block
                one[block] = np.clip(one[block] + size, *model.limits)
        return self._replace(theta=theta)

    @property
    def is_level(self) -> bool:
        """Whether the cameras are those of a level field."""
        return not any(np.any(one[self.layout.crown_block]) for one in self.theta.values())

    @property
    def levelled(self) -> Start:
        """The cameras as a start on a level field."""
        return self._replace(theta={t: np.where(self.layout.is_crown, 0.0, one) for t, one in self.theta.items()})

    @property
    def frames(self) -> IntArray:
        """Numbers of the frames, ascending."""
        return np.array(sorted(self.theta), dtype=np.intp)

    @property
    def reference(self) -> float:
        """Reference log f of the zoom law: the layout's if it has one, otherwise the median over the frames."""
        law = self.layout.zoom_law
        return law.reference if law is not None else float(np.median([one[LOG_F] for one in self.theta.values()]))

    def in_layout(self, layout: Layout, count: int) -> Array:
        """Convert to cameras (count, n) in a joint layout, 0 for missing ones; shared parameters are medians.

        A size that is known here, and a crown of which nothing is known yet, are as given.
        """
        index, theta = self.frames, np.zeros((count, layout.size))
        if layout.field_size is not None:
            theta[:, layout.field_size_block] = layout.field_size.given
        _, columns, old = np.intersect1d(layout.names, self.layout.names, return_indices=True)
        theta[np.ix_(index, columns)] = np.array([self.theta[t] for t in index.tolist()])[:, old]
        same = layout.roles != Role.FRAME
        theta[:, same] = np.median(theta[np.ix_(index, same)], axis=0)
        return theta


class JointStart(NamedTuple):
    """Frames at the start of a joint solution."""

    frames: IntArray
    """Numbers of the frames, (B,)."""
    evaluation: Evaluation


def joint_start(
    problem: SequenceProblem,
    start: Start,
    fixed_sizes: Mapping[str, float],
    *,
    among: IntArray | None = None,
    agreeing: bool = True,
) -> JointStart:
    """Set up the joint problem of frames that have a camera, or are tied to a frame with one.

    Parameters
    ----------
    fixed_sizes : mapping of str to float
        As for `joint_layout`.
    among : int array, optional
        If frames are tied, numbers of the frames to choose from; by default those that are solved together.
    agreeing : bool
        Whether labels are used only of frames whose cameras the ties do not contradict.
    """
    options, ties = problem.options, problem.ties
    layout = joint_layout(problem, start.reference, fixed_sizes)
    theta, index, labels = start.in_layout(layout, len(problem)), start.frames, start.labels
    if len(ties):
        some = problem.solved_together if among is None else among
        known = np.zeros(len(problem), dtype=bool)
        known[index] = True
        # ties move each frame's own parameters only, so shared ones count as known here
        each = layout.with_roles_of(layout.roles == Role.SHARED, Role.CONSIDERED)
        theta, known, right = _without_contradicted(problem, theta, known, some, each)
        index = some[known[some]]
        if agreeing:
            labels = {t: one for t, one in labels.items() if right[t]}
    theta = theta[index]
    stands = given_cameras(theta, gaussian_priors(options.distributions, layout)).prior
    pixels = PixelTable.joined(options.object_segments, [labels.get(t, NO_PIXELS) for t in index.tolist()])
    path = SmoothPath(index, ACCELERATION) if problem.moves else None
    like = replace(
        options.problem(pack(options.object_segments, [], layout.image_size), stands if options.use_prior else None),
        layout=layout,
        background=ties.among(index),
        path=path,
    )
    once = (layout.roles == Role.SHARED) | layout.is_centre
    # on a tripod zoom and angles are alike from frame to frame; with the camera or a window that moves they change
    once[: CENTER.stop] |= not problem.moves and "principal point" in problem.shared
    return JointStart(index, joint_evaluation(like, options.object_segments, pixels, theta, once))


def _without_contradicted(
    problem: SequenceProblem, theta: Array, known: BoolArray, some: IntArray, layout: Layout
) -> tuple[Array, BoolArray, BoolArray]:
    """Remove known cameras that the ties contradict, and add cameras of tied frames.

    Returns the cameras (T, n), which of them are known (T,), and which of the given ones are right (T,). Wrong cameras
    are revealed by ties to other known frames, or to frames that are tied to these.
    """
    right = problem.ties.agreeing(theta, known, layout)
    while True:
        tied, reached = with_tied(problem.options, problem.ties, theta, right, some, layout)
        contradicted = right & ~problem.ties.agreeing(tied, reached, layout)
        if not np.any(contradicted):
            return tied, reached, right
        right = right & ~contradicted


def joint_layout(problem: SequenceProblem, reference: float, fixed_sizes: Collection[str]) -> Layout:
    """Layout of a frame with the shared parameters of all frames; parameters that the flags fix stay fixed.

    Parameters
    ----------
    reference : float
        Reference log f of the zoom law.
    fixed_sizes : collection of str
        Which of length, width and crown are kept at an uncertain value.
    """
    base = problem.options.layout
    law = ZoomLaw(reference) if "zoom law" in problem.shared and base.free[LOG_F] else None
    layout = Layout.of(base.image_size, base.lens, base.field_size, law)
    roles = layout.roles.copy()
    roles[: base.lens_block.stop] = base.roles[: base.lens_block.stop]
    shared = {*problem.shared, *(("aspect",) if {"principal point", "lens"} & set(problem.shared) else ())}
    for name in shared & layout.blocks.keys():
        block = layout.blocks[name]
        roles[block] = np.where(roles[block] == Role.FRAME, Role.SHARED, Role.FIXED)
    index = {name: k for k, name in enumerate(layout.names)}
    roles[layout.crown_block] = Role.SHARED
    for name in fixed_sizes:
        if name in index:
            roles[index[name]] = Role.CONSIDERED
    if law is not None:
        unshared = [part for part, of in CHANGED.items() if of not in index or roles[index[of]] != Role.SHARED]
        is_known = problem.moves or not np.any(base.free[CENTER])  # a known centre is the centre of projection
        for name in (*unshared, *(("axis offset",) if is_known else ())):
            roles[index[name]] = Role.FIXED
    return replace(layout, roles=roles)


class CrownEstimate(NamedTuple):
    """The crown that frames tell to first order, and its standard deviation, metres."""

    height: float
    sigma: float

    @property
    def is_raised(self) -> bool:
        """Whether frames tell that the ground is not level."""
        return self.height > RAISED * self.sigma

    @property
    def is_determined(self) -> bool:
        """Whether frames tell that the ground is not level, and by how much."""
        return self.is_raised and self.sigma < LARGEST_CROWN_SIGMA


def moment_of_crown(system: ReducedSystem, crown: Crown) -> float:
    """Posterior second moment of the crown of a field, square metres.

    Parameters
    ----------
    system : ReducedSystem
        Normal equations of the shared parameters and, last, the crown.
    crown : Crown
        Prior distribution.
    """
    offset = -system.inverse[-1:, -1] * system.gradient[-1]  # the gradient by all other parameters is 0
    weights, sigma = crown.possibilities
    found = possible_values(offset, system.covariance[-1:, -1:], np.asarray(weights), np.reshape(sigma, (-1, 1)))
    posterior = np.exp(found.log - np.max(found.log))
    return float(posterior @ found.moments[:, 0, 0] / np.sum(posterior))


@dataclass(frozen=True, eq=False)
class JointSolution:
    """B frames that were solved together."""

    index: IntArray
    """Numbers of the frames, (B,)."""
    evaluation: Evaluation
    considered: Considered
    """Covariance of the shared parameters and of a size that is not estimated, as considered parameters of a frame."""
    noise: PixelNoise
    fixed_sizes: Mapping[str, float]
    """Variances of length and width if these are not estimated."""
    left_out: Mapping[int, float] = field(default_factory=dict)
    """Misfit, pixels, of the frames whose labels contradict the others."""
    crown: CrownEstimate | None = None
    """The crown that the frames tell; None where it is no parameter."""
    misfit_if_level: Array | None = None
    """Misfit of each frame's labels on level ground, pixels (B,), from which the crown was estimated."""
    alternatives: Array = field(default_factory=lambda: np.zeros((0, 3)))
    """Other centres that explain the labels equally well, (A, 3)."""

    @property
    def layout(self) -> Layout:
        """Layout of the parameters of a frame."""
        return self.evaluation.problem.layout

    @cached_property
    def misfit(self) -> Array:
        """Misfit of the labels of each frame, pixels, (B,)."""
        return misfit(self.evaluation)

    @property
    def labelled(self) -> int:
        """Number of frames whose labels were used."""
        return int(np.count_nonzero(np.any(self.evaluation.problem.observations.weight > 0.0, axis=1)))

    @property
    def covariance(self) -> Array:
        """Covariance of the shared parameters, (S, S)."""
        return self.considered.covariance[self._shared]

    @property
    def _shared(self) -> tuple[IntArray, ...]:
        is_shared = self.layout.roles[self.considered.layout.considered] == Role.SHARED
        return np.ix_(is_shared, is_shared)

    @property
    def is_tied(self) -> BoolArray:
        """Mask (B,) of the frames that are tied to others."""
        pairs = self.evaluation.problem.background
        tied = np.zeros(len(self.index), dtype=bool)
        if pairs is not None:
            tied[pairs.first] = tied[pairs.second] = True
        return tied

    def shared_parameters(self, problem: SequenceProblem) -> SharedParameters:
        """Fix the shared parameters at their values, with their covariance, for the calibration of further frames."""
        layout, theta = self.considered.layout, self.evaluation.theta[0]
        object_segments, pitch, size = problem.object_segments, problem.options.field, layout.field_size
        if size is not None and pitch is not None:
            length, width = theta[layout.field_size_block].tolist()
            object_segments = replace(pitch if size.is_known else pitch.resized(length, width), size_known=True)
            height = float(np.sum(theta[layout.crown_block]))
            if height:
                object_segments = object_segments.with_ground(Ground(height))
            layout = replace(layout, field_size=size._replace(given=np.array([length, width]), height=height))
        options = replace(
            problem.options,
            layout=layout,
            known=np.where(layout.roles == Role.FRAME, np.nan, theta),
            task=replace(problem.options.task, object_segments=object_segments),
            considered=self.considered.covariance,
        )
        return SharedParameters(options, self.noise, self.considered.by_line)


def solved_together(problem: SequenceProblem, start: Start, fixed_sizes: Mapping[str, float]) -> JointSolution:
    """Solve frames together; length and width, if in `fixed_sizes`, are kept at their uncertain values."""
    options = problem.options
    index, evaluation = joint_start(problem, start, fixed_sizes)
    solved = levenberg_marquardt(
        _at_given_sizes(evaluation, options), max_iterations=options.max_iterations, tolerance=options.tolerance
    ).evaluation
    sigma, kappa = pooled_noise(solved)
    system, layout = ReducedSystem.of(solved, sigma, kappa), solved.problem.layout
    noise = PixelNoise(float(sigma[0]), float(kappa[0]))
    considered, crown = _considered(problem, system, solved, fixed_sizes), crown_of(system, layout, solved.theta[0])
    if crown is not None and np.any(layout.is_crown & layout.free):
        # a size that is not estimated makes it less certain; it is the last parameter
        crown = crown._replace(sigma=float(np.sqrt(considered.covariance[-1, -1])))
    return JointSolution(index, solved, considered, noise, fixed_sizes, crown=crown)


def _at_given_sizes(start: Evaluation, options: Options) -> Evaluation:
    """Frames on a field of the given size, as far as it is not estimated.

    Cameras that were solved on another one are moved with it, along what the labels leave open: otherwise all markings
    at one of its ends would be metres off.
    """
    problem, layout, theta = start.problem, start.problem.layout, start.theta.copy()
    block, is_kept = layout.field_size_block, layout.considered & ~layout.is_crown
    if layout.field_size is not None:
        theta[:, block] = np.where(is_kept[block], layout.field_size.given, theta[:, block])
    if np.array_equal(theta, start.theta):
        return start
    held = start.of(replace(problem, layout=layout.with_roles_of(is_kept, Role.SHARED))).held(is_kept, theta)
    moved = levenberg_marquardt(held, max_iterations=options.max_iterations, tolerance=options.tolerance).evaluation
    return evaluate(problem, np.where(is_kept, theta, moved.theta))


def solved_with_known_sizes(problem: SequenceProblem, start: Start) -> JointSolution:
    """Solve frames together; length, width and crown are estimated only if the frames determine them."""
    found = solved_on_its_ground(problem, start, problem.fixed_sizes)
    uncertain = _uncertain_sizes(found)
    return solved_on_its_ground(problem, start, {**problem.fixed_sizes, **uncertain}) if uncertain else found


def solved_on_its_ground(problem: SequenceProblem, start: Start, fixed_sizes: Mapping[str, float]) -> JointSolution:
    """Solve frames of a tripod with the crown of their field, if they determine it; otherwise on level ground.

    A camera that moves explains a crown by its path.
    """
    estimated = {name: variance for name, variance in fixed_sizes.items() if name not in CROWN}
    if not (start.is_level or problem.moves):
        found = solved_together(problem, start, estimated)
        if found.crown is not None and found.crown.is_determined:
            return found
    level = solved_together(problem, start.levelled, {**fixed_sizes, **dict.fromkeys(CROWN, np.inf)})
    if problem.moves or level.crown is None or not level.crown.is_determined:
        return level
    cameras = dict(zip(level.index.tolist(), level.evaluation.theta, strict=True))
    found = solved_together(problem, Start(level.layout, cameras, start.labels), estimated)
    is_better = found.crown is not None and found.crown.is_determined
    return replace(found, misfit_if_level=level.misfit) if is_better else level


def crown_of(system: ReducedSystem, layout: Layout, theta: Array) -> CrownEstimate | None:
    """The crown that frames tell: estimated, or to first order from level ground; None where it is no parameter.

    `system` has the shared and the considered parameters, the crown last.
    """
    if not np.any(layout.is_crown):
        return None
    roles = layout.roles[layout.with_roles_of(layout.roles == Role.SHARED, Role.CONSIDERED).considered]
    some = system.take(np.append(np.flatnonzero(roles[:-1] == Role.SHARED), len(roles) - 1)).determined
    height = theta[-1] if roles[-1] == Role.SHARED else -some.inverse[-1] @ some.gradient
    return CrownEstimate(float(height), float(np.sqrt(some.covariance[-1, -1])))


def _considered(
    problem: SequenceProblem, system: ReducedSystem, solved: Evaluation, fixed_sizes: Mapping[str, float]
) -> Considered:
    """Joint covariance of the shared parameters and of a size (and crown) that is not estimated but affects them."""
    layout = solved.problem.layout
    both = layout.with_roles_of(layout.roles == Role.SHARED, Role.CONSIDERED)
    roles = layout.roles[both.considered]
    s, c = np.flatnonzero(roles == Role.SHARED), np.flatnonzero(roles == Role.CONSIDERED)
    alone = system.take(s).determined
    kept = _kept_covariance(problem.options.layout.field_size or layout.field_size, layout, fixed_sizes)
    if np.any(layout.is_crown & layout.considered):
        assert layout.field_size is not None
        assert layout.field_size.crown is not None
        kept[-1, -1] = moment_of_crown(system.take(np.append(s, len(roles) - 1)), layout.field_size.crown)
    by_kept = -alone.inverse @ system.hessian[np.ix_(s, c)]
    covariance = np.zeros((len(roles), len(roles)))
    covariance[np.ix_(s, s)] = alone.covariance + by_kept @ kept @ by_kept.T
    covariance[np.ix_(s, c)] = by_kept @ kept
    covariance[np.ix_(c, s)] = covariance[np.ix_(s, c)].T
    covariance[np.ix_(c, c)] = kept
    if np.any(layout.is_crown & layout.free):
        covariance[-1, -1] += (PROFILE * solved.theta[0, -1]) ** 2
    labels, moved = solved.problem.observations.labels, np.zeros((len(roles), system.painted.shape[1]))
    moved[s] = alone.inverse @ alone.painted
    return Considered(both, covariance, {labels[k]: one for k, one in zip(system.lines, moved.T, strict=True)})


def _kept_covariance(size: SizeBlock | None, layout: Layout, fixed_sizes: Mapping[str, float]) -> Array:
    """Covariance (c, c) of length, width and crown if not estimated: the prior one, or the frames' if smaller."""
    index = np.flatnonzero(layout.considered)
    if not len(index):
        return np.zeros((0, 0))
    assert size is not None
    probability, sigma = size.possibilities_with_crown
    known = probability @ np.square(sigma[:, index - layout.field_size_block.start])
    return np.diag(np.minimum(known, [fixed_sizes.get(layout.names[k], np.inf) for k in index]))


def _uncertain_sizes(joint: JointSolution) -> dict[str, float]:
    """Find which of length and width the frames hardly determine; estimated, they would absorb errors of lens and zoom.

    A size that the frames contradict is not among them. The values are mean square differences from the given size,
    according to the frames.
    """
    layout, theta = joint.layout, joint.evaluation.theta[0]
    if layout.field_size is None:
        return {}
    sigma = np.full(layout.size, np.inf)
    of_crown = (layout.is_crown & layout.considered)[joint.considered.layout.considered]
    covariance = given_crown(joint.considered.covariance, of_crown)  # an unknown crown alone fixes no size
    sigma[layout.roles == Role.SHARED] = np.sqrt(np.diagonal(covariance[joint._shared]))
    block = range(layout.size)[layout.field_size_block]
    return {
        layout.names[k]: float(sigma[k] ** 2 + (theta[k] - given) ** 2)
        for k, given in zip(block, layout.field_size.given, strict=True)
        if layout.free[k] and sigma[k] > max(LARGEST_SIZE_SIGMA, abs(theta[k] - given) / OTHER_SIZE)
    }
