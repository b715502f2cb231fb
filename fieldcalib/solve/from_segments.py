"""Calibration from labelled pixels: all steps from labels to a camera with a verdict.

    checked pixels -> initial cameras -> wide loss from all of them -> the best plausible camera -> narrow loss
                   -> mislabelled segments -> ends of segments -> verdict

Many frames (`fieldcalib.solve.batch`) are solved by the batched Levenberg-Marquardt; a single frame is then finished by
SciPy's `least_squares`. Both minimise the same cost.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib._types import Array, BoolArray, IntArray, truth
from fieldcalib.assess.camera_errors import Solved
from fieldcalib.assess.findings import Finding, Status, SuspectLabel, What
from fieldcalib.assess.label_errors import rms_by_label, rms_of_labels
from fieldcalib.assess.ndc import ndc_losses
from fieldcalib.assess.observability import OPEN_DIRECTION, Information
from fieldcalib.assess.probability import UNUSUAL, largest_error
from fieldcalib.assess.result import Calibration, found_of
from fieldcalib.assess.verdict import STEEPLY, Evidence, implausibilities, may_blame, verdict
from fieldcalib.fields.field import Field, ObjectSegments, turned_camera
from fieldcalib.geometry.camera import Camera
from fieldcalib.problem.evaluation import Evaluation, evaluate, with_segment_ends
from fieldcalib.problem.labelled_pixels import (
    ImageSegments,
    Pixels,
    PixelTable,
    PixelWeights,
    Weights,
    check_segments,
    check_weights,
)
from fieldcalib.problem.layout import CENTER, LOG_F
from fieldcalib.problem.levenberg_marquardt import Solution, least_squares, levenberg_marquardt
from fieldcalib.problem.losses import LossName, RobustLoss
from fieldcalib.problem.observations import Observations
from fieldcalib.solve.auto_lens import FISHEYE, as_fisheye, may_be_fisheye, more_likely, with_required_lens
from fieldcalib.solve.initial_cameras import straight_above
from fieldcalib.solve.likelier_shape import with_border_complaint, with_likely_aspect
from fieldcalib.solve.mislabels import Relabelled, without_mislabels
from fieldcalib.solve.misreadings import with_other_names
from fieldcalib.solve.request import GivenCamera, Options, Task, as_fixed
from fieldcalib.solve.search import find_cameras, fits_other_side, is_against_convention, repeats
from fieldcalib.solve.solver_options import ALL, DEFAULT_CRITERIA, CalibrationFlags, Criteria, Prior

NOISY = 4.0  # times the usual noise: none of 755 good cameras of annotated frames misses its labels by more than 2.7
UNKNOWN_FOCAL_LENGTH = 0.1  # standard deviation of log f from which on heights are known to a tenth at best
POORLY_DETERMINED = 0.5  # share of k1 that comes from the labels; the message mentions smaller ones
REPEATS = "labels that are all {:g} m off along the field fit as well: nothing labelled here tells where that is"
NOTHING_LABELLED = "no labelled pixels: nothing to calibrate from"


class Solver(Protocol):
    """`finished` or `levenberg_marquardt`."""

    def __call__(self, start: Evaluation, *, max_iterations: int, tolerance: float) -> Solution:
        """Minimise the cost of B problems from the cameras of an evaluation."""


def calibrate_from_segments(
    object_segments: ObjectSegments,
    image_segments: ImageSegments,
    image_size: tuple[int, int],
    camera_matrix: ArrayLike | None = None,
    dist_coeffs: ArrayLike | None = None,
    rvec: ArrayLike | None = None,
    tvec: ArrayLike | None = None,
    *,
    flags: int | None = None,
    criteria: Criteria = DEFAULT_CRITERIA,
    prior: Prior = "all",
    loss: LossName | RobustLoss = "cauchy",
    tau: float | None = None,
    trust_labels: bool = False,
    weights: Weights | None = None,
    paint: float = 0.0,
    estimate_aspect: bool = False,
) -> Calibration:
    """Calibrate a camera from labelled pixels of one frame.

    Minimises ``1/2 sum_i w_i rho(r_i^2) / noise^2 + 1/2 sum_k z_k^2`` over the camera, r_i being the signed distance of
    a pixel to the image of its segment, w_i one over the number of pixels of the segment, rho a robust loss and z_k the
    z-scores of the camera under a weak prior.

    Parameters
    ----------
    object_segments : mapping of str to segment
        The calibration object, e.g. `soccer()`; metres.
    image_segments : mapping of str to (N, 2) array_like
        Pixels (x, y) on each visible segment.
    image_size : (int, int)
        Width and height in pixels.
    camera_matrix : (3, 3) array_like, optional
        Start or known value of K, with `CALIB_USE_INTRINSIC_GUESS` or `CALIB_FIX_FOCAL_LENGTH`.
    dist_coeffs : (2..14,) array_like, optional
        Known lens (k1, k2, 0, ...) at the focal length of `camera_matrix`. If the focal length changes, the distortion
        of the image is kept: k1 f^-2 is constant.
    rvec, tvec : (3,) array_like, optional
        Initial pose, with `CALIB_USE_EXTRINSIC_GUESS`, or known position or rotation, with `CALIB_FIX_POSITION` or
        `CALIB_FIX_ROTATION`. Values that flags fix are returned to the last bit.
    flags : int, optional
        `CalibrationFlags`, equal in value to cv2's. They replace the default, `DEFAULT_FLAGS`; without a prior the
        default fixes the principal point too.
    criteria : (int, int, float)
        cv2's (type, max_count, eps) of the final stage; eps is the relative decrease of the cost.
    prior : str, CameraDistribution, an iterable of them, or None
        Stands where the camera may be: a weak prior and the source of initial cameras. "all" tries all stands of the
        field, for `soccer` the main stand's centre, left and right, the opposite stand and behind both goals; the name
        of one, like "main center", restricts the search to it. The camera of a `Field` without stands may be anywhere;
        an object that is no `Field` needs a distribution of its own. None takes initial cameras from all stands and
        solves without a prior.
    loss : {"cauchy", "soft_l1", "huber", "linear"} or RobustLoss
        Robust loss of the final stage.
    tau : float, optional
        Threshold of the loss in NDC above which the camera is rejected, but still returned; the paper's is 0.019.
    trust_labels : bool
        Take every label as right: faster, for pixels that were searched along known segments, as lines in an image.
    weights : mapping of str to float or (N,) array_like, optional
        Weights of labels, or of each of their pixels, relative to others; by default 1. Weight 0 leaves a pixel out.
    paint : float
        Standard deviation, in metres, of the position of a painted line as a whole. It enters the uncertainty: many
        pixels on one line do not average it out.
    estimate_aspect : bool
        Whether a picture of another shape than 16:9 may have been squashed from it: it is calibrated as it is and
        stretched, and the calibration that the labels make more likely is returned, with the aspect ratio of its
        pixels. If neither is much more likely, the verdict is "check". A `camera_matrix` gives the aspect ratio: then
        it is not estimated.

    Returns
    -------
    Calibration
        Unpacks to ``rms, K, dist, rvec, tvec``. Data that cannot be calibrated raises no error: see `status`,
        `message`.

    Raises
    ------
    ValueError
        If arguments are invalid: unknown labels, pixels that are not finite or look normalised, a swapped image size,
        flags without the values that they need.

    References
    ----------
    Theiner, Ewerth: TVCalib, WACV 2023, sections "Segment Reprojection Loss" and "Gradient-based Iterative
    Optimization".

    Examples
    --------
    >>> from fieldcalib import Camera, soccer
    >>> truth = Camera.from_angles(-0.3, 1.35, 0.0, 1600.0, (0.0, 68.0, -17.0), (960, 540))
    >>> labels = ("Side line left", "Side line top", "Big rect. left main", "Big rect. left top", "Circle left")
    >>> pixels = {label: truth.project(soccer()[label].sample(7.0)) for label in labels}
    >>> calibration = calibrate_from_segments(soccer(), pixels, (960, 540))
    >>> str(calibration.status), round(calibration.camera.focal_length, -2)  # the weak prior moves it a little
    ('accepted', 1600.0)
    """
    given = GivenCamera(camera_matrix, dist_coeffs, rvec, tvec)
    task = Task(object_segments, given, flags, criteria, prior, loss, tau, paint, trust_labels)

    def calibrated(frames: Sequence[ImageSegments], size: tuple[int, int]) -> list[Calibration]:
        return [calibrate_frame(task, frames[0], size, weights)]

    is_estimated = truth(estimate_aspect, "estimate_aspect") and camera_matrix is None
    return with_likely_aspect(object_segments, calibrated, [image_segments], image_size, estimated=is_estimated)[0]


def calibrate_frame(
    task: Task, frame: ImageSegments, image_size: tuple[int, int], weights: Weights | None, *, are_names: bool = True
) -> Calibration:
    """Check the labels of one frame and calibrate it; unless they `are_names` of markings, they name no sides."""
    options = task.options(image_size)
    pixels, pixel_weights = checked_labels(task.object_segments, frame, weights, options.image_size)
    if not pixels:
        return Calibration.without_camera(Status.TOO_FEW_SEGMENTS, NOTHING_LABELLED)
    table = PixelTable.of(task.object_segments, [pixels], [pixel_weights])
    calibrate = calibrate_checked if are_names else _calibrate_as_given
    (found,) = as_fixed(calibrate(table, options, finished), task.given, options.flags)
    return with_border_complaint(task.object_segments, pixels, found)


def checked_labels(
    object_segments: ObjectSegments, frame: ImageSegments, weights: Weights | None, image_size: tuple[int, int]
) -> tuple[Pixels, PixelWeights | None]:
    """The checked pixels and weights of one frame."""
    return check_weights(object_segments, check_segments(object_segments, frame, image_size), weights)


def finished(start: Evaluation, *, max_iterations: int, tolerance: float) -> Solution:
    """Solve one frame by both solvers: SciPy's `least_squares` starts where Levenberg-Marquardt ends.

    Neither takes a last step that lowers the cost by less than the share `tolerance`. So unless SciPy finds a better
    minimum, the camera is that of `calibrate_batch`.
    """
    near = levenberg_marquardt(start, max_iterations=max_iterations, tolerance=tolerance)
    found = least_squares(near.evaluation, max_iterations=max_iterations, tolerance=tolerance)
    is_better = near.cost[0] - found.cost[0] > tolerance * near.cost[0]
    return replace(
        found if is_better else replace(found, evaluation=near.evaluation),
        iterations=near.iterations + found.iterations,
    )


def calibrate_checked(
    pixels: PixelTable, options: Options, solve: Solver, given: Array | None = None
) -> list[Calibration]:
    """Calibrate checked frames that all have pixels, from cameras `given` (B, n) if these are not None.

    `solve` computes the final optimum. What seems to be wrong with all labels that a person set is named
    (`fieldcalib.solve.misreadings`).
    """
    number = {label: index for index, label in enumerate(pixels.labels)}
    calibrations = _calibrate_as_given(pixels, options, solve, given)

    def under_other_names(frames: Sequence[int], names: Sequence[Mapping[str, str]]) -> list[Calibration]:
        of_label = np.array([[number[its.get(label, label)] for label in pixels.labels] for its in names])
        own = pixels.of_frames(frames)
        return _calibrate_as_given(replace(own, label=of_label[own.frame, own.label]), options, solve)

    annotated = {t: one for t, one in enumerate(calibrations) if one.are_annotated}
    for t, found in with_other_names(annotated, options, under_other_names).items():
        calibrations[t] = found
    return calibrations


def _calibrate_as_given(
    pixels: PixelTable, options: Options, solve: Solver, given: Array | None = None
) -> list[Calibration]:
    """Calibrate checked frames as they are labelled."""
    observations = Observations.of(options.object_segments, pixels, options.image_size, options.motion)
    parts = _solved(observations, options, solve, given)
    if options.auto_lens and given is None:
        parts = _with_fisheye(parts, solve)
    calibrations: dict[int, Calibration] = {}
    for frames, part in parts:
        calibrations |= dict(zip(frames.tolist(), _judged(part), strict=True))
    found = [calibrations[t] for t in range(pixels.count)]
    above = options.from_above
    return found if above is None else _with_views_from_above(found, pixels, above, solve)


def _with_views_from_above(
    found: list[Calibration], pixels: PixelTable, options: Options, solve: Solver
) -> list[Calibration]:
    """Calibrate again, under the prior of cameras above the field, frames that may be seen from there.

    Few cameras are there: all labels must agree with one. Beside that, the camera of the lower cost is kept.
    """
    start = {t: _start_above(one, options) for t, one in enumerate(found)}
    tried = [t for t, theta in start.items() if theta is not None]
    if not tried:
        return found
    again = _calibrate_as_given(pixels.of_frames(tried), options, solve, np.array([start[t] for t in tried]))
    chosen = list(found)
    for t, one in zip(tried, again, strict=True):
        looks_down = one.accepted and one.required_camera.angles[1] < STEEPLY
        agrees = looks_down and not any(finding.what.is_against for finding in found_of(one))
        if agrees and not (found[t].accepted and _cost(found[t]) < _cost(one)):
            chosen[t] = one
    return chosen


def _start_above(found: Calibration, options: Options) -> Array | None:
    """Parameters (n,) of a camera that looks down on the field, where the found one does not fit or is at no stand.

    Of pictures the search for courts finds views from above, so only what a person labelled is tried without a fit.
    """
    if found.solved is None or found.camera is None:
        return None
    evaluation = found.solved.alone.evaluation
    problem, field = evaluation.problem, options.field
    if field is None or problem.layout.lens != options.layout.lens:
        return None
    if found.are_annotated and any(finding.what is What.MISFIT for finding in found_of(found)):
        start = straight_above(problem.observations, options.stands.mean[0], options.scale)[0]
        return start if np.linalg.norm(start[CENTER]) < field.farthest_camera else None  # not if it is NaN
    is_unusual = bool(np.any(np.abs(problem.prior_residuals(evaluation.theta)) > UNUSUAL))
    is_tried = is_unusual if found.accepted else found.status in (Status.DEGENERATE, Status.IMPLAUSIBLE)
    return np.asarray(evaluation.theta[0]) if is_tried and found.camera.angles[1] < STEEPLY else None


def _cost(found: Calibration) -> float:
    """Cost of the labels and of the prior."""
    return np.inf if found.solved is None else float(found.solved.alone.evaluation.cost[0])


def _solved(
    observations: Observations, options: Options, solve: Solver, given: Array | None
) -> Iterator[tuple[IntArray, _Frames]]:
    """Solve frames; with `CALIB_AUTO_LENS` in parts by the coefficients of the lens, each with its frames' indices."""
    found = find_cameras(observations, options, given)
    approached = levenberg_marquardt(
        found.evaluation, max_iterations=options.max_iterations, tolerance=options.approach_tolerance
    ).evaluation
    relabelled = Relabelled(approached, found.prior, [()] * len(observations))
    if options.task.finds_mislabels and not options.task.trust_labels:
        relabelled = without_mislabels(approached, found.prior, options)
    start = with_segment_ends(relabelled.evaluation, options.wide_loss.scale)
    solution = solve(start, max_iterations=options.max_iterations, tolerance=options.tolerance)
    if not options.auto_lens:
        yield np.arange(len(observations)), _Frames(observations, relabelled, solution, options)
        return
    for part in with_required_lens(solution, relabelled.prior, options):
        its = relabelled.take(part.frames, part.prior)
        yield part.frames, _Frames(observations.take(part.frames), its, part.solution, part.options, part.freed)


def _with_fisheye(parts: Iterable[tuple[IntArray, _Frames]], solve: Solver) -> Iterator[tuple[IntArray, _Frames]]:
    """Solve frames whose labels no other lens explains with a fisheye lens, and keep that where it does."""
    for frames, part in parts:
        tried = np.flatnonzero(may_be_fisheye(part.as_given))
        better = np.zeros(0, dtype=np.intp)
        if len(tried) and not np.any(part.options.known[part.options.layout.lens_block]):
            options = replace(as_fisheye(part.options), flags=part.options.flags & ~CalibrationFlags.CALIB_AUTO_LENS)
            ((_, fisheye),) = _solved(part.observations.take(tried), options, solve, None)
            is_better = more_likely(fisheye.as_given, part.as_given.take(tried))
            better = tried[is_better]
            yield frames[better], replace(fisheye.take(np.flatnonzero(is_better)), freed=FISHEYE)
        left = np.setdiff1d(np.arange(len(frames)), better)
        yield frames[left], part.take(left) if len(better) else part


@dataclass(frozen=True, eq=False)
class _Frames:
    """B solved frames."""

    observations: Observations
    """The given labels."""
    relabelled: Relabelled
    """The labels that they were solved with."""
    solution: Solution
    options: Options
    freed: tuple[str, ...] = ()
    """Lens coefficients estimated in addition to those of the flags."""

    @property
    def evaluation(self) -> Evaluation:
        """Evaluation at the solution."""
        return self.solution.evaluation

    @property
    def as_given(self) -> Evaluation:
        """Evaluation of the given labels at the solution."""
        if not any(self.relabelled.suspects):
            return self.evaluation
        problem = replace(self.evaluation.problem, observations=self.observations)
        return evaluate(problem, self.evaluation.theta)

    def take(self, index: IntArray) -> _Frames:
        """Some of the frames."""
        relabelled = self.relabelled.take(index, self.relabelled.prior.take(index))
        observations, solution = self.observations.take(index), self.solution.take(index)
        return replace(self, observations=observations, relabelled=relabelled, solution=solution)


def _judged(frames: _Frames) -> list[Calibration]:
    """Calibrations of solved frames.

    Errors are those of the given labels; the verdict rests on the labels that the frames were solved with.
    """
    options, relabelled, evaluation, given = frames.options, frames.relabelled, frames.evaluation, frames.observations
    cameras = options.layout.cameras(evaluation.theta)
    both_sides = fits_other_side(evaluation.problem.observations, evaluation.theta, options)
    errors_as_given = rms_by_label(frames.as_given)
    calibrations, solved = [], [Solved(evaluation, relabelled.prior.sigma, t) for t in range(len(cameras))]
    for t, evidence in enumerate(_evidence(frames, solved)):
        errors = given.by_name(t, errors_as_given[t])
        suspects = tuple(sorted(relabelled.suspects[t], key=lambda one: list(errors).index(one.label)))
        status, message, *advice = verdict(evidence, options.task.tau)
        is_open = options.task.side is None and bool(both_sides[t])
        is_turned = not is_open and is_against_convention(cameras[t].C, options)
        alternatives = (turned_camera(cameras[t]),) if is_open or is_turned else ()
        sides = [Finding(What.OTHER_SIDE)] * is_open + [Finding(What.SEEN_FROM_OPPOSITE)] * is_turned
        if status is Status.ACCEPTED and _shows_ground_only(cameras[t], evidence, solved[t]):
            advice.append(Finding(What.GROUND_ONLY))
        told = [one for one in sides if status is not Status.ACCEPTED or not one.what.is_against]  # `reason` has others
        notes = [message, *map(str, [*told, *(one for one in advice if one.what is What.GROUND_ONLY)])]
        if status is Status.ACCEPTED and options.field is not None and repeats(evidence.labels.segments, options):
            notes.append(REPEATS.format(options.field.repeats))
        if frames.freed:
            notes.append(f"{', '.join(frames.freed)} estimated too, as the labels require it")
        found = Calibration(
            camera=cameras[t],
            status=status,
            message="; ".join(notes),
            rms=evidence.rms,
            _loss=evidence.loss_ndc,
            per_segment_errors=errors,
            suspect_labels=suspects,
            alternatives=alternatives,
            _found=(*_against(errors, suspects, evidence, options), *sides, *advice),
            pixel_counts=given.by_name(t, given.pixels_by_label[t].astype(int)),
            field=options.field,
            errors=solved[t],
            are_annotated=not options.task.trust_labels and bool(given.weigh_alike[t]),
        )
        calibrations.append(found)
    return calibrations


def _evidence(frames: _Frames, solved: Sequence[Solved]) -> list[Evidence]:
    """The evidence for the verdict on each frame."""
    options, relabelled, evaluation = frames.options, frames.relabelled, frames.evaluation
    far, sigma = options.wide_loss.scale, relabelled.prior.sigma[:, options.layout.free]
    losses = cache(partial(ndc_losses, evaluation, options.object_segments))  # of all frames, when one is asked for
    fitted = evaluation.problem.observations
    errors, rms = rms_by_label(evaluation), rms_of_labels(evaluation)
    wrong = implausibilities(evaluation, far=far, field=options.field, may_be_inside=options.may_be_inside)
    labels = Information.of(evaluation, sigma)
    # ends were chosen by the camera itself: they confirm any camera
    count = evaluation.r.shape[1] - evaluation.problem.observations.ends.xy.shape[1]
    without_ends = replace(
        labels, matrix=evaluation.information_of(slice(0, count)) * sigma[:, :, None] * sigma[:, None]
    )
    as_given = frames.observations if any(relabelled.suspects) else fitted
    needed, lens_is_prior = without_ends.about(options.left_to_labels), _lens_is_prior(labels, options)
    return [
        Evidence(
            rms=float(rms[t]),
            loss_ndc=lambda t=t: float(losses()[t]),  # type: ignore[misc]
            errors=fitted.by_name(t, errors[t]),
            labels=fitted.labels_in(t),
            given=as_given.labels_in(t),
            suspects=[suspect.label for suspect in relabelled.suspects[t]],
            far=far,
            unknowns=options.unknowns,
            implausible=[reason for reason, mask in wrong.items() if mask[t]],
            weakest=needed.weakest(t),
            ground_error=partial(_ground_error, solved[t], options.field),
            converged=bool(frames.solution.converged[t]),
            lens_is_prior=bool(lens_is_prior[t]),
        )
        for t in range(len(evaluation.theta))
    ]


def _ground_error(solved: Solved, field: Field | None) -> float:
    """Largest error of the field in view, in units of its tolerance; NaN without a field, or a prior for the rest."""
    if field is None or solved.evaluation.prior is None:
        return float("nan")
    if not np.all(np.isfinite(solved.alone.evaluation.information)):  # of an absurd camera
        return float("nan")
    return largest_error(solved.uncertainty, field) / field.tolerance


def _shows_ground_only(camera: Camera, evidence: Evidence, solved: Solved) -> bool:
    """Whether focal length and height of an accepted camera are open against one another, as from straight above."""
    if evidence.weakest.information >= OPEN_DIRECTION and camera.angles[1] > STEEPLY:
        return False
    return bool(np.sqrt(solved.uncertainty.covariance[LOG_F, LOG_F]) > UNKNOWN_FOCAL_LENGTH)


def _against(
    errors: Mapping[str, float], suspects: Sequence[SuspectLabel], evidence: Evidence, options: Options
) -> list[Finding]:
    """Evidence of one frame's labels against a camera that agrees with most of them, or misses all by their noise."""
    suspected = {suspect.label for suspect in suspects}
    missed = [label for label, error in errors.items() if error > evidence.far and label not in suspected]
    found = [Finding(What.SUSPECTS, numbers=(len(suspects), len(errors)))] if suspects else []
    if missed:
        is_named = may_blame(evidence.given, missed, evidence.unknowns)
        worst = max(missed, key=lambda label: errors[label]) if is_named else ""
        found.append(Finding(What.MISSED, worst, (len(missed), len(errors))))
    if evidence.rms > NOISY * options.noise:
        found.append(Finding(What.MISFIT, numbers=(float(evidence.rms),)))
    labels, field = evidence.labels, options.field
    is_free = field is not None and not field.stands and options.task.prior in (None, ALL)  # `from_points` has its own
    points = is_free and all(segment.is_point for segment in labels.segments.values())
    is_unchecked = points and sum(labels.equations.values()) <= evidence.unknowns + 1
    return [*found, Finding(What.UNCHECKED)] if is_unchecked else found


def _lens_is_prior(labels: Information, options: Options) -> BoolArray:
    """Mask (B,) of the frames whose k1 comes from the prior, as the labels hardly determine it."""
    is_k1 = np.flatnonzero(options.layout.free) == options.layout.lens_block.start
    if not (options.use_prior and np.any(is_k1)):
        return np.zeros(len(labels.matrix), dtype=bool)
    information = labels.about(is_k1).matrix[:, 0, 0]
    return np.asarray(information / (1.0 + information) < POORLY_DETERMINED)
