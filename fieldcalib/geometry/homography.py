"""Decomposition of the ground plane's homography into a camera with square pixels and a known principal point.

A homography maps field points (x, y, 1) in metres to pixels. `ALIGNMENTS` converts published ones to that convention.

Homogeneous points and lines of the projective plane; homographies and projections by the normalised DLT. A line l and
the points x on it satisfy ``l . x = 0``. A homography H maps points as ``x' = H x`` and lines as ``l' = H^-T l``
(Hartley & Zisserman, Multiple View Geometry, 2nd edition, section 2.3).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib._types import LARGEST, Array, real_array

TINY = 1e-300  # smallest divisor, where weights or lengths may all be 0
# Condition number of a homography beyond which its inverse has less than four digits; those of cameras, between metres
# and pixels, are about 1e6.
SINGULAR = 1e12
YARD = 0.9144  # metres
_YARDS = (115.0, 74.0)
_WC14_TEMPLATE = (115.0 * YARD, 74.0 * YARD)
_PIXELS = np.eye(3)


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
    T, T_image = normalizing_transform(x, weights), normalizing_transform(x_image, weights)
    a, b = homogenize(x) @ np.swapaxes(T, -1, -2), homogenize(x_image) @ np.swapaxes(T_image, -1, -2)
    return np.asarray(np.linalg.inv(T_image) @ _dlt(a, b, weights) @ T)


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
    return homography_from_points(X, x_image, weights)


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


def decompose_homography(H: Array, principal_point: Array, reference: Array) -> tuple[Array, Array, Array]:
    """Focal length, rotation and centre of the camera whose ground-plane homography is H.

    With ``[h1 h2 h3] = diag(1, 1, f) T H``, T moving the principal point to the origin, h1 and h2 must be orthogonal
    and equally long: two equations linear in 1 / f^2, solved by least squares (paper, appendix "Homography
    Decomposition", step 1; Hartley & Zisserman, algorithm 8.2). `pose_from_homography` gives the rest.

    Parameters
    ----------
    H : (..., 3, 3) array
        Maps field points (x, y, 1) to pixels; scale and sign do not matter.
    principal_point : (2,) array
        In pixels.
    reference : (..., 2) array
        A field point that the camera sees. It must be in front of the camera, which determines the sign of H.

    Returns
    -------
    f : (...) array
        NaN where no real focal length meets the constraints.
    R : (..., 3, 3) array
    C : (..., 3) array
        NaN with f.

    Examples
    --------
    >>> from fieldcalib import Camera
    >>> camera = Camera.from_angles(0.3, 1.3, 0.01, 1800.0, (2.0, 70.0, -18.0), (960, 540))
    >>> f, R, C = decompose_homography(-camera.homography, camera.principal_point, np.zeros(2))
    >>> bool(np.isclose(f, 1800.0)), C.round(6)
    (True, array([  2.,  70., -18.]))
    """
    T = np.array([[1.0, 0.0, -principal_point[0]], [0.0, 1.0, -principal_point[1]], [0.0, 0.0, 1.0]])
    M = T @ H
    x, y, z = M[..., 0, :], M[..., 1, :], M[..., 2, :]
    # |h1| = |h2| and h1 . h2 = 0: a + f^2 b = 0 for each
    a = np.stack([x[..., 0] * x[..., 1] + y[..., 0] * y[..., 1], _difference(x) + _difference(y)], axis=-1)
    b = np.stack([z[..., 0] * z[..., 1], _difference(z)], axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        f = np.sqrt(-np.sum(a * a, axis=-1) / np.sum(a * b, axis=-1))
        M[..., :2, :] /= f[..., None, None]
    R, C = pose_from_homography(M, reference)
    return np.where(np.isnan(C[..., 0]), np.nan, f), R, C


def pose_from_homography(M: Array, reference: Array) -> tuple[Array, Array]:
    """Rotation and centre of a camera with known intrinsics K, from ``M = K^-1 H``.

    ``[r1 r2 t] = M / sqrt(|m1| |m2|)``, the rotation is the one nearest to ``[r1 r2 r1 x r2]`` and ``C = -R^T t``
    (paper, appendix "Homography Decomposition", steps 2 and 3, with the sign and the scale that its formula lacks).

    Parameters
    ----------
    M : (..., 3, 3) array
        Maps field points (x, y, 1) to the plane at depth 1 before the camera; scale and sign do not matter.
    reference : (..., 2) array
        A field point that the camera sees.

    Returns
    -------
    R : (..., 3, 3) array
    C : (..., 3) array
        NaN, and R the identity, where M is not finite, has a zero column or maps the reference point to infinity.

    Examples
    --------
    >>> from fieldcalib import Camera
    >>> camera = Camera.from_angles(0.3, 1.3, 0.01, 1800.0, (2.0, 70.0, -18.0), (960, 540))
    >>> _, C = pose_from_homography(-np.linalg.inv(camera.K) @ camera.homography, np.zeros(2))
    >>> C.round(6)
    array([  2.,  70., -18.])
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        z = M[..., 2, :]
        front = np.sign(z[..., 0] * reference[..., 0] + z[..., 1] * reference[..., 1] + z[..., 2])
        lengths = np.linalg.norm(M[..., :2], axis=-2)
        M = M * (front / np.sqrt(lengths[..., 0] * lengths[..., 1]))[..., None, None]
    valid = (front != 0.0) & np.isfinite(M).all(axis=(-1, -2))
    M = np.where(valid[..., None, None], M, np.eye(3))
    r1, r2 = (M[..., i] / np.linalg.norm(M[..., i], axis=-1, keepdims=True) for i in (0, 1))
    U, _, Vh = np.linalg.svd(np.stack([r1, r2, np.cross(r1, r2)], axis=-1))
    R = U @ Vh
    C = -(np.swapaxes(R, -1, -2) @ M[..., 2:])[..., 0]
    return R, np.where(valid[..., None], C, np.nan)


def _difference(row: Array) -> Array:
    """The square of the first entry minus the square of the second."""
    return np.asarray(np.square(row[..., 0]) - np.square(row[..., 1]))


@dataclass(frozen=True, eq=False)
class Alignment:
    """Field and image coordinates of a published data set, and the conversion of its homographies, (..., 3, 3).

    Its homographies map the image to the field, ``x_field = H x_image``; those of fieldcalib map field points (x, y, 1)
    in metres, origin at the centre mark, y towards the main camera, to pixels of `image_size`.

    Examples
    --------
    >>> from fieldcalib.geometry.homography import dehomogenize
    >>> theirs = np.diag([0.1, 0.1, 1.0])  # ten pixels per yard: the whole field from above
    >>> ours = ALIGNMENTS["wc14"].to_fieldcalib(theirs)
    >>> dehomogenize(ours @ [0.0, 0.0, 1.0]).round(9)  # the centre mark
    array([575., 370.])
    """

    field: Array
    """Field coordinates of the data set -> those of fieldcalib, (3, 3)."""
    image: Array
    """Image coordinates of the data set -> pixels of `image_size`, (3, 3)."""
    template: tuple[float, float]
    """Length and width of the field of the data set in metres."""
    image_size: tuple[int, int] = (1280, 720)

    def to_fieldcalib(self, H: ArrayLike) -> Array:
        """Homographies of the data set in the convention of fieldcalib: ``(field H image^-1)^-1``."""
        return np.asarray(self.image @ _inverse(H) @ np.linalg.inv(self.field))

    def from_fieldcalib(self, H: ArrayLike) -> Array:
        """The inverse of `to_fieldcalib`, up to scale."""
        return np.asarray(np.linalg.inv(self.field) @ _inverse(H) @ self.image)


def _inverse(H: ArrayLike) -> Array:
    """Inverses of homographies (..., 3, 3), or a ValueError."""
    array = finite_homography(H, batch=True)
    if not np.all(np.linalg.det(array)):
        raise ValueError("expected homographies, got a singular matrix: it maps the plane to a line or a point")
    return np.asarray(np.linalg.inv(array))


def _centred(length: float, width: float, x: float, y: float) -> Array:
    """Origin from a corner to the centre of a field of length x width, axes scaled by x and y."""
    return np.array([[x, 0.0, -x * length / 2.0], [0.0, y, -y * width / 2.0], [0.0, 0.0, 1.0]])


# Paper, appendix "Note on the World Reference Axis System".
ALIGNMENTS: Mapping[str, Alignment] = MappingProxyType(
    {
        # Homayounfar et al. 2017: yards from the far left corner, x right, y towards the camera.
        "wc14": Alignment(_centred(*_YARDS, YARD, YARD), _PIXELS, _WC14_TEMPLATE),
        # Chen & Little 2019: metres from the near left corner, y away from the camera. (The paper's equation names the
        # matrix of WC14 on its right side; Chen's is meant. Their own code has a field of 115 x 74 yards, so that the
        # paper's 105 x 68 m puts its centre 8 cm and 17 cm off.)
        "chen": Alignment(_centred(105.0, 68.0, 1.0, -1.0), _PIXELS, (105.0, 68.0)),
        # Jiang et al. 2020: field and image from -0.5 to 0.5, y as in WC14. (The paper's text swaps the two factors:
        # the left one is the template in yards, the right one takes the pixels to -0.5..0.5.)
        "jiang": Alignment(
            np.diag([*_WC14_TEMPLATE, 1.0]),
            np.array([[1280.0, 0.0, 640.0], [0.0, 720.0, 360.0], [0.0, 0.0, 1.0]]),
            _WC14_TEMPLATE,
        ),
    }
)
