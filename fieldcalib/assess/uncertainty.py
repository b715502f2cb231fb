"""The uncertainty of a frame that was calibrated by itself: covariance, and observability by the labels.

The solver minimises ``1/2 sum w_i rho(r_i^2) / noise^2 + 1/2 sum z_k^2``, in which each segment has the same weight.
These weights are not inverse variances, so the inverse of its Hessian is not a covariance. To first order the error is

    A^-1 (sum_i w_i / noise^2 psi(e_i) J_i + P (mean - theta)),        A = kappa H + P,

with e the noise of the pixels, ``psi(r) = r rho'``, H the Gauss-Newton Hessian of the data, P the prior's precision and
kappa the mean of psi' divided by the mean of rho', which takes the place of psi' in H. With noise of standard deviation
sigma and correlation c, and cameras distributed as the prior, the covariance of the error is the sandwich

    A^-1 (sigma^2 sum_ij c_ij v_i v_j J_i J_j^T + P) A^-1,        v_i = w_i rho'_i / noise^2.

Segments are independent: c is 0 between them. Pixels of one segment share a small part of their noise.

Sigma comes from the residuals of the frame, divided by the redundancy of the fit, and is moderated by the noise of
other frames, as few labels hardly determine their own noise. Regions then follow Student's and Fisher's distributions.

References: Huber, Ronchetti: Robust Statistics, 2nd edition, 2009, section 7.6 (the sandwich). Smyth: Linear Models and
Empirical Bayes Methods, 2004, section 3 (moderated variances).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from fieldcalib._types import Array, BoolArray
from fieldcalib.assess.estimate import Estimate
from fieldcalib.assess.label_errors import Noise, gram, size_and_curvature
from fieldcalib.assess.observability import OPEN_DIRECTION, Direction, Information
from fieldcalib.assess.size_evidence import FAINT, SizeEvidence
from fieldcalib.fields.field import Field
from fieldcalib.geometry.camera import Camera
from fieldcalib.problem.evaluation import Evaluation, Problem, evaluate
from fieldcalib.problem.layout import POSE_AND_ZOOM, PRINCIPAL_POINT, ROLL, Layout, Role

# Number of equations as which the noise of other frames counts. Smyth's fit gives 6 on 399 frames of SoccerNet, whose
# pixels have a median sigma of 1.3 px at 960 x 540, and 11 on 93 of WC14 (0.7); here it is less, as annotators differ.
OTHER_FRAMES = 5.0
# Probability of level ground below which labels exclude it: of 2,000 drawn frames, a third of them of crowned fields,
# 14 that seemed good on level ground are then more probably wrong, and all 14 are.
LEAST_LEVEL = 0.1
TESTED = ("log aspect", "b2")  # parameters that are usually kept fixed, in the order of theta
GIVEN = ("pan", "tilt", "roll", "log f", "x", "y", "z", "cx", "cy", "a1")  # that users give, in the order of theta
TOUCHED = 1e-6  # share of a derivative along open directions: less is rounding


@dataclass(frozen=True, eq=False, repr=False)
class Uncertainty(Estimate):
    """An estimate from the labels of one frame, with its uncertainty.

    Examples
    --------
    >>> from fieldcalib import Camera, calibrate_from_segments, soccer
    >>> camera = Camera.from_angles(-0.3, 1.35, 0.0, 1600.0, (0.0, 68.0, -17.0), (960, 540))
    >>> labels = ("Side line left", "Side line top", "Big rect. left main", "Big rect. left top", "Circle left")
    >>> frame = {label: camera.project(soccer()[label].sample(7.0)) for label in labels}
    >>> uncertainty = calibrate_from_segments(soccer(size_known=True), frame, (960, 540)).uncertainty
    >>> uncertainty.std_deviations_intrinsics[:4, 0].round()
    array([19., 19., 18., 19.])
    >>> round(float(uncertainty.at_field((-40.0, 0.0, 0.0)).rms), 2)  # metres
    0.05
    """

    evaluation: Evaluation
    """The problem of this frame alone, at the estimate. Parameters that are not free in it count as known."""
    sigma: float
    """Standard deviation of the labelled pixels, pixels."""
    robust_sigma: float
    """Standard deviation of the noise after robust weighting, ``psi / rms rho'``, pixels."""
    curvature: float
    """kappa: mean curvature of the robust loss, divided by the one in the Gauss-Newton Hessian of the data."""
    dof: float
    """Degrees of freedom of sigma."""
    unit: Array
    """Standard deviations (n,) in whose units information is measured; 0 for parameters that are not free."""
    determined: Array
    """Covariance (n, n) along the determined directions, 0 along open ones, without errors of considered parameters."""
    open: Array
    """Open directions (n, k): neither labels nor prior determine them."""
    information: Information
    """Information from the labels."""
    by_considered: Array
    """Derivatives (n, c) of the error of the estimate by the errors of the considered parameters: length, width and
    crown of the field, or parameters shared by many frames."""
    size: SizeEvidence | None
    """Those of size and crown of the field that are not exact, as estimated from this frame; None if all are, or are
    known with a covariance."""
    offsets: Mapping[str, tuple[float, float]]
    """Error, to first order, of "log aspect" and "b2" (the second radial coefficient) if they are kept fixed, and its
    standard deviation."""
    following: Mapping[str, Array]
    """Derivatives (n,) of the estimate by these parameters."""
    off_given: Mapping[str, tuple[float, float]]
    """Parameters that were given: by how much, to first order, the labels want to move one of them if it alone is
    freed, and the standard deviation of that. The size of the field is as uncertain as it is a priori."""
    field: Field | None = None
    """The field in view; None if the object is not a `Field`, or unknown."""

    def on(self, field: Field | None) -> Uncertainty:
        """The estimate with another field in view: errors are then relative to its markings."""
        return replace(self, field=field)

    def widened(self, factor: float) -> Uncertainty:
        """The estimate with errors larger by a factor, but for those of the considered parameters."""
        return self if factor == 1.0 else replace(self, determined=factor**2 * self.determined)

    @property
    def told_crown(self) -> float:
        """Expected height of the middle of the field, metres, if it was solved level, and the labels exclude that."""
        found, given = self.size, self.layout.field_size
        is_level = given is not None and given.height == 0.0
        return float(found.mean[-1]) if found is not None and is_level and found.level < LEAST_LEVEL else 0.0

    @cached_property
    def possibilities(self) -> tuple[Array, Array]:
        """Probabilities (K,) of the possible fields, and second moments of the considered parameters, (K, c, c)."""
        if self.size is not None:
            return self.size.weights, self.size.moments
        c, known = self.by_considered.shape[1], self.problem.considered
        return np.ones(1), (np.zeros((c, c)) if known is None else known)[None]

    @cached_property
    def _covariance_by_considered(self) -> Array:
        return np.asarray(self.by_considered @ np.tensordot(*self.possibilities, axes=1) @ self.by_considered.T)

    @cached_property
    def observability(self) -> tuple[Direction, ...]:
        """Directions of the free parameters, least determined by the labels first."""
        return self.information.directions(0)

    @property
    def problem(self) -> Problem:
        """The problem that was solved."""
        return self.evaluation.problem

    @property
    def theta(self) -> Array:  # type: ignore[override]
        """The estimate, (n,)."""
        return np.asarray(self.evaluation.theta[0])

    @property
    def layout(self) -> Layout:  # type: ignore[override]
        """Names and order of the parameters."""
        return self.problem.layout

    def propagated(self, J: Array) -> Array:
        """Covariance (..., m, m) of quantities whose derivatives by theta are J (..., m, n)."""
        covariance = J @ (self.determined + self._covariance_by_considered) @ np.swapaxes(J, -2, -1)
        if not self.open.shape[1]:
            return np.asarray(covariance)
        is_open = self.is_open(J)  # their variance is infinite, and NaN off the diagonal
        covariance = np.where(is_open[..., :, None] | is_open[..., None, :], np.nan, covariance)
        diagonal = np.arange(J.shape[-2])
        covariance[..., diagonal, diagonal] = np.where(is_open, np.inf, covariance[..., diagonal, diagonal])
        return covariance

    def is_open(self, J: Array) -> BoolArray:
        """Mask (...) of the quantities, with derivatives J (..., n), that nothing determines."""
        along = np.linalg.norm(J @ self.open, axis=-1)
        return np.asarray(along > TOUCHED * np.linalg.norm(J * self.unit, axis=-1))

    def distance(self, camera: Camera) -> float:
        """Distance of another camera from the estimate, in standard deviations: Rao's score.

        ``sqrt(g^T V^-1 g)``, where g is the gradient of the cost at that camera and V is the covariance of g if that
        camera is the true one. ``radius(number of free parameters)`` bounds the cameras that agree with the frame.
        Unlike the ellipsoid of `covariance`, this region follows the curved valley of cameras with similar images.
        """
        theta = self.problem.layout.theta(camera)
        theta[self.problem.layout.field_size_block] = self.theta[self.problem.layout.field_size_block]
        there = evaluate(self.problem, theta[None])
        noise = Noise(there)
        V = self.robust_sigma**2 * noise.covariance(there.JT)[0]
        if there.prior is not None:
            V += np.diag(1.0 / np.square(there.prior.effective_sigma[0]))
        scale = 1.0 / np.sqrt(np.diagonal(V))
        g = scale * there.gradient[0]
        return float(np.sqrt(g @ np.linalg.lstsq(scale[:, None] * V * scale, g, rcond=None)[0]))

    def __str__(self) -> str:
        """Parameters by origin: from the labels, mostly from the prior, or open."""
        has_prior = self.problem.prior is not None
        groups: dict[str, list[str]] = {}
        for direction in self.observability:
            what = direction.parameters
            if direction.information >= (1.0 if has_prior else OPEN_DIRECTION):
                origin = "from the labels"
            elif has_prior:
                origin, what = "mostly from the prior", f"{what} ({100.0 * direction.share:.0f} % from the labels)"
            else:
                origin = "open"
            groups.setdefault(origin, []).append(what)
        return "; ".join(f"{origin}: {', '.join(names)}" for origin, names in groups.items())


def uncertainties(evaluation: Evaluation, unit: Array) -> list[Uncertainty]:
    """The uncertainty of each of B estimates.

    Parameters
    ----------
    evaluation : Evaluation
        Solved problems. Their prior, if any, is taken as the distribution of the true cameras.
    unit : (B, n) array
        Standard deviations in whose units information is measured: those of the prior, if there is one.

    Returns
    -------
    list of B Uncertainty
    """
    problem, layout = evaluation.problem, evaluation.problem.layout
    free, has_prior = problem.free, problem.prior is not None
    scale = unit[:, free] if evaluation.prior is None else evaluation.prior.effective_sigma
    information = Information.of(evaluation, scale)
    directions = _Directions.of(evaluation, information, scale)
    noise = Noise(evaluation)
    variance, dof = _variance(evaluation, noise, directions)
    sigma, kappa = size_and_curvature(problem.loss, variance)

    is_given = _is_given(evaluation)
    is_tested = np.any(is_given, axis=0) | (np.isin(layout.names, TESTED) & ~free)
    tested = [name for name, is_one in zip(layout.names, is_tested, strict=True) if is_one]
    by_kept = np.concatenate([evaluation.derivatives(some) for some in (layout.considered, is_tested)], axis=1)
    rows = np.concatenate([directions.JT, by_kept], axis=1)
    noisy = variance[:, None, None] * noise.covariance(rows)
    noisy += noise.of_paint(rows, evaluation.irls_weight)
    P, sizes = directions.JT.shape[1], by_kept.shape[1] - len(tested)
    gain = directions.gain(kappa, has_prior)
    noisy[:, :P, :P] += has_prior * np.eye(P)
    kept = _Kept.of(evaluation, rows, gain, kappa, noisy)

    by_kept_value = np.zeros((len(problem), layout.size, by_kept.shape[1]))
    by_kept_value[:, free] = directions.theta @ kept.following
    by_kept_value[:, [*np.flatnonzero(layout.considered), *np.flatnonzero(is_tested)]] = np.eye(by_kept.shape[1])
    units, along = np.zeros_like(evaluation.theta), np.zeros((len(problem), layout.size, P))
    units[:, free], along[:, free] = scale, directions.theta
    usual = [(i, name) for i, name in enumerate(tested, sizes) if name in TESTED]
    columns: dict[str, Any] = {
        "sigma": sigma.tolist(),
        "robust_sigma": np.sqrt(variance).tolist(),
        "curvature": kappa.tolist(),
        "dof": dof.tolist(),
        "unit": units,
        "determined": _whole(directions.theta * gain[:, None], noisy[:, :P, :P], free),
        "open": [one[:, is_open & (not has_prior)] for one, is_open in zip(along, directions.is_open, strict=True)],
        "by_considered": -by_kept_value[:, :, :sizes],  # errors: given minus true values
        "size": _size_evidence(problem, kept),
        "offsets": [{name: kept.offset(t, i) for i, name in usual} for t in range(len(problem))],
        "following": [{name: by_kept_value[t, :, i] for i, name in usual} for t in range(len(problem))],
        "off_given": _off_given(evaluation, kept, is_given, tested, sizes),
    }
    return [
        Uncertainty(
            evaluation=evaluation.take(slice(t, t + 1)),
            information=information.take(slice(t, t + 1)),
            **{name: values[t] for name, values in columns.items()},
        )
        for t in range(len(problem))
    ]


class _Directions(NamedTuple):
    """Coordinates of B estimates, in units of the prior, in which information and prior are diagonal."""

    theta: Array
    """Derivatives (B, P, P) of the free parameters by the coordinates."""
    JT: Array
    """Derivatives (B, P, M) of the residuals by the coordinates."""
    information: Array
    """Information (B, P) of the labels along each coordinate; that of the prior is 1."""

    @classmethod
    def of(cls, evaluation: Evaluation, labels: Information, scale: Array) -> _Directions:
        information, V = labels.eigen
        theta = scale[:, :, None] * V
        return cls(theta, np.swapaxes(theta, 1, 2) @ evaluation.JT, information)

    @property
    def is_open(self) -> BoolArray:
        """Which directions the labels leave open, (B, P)."""
        return self.information < OPEN_DIRECTION

    def gain(self, kappa: Array, has_prior: bool) -> Array:
        """Inverse curvature (B, P) of the cost along the directions, 0 along open ones."""
        lost = self.is_open & (not has_prior)
        return np.asarray(1.0 / np.where(lost, np.inf, kappa[:, None] * self.information + has_prior))


def _variance(evaluation: Evaluation, noise: Noise, directions: _Directions) -> tuple[Array, Array]:
    """Variance (B,) of ``psi / rms rho'``, moderated by the noise of other frames, and its degrees of freedom, (B,).

    The redundancy is the trace of ``(1 - G)^T D (1 - G)``, D being `noise.square` and G = J A^-1 J^T W the response of
    the fit to the pixels.
    """
    squares = gram(directions.JT, noise.square)
    spread = noise.covariance(directions.JT)
    crossed = noise.covariance(directions.JT, noise.square * noise.relative_sigma)
    gain = directions.gain(np.ones(len(evaluation.theta)), evaluation.problem.prior is not None)
    redundancy = (
        np.sum(noise.square * np.square(noise.relative_sigma), axis=1)
        - 2.0 * np.einsum("bii,bi->b", crossed, gain)
        + np.einsum("bij,bi,bij,bj->b", squares, gain, spread, gain)
    )
    dof = OTHER_FRAMES + np.maximum(redundancy, 0.0)
    total = OTHER_FRAMES * evaluation.problem.noise**2 + np.sum(noise.square * np.square(evaluation.r), axis=1)
    return total / dof, dof


class _Kept(NamedTuple):
    """Derivatives of the cost of B frames by k parameters kept at given values, while the camera is fitted to them."""

    following: Array
    """Derivatives (B, P, k) of the fitted camera, along the directions."""
    gradient: Array
    """Gradient (B, k) of the cost."""
    information: Array
    """Hessian (B, k, k) of the cost: the Schur complement."""
    spread: Array
    """Covariance (B, k, k) of the gradient."""

    @classmethod
    def of(cls, evaluation: Evaluation, rows: Array, gain: Array, kappa: Array, noisy: Array) -> _Kept:
        """Compute from derivatives `rows` (B, P + k, M) of the residuals; `noisy` is the covariance of the gradient."""
        P = gain.shape[1]
        by_kept = rows[:, P:]
        crossed = kappa[:, None, None] * gram(rows, evaluation.irls_weight)[:, :P, P:]
        following = -gain[:, :, None] * crossed
        information = (
            kappa[:, None, None] * gram(by_kept, evaluation.irls_weight) + np.swapaxes(crossed, 1, 2) @ following
        )
        identity = np.broadcast_to(np.eye(by_kept.shape[1]), information.shape)
        L = np.concatenate([np.swapaxes(following, 1, 2), identity], axis=2)
        gradient = (by_kept @ (evaluation.irls_weight * evaluation.r)[..., None])[..., 0]
        return cls(following, gradient, information, L @ noisy @ np.swapaxes(L, 1, 2))

    def offset(self, t: int, i: int) -> tuple[float, float]:
        """Error of parameter i by the labels of frame t, to first order, and its standard deviation."""
        information = max(self.information[t, i, i], FAINT)
        return float(-self.gradient[t, i] / information), float(np.sqrt(max(self.spread[t, i, i], 0.0)) / information)

    def offset_with(self, t: int, i: int, S: Array) -> tuple[float, float]:
        """`offset` if the first c parameters are estimated together with it, whose covariance a priori is S (c, c)."""
        c, information = len(S), self.information[t]
        # a = -(I + S^-1)^-1 I_i of these parameters, written for an S that may be singular: a = -S b
        b = np.linalg.solve(np.eye(c) + information[:c, :c] @ S, information[:c, i])
        row = np.eye(len(information))[i]
        row[:c] -= S @ b
        curvature = max(float(row @ information[:, i]), FAINT)
        variance = float(row @ self.spread[t] @ row + b @ S @ b)
        return float(-row @ self.gradient[t]) / curvature, float(np.sqrt(max(variance, 0.0))) / curvature


def _is_given(evaluation: Evaluation) -> BoolArray:
    """Mask (B, n) of the parameters of `GIVEN` that were given.

    Pose and zoom are kept only at given values; roll, principal point and lens at 0 and the middle of the picture too,
    as simplifications, which labels often contradict and which harm little.
    """
    layout = evaluation.problem.layout
    simplest = np.zeros(layout.size)
    simplest[POSE_AND_ZOOM] = np.nan
    simplest[ROLL], simplest[PRINCIPAL_POINT] = 0.0, np.divide(layout.image_size, 2.0)
    is_fixed = np.isin(layout.names, GIVEN) & (layout.roles == Role.FIXED)
    return np.asarray(is_fixed & (evaluation.theta != simplest))


def _off_given(
    evaluation: Evaluation, kept: _Kept, is_given: BoolArray, tested: Sequence[str], sizes: int
) -> list[Mapping[str, tuple[float, float]]]:
    """`Uncertainty.off_given` of each frame; `tested` are the parameters of `kept` behind the first `sizes`."""
    if not np.any(is_given):
        return [{}] * len(is_given)
    problem = evaluation.problem
    names, S = problem.layout.names, problem.layout.prior_moment if problem.considered is None else problem.considered
    columns = {name: i for i, name in enumerate(tested, sizes)}
    return [
        {names[k]: kept.offset_with(t, columns[names[k]], S) for k in np.flatnonzero(is_given[t]).tolist()}
        for t in range(len(is_given))
    ]


def _size_evidence(problem: Problem, kept: _Kept) -> Sequence[SizeEvidence | None]:
    """Size and crown of the field estimated from each frame."""
    layout, size = problem.layout, problem.layout.field_size
    block = layout.field_size_block.start
    index = np.flatnonzero(layout.considered) - block
    if size is None or problem.considered is not None or not len(index) or np.any(layout.free[block:]):
        return [None] * len(problem)  # size and crown are exact, known with a covariance, or estimated
    probability, sigma = size.possibilities_with_crown
    c, room = len(index), None if size.is_known else size.limits - size.given + size.shift[:2]
    some = zip(kept.information[:, :c, :c], kept.gradient[:, :c], kept.spread[:, :c, :c], strict=True)
    prior, are_lines = (probability, sigma[:, index]), problem.paint > 0.0
    return [
        SizeEvidence.of(*one, prior, room, size.shift[index], are_lines=are_lines, scale=problem.scale) for one in some
    ]


def _whole(map_: Array, inner: Array, free: BoolArray) -> Array:
    """``map inner map^T`` (B, n, n) of the free parameters, with zeros for the others."""
    index = np.flatnonzero(free)
    whole = np.zeros((len(map_), len(free), len(free)))
    whole[:, index[:, None], index] = map_ @ inner @ np.swapaxes(map_, 1, 2)
    return whole
