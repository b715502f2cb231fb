"""An estimated camera: from the covariance of its parameters to errors of intrinsics, pose and points on the ground.

The reference of errors on the ground: the markings in view, or the centre mark.

Where the length of a pitch is not known and one end of it is in view, positions relative to the centre mark are
uncertain by half of its error, while positions relative to the paint in view are known to centimetres. The true pitch
is the assumed one with its markings moved by M (`Field.motion`) per metre of length and width. A camera that was fitted
to them locates a point X at X + J e, with e the error of its parameters, length and width among them. Relative to the
markings the point is off by

    J e - t e_size,

where t e_size is the common displacement of the markings in view: t is the translation of the ground nearest to their
motion,

    t = argmin sum_i w_i |n_i . (M_i - t)|^2,

over the metres w_i of all markings in view, with n_i their normals. A line does not show motion along itself, so lines
across x determine the x of t, lines across y its y, and circles both. With one end in view t is the motion of this end,
and the error of the length drops out. With both ends in view their motions cancel, t is small, and the error of the
length remains at both. Along a coordinate that no marking in view determines, t is 0: the error stays relative to the
centre mark.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Literal, NamedTuple, Self, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib._types import Array, BoolArray, is_number, one_of
from fieldcalib.assess.ground import ground_derivatives, pixels_of_points, projection_on
from fieldcalib.assess.observability import Direction
from fieldcalib.fields.field import Field, terrain_of
from fieldcalib.geometry.camera import Camera
from fieldcalib.geometry.rotation import rotation_axes, rotation_vector_jacobian
from fieldcalib.problem.layout import ANGLES, CENTER, LOG_ASPECT, LOG_F, PRINCIPAL_POINT, Layout
from fieldcalib.problem.projection import Projection

RelativeTo: TypeAlias = Literal["markings in view", "centre mark"]
MARKINGS_IN_VIEW: RelativeTo = "markings in view"
CENTRE_MARK: RelativeTo = "centre mark"

PIXEL_SD = 2.0  # px: of what a detector finds or a person clicks, unless it is told
SPACING = 1.0  # m, of the places along the markings
FAINT = 1e-3  # m of marking: less does not determine a translation
OFF_GROUND = 1e-3  # m: points farther from the ground are on none
APART = 0.5  # m: larger errors of the centre mark relative to the markings in view are mentioned
SIDES = (("length", ("left end", "right end")), ("width", ("far side", "near side")))  # as the main camera sees them

INTRINSICS, EXTRINSICS = 18, 6  # lengths of cv2.calibrateCameraExtended's standard deviations
NORMAL = 1e9  # degrees of freedom from which on Fisher's distribution is the chi-squared one
LENS_INTRINSICS = slice(4, 16)  # of the intrinsics: k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4


class _Places(NamedTuple):
    """N places along the painted markings of a field."""

    X: Array
    """Positions, (N, 3)."""
    normal: Array
    """Terms ``w n n^T`` of the normal equations of t, row by row, (N, 4)."""
    moving: Array
    """Terms ``w n n^T M`` of their right side, (N, 4)."""


@lru_cache(maxsize=64)
def _places(field: Field) -> _Places:
    X, normal, moving = [np.zeros((0, 3))], [np.zeros((0, 2, 2))], [np.zeros((0, 2, 2))]
    for (label, segment), motion in zip(field.items(), field.motion, strict=True):
        if label in field.half_labels or field.paint_of(label).width == 0.0:
            continue
        parts = segment.parts(SPACING)
        if parts is None:
            continue
        share = parts.share[:, None, None]
        moved = (1.0 - share) * motion[0, :2] + share * motion[1, :2]
        along = parts.along[:, :2]
        X.append(parts.X)
        across = np.eye(2) - along[:, :, None] * along[:, None, :]  # for a post both directions
        normal.append(parts.length / len(moved) * across)
        moving.append(normal[-1] @ moved)
    on_ground = field.terrain.raised(np.concatenate(X))
    return _Places(on_ground, *(np.concatenate(one).reshape(-1, 4) for one in (normal, moving)))


def motion_in_view(projection: Projection, field: Field) -> Array:
    """Common motion t of the markings that B cameras see, in metres per metre of length and width, (B, 2, 2).

    Every marking that the camera projects into its image counts as in view, even if something hides it.

    Examples
    --------
    >>> from fieldcalib import Camera, soccer
    >>> from fieldcalib.problem.layout import Layout
    >>> right = Camera.from_angles(0.6, 1.35, 0.0, 2500.0, (0.0, 65.0, -16.0), (960, 540))
    >>> layout = Layout.of((960, 540))
    >>> abs(motion_in_view(Projection(layout.theta(right)[None], layout), soccer()).round(3))  # x with half the length
    array([[[0.5  , 0.   ],
            [0.   , 0.091]]])
    """
    places = _places(field)
    xy, has_pixel = pixels_of_points(projection, places.X[None])
    size = np.array(projection.layout.image_size)
    in_view = (has_pixel & np.all((xy >= -0.5) & (xy < size - 0.5), axis=-1)).astype(float)
    in_view = in_view[:, None]  # a product for each camera, which does not depend on how many there are
    normal = (in_view @ places.normal).reshape(-1, 2, 2)
    return np.asarray(np.linalg.solve(normal + FAINT * np.eye(2), (in_view @ places.moving).reshape(-1, 2, 2)))


def by_parameters(projection: Projection, field: Field | None) -> Array:
    """Motion of the markings in view as derivatives (B, 2, n) by all parameters: 0 except by length and width."""
    layout = projection.layout
    moved = np.zeros((len(projection.theta), 2, layout.size))
    if field is not None and layout.is_sized:
        moved[:, :, layout.field_size_block] = motion_in_view(projection, field)
    return moved


def relative_to_markings(derivatives: Array, projection: Projection, field: Field | None, some: BoolArray) -> Array:
    """Derivatives (B, N, 2, P) of ground points by some parameters (n,), less the motion of the markings in view."""
    layout = projection.layout
    if field is None or not np.any(some[layout.field_size_block]):
        return derivatives
    return derivatives - by_parameters(projection, field)[:, None, :, some]


def in_words(motion: Array, standard_deviations: Array) -> str:
    """Describe the reference of positions, with advice; empty if the centre mark is known well enough.

    Parameters
    ----------
    motion : (2, 2) array
        Motion of the markings in view with length and width, see `motion_in_view`.
    standard_deviations : (2,) array
        Standard deviations of length and width, metres.

    Examples
    --------
    >>> print(in_words(np.diag([0.5, -0.5]), np.array([2.5, 0.1])))
    the length is not visible: positions are relative to the right end; the known length gives metres from the centre
    """
    along = np.diagonal(motion)
    is_open = np.abs(along) * standard_deviations > APART
    found = [(name, sides[int(along[k] > 0.0)]) for k, (name, sides) in enumerate(SIDES) if is_open[k]]
    if not found:
        return ""
    names, sides_in_view = (" and ".join(one) for one in zip(*found, strict=True))
    verb, gives = ("is", "gives") if len(found) == 1 else ("are", "give")
    return (
        f"the {names} {verb} not visible: positions are relative to the {sides_in_view}; the known {names} {gives} "
        f"metres from the centre"
    )


@dataclass(frozen=True)
class GroundError:
    """Errors of points on the ground: `rms` in metres, and the `ellipse` that contains the true point."""

    covariance: Array
    """Covariance (..., 2, 2) of x and y: NaN where there is no ground point, infinite where nothing determines it."""
    dof: float
    """Degrees of freedom of Student's t."""

    @property
    def rms(self) -> Array:
        """Root mean square distance to the true point, (...,) metres: of one point a float."""
        variance = np.trace(self.covariance, axis1=-2, axis2=-1)
        rms: Array = np.sqrt(np.maximum(variance, 0.0))  # rounding may make it less than 0
        return rms

    def ellipse(self, level: float = 0.95) -> tuple[Array, Array]:
        """The ellipse that contains the true point with the probability `level`.

        Returns
        -------
        half_axes : (..., 2) array
            Metres, the longer one first; NaN where the covariance is not finite.
        angle : (...,) array
            Direction of the longer axis, radians from x towards y.
        """
        known = np.asarray(np.isfinite(self.covariance).all(axis=(-2, -1)))
        values, vectors = np.linalg.eigh(np.where(known[..., None, None], self.covariance, np.eye(2)))
        half_axes = region_radius(2, self.dof, level) * np.sqrt(np.maximum(values[..., ::-1], 0.0))
        y, x = np.moveaxis(vectors[..., 1], -1, 0)[::-1].copy()
        angle = np.arctan2(y, x)
        return np.where(known[..., None], half_axes, np.nan), np.where(known, angle, np.nan)[()]


class Estimate(ABC):
    """An estimated camera and its errors, from a covariance of any origin."""

    layout: Layout
    """Names and order of the parameters."""
    theta: Array
    """The estimate, (n,)."""
    dof: float
    """Degrees of freedom of Student's and Fisher's distributions, which give the size of regions."""
    field: Field | None
    """The field in view; None if the object is not a `Field`: then errors are relative to its origin."""

    @abstractmethod
    def on(self, field: Field | None) -> Self:
        """The estimate with another field in view: errors are then relative to its markings."""

    @property
    @abstractmethod
    def observability(self) -> tuple[Direction, ...]:
        """Directions of the parameters, least determined by the labels first."""

    @abstractmethod
    def propagated(self, J: Array) -> Array:
        """Covariance (..., m, m) of quantities whose derivatives by theta are J (..., m, n)."""

    @property
    def covariance(self) -> Array:
        """Covariance (n, n) of theta, in the order of the layout's `names`; 0 for fixed parameters.

        Parameters that nothing determines have an infinite variance, and covariances of NaN.
        """
        return self.propagated(np.eye(len(self.theta)))

    @cached_property
    def camera(self) -> Camera:
        """The estimated camera."""
        return self.layout.camera(self.theta)

    @property
    def std_deviations_intrinsics(self) -> Array:
        """Standard deviations (18, 1) in cv2's order: fx, fy, cx, cy, k1, k2, p1, p2, k3 to k6, s1 to s4, 0, 0."""
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
        """Standard deviations (6, 1) in cv2's order: rvec, then tvec."""
        rvec, tvec, _, _ = self.camera.to_opencv()
        axes = rotation_axes(self.theta[ANGLES], self.camera.R)
        J = np.zeros((EXTRINSICS, len(self.theta)))
        # angles turn the scene by -axis, on the left of R: the inverse left Jacobian of SO(3) gives the change of rvec
        J[:3, ANGLES] = -rotation_vector_jacobian(rvec[:, 0]) @ axes.T
        J[3:, ANGLES] = -np.cross(axes, tvec[:, 0]).T
        J[3:, CENTER] = -self.camera.R
        return self._standard_deviations(J @ self.layout.zoom_jacobian(self.theta))

    def radius(self, dimensions: int = 1, level: float = 0.95) -> float:
        """Number of standard deviations that contain the truth with a probability, see `region_radius`."""
        return region_radius(dimensions, self.dof, level)

    def at_image(self, xy: ArrayLike, *, relative_to: RelativeTo = MARKINGS_IN_VIEW) -> GroundError:
        """Errors of the ground points seen at pixels (..., 2), see `at_field`."""
        return self._at(self.camera.image_to_field(xy, terrain=terrain_of(self.field)), relative_to)

    def at_field(self, X: ArrayLike, *, relative_to: RelativeTo = MARKINGS_IN_VIEW) -> GroundError:
        """Errors of ground points (..., 3), z = 0, that the camera locates from their true pixels.

        Where the size of the field is not known, errors relative to the "centre mark" contain the motion of the
        markings with that size; errors relative to the "markings in view" do not (`fieldcalib.assess.estimate`).

        Raises
        ------
        ValueError
            If a point is not on the ground, or `relative_to` has another value.
        """
        X = np.asarray(X, dtype=float)
        if X.shape[-1:] != (3,):
            raise ValueError(f"expected ground points of shape (..., 3) with z = 0, got {X.tolist()}; append a zero")
        terrain, on_ground = terrain_of(self.field), X * (1.0, 1.0, 0.0)
        on_ground = on_ground if terrain is None else terrain.raised(on_ground)
        if np.any(np.minimum(np.abs(X[..., 2]), np.abs(X[..., 2] - on_ground[..., 2])) > OFF_GROUND):
            raise ValueError(f"expected ground points of shape (..., 3) with z = 0, got {X.tolist()}")
        X, seen = on_ground, np.isfinite(self.camera.project(on_ground)).all(axis=-1, keepdims=True)
        return self._at(np.where(seen, X, np.nan), relative_to)

    @cached_property
    def motion_of_markings(self) -> Array:
        """Derivatives (2, n) by theta of the common motion of the markings in view (`fieldcalib.assess.estimate`)."""
        return np.asarray(by_parameters(projection_on(self.field, self.theta[None], self.layout), self.field)[0])

    @property
    def remedy(self) -> str:
        """Advice if positions relative to the centre mark are not known, else empty (`fieldcalib.assess.estimate`)."""
        if not np.any(self.motion_of_markings):
            return ""
        block = self.layout.field_size_block
        deviations = self._standard_deviations(np.eye(self.layout.size)[block])[:, 0]
        return in_words(self.motion_of_markings[:, block], deviations)

    def _at(self, X: Array, relative_to: RelativeTo) -> GroundError:
        """Errors at ground points (..., 3); NaN there gives NaN."""
        dX_dtheta, known = self.ground_jacobian(X)
        if one_of(relative_to, get_args(RelativeTo), "relative_to") == MARKINGS_IN_VIEW:
            dX_dtheta = dX_dtheta - self.motion_of_markings
        return GroundError(np.where(known[..., None, None], self.propagated(dX_dtheta), np.nan), self.dof)

    def ground_jacobian(self, X: Array) -> tuple[Array, BoolArray]:
        """Derivatives (..., 2, n) of ground points (..., 3) relative to the centre mark, and which exist, (...,)."""
        known = np.asarray(np.isfinite(X).all(axis=-1))
        projection = projection_on(self.field, self.theta[None], self.layout)
        every = np.ones(len(self.theta), dtype=bool)
        J = ground_derivatives(projection, X.reshape(1, -1, 3), known.reshape(1, -1), every)
        return J.reshape(*known.shape, 2, len(self.theta)), known

    def _standard_deviations(self, J: Array) -> Array:
        """Standard deviations (m, 1) of quantities whose derivatives by theta are J (m, n)."""
        return np.asarray(np.sqrt(np.maximum(np.diagonal(self.propagated(J)), 0.0)))[:, None]


def region_radius(dimensions: int, dof: float, level: float) -> float:
    """Mahalanobis distance below which an error of some dimensions lies with the probability `level`.

    ``sqrt(d F)`` with F the quantile of Fisher's distribution with d and `dof` degrees of freedom; for one dimension
    Student's t, two-sided.

    Examples
    --------
    >>> round(region_radius(1, 1e9, 0.95), 2), round(region_radius(1, 5.0, 0.95), 2)
    (1.96, 2.57)
    """
    from scipy.special import fdtri  # a slow import

    if not (is_number(level) and 0.0 < level < 1.0):
        raise ValueError(f"level must be a probability between 0 and 1, got {level}")
    return float(np.sqrt(dimensions * fdtri(dimensions, min(dof, NORMAL), level)))
