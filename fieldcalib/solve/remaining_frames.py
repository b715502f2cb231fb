"""All frames of a sequence, given those that were solved together: the others are solved one by one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from fieldcalib._types import Array, BoolArray, IntArray
from fieldcalib.assess.frame_table import FrameTable
from fieldcalib.assess.own_errors import OwnErrors
from fieldcalib.assess.result import Calibration
from fieldcalib.assess.sequence_calibration import SequenceCalibration
from fieldcalib.assess.words import Status
from fieldcalib.problem.background import BackgroundPairs, BackgroundTerm
from fieldcalib.problem.pixel_table import PixelTable
from fieldcalib.solve.batch import CHUNK
from fieldcalib.solve.centres import KnownCentres, expected_centres, near_path
from fieldcalib.solve.frame_rows import SolvedFrames, solved_rows, table_without_cameras, without_camera
from fieldcalib.solve.joint_solution import JointSolution
from fieldcalib.solve.sequence_problem import SequenceProblem
from fieldcalib.solve.shared_parameters import SharedParameters
from fieldcalib.solve.ties import contradicted, with_tied

OFF_PATH = "its centre is off the path of the frames around it"


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
    """Make the table of all frames: those that were solved together, and the others with the same shared parameters.

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
    # if nothing links the frames, one that is accepted by itself is done
    table = with_frames_alone(table, shared, unlinked, None if problem.is_linked else np.inf)
    while len(layer := _next(problem, done, initial.known)):
        for part in np.array_split(layer, -(-len(layer) // CHUNK)):
            table = table.replaced(part, _followed(problem, shared, table, done, initial, part))
        done = done | np.isin(np.arange(len(done)), layer)
    excess = dict(zip(joint.index.tolist(), joint.misfit.excess.tolist(), strict=True))
    return table.with_misfit({**excess, **joint.left_out})


def _each(joint: JointSolution, shared: SharedParameters) -> SolvedFrames:
    """The frames that were solved together, each as its own problem with its own errors."""
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
    """Initial cameras of frames that are tied to solved ones, and calibrations of labelled frames by themselves."""
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
    if not options.trust_labels:
        alone |= problem.calibrate_alone(tied, options, {t: theta[t] for t in tied.tolist()})
    return InitialFrames(theta, known, alone)


def _on_path(initial: InitialFrames, known_centres: KnownCentres) -> InitialFrames:
    """Add the cameras of untied frames by themselves if these are on the path; reject the others."""
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
    """The table with untied frames filled in as they were calibrated by themselves."""
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
    """Numbers of the frames to be solved next: those tied to solved ones or, if none is left, those on the path."""
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
    """Solve frames `part` (B,) from their labels and from solved frames; returns their rows."""
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
    """Numbers of the frames whose own camera is contradicted by most of their ties."""
    solved = {k: one for k, t in enumerate(index.tolist()) if t in alone and (one := alone[t].solved) is not None}
    if not solved:
        return set()
    number, first = np.array(list(solved)), next(iter(solved.values()))
    theta = np.concatenate([one.alone.evaluation.theta for one in solved.values()])
    layout = first.evaluation.problem.layout
    wrong = contradicted(BackgroundTerm(pairs.take(number), layout, theta))
    return set(index[number][wrong].tolist())
