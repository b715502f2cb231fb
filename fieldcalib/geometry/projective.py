"""Homogeneous points and lines of the projective plane; homographies and projections by the normalised DLT.

A line l and the points x on it satisfy ``l . x = 0``. A homography H maps points as ``x' = H x`` and lines as
``l' = H^-T l`` (Hartley & Zisserman, Multiple View Geometry, 2nd edition, section 2.3).
"""

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib._types import LARGEST, Array, real_array

TINY = 1e-300  # smallest divisor, where weights or lengths may all be 0
# Condition number of a homography beyond which its inverse has less than four digits; those of cameras, between metres
# and pixels, are about 1e6.
SINGULAR = 1e12


def finite_homography(H: ArrayLike, *, batch: bool = False, name: str = "") -> Array:
    """A homography as a float array (3, 3), with `batch` any number of them, (..., 3, 3).

    Errors begin with the `name` of the argument, if it is given.

    Raises
    ------
    ValueError
        If it has another shape, or a number that is not finite.

    Examples
    --------
    >>> finite_homography([[1, 0, 5], [0, 1, 0], [0, 0, 1]])[0]
    array([1., 0., 5.])
    """
    whose = f"{name}: " if name else ""
    try:
        array = real_array(H)
    except ValueError as error:
        raise ValueError(f"{whose}expected a homography, three rows of three numbers: {error}") from None
    if array.shape[-2:] != (3, 3) or not (batch or array.ndim == 2):
        shape = "(..., 3, 3)" if batch else "(3, 3)"
        raise ValueError(f"{whose}expected a homography, three rows of three numbers: shape {shape}, got {array.shape}")
    if not np.all(np.isfinite(array)):
        raise ValueError(f"{whose}a number of the homography is not finite")
    scale = np.max(np.abs(array), axis=(-2, -1), keepdims=True)
    return np.where(scale > LARGEST, array / np.maximum(scale, 1.0), array)  # the scale of a homography is free


def homogenize(x: Array) -> Array:
    """Append a 1 to every point: (..., N) -> (..., N + 1)."""
    return np.concatenate([x, np.ones((*x.shape[:-1], 1))], axis=-1)


def dehomogenize(x: Array) -> Array:
    """Divide by the last coordinate and drop it: (..., N + 1) -> (..., N)."""
    return np.asarray(x[..., :-1] / x[..., -1:])


def fit_lines(xy: Array, weights: Array) -> Array:
    """Total least squares line through weighted points.

    Parameters
    ----------
    xy : (..., N, 2) array
        Points.
    weights : (..., N) array
        Non-negative; 0 leaves a point out.

    Returns
    -------
    (..., 3) array
        Lines (nx, ny, -n . mean) with unit normal n: the direction of least spread. Without two different points the
        normal is arbitrary.

    Examples
    --------
    >>> line = fit_lines(np.array([[0.0, 1.0], [2.0, 1.0], [4.0, 1.0]]), np.ones(3))
    >>> (line * np.sign(line[1])).round(9) + 0.0
    array([ 0.,  1., -1.])
    """
    total = np.maximum(np.sum(weights, axis=-1), TINY)[..., None]
    mean = np.sum(weights[..., None] * xy, axis=-2) / total
    offset = np.sqrt(weights)[..., None] * (xy - mean[..., None, :])
    spread = np.swapaxes(offset, -1, -2) @ offset
    angle = 0.5 * np.arctan2(2.0 * spread[..., 0, 1], spread[..., 0, 0] - spread[..., 1, 1])  # of the long axis
    normal = np.stack([-np.sin(angle), np.cos(angle)], axis=-1)
    return np.concatenate([normal, -np.sum(normal * mean, axis=-1, keepdims=True)], axis=-1)


def normalizing_transform(x: Array, weights: Array) -> Array:
    """Similarity that moves the centroid of points to the origin and their mean distance from it to sqrt(D).

    The DLT works on coordinates of about unit size (Hartley & Zisserman, section 4.4.4); in pixels and metres the
    weights of its equations would differ by a factor of a million.

    Parameters
    ----------
    x : (..., N, D) array
        Points of the plane (D = 2) or of space (D = 3).
    weights : (..., N) array
        Non-negative; 0 leaves a point out.

    Returns
    -------
    (..., D + 1, D + 1) array
        T for homogeneous points, ``T x``; lines of the plane are carried by ``T^-T l``. Points that coincide are moved
        and not scaled.

    Examples
    --------
    >>> normalizing_transform(np.array([[10.0, 10], [14, 10], [14, 14], [10, 14]]), np.ones(4))
    array([[ 0.5,  0. , -6. ],
           [ 0. ,  0.5, -6. ],
           [ 0. ,  0. ,  1. ]])
    """
    D = x.shape[-1]
    share = weights / np.maximum(np.sum(weights, axis=-1, keepdims=True), TINY)
    mean = np.sum(share[..., None] * x, axis=-2)
    distance = np.sum(share * np.linalg.norm(x - mean[..., None, :], axis=-1), axis=-1)
    scale = np.where(distance > 0.0, np.sqrt(D) / np.where(distance > 0.0, distance, 1.0), 1.0)
    T = np.zeros((*scale.shape, D + 1, D + 1))
    T[..., :D, :D] = scale[..., None, None] * np.eye(D)
    T[..., :D, D] = -scale[..., None] * mean
    T[..., D, D] = 1.0
    return T


def homography_from_points(x: Array, x_image: Array, weights: Array) -> Array:
    """Homography H with ``x' = H x`` from corresponding points, by the normalised DLT.

    Each pair gives ``x' x (H x) = 0``: three equations, two of them independent.

    Parameters
    ----------
    x : (..., N, 2) array
        Points of the first plane, in any unit: both planes are normalised inside.
    x_image : (..., N, 2) array
        The same points in the second plane.
    weights : (..., N) array
        Weight of each pair in the least squares problem; 0 leaves a pair out.

    Returns
    -------
    (..., 3, 3) array
        H up to scale and sign. Four points of which no three lie on a line determine it; with fewer, or with
        degenerate ones, it is one of many.

    References
    ----------
    Hartley & Zisserman, Multiple View Geometry, 2nd edition, algorithm 4.2.

    Examples
    --------
    >>> corners = np.array([[-52.5, -34.0], [52.5, -34.0], [52.5, 34.0], [-52.5, 34.0]])
    >>> pixels = np.array([[250.0, 120.0], [700.0, 110.0], [1100.0, 480.0], [-200.0, 500.0]])
    >>> H = homography_from_points(corners, pixels, np.ones(4))
    >>> dehomogenize(homogenize(corners) @ H.T).round(6)[1]
    array([700., 110.])
    """
    return _dlt_of_points(x, x_image, weights)


def projection_from_points(X: Array, x_image: Array, weights: Array) -> Array:
    """Camera matrix P with ``x' = P X`` from points in space and their images, by the normalised DLT.

    Parameters
    ----------
    X : (..., N, 3) array
        Points in space, in any unit.
    x_image : (..., N, 2) array
        Their images.
    weights : (..., N) array
        Weight of each pair in the least squares problem; 0 leaves a pair out.

    Returns
    -------
    (..., 3, 4) array
        P up to scale and sign. Six points in general position determine it; points on one plane never do.

    References
    ----------
    Hartley & Zisserman, Multiple View Geometry, 2nd edition, algorithm 7.1 without its last, iterative step.

    Examples
    --------
    >>> P = np.array([[1000.0, 0, 480, 100], [0, 1000, 270, -50], [0, 0, 1, 8]])
    >>> X = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [1, 0, 1], [0, 1, 1]])
    >>> found = projection_from_points(X, dehomogenize(homogenize(X) @ P.T), np.ones(7))
    >>> bool(np.allclose(found / found[2, 3] * 8, P))
    True
    """
    return _dlt_of_points(X, x_image, weights)


def homography_from_lines(
    lines: Array, lines_image: Array, weights: Array, T: Array | None = None, T_image: Array | None = None
) -> Array:
    """Homography H with ``x' = H x`` from corresponding lines, by the normalised DLT.

    Each pair gives ``l x (H^T l') = 0``: three equations, two of them independent (Hartley & Zisserman, sections 4.1
    and 4.4).

    Parameters
    ----------
    lines : (..., N, 3) array
        Lines of the first plane; the line at infinity (0, 0, 1) may be one of them.
    lines_image : (..., N, 3) array
        The same lines in the second plane.
    weights : (..., N) array
        Weight of each pair in the least squares problem; 0 leaves a pair out.
    T, T_image : (..., 3, 3) array, optional
        Similarities that bring the two planes to about unit size around the origin, e.g. `normalizing_transform` of
        points on the lines. None if the plane has that size already.

    Returns
    -------
    (..., 3, 3) array
        H up to scale and sign, between the planes as they were given. Four lines of which no three meet in a point
        determine it; with fewer, or with degenerate ones, it is one of many.

    Examples
    --------
    >>> H = np.array([[2.0, 0.1, 3.0], [0.0, 1.5, 1.0], [0.1, 0.0, 1.0]])
    >>> lines = np.array([[1.0, 0, -1], [1, 0, 1], [0, 1, -1], [0, 1, 1]])
    >>> found = homography_from_lines(lines, lines @ np.linalg.inv(H), np.ones(4))
    >>> bool(np.allclose(found / found[2, 2], H))
    True
    """
    T = np.eye(3) if T is None else T
    T_image = np.eye(3) if T_image is None else T_image
    line, image = lines @ np.linalg.inv(T), lines_image @ np.linalg.inv(T_image)  # T^-T l, in rows
    line = line / np.linalg.norm(line, axis=-1, keepdims=True)
    image = image / np.linalg.norm(image, axis=-1, keepdims=True)
    return np.asarray(np.linalg.inv(T_image) @ np.swapaxes(_dlt(image, line, weights), -1, -2) @ T)


def _dlt_of_points(x: Array, x_image: Array, weights: Array) -> Array:
    """M (..., 3, D + 1) with ``x_image = M x``, by the normalised DLT; points x have D dimensions."""
    T, T_image = normalizing_transform(x, weights), normalizing_transform(x_image, weights)
    a, b = homogenize(x) @ np.swapaxes(T, -1, -2), homogenize(x_image) @ np.swapaxes(T_image, -1, -2)
    return np.asarray(np.linalg.inv(T_image) @ _dlt(a, b, weights) @ T)


def _dlt(a: Array, b: Array, weights: Array) -> Array:
    """The M (..., 3, D) of unit norm with ``b x (M a) = 0`` by least squares, for a (..., N, D) and b (..., N, 3)."""
    zero = np.zeros_like(b[..., 0])
    cross = np.stack(
        [
            np.stack([zero, -b[..., 2], b[..., 1]], axis=-1),
            np.stack([b[..., 2], zero, -b[..., 0]], axis=-1),
            np.stack([-b[..., 1], b[..., 0], zero], axis=-1),
        ],
        axis=-2,
    )
    # [b]x M a = sum over the rows m_i of M of column i of [b]x times m_i . a
    rows = cross[..., None] * a[..., None, None, :] * weights[..., None, None, None]
    A = rows.reshape(*rows.shape[:-4], -1, 3 * a.shape[-1])
    # the eigenvector of A^T A is cheaper than the SVD of A in a batch, and accurate enough for an initial value
    _, vectors = np.linalg.eigh(np.swapaxes(A, -1, -2) @ A)
    return np.asarray(vectors[..., 0].reshape(*vectors.shape[:-2], 3, a.shape[-1]))
