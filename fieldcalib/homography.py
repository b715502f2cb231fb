"""From the homography of the ground plane to a camera with square pixels and a known principal point."""

import numpy as np

from fieldcalib._types import Array


def decompose_homography(H: Array, principal_point: Array, reference: Array) -> tuple[Array, Array, Array]:
    """Focal length, rotation and centre of the camera whose ground-plane homography is H.

    With ``[h1 h2 h3] = diag(1, 1, f) T H``, T moving the principal point to the origin, h1 and h2 must be orthogonal
    and equally long: two equations linear in 1 / f^2, solved by least squares. Then
    ``[r1 r2 t] = K^-1 H / sqrt(|K^-1 h1| |K^-1 h2|)``, the rotation is the one nearest to ``[r1 r2 r1 x r2]`` and
    ``C = -R^T t`` (paper, appendix "Homography Decomposition", steps 1 to 3; Hartley & Zisserman, algorithm 8.2).

    Parameters
    ----------
    H : (..., 3, 3) array
        Maps field points (x, y, 1) to pixels; scale and sign do not matter.
    principal_point : (2,) array
        In pixels.
    reference : (..., 2) array
        A field point that the camera sees: it is put in front of the camera, which settles the sign of H.

    Returns
    -------
    f : (...) array
        NaN where no real focal length meets the constraints.
    R : (..., 3, 3) array
    C : (..., 3) array

    Examples
    --------
    >>> from fieldcalib.camera import Camera
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
        front = np.sign(z[..., 0] * reference[..., 0] + z[..., 1] * reference[..., 1] + z[..., 2])
        lengths = np.linalg.norm(M[..., :2], axis=-2)
        M *= (front / np.sqrt(lengths[..., 0] * lengths[..., 1]))[..., None, None]
    valid = np.isfinite(f) & (front != 0.0) & np.isfinite(M).all(axis=(-1, -2))
    M = np.where(valid[..., None, None], M, np.eye(3))
    r1, r2 = (M[..., i] / np.linalg.norm(M[..., i], axis=-1, keepdims=True) for i in (0, 1))
    U, _, Vh = np.linalg.svd(np.stack([r1, r2, np.cross(r1, r2)], axis=-1))
    R = U @ Vh
    C = -(np.swapaxes(R, -1, -2) @ M[..., 2:])[..., 0]
    return np.where(valid, f, np.nan), R, C


def _difference(row: Array) -> Array:
    """First entry squared minus second entry squared."""
    return np.asarray(np.square(row[..., 0]) - np.square(row[..., 1]))
