"""From labelled pixels to a camera: the whole flow.

    checked pixels -> initial cameras -> wide loss, all of them -> the best plausible one -> narrow loss
                   -> mislabelled segments -> ends of segments -> verdict

Many frames (`fieldcalib.solve.batch`) are solved by the batched Levenberg-Marquardt; one frame is finished by
SciPy's `least_squares` from there. Both minimise the same cost.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib._types import Array
from fieldcalib.assess.ndc import ndc_losses
from fieldcalib.assess.observability import Information
from fieldcalib.assess.result import Calibration, Status, SuspectLabel
from fieldcalib.assess.solved import Solved
from fieldcalib.assess.verdict import Evidence, implausibilities, segment_errors, verdict
from fieldcalib.fields.field import Field
from fieldcalib.fields.segments import ObjectSegments
from fieldcalib.geometry.camera import Camera
from fieldcalib.problem.evaluation import Evaluation, evaluate
from fieldcalib.problem.labelled_pixels import (
    ImageSegments,
    Pixels,
    PixelWeights,
    Weights,
    check_object,
    check_segments,
    check_weights,
)
from fieldcalib.problem.least_squares import least_squares
from fieldcalib.problem.levenberg_marquardt import Solution, levenberg_marquardt
from fieldcalib.problem.losses import LossName, RobustLoss
from fieldcalib.problem.observations import Observations, pack
from fieldcalib.problem.segment_ends import with_segment_ends
from fieldcalib.solve.aspect import with_aspect_as_told
from fieldcalib.solve.auto_lens import with_lens_as_called_for
from fieldcalib.solve.given_camera import GivenCamera, as_fixed
from fieldcalib.solve.label_ends import with_border_asked
from fieldcalib.solve.mislabels import Relabelled, without_mislabels
from fieldcalib.solve.options import (
    DEFAULT_CRITERIA,
    Criteria,
    Options,
    Prior,
    checked_options,
)
from fieldcalib.solve.search import find_cameras
from fieldcalib.solve.symmetry import other_side, repeats

NOISY = 4.0  # times the usual noise: of 755 good cameras of annotated frames none misses its labels by more than 2.7
POORLY_DETERMINED = 0.5  # share of k1 that comes from the labels, below which the message says so
OTHER_SIDE_FITS = "the camera across the field, turned by 180 degrees, fits as well"
REPEATS = "labels that are all {:g} m off along the field fit as well: nothing labelled here tells where that is"
NO_PIXELS = "no labelled pixels: nothing to calibrate from"


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
        Known lens (k1, k2, 0, ...) at the focal length of `camera_matrix`. If the focal length changes, the lens bends
        the image as before: k1 f^-2 is kept.
    rvec, tvec : (3,) array_like, optional
        Start of the pose, with `CALIB_USE_EXTRINSIC_GUESS`, or what is known of it, with `CALIB_FIX_POSITION` or
        `CALIB_FIX_ROTATION`. What flags fix is in the result to the last bit.
    flags : int, optional
        `CalibrationFlags`; equal in value to cv2's. They replace the default, which is `DEFAULT_FLAGS`; without a prior
        that fixes the principal point too.
    criteria : (int, int, float)
        cv2's (type, max_count, eps) of the final stage; eps is the relative decrease of the cost.
    prior : str, CameraDistribution, an iterable of them, or None
        Where the camera may stand: weak prior, and where starts come from. "all" tries the stands of the field, for
        `soccer` the main stand's centre, left and right, the opposite stand and behind both goals; the name of one,
        like "main center", says that the kind of camera is known. An object that knows no stands needs a distribution
        of its own. None starts everywhere and solves without a prior.
    loss : {"cauchy", "soft_l1", "huber", "linear"} or RobustLoss
        Robust loss of the final stage.
    tau : float, optional
        Reject if the loss in NDC is above; the paper's is 0.019. The camera is given all the same.
    trust_labels : bool
        Take every label for right: quicker, where pixels were found for known segments, as lines in an image are.
    weights : mapping of str to float or (N,) array_like, optional
        What labels, or each of their pixels, count against others; 1 where nothing is said. 0 leaves a pixel out.
    paint : float
        Standard deviation, in metres, of where a line is painted as a whole. It is in the uncertainty: many pixels on
        one line do not average it out.
    estimate_aspect : bool
        Whether a picture of another shape than 16:9 may have been squashed from it: it is calibrated as it is and as it
        would be shown, and what the labels make more likely is given, with the aspect ratio of its pixels. Where they
        do not tell, the verdict is "check". A `camera_matrix` says the aspect ratio: then nothing is estimated.

    Returns
    -------
    Calibration
        Unpacks to ``rms, K, dist, rvec, tvec``. Data that cannot be calibrated is no error: see `status` and `message`.

    Raises
    ------
    ValueError
        Arguments that cannot be right: unknown labels, pixels that are not finite or look normalised, a swapped image
        size, flags without the values that they need.

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
    check_object(object_segments)

    def calibrated(frames: Sequence[ImageSegments], size: tuple[int, int]) -> list[Calibration]:
        options = checked_options(
            size,
            camera_matrix,
            dist_coeffs,
            rvec,
            tvec,
            flags=flags,
            criteria=criteria,
            prior=prior,
            loss=loss,
            tau=tau,
            field=object_segments if isinstance(object_segments, Field) else None,
            paint=paint,
        )
        frame = check_segments(object_segments, frames[0], options.image_size)
        frame, pixel_weights = check_weights(object_segments, frame, weights)
        if not frame:
            return [Calibration.without_camera(Status.TOO_FEW_SEGMENTS, NO_PIXELS)]
        found = calibrate_checked(
            object_segments, [frame], [pixel_weights], options, finished, trust_labels=trust_labels
        )
        camera = GivenCamera(camera_matrix, dist_coeffs, rvec, tvec).camera(options.image_size)
        return found if flags is None else [as_fixed(one, camera, flags) for one in found]

    is_estimated = estimate_aspect and camera_matrix is None
    return with_aspect_as_told(object_segments, calibrated, [image_segments], image_size, estimated=is_estimated)[0]


def finished(start: Evaluation, *, max_iterations: int, tolerance: float) -> Solution:
    """One frame by both solvers: few steps of SciPy's, which are slower, are left where Levenberg-Marquardt ends."""
    near = levenberg_marquardt(start, max_iterations=max_iterations, tolerance=tolerance)
    solution = least_squares(near.evaluation, max_iterations=max_iterations, tolerance=tolerance)
    return replace(solution, iterations=near.iterations + solution.iterations)


def calibrate_checked(
    object_segments: ObjectSegments,
    frames: list[Pixels],
    weights: list[PixelWeights | None],
    options: Options,
    solve: Solver,
    *,
    given: Array | None = None,
    trust_labels: bool = False,
) -> list[Calibration]:
    """Calibrate checked frames that have pixels, from `given` cameras (B, n) if there are.

    `solve` finds the final optimum.
    """
    found = _solved(object_segments, frames, weights, options, solve, given, trust_labels)
    if trust_labels:
        return found
    return [with_border_asked(object_segments, frame, one) for frame, one in zip(frames, found, strict=True)]


def _solved(
    object_segments: ObjectSegments,
    frames: list[Pixels],
    weights: list[PixelWeights | None],
    options: Options,
    solve: Solver,
    given: Array | None,
    trust_labels: bool,
) -> list[Calibration]:
    """Calibrations of checked frames by their labels, wherever these end."""
    observations = pack(object_segments, frames, options.image_size, weights, motion_of(options))
    found = find_cameras(observations, options, given)
    solution = levenberg_marquardt(
        found.evaluation, max_iterations=options.max_iterations, tolerance=options.approach_tolerance
    )
    solved = Relabelled(frames, solution.evaluation, found.prior, [()] * len(frames))
    if not trust_labels:
        solved = without_mislabels(object_segments, frames, weights, solution.evaluation, found.prior, options)
    start = with_segment_ends(solved.evaluation, options.wide_loss.scale)
    solution = solve(start, max_iterations=options.max_iterations, tolerance=options.tolerance)
    are_annotated = [not trust_labels and _weigh_alike(weight) for weight in weights]
    if not options.auto_lens:
        return _judged(object_segments, frames, observations, solved, solution, options, are_annotated)
    calibrations: dict[int, Calibration] = {}
    for part in with_lens_as_called_for(object_segments, solution, solved.prior, options):
        index = part.frames
        some = solved.take(index, part.prior)
        members = [frames[t] for t in index]
        seen, by_hand = observations.take(index), [are_annotated[t] for t in index]
        judged = _judged(object_segments, members, seen, some, part.solution, part.options, by_hand)
        extra = f"; {', '.join(part.freed)} estimated too, as the labels call for it" if part.freed else ""
        for t, one in zip(index.tolist(), judged, strict=True):
            calibrations[t] = replace(one, message=one.message + extra) if extra else one
    return [calibrations[t] for t in range(len(frames))]


def _weigh_alike(weights: PixelWeights | None) -> bool:
    """Whether all labels of a frame count alike, as without weights."""
    return weights is None or all(np.allclose(of_label, 1.0 / len(of_label)) for of_label in weights.values())


def motion_of(options: Options) -> Array | None:
    """How the segments move with the size of the field, where that is a parameter."""
    if options.field is None or options.layout.field_size is None:
        return None
    return options.field.motion


def _judged(
    object_segments: ObjectSegments,
    frames: list[Pixels],
    observations: Observations,
    solved: Relabelled,
    solution: Solution,
    options: Options,
    are_annotated: Sequence[bool],
) -> list[Calibration]:
    """Cameras, errors and verdicts of solved frames.

    Segments have the errors of the labels that were given; the verdict is on the labels that were solved with.
    """
    evaluation, prior, layout = solution.evaluation, solved.prior, options.layout
    theta, far = evaluation.theta, options.wide_loss.scale
    cameras = layout.cameras(theta)
    losses = ndc_losses(theta, layout, object_segments, solved.frames)
    wrong = implausibilities(evaluation, far=far, field=options.field, may_be_inside=options.may_be_inside)
    labels = Information.of(evaluation, prior.sigma[:, layout.free])
    # ends are seen from the camera that was found: they confirm it wherever it is
    lines_alone = evaluation.with_ends(evaluation.problem.observations.without_ends.ends)
    needed = Information.of(lines_alone, prior.sigma[:, layout.free]).about(options.is_camera)
    lens_is_prior = _lens_is_prior(labels, options)
    fitted = segment_errors(evaluation, solved.frames)
    given = fitted
    if any(solved.suspects):
        given = segment_errors(evaluate(replace(evaluation.problem, observations=observations), theta), frames)

    other = other_side(evaluation.problem.observations, theta, options)
    calibrations = []
    for t, (frame, (errors, rms)) in enumerate(zip(solved.frames, fitted, strict=True)):
        evidence = Evidence(
            rms=rms,
            loss_ndc=float(losses[t]),
            errors=errors,
            given=frames[t],
            suspects=[suspect.label for suspect in solved.suspects[t]],
            far=far,
            unknowns=options.unknowns,
            lens_is_prior=bool(lens_is_prior[t]),
            implausible=[reason for reason, mask in wrong.items() if mask[t]],
            weakest=needed.weakest(t),
            converged=bool(solution.converged[t]),
        )
        status, message = verdict(object_segments, frame, evidence, options.tau)
        alternatives = (layout.camera(other.theta[t]),) if other.fits[t] else ()
        notes = [*map(str, solved.suspects[t]), *[OTHER_SIDE_FITS] * len(alternatives)]
        if status is Status.ACCEPTED and options.field is not None and repeats(frame, options):
            notes.append(REPEATS.format(options.field.repeats))
        message = "; ".join([message, *notes])
        calibrations.append(
            Calibration(
                cameras[t],
                status,
                message,
                rms,
                evidence.loss_ndc,
                given[t][0],
                solved.suspects[t],
                alternatives,
                _complaints(given[t][0], solved.suspects[t], alternatives, far) + _misfit(rms, options),
                {label: len(xy) for label, xy in frames[t].items()},
                options.field,
                Solved(evaluation, prior.sigma, t),
                are_annotated=are_annotated[t],
            )
        )
    return calibrations


def _complaints(
    errors: Mapping[str, float], suspects: Sequence[SuspectLabel], alternatives: Sequence[Camera], far: float
) -> tuple[str, ...]:
    """What the labels of one frame say against its camera, though most of them agree with it."""
    suspected = {suspect.label for suspect in suspects}
    missed = [label for label, error in errors.items() if error > far and label not in suspected]
    found = [f"{len(suspects)} of {len(errors)} labels are suspect"] if suspects else []
    found += [f"{len(missed)} of {len(errors)} labels lie far off"] if missed else []
    return (*found, *[OTHER_SIDE_FITS] * len(alternatives))


def _misfit(rms: float, options: Options) -> tuple[str, ...]:
    """What is said of a camera that misses most of its labels by a little."""
    if not rms > NOISY * options.noise:
        return ()
    return (f"the labels lie {rms:.0f} px off: check the size of field and image, and what was given of the camera",)


def _lens_is_prior(labels: Information, options: Options) -> Array:
    """Whose k1 (B,) is mostly that of the prior: the labels cannot tell it from zoom and position."""
    is_k1 = np.flatnonzero(options.layout.free) == options.layout.lens_block.start
    if not (options.use_prior and np.any(is_k1)):
        return np.zeros(len(labels.matrix), dtype=bool)
    information = labels.about(is_k1).matrix[:, 0, 0]
    return np.asarray(information / (1.0 + information) < POORLY_DETERMINED)
