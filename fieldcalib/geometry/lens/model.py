"""The interface of a lens, and the conversion to and from OpenCV's coefficients, which all lenses share.

OpenCV's distortion coefficients, ``dist_coeffs``: their names, their lengths, and how they scale with the zoom.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from reprlib import repr as short
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib._types import Array, BoolArray, IntArray, real_array

COEFFICIENTS = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4")  # OpenCV's order
POWERS = np.array([2, 4, 1, 1, 6, 2, 4, 6, 1, 3, 1, 3])  # of rho / f, by which a coefficient is corner-normalised
LENGTHS = (1, 2, 4, 5, 8, 12, 14)  # of dist_coeffs: k1; k1, k2; and the five lengths of OpenCV

FOLD = 0.46  # a little above 9/20
UNDISTORTING_STEPS = 3  # fixed-point steps before a search for closest points
TINY = 1e-100  # of a complex step, whose square is lost in rounding


def opencv_vector(dist_coeffs: ArrayLike | None, name: str = "dist_coeffs") -> Array:
    """OpenCV's distortion coefficients, of any of its lengths and shapes, as a vector of twelve; None is no distortion.

    Raises
    ------
    ValueError
        If the length is not one of `LENGTHS`, a number is not finite or the sensor is tilted (tauX, tauY).

    Examples
    --------
    >>> opencv_vector([[0.1, 0.02]])
    array([0.1 , 0.02, 0.  , 0.  , 0.  , 0.  , 0.  , 0.  , 0.  , 0.  , 0.  ,
           0.  ])
    """
    dist = np.zeros(2) if dist_coeffs is None else real_array(dist_coeffs).ravel()
    if dist.size not in LENGTHS or not np.all(np.isfinite(dist)):
        raise ValueError(
            f"{name} must be a finite array of {', '.join(map(str, LENGTHS[:-1]))} or {LENGTHS[-1]} coefficients "
            f"(k1, k2, p1, p2, k3, ...), got {short(dist.tolist())}"
        )
    if np.any(dist[12:]):
        raise ValueError(
            f"a tilted sensor (tauX, tauY) is not modelled, got {name} = {dist.tolist()}; "
            f"undistort the pixels with cv2.undistortPoints first, or refit without CALIB_TILTED_MODEL"
        )
    twelve = np.zeros(12)
    twelve[: dist.size] = dist[:12]
    return twelve


def shortest_opencv_vector(dist: Array) -> Array:
    """The shortest of OpenCV's lengths, 5, 8 or 12, that holds twelve coefficients (12, ...)."""
    return dist[: next(length for length in (5, 8, 12) if not np.any(dist[length:]))]


def nonzero_coefficients(dist_coeffs: ArrayLike | None) -> dict[str, float]:
    """The distortion coefficients that are not 0, by name.

    Raises
    ------
    ValueError
        As in `opencv_vector`.

    Examples
    --------
    >>> nonzero_coefficients([0.1, 0.0, 0.0, 0.2])
    {'k1': 0.1, 'p2': 0.2}
    """
    return {name: k for name, k in zip(COEFFICIENTS, opencv_vector(dist_coeffs).tolist(), strict=True) if k}


@dataclass(frozen=True)
class Lens(ABC):
    """A warp of the image around the principal point.

    Offsets ``s`` (ideal) and ``d`` (real, distorted) are (2, ...) pixels, coefficients ``b`` are (n, ...) and broadcast
    against their trailing axes. J is the derivative of `distort` by the offset.

    Parameters
    ----------
    rho : float
        Half the image's diagonal in pixels: the radius to which coefficients are normalised.
    """

    rho: float

    name: ClassVar[str]
    """Name of the lens model in files."""
    names: ClassVar[tuple[str, ...]]
    """Names of the coefficients."""
    opencv_names: ClassVar[tuple[str, ...]]
    """OpenCV's name of each coefficient."""
    estimable: ClassVar[int]
    """Number of coefficients, from the first on, that can be estimated; the others are given or 0."""
    least: ClassVar[Array]
    """(n,) lower bounds of the coefficients when they are estimated, -inf where there is none."""
    mean: ClassVar[Array]
    """(n,) mean of the lenses that cameras have."""
    sigma: ClassVar[Array]
    """(n,) standard deviation of the lenses that cameras have."""
    follows_zoom: ClassVar[bool] = False
    """Whether the warp depends on the focal length: the methods then take it behind the coefficients
    (`at_focal_length`)."""
    usual_focal_length: ClassVar[tuple[float, float] | None] = None
    """Mean and standard deviation of the log of the focal length in widths of the image; None for a lens that tells
    nothing of it."""

    def at_focal_length(self, b: Array, f: Array | float) -> Array:
        """What the methods take as coefficients: b (n, ...), with the focal length behind them if the warp depends on
        it."""
        return b

    def pull_zoom(self, s: Array, b: Array, n: Array) -> Array | float:
        """Derivative (...) of ``n . distort(s, b)`` by the log of the focal length, s and n held."""
        return 0.0

    @abstractmethod
    def distort(self, s: Array, b: Array) -> Array:
        """Real offsets (2, ...) of ideal ones."""

    @abstractmethod
    def push(self, s: Array, b: Array, *steps: Array) -> tuple[Array, ...]:
        """`distort`, and the images ``J step`` of small steps (2, ...) from s."""

    def follow(self, s: Array, b: Array, ds: Array, dds: Array) -> tuple[Array, Array, Array]:
        """The distorted image of a curve through s whose derivatives there are ds and dds: its point and its
        derivatives, (2, ...) each; the second one by a complex step."""
        d, T = self.push(s + TINY * 1j * ds, b, ds + TINY * 1j * dds)
        return np.real(d), np.real(T), np.imag(T) / TINY

    @abstractmethod
    def pull(self, s: Array, b: Array, n: Array) -> Array:
        """Normals n (2, ...) of the real image as derivatives by the ideal offset: ``J^T n``."""

    @abstractmethod
    def pull_coefficients(self, s: Array, b: Array, n: Array) -> Array:
        """Derivatives (n_coefficients, ...) of ``n . distort(s, b)`` by the coefficients, n held."""

    @abstractmethod
    def undistort(self, d: Array, b: Array) -> Array:
        """Ideal offsets (2, ...) of real ones; NaN where no ray on the monotone part of the lens meets d."""

    def nearly_undistort(self, d: Array, b: Array) -> Array:
        """Approximate ideal offsets of real ones, from a few fixed-point steps; finite everywhere."""
        s = d
        for _ in range(UNDISTORTING_STEPS):
            s = s + (d - self.distort(s, b))
        return s

    @abstractmethod
    def is_monotone(self, s: Array, b: Array) -> BoolArray:
        """Whether the lens is monotone from the centre to s: ``det J > 0`` on the whole straight path."""

    def is_identity(self, b: Array) -> bool:
        """Whether the coefficients give no distortion."""
        return not b.any()

    def corner(self, b: Array) -> Array:
        """Corner-normalised coefficients (n, ...), with a2 instead of b2."""
        if not self._is_radial:
            return b
        a = np.array(b, dtype=float)
        a[1] += a2_of_a1(a)
        return a

    def to_opencv(self, b: Array, f: Array | float) -> Array:
        """OpenCV's distortion coefficients (5, ...) at focal length f; (8, ...) or (12, ...) if these are needed.

        They are ``(f / rho)^power`` times the corner-normalised coefficients.
        """
        a, scale = self.corner(b), np.asarray(f) / self.rho
        dist = np.zeros((12, *np.broadcast_shapes(a.shape[1:], scale.shape)))
        for index, a_i in zip(self._index, a, strict=True):
            # by products: powers of an array and of its elements may be rounded differently
            dist[index] = np.prod([scale] * int(POWERS[index]), axis=0) * a_i
        return shortest_opencv_vector(dist)

    def opencv_jacobian(self, b: Array, f: float) -> tuple[Array, Array]:
        """Derivatives of OpenCV's twelve coefficients, of one lens, by b (12, n) and by log f (12,)."""
        by_a = (f / self.rho) ** POWERS
        by_b = np.eye(12)[:, self._index] * by_a[:, None]
        if self._is_radial:
            by_b[1, 0] = by_a[1] * da2_da1(b)
        return by_b, POWERS * opencv_vector(self.to_opencv(b, f))

    def from_opencv(self, dist_coeffs: ArrayLike | None, f: float) -> Array:
        """Coefficients (n,) of OpenCV's distortion coefficients, of any of its lengths, at focal length f.

        Raises
        ------
        ValueError
            If coefficients that this lens does not have are not 0.
        """
        dist = opencv_vector(dist_coeffs)
        if np.any(np.delete(dist, self._index)):
            raise ValueError(
                f"a {self.name} lens has no coefficients but {', '.join(self.opencv_names) or '(none)'}, got "
                f"dist_coeffs = {dist.tolist()}; undistort the pixels with cv2.undistortPoints first"
            )
        b = (dist * (self.rho / f) ** POWERS)[self._index]
        if self._is_radial:
            b[1] -= a2_of_a1(b)
        return b

    @property
    def _is_radial(self) -> bool:
        return self.names[:2] == ("a1", "b2")

    @property
    def _index(self) -> IntArray:
        """Indices of the coefficients among OpenCV's twelve."""
        return np.array([COEFFICIENTS.index(name) for name in self.opencv_names], dtype=np.intp)


class SymmetricLens(Lens):
    """A lens that is symmetric about the principal point: ``distorted = gain s``.

    So ``J = gain I + slope s s^T`` with ``slope = 2 dgain/d|s|^2``, which is symmetric.
    """

    @abstractmethod
    def gain(self, s: Array, b: Array) -> tuple[Array, Array]:
        """The gain and the slope (...) at ideal offsets (2, ...)."""

    def push(self, s: Array, b: Array, *steps: Array) -> tuple[Array, ...]:
        """``J step = gain step + slope (s . step) s``."""
        gain, slope = self.gain(s, b)
        return gain * s, *(gain * step + slope * dot(s, step) * s for step in steps)

    def pull(self, s: Array, b: Array, n: Array) -> Array:
        """``J n``, as in `push`: J is symmetric."""
        gain, slope = self.gain(s, b)
        return np.asarray(gain * n + slope * dot(s, n) * s)


def a2_of_a1(b: Array) -> Array:
    """The part of a2 that keeps a lens with b2 >= 0 monotone, (...): ``FOLD min(a1, 0)^2``."""
    return np.asarray(FOLD * np.square(np.minimum(b[0], 0.0)))


def da2_da1(b: Array) -> Array:
    """Derivative of a2 by a1, b2 held, (...)."""
    return np.asarray(2.0 * FOLD * np.minimum(b[0], 0.0))


def dot(a: Array, b: Array) -> Array:
    """Inner products (...) of plane vectors (2, ...)."""
    xx, yy = a * b
    return np.asarray(xx + yy)


def constant(*values: float) -> Array:
    """A read-only vector."""
    array = np.array(values, dtype=float)
    array.flags.writeable = False
    return array
