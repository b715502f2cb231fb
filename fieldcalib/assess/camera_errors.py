"""Errors of the camera of a calibration.

Errors of a frame that was solved by itself or in a batch (`Solved`) are computed from its problem at the solution; the
others are for frames of a sequence, and for homographies.

What the labels of a solved frame say of its picture (`seems_part`): whole, or a part of a frame whose camera would be
wrong. The hypotheses, their prior and their likelihood are those of `fieldcalib.problem.picture_shape`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from typing import Any, NoReturn, TypeAlias

import numpy as np

from fieldcalib._json import from_json, to_json
from fieldcalib._types import Array, BoolArray
from fieldcalib.assess.estimate import Estimate
from fieldcalib.assess.findings import CUT, SHAPE, Finding, What
from fieldcalib.assess.observability import Direction
from fieldcalib.assess.probability import (
    ErrorsInView,
    OddsTerms,
    ground_in_view,
    largest_error,
    odds_terms,
    probability_right,
    surprises,
)
from fieldcalib.assess.uncertainty import Uncertainty, uncertainties
from fieldcalib.fields.field import Field, tolerance_of
from fieldcalib.fields.traits import LAWNS
from fieldcalib.geometry.camera import Camera
from fieldcalib.problem.evaluation import Evaluation, evaluate
from fieldcalib.problem.labelled_pixels import PixelTable
from fieldcalib.problem.layout import PRINCIPAL_POINT, ROLL, Layout
from fieldcalib.problem.picture_shape import (
    LARGEST_SPREAD,
    PART_SCALE,
    ROLL_OFF_LAWNS,
    SQUASHED_LOG_ODDS,
    SURE,
    Declared,
    Placement,
    PrincipalPoint,
    frame_around,
    has_square_pixels,
    is_whole_shape,
    log_ratio_of_cut,
    score_of_part,
)
from fieldcalib.problem.records import (
    check_covariances,
    check_parameters,
    layout_from_record,
    layout_to_record,
    problem_from_record,
    problem_to_record,
    sized,
)

FAINT = 1e-6  # information, in units of the prior's, that keeps the system regular


@dataclass(frozen=True, eq=False)
class Picture:
    """A picture that may be a part of a frame."""

    camera: Camera
    """The camera in the pixels of the picture."""
    field: Field
    probability: float
    """Probability that the camera is right to the field's tolerance, if the field has the given size."""
    declared: Declared
    are_annotated: bool
    """Whether a person labelled it, following markings to its border."""
    sure: float = SURE
    """Probability from which on a camera of an odd shape needs no further evidence of that shape."""

    def log_ratio_of_part(self, solved: Camera, labels: PixelTable) -> float:
        """Log odds of a part from what was done to the picture, and from the ends of labels set by hand.

        `solved` is the camera in pixels of its frame, as the labels are.
        """
        log_ratio = SQUASHED_LOG_ODDS * Placement.of_cameras(self.camera, solved).is_squashed
        return log_ratio + (log_ratio_of_cut(self.field, labels.by_label(0), solved) if self.are_annotated else 0.0)


def principal_point_of(uncertainty: Uncertainty) -> PrincipalPoint | None:
    """The principal point of a frame as its labels determine it; None if it was not free under a prior of whole frames.

    Examples
    --------
    >>> from fieldcalib import Camera, calibrate_from_segments, soccer
    >>> truth = Camera.from_angles(0.2, 1.35, 0.0, 1400.0, (1.0, 65.0, -16.0), (960, 540))
    >>> labels = ("Side line top", "Side line right", "Big rect. right main", "Big rect. right top", "Circle right")
    >>> pixels = {label: truth.project(soccer()[label].sample(4.0)) for label in labels}
    >>> found = principal_point_of(calibrate_from_segments(soccer(), pixels, (960, 540)).uncertainty)
    >>> found.log_ratio_of_part < 0.0
    True
    """
    freed, frame = _freed(uncertainty, FAINT), frame_around(uncertainty.layout.image_size)
    if freed is None or np.min(uncertainty.unit[PRINCIPAL_POINT]) > LARGEST_SPREAD * frame[0]:
        return None
    own, z, shift, covariance = freed
    return PrincipalPoint((z + shift)[own], covariance[np.ix_(own, own)])


def largest_error_of_part(uncertainty: Uncertainty) -> float:
    """Largest root mean square error of the ground points in view if the picture is a part of a frame, metres.

    It is computed to first order from the camera of the labels without the narrow prior of whole frames.

    Examples
    --------
    >>> from fieldcalib import Camera, calibrate_from_segments, soccer
    >>> truth = Camera.from_angles(0.2, 1.35, 0.0, 1400.0, (1.0, 65.0, -16.0), (960, 540))
    >>> labels = ("Side line top", "Side line right", "Big rect. right main", "Big rect. right top", "Circle right")
    >>> pixels = {label: truth.project(soccer()[label].sample(4.0)) for label in labels}
    >>> uncertainty = calibrate_from_segments(soccer(), pixels, (960, 540)).uncertainty.on(soccer())
    >>> 0.5 < largest_error_of_part(uncertainty) < 5.0
    True
    """
    freed = _freed(uncertainty, 1.0 / PART_SCALE**2)
    if freed is None or uncertainty.field is None:
        return float("nan")
    _, _, shift, covariance = freed
    dX_dtheta, known = uncertainty.ground_jacobian(ground_in_view(uncertainty.camera, uncertainty.field))
    if not np.any(known):
        return float("nan")
    free = np.flatnonzero(uncertainty.problem.free)
    J = (dX_dtheta[known] - uncertainty.motion_of_markings)[..., free] * uncertainty.unit[free]
    squares = np.sum(np.square(J @ shift), axis=-1) + np.einsum("nij,jk,nik->n", J, covariance, J)
    return float(np.sqrt(np.max(squares)))


def _freed(uncertainty: Uncertainty, precision: float) -> tuple[BoolArray, Array, Array, Array] | None:
    """The estimate if the precision of the principal point's prior is multiplied by `precision`; None if it is fixed.

    Returned are a mask of the principal point among the free parameters and, in units of their prior, their z-scores,
    the shift of the estimate, and its covariance.
    """
    problem = uncertainty.problem
    free = np.flatnonzero(problem.free)
    own = (free >= PRINCIPAL_POINT.start) & (free < PRINCIPAL_POINT.stop)
    if problem.prior is None or np.count_nonzero(own) != 2:
        return None
    unit = uncertainty.unit[free]
    determined = uncertainty.determined[np.ix_(free, free)] / (unit[:, None] * unit)
    A = uncertainty.curvature * uncertainty.information.matrix[0] + np.eye(len(free))
    z = problem.prior_residuals(uncertainty.evaluation.theta)[0]
    less = own * (1.0 - precision)
    inverse = np.linalg.inv(A - np.diag(less))
    return own, z, inverse @ (less * z), inverse @ (A @ determined @ A - np.diag(less)) @ inverse.T


def score_above(least: float, uncertainty: Uncertainty, found: PrincipalPoint, probability: float) -> float:
    """Score of a picture with the shape of a frame (`score_of_part`), whose camera is right with a probability.

    It is -inf where no errors of a part could raise it above `least`: they take long to compute.
    """
    field, angle, variance = uncertainty.field, uncertainty.theta[ROLL], uncertainty.covariance[ROLL, ROLL]
    share = 1.0 if field is None or field.surface in LAWNS else ROLL_OFF_LAWNS
    if field is not None and field.probability is not None and field.probability.least_in_picture is not None:
        share = 0.0  # pictures that people take are not level
    roll = (share * float(angle), share**2 * float(variance))
    score = partial(score_of_part, probability, found.log_ratio_of_part, roll)
    if not score(np.inf) > least:
        return -np.inf
    error = largest_error_of_part(uncertainty) / tolerance_of(field)
    return score(float(np.nan_to_num(error, nan=1.0)))  # that of the tolerance, if no field is in view


def seems_part(
    uncertainty: Uncertainty,
    probability: float,
    log_ratio_of_part: float = 0.0,
    declared: Declared = Declared.NOTHING,
    sure: float = SURE,
) -> tuple[Finding, ...]:
    """Evidence that a picture may be a part of a frame whose camera would then be wrong; empty without any.

    Parameters
    ----------
    uncertainty : Uncertainty
    probability : float
        Probability that the camera is right to the field's tolerance, for a field of the given size.
    log_ratio_of_part : float
        Further log odds of a part, from the ends of labels (`Picture.log_ratio_of_part`).
    declared : Declared
        Statement of the user about the picture.
    sure : float
        See `Picture`.
    """
    found = None if declared == Declared.FRAME else principal_point_of(uncertainty)
    if found is None:
        return ()
    size = uncertainty.layout.image_size
    if is_whole_shape(size):
        score = score_above(-log_ratio_of_part, uncertainty, found, probability)
        return (CUT,) if score + log_ratio_of_part > 0.0 else ()
    is_known = declared != Declared.NOTHING or "log aspect" not in uncertainty.offsets
    is_square = is_known or has_square_pixels(size, uncertainty.offsets["log aspect"])
    if is_square and probability >= sure:
        return ()
    return (SHAPE if declared == Declared.NOTHING else CUT,)


@dataclass(frozen=True)
class NoErrors:
    """The unknown errors of a camera that does not come from labelled pixels."""

    are_known = False

    def on(self, field: Field | None) -> NoReturn:
        """Raise a ValueError: there is no estimate."""
        raise ValueError("expected a calibration from labelled pixels: the errors of a homography are not known")

    def probability(self, field: Field, metres: float, *, size_known: bool) -> float:
        """NaN: the probability is unknown."""
        return float("nan")

    def largest_error(self, field: Field) -> float:
        """NaN: the errors are unknown."""
        return float("nan")

    def doubts(self, picture: Picture | None) -> tuple[Finding, ...]:
        """The finding that the errors are unknown."""
        return (Finding(What.UNKNOWN_ERRORS),)

    def to_record(self) -> dict[str, Any]:
        """The key of `Calibration.to_dict`, with an empty value."""
        return {"solved": None}


class KnownErrors(Estimate):
    """A camera with its covariance, without the problem that it was estimated from: a frame of a sequence.

    Parameters
    ----------
    layout : Layout
        Names and order of the parameters.
    theta : (n,) array
        The estimate.
    covariance : (n, n) array
    dof : float
        Degrees of freedom of the covariance.
    field : Field, optional
        The field in view; it is not written with the errors.

    Examples
    --------
    >>> from fieldcalib import Camera
    >>> from fieldcalib.problem.layout import Layout
    >>> camera = Camera.from_angles(0.1, 1.3, 0.0, 1500.0, (0.0, 65.0, -16.0), (960, 540))
    >>> layout = Layout.of((960, 540))
    >>> errors = KnownErrors(layout, layout.theta(camera), np.diag([1e-4] * 3 + [0.0] * (layout.size - 3)))
    >>> round(float(errors.at_field((0.0, 0.0, 0.0)).rms), 3)  # a hundredth of a radian, at 67 m
    2.874
    """

    are_known = True

    def __init__(
        self, layout: Layout, theta: Array, covariance: Array, dof: float = np.inf, field: Field | None = None
    ) -> None:
        self.layout, self.theta, self._covariance, self.dof, self.field = layout, theta, covariance, dof, field

    @staticmethod
    def compute(several: Sequence[KnownErrors]) -> None:
        """Compute and cache the errors in view of frames of one layout, which see one field, all at once."""
        layout, field = several[0].layout, several[0].field
        assert field is not None
        theta, covariance = (np.array([getattr(one, name) for one in several]) for name in ("theta", "_covariance"))
        for one, in_view in zip(several, ErrorsInView.of(theta, covariance, layout, field), strict=True):
            one.in_view = in_view

    @property
    def are_computed(self) -> bool:
        """Whether the errors in view are cached, if there is a field."""
        return self.field is None or "in_view" in vars(self)

    @cached_property
    def in_view(self) -> ErrorsInView:
        """Errors of the points of the field in view."""
        assert self.field is not None
        return ErrorsInView.of(self.theta[None], self._covariance[None], self.layout, self.field)[0]

    @property
    def observability(self) -> tuple[Direction, ...]:
        """Raise a ValueError: a covariance does not separate labels and prior."""
        raise ValueError("expected a calibration of a single frame: of a sequence only the covariance is kept")

    def on(self, field: Field | None) -> KnownErrors:
        """The estimate with another field in view: errors are then relative to its markings."""
        return self if field is self.field else KnownErrors(self.layout, self.theta, self._covariance, self.dof, field)

    def propagated(self, J: Array) -> Array:
        """Covariance (..., m, m) of quantities whose derivatives by theta are J (..., m, n)."""
        return np.asarray(J @ self._covariance @ np.swapaxes(J, -2, -1))

    def probability(self, field: Field, metres: float, *, size_known: bool) -> float:
        """Probability that no point of the field in view is off by more than `metres`, from the covariance."""
        return self.on(field).in_view.probability(metres)

    def largest_error(self, field: Field) -> float:
        """Largest root mean square error of the points of the field in view, metres."""
        return self.on(field).in_view.largest

    @cached_property
    def motion_of_markings(self) -> Array:
        """Derivatives (2, n) by theta of the common motion of the markings in view."""
        return self.in_view.motion if "in_view" in vars(self) else super().motion_of_markings

    def doubts(self, picture: Picture | None) -> tuple[Finding, ...]:
        """No doubts: the evidence of the labels is not kept."""
        return ()

    def to_record(self) -> dict[str, Any]:
        """The keys of `Calibration.to_dict` that hold them."""
        return {"solved": None, "errors": self.to_dict()}

    def to_dict(self) -> dict[str, Any]:
        """Everything but the field, for `json.dumps`."""
        return {
            "layout": layout_to_record(self.layout),
            "theta": to_json(self.theta),
            "covariance": to_json(self._covariance),
            "dof": to_json(self.dof),
        }

    @classmethod
    def from_dict(cls, record: Mapping[str, Any]) -> KnownErrors:
        """The inverse of `to_dict`."""
        layout = layout_from_record(record["layout"])
        theta = sized(record["theta"], (layout.size,), "'theta'")
        check_parameters(layout, theta)
        covariance = from_json(record["covariance"])
        if covariance.shape != (layout.size, layout.size):
            raise ValueError(f"'covariance': expected that of {layout.size} parameters, got shape {covariance.shape}")
        check_covariances(covariance, "'covariance'")
        return cls(layout, theta, covariance, float(from_json(record["dof"])))

    def __reduce__(self) -> tuple[Callable[..., KnownErrors], tuple[dict[str, Any]]]:
        return KnownErrors.from_dict, (self.to_dict(),)


class Solved:
    """One of B solved frames. Its errors are computed when they are first needed, and cached.

    It is copied, pickled and written without the other frames.

    Parameters
    ----------
    evaluation : Evaluation
        B frames at their solutions.
    unit : (B, n) array
        Standard deviations in whose units information is measured.
    frame : int
        Index of the frame.
    """

    are_known = True

    def __init__(self, evaluation: Evaluation, unit: Array, frame: int = 0) -> None:
        self.evaluation, self.unit, self.frame = evaluation, unit, frame
        # cached: the estimate on the last field that was asked for, the terms of the log odds there, and what the
        # labels said of a part, and what is unusual, when they were last asked
        self._on: Uncertainty | None = None
        self._terms: tuple[Field, OddsTerms] | None = None
        self._seems_part, self._surprises = lru_cache(maxsize=1)(seems_part), lru_cache(maxsize=1)(surprises)

    @staticmethod
    def compute(several: Sequence[Solved], field: Field | None = None) -> None:
        """Compute and cache the uncertainties of frames of one evaluation, all at once.

        On a field with a probability model, compute the terms of their log odds of being right too.
        """
        first, index = several[0], np.array([one.frame for one in several])
        found = uncertainties(first.evaluation.take(index).trimmed, first.unit[index])
        for one, uncertainty in zip(several, found, strict=True):
            one.uncertainty = uncertainty
        if field is not None and field.probability is not None:
            for one, terms in zip(several, odds_terms(found, field), strict=True):
                one._terms = field, terms

    @property
    def alone(self) -> Solved:
        """The frame without the others and their padding."""
        one = np.array([self.frame])
        return Solved(self.evaluation.take(one).trimmed, self.unit[one])

    @property
    def pixels(self) -> PixelTable:
        """The labelled pixels of the frame, and the weights that it was solved with."""
        return self.evaluation.problem.observations.take(np.array([self.frame])).pixels

    @property
    def camera(self) -> Camera:
        """The camera as it was solved: of a squashed or cropped picture that of its frame with square pixels."""
        return self.evaluation.problem.layout.camera(self.evaluation.theta[self.frame])

    @property
    def are_computed(self) -> bool:
        """Whether the uncertainty is cached."""
        return "uncertainty" in vars(self)

    @cached_property
    def uncertainty(self) -> Uncertainty:
        """The estimate of the frame with no field in view: its errors are relative to the centre mark."""
        alone = self.alone
        return uncertainties(alone.evaluation, alone.unit)[0]

    def on(self, field: Field | None) -> Uncertainty:
        """The estimate of the frame with this field in view."""
        if self._on is None or self._on.field is not field:
            self._on = self.uncertainty.on(field)
        return self._on

    def probability(self, field: Field, metres: float, *, size_known: bool) -> float:
        """Probability that no point of the field in view is off by more than `metres`, by the labels."""
        assert field.probability is not None
        if self._terms is None or self._terms[0] is not field:
            self._terms = field, odds_terms([self.uncertainty], field)[0]
        terms = self._terms[1]
        as_given = OddsTerms(terms.rows[:1], np.ones(1))
        return probability_right(field.probability, as_given if size_known else terms, metres)

    def largest_error(self, field: Field) -> float:
        """Largest root mean square error of the points of the field in view, metres."""
        return largest_error(self.uncertainty, field)

    def doubts(self, picture: Picture | None) -> tuple[Finding, ...]:
        """Evidence of the labels against an ordinary camera and, if a picture is given, against a whole frame."""
        if picture is None:
            return self._surprises(self.uncertainty)
        seen, log_ratio = self.on(picture.field), picture.log_ratio_of_part(self.uncertainty.camera, self.pixels)
        asked = picture.probability, log_ratio, picture.declared, picture.sure
        return (*self._seems_part(seen, *asked), *self._surprises(seen))

    def to_record(self) -> dict[str, Any]:
        """The keys of `Calibration.to_dict` that hold it."""
        return {"solved": self.to_dict()}

    def to_dict(self) -> dict[str, Any]:
        """The problem of the frame and its solution, for `json.dumps`."""
        return {
            "problem": problem_to_record(self.evaluation.problem, self.frame),
            "theta": to_json(self.evaluation.theta[self.frame]),
            "unit": to_json(self.unit[self.frame]),
        }

    @classmethod
    def from_dict(cls, record: Mapping[str, Any]) -> Solved:
        """The inverse of `to_dict`: the closest points are searched again."""
        problem = problem_from_record(record["problem"])
        theta, unit = (sized(record[name], (problem.layout.size,), repr(name))[None] for name in ("theta", "unit"))
        check_parameters(problem.layout, theta)
        return cls(evaluate(problem, theta), unit)

    def __reduce__(self) -> tuple[Callable[..., Solved], tuple[dict[str, Any]]]:
        return Solved.from_dict, (self.to_dict(),)


CameraErrors: TypeAlias = Solved | KnownErrors | NoErrors
"""Errors of the camera of a frame that was solved by itself, of one of a sequence, and of a homography or no camera.

A type raises a ValueError for values that it does not have.
"""
