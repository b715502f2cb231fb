"""OpenCV's lens: radial, tangential, rational and thin prism coefficients."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from fieldcalib._types import Array, BoolArray
from fieldcalib.geometry.lens.model import COEFFICIENTS, Lens, constant, da2_da1, dot
from fieldcalib.geometry.lens.radial import RADIAL_MEAN, RADIAL_SIGMA

# Not measured on broadcast cameras; small, so that they stay near 0 unless the pixels determine them. p1 displaces the
# corner of a 16:9 image by 1.7 p1, between p1 and 3 p1 in other directions; 0.001 and 0.002 are 0.2 % of rho, 2 px at
# 1920 x 1080.
TANGENTIAL_SIGMA, HIGHER_SIGMA = 0.001, 0.002
PATH_SAMPLES = 100  # folds that are shorter than a hundredth of the path may be missed
POINTS_AT_ONCE = 200  # whose paths are sampled together: 0.16 MB for each coordinate


class BrownConradyLens(Lens):
    """All of OpenCV's coefficients but those of a tilted sensor, in its order, corner-normalised.

    The second one is b2, as in `RadialLens`, to which this lens reduces if the others are 0. The first five can be
    estimated: with b2 >= 0 and a3 >= 0 their radial part is monotone. For the methods see `Lens`.

    Examples
    --------
    >>> lens = BrownConradyLens(500.0)
    >>> b = lens.from_opencv([0.0, 0.0, 0.01, 0.0, 0.0], f=500.0)
    >>> lens.distort(np.array([0.0, 500.0]), b)  # 3 p1
    array([  0., 515.])
    """

    name: ClassVar[str] = "brown conrady"
    names: ClassVar[tuple[str, ...]] = ("a1", "b2", "p1", "p2", "a3", "a4", "a5", "a6", "s1", "s2", "s3", "s4")
    opencv_names: ClassVar[tuple[str, ...]] = COEFFICIENTS
    estimable: ClassVar[int] = 5
    least: ClassVar[Array] = constant(-np.inf, 0.0, -np.inf, -np.inf, 0.0, *7 * [-np.inf])
    mean: ClassVar[Array] = constant(*RADIAL_MEAN, *10 * [0.0])
    sigma: ClassVar[Array] = constant(
        *RADIAL_SIGMA, *2 * [TANGENTIAL_SIGMA], *4 * [HIGHER_SIGMA], *4 * [TANGENTIAL_SIGMA]
    )

    def distort(self, s: Array, b: Array) -> Array:
        """The formula of the module."""
        return self.rho * brown_conrady(s / self.rho, self.corner(b))

    def push(self, s: Array, b: Array, *steps: Array) -> tuple[Array, ...]:
        """`distort`, and the steps by `brown_conrady_jacobian`."""
        u, a = s / self.rho, self.corner(b)
        (xx, xy), (yx, yy) = brown_conrady_jacobian(u, a)
        images = (np.array([xx * x + xy * y, yx * x + yy * y]) for x, y in steps)
        return self.rho * brown_conrady(u, a), *images

    def pull(self, s: Array, b: Array, n: Array) -> Array:
        """The transpose of `brown_conrady_jacobian`."""
        (xx, xy), (yx, yy) = brown_conrady_jacobian(s / self.rho, self.corner(b))
        return np.array([xx * n[0] + yx * n[1], xy * n[0] + yy * n[1]])

    def pull_coefficients(self, s: Array, b: Array, n: Array) -> Array:
        """Derivatives by the coefficients: the formula is linear in all but those of the denominator."""
        (x, y), a = s / self.rho, self.corner(b)
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
        by_a1_and_a2 = by_a1 + da2_da1(b) * by_a2
        return np.array(np.broadcast_arrays(by_a1_and_a2, by_a2, by_p1, by_p2, by_a3, *rational, *prism))

    def undistort(self, d: Array, b: Array) -> Array:
        """Newton's method; steps that leave the monotone part are halved."""
        target, a = d / self.rho, self.corner(b)
        u = np.broadcast_to(target, (2, *np.broadcast_shapes(d.shape[1:], b.shape[1:]))).copy()
        inside = np.zeros_like(u)  # the last point on the monotone part
        with np.errstate(all="ignore"):  # without a solution, the iteration may end at a pole
            for _ in range(60):
                newton, determinant = newton_step(u, a, target)
                newton *= np.minimum(1.0, 0.5 * np.sqrt(dot(u, u) / np.maximum(dot(newton, newton), 1e-300)))
                q = dot(u, u)  # far beyond the fold the determinant is positive again, and the gain is negative
                spreads = (determinant > 0.0) & (_numerator(q, a) > 0.0) & (_denominator(q, a) > 0.0)
                step = np.where(spreads, newton, 0.5 * (u - inside))
                inside = np.where(spreads, u, inside)
                u -= step
                if not np.any(np.abs(step) > 1e-15):
                    break
            miss = np.abs(brown_conrady(u, a) - target).max(axis=0)
            s = self.rho * u
            found = (miss <= 1e-9 * (1.0 + np.sqrt(dot(target, target)))) & self.is_monotone(s, b)
        return np.where(found, s, np.nan)

    def is_monotone(self, s: Array, b: Array) -> BoolArray:
        """Test a bound on J for the whole path; where it fails, sample the path at `PATH_SAMPLES` points."""
        u, a = s / self.rho, self.corner(b)
        monotone = _surely_monotone(np.sqrt(dot(u, u)), a)
        shape = monotone.shape
        unsure = ~monotone & np.isfinite(u).all(axis=0)
        u = np.broadcast_to(u, (2, *shape))[:, unsure]
        a = np.broadcast_to(a.reshape(12, *(len(shape) + 1 - a.ndim) * (1,), *a.shape[1:]), (12, *shape))[:, unsure]
        monotone[unsure] = _monotone_on_the_way(u, a)
        return monotone


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
    """Derivative of `brown_conrady` by the point: rows of entries (...).

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


def newton_step(u: Array, a: Array, target: Array) -> tuple[Array, Array]:
    """Newton's step ``J^-1 (distorted - target)`` (2, ...) of the inverse of `brown_conrady`, and det J (...)."""
    (xx, xy), (yx, yy) = brown_conrady_jacobian(u, a)
    x, y = brown_conrady(u, a) - target
    determinant = xx * yy - xy * yx
    return np.array([yy * x - xy * y, xx * y - yx * x]) / determinant, determinant


def undistorted(target: Array, a: Array) -> Array:
    """Image points (2, ...) that `brown_conrady` distorts to `target`: Newton's method, starting at the target.

    Unlike `BrownConradyLens.undistort`, it does not look for where the lens is monotone.

    Returns
    -------
    (2, ...) array
        NaN where none is found, or only one on the opposite side of the image's centre; one of several if the lens is
        not monotone.

    Examples
    --------
    >>> undistorted(np.array([0.303, 0.404]), np.array([0.04, *np.zeros(11)])).round(12)  # q = 0.25: 1 % outwards
    array([0.3, 0.4])
    """
    u = target.copy()
    with np.errstate(all="ignore"):  # iterations that do not converge may overflow
        for _ in range(40):
            step, _ = newton_step(u, a, target)
            u -= step
            if not np.any(np.abs(step) > 1e-15):
                break
        error = np.max(np.abs(brown_conrady(u, a) - target), axis=0)
        found = (error <= 1e-9 * (1.0 + np.max(np.abs(target), axis=0))) & (dot(u, target) >= 0.0)
    return np.where(found, u, np.nan)


def _numerator(q: Array, a: Array) -> Array:
    return np.asarray(1.0 + q * (a[0] + q * (a[1] + q * a[4])))


def _denominator(q: Array, a: Array) -> Array:
    return np.asarray(1.0 + q * (a[5] + q * (a[6] + q * a[7])))


def _surely_monotone(radius: Array, a: Array) -> BoolArray:
    """Whether bounds prove the symmetric part of J positive definite up to a radius in units of rho.

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


def _monotone_on_the_way(u: Array, a: Array) -> BoolArray:
    """Whether det J and D are positive at `PATH_SAMPLES` points between the middle and each of u (2, N), a (12, N)."""
    t = np.arange(1, PATH_SAMPLES + 1)[:, None] / PATH_SAMPLES
    monotone = np.ones(u.shape[1], dtype=bool)
    with np.errstate(all="ignore"):
        for start in range(0, len(monotone), POINTS_AT_ONCE):
            part = slice(start, start + POINTS_AT_ONCE)
            on_the_way, b = t * u[:, None, part], a[:, None, part]
            (xx, xy), (yx, yy) = brown_conrady_jacobian(on_the_way, b)
            regular = (xx * yy - xy * yx > 0.0) & (_denominator(dot(on_the_way, on_the_way), b) > 0.0)
            monotone[part] = np.all(regular, axis=0)
    return monotone
