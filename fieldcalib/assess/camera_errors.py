"""From the covariance of a camera's parameters to errors of its intrinsics, its pose, and points on the ground."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib._json import from_json, to_json
from fieldcalib._types import Array, BoolArray
from fieldcalib.assess.datum import MARKINGS_IN_VIEW, RelativeTo, by_parameters, checked, in_words
from fieldcalib.assess.ground import ground_derivatives
from fieldcalib.assess.level import if_level
from fieldcalib.fields.field import Field
from fieldcalib.geometry.camera import Camera
from fieldcalib.geometry.rotation import rotation_axes
from fieldcalib.problem.layout import ANGLES, CENTER, LOG_ASPECT, LOG_F, PRINCIPAL_POINT, Layout
from fieldcalib.problem.projection import Projection
from fieldcalib.problem.records import layout_from_record, layout_to_record

INTRINSICS, EXTRINSICS = 18, 6  # lengths of cv2.calibrateCameraExtended's standard deviations
NORMAL = 1e9  # degrees of freedom from which on Fisher's distribution is the chi-squared one
LENS_INTRINSICS = slice(4, 16)  # of them: k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4


@dataclass(frozen=True)
class GroundError:
    """Errors of points on the ground: `rms` in metres, `ellipse` of the region that holds the true point."""

    covariance: Array
    """Of (x, y), (..., 2, 2); NaN where there is no ground point, infinite where the labels leave it open."""
    dof: float
    """Degrees of freedom of Student's t."""

    @property
    def rms(self) -> Array:
        """Root mean square distance to the true point, (...,) metres."""
        return np.asarray(np.sqrt(np.trace(self.covariance, axis1=-2, axis2=-1)))

    def ellipse(self, level: float = 0.95) -> tuple[Array, Array]:
        """The ellipse that holds the true point with a probability.

        Returns
        -------
        half_axes : (..., 2) array
            Metres, the longer one first; NaN where the covariance is not finite.
        angle : (...,) array
            Of the longer axis, radians from x towards y.
        """
        known = np.asarray(np.isfinite(self.covariance).all(axis=(-2, -1)))
        values, vectors = np.linalg.eigh(np.where(known[..., None, None], self.covariance, np.eye(2)))
        half_axes = region_radius(2, self.dof, level) * np.sqrt(np.maximum(values[..., ::-1], 0.0))
        y, x = np.moveaxis(vectors[..., 1], -1, 0)[::-1].copy()
        angle = np.arctan2(y, x)
        return np.where(known[..., None], half_axes, np.nan), np.where(known, angle, np.nan)


class CameraErrors(ABC):
    """An estimated camera and how far it may be off; what knows the covariance says what it is."""

    dof: float
    """Degrees of freedom of Student's and Fisher's distributions, of which regions are."""
    field: Field | None
    """What is in view; None if that is no `Field`: then errors are relative to its origin."""

    @abstractmethod
    def on(self, field: Field | None) -> Self:
        """Name the field that is in view: errors are then relative to its markings."""

    @property
    @abstractmethod
    def if_level(self) -> Self:
        """The errors if the field were known to be level (`fieldcalib.fields.crown`)."""

    @property
    @abstractmethod
    def layout(self) -> Layout:
        """Of the parameters."""

    @property
    @abstractmethod
    def theta(self) -> Array:
        """The estimate, (n,)."""

    @abstractmethod
    def propagated(self, J: Array) -> Array:
        """Covariance (..., m, m) of quantities whose derivatives by theta are J (..., m, n)."""

    @property
    def covariance(self) -> Array:
        """Covariance (n, n) of theta, in the order of `names` of the layout; 0 for what was fixed.

        Where nothing determines a parameter its variance is infinite and its covariances are NaN.
        """
        return self.propagated(np.eye(len(self.theta)))

    @cached_property
    def camera(self) -> Camera:
        """The estimated camera."""
        return self.layout.camera(self.theta)

    @property
    def std_deviations_intrinsics(self) -> Array:
        """(18, 1) as cv2's: fx, fy, cx, cy, k1, k2, p1, p2, k3 to k6, s1 to s4, and 0 for a tilt."""
        camera, layout = self.camera, self.layout
        fx, fy = camera.K[0, 0], camera.K[1, 1]
        J = np.zeros((INTRINSICS, layout.size))
        J[[0, 1], LOG_F] = fx, fy
        J[1, LOG_ASPECT] = fy
        J[[2, 3], [PRINCIPAL_POINT.start, PRINCIPAL_POINT.start + 1]] = 1.0
        by_lens, by_log_f = layout.lens.opencv_jacobian(layout.at_zoom(self.theta)[layout.lens_block], fx)
        J[LENS_INTRINSICS, layout.lens_block] = by_lens
        J[LENS_INTRINSICS, LOG_F] = by_log_f
        return self._standard_deviations(J @ layout.zoom_jacobian(self.theta))

    @property
    def std_deviations_extrinsics(self) -> Array:
        """(6, 1) as cv2's: rvec, then tvec."""
        rvec, tvec, _, _ = self.camera.to_opencv()
        axes = rotation_axes(self.theta[ANGLES], self.camera.R)
        J = np.zeros((EXTRINSICS, len(self.theta)))
        # angles turn the scene by -axis, on the left of R: the inverse left Jacobian of SO(3) makes it one of rvec
        J[:3, ANGLES] = -_inverse_left_jacobian(rvec[:, 0]) @ axes.T
        J[3:, ANGLES] = -np.cross(axes, tvec[:, 0]).T
        J[3:, CENTER] = -self.camera.R
        return self._standard_deviations(J @ self.layout.zoom_jacobian(self.theta))

    def radius(self, dimensions: int = 1, level: float = 0.95) -> float:
        """How many standard deviations hold the truth with a probability, see `region_radius`."""
        return region_radius(dimensions, self.dof, level)

    def at_image(self, xy: ArrayLike, *, relative_to: RelativeTo = MARKINGS_IN_VIEW) -> GroundError:
        """Errors of the ground points that are seen at pixels (..., 2), see `at_field`."""
        return self._of_ground(self.camera.image_to_field(xy), relative_to)

    def at_field(self, X: ArrayLike, *, relative_to: RelativeTo = MARKINGS_IN_VIEW) -> GroundError:
        """Errors of ground points (..., 3), z = 0: of where the camera, given their true pixels, takes them to be.

        Relative to the "markings in view" they do not have what moves these with a size of the field that is not known
        (`fieldcalib.assess.datum`); relative to the "centre mark" they do.

        Raises
        ------
        ValueError
            If a point is not on the ground, or `relative_to` is something else.
        """
        X = np.asarray(X, dtype=float)
        if X.shape[-1:] != (3,) or np.any(X[..., 2] != 0.0):
            raise ValueError(f"expected ground points of shape (..., 3) with z = 0, got {X.tolist()}; append a zero")
        seen = np.isfinite(self.camera.project(X)).all(axis=-1, keepdims=True)
        return self._of_ground(np.where(seen, X, np.nan), relative_to)

    @cached_property
    def motion_of_markings(self) -> Array:
        """Derivatives (2, n) by theta of the frame that the markings in view are, see `fieldcalib.assess.datum`."""
        return np.asarray(by_parameters(Projection(self.theta[None], self.layout), self.field)[0])

    @property
    def remedy(self) -> str:
        """What would give metres from the centre mark; empty where they are, see `fieldcalib.assess.datum`."""
        if not np.any(self.motion_of_markings):
            return ""
        block = self.layout.field_size_block
        return in_words(
            self.motion_of_markings[:, block], self._standard_deviations(np.eye(self.layout.size)[block])[:, 0]
        )

    def _of_ground(self, X: Array, relative_to: RelativeTo) -> GroundError:
        """Errors at ground points (..., 3)."""
        dX_dtheta, known = self.ground_jacobian(X)
        if checked(relative_to) == MARKINGS_IN_VIEW:
            dX_dtheta = dX_dtheta - self.motion_of_markings
        return GroundError(np.where(known[..., None, None], self.propagated(dX_dtheta), np.nan), self.dof)

    def ground_jacobian(self, X: Array) -> tuple[Array, BoolArray]:
        """Derivatives (..., 2, n) of ground points (..., 3), and which exist, (...,), see `ground_derivatives`.

        They are those of places from the centre mark on.
        """
        known = np.asarray(np.isfinite(X).all(axis=-1))
        projection, every = Projection(self.theta[None], self.layout), np.ones(len(self.theta), dtype=bool)
        J = ground_derivatives(projection, X.reshape(1, -1, 3), known.reshape(1, -1), every)
        return J.reshape(*known.shape, 2, len(self.theta)), known

    def _standard_deviations(self, J: Array) -> Array:
        """Standard deviations (m, 1) of quantities whose derivatives by theta are J (m, n)."""
        return np.asarray(np.sqrt(np.maximum(np.diagonal(self.propagated(J)), 0.0)))[:, None]


class KnownErrors(CameraErrors):
    """A camera with its covariance, without what it was estimated from.

    Parameters
    ----------
    layout : Layout
        Of the parameters.
    theta : (n,) array
        The estimate.
    covariance : (n, n) array
    dof : float
        Degrees of freedom that the covariance rests on.
    field : Field, optional
        What the camera sees; it is not written with the errors.

    Examples
    --------
    >>> from fieldcalib.problem.layout import Layout
    >>> camera = Camera.from_angles(0.1, 1.3, 0.0, 1500.0, (0.0, 65.0, -16.0), (960, 540))
    >>> layout = Layout.of((960, 540))
    >>> errors = KnownErrors(layout, layout.theta(camera), np.diag([1e-4] * 3 + [0.0] * (layout.size - 3)))
    >>> round(float(errors.at_field((0.0, 0.0, 0.0)).rms), 3)  # of a hundredth of a radian, at 67 m
    2.874
    """

    def __init__(
        self, layout: Layout, theta: Array, covariance: Array, dof: float = np.inf, field: Field | None = None
    ) -> None:
        self._layout, self._theta, self._covariance, self.dof, self.field = layout, theta, covariance, dof, field

    def on(self, field: Field | None) -> KnownErrors:
        """Name the field that is in view: errors are then relative to its markings."""
        return KnownErrors(self._layout, self._theta, self._covariance, self.dof, field)

    @property
    def if_level(self) -> KnownErrors:
        """The errors if the field were known to be level."""
        covariance = if_level(self._covariance, self._layout.is_crown)
        return KnownErrors(self._layout, self._theta, covariance, self.dof, self.field)

    @property
    def layout(self) -> Layout:
        """Of the parameters."""
        return self._layout

    @property
    def theta(self) -> Array:
        """The estimate, (n,)."""
        return self._theta

    def propagated(self, J: Array) -> Array:
        """Covariance (..., m, m) of quantities whose derivatives by theta are J (..., m, n)."""
        return np.asarray(J @ self._covariance @ np.swapaxes(J, -2, -1))

    @property
    def uncertainty(self) -> KnownErrors:
        """Itself: as `fieldcalib.assess.solved.Solved` has one."""
        return self

    def to_dict(self) -> dict[str, Any]:
        """Everything, for `json.dumps`."""
        return {
            "layout": layout_to_record(self.layout),
            "theta": to_json(self.theta),
            "covariance": to_json(self._covariance),
            "dof": to_json(self.dof),
        }

    @classmethod
    def from_dict(cls, record: Mapping[str, Any]) -> KnownErrors:
        """The inverse of `to_dict`."""
        return cls(
            layout_from_record(record["layout"]),
            from_json(record["theta"]),
            from_json(record["covariance"]),
            float(from_json(record["dof"])),
        )

    def __reduce__(self) -> tuple[Callable[..., KnownErrors], tuple[dict[str, Any]]]:
        return KnownErrors.from_dict, (self.to_dict(),)


def region_radius(dimensions: int, dof: float, level: float) -> float:
    """How many standard deviations (Mahalanobis) hold an error of so many dimensions with a probability.

    ``sqrt(d F)`` with F the quantile of Fisher's distribution with d and `dof` degrees of freedom; for one dimension
    Student's t, two-sided.

    Examples
    --------
    >>> round(region_radius(1, 1e9, 0.95), 2), round(region_radius(1, 5.0, 0.95), 2)
    (1.96, 2.57)
    """
    from scipy.special import fdtri  # a slow import

    if not 0.0 < level < 1.0:
        raise ValueError(f"level must be a probability between 0 and 1, got {level}")
    return float(np.sqrt(dimensions * fdtri(dimensions, min(dof, NORMAL), level)))


def _inverse_left_jacobian(rvec: Array) -> Array:
    """Derivative (3, 3) of a rotation vector by a small rotation applied after it.

    ``I - [v] / 2 + (1 / |v|^2 - cot(|v| / 2) / (2 |v|)) [v]^2``. Source: Sola, Deray, Atchuthan: A micro Lie theory,
    2018, equation (146).
    """
    angle = float(np.linalg.norm(rvec))
    bend = 1.0 / 12.0 if angle < 1e-4 else 1.0 / angle**2 - 0.5 / (angle * np.tan(0.5 * angle))
    x, y, z = rvec
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) - 0.5 * cross + bend * cross @ cross)
