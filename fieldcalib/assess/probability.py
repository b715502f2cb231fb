"""The probability that a camera is right, from its uncertainty.

A camera is right to d metres if it locates every point of the field in view to better than that, relative to the
markings in view (`fieldcalib.assess.estimate`). With m the largest root mean square error of these points by its
covariance, sigma the noise of the labelled pixels (in units of the usual one), nu the degrees of freedom of sigma, and
z the z-scores of the camera under its prior, the log odds of being right are

    b0 + b1 log(m / d) + b2 log sigma + b3 log nu + b4 log(1 + z . z).

The covariance alone (b0 and b2 to b4 zero) gives nearly the right odds. The other terms lower them for frames with
large noise or an unusual camera, whose errors are larger than the covariance says: few labels, some of them wrong, or
a principal point far from the middle. The coefficients belong to a field and its cameras
(`fieldcalib.fields.traits.ProbabilityModel`).

Unusual estimates: parameters far from their prior, or fixed at values that the labels contradict.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from fieldcalib._types import Array, BoolArray
from fieldcalib.assess.estimate import Estimate, by_parameters
from fieldcalib.assess.findings import Finding, What
from fieldcalib.assess.ground import ground_derivatives, ground_of_pixels, pixels_of_points, projection_on
from fieldcalib.assess.uncertainty import OTHER_FRAMES, Uncertainty
from fieldcalib.fields.field import Field, tolerance_of
from fieldcalib.fields.ground import Terrain
from fieldcalib.fields.traits import ProbabilityModel
from fieldcalib.geometry.camera import Camera
from fieldcalib.problem.layout import LOG_F, Layout
from fieldcalib.problem.picture_shape import LEAST_ASPECT, has_square_pixels, is_whole_shape
from fieldcalib.problem.projection import Projection

UNUSUAL = 2.8  # z-score under the prior: 1 in 200 if it is normal; 8 of 728 annotated frames have one above 2.5
CONTRADICTED = 5.0  # standard deviations between a fixed value and the labels' one: up to 4.4 on annotated frames
# Standard deviations between a given value and the labels' one. Of 2,768 random frames (data_tools.random_frames) with
# right values and otherwise good, 2 are beyond.
CONTRADICTS_GIVEN = 3.0
# Labels determine a parameter if they leave at most this share of the prior's standard deviation, so that the estimate
# is theirs to three quarters, and lie on their markings: their noise, in units of the usual one, is at most 1.4 on nine
# of ten right pictures. Few pixels tell neither: with 50 degrees of freedom the noise is known to a tenth.
DETERMINED, USUAL_NOISE, LEAST_DOF = 0.5, 1.4, 50.0
MOST_MOVED = 0.5  # share of the field's tolerance: the rest is left to the errors of the camera itself
LEAST_SQUASH = 0.08  # log aspect: other pictures that are shown as 16:9 come from 16:10 (0.105) or 4:3 (0.29)
LEAST_LENS = 0.01  # relative displacement at the corner by k2
# Of k2, as b2: its standard deviation times f^4 / rho^4, a quarter of what an equidistant lens has there, and the least
# one that is asked for, that of a view of 45 degrees. Lenses that displace the corner by less by k1, as far as the
# labels tell, have no k2 either: among frames of such lenses the doubt cost 7 to 9 % of the right cameras.
K2_OF_VIEW, LEAST_K2, LEAST_K1 = 0.05, 0.0025, 0.02
LEAST_SIZE = 0.1  # probability of the given size of the field
# Errors of given values: the least one that is worth a word, and the standard deviation of wrong values. In radians,
# log focal length, metres, shares of the width of the picture, and relative displacement at the corner.
WRONG_GIVEN = {
    **dict.fromkeys(("pan", "tilt", "roll"), (0.01, 0.1)),
    "log f": (0.03, 0.3),
    **dict.fromkeys("xyz", (0.5, 10.0)),
    **dict.fromkeys(("cx", "cy"), (0.01, 0.1)),
    "a1": (LEAST_LENS, 0.1),
}
NAMES = {  # of parameters that may be unusual: as what they are told
    **{name: name for name in ("log f", "z", "roll", "tilt", "pan")},
    **dict.fromkeys("xy", "place"),
    **dict.fromkeys(("cx", "cy"), "principal point"),
    **dict.fromkeys(("a1", "b2"), "lens"),
}
EVIDENT = ("a1", "b2", "x", "y", "pan")  # what may be far out in its prior, if the labels determine it

GRID = (17, 10)  # points along the image's width and height at which errors are computed,
BORDER = 20  # and along each side of the field
LARGEST_SCORE = 5.0  # larger z-scores count as this
MOST_PIXELS = 3.0  # of a segment that count for the degrees of freedom
# Fitted to 600 rendered pictures (`data_tools.pitches`) with the coefficients of labelled frames kept.
EXPECTED_SHARE, LOG_ODDS_PER_SHARE = 0.9, 3.5


class OddsTerms(NamedTuple):
    """Terms of the log odds for d = 1 m if the field is as given, and under each of K possible sizes and crowns."""

    rows: Array
    """``1, log m, log sigma, log nu, log(1 + z . z)``, (1 + K, 5)."""
    weights: Array
    """0, and the probabilities of the possibilities, (1 + K,)."""


def surprises(uncertainty: Uncertainty) -> tuple[Finding, ...]:
    """Find what is unusual about an estimate; nothing for an ordinary camera.

    A lens far out in its prior is no surprise where the labels determine it, and lie on their markings. One of k1 alone
    is a surprise in a wide view that it bends, if k2 may move a place by more than half the field's tolerance.

    Examples
    --------
    >>> from fieldcalib import Camera, calibrate_from_segments, soccer
    >>> truth = Camera.from_angles(0.2, 1.35, 0.0, 1400.0, (1.0, 65.0, -16.0), (960, 540))
    >>> labels = ("Side line top", "Side line right", "Big rect. right main", "Big rect. right top", "Circle right")
    >>> pixels = {label: truth.project(soccer()[label].sample(4.0)) for label in labels}
    >>> surprises(calibrate_from_segments(soccer(), pixels, (960, 540)).uncertainty)
    ()
    """
    found: dict[Finding, None] = {}  # an ordered set
    problem = uncertainty.problem
    if problem.prior is not None:
        names = np.array(problem.layout.names)[problem.free]
        z = problem.prior_residuals(uncertainty.evaluation.theta)[0]
        unusual, evident = np.abs(z) > UNUSUAL, np.isin(names, EVIDENT)
        if np.any(unusual & evident):
            unusual &= ~(evident & _by_labels(uncertainty))
        found |= dict.fromkeys(Finding(What.UNUSUAL, NAMES[name]) for name in names[unusual] if name in NAMES)
        if _moved_by_k2(uncertainty) > MOST_MOVED * tolerance_of(uncertainty.field):
            found[Finding(What.MORE_LENS)] = None
    size, aspect = problem.layout.image_size, uncertainty.offsets.get("log aspect", (0.0, 1.0))
    squash = LEAST_SQUASH if is_whole_shape(size) or has_square_pixels(size, aspect) else LEAST_ASPECT
    for name, least, what in ("log aspect", squash, What.NOT_SQUARE), ("b2", LEAST_LENS, What.MORE_LENS):
        offset, sigma = uncertainty.offsets.get(name, (0.0, 1.0))
        if abs(offset) > max(least, CONTRADICTED * sigma):
            found[Finding(what)] = None
    if (contradicted := _contradicted(uncertainty)) is not None:
        found[Finding(What.CONTRADICTED, contradicted, (uncertainty.off_given[contradicted][0],))] = None
    given, told = problem.layout.field_size, uncertainty.size
    if told is not None and given is not None and not np.any(given.shift) and told.as_given < LEAST_SIZE:
        length, width = np.clip(given.given + told.mean[:2], *given.limits)
        found[Finding(What.OTHER_SIZE, numbers=(float(length), float(width)))] = None
    return tuple(found)


def _by_labels(uncertainty: Uncertainty) -> BoolArray:
    """Mask (P,) of the free parameters that the labels determine; of none if they are few, or noisier than usual.

    The prior of the lens has heavy tails: its standard deviation is the one that it has at the estimate.
    """
    prior, problem = uncertainty.evaluation.prior, uncertainty.problem
    assert prior is not None
    deviation = np.sqrt(np.diagonal(uncertainty.covariance)[problem.free])
    is_usual = uncertainty.sigma <= USUAL_NOISE * problem.noise and uncertainty.dof >= LEAST_DOF
    return np.asarray(is_usual & (deviation <= DETERMINED * prior.effective_sigma[0]))


def _moved_by_k2(uncertainty: Uncertainty) -> float:
    """By how much k2, which is kept, moves a place in view, metres, relative to the markings there.

    Its prior is as wide as lenses of such a view may have it; 0 in narrow views, and where k1 bends hardly.
    """
    layout, theta, field = uncertainty.layout, uncertainty.theta, uncertainty.field
    sigma, k1 = K2_OF_VIEW * (layout.lens.rho / np.exp(theta[LOG_F])) ** 4, layout.lens_block.start
    strength = np.hypot(theta[k1], np.sqrt(uncertainty.covariance[k1, k1]))
    if "b2" not in uncertainty.offsets or field is None or sigma < LEAST_K2 or strength < LEAST_K1:
        return 0.0
    off = np.hypot(*uncertainty.offsets["b2"]) / np.hypot(1.0, uncertainty.offsets["b2"][1] / sigma)
    J, known = uncertainty.ground_jacobian(ground_in_view(uncertainty.camera, field))
    moved = (J[known] - uncertainty.motion_of_markings) @ uncertainty.following["b2"]
    return float(off * np.max(np.linalg.norm(moved, axis=-1), initial=0.0))


def _contradicted(uncertainty: Uncertainty) -> str | None:
    """The given value that the labels contradict most; None if they agree with all of them.

    One wrong value pulls all others with it: each is freed alone, under a prior around what was given. The score is
    the root of twice the fall of the cost, with the noise that is left after it (a t statistic): a wrong value makes
    the noise look larger than it is.
    """
    dof, scores = uncertainty.dof, dict[str, float]()
    for name, (offset, sigma) in uncertainty.off_given.items():
        unit = uncertainty.layout.image_size[0] if name in ("cx", "cy") else 1.0
        least, wrong = (unit * value for value in WRONG_GIVEN[name])
        if abs(offset) > least and sigma > 0.0:
            fall = abs(offset) * wrong / (sigma * np.hypot(sigma, wrong))
            scores[name] = fall * np.sqrt((dof - 1.0) / max(dof - fall**2, 1.0))
    most = max(scores, key=lambda name: scores[name], default=None)
    return most if most is not None and scores[most] > CONTRADICTS_GIVEN else None


def largest_error(uncertainty: Estimate, field: Field) -> float:
    """Largest root mean square error of the points of a field in view, relative to the markings there, metres.

    NaN where no part of the field is in view, infinite where the labels do not determine it.

    Examples
    --------
    >>> from fieldcalib import Camera, calibrate_from_segments, soccer
    >>> truth = Camera.from_angles(-0.3, 1.35, 0.0, 1600.0, (0.0, 68.0, -17.0), (960, 540))
    >>> labels = ("Side line left", "Side line top", "Big rect. left main", "Big rect. left top", "Circle left")
    >>> pixels = {label: truth.project(soccer()[label].sample(7.0)) for label in labels}
    >>> calibration = calibrate_from_segments(soccer(size_known=True), pixels, truth.image_size)
    >>> 0.05 < largest_error(calibration.uncertainty, soccer()) < 0.5
    True
    """
    X = ground_in_view(uncertainty.camera, field)
    return float(np.max(uncertainty.on(field).at_field(X).rms)) if len(X) else float("nan")


def largest_move(camera: Camera, other: Camera, field: Field, terrain: Terrain | None = None) -> float:
    """Largest distance, metres, between the places on the field that two cameras of one picture see in a pixel.

    The other camera may see another ground, `terrain`, than that of the field.
    Infinite if one of them sees no ground where the other does; NaN if no ground is in view.

    Examples
    --------
    >>> from fieldcalib import soccer
    >>> camera = Camera.from_angles(0.2, 1.35, 0.0, 1400.0, (1.0, 65.0, -16.0), (960, 540))
    >>> moved = Camera.from_angles(0.2, 1.35, 0.0, 1400.0, (1.0, 65.5, -16.0), (960, 540))
    >>> round(largest_move(camera, moved, soccer()), 6)
    0.5
    """
    X = ground_in_view(camera, field)
    there = other.image_to_field(camera.project(X), terrain=terrain or field.terrain)
    off = np.linalg.norm((there - X)[:, :2], axis=1)
    return float(np.max(np.nan_to_num(off, nan=np.inf))) if len(X) else float("nan")


def ground_in_view(camera: Camera, field: Field, finer: int = 1) -> Array:
    """Points of a field that a camera sees, (n, 3): on a grid of pixels, and along the border of the field.

    In most views errors are largest at the border, which may lie between the rows of the grid.
    """
    layout = Layout.of(camera.image_size, camera.lens)
    X, seen = _grounds_in_view(projection_on(field, layout.theta(camera)[None], layout), field, finer)
    return X[seen]


def _grounds_in_view(projection: Projection, field: Field, finer: int = 1) -> tuple[Array, BoolArray]:
    """Points of `ground_in_view` for B cameras, (B, N, 3), and which of them each camera sees, (B, N)."""
    size = np.array(projection.layout.image_size)
    half = np.array([field.length, field.width]) / 2.0
    pixels, border = _grid(projection.layout.image_size, finer)
    B = len(projection.theta)
    on_grid, sees_ground = ground_of_pixels(projection, np.broadcast_to(pixels, (B, *pixels.shape)))
    on_border = border * np.append(half, 0.0)
    on_border = np.broadcast_to(on_border, (B, *on_border.shape))
    if projection.terrain is not None:
        on_border = projection.terrain.raised(on_border)
    xy, has_pixel = pixels_of_points(projection, on_border)
    in_image = np.all((xy >= 0.0) & (xy <= size - 1.0), axis=-1)
    on_field = np.all(np.abs(on_grid[..., :2]) <= half, axis=-1)
    seen = np.concatenate([sees_ground & on_field, has_pixel & in_image], axis=1)
    return np.concatenate([on_grid, on_border], axis=1), seen


@lru_cache(maxsize=64)
def _grid(image_size: tuple[int, int], finer: int) -> tuple[Array, Array]:
    """Pixels of the grid, (N, 2), and points along the border of a field with sides of 2 m, (M, 3)."""
    x, y = (np.linspace(0.0, side - 1.0, finer * count) for side, count in zip(image_size, GRID, strict=True))
    along = np.linspace(-1.0, 1.0, finer * BORDER)
    ones = np.ones_like(along)
    sides = [
        np.stack((*pair, 0.0 * ones), axis=1) for pair in ((along, ones), (along, -ones), (ones, along), (-ones, along))
    ]
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2), np.concatenate(sides)


def odds_terms(uncertainties: Sequence[Uncertainty], field: Field) -> list[OddsTerms]:
    """Terms of the log odds for each of several estimates of one layout."""
    if not uncertainties:
        return []
    found = []
    J, seen, _ = _derivatives_in_view(np.array([one.theta for one in uncertainties]), uncertainties[0].layout, field)
    for one, dX_dtheta, is_seen in zip(uncertainties, J, seen, strict=True):
        problem, (weights, moments), dX_dtheta = one.problem, one.possibilities, dX_dtheta[is_seen]
        determined = np.sum((dX_dtheta @ one.determined) * dX_dtheta, axis=(-2, -1))  # mean squares of errors, (N,)
        if one.open.shape[1]:
            determined[np.any(one.is_open(dX_dtheta), axis=-1)] = np.inf
        considered = dX_dtheta @ one.by_considered
        by_moment = np.swapaxes(considered, 1, 2) @ considered  # derivatives of the mean squares, (N, c, c)
        of_field = np.tensordot(moments, by_moment, axes=((1, 2), (1, 2)))  # (K, N)
        squares = determined + np.concatenate([np.zeros_like(of_field[:1]), of_field])
        z = np.minimum(np.abs(problem.prior_residuals(one.evaluation.theta)), LARGEST_SCORE)
        rows = np.ones((len(squares), 5))
        rows[:, 1] = np.log(np.sqrt(np.max(squares, axis=1)) if len(determined) else np.nan)
        rows[:, 2:] = np.log([one.sigma / problem.noise, degrees_of_freedom(one), 1.0 + np.sum(np.square(z))])
        found.append(OddsTerms(rows, np.append(0.0, weights)))
    return found


def _derivatives_in_view(theta: Array, layout: Layout, field: Field) -> tuple[Array, BoolArray, Array]:
    """Derivatives of the ground points that B cameras (B, n) may see, relative to the markings in view.

    These are (B, N, 2, n), with a mask (B, N) of the points that are in view, and the motion (B, 2, n) of the markings
    (`by_parameters`).
    """
    projection = projection_on(field, theta, layout)
    X, seen = _grounds_in_view(projection, field)
    motion = by_parameters(projection, field)
    J = ground_derivatives(projection, X, seen, np.ones(layout.size, dtype=bool))
    return J - motion[:, None], seen, motion


class ErrorsInView(NamedTuple):
    """Errors, from a covariance, of the ground points that a camera sees, relative to the markings in view."""

    largest: float
    """Largest root mean square error, metres; NaN where no part of the field is in view."""
    motion: Array
    """Motion of the markings in view by the parameters, (2, n) (`by_parameters`)."""

    @classmethod
    def of(cls, theta: Array, covariance: Array, layout: Layout, field: Field) -> list[ErrorsInView]:
        """Compute those of B cameras (B, n), from their covariances (B, n, n)."""
        J, seen, motion = _derivatives_in_view(theta, layout, field)
        rows = J.reshape(len(J), -1, layout.size)
        squares = np.maximum(np.sum(((rows @ covariance) * rows).reshape(J.shape), axis=(-2, -1)), 0.0)
        largest = np.sqrt([np.max(one[k]) if np.any(k) else np.nan for one, k in zip(squares, seen, strict=True)])
        return [cls(*one) for one in zip(largest.tolist(), motion, strict=True)]

    def probability(self, metres: float) -> float:
        """Smallest probability, over the ground points in view, that a point is off by at most `metres`.

        It is ``1 - exp(-metres^2 / rms^2)``, Rayleigh's distribution. NaN where no part of the field is in view.
        """
        with np.errstate(divide="ignore"):
            return float(-np.expm1(-np.square(np.divide(metres, self.largest))))


def degrees_of_freedom(uncertainty: Uncertainty) -> float:
    """Degrees of freedom of sigma, counting at most three pixels per segment.

    Pixels of one segment share errors: a thousand of them determine the noise hardly better than three.
    """
    observations = uncertainty.problem.observations
    counted = np.sum(np.minimum(observations.pixels_by_label, MOST_PIXELS))
    unknowns = np.count_nonzero(uncertainty.problem.free)
    return OTHER_FRAMES + max(float(counted) - unknowns, 0.0)


def probability_right(model: ProbabilityModel, terms: OddsTerms, metres: float) -> float:
    """Probability that no ground point in view is off by more than `metres`, from `odds_terms`.

    Examples
    --------
    >>> from fieldcalib.fields.sports.soccer import PROBABILITY
    >>> few_centimetres = [[1.0, np.log(0.05), 0.0, np.log(20.0), 0.0]]
    >>> terms = OddsTerms(np.array(few_centimetres), np.ones(1))
    >>> probability_right(PROBABILITY, terms, 0.5) > 0.99
    True
    >>> probability_right(PROBABILITY, terms, 0.01) < 0.1
    True
    """
    if np.isnan(terms.rows[:, 1]).any():
        return float("nan")
    with np.errstate(over="ignore"):
        log_odds = (terms.rows - [0.0, np.log(metres), 0.0, 0.0, 0.0]) @ np.array(model.coefficients)
        return float(np.sum(terms.weights / (1.0 + np.exp(-log_odds))))


def log_odds_of_paint(share: float) -> float:
    """Log odds that come to those by the labels, given the share of the markings in view that show paint."""
    return -LOG_ODDS_PER_SHARE * max(0.0, EXPECTED_SHARE - share)


def errors_given_paint(model: ProbabilityModel, share: float) -> float:
    """Factor of a camera's errors by its labels, given the share of the markings in view that show paint.

    It lowers the log odds as the share does: ``b1 log(factor) = -3.5 max(0, 0.9 - share)``.

    Examples
    --------
    >>> from fieldcalib.fields.sports.soccer import PROBABILITY
    >>> round(errors_given_paint(PROBABILITY, 0.95), 2), round(errors_given_paint(PROBABILITY, 0.4), 2)
    (1.0, 1.77)
    """
    return float(np.exp(log_odds_of_paint(share) / model.coefficients[1]))


def probability_given_paint(probability: float, share: float) -> float:
    """Probability of being right, given that by the labels and the share of the markings in view that show paint.

    The log odds are reduced by ``3.5 max(0, 0.9 - share)``. Right cameras of real pictures have shares from 0.8 on,
    half of them more than 0.95.

    Examples
    --------
    >>> round(probability_given_paint(0.9, 0.95), 2), round(probability_given_paint(0.9, 0.4), 2)
    (0.9, 0.61)
    """
    doubt = float(np.exp(-log_odds_of_paint(share)))
    return probability / (probability + (1.0 - probability) * doubt)
