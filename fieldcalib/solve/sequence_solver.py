"""Frames of one camera, calibrated together.

    frames one by one -> position of the tripod -> frames from there -> all together -> every frame again

A moving camera has a smooth path instead of one position (`fieldcalib.solve.centres`).

Shared parameters are estimated once for all frames (`fieldcalib.problem.layout`); pan, tilt, roll and zoom belong to
each frame, and are eliminated (`fieldcalib.problem.levenberg_marquardt`). A few hundred frames determine the shared
parameters as well as all frames would, since errors of paint and zoom law then exceed those of noise; the other frames
are solved one by one. So the time is linear in the number of frames.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from fieldcalib._types import Array
from fieldcalib.assess.misfit import is_of_wrong_model
from fieldcalib.assess.result import Calibration
from fieldcalib.assess.sequence_calibration import SequenceCalibration
from fieldcalib.problem.layout import CENTER, Layout, Role
from fieldcalib.solve.centres import on_path, voted_centres
from fieldcalib.solve.frame_rows import table_without_cameras
from fieldcalib.solve.joint_solution import JointSolution, solved_together, solved_with_known_sizes
from fieldcalib.solve.joint_start import Start
from fieldcalib.solve.options import Options
from fieldcalib.solve.remaining_frames import with_frames_alone, with_remaining_frames
from fieldcalib.solve.sequence_problem import SequenceProblem
from fieldcalib.solve.shared_parameters import PixelNoise, SharedParameters
from fieldcalib.solve.shared_starts import best_of_other_starts

FIRST = 60  # frames that are calibrated one by one, to find the position of the tripod
ROUNDS = 3  # of solving all together, and every frame again


class SolvedSequence(NamedTuple):
    """The calibration of all frames, and the shared parameters for the calibration of further ones."""

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
    if problem.finds_centre and is_of_wrong_model(joint.misfit.excess, problem.options.layout.image_size):
        joint = best_of_other_starts(problem, joint, alone)
    return _finished(problem, _with_more_labels(problem, joint))


def solve_from_cameras(
    problem: SequenceProblem,
    layout: Layout,
    cameras: Mapping[int, Array],
    before: SequenceCalibration | None = None,
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
    """Calibrate labelled frames by themselves, which share nothing."""
    options = problem.options
    alone = problem.calibrate_alone(np.arange(len(problem)), options)
    found = [c.solved.alone.uncertainty for c in alone.values() if c.solved is not None]
    variance = np.zeros(2 * (int(np.count_nonzero(options.layout.considered)),))
    if options.layout.field_size is not None:
        probability, sigma = options.layout.field_size.possibilities_with_crown
        np.fill_diagonal(variance, probability @ np.square(sigma))
    noise = np.median([(one.robust_sigma, one.curvature) for one in found], axis=0) if found else np.ones(2)
    shared = SharedParameters(replace(options, considered=variance), PixelNoise(*noise.tolist()))
    table = table_without_cameras(shared, len(problem))
    if found:
        table = with_frames_alone(table, shared, alone, np.inf)
    return SequenceCalibration(table, field=options.field, layout=options.layout, considered=variance)


def _first_start(problem: SequenceProblem) -> tuple[Start | None, Mapping[int, Calibration]]:
    """Cameras of some frames, at the position on which they agree or along a path; None if there is none.

    Also returned are the calibrations by themselves of the frames that voted for that position.
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
    """Options with a known centre (3,); unknown parameters of the pose stay unknown."""
    is_pose = np.arange(len(options.known)) < CENTER.stop
    known = np.where(is_pose & options.layout.free, np.nan, options.known)
    known[CENTER] = centre
    return replace(options, layout=options.layout.fixed("centre"), known=known)


def _start_of(
    problem: SequenceProblem, alone: Mapping[int, Calibration], left_out: Mapping[int, float] | None = None
) -> Start | None:
    """Cameras of frames that were accepted by themselves; for a moving camera, of those on its path."""
    found = {t: c for t, c in alone.items() if c.accepted and c.solved is not None and t not in (left_out or {})}
    return Start.of(on_path(found) if problem.moves else found)


def _with_more_labels(problem: SequenceProblem, joint: JointSolution) -> JointSolution:
    """Solve again with the labels of frames that are accepted only since the tripod is known."""
    for _ in range(ROUNDS - 1):
        shared, some = joint.shared_parameters(problem), problem.solved_together
        alone = problem.calibrate_alone(some, shared.options, joint.tied_cameras)
        start = _start_of(problem, alone, joint.left_out)
        if start is None:
            break
        found = solved_together(problem, start, joint.fixed_sizes)
        is_last = found.labelled == joint.labelled
        joint = replace(found, left_out=joint.left_out, alternatives=joint.alternatives)
        if is_last:
            break
    return joint


def _finished(
    problem: SequenceProblem, joint: JointSolution, before: SequenceCalibration | None = None
) -> SolvedSequence:
    """The calibration of all frames, given those that were solved together."""
    shared = joint.shared_parameters(problem)
    is_shared = joint.layout.roles == Role.SHARED
    calibration = SequenceCalibration(
        with_remaining_frames(problem, joint, shared, before),
        tuple(np.array(joint.layout.names)[is_shared].tolist()),
        joint.evaluation.theta[0, is_shared],
        joint.covariance,
        shared.options.field,
        len(joint.index),
        shared.options.layout,
        shared.considered.covariance,
        joint.alternatives,
    )
    return SolvedSequence(calibration, shared)
