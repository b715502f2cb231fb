"""Frames of one camera while they are calibrated together.

    frames one by one -> the place of the tripod -> every frame from there -> all together -> every frame again

A camera that moves has a smooth path instead of one place (`fieldcalib.solve.centres`).

What frames share are blocks that stand once (`fieldcalib.problem.layout`); pan, tilt, roll and zoom are each frame's
own, and eliminated (`fieldcalib.problem.levenberg_marquardt`). A few hundred frames tell what is shared as well as all
of them, since paint and lens law are wrong by more than noise leaves; the others follow, each by itself. So the time is
linear in the number of frames.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from fieldcalib._types import Array, BoolArray, IntArray
from fieldcalib.assess.crown import moment_of_crown
from fieldcalib.assess.misfit import inflation, is_contradicted, is_of_wrong_model, misfit
from fieldcalib.assess.noise import pooled_noise
from fieldcalib.assess.own_errors import OwnErrors, own_errors
from fieldcalib.assess.result import Calibration, Status
from fieldcalib.assess.sequence import LARGEST_ERROR, SequenceCalibration
from fieldcalib.assess.shared import by_considered, shared_covariance
from fieldcalib.fields.segments import ObjectSegments
from fieldcalib.problem.background import BackgroundEvaluation, BackgroundPairs
from fieldcalib.problem.evaluation import Evaluation, Problem
from fieldcalib.problem.labelled_pixels import ImageSegments, Pixels, PixelWeights, Weights
from fieldcalib.problem.layout import CENTER, FIELD_SIZE, LOG_F, Layout, Role, SizeBlock, ZoomLaw
from fieldcalib.problem.levenberg_marquardt import levenberg_marquardt
from fieldcalib.problem.losses import LossName, RobustLoss
from fieldcalib.problem.observations import pack
from fieldcalib.problem.prior import gaussian_priors
from fieldcalib.problem.smooth_path import SmoothPath
from fieldcalib.solve.batch import CHUNK, calibrate_frames, checked_frames
from fieldcalib.solve.centres import ACCELERATION, expected_centres, near_path, on_path, voted_centres
from fieldcalib.solve.frame_columns import FrameColumns
from fieldcalib.solve.given_camera import NOTHING_GIVEN, GivenCamera
from fieldcalib.solve.initial_cameras import given_cameras
from fieldcalib.solve.options import (
    CalibrationFlags,
    Options,
    Prior,
    default_flags,
)
from fieldcalib.solve.shared_starts import SAME, WIDTHS, elsewhere, followed, narrowing
from fieldcalib.solve.solved_together import SolvedTogether, Start
from fieldcalib.solve.task import Task
from fieldcalib.solve.ties import Matched, Ties, contradicted, with_tied
from fieldcalib.solve.together import labels_of, put_together
from fieldcalib.solve.tripod import KnownTripod, Labels, PixelNoise

SIZE = "field size"
SHARED = ("centre", "principal point", "lens", "zoom law", SIZE)
SHARED_IN_MOTION = SHARED[1:]  # by the frames of a camera that moves
FIRST = 60  # frames that are calibrated one by one, to find the place of the tripod
TOGETHER = 400  # frames that are solved together,
TIED_TOGETHER = 100  # and that if matches tie them: these make one system of all of them
NO_NOISE = PixelNoise(1.0, 1.0)
ROUNDS = 3  # of solving together, and every frame again
TOLD = 0.4  # m: standard deviation of length or width; clips that show a penalty area and the middle tell it to 0.2
MOST_CENTRES = 2  # that frames vote for, from which they are solved together where one of them does not explain all
OTHER_SIZES = ((0.0, 0.0), (0.0, -3.0), (0.0, 3.0))  # m: of starts, beside the given size
RUNS = 4  # of frames; without one of them the others may agree
OFF_PATH = "its centre is not where the frames around it let it be"


def sequence_solver(
    object_segments: ObjectSegments,
    frames: Iterable[ImageSegments],
    image_size: tuple[int, int],
    *,
    flags: int | None,
    prior: Prior,
    loss: LossName | RobustLoss,
    trust_labels: bool,
    weights: Iterable[Weights] | None,
    shared: Sequence[str],
    paint: float,
    matches: Matched | None,
    given: GivenCamera = NOTHING_GIVEN,
) -> SequenceSolver:
    """The checked arguments of `calibrate_sequence`, before anything is solved."""
    if isinstance(shared, str):
        raise ValueError(f"shared must be a sequence of names, got the name {shared!r}: did you mean ({shared!r},)?")
    unknown = set(shared) - set(SHARED)
    if unknown:
        raise ValueError(f"frames cannot share {sorted(unknown)}: expected some of {', '.join(SHARED)}")
    if flags is None:
        flags = default_flags(prior) & ~CalibrationFlags.CALIB_FIX_K2
    task = Task(object_segments, given, flags, prior=prior, loss=loss, paint=paint, trust_labels=trust_labels)
    options = task.options(image_size)
    pixels, pixel_weights = checked_frames(object_segments, frames, weights, options.image_size)
    ties = Ties.of(object_segments, matches or {}, len(pixels), options.image_size)
    return SequenceSolver(object_segments, pixels, pixel_weights, ties, options, tuple(shared), trust_labels)


class SequenceSolver:
    """The frames of one tripod while they are calibrated."""

    def __init__(
        self,
        object_segments: ObjectSegments,
        frames: list[Pixels],
        weights: list[PixelWeights | None],
        ties: Ties,
        options: Options,
        shared: tuple[str, ...],
        trust_labels: bool,
    ) -> None:
        self.object_segments = object_segments
        self.frames = frames
        self.weights = weights
        self.ties = ties
        self.options = options
        self.shared = shared
        self.trust_labels = trust_labels
        self.moves = "centre" not in shared
        self.tripod: KnownTripod | None = None  # when it was found
        # variance of what the frames hardly tell of length and width, or are not asked: these stay as they are given
        is_asked = SIZE in shared or options.layout.field_size is None
        self.not_asked: dict[str, float] = {} if is_asked else dict.fromkeys(FIELD_SIZE, np.inf)
        self.kept = self.not_asked
        self.first: dict[int, Calibration] = {}  # some frames by themselves
        self.left_out: dict[int, float] = {}  # frames whose labels contradict the others, and their misfit, pixels
        self.alternatives: tuple[Array, ...] = ()  # other places of the tripod that explain the labels as well

    def calibrated(self, before: SequenceCalibration | None = None) -> SequenceCalibration:
        """All frames, from a calibration of the same frames if there is one."""
        if before is not None and before.together:
            assert before.layout is not None
            cameras = {int(t): before.frames.theta[t] for t in np.flatnonzero(before.usable)}
            return self.calibrated_from(before.layout, cameras, before)
        some = self._solved_together()
        start = self._start(some)
        if start is None:
            return self.one_by_one()
        together = self._together_but_hardly_told(some, start)
        if self._may_be_elsewhere and is_of_wrong_model(together.misfit.excess, self.options.layout.image_size):
            together = self._from_other_starts(some, together)
        for _ in range(ROUNDS - 1):
            count = together.labelled
            tripod = self._known(together)
            again = self._alone(some, tripod.options, together.cameras)
            start = self._start_of(again)
            if start is None:
                break
            together = self._together(some, start)
            if together.labelled == count:
                break
        return self._every(together)

    def _start(self, some: IntArray) -> Start | None:
        """Cameras of some frames, from the place that they agree on or along a path; None if there is none."""
        if self.moves:
            return self._start_of(self._alone(some, self.options))
        if not np.any(self.options.layout.free[CENTER]):
            return self._start_of(self._alone(some, self.options))
        self.first = self._alone(self._spread(FIRST), self.options)
        voted = voted_centres([c for c in self.first.values() if c.accepted], 1)
        return self._start_of(self._alone(some, self._from_there(voted[0]))) if voted else None

    def _from_there(self, centre: Array) -> Options:
        """The options with a known centre (3,)."""
        is_pose = np.arange(len(self.options.known)) < CENTER.stop
        known = np.where(is_pose & self.options.layout.free, np.nan, self.options.known)
        known[CENTER] = centre
        return replace(self.options, layout=self.options.layout.fixed("centre"), known=known)

    @property
    def _may_be_elsewhere(self) -> bool:
        """Whether the frames share a centre that is estimated."""
        return not self.moves and bool(np.any(self.options.layout.free[CENTER]))

    def _from_other_starts(self, some: IntArray, together: SolvedTogether) -> SolvedTogether:
        """The best solution of the labels from several places and sizes; that of before if none is better.

        Places are those that single frames vote for, and those of all frames but a run of them.
        """
        accepted = {t: c for t, c in self.first.items() if c.accepted}
        alone = Start.of(accepted)
        if alone is None:
            return together
        self.kept, sizes = self.not_asked, OTHER_SIZES[:1] if self.not_asked else OTHER_SIZES
        cameras = dict(zip(together.index.tolist(), together.evaluation.theta, strict=True))
        before = Start(together.layout, cameras, alone.labels)
        found = [self._of_all(some, before, ())]
        for centre in voted_centres(list(accepted.values()), MOST_CENTRES):
            found += [self._of_all(some, alone.moved(centre, size), WIDTHS) for size in sizes]
        for run in np.array_split(np.array(sorted(alone.theta)), RUNS):
            found.append(self._of_all(some, self._without(alone, run), ()))
        most = max(len(index) for index, _ in found)
        alike = [one for one in found if len(one[0]) == most]
        index, best = min(alike, key=lambda one: float(np.sum(one[1].cost)))
        cameras = dict(zip(index.tolist(), best.theta, strict=True))
        excess = misfit(best).excess
        wrong = is_contradicted(excess, self.options.layout.image_size)
        self.left_out = dict(zip(index[wrong].tolist(), excess[wrong].tolist(), strict=True))
        labels = {t: one for t, one in alone.labels.items() if t not in self.left_out}
        if not labels:
            return together
        solved = self._together_but_hardly_told(some, Start(best.problem.layout, cameras, labels))
        others = [
            self._together(some, Start(one.problem.layout, dict(zip(where.tolist(), one.theta, strict=True)), labels))
            for where, one in alike
            if np.linalg.norm(one.theta[0, CENTER] - best.theta[0, CENTER]) > SAME
        ]
        same = [one.evaluation for one in others if np.array_equal(one.index, solved.index)]
        self.alternatives = elsewhere(same, solved.evaluation, solved.covariance_if_level[:3, :3])
        return solved

    def _of_all(self, some: IntArray, start: Start, widths: Sequence[float]) -> tuple[IntArray, Evaluation]:
        """Frames solved together with all their labels, and which they are."""
        index, evaluation = self._before_together(some, start, agreeing=False)
        return index, narrowing(evaluation, widths, self.options.max_iterations, self.options.tolerance)

    def _without(self, start: Start, run: IntArray) -> Start:
        """What frames share as all but a run of them tell it, and cameras that follow."""
        theta = {t: one for t, one in start.theta.items() if t not in set(run.tolist())}
        if not theta:
            return start
        middle = np.median([one[CENTER] for one in theta.values()], axis=0)
        rest = start._replace(theta=theta).moved(middle, (0.0, 0.0))
        _, solved = self._of_all(np.array(sorted(theta)), rest, WIDTHS)
        layout = solved.problem.layout
        shared = layout.roles != Role.FRAME
        column = [layout.names.index(name) for name in start.layout.names]
        every = np.array([solved.theta[0]] * len(start.theta))
        every[:, column] = [start.theta[t] for t in sorted(start.theta)]
        every[:, shared] = solved.theta[0, shared]
        index = np.array(sorted(start.theta))
        again = start._replace(layout=layout, theta=dict(zip(index.tolist(), every, strict=True)))
        index, evaluation = self._before_together(index, again, agreeing=False)
        following = followed(evaluation, self.options.max_iterations)
        return again._replace(theta=dict(zip(index.tolist(), following.theta, strict=True)))

    def _start_of(self, alone: Mapping[int, Calibration]) -> Start | None:
        """The cameras of frames that were accepted by themselves, of a camera that moves those on its path."""
        accepted = {t: c for t, c in alone.items() if c.accepted and c.solved is not None and t not in self.left_out}
        return Start.of(on_path(accepted) if self.moves else accepted)

    def calibrated_from(
        self, layout: Layout, cameras: Mapping[int, Array], before: SequenceCalibration | None = None
    ) -> SequenceCalibration:
        """All frames, from cameras (n,) of some of them in the layout of an earlier solution; labels are trusted.

        Of frames that follow from those that are solved together the cameras of `before` are a start too.
        """
        labels = {t: self._labels(t, None) for t in cameras if self.frames[t]}
        some = self._solved_together()
        start = Start(layout, {t: cameras[t] for t in some.tolist() if t in cameras}, labels)
        if not any(t in labels for t in start.theta):
            return self.calibrated()
        return self._every(self._together_but_hardly_told(some, start), before)

    def _together_but_hardly_told(self, some: IntArray, start: Start) -> SolvedTogether:
        """Without what the frames hardly tell of the field's size."""
        together = self._together(some, start)
        hardly_told = self._hardly_told(together)
        self.kept = {**self.not_asked, **hardly_told}
        return self._together(some, start) if hardly_told else together

    def _spread(self, count: int) -> IntArray:
        """Up to `count` labelled frames, evenly spread, each the one with most labels of its part of the sequence."""
        labels = np.array([len(frame) for frame in self.frames], dtype=np.intp)
        parts = np.array_split(np.arange(len(labels)), min(count, max(len(labels), 1)))
        best = [part[np.argmax(labels[part])] for part in parts if len(part)]
        return np.array([t for t in best if labels[t]], dtype=np.intp)

    def _solved_together(self) -> IntArray:
        """The frames that are solved together: those that others are tied to, and labelled ones."""
        most = TIED_TOGETHER if len(self.ties) or self.moves else TOGETHER
        hubs = np.unique(self.ties.first)
        hubs = hubs[np.linspace(0, len(hubs), min(len(hubs), TOGETHER), endpoint=False, dtype=int)]
        return np.union1d(hubs, self._spread(most - len(hubs))) if len(hubs) < most else hubs

    def _alone(
        self,
        index: IntArray,
        options: Options,
        given: Mapping[int, Array] | None = None,
    ) -> dict[int, Calibration]:
        """Calibrations of labelled frames by themselves, from given cameras or, where there is none, from anywhere."""
        found: dict[int, Calibration] = {}
        given = given or {}
        labelled = [int(t) for t in index if self.frames[t]]
        for members in ([t for t in labelled if t in given], [t for t in labelled if t not in given]):
            if not members:
                continue
            calibrations = calibrate_frames(
                [self.frames[t] for t in members],
                [self.weights[t] for t in members],
                options,
                given=np.array([given[t] for t in members]) if members[0] in given else None,
            )
            found |= dict(zip(members, calibrations, strict=True))
        return found

    def _layout(self, reference: float) -> Layout:
        """Blocks of the frames together: what the flags fix stays fixed, what is shared is shared."""
        base, field = self.options.layout, self.options.field
        size = None
        if base.field_size is not None and field is not None:
            assert field.size_model is not None
            model = field.size_model
            size = SizeBlock(np.array([field.length, field.width]), model.sigma, model.limits, crown=model.crown)
        law = ZoomLaw(reference) if "zoom law" in self.shared and base.free[LOG_F] else None
        layout = Layout.of(base.image_size, base.lens, size, law)
        layout.roles[: base.lens_block.stop] = base.roles[: base.lens_block.stop]
        blocks = {*self.shared, *(("aspect",) if {"principal point", "lens"} & set(self.shared) else ())}
        for name in blocks & layout.blocks.keys():
            block = layout.blocks[name]
            layout.roles[block] = np.where(layout.roles[block] == Role.FRAME, Role.SHARED, Role.FIXED)
        if law is not None and (self.moves or not np.any(base.free[CENTER])):  # a known centre is that of projection
            layout.roles[layout.names.index("axis offset")] = Role.FIXED
        for name in self.kept:
            layout.roles[layout.names.index(name)] = Role.CONSIDERED
        return _law_of_what_is_free(layout)

    def _before_together(self, some: IntArray, start: Start, agreeing: bool = True) -> tuple[IntArray, Evaluation]:
        """The frames that are solved together, those that have a camera and those that are tied to them, at a start.

        Labels of frames whose cameras the ties contradict do not count if these must be `agreeing`.
        """
        labelled, old = np.array(sorted(start.theta)), start.layout
        theirs = np.array([start.theta[t] for t in labelled.tolist()])
        layout = self._layout(float(np.median(theirs[:, LOG_F])) if old.zoom_law is None else old.zoom_law.reference)
        theta, known = np.zeros((len(self.frames), layout.size)), np.zeros(len(self.frames), dtype=bool)
        column = {name: index for index, name in enumerate(old.names)}
        for index, name in enumerate(layout.names):
            if name in column:
                theta[labelled, index] = theirs[:, column[name]]
        is_shared = layout.roles == Role.SHARED
        is_same = layout.roles != Role.FRAME
        theta[:, is_same] = np.median(theta[np.ix_(labelled, is_same)], axis=0)
        known[labelled] = True
        labels = start.labels
        if len(self.ties):
            each = layout.with_roles_of(layout.roles == Role.SHARED, Role.CONSIDERED)
            theta, known, right = self._agreeing(theta, known, some, each)
            if agreeing:
                labels = {t: one for t, one in labels.items() if right[t]}
            some = some[known[some]]
        else:
            some = labelled
        stands = gaussian_priors(self.options.distributions, layout)
        prior = given_cameras(theta[some], stands).prior if self.options.use_prior else None
        together = put_together(
            self.object_segments,
            [labels.get(t, ({}, {})) for t in some.tolist()],
            self._problem(layout),
            layout,
            theta[some],
            prior,
            once=is_shared | layout.is_centre,
            background=self.ties.among(some),
            path=SmoothPath(some, ACCELERATION) if self.moves else None,
        )
        return some, together

    def _together(self, some: IntArray, start: Start) -> SolvedTogether:
        """Some frames solved together."""
        some, together = self._before_together(some, start)
        layout = together.problem.layout
        solved = levenberg_marquardt(
            together, max_iterations=self.options.max_iterations, tolerance=self.options.tolerance
        ).evaluation
        sigma, kappa = pooled_noise(solved)
        covariance, inverse = shared_covariance(solved, sigma, kappa)
        covariance = inflation(solved, covariance, inverse, kappa) * covariance
        kept = self._kept_variance(layout)
        if np.any(layout.is_crown):
            kept[-1, -1] = moment_of_crown(solved, sigma, kappa)
        by_kept = by_considered(solved, kappa, inverse)
        whole = np.block([[covariance + by_kept @ kept @ by_kept.T, by_kept @ kept], [kept @ by_kept.T, kept]])
        labelled = int(np.count_nonzero(np.any(solved.problem.observations.weight > 0.0, axis=1)))
        return SolvedTogether(some, solved, whole, PixelNoise(float(sigma[0]), float(kappa[0])), labelled)

    def _kept_variance(self, layout: Layout) -> Array:
        """Covariance (c, c) of what is kept of the field: what the frames tell of its size, or what is known anyway."""
        index = np.flatnonzero(layout.considered)
        if not len(index):
            return np.zeros((0, 0))
        assert self.options.layout.field_size is not None
        probability, sigma = self.options.layout.field_size.possibilities_with_crown
        known = probability @ np.square(sigma[:, index - layout.field_size_block.start])
        return np.diag(np.minimum(known, [self.kept.get(layout.names[k], np.inf) for k in index]))

    def _problem(self, layout: Layout) -> Problem:
        """That of no frame."""
        nothing = pack(self.object_segments, [], layout.image_size)
        options = self.options
        return Problem(nothing, layout, options.loss, options.noise, paint=options.paint, scale=options.scale)

    def _agreeing(
        self, theta: Array, known: BoolArray, some: IntArray, layout: Layout
    ) -> tuple[Array, BoolArray, BoolArray]:
        """Cameras (T, n) of known frames (T,) and of some that are tied to them, and which of the known ones are right.

        A wrong camera is found out by ties to other known ones, or to frames that these tie.
        """
        right = self.ties.agreeing(theta, known, layout)
        while True:
            tied, reached = with_tied(self.object_segments, self.ties, theta, right, some, layout, self.options.scale)
            contradicted = right & ~self.ties.agreeing(tied, reached, layout)
            if not np.any(contradicted):
                return tied, reached, right
            right = right & ~contradicted

    def _hardly_told(self, together: SolvedTogether) -> dict[str, float]:
        """Of length and width, what the frames hardly tell: estimated, it would absorb errors of lens and zoom.

        With it comes the mean square distance from what is given, as the frames tell it.
        """
        layout = together.layout
        sigma = np.full(layout.size, np.inf)
        sigma[layout.roles == Role.SHARED] = np.sqrt(np.diagonal(together.covariance_if_level))
        block = range(layout.size)[layout.field_size_block]
        theta = together.evaluation.theta[0]
        given = np.zeros(layout.size)
        if layout.field_size is not None:
            given[layout.field_size_block] = layout.field_size.given
        return {
            layout.names[index]: float(sigma[index] ** 2 + (theta[index] - given[index]) ** 2)
            for index in block
            if layout.free[index] and sigma[index] > TOLD
        }

    def _known(self, together: SolvedTogether) -> KnownTripod:
        """What the frames share, with its covariance."""
        layout, theta = together.layout, together.evaluation.theta[0]
        object_segments, field, size = self.object_segments, self.options.field, layout.field_size
        if size is not None and field is not None:
            length, width = theta[layout.field_size_block].tolist()
            object_segments = replace(field.resized(length, width), size_known=True)
            layout = replace(layout, field_size=size._replace(given=np.array([length, width])))
        is_shared, is_kept = layout.roles == Role.SHARED, layout.roles == Role.CONSIDERED
        considered = is_shared | is_kept
        both = np.concatenate([np.flatnonzero(is_shared), np.flatnonzero(is_kept)])
        every = np.zeros((layout.size, layout.size))
        every[np.ix_(both, both)] = together.whole
        options = replace(
            self.options,
            layout=layout.with_roles_of(considered, Role.CONSIDERED),
            known=np.where(layout.roles == Role.FRAME, np.nan, theta),
            object_segments=object_segments,
            considered=every[np.ix_(considered, considered)],
        )
        return KnownTripod(object_segments, options, together.noise)

    def _every(self, together: SolvedTogether, before: SequenceCalibration | None = None) -> SequenceCalibration:
        """All frames, from what some share; those that are tied from their cameras of before, if they had any."""
        self.tripod = tripod = self._known(together)
        options, object_segments = tripod.options, tripod.object_segments
        # where nothing links the frames, one that is accepted by itself needs no more
        follow = self.moves or len(self.ties) > 0
        columns = tripod.columns(len(self.frames), LARGEST_ERROR if follow else np.inf)
        done = np.zeros(len(self.frames), dtype=bool)
        theta, known = columns.theta.copy(), done.copy()
        if follow:
            each = together.evaluation.of(replace(together.evaluation.problem, layout=options.layout, group=None))
            errors = own_errors(each, *together.noise)
            apart = each.of(replace(each.problem, background=None, path=None))
            columns.fill(together.index, apart, errors, tied=together.is_tied, alone={})
            theta[together.index], done[together.index] = each.theta, True
            theta, known = theta.copy(), done.copy()
            if before is not None:
                again = before.usable & ~done & self.ties.some_tie
                theta[np.ix_(again, options.layout.free)] = before.frames.theta[np.ix_(again, options.layout.free)]
                theta[np.ix_(again, ~options.layout.free)] = each.theta[0, ~options.layout.free]
                known |= again
            every = np.arange(len(known))
            theta, known = with_tied(object_segments, self.ties, theta, known, every, options.layout, options.scale)
        rest = np.flatnonzero(~done)
        alone = self._alone(rest[~known[rest]], options)
        if not self.trust_labels:
            alone |= self._alone(rest[known[rest]], options, {t: theta[t] for t in rest[known[rest]].tolist()})
        if self.moves:
            accepted = {t: c for t, c in alone.items() if c.accepted and not known[t]}
            near = near_path(accepted, columns, done)
            alone |= {t: Calibration.without_camera(Status.IMPROBABLE, OFF_PATH) for t in accepted.keys() - near.keys()}
            for t, calibration in near.items():
                assert calibration.solved is not None
                theta[t], known[t] = calibration.solved.alone.evaluation.theta[0], True
        self._fill_alone(columns, {t: c for t, c in alone.items() if not known[t]}, together.noise)
        while len(layer := self._next(done, known)):
            for part in np.array_split(layer, -(-len(layer) // CHUNK)):
                pairs, first = self.ties.towards(part, columns.theta, done)
                alone = {t: c for t, c in alone.items() if t not in self._contradicted(part, pairs, alone)}
                of_first = OwnErrors(columns.errors.own[first], columns.errors.following[first])
                labels = [self._labels(t, alone.get(t)) for t in part.tolist()]
                centres = expected_centres(columns, done, part) if self.moves else None
                tripod.follow(columns, part, theta[part], labels, pairs, of_first, alone, centres)
            done[layer] = True
        known_misfit = dict(zip(together.index.tolist(), together.misfit.excess.tolist(), strict=True)) | self.left_out
        columns.set_misfit(known_misfit)
        is_shared = together.layout.roles == Role.SHARED
        return SequenceCalibration(
            columns.frames,
            tuple(np.array(together.layout.names)[is_shared].tolist()),
            together.evaluation.theta[0, is_shared],
            together.covariance,
            options.field,
            len(together.index),
            options.layout,
            tripod.considered,
            np.reshape(self.alternatives, (-1, 3)),
        )

    def _next(self, done: BoolArray, known: BoolArray) -> IntArray:
        """Frames that follow from those that are done: tied ones, and then those that are on the path only."""
        tied = self.ties.reached(done, ~known)
        return tied if len(tied) or not self.moves else np.flatnonzero(known & ~done)

    def _fill_alone(self, columns: FrameColumns, alone: Mapping[int, Calibration], noise: PixelNoise) -> None:
        """Frames that nothing ties, as they were calibrated; those that were solved together at a time."""
        parts: dict[int, list[int]] = {}
        for t, calibration in alone.items():
            if calibration.solved is None:
                columns.without_camera(t, calibration)
            else:
                parts.setdefault(id(calibration.solved.evaluation), []).append(t)
        for members in parts.values():
            solved = [one for t in members if (one := alone[t].solved) is not None]
            evaluation = solved[0].evaluation.take(np.array([one.frame for one in solved]))
            errors = own_errors(evaluation, *noise)
            columns.fill(np.array(members), evaluation, errors, tied=np.zeros(len(members), dtype=bool), alone=alone)

    def _contradicted(self, index: IntArray, pairs: BackgroundPairs, alone: Mapping[int, Calibration]) -> set[int]:
        """Which of some frames have a camera by themselves that most of their ties contradict."""
        number = [k for k, t in enumerate(index.tolist()) if t in alone and alone[t].solved is not None]
        if not number:
            return set()
        solved = [one for k in number if (one := alone[int(index[k])].solved) is not None]
        theta = np.concatenate([one.alone.evaluation.theta for one in solved])
        layout = solved[0].evaluation.problem.layout
        wrong = contradicted(BackgroundEvaluation(pairs.take(np.array(number)), layout, theta))
        return set(index[number][wrong].tolist())

    def _labels(self, t: int, alone: Calibration | None) -> Labels:
        """What frame t is solved from: its labels as the camera that was found by itself has them."""
        if self.trust_labels:
            frame, weights = self.frames[t], self.weights[t]
            return frame, {label: np.full(len(xy), 1.0 / len(xy)) for label, xy in frame.items()} | (weights or {})
        if alone is None or not alone.accepted or alone.solved is None:
            return {}, {}
        return labels_of(alone.solved.alone.evaluation)

    def one_by_one(self) -> SequenceCalibration:
        """Labelled frames by themselves, which share nothing."""
        alone = self._alone(np.arange(len(self.frames)), self.options)
        solved = [c.solved.alone for c in alone.values() if c.solved is not None]
        variance = np.zeros(2 * (int(np.count_nonzero(self.options.layout.considered)),))
        if self.options.layout.field_size is not None:
            probability, sigma = self.options.layout.field_size.possibilities_with_crown
            np.fill_diagonal(variance, probability @ np.square(sigma))
        options = replace(self.options, considered=variance)
        columns = KnownTripod(self.object_segments, options, NO_NOISE).columns(len(self.frames), np.inf)
        if solved:
            sigma, kappa = np.median([(u.bent_sigma, u.curvature) for u in (one.uncertainty for one in solved)], axis=0)
            self._fill_alone(columns, alone, PixelNoise(sigma, kappa))
        return SequenceCalibration(columns.frames, field=options.field, layout=options.layout, considered=variance)


def _law_of_what_is_free(layout: Layout) -> Layout:
    """Without the parts of the zoom law of what is fixed itself, or each frame's own."""
    if layout.zoom_law is None:
        return layout
    names, roles = layout.names, layout.roles.copy()
    for name, of in (("cx slope", "cx"), ("cy slope", "cy"), ("a1 slope", "a1"), ("a1 bend", "a1")):
        if of not in names or roles[names.index(of)] != Role.SHARED:
            roles[names.index(name)] = Role.FIXED
    return replace(layout, roles=roles)
