"""OpenCV's fisheye lens (cv2.fisheye), the model of Kannala and Brandt: the angle of a ray, not its tangent, is bent.

A ray at the angle theta from the optical axis, ``tan(theta) = |s| / f``, is imaged at the distance

    f theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8)

from the principal point. With all k at 0 the image is equidistant. A point has an image if it lies in front of the
camera, theta < 90 degrees, as with every lens here and in ``cv2.fisheye.projectPoints``: a field of view reaches to 180
degrees, and pixels farther out have no ray.

Reference: Kannala, Brandt: A Generic Camera Model and Calibration Method, PAMI 2006.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib._types import Array, BoolArray, real_array
from fieldcalib.geometry.lens.model import SymmetricLens, constant, dot

LARGEST_ANGLE = 0.5 * np.pi
NEARLY = 1.5  # radians: pixels of wider rays are approximated by this one
ANGLES = np.linspace(0.0, LARGEST_ANGLE, 181)  # at which the slope is tested: folds of less than 0.5 degrees are missed
SMALL = 1e-4  # squared tangents below which the slope is that of the series
ITERATIONS = 60
LEAST = 1e-150  # added to lengths, whose square is not 0
# Of the angle in the projections that lenses have: stereographic 1/12 and 1/120, equidistant 0 and 0, equal in area
# -1/24 and 1/1920, orthographic -1/6 and 1/120 for k1 and k2.
SIGMA = (0.1, 0.05, 0.02, 0.005)


class FisheyeLens(SymmetricLens):
    """The lens of ``cv2.fisheye`` with its four coefficients, which hold at every focal length.

    For the methods see `fieldcalib.geometry.lens.model.Lens`; their coefficients are (5, ...), the last one being the
    focal length (`at_focal_length`).

    Examples
    --------
    >>> lens = FisheyeLens(500.0)
    >>> b = lens.at_focal_length(np.zeros(4), f=300.0)
    >>> lens.distort(np.array([0.0, 300.0]), b).round(2)  # 45 degrees: 300 pi / 4
    array([  0.  , 235.62])
    >>> lens.undistort(np.array([0.0, 235.62]), b).round(1)
    array([  0., 300.])
    """

    name: ClassVar[str] = "fisheye"
    names: ClassVar[tuple[str, ...]] = ("k1", "k2", "k3", "k4")
    opencv_names: ClassVar[tuple[str, ...]] = names
    estimable: ClassVar[int] = 4
    least: ClassVar[Array] = constant(*4 * [-np.inf])
    mean: ClassVar[Array] = constant(*4 * [0.0])
    sigma: ClassVar[Array] = constant(*SIGMA)
    follows_zoom: ClassVar[bool] = True
    # the half of an equidistant image that is w wide shows f theta = w / 2: here 65 to 180 degrees
    usual_focal_length: ClassVar[tuple[float, float] | None] = (float(np.log(0.53)), 0.26)

    def at_focal_length(self, b: Array, f: Array | float) -> Array:
        """The coefficients and, behind them, the focal length, (5, ...)."""
        return np.concatenate([b, np.broadcast_to(f, b.shape[1:])[None]])

    def is_identity(self, b: Array) -> bool:
        """False: without coefficients the image is equidistant."""
        return False

    def distort(self, s: Array, b: Array) -> Array:
        """The formula of the module."""
        r = _tangent(s, b)
        return np.asarray(_bent(np.arctan(r), b) / r * s)

    def gain(self, s: Array, b: Array) -> tuple[Array, Array]:
        """``theta_d / r``, where r is the tangent of the angle, and ``2 / f^2`` times its derivative by r^2.

        Near the axis that is the difference of nearly equal numbers, and the series by r^2 takes its place.
        """
        r, (k1, k2, k3, _, f) = _tangent(s, b), b
        theta, q = np.arctan(r), r * r
        gain = _bent(theta, b) / r
        c1, c2, c3 = k1 - 1.0 / 3.0, 0.2 - k1 + k2, -1.0 / 7.0 + 14.0 / 15.0 * k1 - 5.0 / 3.0 * k2 + k3
        series = c1 + q * (2.0 * c2 + 3.0 * q * c3)
        exact = 0.5 * (_slope(theta, b) / (1.0 + q) - gain) / q
        return gain, np.where(np.abs(q) < SMALL, series, exact) * (2.0 / np.square(f))

    def pull_zoom(self, s: Array, b: Array, n: Array) -> Array:
        """``n . (distorted - J s)``: with the direction of the ray held, the image scales with f."""
        _, slope = self.gain(s, b)
        return np.asarray(-slope * dot(s, s) * dot(s, n))

    def pull_coefficients(self, s: Array, b: Array, n: Array) -> Array:
        """``n . s theta^3 / r``, and so on with theta^5, theta^7 and theta^9."""
        r = _tangent(s, b)
        theta = np.arctan(r)
        square, first = theta * theta, dot(n, s) / r * theta
        return np.array([first * square ** (i + 1) for i in range(4)])

    def undistort(self, d: Array, b: Array) -> Array:
        """Solve for the angle; NaN from 90 degrees on."""
        theta, found = _angle(np.sqrt(dot(d, d)) / b[4], b, _last_angle(b))
        return np.where(found & (theta < LARGEST_ANGLE), self._towards(d, b, theta), np.nan)

    def nearly_undistort(self, d: Array, b: Array) -> Array:
        """As `undistort`, with the widest ray of the lens, 86 degrees at most, for pixels beyond it."""
        theta, _ = _angle(np.sqrt(dot(d, d)) / b[4], b, np.minimum(_last_angle(b), NEARLY))
        return self._towards(d, b, theta)

    def is_monotone(self, s: Array, b: Array) -> BoolArray:
        """Whether the distance grows with the angle up to that of s."""
        return np.asarray(np.arctan(_tangent(s, b)) <= _last_angle(b))

    def to_opencv(self, b: Array, f: Array | float) -> Array:
        """The coefficients of cv2.fisheye (4, ...)."""
        return np.broadcast_to(b, (4, *np.broadcast_shapes(b.shape[1:], np.shape(f)))).copy()

    def opencv_jacobian(self, b: Array, f: float) -> tuple[Array, Array]:
        """Derivatives of the coefficients, in the places of their names among OpenCV's twelve; none by log f."""
        return np.eye(12)[:, self._index], np.zeros(12)

    def from_opencv(self, dist_coeffs: ArrayLike | None, f: float) -> Array:
        """The coefficients of cv2.fisheye (4,), checked."""
        return fisheye_vector(dist_coeffs)

    @staticmethod
    def _towards(d: Array, b: Array, theta: Array) -> Array:
        """Ideal offsets in the directions of real ones, at given angles."""
        return np.asarray(d * (b[4] * np.tan(theta) / (np.sqrt(dot(d, d)) + LEAST)))


def fisheye_vector(dist_coeffs: ArrayLike | None, name: str = "dist_coeffs") -> Array:
    """The four coefficients of cv2.fisheye, of any shape; None is an equidistant lens.

    Raises
    ------
    ValueError
        If they are not four finite numbers.

    Examples
    --------
    >>> fisheye_vector([[0.1], [0.02], [0.0], [0.0]])
    array([0.1 , 0.02, 0.  , 0.  ])
    """
    dist = np.zeros(4) if dist_coeffs is None else real_array(dist_coeffs).ravel()
    if dist.size != 4 or not np.all(np.isfinite(dist)):
        raise ValueError(
            f"{name} of a fisheye lens must be the four finite coefficients k1, k2, k3, k4 of cv2.fisheye, got "
            f"{dist.tolist()!s:.100}"
        )
    return dist.copy()


def _tangent(s: Array, b: Array) -> Array:
    """Tangents of the angles of ideal offsets, never 0; complex offsets are continued analytically."""
    return np.asarray(np.sqrt(dot(s, s) / np.square(b[4]) + LEAST**2))


def _bent(theta: Array, b: Array) -> Array:
    """``theta_d``: the distances from the principal point in focal lengths."""
    k1, k2, k3, k4 = b[:4]
    q = theta * theta
    return np.asarray(theta * (1.0 + q * (k1 + q * (k2 + q * (k3 + q * k4)))))


def _slope(theta: Array, b: Array) -> Array:
    """The derivative of `_bent` by the angle."""
    k1, k2, k3, k4 = b[:4]
    q = theta * theta
    return np.asarray(1.0 + q * (3.0 * k1 + q * (5.0 * k2 + q * (7.0 * k3 + q * 9.0 * k4))))


def _last_angle(b: Array) -> Array:
    """The angles (...) up to which the distances of lenses (5, ...) grow, 90 degrees at most."""
    angles = ANGLES.reshape(-1, *(b.ndim - 1) * (1,))
    falls = _slope(angles, b[:, None]) <= 0.0
    first = np.where(np.any(falls, axis=0), np.argmax(falls, axis=0), len(ANGLES))
    return np.where(first < len(ANGLES), ANGLES[np.maximum(first, 1) - 1], LARGEST_ANGLE)


def _angle(target: Array, b: Array, last: Array) -> tuple[Array, BoolArray]:
    """Angles up to `last` at which `_bent` is `target`, and where there is one: Newton's method within an interval."""
    low = np.zeros(np.broadcast_shapes(target.shape, b.shape[1:]))
    high = np.broadcast_to(last, low.shape).copy()
    theta = np.minimum(target, high)
    for _ in range(ITERATIONS):
        miss = _bent(theta, b) - target
        low, high = np.where(miss < 0.0, theta, low), np.where(miss < 0.0, high, theta)
        newton = theta - miss / np.maximum(_slope(theta, b), LEAST)
        new = np.where((newton >= low) & (newton <= high), newton, 0.5 * (low + high))
        moved, theta = np.abs(new - theta), new
        if np.max(moved, initial=0.0) < 1e-15:
            break
    return theta, np.abs(_bent(theta, b) - target) <= 1e-9 * (1.0 + target)
