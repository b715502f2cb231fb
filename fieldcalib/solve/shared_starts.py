"""Joint solutions from several starts: the best one wins; other centres that fit equally well are alternatives.

Position of the tripod, size of the field and lens trade off, so that the joint problem has several minima. Labels that
contradict a start are outliers under a narrow loss and cannot move the solution out of its minimum. Under a wide loss
they can, so the loss is wide at first and then narrowed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from fieldcalib._types import Array, IntArray
from fieldcalib.assess.misfit import is_contradicted, misfit
from fieldcalib.assess.result import Calibration
from fieldcalib.problem.evaluation import Evaluation
from fieldcalib.problem.layout import CENTER, Role
from fieldcalib.problem.levenberg_marquardt import FAR, levenberg_marquardt
from fieldcalib.problem.prior import GaussianPrior
from fieldcalib.solve.centres import voted_centres
from fieldcalib.solve.joint_solution import JointSolution, solved_together, solved_with_known_sizes
from fieldcalib.solve.joint_start import JointStart, Start, joint_start
from fieldcalib.solve.sequence_problem import SequenceProblem

WIDTHS = (25.0, 5.0)  # factors of the scale of the loss, in turn: lines are 20 to 100 px off after wrong starts
FEW = 30  # iterations with each of them,
APPROACHED = 1e-3  # and relative decrease of the cost at which the next one takes over
HELD = 1e-6  # standard deviation, in any unit, of parameters that are to stay
SAME = 0.3  # m: nearer centres belong to the same minimum
APART = 11.3  # squared distance in standard deviations: 99 % of chi-squared with three degrees of freedom
AS_GOOD = 4.0  # difference in cost that noise explains: three standard deviations, a probability of one in fifty
MOST_CENTRES = 2  # centres with most votes from which frames are solved together
GIVEN_SIZE = (0.0, 0.0)  # m: length and width of starts, minus the given ones
OTHER_SIZES = (GIVEN_SIZE, (0.0, -3.0), (0.0, 3.0))
RUNS = 4  # of consecutive frames: if one of them is wrong, the others may agree without it


def best_of_other_starts(
    problem: SequenceProblem, joint: JointSolution, alone: Mapping[int, Calibration]
) -> JointSolution:
    """Solve from several positions and sizes, and take the solution of least cost; `joint` if there is no other start.

    Positions are those that frames calibrated `alone` vote for, and those of all frames but a run of them.
    """
    accepted = {t: c for t, c in alone.items() if c.accepted}
    voters = Start.of(accepted)
    if voters is None:
        return joint
    before = Start(joint.layout, _cameras(JointStart(joint.index, joint.evaluation)), voters.labels)
    found = [_solved(problem, before, ())]
    for centre in voted_centres(list(accepted.values()), MOST_CENTRES):
        sizes = (GIVEN_SIZE,) if problem.fixed_sizes else OTHER_SIZES
        found += [_solved(problem, voters.moved(centre, size), WIDTHS) for size in sizes]
    for run in np.array_split(voters.frames, RUNS):
        found.append(_solved(problem, _without(problem, voters, run), ()))
    most = max(len(one.frames) for one in found)
    alike = [one for one in found if len(one.frames) == most]
    best = min(alike, key=lambda one: _cost(one.evaluation))
    excess = misfit(best.evaluation).excess
    wrong = is_contradicted(excess, problem.options.layout.image_size)
    left_out = dict(zip(best.frames[wrong].tolist(), excess[wrong].tolist(), strict=True))
    labels = {t: one for t, one in voters.labels.items() if t not in left_out}
    if not labels:
        return replace(joint, fixed_sizes=problem.fixed_sizes, left_out=left_out)
    solved = solved_with_known_sizes(problem, Start(best.evaluation.problem.layout, _cameras(best), labels))
    others = [
        solved_together(problem, Start(one.evaluation.problem.layout, _cameras(one), labels), solved.fixed_sizes)
        for one in alike
        if np.linalg.norm(one.evaluation.theta[0, CENTER] - best.evaluation.theta[0, CENTER]) > SAME
    ]
    same = [one.evaluation for one in others if np.array_equal(one.index, solved.index)]
    alternatives = _other_centres(same, solved.evaluation, solved.covariance_if_level[:3, :3])
    return replace(solved, left_out=left_out, alternatives=np.reshape(alternatives, (-1, 3)))


def _solved(
    problem: SequenceProblem, start: Start, widths: Sequence[float], among: IntArray | None = None
) -> JointStart:
    """Solve frames together with all their labels."""
    index, evaluation = joint_start(problem, start, problem.fixed_sizes, among=among, agreeing=False)
    return JointStart(index, _narrowing(evaluation, widths, problem.options.max_iterations, problem.options.tolerance))


def _without(problem: SequenceProblem, start: Start, run: IntArray) -> Start:
    """Start from the shared parameters of all frames but a run of them; the cameras of the run follow."""
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
    return again._replace(theta=_cameras(JointStart(index, _followed(evaluation, problem.options.max_iterations))))


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


def _followed(start: Evaluation, max_iterations: int) -> Evaluation:
    """Solve for the frames' own parameters; shared ones are kept."""
    layout, theta = start.problem.layout, start.theta
    prior = start.problem.prior or GaussianPrior(theta, np.full_like(theta, np.inf))
    held = layout.roles == Role.SHARED
    prior = GaussianPrior(np.where(held, theta, prior.mean), np.where(held, HELD, prior.sigma))
    return _narrowing(start.of(replace(start.problem, prior=prior)), WIDTHS, max_iterations, APPROACHED)


def _other_centres(found: Sequence[Evaluation], best: Evaluation, covariance: Array) -> list[Array]:
    """Other centres (3,) of solutions that fit as well as the best one; `covariance` (3, 3) is of the best centre."""
    others: list[Array] = []
    least, V = _cost(best), covariance + SAME**2 * np.eye(3)
    for one in sorted(found, key=_cost):
        centre = one.theta[0, CENTER]
        away = [centre - known for known in (best.theta[0, CENTER], *others)]
        if all(way @ np.linalg.solve(V, way) > APART for way in away) and _cost(one) - least < AS_GOOD:
            others.append(centre)
    return others
