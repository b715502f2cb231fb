"""`calibrate_sequence`: calibration of frames of one camera, whose shared parameters are estimated from all of them.

Over a shot the law by which principal point and lens follow the zoom, the size of the field and, on a tripod, the
centre are constant. The steps:

    frames one by one -> position of the tripod -> frames from there -> all together -> every frame again

A moving camera has a smooth path instead of one position (`fieldcalib.solve.sequence.tripod_position`).

Shared parameters are estimated once for all frames (`fieldcalib.problem.layout`); pan, tilt, roll and zoom belong to
each frame, and are eliminated (`fieldcalib.problem.levenberg_marquardt`). A few hundred frames determine the shared
parameters as well as all frames would, since errors of paint and zoom law then exceed those of noise; the other frames
are solved one by one. So the time is linear in the number of frames.

Errors of the position of the tripod, the size of the field and the lens compensate one another, so that the joint
problem has several minima. If frames contradict the first solution, it is therefore solved from several starts
(`best_of_other_starts`); the best solution wins, and other centres that fit equally well are its alternatives. Labels
that contradict a start are outliers under a narrow loss and cannot move the solution out of its minimum. Under a wide
loss they can, so the loss is wide at first and then narrowed.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from fieldcalib._types import Array, BoolArray, IntArray
from fieldcalib.assess.findings import Status
from fieldcalib.assess.frame_table import FrameTable
from fieldcalib.assess.label_errors import is_contradicted, is_of_wrong_model, misfit
from fieldcalib.assess.result import Calibration
from fieldcalib.assess.sequence_calibration import SequenceCalibration
from fieldcalib.assess.sequence_errors import OwnErrors
from fieldcalib.fields.field import ObjectSegments
from fieldcalib.problem.evaluation import Evaluation
from fieldcalib.problem.frame_ties import BackgroundPairs, BackgroundTerm
from fieldcalib.problem.labelled_pixels import ImageSegments, PixelTable, Weights
from fieldcalib.problem.layout import CENTER, Layout, Role
from fieldcalib.problem.levenberg_marquardt import FAR, levenberg_marquardt
from fieldcalib.problem.losses import LossName, RobustLoss
from fieldcalib.solve.batch import CHUNK, checked_batch
from fieldcalib.solve.request import Options, Task
from fieldcalib.solve.sequence.background_matches import Matched, contradicted, with_tied
from fieldcalib.solve.sequence.joint_solution import (
    JointSolution,
    JointStart,
    Start,
    joint_start,
    solved_on_its_ground,
    solved_together,
    solved_with_known_sizes,
)
from fieldcalib.solve.sequence.sequence_problem import (
    SHARED,
    PixelNoise,
    SequenceProblem,
    SharedParameters,
    SolvedFrames,
    solved_rows,
    table_without_cameras,
    without_camera,
)
from fieldcalib.solve.sequence.tripod_position import KnownCentres, expected_centres, near_path, on_path, voted_centres
from fieldcalib.solve.solver_options import CalibrationFlags, Prior, default_flags, paint_sigma

WIDTHS = (25.0, 5.0)  # factors of the scale of the loss, in turn: lines are 20 to 100 px off after wrong starts
FEW = 30  # largest number of iterations with each factor,
APPROACHED = 1e-3  # and relative decrease of the cost at which the next factor takes over
SAME = 0.3  # m: centres nearer to each other than this belong to the same minimum
APART = 11.3  # squared distance in standard deviations: 99 % of chi-squared with three degrees of freedom
AS_GOOD = 4.0  # difference in cost that noise explains: three standard deviations, a probability of one in fifty
MOST_CENTRES = 2  # centres with most votes from which frames are solved together
GIVEN_SIZE = (0.0, 0.0)  # m: length and width of a start, minus the given length and width
OTHER_SIZES = (GIVEN_SIZE, (0.0, -3.0), (0.0, 3.0))
RUNS = 4  # number of runs of consecutive frames: if one run is wrong, the others may agree without it
FIRST = 60  # number of frames that are calibrated one by one, to find the position of the tripod
ROUNDS = 3  # rounds of solving all together and then every frame again
OFF_PATH = "its centre is off the path of the frames around it"


def calibrate_sequence(
    object_segments: ObjectSegments,
    frames: Iterable[ImageSegments],
    image_size: tuple[int, int],
    *,
    flags: int | None = None,
    prior: Prior = "all",
    loss: LossName | RobustLoss = "cauchy",
    trust_labels: bool = False,
    weights: Iterable[Weights] | None = None,
    shared: Sequence[str] = SHARED,
    paint: float | None = None,
    matches: Matched | None = None,
    start: SequenceCalibration | None = None,
) -> SequenceCalibration:
    """Calibrate frames of one camera, which share its zoom law and, on a tripod, its centre.

    Parameters
    ----------
    object_segments : mapping of str to segment
        The calibration object, e.g. `soccer()`.
    frames : iterable of mappings of str to (N, 2) array_like
        Pixels of each frame, in any order unless the camera moves; frames without labels get a camera if `matches` tie
        them to others.
    image_size : (int, int)
        Width and height of every frame, pixels.
    flags, prior, loss, trust_labels, weights
        As in `calibrate_batch`. By default k2 is estimated too: frames together determine it.
    shared : sequence of str
        Names of the shared parameters: ``"centre"``, ``"principal point"``, ``"lens"``, ``"zoom law"`` and ``"field
        size"`` (unless it is known, or the frames hardly determine it). Other parameters belong to each frame, under
        their prior. Without a zoom law no parameter follows the zoom; a size that is not shared is the given one, with
        its prior uncertainty. Without the centre the camera moves on a smooth path: the frames must be in order, evenly
        spaced in time, at about 25 per second.
    paint : float, optional
        Standard deviation, in metres, of the position of a painted line as a whole, the same in all frames. By default
        a quarter of the width of the field's lines, 3 cm on a soccer pitch.
    matches : mapping of (int, int) to pair of (N, 2) array_like, optional
        Pixels of static points of the background in two frames, e.g. `first` and `second` of
        `fieldcalib.images.match_background`; None for a pair without matches. They tie frames without labels to frames
        that have some. Frames that come first in a pair are solved together; the others are solved from them.
    start : SequenceCalibration, optional
        Calibration of the same frames from fewer pixels, as initial cameras. The labels must be trusted.

    Returns
    -------
    SequenceCalibration
        A calibration for each frame, and the shared parameters. If no position of the tripod is found, the frames are
        calibrated one by one and share nothing.

    Raises
    ------
    ValueError
        As in `calibrate_batch`, for unknown names in `shared`, and for matches between frames that do not exist.

    References
    ----------
    Theiner, Ewerth: TVCalib, WACV 2023, whose tensors have a dimension T for frames of one camera.

    Examples
    --------
    >>> from fieldcalib import Camera, soccer
    >>> field, pans = soccer(size_known=True), (-0.3, -0.1, 0.1, 0.3)
    >>> cameras = [Camera.from_angles(pan, 1.35, 0.0, 1400.0, (0.0, 66.0, -16.0), (960, 540)) for pan in pans]
    >>> labels = ("Side line top", "Middle line", "Circle central", "Big rect. left main", "Big rect. right main")
    >>> frames = []
    >>> for camera in cameras:
    ...     seen = {label: camera.project(field[label].sample(2.0)) for label in labels}
    ...     inside = {label: xy[((xy > 0.0) & (xy < (959, 539))).all(axis=1)] for label, xy in seen.items()}
    ...     frames.append({label: xy for label, xy in inside.items() if len(xy) > 1})
    >>> found = calibrate_sequence(field, frames, (960, 540))
    >>> [str(frame.status) for frame in found]
    ['accepted', 'accepted', 'accepted', 'accepted']
    >>> found.values[1:3].round()  # y and z of the tripod
    array([ 66., -16.])
    """
    paint = paint_sigma(object_segments) if paint is None else paint
    task = Task(object_segments, flags=flags, prior=prior, loss=loss, paint=paint, trust_labels=trust_labels)
    if flags is None:
        task = replace(task, flags=default_flags(prior) & ~CalibrationFlags.CALIB_FIX_K2)
    options = task.options(image_size)
    checked = checked_batch(object_segments, frames, weights, options.image_size)
    problem = SequenceProblem.of(options, PixelTable.of(object_segments, *checked), shared, matches)
    if start is not None and not trust_labels:
        raise ValueError("start needs trust_labels=True: from there labels are not doubted again")
    if start is not None and len(start) != len(problem):
        raise ValueError(f"start must be a calibration of the same {len(problem)} frames, got {len(start)}")
    return solve_sequence(problem, start).calibration


def best_of_other_starts(
    problem: SequenceProblem, joint: JointSolution, alone: Mapping[int, Calibration]
) -> JointSolution:
    """Solve from several positions and sizes, and take the solution of least cost; `joint` if there is no other start.

    Positions are the one of `joint`, those that frames calibrated `alone` vote for, and those of all frames except one
    run of consecutive frames.
    """
    accepted = {t: c for t, c in alone.items() if c.accepted}
    voters = Start.of(accepted)
    if voters is None:
        return joint
    before = Start(joint.layout, _cameras(JointStart(joint.index, joint.evaluation)), voters.labels)
    found = [_solved(problem, before, ())]
    is_raised = joint.misfit_if_level is not None  # then the frames see so much that one size is enough to start from
    sizes = OTHER_SIZES if problem.estimates_size and not is_raised else (GIVEN_SIZE,)
    for centre in voted_centres(list(accepted.values()), MOST_CENTRES):
        found += [_solved(problem, voters.moved(centre, size), WIDTHS) for size in sizes]
    for run in np.array_split(voters.frames, RUNS):
        found.append(_solved(problem, _without(problem, voters, run), ()))
    # costs can be compared only among solutions of the same number of frames
    most = max(len(one.frames) for one in found)
    alike = [one for one in found if len(one.frames) == most]
    best = min(alike, key=lambda one: _cost(one.evaluation))
    excess = misfit(best.evaluation)
    wrong = is_contradicted(excess, problem.options.layout.image_size)
    left_out = dict(zip(best.frames[wrong].tolist(), excess[wrong].tolist(), strict=True))
    labels = {t: one for t, one in voters.labels.items() if t not in left_out}
    if not labels:
        return replace(joint, fixed_sizes=problem.fixed_sizes, left_out=left_out)
    solved = solved_with_known_sizes(problem, Start(best.evaluation.problem.layout, _cameras(best), labels))
    apart = [best]
    for one in sorted(alike, key=lambda one: _cost(one.evaluation)):
        centre = one.evaluation.theta[0, CENTER]
        if all(np.linalg.norm(centre - known.evaluation.theta[0, CENTER]) > SAME for known in apart):
            apart.append(one)
    others = [
        solved_together(problem, Start(one.evaluation.problem.layout, _cameras(one), labels), solved.fixed_sizes)
        for one in apart[1:]
    ]
    same = [one.evaluation for one in others if np.array_equal(one.index, solved.index)]
    alternatives = _other_centres(same, solved.evaluation, solved.covariance[:3, :3])
    return replace(solved, left_out=left_out, alternatives=np.reshape(alternatives, (-1, 3)))


def _solved(
    problem: SequenceProblem, start: Start, widths: Sequence[float], among: IntArray | None = None
) -> JointStart:
    """Solve frames together with all their labels, also labels of frames whose cameras the ties contradict."""
    index, evaluation = joint_start(problem, start, problem.fixed_sizes, among=among, agreeing=False)
    return JointStart(index, _narrowing(evaluation, widths, problem.options.max_iterations, problem.options.tolerance))


def _without(problem: SequenceProblem, start: Start, run: IntArray) -> Start:
    """Start from the shared parameters of all frames except a run of them; the cameras of the run are then solved."""
    left = {t: one for t, one in start.theta.items() if t not in set(run.tolist())}
    if not left:
        return start
    middle = np.median([one[CENTER] for one in left.values()], axis=0)
    rest = start._replace(theta=left).moved(middle, GIVEN_SIZE)
    solved = _solved(problem, rest, WIDTHS, rest.frames).evaluation
    layout, index = solved.problem.layout, start.frames
    shared = layout.roles != Role.FRAME
    theta = np.array([solved.theta[0]] * len(index))
    theta[:, [layout.names.index(name) for name in start.layout.names]] = [start.theta[t] for t in index.tolist()]
    theta[:, shared] = solved.theta[0, shared]
    again = start._replace(layout=layout, theta=dict(zip(index.tolist(), theta, strict=True)))
    index, evaluation = joint_start(problem, again, problem.fixed_sizes, among=index, agreeing=False)
    return again._replace(
        theta=_cameras(JointStart(index, _own_parameters_solved(evaluation, problem.options.max_iterations)))
    )


def _cameras(solved: JointStart) -> dict[int, Array]:
    return dict(zip(solved.frames.tolist(), solved.evaluation.theta, strict=True))


def _cost(evaluation: Evaluation) -> float:
    return float(np.sum(evaluation.cost))


def _narrowing(start: Evaluation, widths: Sequence[float], max_iterations: int, tolerance: float) -> Evaluation:
    """Solve frames together, first with losses whose scales are larger by the factors `widths`."""
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


def _own_parameters_solved(start: Evaluation, max_iterations: int) -> Evaluation:
    """Solve for the frames' own parameters; shared parameters are kept."""
    held = start.held(start.problem.layout.roles == Role.SHARED, start.theta)
    return _narrowing(held, WIDTHS, max_iterations, APPROACHED)


def _other_centres(found: Sequence[Evaluation], best: Evaluation, covariance: Array) -> list[Array]:
    """Other centres (3,) of solutions that fit as well as the best; `covariance` (3, 3) is that of the best centre."""
    others: list[Array] = []
    least, V = _cost(best), covariance + SAME**2 * np.eye(3)
    for one in sorted(found, key=_cost):
        centre = one.theta[0, CENTER]
        away = [centre - known for known in (best.theta[0, CENTER], *others)]
        if all(way @ np.linalg.solve(V, way) > APART for way in away) and _cost(one) - least < AS_GOOD:
            others.append(centre)
    return others


class SolvedSequence(NamedTuple):
    """Calibration of all frames, and the shared parameters for the calibration of further frames."""

    calibration: SequenceCalibration
    shared: SharedParameters | None
    """The shared parameters; None if the frames share nothing."""


def solve_sequence(problem: SequenceProblem, before: SequenceCalibration | None = None) -> SolvedSequence:
    """Calibrate all frames, from an earlier calibration of the same frames if there is one."""
    if before is not None and before.together:
        assert before.layout is not None
        cameras = {int(t): before.frames.theta[t] for t in np.flatnonzero(before.usable)}
        return solve_from_cameras(problem, before.layout, cameras, before)
    start, alone = _first_start(problem)
    if start is None:
        return SolvedSequence(calibrate_one_by_one(problem), None)
    joint = solved_with_known_sizes(problem, start)
    # a crown may hide that frames are at a wrong place, as mislabelled segments of some of them would have it
    excess = joint.misfit if joint.misfit_if_level is None else joint.misfit_if_level
    if problem.finds_centre and is_of_wrong_model(excess, problem.options.layout.image_size):
        joint = best_of_other_starts(problem, joint, alone)
    return _finished(problem, _with_more_labels(problem, joint))


def solve_from_cameras(
    problem: SequenceProblem, layout: Layout, cameras: Mapping[int, Array], before: SequenceCalibration | None = None
) -> SolvedSequence:
    """Calibrate all frames from cameras (n,) of some of them in the layout of an earlier solution; labels are trusted.

    Frames that are not solved together start from their cameras in `before`.
    """
    labels = {t: problem.fitted(t) for t in cameras if problem.pixels.has_pixels[t]}
    some = [t for t in problem.solved_together.tolist() if t in cameras]
    if not any(t in labels for t in some):
        return solve_sequence(problem)
    start = Start(layout, {t: cameras[t] for t in some}, labels)
    return _finished(problem, solved_with_known_sizes(problem, start), before)


def calibrate_one_by_one(problem: SequenceProblem) -> SequenceCalibration:
    """Calibrate labelled frames one by one, without shared parameters."""
    options = problem.options
    alone = problem.calibrate_alone(np.arange(len(problem)), options)
    found = [c.solved.alone.uncertainty for c in alone.values() if c.solved is not None]
    variance = options.layout.prior_moment
    noise = np.median([(one.robust_sigma, one.curvature) for one in found], axis=0) if found else np.ones(2)
    shared = SharedParameters(replace(options, considered=variance), PixelNoise(*noise.tolist()))
    table = table_without_cameras(shared, len(problem))
    if found:
        table = with_frames_alone(table, shared, alone, np.inf)
    return SequenceCalibration(table, field=options.field, layout=options.layout, considered=variance)


def _first_start(problem: SequenceProblem) -> tuple[Start | None, Mapping[int, Calibration]]:
    """Find cameras of some frames, at the position on which they agree or along a path; None if there is none.

    Also returns the calibrations, each by itself, of the frames that voted for that position.
    """
    if not problem.finds_centre:
        return _start_of(problem, problem.calibrate_alone(problem.solved_together, problem.options)), {}
    alone = problem.calibrate_alone(problem.spread(FIRST), problem.options)
    voted = voted_centres([c for c in alone.values() if c.accepted], 1)
    if not voted:
        return None, alone
    from_there = _with_known_centre(problem.options, voted[0])
    return _start_of(problem, problem.calibrate_alone(problem.solved_together, from_there)), alone


def _with_known_centre(options: Options, centre: Array) -> Options:
    """Fix the centre (3,) in options; other unknown parameters of the pose stay unknown."""
    is_pose = np.arange(len(options.known)) < CENTER.stop
    known = np.where(is_pose & options.layout.free, np.nan, options.known)
    known[CENTER] = centre
    return replace(options, layout=options.layout.fixed("centre"), known=known)


def _start_of(
    problem: SequenceProblem, alone: Mapping[int, Calibration], left_out: Mapping[int, float] | None = None
) -> Start | None:
    """Start from frames that were accepted by themselves; for a moving camera, only from frames on its path."""
    found = {t: c for t, c in alone.items() if c.accepted and c.solved is not None and t not in (left_out or {})}
    return Start.of(on_path(found) if problem.moves else found)


def _with_more_labels(problem: SequenceProblem, joint: JointSolution) -> JointSolution:
    """Solve again with the labels of further frames that are accepted now that the shared parameters are known.

    More frames may determine a size that the first ones did not.
    """
    for _ in range(ROUNDS - 1):
        shared, some = joint.shared_parameters(problem), problem.solved_together
        tied = {int(joint.index[k]): joint.evaluation.theta[k] for k in np.flatnonzero(joint.is_tied)}
        alone = problem.calibrate_alone(some, shared.options, tied)
        start = _start_of(problem, alone, joint.left_out)
        if start is None:
            break
        found = solved_on_its_ground(problem, start, joint.fixed_sizes)
        is_last = found.labelled == joint.labelled
        if found.labelled > joint.labelled and len(joint.fixed_sizes) > len(problem.fixed_sizes):
            found = solved_with_known_sizes(problem, start)
        joint = replace(found, left_out=joint.left_out, alternatives=joint.alternatives)
        if is_last:
            break
    return joint


def _finished(
    problem: SequenceProblem, joint: JointSolution, before: SequenceCalibration | None = None
) -> SolvedSequence:
    """Complete the calibration of all frames, given the frames that were solved together."""
    shared, given = joint.shared_parameters(problem), problem.options.field
    is_shared = joint.layout.roles == Role.SHARED
    sized = shared.options.field  # solved with as known, which it is only if a person says so
    calibration = SequenceCalibration(
        with_remaining_frames(problem, joint, shared, before),
        tuple(np.array(joint.layout.names)[is_shared].tolist()),
        joint.evaluation.theta[0, is_shared],
        joint.covariance,
        sized if sized is None or given is None else replace(sized, size_known=given.size_known),
        len(joint.index),
        shared.options.layout,
        shared.considered.covariance,
        joint.alternatives,
    )
    return SolvedSequence(calibration, shared)


@dataclass(frozen=True, eq=False)
class InitialFrames:
    """Initial cameras of T frames, and calibrations of frames by themselves."""

    theta: Array
    """Initial cameras, (T, n)."""
    known: BoolArray
    """Mask (T,) of the frames that have an initial camera."""
    alone: Mapping[int, Calibration]
    """Calibrations of labelled frames by themselves."""


def with_remaining_frames(
    problem: SequenceProblem, joint: JointSolution, shared: SharedParameters, before: SequenceCalibration | None = None
) -> FrameTable:
    """Make the table of all frames: frames solved together, and the others with the same shared parameters.

    Tied frames start from their cameras in `before`, if there are any.
    """
    table = table_without_cameras(shared, len(problem))
    done = np.zeros(len(problem), dtype=bool)
    if problem.is_linked:
        table = table.replaced(joint.index, solved_rows(shared, _each(joint, shared)))
        done[joint.index] = True
    initial = _initial_frames(problem, shared, table, done, before)
    if problem.moves:
        initial = _on_path(initial, KnownCentres.of(table, done, shared.considered))
    unlinked = {t: c for t, c in initial.alone.items() if not initial.known[t]}
    # if nothing links the frames, a frame that was accepted by itself is final, whatever its error
    table = with_frames_alone(table, shared, unlinked, None if problem.is_linked else np.inf)
    while len(layer := _next(problem, done, initial.known)):
        for part in np.array_split(layer, -(-len(layer) // CHUNK)):
            table = table.replaced(part, _followed(problem, shared, table, done, initial, part))
        done = done | np.isin(np.arange(len(done)), layer)
    excess = dict(zip(joint.index.tolist(), joint.misfit.tolist(), strict=True))
    return table.with_misfit({**excess, **joint.left_out})


def _each(joint: JointSolution, shared: SharedParameters) -> SolvedFrames:
    """Split the joint solution into frames, each as its own problem with its own errors."""
    linked = joint.evaluation.of(replace(joint.evaluation.problem, layout=shared.options.layout, group=None))
    each = linked.of(replace(linked.problem, background=None, path=None))
    return SolvedFrames(each, shared.errors(linked), joint.is_tied)


def _initial_frames(
    problem: SequenceProblem,
    shared: SharedParameters,
    table: FrameTable,
    done: BoolArray,
    before: SequenceCalibration | None,
) -> InitialFrames:
    """Find initial cameras of frames that are tied to solved ones, and calibrate labelled frames by themselves."""
    theta, known = table.theta.copy(), done.copy()
    options = shared.options
    if problem.is_linked:
        if before is not None:
            again = before.usable & ~done & problem.ties.is_tied
            theta[again] = np.where(options.layout.free, before.frames.theta[again], options.known)
            known |= again
        every = np.arange(len(known))
        theta, known = with_tied(options, problem.ties, theta, known, every, options.layout)
    untied, tied = np.flatnonzero(~known), np.flatnonzero(known & ~done)
    alone = problem.calibrate_alone(untied, options)
    if not options.task.trust_labels:
        alone |= problem.calibrate_alone(tied, options, {t: theta[t] for t in tied.tolist()})
    return InitialFrames(theta, known, alone)


def _on_path(initial: InitialFrames, known_centres: KnownCentres) -> InitialFrames:
    """Add the cameras of untied frames that were calibrated by themselves, if on the path; reject the others."""
    accepted = {t: c for t, c in initial.alone.items() if c.accepted and not initial.known[t]}
    near = near_path(accepted, known_centres)
    off_path = Calibration.without_camera(Status.IMPROBABLE, OFF_PATH)
    theta, known = initial.theta.copy(), initial.known.copy()
    for t, calibration in near.items():
        assert calibration.solved is not None
        theta[t], known[t] = calibration.solved.alone.evaluation.theta[0], True
    return InitialFrames(theta, known, {**initial.alone, **dict.fromkeys(accepted.keys() - near.keys(), off_path)})


def with_frames_alone(
    table: FrameTable, shared: SharedParameters, alone: Mapping[int, Calibration], largest_error: float | None
) -> FrameTable:
    """Fill untied frames into the table as they were calibrated by themselves."""
    table = without_camera(table, {t: c for t, c in alone.items() if c.solved is None})
    parts: dict[int, list[int]] = {}  # frames that were solved at once
    for t, calibration in alone.items():
        if calibration.solved is not None:
            parts.setdefault(id(calibration.solved.evaluation), []).append(t)
    for members in parts.values():
        solved = [one for t in members if (one := alone[t].solved) is not None]
        evaluation = solved[0].evaluation.take(np.array([one.frame for one in solved]))
        untied = SolvedFrames(evaluation, shared.errors(evaluation), np.zeros(len(members), dtype=bool))
        rows = solved_rows(shared, untied, {k: alone[t] for k, t in enumerate(members)}, largest_error)
        table = table.replaced(np.array(members), rows)
    return table


def _next(problem: SequenceProblem, done: BoolArray, known: BoolArray) -> IntArray:
    """Numbers of the frames to solve next: frames tied to solved ones or, if none is left, frames on the path."""
    tied = problem.ties.reached(done, ~known)
    return tied if len(tied) or not problem.moves else np.flatnonzero(known & ~done)


def _followed(
    problem: SequenceProblem,
    shared: SharedParameters,
    table: FrameTable,
    done: BoolArray,
    initial: InitialFrames,
    part: IntArray,
) -> FrameTable:
    """Solve frames `part` (B,) from their labels and from the solved frames they are tied to; returns their rows."""
    pairs = problem.ties.towards(part, table.theta, done)
    wrong = _contradicted(part, pairs, initial.alone)
    alone = {k: one for k, t in enumerate(part.tolist()) if (one := initial.alone.get(t)) and t not in wrong}
    fitted = [problem.fitted(t, alone.get(k)) for k, t in enumerate(part.tolist())]
    pixels = PixelTable.joined(problem.pixels.labels, fitted)
    theta = initial.theta[part]
    prior = shared.prior(theta)
    if problem.moves:
        centres = expected_centres(KnownCentres.of(table, done, shared.considered), part)
        prior = centres.of_prior(prior, theta.shape[1])
    solved = shared.solved(theta, pixels, pairs, prior)
    errors = shared.errors(solved, OwnErrors(table.own[pairs.first], table.following[pairs.first]))
    is_tied = np.isin(np.arange(len(part)), pairs.second)
    return solved_rows(shared, SolvedFrames(solved, errors, is_tied), alone)


def _contradicted(index: IntArray, pairs: BackgroundPairs, alone: Mapping[int, Calibration]) -> set[int]:
    """Numbers of the frames whose camera, calibrated by itself, is contradicted by most of their ties."""
    solved = {k: one for k, t in enumerate(index.tolist()) if t in alone and (one := alone[t].solved) is not None}
    if not solved:
        return set()
    number, first = np.array(list(solved)), next(iter(solved.values()))
    theta = np.concatenate([one.alone.evaluation.theta for one in solved.values()])
    layout = first.evaluation.problem.layout
    wrong = contradicted(BackgroundTerm(pairs.take(number), layout, theta))
    return set(index[number][wrong].tolist())
