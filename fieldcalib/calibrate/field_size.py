"""How large is the pitch? Its length and width, estimated together with the cameras that see it.

Law 1 leaves a pitch some freedom, and a field of 105 x 68 m then bends the cameras. With length and width a marking
moves, or grows along itself; its shape stays. It moves by a constant ``M`` (3, 2), metres a metre, and a segment that
moves is a camera that moves the other way: with C the camera's centre

    dr/ds = -dr/dC M,        s = (length, width).

What is minimised is the solver's cost of all frames, each with a camera of its own, and the prior of the size,

    sum_t cost_t(theta_t, s) + 1/2 sum_k ((s_k - mean_k) / sigma_k)^2,

by Gauss-Newton steps on s from which the cameras are eliminated: with H_t the Hessian of frame t and g_t its gradient,

    L_t = (-H_st H_tt^-1, I),        step = -(sum_t L_t H_t[:, s] + P)^-1 (sum_t L_t g_t + P (s - mean)).

After each step the frames are calibrated from the beginning, as labels that seemed to lie may fit a pitch of another
size; and so on until the size stays. (Of several frames, the priors in g and H are weaker than those that the cameras
were calibrated with, see `_parts`: as g is not 0 then, the steps still lead to the minimum, to first order. The same
holds for pixels past the end of a segment: they tell the cameras where it is, `fieldcalib.problem.segment_ends`, but
not the size.)

The covariance is the sandwich of `fieldcalib.assess.uncertainty` with two parameters more.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fieldcalib._types import Array
from fieldcalib.assess.result import Calibration, Status
from fieldcalib.assess.uncertainty import Noise, Solved, uncertainties
from fieldcalib.calibrate.from_segments import calibrate_batch
from fieldcalib.calibrate.options import DEFAULT_FLAGS, Prior
from fieldcalib.fields.field import Field
from fieldcalib.fields.traits import DEVIATIONS, SizePrior
from fieldcalib.problem.labelled_pixels import ImageSegments
from fieldcalib.problem.parameters import CENTER, GaussianPrior
from fieldcalib.problem.residuals import segment_residuals_with_jacobian

STILL = 1e-3  # metres: a size that moves by less stays
STEPS = 10
# Share below which the labels count as silent: a frame of one half has 2 % of the length, since the prior knows roughly
# where the camera stands.
SILENT = 0.05


@dataclass(frozen=True, eq=False)
class FieldSize:
    """The estimated size of a pitch, and what it rests on. Pairs are (length, width)."""

    field: Field
    """The pitch, of the estimated size."""
    covariance: Array
    """Of length and width, (2, 2) square metres, given labels and prior."""
    from_labels: Array
    """Share of the estimate that comes from the labels, the rest being the prior's, (2,): ``information / (1 +
    information)``, with the information of the labels in units of the prior's."""
    calibrations: tuple[Calibration, ...]
    """Of the frames, on that pitch; they take its size as known."""

    @property
    def length(self) -> float:
        """Of a touchline, metres."""
        return self.field.length

    @property
    def width(self) -> float:
        """Of a goal line, metres."""
        return self.field.width

    @property
    def std_deviations(self) -> Array:
        """Standard deviations, (2,) metres: the prior's where the labels say nothing."""
        return np.asarray(np.sqrt(np.diagonal(self.covariance)))

    @property
    def interval(self) -> Array:
        """From and to, (2, 2) metres: each column holds the truth with a probability of 95 %. The legal sizes cut it
        off."""
        assert self.field.size_model is not None  # the size was estimated under it
        size, half = np.array([self.length, self.width]), DEVIATIONS * self.std_deviations
        return np.asarray(np.clip([size - half, size + half], *self.field.size_model.limits))

    def __str__(self) -> str:
        """What is known, in words."""
        sizes, deviations = (self.length, self.width), self.std_deviations
        return "; ".join(map(_in_words, ("length", "width"), sizes, deviations, self.from_labels))


def _in_words(name: str, metres: float, deviation: float, share: float) -> str:
    if share < SILENT:
        return f"{name}: the labels say nothing, {metres:.1f} ± {deviation:.1f} m is from the prior"
    origin = "from the labels" if share >= 0.5 else f"mostly from the prior ({100.0 * share:.0f} % from the labels)"
    return f"{name}: {metres:.2f} ± {deviation:.2f} m {origin}"


def estimate_field_size(
    field: Field,
    frames: Sequence[ImageSegments],
    image_size: tuple[int, int],
    *,
    flags: int = DEFAULT_FLAGS,
    prior: Prior = "all",
    tau: float | None = None,
) -> FieldSize:
    """Calibrate frames of one pitch together with its length and width.

    Length and width are normal a priori, with the size of `field` as mean and the usual range of its `size_model` as
    width of the 95 % interval. For `soccer` that is the range of law 1 for international matches, 100 to 110 m and 64
    to 75 m: sigma is 2.55 and 2.81 m. The estimate stays within the legal sizes, 90 to 120 m and 45 to 90 m. Only
    accepted frames take part.

    A frame tells the width from both touchlines, or from one and what lies in the middle; the length from a goal line
    or a penalty area together with the middle line or the centre circle, or from both halves.

    Parameters
    ----------
    field : Field
        The pitch as `soccer` makes it, of the most likely size; or another field with a `size_model`.
    frames : sequence of mappings of str to (N, 2) array_like
        Pixels of one or several frames of the same pitch.
    image_size : (int, int)
        Width and height of every frame, pixels.
    flags, prior, tau
        As in `calibrate_batch`, for the cameras.

    Returns
    -------
    FieldSize
        The mean of the prior where the labels say nothing, or no frame is accepted.

    Raises
    ------
    ValueError
        If the field does not know how its segments move with its size, or is of no legal size; otherwise as
        `calibrate_batch`.

    References
    ----------
    IFAB, Laws of the Game, law 1, sections 3 and 4. The range as a 95 % interval: Theiner, Ewerth: TVCalib, WACV 2023,
    appendix "Camera Distribution".

    Examples
    --------
    >>> from fieldcalib import Camera, soccer
    >>> pitch, frames = soccer(101.0, 66.5), []
    >>> for pan in (-0.6, -0.2, 0.2, 0.6):
    ...     camera = Camera.from_angles(pan, 1.35, 0.0, 900.0, (0.0, 68.0, -17.0), (960, 540))
    ...     seen = {label: camera.project(segment.sample(2.0)) for label, segment in pitch.markings.items()}
    ...     frames.append({label: xy[((xy > 0.0) & (xy < (959, 539))).all(axis=1)] for label, xy in seen.items()})
    >>> found = estimate_field_size(soccer(), frames, (960, 540))
    >>> round(found.length, 1), round(found.width, 1), found.from_labels.round(2)
    (101.0, 66.6, array([0.98, 0.98]))
    >>> middle = {label: frames[1][label] for label in ("Middle line", "Circle central", "Side line top")}
    >>> print(str(estimate_field_size(soccer(), [middle], (960, 540))).split("; ")[0])
    length: the labels say nothing, 105.0 ± 2.6 m is from the prior
    """
    mean, sizes = _checked_size(field)
    size = mean

    def calibrated(size: Array) -> list[Calibration]:
        return calibrate_batch(field.resized(*size.tolist()), frames, image_size, flags=flags, prior=prior, tau=tau)

    calibrations, motion = calibrated(size), _motion(field)
    for _ in range(STEPS):
        # where none is accepted, the size may be why
        parts = _parts(calibrations, Status.ACCEPTED) or _parts(calibrations, Status.NOT_CONVERGED, Status.IMPLAUSIBLE)
        moved = _moved(size, parts, motion, mean, sizes)
        if np.max(np.abs(moved - size)) < STILL:
            break
        size = moved
        calibrations = calibrated(size)
    accepted = _parts(calibrations, Status.ACCEPTED)
    if not accepted and np.any(size != mean):
        size, calibrations = mean, calibrated(mean)
    covariance, share = _uncertainty(accepted, motion, sizes.sigma)
    return FieldSize(field.resized(*size.tolist()), covariance, share, tuple(calibrations))


def _checked_size(field: Field) -> tuple[Array, SizePrior]:
    """(length, width) of a field that is of a legal size and knows how its segments move, and its prior."""
    if not isinstance(field, Field):
        raise ValueError(f"expected a field as soccer(length, width) makes it, got {type(field).__name__}")
    sizes = field.resized(field.length, field.width).size_model
    assert sizes is not None  # else it cannot be resized
    size, (low, high) = np.array([field.length, field.width]), sizes.limits
    if np.any(size < low) or np.any(size > high):
        raise ValueError(
            f"expected a pitch of {low[0]:g} to {high[0]:g} x {low[1]:g} to {high[1]:g} m ({sizes.rules}) whose size "
            f"is to be estimated, got {field.length:g} x {field.width:g}; give a likely size in metres, the touchline "
            f"first"
        )
    return size, sizes


def _motion(field: Field) -> Array:
    """How the segments move with length and width, in the order of the field: (L, 3, 2), metres a metre.

    As their middles do: beyond that, a line only grows along itself.
    """

    def middles(pitch: Field) -> Array:
        return np.array([segment.sample().mean(axis=0) for segment in pitch.values()])

    longer = field.resized(field.length + 1.0, field.width)
    wider = field.resized(field.length, field.width + 1.0)
    return np.stack([middles(longer), middles(wider)], axis=-1) - middles(field)[..., None]


def _parts(calibrations: Sequence[Calibration], *statuses: Status) -> list[Solved]:
    """The frames that have one of the statuses, with one prior of the camera's place for all of them.

    What one frame learns from it about the length is little, but frames of one pitch may have one camera: its prior is
    no news in the second one.
    """
    together: dict[int, list[Solved]] = {}
    for calibration in calibrations:
        if calibration.status in statuses and calibration.solved is not None:
            together.setdefault(id(calibration.solved.problem), []).append(calibration.solved)
    count = sum(map(len, together.values()))
    parts = []
    for members in together.values():
        frames, one = np.array([solved.frame for solved in members]), members[0]
        problem = one.problem.take(frames)
        problem = replace(problem, observations=problem.observations.without_ends)
        if problem.prior is not None:
            sigma = problem.prior.sigma.copy()
            sigma[:, CENTER] *= np.sqrt(count)
            problem = replace(problem, prior=GaussianPrior(problem.prior.mean, sigma))
        parts.append(Solved(problem, one.theta[frames], one.unit[frames]))
    return parts


@dataclass(frozen=True)
class _Linearized:
    """B frames linearised in P free parameters of their cameras and two of the size, Q = P + 2."""

    J: Array
    """Derivatives of the residuals, (B, M, Q)."""
    weight: Array
    """Of the residuals under the loss, (B, M)."""
    gradient: Array
    """Of the cost with the cameras' prior, (B, Q)."""
    data: Array
    """Gauss-Newton Hessian of the data alone, (B, Q, Q)."""
    prior: Array
    """What the cameras' prior adds to it, (B, Q, Q)."""


def _linearized(part: Solved, motion: Array) -> _Linearized:
    problem, theta = part.problem, part.theta
    r, J = segment_residuals_with_jacobian(theta, problem.observations, problem.free)
    P = J.shape[2]
    center = np.searchsorted(np.flatnonzero(problem.free), np.arange(CENTER.start, CENTER.stop))
    by_size = -np.einsum("bmc,bmcs->bms", J[:, :, center], motion[problem.observations.label])
    J = np.concatenate([J, by_size], axis=-1)
    _, slope = problem.loss.evaluate(np.square(r))
    weight = problem.observations.weight / problem.noise**2 * slope
    JT = np.swapaxes(J, 1, 2) * weight[:, None]
    gradient, data = (JT @ r[..., None])[..., 0], JT @ J
    prior = np.zeros_like(data)
    _, gradient[:, :P], hessian = problem.linearized(theta)
    prior[:, :P, :P] = hessian - data[:, :P, :P]
    return _Linearized(J, weight, gradient, data, prior)


def _eliminated(hessian: Array) -> tuple[Array, Array]:
    """L (B, 2, Q) that takes gradients to those by the size with the cameras following, and Schur's complement."""
    P = hessian.shape[1] - 2
    following = -np.linalg.solve(hessian[:, :P, :P], hessian[:, :P, P:])
    L = np.concatenate([np.swapaxes(following, 1, 2), np.tile(np.eye(2), (len(hessian), 1, 1))], axis=-1)
    return L, L @ hessian[:, :, P:]


def _moved(size: Array, parts: Sequence[Solved], motion: Array, mean: Array, sizes: SizePrior) -> Array:
    """The size (2,) after a step, within the legal ones."""
    gradient, hessian = (size - mean) / sizes.sigma**2, np.diag(sizes.sigma**-2)
    for part in parts:
        linear = _linearized(part, motion)
        L, complement = _eliminated(linear.data + linear.prior)
        gradient = gradient + np.einsum("bsq,bq->s", L, linear.gradient)
        hessian = hessian + np.sum(complement, axis=0)
    return np.asarray(np.clip(size - np.linalg.solve(hessian, gradient), *sizes.limits))


def _uncertainty(parts: Sequence[Solved], motion: Array, sigma: Array) -> tuple[Array, Array]:
    """Covariance (2, 2) and shares from the labels (2,) of the most likely size."""
    curvature, pulls = np.diag(sigma**-2), np.diag(sigma**-2)  # A and what is between the A^-1
    for part in parts:
        found = uncertainties(part.problem, part.theta, part.unit)
        linear = _linearized(part, motion)
        kappa, noise_sigma = np.array([(one.curvature, one.bent_sigma) for one in found]).T[..., None, None]
        L, complement = _eliminated(kappa * linear.data + linear.prior)
        noise = Noise(part.problem.observations)
        pull = linear.weight * noise.relative_sigma
        between = noise_sigma**2 * noise.covariance(linear.J, pull, pull) + linear.prior
        curvature = curvature + np.sum(complement, axis=0)
        pulls = pulls + np.sum(L @ between @ np.swapaxes(L, 1, 2), axis=0)
    inverse = np.linalg.inv(curvature)
    share = np.maximum(1.0 - np.diagonal(inverse) / sigma**2, 0.0)  # below 0 by rounding
    return inverse @ pulls @ inverse, share
