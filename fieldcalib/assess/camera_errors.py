"""Errors of the camera of a calibration: a protocol, and its types for a frame of a sequence and for a homography."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NoReturn, Protocol

import numpy as np

from fieldcalib._json import from_json, to_json
from fieldcalib._types import Array
from fieldcalib.assess.cropping_evidence import Picture
from fieldcalib.assess.estimate import Estimate
from fieldcalib.assess.findings import Finding, What
from fieldcalib.assess.ground import if_level
from fieldcalib.assess.observability import Direction
from fieldcalib.assess.probability import probability_by_covariance
from fieldcalib.fields.field import Field
from fieldcalib.problem.layout import Layout
from fieldcalib.problem.records import check_covariances, check_parameters, layout_from_record, layout_to_record, sized


class CameraErrors(Protocol):
    """Errors of a camera, as `Calibration` uses them.

    There are three types: `fieldcalib.assess.solved.Solved` for a frame that was solved by itself, `KnownErrors` for a
    frame of a sequence, `NoErrors` for a homography or a missing camera. A type raises a ValueError for values that it
    does not have.
    """

    @property
    def are_known(self) -> bool:
        """Whether there is an estimate with a covariance."""

    @property
    def are_computed(self) -> bool:
        """Whether all errors are computed already."""

    def on(self, field: Field | None) -> Estimate:
        """The estimate with this field in view."""

    def probability(self, field: Field, metres: float, *, size_known: bool, level: bool) -> float:
        """Probability that no point of the field in view is off by more than `metres`; NaN if it is unknown."""

    def doubts(self, picture: Picture | None) -> tuple[Finding, ...]:
        """Evidence of the labels against an ordinary camera and, if a picture is given, against a whole frame."""

    def to_record(self) -> dict[str, Any]:
        """The keys of `Calibration.to_dict` that hold them."""


@dataclass(frozen=True)
class NoErrors:
    """The unknown errors of a camera that does not come from labelled pixels."""

    are_known, are_computed = False, True

    def on(self, field: Field | None) -> NoReturn:
        """Raise a ValueError: there is no estimate."""
        raise ValueError("expected a calibration from labelled pixels: the errors of a homography are not known")

    def probability(self, field: Field, metres: float, *, size_known: bool, level: bool) -> float:
        """NaN: the probability is unknown."""
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

    are_known = are_computed = True

    def __init__(
        self, layout: Layout, theta: Array, covariance: Array, dof: float = np.inf, field: Field | None = None
    ) -> None:
        self._layout, self._theta, self._covariance, self.dof, self.field = layout, theta, covariance, dof, field

    @property
    def layout(self) -> Layout:
        """Names and order of the parameters."""
        return self._layout

    @property
    def theta(self) -> Array:
        """The estimate, (n,)."""
        return self._theta

    @property
    def observability(self) -> tuple[Direction, ...]:
        """Raise a ValueError: a covariance does not separate labels and prior."""
        raise ValueError("expected a calibration of a single frame: of a sequence only the covariance is kept")

    def on(self, field: Field | None) -> KnownErrors:
        """The estimate with another field in view: errors are then relative to its markings."""
        return KnownErrors(self.layout, self.theta, self._covariance, self.dof, field)

    @property
    def if_level(self) -> KnownErrors:
        """The errors if the field were known to be level."""
        covariance = if_level(self._covariance, self.layout.is_crown)
        return KnownErrors(self.layout, self.theta, covariance, self.dof, self.field)

    def propagated(self, J: Array) -> Array:
        """Covariance (..., m, m) of quantities whose derivatives by theta are J (..., m, n)."""
        return np.asarray(J @ self._covariance @ np.swapaxes(J, -2, -1))

    def probability(self, field: Field, metres: float, *, size_known: bool, level: bool) -> float:
        """Probability that no point of the field in view is off by more than `metres`, from the covariance."""
        return probability_by_covariance(self.if_level if level else self, field, metres)

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
