"""The search for the camera of a frame: few iterations from many initial cameras, then the best plausible one.

A frame may fit several cameras equally well. A field turned by 180 degrees is the same field, so a frame that shows
only the middle line and the centre circle fits a camera and the one across the field. Where lines repeat, as yard lines
do, labels may be miscounted.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from fieldcalib._types import Array, BoolArray, IntArray
from fieldcalib.assess.verdict import implausibilities
from fieldcalib.fields.field import OPPOSITE, Field, side_of, side_of_stand
from fieldcalib.problem.evaluation import Evaluation, Problem, evaluate
from fieldcalib.problem.layout import ANGLES, CENTER, PAN, POSE_AND_ZOOM, GaussianPrior, Layout, Role, turned_around
from fieldcalib.problem.levenberg_marquardt import FAR, levenberg_marquardt
from fieldcalib.problem.observations import Observations
from fieldcalib.solve.initial_cameras import InitialCameras, cameras_elsewhere, given_cameras, initial_cameras
from fieldcalib.solve.request import Options
from fieldcalib.solve.solver_options import CERTAIN

FIRST_ITERATIONS = 4  # of every initial camera
PROMISING = 3  # number of the best cameras of a frame that are solved further,
HOPELESS = 2.0  # unless they cost more than this multiple of the best one
WIDE_ITERATIONS = 30
WIDE_TOLERANCE = 0.2  # relative decrease of the cost at which the wide stage ends: the narrow stage does the rest;
RIVALS_TOLERANCE = 0.01  # smaller if several cameras are compared, which is possible only at their minima
POOR = 1.0  # cost a pixel: right cameras of trusted labels cost 0.1 to 0.8, wrong ones 1.7 and more


def fits_other_side(observations: Observations, theta: Array, options: Options) -> BoolArray:
    """Mask (B,) of the cameras (B, n) that explain their frames as well if turned by 180 degrees about the centre mark.

    Labels do not contradict the turned camera, and the prior hardly more than the other one.
    """
    stands, free = options.stands, options.layout.free
    fits = _look_alike(options.field, observations) & bool(np.all(free[CENTER]) and free[PAN])
    if options.use_prior and np.any(fits):
        here, there = (
            np.sum(np.square(stands.z_scores(camera[:, None])[..., POSE_AND_ZOOM]), axis=-1)
            for camera in (theta, turned_around(theta))
        )
        fits &= 0.5 * (there.min(axis=1) - here.min(axis=1)) < CERTAIN
    return fits


def on_main_side(observations: Observations, theta: Array, options: Options) -> Array:
    """Cameras (B, n), of which those that fit equally well on the main side, the usual one, are turned to it.

    Cameras are not turned if the position is given, or if they are known to be on the other side.
    """
    if options.task.side == OPPOSITE or not np.isnan(options.known[CENTER]).any():
        return theta
    turn = fits_other_side(observations, theta, options) & (theta[:, CENTER][:, 1] < 0.0)
    return np.where(turn[:, None], turned_around(theta), theta) if np.any(turn) else theta


def is_against_convention(C: Array, options: Options) -> bool:
    """Whether labels put a camera at C (3,) on the opposite side of the field, and nothing else tells its side.

    Labels name the ends as seen from the main side. If they name them as the camera itself sees them, it is the one
    turned by 180 degrees: its image is the same, and most cameras are on the main side.
    """
    field, is_told = options.field, not np.isnan(options.known[CENTER]).any() or not options.layout.free[PAN]
    if field is None or options.task.side is not None or is_told or side_of(C, field) != OPPOSITE:
        return False
    sides = {side_of_stand(stand, field) for stand in options.distributions}
    # labels name unpainted points too, so all must have a counterpart, not only what `looks_the_same_turned` asks of
    return len(sides) > 1 and len(field.symmetric) == len(field)


def repeats(labels: Iterable[str], options: Options) -> bool:
    """Whether a frame with these labels looks the same one step of `Field.repeats` along the field.

    Then labels that are all one step off fit equally well. False if the position is given.
    """
    if options.field is None or not np.all(options.layout.free[CENTER]):
        return False
    return any(set(labels) <= alike for alike in options.field.alike_further_on)


def _look_alike(field: Field | None, observations: Observations) -> BoolArray:
    """Mask (B,) of the frames whose labels all look the same from the other side of the field."""
    if field is None:
        return np.zeros(len(observations), dtype=bool)
    alike = np.array([label in field.self_symmetric for label in observations.labels])
    return np.asarray(np.all(alike[observations.label] | (observations.label < 0), axis=1))


@dataclass(frozen=True, eq=False)
class Found:
    """Cameras of B frames from which the narrow loss starts."""

    evaluation: Evaluation
    """Evaluation of the narrow problem at these cameras."""
    prior: GaussianPrior
    """Means and sigmas (B, n) of the stand where each camera is, even if the problem has no prior."""


def find_cameras(observations: Observations, options: Options, given: Array | None = None) -> Found:
    """Search the cameras of B frames that have pixels, near cameras `given` (B, n) if these are not None."""
    layout, known = _without_lens(options), options.known
    only_turned = given is None and not np.any(options.layout.free[ANGLES]) and np.isnan(known[CENTER]).any()
    if only_turned:  # from the middle of a stand, a camera with the known rotation sees other parts of the field
        layout, known = layout.with_roles(Role.FRAME, "angles"), known.copy()
        known[ANGLES] = np.nan
    if given is None:
        start = initial_cameras(observations, options.stands, known, options.scale, layout.lens)
    else:  # initial values only: no parameter counts as known
        start = given_cameras(given, options.stands)
    several = len(start.theta) > len(observations)
    # an unknown lens is left out here: that is faster, with the same result
    evaluation = _wide(observations, layout, options, start, several=several)
    if several:
        evaluation = _best_of(evaluation, start.frame, options)
        if options.task.trust_labels and len(poor := np.flatnonzero(~_explains(evaluation))):
            # no mislabelled segment is the cause
            some = observations.take(poor)
            again = cameras_elsewhere(some, options.stands, known, options.scale, evaluation.theta[poor])
            found = _best_of(_wide(some, layout, options, again, several=True), again.frame, options)
            is_right = _explains(found)
            right = found.take(np.flatnonzero(is_right))
            evaluation = evaluation.replaced(poor[is_right], right.theta, right.points)
    else:  # cameras that are close already are kept
        evaluation = _approached(evaluation, WIDE_ITERATIONS, ~_fits_most(evaluation, options.wide_loss.scale))
    theta = on_main_side(observations, evaluation.theta, options)
    if only_turned:
        theta = _turned_as_known(theta, options.known[ANGLES])
    prior = given_cameras(theta, options.stands).prior  # of the nearest stand: the search may have left the first one
    if given is None:
        prior = _around_known_lens(prior, options)
    problem = options.problem(observations, prior if options.use_prior else None)
    found = evaluation.of(problem) if theta is evaluation.theta else evaluate(problem, theta)
    return Found(found, prior)


def _wide(
    observations: Observations, layout: Layout, options: Options, start: InitialCameras, *, several: bool
) -> Evaluation:
    """Evaluate the problem of the wide loss at initial cameras."""
    wide = Problem(observations.take(start.frame), layout, options.wide_loss, options.noise, scale=options.scale)
    if several or options.use_prior:  # initial cameras far from the data need the prior to converge
        wide = replace(wide, prior=start.prior)
    return evaluate(wide, start.theta)


def _explains(evaluation: Evaluation) -> BoolArray:
    """Mask (B,) of the cameras that explain their labels, after the wide loss."""
    return np.asarray(evaluation.cost < POOR * np.sum(evaluation.problem.observations.weight > 0.0, axis=1))


def _best_of(start: Evaluation, frame: IntArray, options: Options) -> Evaluation:
    """Solve several cameras of each frame with the wide loss, and take the best; `frame` (N,) is ascending."""
    found = _approached(start, FIRST_ITERATIONS)
    best = _best(found, frame, PROMISING, options)
    found, frame = found.take(best), frame[best]
    rivals = np.bincount(frame)[frame] > 1
    found = _approached(found, WIDE_ITERATIONS, ~rivals)
    found = _approached(found, WIDE_ITERATIONS, rivals, tolerance=RIVALS_TOLERANCE)
    return found.take(_best(found, frame, 1, options))


def _turned_as_known(theta: Array, angles: Array) -> Array:
    """The cameras (B, n) with known angles (3,), moved to the side of the field from which these look at it."""
    across = np.cos(theta[:, PAN] - angles[PAN]) < 0.0
    turned = np.where(across[:, None], turned_around(theta), theta)
    turned[:, ANGLES] = angles
    return turned


def _approached(
    start: Evaluation, iterations: int, some: BoolArray | None = None, tolerance: float = WIDE_TOLERANCE
) -> Evaluation:
    """The cameras after a few iterations of the wide loss; only those of the mask `some` (B,) are iterated."""
    index = np.arange(len(start.theta)) if some is None else np.flatnonzero(some)
    if not len(index):
        return start
    part = start if len(index) == len(start.theta) else start.take(index)
    found = levenberg_marquardt(part, max_iterations=iterations, tolerance=tolerance, initial_damping=FAR).evaluation
    return found if part is start else start.replaced(index, found.theta, found.points)


def _around_known_lens(prior: GaussianPrior, options: Options) -> GaussianPrior:
    """The priors with the mean of the lens that the user gave, if any."""
    lens = options.known[options.layout.lens_block]
    if not np.any(lens):
        return prior
    mean = prior.mean.copy()
    mean[:, options.layout.lens_block] = lens
    return replace(prior, mean=mean)


def _without_lens(options: Options) -> Layout:
    """The layout of the search: a free lens and principal point would absorb mislabelled segments."""
    return options.layout.fixed("lens", "principal point", "aspect")


def _best(evaluation: Evaluation, frame: IntArray, kept: int, options: Options) -> IntArray:
    """Indices of the best cameras of each frame: plausible before implausible ones, then by cost."""
    wrong = implausibilities(evaluation, far=options.wide_loss.scale, field=options.field)
    order = np.lexsort((evaluation.cost, np.any(list(wrong.values()), axis=0), frame))
    first = np.searchsorted(frame, frame)  # frames are ascending
    rank = np.arange(len(order)) - first
    hopeless = evaluation.cost[order] > HOPELESS * evaluation.cost[order][first]
    return np.asarray(order[(rank < kept) & ~hopeless])


def _fits_most(evaluation: Evaluation, scale: float) -> BoolArray:
    """Mask (B,) of the cameras that fit more than half of their frame's pixels to within `scale` already.

    From these the narrow loss alone ends in the minimum of the wide one: on annotated frames 4 of 2465 trials with
    initial cameras up to 50 px off ended in another one, two of them in a lower one.
    """
    seen = evaluation.problem.observations.weight > 0.0
    return np.asarray(np.sum((np.abs(evaluation.r) < scale) & seen, axis=1) > 0.5 * np.sum(seen, axis=1))
