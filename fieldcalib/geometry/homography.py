"""Decomposition of the ground plane's homography into a camera with square pixels and a known principal point.

A homography maps field points (x, y, 1) in metres to pixels. `ALIGNMENTS` converts published ones to that convention.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib._types import Array
from fieldcalib.geometry.projective import finite_homography

YARD = 0.9144  # metres


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
    >>> from fieldcalib.geometry.projective import dehomogenize
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


_YARDS = (115.0, 74.0)
_WC14_TEMPLATE = (115.0 * YARD, 74.0 * YARD)
_PIXELS = np.eye(3)

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
