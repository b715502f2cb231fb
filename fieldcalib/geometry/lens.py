"""The lens: the map from the ideal pinhole image to the real, distorted one.

Coordinates are isotropic offsets from the principal point in pixels, ``s = f (X/Z, Y/Z)``, and the coefficients are
normalised to the corner of the image. With rho half its diagonal, ``u = s / rho`` and ``q = |u|^2``, the members

    Pinhole             distorted = s
    RadialLens          distorted = s (1 + a1 q + a2 q^2)
    BrownConradyLens    distorted = s (1 + a1 q + a2 q^2 + a3 q^3) / (1 + a4 q + a5 q^2 + a6 q^3)
                                  + rho (2 p1 ux uy + p2 (q + 2 ux^2) + s1 q + s2 q^2,
                                         p1 (q + 2 uy^2) + 2 p2 ux uy + s3 q + s4 q^2)

are OpenCV's lens (documentation of calib3d, "Detailed Description") of ``dist_coeffs = (k1, k2, p1, p2, k3, ...)``:
``a1 = k1 (rho / f)^2``, ``a2 = k2 (rho / f)^4`` and so on (`POWERS`). So a1 + a2 is the relative displacement at the
corner at any zoom, and a lens is a warp of the image that does not depend on f.

Where the slope ``1 + 3 a1 q + 5 a2 q^2`` is negative, the lens is not monotone: it folds the scene back, and lines far
outside the image appear in it, in every program that projects them. With ``a2 >= 9/20 a1^2`` for barrel distortion
(a1 < 0) and ``a2 >= 0`` for pincushion distortion the slope is positive at every radius. The estimated parameters are
therefore (a1, b2), ``a2 = b2 + FOLD min(a1, 0)^2`` with b2 >= 0: at a1 = -1 % the term moves the corner of an image by
0.005 %.

In this module components come first: a plane vector of every point is (2, ...), coefficients are (n, ...) and broadcast
against the trailing axes of the points. Contiguous components halve the time.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib._types import Array, BoolArray

COEFFICIENTS = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4")  # OpenCV's order
POWERS = np.array([2, 4, 1, 1, 6, 2, 4, 6, 1, 3, 1, 3])  # of rho / f, by which a coefficient is corner-normalised
LENGTHS = (1, 2, 4, 5, 8, 12, 14)  # of dist_coeffs: k1, k1 k2, and OpenCV's five
FOLD = 0.46  # a little above 9/20

# Broadcast lenses displace the corner outwards: on annotated frames a1 has its median at 2.8 %, 95 % are below 5.5 %.
RADIAL_MEAN, RADIAL_SIGMA = (0.025, 0.0), (0.02, 0.005)  # a1, b2
# Not measured on broadcast cameras; small, so that they stay near 0 unless the pixels determine them. p1 displaces the
# corner of a 16:9 image by 1.7 p1, between p1 and 3 p1 in other directions; 0.001 and 0.002 are 0.2 % of rho, 2 px at
# 1920 x 1080.
TANGENTIAL_SIGMA, HIGHER_SIGMA = 0.001, 0.002


class Lens(Protocol):
    """A warp of the image around the principal point.

    Offsets ``s`` (ideal) and ``d`` (real, distorted) are (2, ...) pixels, coefficients ``b`` are (n, ...) and broadcast
    against their trailing axes. J is the derivative of `distort` by the offset.
    """

    names: ClassVar[tuple[str, ...]]
    """Names of the coefficients."""
    estimable: ClassVar[int]
    """Number of coefficients, the first ones, that can be estimated; the others are given or 0."""
    least: ClassVar[Array]
    """(n,) lower bounds of the coefficients when they are estimated, -inf where there is none."""
    mean: ClassVar[Array]
    """(n,) mean of broadcast lenses."""
    sigma: ClassVar[Array]
    """(n,) standard deviation of broadcast lenses."""

    @property
    def rho(self) -> float:
        """Half the image's diagonal in pixels: the radius to which coefficients are normalised."""

    def distort(self, s: Array, b: Array) -> Array:
        """Real offsets (2, ...) of ideal ones."""

    def push(self, s: Array, b: Array, *steps: Array) -> tuple[Array, ...]:
        """`distort`, and the images ``J step`` of small steps (2, ...) from s."""

    def pull(self, s: Array, b: Array, n: Array) -> Array:
        """Normals n (2, ...) of the real image as derivatives by the ideal offset: ``J^T n``."""

    def pull_coefficients(self, s: Array, b: Array, n: Array) -> Array:
        """Derivatives (n_coefficients, ...) of ``n . distort(s, b)`` by the coefficients, n held."""

    def undistort(self, d: Array, b: Array) -> Array:
        """Ideal offsets (2, ...) of real ones; NaN where no ray on the monotone part of the lens meets d."""

    def is_monotone(self, s: Array, b: Array) -> BoolArray:
        """Whether the lens is monotone from the centre to s: ``det J > 0`` on the whole straight path."""

    def is_identity(self, b: Array) -> bool:
        """Whether the coefficients give no distortion."""

    def to_opencv(self, b: Array, f: Array | float) -> Array:
        """OpenCV's distortion coefficients (5, ...) at focal length f; (8, ...) or (12, ...) if these are needed."""

    def opencv_jacobian(self, b: Array, f: float) -> tuple[Array, Array]:
        """Derivatives of OpenCV's twelve coefficients, of one lens, by b (12, n) and by log f (12,)."""

    def from_opencv(self, dist_coeffs: ArrayLike | None, f: float) -> Array:
        """Coefficients (n,) of OpenCV's distortion coefficients, of any of its lengths, at focal length f.

        Raises
        ------
        ValueError
            If coefficients that this lens does not have are not 0.
        """


def lens_of(dist_coeffs: ArrayLike | None, rho: float) -> Lens:
    """The smallest lens that has all of OpenCV's distortion coefficients that are not 0.

    Raises
    ------
    ValueError
        As `opencv_vector`.

    Examples
    --------
    >>> lens_of([0.1, 0.0, 0.0, 0.0, 0.0], rho=550.0)
    RadialLens(rho=550.0)
    """
    dist = opencv_vector(dist_coeffs)
    if not dist.any():
        return Pinhole(rho)
    return BrownConradyLens(rho) if dist[2:].any() else RadialLens(rho)


def opencv_vector(dist_coeffs: ArrayLike | None, name: str = "dist_coeffs") -> Array:
    """OpenCV's distortion coefficients, of any of its lengths and shapes, as a vector of twelve; None is no distortion.

    Raises
    ------
    ValueError
        If the length is none of OpenCV's, a number is not finite or the sensor is tilted (tauX, tauY).

    Examples
    --------
    >>> opencv_vector([[0.1, 0.02]])
    array([0.1 , 0.02, 0.  , 0.  , 0.  , 0.  , 0.  , 0.  , 0.  , 0.  , 0.  ,
           0.  ])
    """
    dist = np.zeros(2) if dist_coeffs is None else np.asarray(dist_coeffs, dtype=float).ravel()
    if dist.size not in LENGTHS or not np.all(np.isfinite(dist)):
        raise ValueError(
            f"{name} must be a finite array of {', '.join(map(str, LENGTHS[:-1]))} or {LENGTHS[-1]} coefficients "
            f"(k1, k2, p1, p2, k3, ...), got {np.asarray(dist_coeffs).tolist()}"
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


def _radial_coefficients(dist_coeffs: ArrayLike | None) -> Array:
    """(k1, k2) of OpenCV's distortion coefficients.

    Raises
    ------
    ValueError
        If any other coefficient is not zero.
    """
    dist = np.zeros(2) if dist_coeffs is None else np.asarray(dist_coeffs, dtype=float).ravel()
    if np.any(dist[2:]):
        raise ValueError(
            f"only the radial coefficients k1 and k2 are modelled, got dist_coeffs = {dist.tolist()}; "
            f"undistort the pixels with cv2.undistortPoints first, or refit with k1 and k2 alone"
        )
    return opencv_vector(dist)[:2]


def _constant(*values: float) -> Array:
    """A read-only vector."""
    array = np.array(values, dtype=float)
    array.flags.writeable = False
    return array


@dataclass(frozen=True)
class Pinhole:
    """No distortion: real offsets are ideal ones. See `Lens`."""

    rho: float

    names: ClassVar[tuple[str, ...]] = ()
    estimable: ClassVar[int] = 0
    least: ClassVar[Array] = _constant()
    mean: ClassVar[Array] = _constant()
    sigma: ClassVar[Array] = _constant()

    def distort(self, s: Array, b: Array) -> Array:
        """The offsets themselves."""
        return s

    def push(self, s: Array, b: Array, *steps: Array) -> tuple[Array, ...]:
        """The offsets and steps themselves."""
        return s, *steps

    def pull(self, s: Array, b: Array, n: Array) -> Array:
        """The normals themselves."""
        return n

    def pull_coefficients(self, s: Array, b: Array, n: Array) -> Array:
        """Nothing, (0, ...)."""
        return np.empty((0, *np.broadcast_shapes(s.shape[1:], n.shape[1:])))

    def undistort(self, d: Array, b: Array) -> Array:
        """The offsets themselves."""
        return d

    def is_monotone(self, s: Array, b: Array) -> BoolArray:
        """Everywhere."""
        return np.ones(s.shape[1:], dtype=bool)

    def is_identity(self, b: Array) -> bool:
        """Always."""
        return True

    def to_opencv(self, b: Array, f: Array | float) -> Array:
        """Zeros (5, ...)."""
        return np.zeros((5, *np.shape(f)))

    def opencv_jacobian(self, b: Array, f: float) -> tuple[Array, Array]:
        """Nothing (12, 0), and zeros."""
        return np.empty((12, 0)), np.zeros(12)

    def from_opencv(self, dist_coeffs: ArrayLike | None, f: float) -> Array:
        """Nothing, if all coefficients are 0."""
        dist = opencv_vector(dist_coeffs)
        if dist.any():
            raise ValueError(f"a pinhole has no distortion, got dist_coeffs = {dist.tolist()}; use lens_of to find one")
        return np.empty(0)


@dataclass(frozen=True)
class RadialLens:
    """Two radial coefficients (a1, b2), monotone where b2 >= 0; with b2 = 0 it has one parameter. See `Lens`.

    Examples
    --------
    >>> RadialLens(500.0).distort(np.array([300.0, 400.0]), np.array([0.03, 0.0]))  # 3 % at the corner
    array([309., 412.])
    """

    rho: float

    names: ClassVar[tuple[str, ...]] = ("a1", "b2")
    estimable: ClassVar[int] = 2
    least: ClassVar[Array] = _constant(-np.inf, 0.0)
    mean: ClassVar[Array] = _constant(*RADIAL_MEAN)
    sigma: ClassVar[Array] = _constant(*RADIAL_SIGMA)

    def distort(self, s: Array, b: Array) -> Array:
        """``gain s`` with ``gain = 1 + a1 q + a2 q^2``."""
        a1, a2 = b[0], _a2(b)
        q = _dot(s, s) / self.rho**2
        return np.asarray((1.0 + q * (a1 + q * a2)) * s)

    def push(self, s: Array, b: Array, *steps: Array) -> tuple[Array, ...]:
        """``J = gain I + slope s s^T`` with ``slope = 2 gain'(q) / rho^2``; symmetric."""
        gain, slope = self._gain(s, b)
        return gain * s, *(gain * step + slope * _dot(s, step) * s for step in steps)

    def pull(self, s: Array, b: Array, n: Array) -> Array:
        """As `push`: J is symmetric."""
        gain, slope = self._gain(s, b)
        return np.asarray(gain * n + slope * _dot(s, n) * s)

    def pull_coefficients(self, s: Array, b: Array, n: Array) -> Array:
        """``n . s dgain/db``; a2 depends on a1."""
        q = _dot(s, s) / self.rho**2
        by_a1 = q * _dot(n, s)
        by_a2 = q * by_a1
        return np.array([by_a1 + _da2_da1(b) * by_a2, by_a2])

    def undistort(self, d: Array, b: Array) -> Array:
        """Newton's method on the radius."""
        a1, a2 = b[0], _a2(b)
        return np.asarray(d * _inverse_gain(np.sqrt(_dot(d, d)) / self.rho, a1, a2))

    def is_monotone(self, s: Array, b: Array) -> BoolArray:
        """``1 + 3 a1 q + 5 a2 q^2 > 0`` up to the q of s."""
        return _is_monotone(_dot(s, s) / self.rho**2, b[0], _a2(b))

    def is_identity(self, b: Array) -> bool:
        """Whether all coefficients are 0."""
        return not np.any(b)

    def to_opencv(self, b: Array, f: Array | float) -> Array:
        """(k1, k2, 0, 0, 0)."""
        q = np.square(np.asarray(f) / self.rho)
        k1, k2 = np.broadcast_arrays(b[0] * q, _a2(b) * q * q)
        return np.array([k1, k2, *np.zeros((3, *k1.shape))])

    def opencv_jacobian(self, b: Array, f: float) -> tuple[Array, Array]:
        """``k1 = a1 (f / rho)^2``, ``k2 = a2 (f / rho)^4``."""
        dist = opencv_vector(self.to_opencv(b, f))
        q = (f / self.rho) ** 2
        by_b = np.zeros((12, 2))
        by_b[:2] = (q, 0.0), (_da2_da1(b) * q * q, q * q)
        return by_b, POWERS * dist

    def from_opencv(self, dist_coeffs: ArrayLike | None, f: float) -> Array:
        """(a1, b2) of (k1, k2)."""
        k1, k2 = _radial_coefficients(dist_coeffs)
        q = (self.rho / f) ** 2
        a1, a2 = k1 * q, k2 * q * q
        return np.array([a1, a2 - FOLD * min(a1, 0.0) ** 2])

    def _gain(self, s: Array, b: Array) -> tuple[Array, Array]:
        """``1 + a1 q + a2 q^2``, and ``2 / rho^2`` times its derivative by q."""
        a1, a2 = b[0], _a2(b)
        q = _dot(s, s) / self.rho**2
        c = 2.0 / self.rho**2
        return 1.0 + q * (a1 + q * a2), c * a1 + (2.0 * c * a2) * q


def _a2(b: Array) -> Array:
    """a2 of (a1, b2, ...): the lens is monotone where b2 >= 0."""
    return np.asarray(b[1] + FOLD * np.square(np.minimum(b[0], 0.0)))


def _da2_da1(b: Array) -> Array:
    """Derivative of `_a2` by a1, b2 held."""
    return np.asarray(2.0 * FOLD * np.minimum(b[0], 0.0))


def _dot(a: Array, b: Array) -> Array:
    """Inner products of plane vectors."""
    return np.asarray(a[0] * b[0] + a[1] * b[1])


def _is_monotone(q: Array, a1: Array, a2: Array) -> BoolArray:
    """Whether a radial lens is monotone up to relative squared radius q: ``1 + 3 a1 q + 5 a2 q^2 > 0``.

    Beyond the first radius where the slope is not positive, distinct points of the scene have the same pixel; the
    result is False there, even where the slope is positive again.
    """
    at_q = 1.0 + q * (3.0 * a1 + 5.0 * a2 * q) > 0.0
    # the slope may be negative before q and positive again at q: test its minimum, at -0.3 a1 / a2
    on_the_way = (a1 < 0.0) & (a2 > 0.0) & (-0.3 * a1 < a2 * q) & (a2 <= 0.45 * np.square(a1))
    return np.asarray(at_q & ~on_the_way)


def _inverse_gain(target: Array, a1: Array, a2: Array) -> Array:
    """Ratio of the ideal to the distorted radius where the latter, in units of rho, is `target`; NaN if there is none.

    Newton's method on the radius, which stays on the monotone part of the lens.
    """
    radius = np.broadcast_to(target, np.broadcast_shapes(target.shape, a1.shape)).copy()
    for _ in range(40):
        q = np.square(radius)
        value = radius * (1.0 + q * (a1 + q * a2)) - target
        slope = 1.0 + q * (3.0 * a1 + 5.0 * a2 * q)
        # beyond the monotone part of a barrel, halving the radius returns to it
        newton = np.clip(value / np.where(slope > 0.0, slope, 1.0), -0.5 * radius, 0.5 * radius)
        step = np.where(slope > 0.0, newton, 0.5 * radius)
        radius -= step
        if np.max(np.abs(step), initial=0.0) < 1e-15:
            break
    q = np.square(radius)
    gain = 1.0 + q * (a1 + q * a2)
    found = (np.abs(radius * gain - target) <= 1e-9 * (1.0 + target)) & _is_monotone(q, a1, a2)
    return np.asarray(np.where(found, 1.0 / np.where(found, gain, 1.0), np.nan))


@dataclass(frozen=True)
class BrownConradyLens:
    """All of OpenCV's coefficients but those of a tilted sensor, in its order, corner-normalised. See `Lens`.

    The second one is b2 as in `RadialLens`, which is this lens with the others 0. The first five can be estimated: with
    b2 >= 0 and a3 >= 0 their radial part is monotone.

    Examples
    --------
    >>> lens = BrownConradyLens(500.0)
    >>> b = lens.from_opencv([0.0, 0.0, 0.01, 0.0, 0.0], f=500.0)
    >>> lens.distort(np.array([0.0, 500.0]), b)  # 3 p1
    array([  0., 515.])
    """

    rho: float

    names: ClassVar[tuple[str, ...]] = ("a1", "b2", "p1", "p2", "a3", "a4", "a5", "a6", "s1", "s2", "s3", "s4")
    estimable: ClassVar[int] = 5
    least: ClassVar[Array] = _constant(-np.inf, 0.0, -np.inf, -np.inf, 0.0, *7 * [-np.inf])
    mean: ClassVar[Array] = _constant(*RADIAL_MEAN, *10 * [0.0])
    sigma: ClassVar[Array] = _constant(
        *RADIAL_SIGMA, *2 * [TANGENTIAL_SIGMA], *4 * [HIGHER_SIGMA], *4 * [TANGENTIAL_SIGMA]
    )

    def distort(self, s: Array, b: Array) -> Array:
        """The formula of the module."""
        return self.rho * brown_conrady(s / self.rho, _corner(b))

    def push(self, s: Array, b: Array, *steps: Array) -> tuple[Array, ...]:
        """`distort`, and the steps by `brown_conrady_jacobian`."""
        u, a = s / self.rho, _corner(b)
        (xx, xy), (yx, yy) = brown_conrady_jacobian(u, a)
        images = (np.array([xx * x + xy * y, yx * x + yy * y]) for x, y in steps)
        return self.rho * brown_conrady(u, a), *images

    def pull(self, s: Array, b: Array, n: Array) -> Array:
        """The transpose of `brown_conrady_jacobian`."""
        (xx, xy), (yx, yy) = brown_conrady_jacobian(s / self.rho, _corner(b))
        return np.array([xx * n[0] + yx * n[1], xy * n[0] + yy * n[1]])

    def pull_coefficients(self, s: Array, b: Array, n: Array) -> Array:
        """The formula of the module is linear in all coefficients but those of the denominator."""
        (x, y), a = s / self.rho, _corner(b)
        nx, ny = self.rho * n
        q, xy = x * x + y * y, x * y
        numerator, denominator = _numerator(q, a), _denominator(q, a)
        by_a1 = q * (nx * x + ny * y) / denominator
        by_a2, by_a3 = q * by_a1, q * q * by_a1
        by_p1 = 2.0 * nx * xy + ny * (q + 2.0 * y * y)
        by_p2 = nx * (q + 2.0 * x * x) + 2.0 * ny * xy
        by_a4 = -by_a1 * numerator / denominator
        rational = (by_a4, q * by_a4, q * q * by_a4)
        prism = (nx * q, nx * q * q, ny * q, ny * q * q)
        by_b1 = by_a1 + _da2_da1(b) * by_a2
        return np.array(np.broadcast_arrays(by_b1, by_a2, by_p1, by_p2, by_a3, *rational, *prism))

    def undistort(self, d: Array, b: Array) -> Array:
        """Newton's method; a step beyond the monotone part is halved."""
        target, a = d / self.rho, _corner(b)
        u = np.broadcast_to(target, (2, *np.broadcast_shapes(d.shape[1:], b.shape[1:]))).copy()
        inside = np.zeros_like(u)  # the last point on the monotone part
        with np.errstate(all="ignore"):  # without a solution, the iteration may end at a pole
            for _ in range(60):
                (xx, xy), (yx, yy) = brown_conrady_jacobian(u, a)
                x, y = brown_conrady(u, a) - target
                determinant = xx * yy - xy * yx
                newton = np.array([yy * x - xy * y, xx * y - yx * x]) / determinant
                newton *= np.minimum(1.0, 0.5 * np.sqrt(_dot(u, u) / np.maximum(_dot(newton, newton), 1e-300)))
                spreads = (determinant > 0.0) & (_denominator(_dot(u, u), a) > 0.0)
                step = np.where(spreads, newton, 0.5 * (u - inside))
                inside = np.where(spreads, u, inside)
                u -= step
                if not np.any(np.abs(step) > 1e-15):
                    break
            miss = np.abs(brown_conrady(u, a) - target).max(axis=0)
            s = self.rho * u
            found = (miss <= 1e-9 * (1.0 + np.sqrt(_dot(target, target)))) & self.is_monotone(s, b)
        return np.where(found, s, np.nan)

    def is_monotone(self, s: Array, b: Array) -> BoolArray:
        """By a bound on J for the whole path, else by sampling the path at `PATH_SAMPLES` points."""
        u, a = s / self.rho, _corner(b)
        monotone = _surely_monotone(np.sqrt(_dot(u, u)), a)
        shape = monotone.shape
        unsure = ~monotone & np.isfinite(u).all(axis=0)
        u = np.broadcast_to(u, (2, *shape))[:, unsure]
        a = np.broadcast_to(a.reshape(12, *(len(shape) + 1 - a.ndim) * (1,), *a.shape[1:]), (12, *shape))[:, unsure]
        on_the_way = np.ones(u.shape[1:], dtype=bool)
        with np.errstate(all="ignore"):
            for t in np.arange(1, PATH_SAMPLES + 1) / PATH_SAMPLES:
                (xx, xy), (yx, yy) = brown_conrady_jacobian(t * u, a)
                on_the_way &= (xx * yy - xy * yx > 0.0) & (_denominator(_dot(t * u, t * u), a) > 0.0)
        monotone[unsure] = on_the_way
        return monotone

    def is_identity(self, b: Array) -> bool:
        """Whether all coefficients are 0."""
        return not np.any(b)

    def to_opencv(self, b: Array, f: Array | float) -> Array:
        """``(f / rho)^power`` times the corner-normalised coefficients."""
        a, scale = _corner(b), np.asarray(f) / self.rho
        return shortest_opencv_vector(np.array([scale**power * a_i for power, a_i in zip(POWERS, a, strict=True)]))

    def opencv_jacobian(self, b: Array, f: float) -> tuple[Array, Array]:
        """``(f / rho)^power`` on the diagonal, and the derivative of a2 by a1."""
        by_a = (f / self.rho) ** POWERS
        by_b = np.diag(by_a)
        by_b[1, 0] = by_a[1] * _da2_da1(b)
        return by_b, POWERS * by_a * _corner(b)

    def from_opencv(self, dist_coeffs: ArrayLike | None, f: float) -> Array:
        """The inverse of `to_opencv`."""
        b = opencv_vector(dist_coeffs) * (self.rho / f) ** POWERS
        b[1] -= FOLD * min(b[0], 0.0) ** 2
        return b


PATH_SAMPLES = 100  # a part that is not monotone and shorter than a hundredth of the path may be missed


def brown_conrady(u: Array, a: Array) -> Array:
    """OpenCV's distortion of image points (2, ...): the formula of the module in units of rho.

    With OpenCV's own coefficients (12, ...), in the order of `COEFFICIENTS`, it distorts normalised image points
    (Xc / Zc, Yc / Zc).
    """
    x, y = u
    p1, p2 = a[2], a[3]
    s1, s2, s3, s4 = a[8:]
    q, xy = x * x + y * y, x * y
    gain = _numerator(q, a) / _denominator(q, a)
    return np.array(
        [
            x * gain + 2.0 * p1 * xy + p2 * (q + 2.0 * x * x) + q * (s1 + q * s2),
            y * gain + p1 * (q + 2.0 * y * y) + 2.0 * p2 * xy + q * (s3 + q * s4),
        ]
    )


def brown_conrady_jacobian(u: Array, a: Array) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Derivative of `brown_conrady` by the point, its rows of entries (...).

    ``gain I + u (dgain_dq dq_du) + tangential + prism dq_du``, with ``dq_du = 2 u``.
    """
    x, y = u
    a1, a2, p1, p2, a3, a4, a5, a6, s1, s2, s3, s4 = a
    q = x * x + y * y
    denominator = _denominator(q, a)
    gain = _numerator(q, a) / denominator
    slope = (a1 + q * (2.0 * a2 + 3.0 * q * a3) - gain * (a4 + q * (2.0 * a5 + 3.0 * q * a6))) / denominator
    dx_dq, dy_dq = x * slope + s1 + 2.0 * q * s2, y * slope + s3 + 2.0 * q * s4
    tangential = 2.0 * (p1 * x + p2 * y)
    return (
        (gain + 2.0 * p1 * y + 6.0 * p2 * x + 2.0 * x * dx_dq, tangential + 2.0 * y * dx_dq),
        (tangential + 2.0 * x * dy_dq, gain + 6.0 * p1 * y + 2.0 * p2 * x + 2.0 * y * dy_dq),
    )


def _corner(b: Array) -> Array:
    """Corner-normalised coefficients (12, ...), a2 in place of b2."""
    a = np.array(b, dtype=float)
    a[1] = _a2(b)
    return a


def _numerator(q: Array, a: Array) -> Array:
    return np.asarray(1.0 + q * (a[0] + q * (a[1] + q * a[4])))


def _denominator(q: Array, a: Array) -> Array:
    return np.asarray(1.0 + q * (a[5] + q * (a[6] + q * a[7])))


def _surely_monotone(radius: Array, a: Array) -> BoolArray:
    """Whether the symmetric part of J is positive definite by its bounds, up to a radius in units of rho.

    With N and D the numerator and the denominator of the gain, the radial part of J has the eigenvalues N / D and
    ``(N D + 2 q (N' D - N D')) / D^2``, the tangential part at most 6 radius |p|, the prism 2 radius |s1| and so on.
    """
    a1, a2, p1, p2, a3, a4, a5, a6, s1, s2, s3, s4 = np.abs(a)
    q = np.square(radius)
    n, d = q * (a1 + q * (a2 + q * a3)), q * (a4 + q * (a5 + q * a6))  # |N - 1| and |D - 1| at most
    qn, qd = q * (a1 + q * (2.0 * a2 + 3.0 * q * a3)), q * (a4 + q * (2.0 * a5 + 3.0 * q * a6))  # |q N'|, |q D'|
    radial = (1.0 - n) * (1.0 - d) - 2.0 * qn * (1.0 + d) - 2.0 * (1.0 + n) * qd
    others = radius * (6.0 * (p1 + p2) + 2.0 * (s1 + s3) + 4.0 * q * (s2 + s4))
    return np.asarray(radial > others * np.square(1.0 + d))
