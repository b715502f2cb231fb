"""How far a calibration may be off: covariance, metres on the field, and what the labels determine.

The solver minimises ``1/2 sum w_i rho(r_i^2) / noise^2 + 1/2 sum z_k^2``, in which each segment counts alike. Its
weights are no inverse variances, so the inverse of its Hessian is no covariance. To first order the estimate is off by

    A^-1 (sum_i w_i / noise^2 psi(e_i) J_i + P (mean - theta)),        A = kappa H + P,

e being the noise of the pixels, ``psi(r) = r rho'``, H the Gauss-Newton Hessian of the data, P the prior's precision
and kappa the mean of psi' by that of rho', which H has in its stead. With noise of standard deviation sigma and
correlation c, and cameras that come from the prior, the covariance of that is the sandwich

    A^-1 (sigma^2 sum_ij c_ij v_i v_j J_i J_j^T + P) A^-1,        v_i = w_i rho'_i / noise^2.

Segments are independent, c is 0 between them; pixels of one segment share a small part of their noise.

Sigma comes from the residuals of the frame, divided by the redundancy that the fit leaves them, and is moderated by the
noise of other frames: few labels tell little about their own noise. Regions are then those of Student and Fisher.

References: Huber, Ronchetti: Robust Statistics, 2nd edition, 2009, section 7.6 (the sandwich). Smyth: Linear Models and
Empirical Bayes Methods, 2004, section 3 (moderated variances).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fieldcalib._types import Array, BoolArray
from fieldcalib.assess.estimate import Estimate
from fieldcalib.assess.level import if_level
from fieldcalib.assess.noise import Noise, gram, size_and_curvature
from fieldcalib.assess.observability import OPEN_DIRECTION, Direction, Information
from fieldcalib.assess.size_evidence import FAINT, SizeEvidence
from fieldcalib.fields.field import Field
from fieldcalib.geometry.camera import Camera
from fieldcalib.problem.evaluation import Evaluation, Problem, evaluate
from fieldcalib.problem.layout import Layout

# Equations that the noise of other frames counts for. Smyth's fit gives 6 on 399 frames of SoccerNet, whose pixels have
# a median sigma of 1.3 px at 960 x 540, and 11 on 93 of WC14 (0.7): fewer, as other annotators may be unlike both.
OTHER_FRAMES = 5.0
TESTED = ("log aspect", "b2")  # parameters that are usually kept fixed
TOUCHED = 1e-6  # share of a derivative along an open direction that is more than rounding


@dataclass(frozen=True, eq=False, repr=False)
class Uncertainty(Estimate):
    """How far a calibration may be off.

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
    """The problem of this frame alone, at the estimate. What is not free in it counts as known."""
    sigma: float
    """Standard deviation of the labelled pixels, pixels."""
    bent_sigma: float
    """That of ``psi / rms rho'``: sigma as the robust loss lets it through."""
    curvature: float
    """kappa: by it the loss bends less than the Gauss-Newton Hessian of the data says."""
    dof: float
    """Degrees of freedom that sigma rests on."""
    unit: Array
    """(n,) standard deviations on which a parameter counts as determined, 0 for what is not free."""
    determined: Array
    """Covariance of what is determined, (n, n): 0 along open directions. Without that of considered parameters."""
    open: Array
    """Directions (n, k) that nothing determines, neither labels nor prior."""
    determined_by_labels: Array
    """As `determined`, without the prior."""
    open_to_labels: Array
    """As `open`, without the prior."""
    information: Information
    """What the labels say."""
    by_considered: Array
    """How the error of the estimate grows with the true values of the considered parameters less those that they are
    kept at, (n, c): length and width of the field, or what many frames share; (n, 0) if nothing is considered."""
    size: SizeEvidence | None
    """What the frame says about the size of its field, if that is level; None if the size is exact, or known with a
    covariance."""
    with_crown: SizeEvidence | None
    """What it says about size and crown together; None if all such fields are level, or as `size`."""
    offsets: Mapping[str, tuple[float, float]]
    """How far off the labels would put what was kept fixed, to first order, and the standard deviation of that: of
    "log aspect" and of "b2", the second radial coefficient."""
    field: Field | None = None
    """What is in view; None if that is no `Field`, or not known."""

    def on(self, field: Field | None) -> Uncertainty:
        """Name the field that is in view: errors are then relative to its markings."""
        return replace(self, field=field)

    @property
    def if_level(self) -> Uncertainty:
        """The errors if the field were known to be level."""
        if self.size is not None:
            return self if self.with_crown is None else replace(self, with_crown=None)
        problem = self.problem
        if problem.considered is None or not np.any(problem.layout.is_crown):
            return self
        considered = if_level(problem.considered, problem.layout.is_crown[problem.layout.considered])
        return replace(self, evaluation=self.evaluation.of(replace(problem, considered=considered)))

    @cached_property
    def possibilities(self) -> tuple[Array, Array]:
        """Probabilities (K,) of what the field may be, and second moments of the considered parameters, (K, c, c)."""
        c, found = self.by_considered.shape[1], self.with_crown or self.size
        if found is None:
            return np.ones(1), np.zeros((1, c, c)) if self.problem.considered is None else self.problem.considered[None]
        level = c - found.moments.shape[1]  # quantities that are 0
        return found.weights, np.pad(found.moments, ((0, 0), (0, level), (0, level)))

    @cached_property
    def _of_any_considered(self) -> Array:
        moment = np.tensordot(*self.possibilities, axes=1)
        return np.asarray(self.by_considered @ moment @ self.by_considered.T)

    @cached_property
    def observability(self) -> tuple[Direction, ...]:
        """Directions of the free parameters, what the labels determine least first."""
        return self.information.directions(0)

    @property
    def problem(self) -> Problem:
        """What was solved."""
        return self.evaluation.problem

    @property
    def theta(self) -> Array:
        """The estimate, (n,)."""
        return np.asarray(self.evaluation.theta[0])

    @property
    def layout(self) -> Layout:
        """Of the parameters."""
        return self.problem.layout

    def propagated(self, J: Array) -> Array:
        """Covariance (..., m, m) of quantities whose derivatives by theta are J (..., m, n)."""
        return _propagated(J, self.determined + self._of_any_considered, self.open, self.unit)

    def is_open(self, J: Array) -> BoolArray:
        """Which quantities of derivatives J (..., n) nothing determines, (...)."""
        return _touched(J, self.open, self.unit)

    @property
    def covariance_by_labels(self) -> Array:
        """As `covariance`, of an estimate from these labels without a prior: infinite what they leave open.

        It may be the smaller one: the solver trusts labels less, and its prior more, than good labels deserve.
        """
        determined = self.determined_by_labels + self._of_any_considered
        return _propagated(np.eye(len(self.theta)), determined, self.open_to_labels, self.unit)

    def distance(self, camera: Camera) -> float:
        """How far another camera is from the estimate, in standard deviations: Rao's score.

        ``sqrt(g^T V^-1 g)`` with g the gradient of the cost at that camera and V the covariance of it if that camera
        were the true one. ``radius(number of free parameters)`` bounds the cameras that agree with the frame. Unlike
        the ellipsoid of `covariance`, this region follows the curved valley of cameras that see nearly the same.
        """
        theta = self.problem.layout.theta(camera)
        theta[self.problem.layout.field_size_block] = self.theta[self.problem.layout.field_size_block]
        there = evaluate(self.problem, theta[None])
        noise = Noise(there)
        pull = there.pull * noise.relative_sigma
        V = self.bent_sigma**2 * noise.covariance(there.JT, pull, pull)[0]
        if self.problem.prior is not None:
            V += np.diag(1.0 / np.square(there.pulling_prior_sigma[0]))
        scale = 1.0 / np.sqrt(np.diagonal(V))
        g = scale * there.gradient[0]
        return float(np.sqrt(g @ np.linalg.lstsq(scale[:, None] * V * scale, g, rcond=None)[0]))

    def __str__(self) -> str:
        """What the labels determine and what came from the prior, in words."""
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
        Solved problems. Their prior, if any, is what cameras are taken to come from.
    unit : (B, n) array
        Standard deviations on which a parameter counts as determined; those of the prior, where there is one.

    Returns
    -------
    list of B Uncertainty
    """
    problem, JT = evaluation.problem, evaluation.JT
    free, has_prior = np.flatnonzero(problem.free), problem.prior is not None
    noise = Noise(evaluation)
    pull = evaluation.pull * noise.relative_sigma  # of noise of one sigma on the estimate
    slope = problem.loss.evaluate(np.square(evaluation.r))[1]
    square = np.square(slope / noise.relative_sigma) * (problem.observations.weight > 0.0)  # what a pixel counts

    # in units of the prior and along the information's own directions, prior and information are diagonal
    scale = evaluation.pulling_prior_sigma if has_prior else unit[:, free]
    labels = Information.of(evaluation, scale)
    information, V = labels.eigen
    theta_of = scale[:, :, None] * V  # of coordinates along the directions
    along = np.swapaxes(theta_of, 1, 2) @ JT
    squares = gram(along, square)
    spread, crossed = (noise.covariance(along, factor, pull) for factor in (pull, square * noise.relative_sigma))
    is_open = information < OPEN_DIRECTION
    lost = is_open & (not has_prior)

    # with D the squares and G = J A^-1 J^T W the response of the fit to the pixels: trace of (1 - G)^T D (1 - G)
    gain = 1.0 / np.where(lost, np.inf, information + has_prior)
    response = np.einsum("bii,bi->b", crossed, gain)
    redundancy = (
        np.sum(square * np.square(noise.relative_sigma), axis=1)
        - 2.0 * response
        + np.einsum("bij,bi,bij,bj->b", squares, gain, spread, gain)
    )
    dof = OTHER_FRAMES + np.maximum(redundancy, 0.0)
    variance = (OTHER_FRAMES * problem.noise**2 + np.sum(square * np.square(evaluation.r), axis=1)) / dof
    sigma, kappa = size_and_curvature(problem.loss, variance)
    information_left = kappa[:, None] * information
    gain = 1.0 / np.where(lost, np.inf, information_left + has_prior)
    gain_by_labels = 1.0 / np.where(is_open, np.inf, information_left)

    tested = [name for name in TESTED if name in problem.layout.names and not _is_estimated(name, problem)]
    by_tested = [evaluation.derivatives(np.array(problem.layout.names) == name) for name in tested]
    by_size = evaluation.derivatives(problem.layout.considered)
    sizes, by_kept = by_size.shape[1], np.concatenate([by_size, *by_tested], axis=1)
    rows = np.concatenate([along, by_kept], axis=1)
    noisy = variance[:, None, None] * noise.covariance(rows, pull, pull) + noise.of_paint(rows, evaluation.pull)
    P = len(free)
    data, identity = noisy[:, :P, :P], np.eye(P)
    determined = _whole(theta_of * gain[:, None], data + has_prior * identity, problem.free)
    determined_by_labels = _whole(theta_of * gain_by_labels[:, None], data, problem.free)

    # with the camera following, what is kept has the Schur complement of its information
    crossed = kappa[:, None, None] * gram(rows, evaluation.pull)[:, :P, P:]
    following = -gain[:, :, None] * crossed  # of the coordinates along the directions
    of_kept = kappa[:, None, None] * gram(by_kept, evaluation.pull) + np.swapaxes(crossed, 1, 2) @ following
    L = np.concatenate([np.swapaxes(following, 1, 2), np.broadcast_to(np.eye(by_kept.shape[1]), of_kept.shape)], axis=2)
    noisy[:, :P, :P] += has_prior * identity
    spread_of_kept = L @ noisy @ np.swapaxes(L, 1, 2)
    gradient = (by_kept @ (evaluation.pull * evaluation.r)[..., None])[..., 0]
    by_true_value = np.zeros((len(problem), problem.layout.size, sizes))
    by_true_value[:, problem.free] = -theta_of @ following[:, :, :sizes]  # given less true, and so the other way
    by_true_value[:, problem.layout.considered] = -np.eye(sizes)
    units = np.zeros_like(evaluation.theta)
    units[:, free] = scale
    layout, size = problem.layout, problem.layout.field_size
    if problem.considered is not None or not np.all(layout.considered[layout.field_size_block]):
        size = None  # it is known with a covariance, or estimated
    with_crown = size and size.crown and size.possibilities_with_crown

    def evidence_of(t: int, c: int, prior: tuple[Array, Array]) -> SizeEvidence:
        assert size is not None
        information, spread = of_kept[t, :c, :c], spread_of_kept[t, :c, :c]
        return SizeEvidence.of(information, gradient[t, :c], spread, prior, size.limits - size.given)

    found = []
    for t in range(len(problem)):
        open_to_labels = np.zeros((problem.layout.size, np.count_nonzero(is_open[t])))
        open_to_labels[free] = theta_of[t][:, is_open[t]]
        found.append(
            Uncertainty(
                evaluation=evaluation.take(slice(t, t + 1)),
                sigma=float(sigma[t]),
                bent_sigma=float(np.sqrt(variance[t])),
                curvature=float(kappa[t]),
                dof=float(dof[t]),
                unit=units[t],
                determined=determined[t],
                open=open_to_labels[:, :0] if has_prior else open_to_labels,
                determined_by_labels=determined_by_labels[t],
                open_to_labels=open_to_labels,
                information=labels.take(slice(t, t + 1)),
                by_considered=by_true_value[t],
                size=size and evidence_of(t, 2, size.possibilities),
                with_crown=with_crown and evidence_of(t, 3, with_crown),
                offsets={
                    name: (
                        float(-gradient[t, i] / max(of_kept[t, i, i], FAINT)),
                        float(np.sqrt(max(spread_of_kept[t, i, i], 0.0)) / max(of_kept[t, i, i], FAINT)),
                    )
                    for i, name in enumerate(tested, sizes)
                },
            )
        )
    return found


def _is_estimated(name: str, problem: Problem) -> bool:
    return bool(problem.free[problem.layout.names.index(name)])


def _whole(map_: Array, inner: Array, free: BoolArray) -> Array:
    """``map inner map^T`` of the free parameters, among zeros for the others: (B, n, n)."""
    index = np.flatnonzero(free)
    whole = np.zeros((len(map_), len(free), len(free)))
    whole[:, index[:, None], index] = map_ @ inner @ np.swapaxes(map_, 1, 2)
    return whole


def _propagated(J: Array, determined: Array, open_directions: Array, unit: Array) -> Array:
    """Covariance (..., m, m) of quantities with derivatives J (..., m, n): infinite, NaN aside, where it is open."""
    covariance = J @ determined @ np.swapaxes(J, -2, -1)
    if not open_directions.shape[1]:
        return np.asarray(covariance)
    touched = _touched(J, open_directions, unit)
    covariance = np.where(touched[..., :, None] | touched[..., None, :], np.nan, covariance)
    diagonal = np.arange(J.shape[-2])
    covariance[..., diagonal, diagonal] = np.where(touched, np.inf, covariance[..., diagonal, diagonal])
    return covariance


def _touched(J: Array, open_directions: Array, unit: Array) -> BoolArray:
    """Whether quantities of derivatives J (..., n) move along open directions (n, k)."""
    along = np.linalg.norm(J @ open_directions, axis=-1)
    return np.asarray(along > TOUCHED * np.linalg.norm(J * unit, axis=-1))
