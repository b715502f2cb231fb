"""Start of a joint solution: cameras of frames that were solved one by one, as one problem with shared parameters."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from fieldcalib._types import Array, BoolArray, IntArray
from fieldcalib.assess.result import Calibration
from fieldcalib.fields.field import Field, ObjectSegments
from fieldcalib.problem.evaluation import Evaluation, Problem, evaluate
from fieldcalib.problem.labelled_pixels import NO_PIXELS, PixelTable
from fieldcalib.problem.layout import CENTER, LOG_F, Layout, Role, ZoomLaw, gaussian_priors
from fieldcalib.problem.observations import Observations, pack
from fieldcalib.problem.smooth_path import SmoothPath
from fieldcalib.solve.initial_cameras import given_cameras
from fieldcalib.solve.sequence.background_matches import with_tied
from fieldcalib.solve.sequence.sequence_problem import SequenceProblem
from fieldcalib.solve.sequence.tripod_position import ACCELERATION

# The parameter that each part of the zoom law changes; the part is fixed unless the frames share this parameter.
CHANGED = {"cx slope": "cx", "cy slope": "cy", "a1 slope": "a1", "a1 bend": "a1"}


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
        index, old = self.frames, {name: k for k, name in enumerate(self.layout.names)}
        theirs = np.array([self.theta[t] for t in index.tolist()])
        theta = np.zeros((count, layout.size))
        if layout.field_size is not None:
            theta[:, layout.field_size_block], theta[:, layout.crown_block] = layout.field_size.given, 0.0
        for column, name in enumerate(layout.names):
            if name in old:
                theta[index, column] = theirs[:, old[name]]
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
