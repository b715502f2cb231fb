"""From labelled pixels to a camera: the whole flow.

    checked pixels -> starting cameras -> wide loss, all starts -> the best plausible one -> narrow loss
                   -> labels that lie -> ends of segments -> verdict

One frame is finished by SciPy's `least_squares`, many frames by the batched Levenberg-Marquardt; both minimise the same
cost.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib._types import Array, BoolArray, IntArray
from fieldcalib.assess.ndc import ndc_loss
from fieldcalib.assess.result import Calibration, Status
from fieldcalib.assess.uncertainty import Solved
from fieldcalib.assess.verdict import Evidence, implausibilities, segment_errors, verdict, weakest_directions
from fieldcalib.calibrate.initial_cameras import Starts, starting_cameras
from fieldcalib.calibrate.mislabels import Resolution, resolve_labels
from fieldcalib.calibrate.options import DEFAULT_CRITERIA, DEFAULT_FLAGS, Criteria, Options, Prior, checked_options
from fieldcalib.calibrate.symmetry import on_main_side, other_side
from fieldcalib.fields.field import Field
from fieldcalib.fields.segments import Line, ObjectSegments
from fieldcalib.problem.labelled_pixels import ImageSegments, Pixels, Shares, Weights, check_segments, check_weights
from fieldcalib.problem.losses import LossName, RobustLoss
from fieldcalib.problem.observations import Observations, pack
from fieldcalib.problem.parameters import LENS, GaussianPrior, camera_from_theta
from fieldcalib.problem.residuals import foot_points, segment_residuals
from fieldcalib.problem.segment_ends import with_ends
from fieldcalib.problem.solver import IS_LENS, Problem, Solution, solve_batch, solve_one

CHUNK = 64  # frames solved together: their arrays still fit the processor's cache
CHUNK_PIXELS = 8192  # of them together, padding included: bounds the memory of densely labelled frames
FIRST_ITERATIONS = 6  # for every start
PROMISING = 3  # starts of a frame that go on
WIDE_ITERATIONS = 30
WIDE_TOLERANCE = 1e-3  # the narrow stage does the rest
LITTLE = 0.5  # of the prior's variance: if more of it is left, the labels say little about the lens
OTHER_SIDE_FITS = "the camera across the field, turned by 180 degrees, fits as well"
NO_PIXELS = "no labelled pixels: nothing to calibrate from"


class Solver(Protocol):
    """`solve_one` or `solve_batch`."""

    def __call__(self, problem: Problem, theta: Array, *, max_iterations: int, tolerance: float) -> Solution:
        """Solve B problems from the starts theta (B, 12)."""


def calibrate_from_segments(
    object_segments: ObjectSegments,
    image_segments: ImageSegments,
    image_size: tuple[int, int],
    camera_matrix: ArrayLike | None = None,
    dist_coeffs: ArrayLike | None = None,
    rvec: ArrayLike | None = None,
    tvec: ArrayLike | None = None,
    *,
    flags: int = DEFAULT_FLAGS,
    criteria: Criteria = DEFAULT_CRITERIA,
    prior: Prior = "all",
    loss: LossName | RobustLoss = "cauchy",
    tau: float | None = None,
    trust_labels: bool = False,
    weights: Weights | None = None,
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
        Start of the pose, with `CALIB_USE_EXTRINSIC_GUESS` or `CALIB_FIX_POSITION`.
    flags : int
        `CalibrationFlags`; equal in value to cv2's. They replace the default: fixed aspect ratio, principal point and
        lens.
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
    options = checked_options(
        image_size,
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
    )
    frame = check_segments(object_segments, image_segments, options.image_size)
    frame, shares = check_weights(object_segments, frame, weights)
    if not frame:
        return Calibration.without_camera(Status.TOO_FEW_SEGMENTS, NO_PIXELS)
    (calibration,) = _calibrate(object_segments, [frame], [shares], options, solve_one, trust_labels=trust_labels)
    return calibration


def calibrate_batch(
    object_segments: ObjectSegments,
    frames: Sequence[ImageSegments],
    image_size: tuple[int, int],
    camera_matrix: ArrayLike | None = None,
    dist_coeffs: ArrayLike | None = None,
    *,
    flags: int = DEFAULT_FLAGS,
    criteria: Criteria = DEFAULT_CRITERIA,
    prior: Prior = "all",
    loss: LossName | RobustLoss = "cauchy",
    tau: float | None = None,
    trust_labels: bool = False,
    weights: Sequence[Weights] | None = None,
) -> list[Calibration]:
    """Calibrate many independent frames at once: the same as `calibrate_from_segments` on each, much faster.

    Parameters
    ----------
    object_segments : mapping of str to segment
        The calibration object.
    frames : sequence of mappings of str to (N, 2) array_like
        Pixels of each frame.
    image_size : (int, int)
        Width and height of every frame, pixels.
    camera_matrix, dist_coeffs, flags, criteria, prior, loss, tau, trust_labels
        As in `calibrate_from_segments`, for all frames alike.
    weights : sequence of mappings, optional
        As in `calibrate_from_segments`, for each frame.

    Returns
    -------
    list of Calibration
        In the order of `frames`.

    Raises
    ------
    ValueError
        As `calibrate_from_segments`; the message begins with the index of the frame.

    Examples
    --------
    >>> from fieldcalib import soccer
    >>> [str(calibration.status) for calibration in calibrate_batch(soccer(), [{}, {}], (960, 540))]
    ['too few segments', 'too few segments']
    """
    options = checked_options(
        image_size,
        camera_matrix,
        dist_coeffs,
        None,
        None,
        flags=flags,
        criteria=criteria,
        prior=prior,
        loss=loss,
        tau=tau,
        field=object_segments if isinstance(object_segments, Field) else None,
    )
    if isinstance(frames, Mapping):
        raise ValueError("expected a sequence of frames, got one mapping: calibrate_from_segments takes a single frame")
    if weights is not None and len(weights) != len(frames):
        raise ValueError(f"expected weights for each of {len(frames)} frames, got {len(weights)}")
    checked: list[Pixels] = []
    shares: list[Shares | None] = []
    for index, frame in enumerate(frames):
        try:
            pixels = check_segments(object_segments, frame, options.image_size)
            pixels, share = check_weights(object_segments, pixels, None if weights is None else weights[index])
        except ValueError as error:
            raise ValueError(f"frame {index}: {error}") from None
        checked.append(pixels)
        shares.append(share)
    calibrations = [Calibration.without_camera(Status.TOO_FEW_SEGMENTS, NO_PIXELS) for _ in checked]
    for chunk in _chunks(object_segments, checked):
        members, their_shares = [checked[t] for t in chunk], [shares[t] for t in chunk]
        found = _calibrate(object_segments, members, their_shares, options, solve_batch, trust_labels=trust_labels)
        for t, calibration in zip(chunk, found, strict=True):
            calibrations[t] = calibration
    return calibrations


def _chunks(object_segments: ObjectSegments, frames: Sequence[Pixels]) -> Iterator[IntArray]:
    """Indices of the frames that have pixels, frames with like numbers of pixels together: less padding."""

    def counts(frame: Pixels) -> tuple[int, int]:
        lines = sum(len(xy) for label, xy in frame.items() if isinstance(object_segments[label], Line))
        return lines, sum(len(xy) for xy in frame.values()) - lines

    lines, others = np.array([counts(frame) for frame in frames], dtype=np.intp).reshape(-1, 2).T
    order = np.lexsort((lines, others // 4))
    order = order[lines[order] + others[order] > 0]
    total = (lines + others)[order]
    begin = 0
    while begin < len(order):
        ahead = total[begin : begin + CHUNK]
        padded = np.maximum.accumulate(ahead) * np.arange(1, len(ahead) + 1)
        size = max(1, int(np.searchsorted(padded, CHUNK_PIXELS, side="right")))
        yield order[begin : begin + size]
        begin += size


def _calibrate(
    object_segments: ObjectSegments,
    frames: list[Pixels],
    shares: list[Shares | None],
    options: Options,
    solve: Solver,
    *,
    trust_labels: bool = False,
) -> list[Calibration]:
    """Calibrate frames that have pixels; `solve` brings them to the final optimum."""
    observations = pack(object_segments, frames, options.image_size, shares)
    theta, prior = _start(object_segments, observations, options, solve)
    used = prior if options.use_prior else None
    narrow = Problem(observations, options.free, options.loss, options.noise, used, options.scale)
    approach = partial(solve, max_iterations=options.max_iterations, tolerance=WIDE_TOLERANCE)
    search = partial(_start, object_segments, options=options, solve=solve_batch)
    far, solution = options.wide_loss.scale, approach(narrow, theta)
    resolved = Resolution(frames, narrow, solution, prior, [()] * len(frames))
    if not trust_labels:
        resolved = resolve_labels(object_segments, frames, shares, narrow, solution, prior, far, search, approach)
    drawn = with_ends(object_segments, resolved.problem, resolved.solution.theta, far)
    solution = solve(drawn, resolved.solution.theta, max_iterations=options.max_iterations, tolerance=options.tolerance)
    resolved = replace(resolved, solution=solution)
    return _judge(object_segments, frames, observations, resolved, drawn, options)


def _start(
    object_segments: ObjectSegments, observations: Observations, options: Options, solve: Solver
) -> tuple[Array, GaussianPrior]:
    """For each frame the camera (12,) that the narrow loss starts from, and its prior."""
    starts = starting_cameras(observations, options.distributions, options.known, options.scale)
    # the search goes without a lens: it is quicker, and finds the same
    search = replace(options, free=options.free & ~IS_LENS)
    theta, prior = _best_starts(starts, observations, search, solve)
    if np.any(options.free & IS_LENS):
        theta, prior = _bent(theta, prior, observations, options, solve)
    return on_main_side(object_segments, observations, theta, prior, options)


def _best_starts(
    starts: Starts, observations: Observations, options: Options, solve: Solver
) -> tuple[Array, GaussianPrior]:
    """For each frame the camera (12,) under the wide loss that the narrow one starts from, and its prior.

    All starts get a few iterations, the most promising ones of each frame then run to the end. Plausible cameras go
    before others, cheap ones before dear ones. A single start that is close already is left as it is.
    """
    theta, frame, prior = starts.theta, starts.frame, starts.prior
    several = len(theta) > len(observations)
    if len(theta) == 1 and _fits_most(theta, observations, options.wide_loss.scale)[0]:
        return theta, prior
    stages = ((PROMISING, FIRST_ITERATIONS), (1, WIDE_ITERATIONS))
    for kept, max_iterations in stages if several else stages[1:]:
        taken = observations.take(frame)
        wide = Problem(taken, options.free, options.wide_loss, options.noise, scale=options.scale)
        if several or options.use_prior:  # starts from the stands need the prior to come home
            wide = replace(wide, prior=prior)
        solve_all = solve if len(theta) == 1 else solve_batch
        trials = solve_all(wide, theta, max_iterations=max_iterations, tolerance=WIDE_TOLERANCE)
        feet = foot_points(trials.theta, wide.observations)
        far = options.wide_loss.scale
        wrong = implausibilities(trials.theta, feet, wide.observations, far=far, field=options.field)
        order = np.lexsort((trials.cost, np.any(list(wrong.values()), axis=0), frame))
        rank = np.arange(len(order)) - np.searchsorted(frame, frame)  # within its frame: frames are ascending
        best = order[rank < kept]
        theta, frame, prior = trials.theta[best], frame[best], prior.take(best)
    return theta, prior


def _bent(
    theta: Array, prior: GaussianPrior, observations: Observations, options: Options, solve: Solver
) -> tuple[Array, GaussianPrior]:
    """Pinholes (B, 12) with the lens that is most likely, and priors around it.

    A lens that the user gave is the most likely one. Where a pinhole is far off, the wide loss goes on with that lens:
    a free one would bend itself around labels that lie.
    """
    lens = options.known[LENS]
    if np.any(lens):
        mean = prior.mean.copy()
        mean[:, LENS] = lens
        prior = replace(prior, mean=mean)
    free = np.flatnonzero(options.free & IS_LENS)
    theta = theta.copy()
    theta[:, free] = prior.mean[:, free]
    poor = np.flatnonzero(~_fits_most(theta, observations, options.loss.scale))
    if len(poor):
        fixed = options.free & ~IS_LENS
        taken = observations.take(poor)
        wide = Problem(taken, fixed, options.wide_loss, options.noise, prior.take(poor), options.scale)
        theta[poor] = solve(wide, theta[poor], max_iterations=WIDE_ITERATIONS, tolerance=WIDE_TOLERANCE).theta
    return theta, prior


def _fits_most(theta: Array, observations: Observations, scale: float) -> BoolArray:
    """Which cameras (B,) have more than half of their frame's pixels within `scale` already.

    On annotated frames the narrow loss alone then leads where the wide one does: 4 of 2465 trials with starts up to
    50 px off ended elsewhere, two of them lower.
    """
    seen = observations.weight > 0.0
    near = (np.abs(segment_residuals(theta, observations)) < scale) & seen
    return np.asarray(np.sum(near, axis=1) > 0.5 * np.sum(seen, axis=1))


def _judge(
    object_segments: ObjectSegments,
    frames: list[Pixels],
    observations: Observations,
    resolved: Resolution,
    drawn: Problem,
    options: Options,
) -> list[Calibration]:
    """Cameras, errors and verdicts of solved frames; `drawn` is the problem with the ends of the segments.

    Segments have the errors of the labels that were given; the verdict is on the labels that were solved with.
    """
    theta, problem, prior = resolved.solution.theta, resolved.problem, resolved.prior
    feet = foot_points(theta, problem.observations)
    losses = ndc_loss(theta, object_segments, resolved.frames, options.image_size)
    far = options.wide_loss.scale
    wrong = implausibilities(theta, feet, problem.observations, far=far, field=options.field)
    information = replace(problem, prior=None).linearized(theta)[2]
    lens_is_prior = _lens_is_prior(information, prior.sigma, options)
    known_by_labels = options.free & ~(IS_LENS & options.use_prior)  # the prior of the lens is good enough
    kept = known_by_labels[options.free]
    weakest = weakest_directions(information[:, kept][:, :, kept], prior.sigma[:, known_by_labels], known_by_labels)
    fitted = segment_errors(feet.r, problem.observations, resolved.frames)
    given = fitted
    if resolved.frames is not frames:
        given = segment_errors(segment_residuals(theta, observations), observations, frames)

    other = other_side(object_segments, problem.observations, theta, options)
    solved = Solved(drawn, theta, prior.sigma)
    calibrations = []
    for t, (frame, (errors, rms)) in enumerate(zip(resolved.frames, fitted, strict=True)):
        evidence = Evidence(
            rms=rms,
            loss_ndc=float(losses[t]),
            errors=errors,
            far=far,
            unknowns=int(np.sum(known_by_labels)),
            lens_is_prior=bool(lens_is_prior[t]),
            implausible=[reason for reason, mask in wrong.items() if mask[t]],
            weakest=weakest[t],
            converged=bool(resolved.solution.converged[t]),
        )
        status, message = verdict(object_segments, frame, evidence, options.tau)
        alternatives = (camera_from_theta(other.theta[t], options.image_size),) if other.fits[t] else ()
        message = "; ".join([message, *map(str, resolved.suspects[t]), *[OTHER_SIDE_FITS] * len(alternatives)])
        calibrations.append(
            Calibration(
                camera_from_theta(theta[t], options.image_size),
                status,
                message,
                rms,
                evidence.loss_ndc,
                given[t][0],
                resolved.suspects[t],
                alternatives,
                options.field,
                solved.of_frame(t),
            )
        )
    return calibrations


def _lens_is_prior(information: Array, sigma: Array, options: Options) -> BoolArray:
    """Whose k1 (B,) is mostly that of the prior: the labels cannot tell it from zoom and position."""
    if not (options.use_prior and options.free[LENS.start]):
        return np.zeros(len(information), dtype=bool)
    precision = 1.0 / np.square(sigma[:, options.free])
    diagonal = np.arange(information.shape[1])
    posterior = information.copy()
    posterior[:, diagonal, diagonal] += precision
    k1 = int(np.sum(options.free[: LENS.start]))
    variance = np.linalg.inv(posterior)[:, k1, k1]
    return np.asarray(variance * precision[:, k1] > LITTLE)
