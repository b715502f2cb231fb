"""Homogeneous points and lines of the projective plane, and homographies from lines by the DLT.

A line l and the points x on it satisfy ``l . x = 0``. A homography H maps points as ``x' = H x`` and lines as
``l' = H^-T l`` (Hartley & Zisserman, Multiple View Geometry, 2nd edition, section 2.3).
"""

import numpy as np

from fieldcalib._types import Array


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
    total = np.maximum(np.sum(weights, axis=-1), 1e-300)[..., None]
    mean = np.sum(weights[..., None] * xy, axis=-2) / total
    offset = np.sqrt(weights)[..., None] * (xy - mean[..., None, :])
    spread = np.swapaxes(offset, -1, -2) @ offset
    angle = 0.5 * np.arctan2(2.0 * spread[..., 0, 1], spread[..., 0, 0] - spread[..., 1, 1])  # of the long axis
    normal = np.stack([-np.sin(angle), np.cos(angle)], axis=-1)
    return np.concatenate([normal, -np.sum(normal * mean, axis=-1, keepdims=True)], axis=-1)


def homography_from_lines(lines: Array, lines_image: Array, weights: Array) -> Array:
    """Homography H with ``x' = H x`` from corresponding lines, by the normalised DLT.

    Each pair gives ``l x (H^T l') = 0``: three equations, two of them independent. Both planes should be normalised
    beforehand, so that the object has about unit size around the origin (Hartley & Zisserman, sections 4.1 and 4.4).

    Parameters
    ----------
    lines : (..., N, 3) array
        Lines of the first plane.
    lines_image : (..., N, 3) array
        The same lines in the second plane.
    weights : (..., N) array
        Weight of each pair in the least squares problem; 0 leaves a pair out.

    Returns
    -------
    (..., 3, 3) array
        H up to scale and sign. Four lines of which no three meet in a point determine it; with fewer, or with
        degenerate ones, it is one of many.

    Examples
    --------
    >>> H = np.array([[2.0, 0.1, 3.0], [0.0, 1.5, 1.0], [0.1, 0.0, 1.0]])
    >>> lines = np.array([[1.0, 0, -1], [1, 0, 1], [0, 1, -1], [0, 1, 1]])
    >>> found = homography_from_lines(lines, lines @ np.linalg.inv(H), np.ones(4))
    >>> bool(np.allclose(found / found[2, 2], H))
    True
    """
    # l x (H^T l') = [l]x sum_i l'_i h_i with h_i the rows of H
    line = lines / np.linalg.norm(lines, axis=-1, keepdims=True)
    image = lines_image / np.linalg.norm(lines_image, axis=-1, keepdims=True)
    zero = np.zeros_like(line[..., 0])
    cross = np.stack(
        [
            np.stack([zero, -line[..., 2], line[..., 1]], axis=-1),
            np.stack([line[..., 2], zero, -line[..., 0]], axis=-1),
            np.stack([-line[..., 1], line[..., 0], zero], axis=-1),
        ],
        axis=-2,
    )
    rows = image[..., None, :, None] * cross[..., :, None, :] * weights[..., None, None, None]
    A = rows.reshape(*rows.shape[:-4], -1, 9)
    # the eigenvector of A^T A is cheaper than the SVD of A in a batch, and exact enough for a start
    _, vectors = np.linalg.eigh(np.swapaxes(A, -1, -2) @ A)
    return np.asarray(vectors[..., 0].reshape(*vectors.shape[:-2], 3, 3))
