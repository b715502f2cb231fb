"""The parameter vector theta of a camera: its blocks, and which of them are estimated.

    theta = (pan, tilt, roll, log f, x, y, z, cx, cy, log aspect, lens..., [zoom law...], [length, width], [crown])

Angles in radians, f the focal length along rows in pixels, (x, y, z) the camera centre in metres, (cx, cy) the
principal point in pixels, aspect fy / fx, the coefficients of a lens (`fieldcalib.geometry.lens`), and, where the
object is a field whose size or ground is not known, its length and width in metres, and its crown, the height of its
middle above the touchlines (`fieldcalib.fields.ground`). Parameters that are not estimated stay at their known values.

Where one camera takes many frames, its principal point and its lens follow the zoom, and its centre of projection is
not on the axes about which it turns. With u = log f - reference and the zoom law (m_x, m_y, l, q, o), the camera of a
theta has the principal point ``(cx, cy) + u (m_x, m_y)``, the first lens coefficient ``a1 + l u + q u^2``, and its
centre o metres ahead of (x, y, z) along its optical axis. On ten measured broadcast cameras (1920 x 1080, zoom by up to
2) the principal point is linear in log f to 1 px, and a1 quadratic to 0.003.

Weak Gaussian priors of theta: from the ranges of a camera distribution, the lens, the principal point.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import IntEnum
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np

from fieldcalib._types import Array, BoolArray, IntArray
from fieldcalib.fields.field import Field
from fieldcalib.fields.ground import Ground, Terrain
from fieldcalib.fields.traits import DEVIATIONS, CameraDistribution, Crown, focal_length_from_fov
from fieldcalib.geometry.camera import Camera
from fieldcalib.geometry.lens import FisheyeLens, Lens, RadialLens
from fieldcalib.geometry.rotation import rotation_axes, rotation_from_angles
from fieldcalib.problem.picture_shape import principal_point_sigma

# The blocks that every camera has, at the same positions for every lens.
ANGLES = slice(0, 3)
PAN, TILT, ROLL = 0, 1, 2
LOG_F = 3
CENTER = slice(4, 7)
PRINCIPAL_POINT = slice(7, 9)
LOG_ASPECT = 9
POSE_AND_ZOOM = slice(0, 7)  # the parameters that camera distributions describe
COMMON = ("pan", "tilt", "roll", "log f", "x", "y", "z", "cx", "cy", "log aspect")
FIELD_SIZE = ("length", "width")
CROWN = ("crown",)
CROWN_RANGE = (0.0, 0.8)  # metres: natural grass is built with up to 0.5
ZOOM_LAW = ("cx slope", "cy slope", "a1 slope", "a1 bend", "axis offset")

# The longest step in one iteration, for a scene of 1 m: the linearisation does not hold farther away.
LARGEST_STEP = (0.4, 0.4, 0.4, 0.7, 1.0, 1.0, 1.0)  # of `POSE_AND_ZOOM`
# Standard deviations of the zoom law: slopes of the principal point in image widths, slope and curvature of a1, and the
# offset in metres. On ten measured cameras the principal point moves by up to 0.011 widths and a1 by 0.04 as the focal
# length grows by a factor e, and the curvature is up to 0.14. A tripod head holds a camera near its centre of gravity:
# the pupil is a decimetre or two off.
ZOOM_LAW_SIGMA = (0.006, 0.006, 0.02, 0.08, 0.1)
LOG_ASPECT_SIGMA = 0.005  # square pixels, up to the resampling of a broadcast chain


def exp_of(theta: Array, column: int) -> Array:
    """``exp`` of a parameter, `LOG_F` or `LOG_ASPECT`, of parameter vectors (..., n).

    It is computed from a copy: NumPy 1.26 and 2.0 (not 2.4) round ``exp``, ``arctan2`` and others differently near the
    end of a non-contiguous column, and results would depend on the position in memory. (`ascontiguousarray` does not
    copy a single number, whose stride is still that of the column.)

    Examples
    --------
    >>> exp_of(np.full((2, 14), np.log(1000.0)), LOG_F).round(9)
    array([1000., 1000.])
    """
    return np.asarray(np.exp(theta[..., column].copy()))


class Role(IntEnum):
    """Treatment of a parameter by a solver."""

    FIXED = 0
    """Known, not estimated."""
    FRAME = 1
    """Estimated for each frame by itself."""
    SHARED = 2
    """Estimated once for all frames of a group."""
    CONSIDERED = 3
    """Kept at an uncertain value; its uncertainty enters the covariance of the other parameters."""


class SizeBlock(NamedTuple):
    """Length and width of a field as parameters, metres."""

    given: Array
    """Length and width of the field that observations are packed for, (2,)."""
    sigma: Array
    """Standard deviations of the prior around it, if the size is estimated, (2,)."""
    limits: Array
    """Least and largest length and width, (2, 2)."""
    possibilities: tuple[Array, Array] = (np.ones(1), np.zeros((1, 2)))
    """Mixture of normal distributions around the given size, if considered: probabilities (K,), sigmas (K, 2)."""
    crown: Crown | None = None
    """Distribution of the crown; None if it is no parameter."""
    height: float = 0.0
    """Crown of the field that observations are packed for, metres."""
    shift: Array = np.zeros(3)
    """Length, width and crown of that field minus those around which the prior is, (3,): 0 unless it was estimated."""

    @classmethod
    def of(cls, field: Field) -> SizeBlock | None:
        """Size and crown of a field as parameters, with what is known of such fields; None if all of them are known."""
        given, crown = np.array([field.length, field.width]), field.crown if field.ground is None else None
        if field.size_model is not None and field.moves_with_size and not field.size_known:
            model = field.size_model
            return cls(given, model.sigma, model.limits, model.possibilities, crown, field.terrain.crown)
        return None if crown is None else cls(given, np.ones(2), np.array([given, given]), crown=crown)

    @property
    def is_known(self) -> bool:
        """Whether length and width are exact, and only the crown is not."""
        return bool(np.all(self.limits == self.given))

    def resize(self, field: Field, length: float, width: float, height: float) -> Field:
        """A field of another size, unless it is known, with a crown of this height; one of 0 leaves its ground open."""
        field = field if self.is_known else field.resized(length, width)
        return field.with_ground(Ground(height)) if height > 0.0 else field

    @property
    def possibilities_with_crown(self) -> tuple[Array, Array]:
        """`possibilities` of length, width and crown: probabilities (2 K,) and sigmas (2 K, 3), level fields first."""
        if self.crown is None:
            return self.possibilities
        (size_probability, size_sigma), (probability, sigma) = self.possibilities, self.crown.possibilities
        both = [np.insert(size_sigma, 2, height, axis=1) for height in sigma]
        return np.outer(probability, size_probability).ravel(), np.concatenate(both)


class Bounds(NamedTuple):
    """Bounds of the free parameters (P,) and of their steps in one iteration."""

    free: IntArray
    """Indices of the free parameters."""
    least: Array
    largest: Array
    longest: Array


class ZoomLaw(NamedTuple):
    """The law by which principal point, lens and centre of one camera follow its zoom, see above."""

    reference: float
    """The log f at which cx, cy and a1 have their values in theta."""


@dataclass(frozen=True, eq=False)
class Layout:
    """The blocks of theta and the roles of its parameters.

    Examples
    --------
    >>> layout = Layout.of((960, 540)).fixed("principal point", "aspect", "lens")
    >>> layout.names
    ('pan', 'tilt', 'roll', 'log f', 'x', 'y', 'z', 'cx', 'cy', 'log aspect', 'a1', 'b2')
    >>> [name for name, free in zip(layout.names, layout.free) if free]
    ['pan', 'tilt', 'roll', 'log f', 'x', 'y', 'z']
    """

    image_size: tuple[int, int]
    lens: Lens
    roles: Array = field(repr=False)
    """`Role` of each parameter, (n,)."""
    field_size: SizeBlock | None = None
    """Length and width as parameters; None if they are not."""
    zoom_law: ZoomLaw | None = None
    """The zoom law; None if no other parameter follows the zoom."""

    @classmethod
    def of(
        cls,
        image_size: tuple[int, int],
        lens: Lens | None = None,
        field_size: SizeBlock | None = None,
        zoom_law: ZoomLaw | None = None,
    ) -> Layout:
        """A layout with all parameters estimated for each frame, and a crown considered; the default lens is radial."""
        lens = RadialLens(float(np.hypot(*image_size) / 2.0)) if lens is None else lens
        roles = np.full(len(_names(lens, field_size, zoom_law)), Role.FRAME)
        roles[len(COMMON) + lens.estimable : len(COMMON) + len(lens.names)] = Role.FIXED
        layout = cls(image_size, lens, roles, field_size, zoom_law)
        roles[layout.crown_block] = Role.CONSIDERED
        if field_size is not None and field_size.is_known:
            roles[layout.field_size_block] = Role.FIXED
        return layout

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters, in the order of theta."""
        return _names(self.lens, self.field_size, self.zoom_law)

    @property
    def size(self) -> int:
        """Length of theta."""
        return len(self.roles)

    @cached_property
    def lens_block(self) -> slice:
        """Block of the lens coefficients."""
        return slice(len(COMMON), len(COMMON) + len(self.lens.names))

    @cached_property
    def zoom_law_block(self) -> slice:
        """Block of the zoom law; empty if there is none."""
        return slice(self.lens_block.stop, self.lens_block.stop + (len(ZOOM_LAW) if self.zoom_law is not None else 0))

    @cached_property
    def field_size_block(self) -> slice:
        """Block of length and width; empty if the size is not a parameter."""
        first = self.zoom_law_block.stop
        return slice(first, first + (len(FIELD_SIZE) if self.field_size is not None else 0))

    @cached_property
    def crown_block(self) -> slice:
        """Block of the crown of the field; empty if it is not a parameter."""
        return slice(self.field_size_block.stop, self.size)

    @cached_property
    def blocks(self) -> dict[str, slice]:
        """All blocks by name; each coefficient of the lens is a block too, by OpenCV's name."""
        first = self.lens_block.start
        coefficients = {name: slice(first + i, first + i + 1) for i, name in enumerate(self.lens.opencv_names)}
        return coefficients | {
            "angles": ANGLES,
            "roll": slice(ROLL, ROLL + 1),
            "focal length": slice(LOG_F, LOG_F + 1),
            "centre": CENTER,
            "principal point": PRINCIPAL_POINT,
            "aspect": slice(LOG_ASPECT, LOG_ASPECT + 1),
            "lens": self.lens_block,
            "zoom law": self.zoom_law_block,
            "field size": self.field_size_block,
            "crown": self.crown_block,
        }

    @cached_property
    def free(self) -> BoolArray:
        """Mask of the estimated parameters, (n,)."""
        return np.asarray((self.roles == Role.FRAME) | (self.roles == Role.SHARED))

    @cached_property
    def has_free_size(self) -> bool:
        """Whether length or width of the field is estimated."""
        return bool(np.any(self.free[self.field_size_block]))

    @cached_property
    def has_free_crown(self) -> bool:
        """Whether the crown of the field is estimated."""
        return bool(np.any(self.free[self.crown_block]))

    @cached_property
    def shared(self) -> BoolArray:
        """Mask of the shared ones among the estimated parameters, (P,)."""
        return np.asarray(self.roles[self.free] == Role.SHARED)

    @cached_property
    def considered(self) -> BoolArray:
        """Mask of the considered parameters, (n,)."""
        return np.asarray(self.roles == Role.CONSIDERED)

    @cached_property
    def is_centre(self) -> BoolArray:
        """Mask of the centre of the camera, (n,)."""
        return self._mask(CENTER)

    @cached_property
    def is_lens(self) -> BoolArray:
        """Mask of the lens, (n,)."""
        return self._mask(self.lens_block)

    @property
    def is_sized(self) -> bool:
        """Whether length or width of the field are uncertain."""
        return bool(np.any(self.roles[self.field_size_block] != Role.FIXED))

    @property
    def quantities(self) -> Array:
        """Length, width and crown of the field that observations are packed for, (0,), (2,) or (3,)."""
        size = self.field_size
        return (
            np.zeros(0)
            if size is None
            else np.append(size.given, size.height)[: self.size - self.field_size_block.start]
        )

    @property
    def prior_moment(self) -> Array:
        """Covariance (c, c) of considered length, width and crown a priori."""
        index = np.flatnonzero(self.considered) - self.field_size_block.start
        if self.field_size is None or not len(index):
            return np.zeros((0, 0))
        probability, sigma = self.field_size.possibilities_with_crown
        return np.diag(probability @ np.square(sigma[:, index]))

    @cached_property
    def is_crown(self) -> BoolArray:
        """Mask of the crown of the field, (n,)."""
        return self._mask(self.crown_block)

    def _mask(self, block: slice) -> BoolArray:
        mask = np.zeros(self.size, dtype=bool)
        mask[block] = True
        return mask

    def bounds(self, scale: float) -> Bounds:
        """The bounds of the free parameters, for scenes of `scale` metres."""
        of_unit = self._bounds_of_unit
        return of_unit._replace(longest=of_unit.longest * np.where(self.is_centre[of_unit.free], scale, 1.0))

    @cached_property
    def _bounds_of_unit(self) -> Bounds:
        """`bounds` for scenes of one metre."""
        least, largest, longest = (np.full(self.size, bound) for bound in (-np.inf, np.inf, np.inf))
        least[self.lens_block] = self.lens.least
        if self.field_size is not None:
            least[self.field_size_block], largest[self.field_size_block] = self.field_size.limits
            least[self.crown_block], largest[self.crown_block] = CROWN_RANGE
        longest[POSE_AND_ZOOM] = LARGEST_STEP
        free = np.flatnonzero(self.free)
        return Bounds(free, least[free], largest[free], longest[free])

    def with_roles(self, role: Role, *blocks: str) -> Layout:
        """The layout with another role for some blocks."""
        roles = self.roles.copy()
        for name in blocks:
            roles[self.blocks[name]] = role
        return replace(self, roles=roles)

    def with_roles_of(self, some: BoolArray, role: Role) -> Layout:
        """The layout with another role for some parameters (n,)."""
        return replace(self, roles=np.where(some, role, self.roles))

    def fixed(self, *blocks: str) -> Layout:
        """The layout with some blocks known."""
        return self.with_roles(Role.FIXED, *blocks)

    def theta(self, camera: Camera) -> Array:
        """The parameter vector of a camera, (n,).

        Raises
        ------
        ValueError
            If the lens of the layout does not have the camera's coefficients.
        """
        if camera.fisheye != isinstance(self.lens, FisheyeLens):
            raise ValueError(f"a {self.lens.name} lens cannot be that of {camera}")
        fx, fy = camera.K[0, 0], camera.K[1, 1]
        theta = np.zeros(self.size)
        theta[ANGLES], theta[LOG_F], theta[CENTER] = camera.angles, np.log(fx), camera.C
        theta[PRINCIPAL_POINT], theta[LOG_ASPECT] = camera.principal_point, np.log(fy / fx)
        theta[self.lens_block] = self.lens.from_opencv(camera.dist, fx)
        theta[self.field_size_block.start :] = self.quantities
        return theta

    def at_zoom(self, theta: Array) -> Array:
        """Parameter vectors (..., n) with principal point, lens and centre evaluated at their zoom."""
        if self.zoom_law is None:
            return theta
        found, u = theta.copy(), theta[..., LOG_F] - self.zoom_law.reference
        law = theta[..., self.zoom_law_block]
        found[..., PRINCIPAL_POINT] += u[..., None] * law[..., :2]
        if self.lens.names:
            found[..., self.lens_block.start] += u * law[..., 2] + np.square(u) * law[..., 3]
        if np.any(law[..., 4]):
            R = rotation_from_angles(theta[..., ANGLES])
            found[..., CENTER] += law[..., 4, None] * R[..., 2, :]
        return found

    def zoom_jacobian(self, theta: Array) -> Array:
        """Derivatives (..., n, n) of `at_zoom` of parameter vectors (..., n)."""
        J = np.broadcast_to(np.eye(self.size), (*theta.shape, self.size)).copy()
        if self.zoom_law is None:
            return J
        u, law = theta[..., LOG_F] - self.zoom_law.reference, theta[..., self.zoom_law_block]
        first, a1 = self.zoom_law_block.start, self.lens_block.start
        J[..., PRINCIPAL_POINT, LOG_F] = law[..., :2]
        J[..., PRINCIPAL_POINT, first : first + 2] = u[..., None, None] * np.eye(2)
        if self.lens.names:
            J[..., a1, LOG_F] = law[..., 2] + 2.0 * law[..., 3] * u
            J[..., a1, first + 2], J[..., a1, first + 3] = u, np.square(u)
        R = rotation_from_angles(theta[..., ANGLES])
        axes = rotation_axes(theta[..., ANGLES], R)
        J[..., CENTER, first + 4] = R[..., 2, :]
        J[..., CENTER, ANGLES] = law[..., 4, None, None] * np.swapaxes(np.cross(axes, (0.0, 0.0, 1.0)) @ R, -1, -2)
        return J

    def referred(self, reference: float) -> tuple[Layout, Array]:
        """The layout with its zoom law at another reference log f, and the matrix (n, n) that takes theta to it.

        Examples
        --------
        >>> layout = Layout.of((960, 540), zoom_law=ZoomLaw(7.0))
        >>> theta = np.arange(layout.size) / 10.0
        >>> other, change = layout.referred(7.5)
        >>> np.allclose(other.at_zoom(change @ theta)[:12], layout.at_zoom(theta)[:12])
        True
        """
        change = np.eye(self.size)
        if self.zoom_law is None:
            return self, change
        shift, first, a1 = reference - self.zoom_law.reference, self.zoom_law_block.start, self.lens_block.start
        change[PRINCIPAL_POINT, first : first + 2] = shift * np.eye(2)
        if self.lens.names:
            change[a1, first + 2], change[a1, first + 3], change[first + 2, first + 3] = shift, shift**2, 2.0 * shift
        return replace(self, zoom_law=ZoomLaw(reference)), change

    def terrain(self, theta: Array, given: Terrain | None) -> Terrain | None:
        """The ground at parameter vectors (B, n), with heights and sizes (B, 1); None where it is level.

        `given` is that of the field for which observations are packed; None for level ground.
        """
        has_crown = self.crown_block.start < self.size
        crown = theta[:, self.crown_block] if has_crown else 0.0 if given is None else given.crown
        fall = 0.0 if given is None else given.fall
        if not (np.count_nonzero(crown) or fall):  # `any` of a number is slow
            return None
        return given if self.field_size is None else self.level(theta)._replace(crown=crown, fall=fall)

    def level(self, theta: Array) -> Terrain:
        """Level ground of the length and the width in parameter vectors (B, n), which have them; (B, 1)."""
        length, width = (theta[:, k, None] for k in range(self.size)[self.field_size_block])
        return Terrain(0.0, 0.0, length, width)

    def camera(self, theta: Array) -> Camera:
        """The camera of a parameter vector, the inverse of `theta` up to full turns of the angles."""
        (camera,) = self.cameras(theta[None])
        return camera

    def cameras(self, theta: Array) -> list[Camera]:
        """The cameras of parameter vectors (B, n)."""
        theta = self.at_zoom(theta)
        fx = exp_of(theta, LOG_F)
        K = np.zeros((len(theta), 3, 3))
        K[:, 0, 0], K[:, 1, 1], K[:, 2, 2] = fx, fx * exp_of(theta, LOG_ASPECT), 1.0
        K[:, :2, 2] = theta[:, PRINCIPAL_POINT]
        R, C = rotation_from_angles(theta[:, ANGLES]), theta[:, CENTER]
        dist = self.lens.to_opencv(theta[:, self.lens_block].T, fx).T
        fisheye = isinstance(self.lens, FisheyeLens)
        return [Camera(K[b], R[b], C[b], self.image_size, dist[b], fisheye=fisheye) for b in range(len(theta))]


def _names(lens: Lens, field_size: SizeBlock | None, zoom_law: ZoomLaw | None) -> tuple[str, ...]:
    """Names of the parameters, in the order of theta."""
    law = ZOOM_LAW if zoom_law else ()
    size = FIELD_SIZE if field_size else ()
    crown = CROWN if field_size and field_size.crown else ()
    return (*COMMON, *lens.names, *law, *size, *crown)


def theta_from_camera(camera: Camera) -> Array:
    """The parameter vector of a camera with a radial lens, (12,)."""
    return Layout.of(camera.image_size).theta(camera)


def camera_from_theta(theta: Array, image_size: tuple[int, int]) -> Camera:
    """The camera of a parameter vector (12,) with a radial lens: the inverse of `theta_from_camera`."""
    return Layout.of(image_size).camera(theta)


def turned_around(theta: Array) -> Array:
    """The cameras (..., n) turned by 180 degrees about the field's centre mark, with the same image of the turned
    field.

    Examples
    --------
    >>> camera = Camera.from_angles(0.2, 1.3, 0.0, 1500.0, (5.0, 60.0, -15.0), (960, 540))
    >>> opposite = camera_from_theta(turned_around(theta_from_camera(camera)), (960, 540))
    >>> np.allclose(opposite.project([-20.0, 10.0, -1.0]), camera.project([20.0, -10.0, -1.0]))
    True
    """
    turned = np.array(theta)
    turned[..., PAN] += np.pi
    turned[..., CENTER] *= (-1.0, -1.0, 1.0)
    return turned


@dataclass(frozen=True)
class GaussianPrior:
    """Independent normal distributions over theta: ``z = (theta - mean) / sigma``.

    `mean` and `sigma` are (..., n) arrays; leading axes are one prior for each initial camera or frame.
    """

    mean: Array
    sigma: Array

    def z_scores(self, theta: Array) -> Array:
        """``(theta - mean) / sigma``; pan and roll differ by less than half a turn."""
        difference = theta - self.mean
        turns = difference[..., ANGLES][..., :: ROLL - PAN]
        turns -= 2.0 * np.pi * np.round(turns / (2.0 * np.pi))
        return np.asarray(difference / self.sigma)

    def take(self, index: IntArray | slice) -> GaussianPrior:
        """The priors of the frames `index`."""
        return GaussianPrior(self.mean[index], self.sigma[index])


@lru_cache(maxsize=64)
def _pose_and_zoom(ranges: CameraDistribution, width: int) -> tuple[Array, Array]:
    """Means and standard deviations, (7,) each."""
    log_f = np.log(focal_length_from_fov(np.radians(ranges.fov), width))[::-1]
    low, high = np.array([*np.radians([ranges.pan, ranges.tilt, ranges.roll]), log_f, ranges.x, ranges.y, ranges.z]).T
    return (low + high) / 2.0, (high - low) / (2.0 * DEVIATIONS)


def gaussian_priors(distributions: Sequence[CameraDistribution], layout: Layout) -> GaussianPrior:
    """K camera distributions as independent normals over theta; mean and sigma are (K, n).

    The field of view's range becomes one of log f, so that wide and narrow lenses weigh alike. A lens that tells the
    focal length, as a fisheye does, takes the place of that range.

    Examples
    --------
    >>> tower = CameraDistribution("tower", (-60, 60), (40, 80), (-2, 2), (20, 60), (-1, 1), (44, 46), (-9, -7))
    >>> gaussian_priors([tower], Layout.of((960, 540))).mean[0, 4:7]
    array([ 0., 45., -8.])
    """
    lens, shape = layout.lens, (len(distributions), layout.size)
    mean, sigma = np.zeros(shape), np.ones(shape)
    sigma[:, LOG_ASPECT] = LOG_ASPECT_SIGMA
    if layout.field_size is not None:
        mean[:, layout.field_size_block] = layout.field_size.given
        sigma[:, layout.field_size_block] = layout.field_size.sigma
        if layout.field_size.crown is not None:
            sigma[:, layout.crown_block] = layout.field_size.crown.height
    if layout.zoom_law is not None:
        width = layout.image_size[0]
        sigma[:, layout.zoom_law_block] = np.multiply(ZOOM_LAW_SIGMA, (width, width, 1.0, 1.0, 1.0))
    mean[:, layout.lens_block], sigma[:, layout.lens_block] = lens.mean, lens.sigma
    for t, one in enumerate(distributions):
        size, corner = one.frame or (layout.image_size, (0, 0))
        mean[t, POSE_AND_ZOOM], sigma[t, POSE_AND_ZOOM] = _pose_and_zoom(one, size[0])
        mean[t, PRINCIPAL_POINT] = np.divide(size, 2.0) - corner
        sigma[t, PRINCIPAL_POINT] = principal_point_sigma(one.principal_point, size)
        if lens.usual_focal_length is not None:
            usual, spread = lens.usual_focal_length
            mean[t, LOG_F], sigma[t, LOG_F] = usual + np.log(size[0]), spread
        if one.frame is not None:
            sigma[t, PRINCIPAL_POINT] = one.principal_point * size[0]
            # a lens displaces corners of frames as usual, those of a part less: as the square of their distance
            share = np.square(layout.image_size).sum() / np.square(size).sum()
            mean[t, layout.lens_block] *= share
            sigma[t, layout.lens_block] *= share
    return GaussianPrior(mean, sigma)
