"""The radial lens: where a pixel of the ideal pinhole image lands in the real, distorted one.

Coordinates are isotropic offsets from the principal point in pixels, ``s = f (X/Z, Y/Z)``, and the coefficients are
normalised to the corner of the image: with ``q = |s|^2 / rho^2``, rho being half the image's diagonal,

    distorted = s (1 + a1 q + a2 q^2),         a1 = k1 (rho / f)^2,    a2 = k2 (rho / f)^4.

So a1 + a2 is the relative displacement at the corner whatever the zoom, and the lens is a warp of the image alone: it
does not change when f does. k1 and k2 are OpenCV's.

A lens whose slope ``1 + 3 a1 q + 5 a2 q^2`` turns negative folds the scene back into the image: lines that lie far
outside appear in it, in every program that projects them. With ``a2 >= 9/20 a1^2`` for a barrel (a1 < 0) and
``a2 >= 0`` for a cushion it never does, however far out. What is estimated is therefore (a1, b2),
``a2 = b2 + FOLD min(a1, 0)^2`` with b2 >= 0: at a1 = -1 % the term moves the corner of an image by 0.005 %.
"""

import numpy as np

from fieldcalib._types import Array, BoolArray


def corner_coefficients(k: Array, f: Array | float, rho: float) -> Array:
    """Corner-normalised (a1, a2) of OpenCV's (k1, k2), at focal length f and half diagonal rho (both pixels)."""
    q = np.square(rho / np.asarray(f))
    return np.stack([k[..., 0] * q, k[..., 1] * q * q], axis=-1)


def opencv_coefficients(a: Array, f: Array | float, rho: float) -> Array:
    """OpenCV's (k1, k2) of corner-normalised (a1, a2): the inverse of `corner_coefficients`."""
    return corner_coefficients(a, rho * rho / np.asarray(f), rho)


FOLD = 0.46  # a little above 9/20


def lens_coefficients(b: Array) -> Array:
    """Corner-normalised (a1, a2) of the estimated (a1, b2), (..., 2): the lens that does not fold where b2 >= 0.

    Examples
    --------
    >>> lens_coefficients(np.array([-0.1, 0.0]))
    array([-0.1   ,  0.0046])
    """
    return np.stack([b[..., 0], b[..., 1] + FOLD * np.square(np.minimum(b[..., 0], 0.0))], axis=-1)


def lens_parameters(a: Array) -> Array:
    """The estimated (a1, b2) of corner-normalised (a1, a2): the inverse of `lens_coefficients`."""
    return np.stack([a[..., 0], a[..., 1] - FOLD * np.square(np.minimum(a[..., 0], 0.0))], axis=-1)


def distort(s: Array, a: Array, rho: float) -> Array:
    """Distorted offset of an ideal one.

    Parameters
    ----------
    s : (..., 2) array
        Offsets from the principal point in pixels.
    a : (..., 2) array
        Corner-normalised coefficients, broadcast against the leading axes of `s`.
    rho : float
        Half the image's diagonal in pixels.

    Returns
    -------
    (..., 2) array

    Examples
    --------
    >>> distort(np.array([300.0, 400.0]), np.array([0.03, 0.0]), rho=500.0)  # 3 % at the corner
    array([309., 412.])
    """
    q = np.sum(np.square(s), axis=-1) / rho**2
    return np.asarray(s * (1.0 + q * (a[..., 0] + q * a[..., 1]))[..., None])


def distort_jacobian(s: Array, a: Array, rho: float) -> tuple[Array, Array]:
    """Derivatives of `distort` with respect to the offset and to the coefficients.

    Returns
    -------
    dd_ds : (..., 2, 2) array
        ``gain I + 2 gain'(q) s s^T / rho^2`` with ``gain = 1 + a1 q + a2 q^2``; symmetric.
    dd_da : (..., 2, 2) array
        Columns ``q s`` and ``q^2 s``.
    """
    q = np.sum(np.square(s), axis=-1) / rho**2
    a1, a2 = a[..., 0], a[..., 1]
    gain = 1.0 + q * (a1 + q * a2)
    slope = 2.0 * (a1 + 2.0 * a2 * q) / rho**2
    dd_ds = slope[..., None, None] * s[..., :, None] * s[..., None, :]
    dd_ds[..., 0, 0] += gain
    dd_ds[..., 1, 1] += gain
    dd_da = np.stack([q[..., None] * s, np.square(q)[..., None] * s], axis=-1)
    return dd_ds, dd_da


def is_monotone(q: Array, a: Array) -> BoolArray:
    """Whether the lens still spreads outwards at relative squared radius q: ``1 + 3 a1 q + 5 a2 q^2 > 0``.

    Beyond the first radius where it does not, distinct points of the scene fold onto one pixel; the answer is then no
    for good, even where the slope turns positive again.
    """
    a1, a2 = a[..., 0], a[..., 1]
    at_q = 1.0 + q * (3.0 * a1 + 5.0 * a2 * q) > 0.0
    # a slope that turned negative on the way out may be positive again at q: look at its minimum, q = -0.3 a1 / a2
    on_the_way = (a1 < 0.0) & (a2 > 0.0) & (-0.3 * a1 < a2 * q) & (a2 <= 0.45 * np.square(a1))
    return np.asarray(at_q & ~on_the_way)


def undistort(d: Array, a: Array, rho: float) -> Array:
    """Ideal offset of a distorted one: Newton's method on the radius.

    Parameters
    ----------
    d : (..., 2) array
        Distorted offsets from the principal point in pixels.
    a : (..., 2) array
        Corner-normalised coefficients.
    rho : float
        Half the image's diagonal in pixels.

    Returns
    -------
    (..., 2) array
        NaN where no radius on the monotone part of the lens is displaced to `d`.

    Examples
    --------
    >>> undistort(np.array([309.0, 412.0]), np.array([0.03, 0.0]), rho=500.0).round(9)
    array([300., 400.])
    """
    a1, a2 = a[..., 0], a[..., 1]
    target = np.sqrt(np.sum(np.square(d), axis=-1)) / rho
    radius = np.broadcast_to(target, np.broadcast_shapes(target.shape, a1.shape)).copy()
    for _ in range(40):
        q = np.square(radius)
        value = radius * (1.0 + q * (a1 + q * a2)) - target
        slope = 1.0 + q * (3.0 * a1 + 5.0 * a2 * q)
        # where a barrel folds back, half-way in leads to the monotone part again
        newton = np.clip(value / np.where(slope > 0.0, slope, 1.0), -0.5 * radius, 0.5 * radius)
        step = np.where(slope > 0.0, newton, 0.5 * radius)
        radius -= step
        if np.max(np.abs(step), initial=0.0) < 1e-15:
            break
    q = np.square(radius)
    gain = 1.0 + q * (a1 + q * a2)
    found = (np.abs(radius * gain - target) <= 1e-9 * (1.0 + target)) & is_monotone(q, a)
    return np.asarray(d * np.where(found, 1.0 / np.where(found, gain, 1.0), np.nan)[..., None])
