"""Pan, tilt and roll of a camera, and their rotation matrix; rotations by vectors.

World: x right along the touchline, y towards the main camera, z down. Camera: x right, y down, z forward.
With ordinary active rotation matrices

    R = (Rz(pan) Rx(tilt) Rz(roll)).T,        Xc = R (X - C).

Tilt 0 looks straight down, 90 degrees at the horizon; pan > 0 looks right. All angles are radians.
"""

import numpy as np

from fieldcalib._types import Array


def rotation_from_angles(angles: Array) -> Array:
    """World-to-camera rotation of (pan, tilt, roll).

    Parameters
    ----------
    angles : (..., 3) array
        Pan, tilt, roll in radians.

    Returns
    -------
    (..., 3, 3) array
        ``R = (Rz(pan) Rx(tilt) Rz(roll)).T``.

    Examples
    --------
    >>> rotation_from_angles(np.array([0.0, np.pi / 2, 0.0])).round(12) + 0.0  # level, towards the far side
    array([[ 1.,  0.,  0.],
           [ 0.,  0.,  1.],
           [ 0., -1.,  0.]])
    """
    c, s = np.cos(angles), np.sin(angles)
    c_pan, c_tilt, c_roll = c[..., 0], c[..., 1], c[..., 2]
    s_pan, s_tilt, s_roll = s[..., 0], s[..., 1], s[..., 2]
    R = np.empty((*angles.shape[:-1], 3, 3))
    R[..., 0, 0] = c_pan * c_roll - s_pan * c_tilt * s_roll
    R[..., 0, 1] = s_pan * c_roll + c_pan * c_tilt * s_roll
    R[..., 0, 2] = s_tilt * s_roll
    R[..., 1, 0] = -c_pan * s_roll - s_pan * c_tilt * c_roll
    R[..., 1, 1] = -s_pan * s_roll + c_pan * c_tilt * c_roll
    R[..., 1, 2] = s_tilt * c_roll
    R[..., 2, 0] = s_pan * s_tilt
    R[..., 2, 1] = -c_pan * s_tilt
    R[..., 2, 2] = c_tilt
    return R


def angles_from_rotation(R: Array) -> Array:
    """Pan, tilt and roll of a world-to-camera rotation: the one of the two solutions with the smaller roll.

    Camera operators keep the horizon level, hence the choice (paper, appendix "Homography Decomposition", step 5).
    Where the camera looks straight down or up, pan and roll turn about one axis: roll is then 0.

    Parameters
    ----------
    R : (..., 3, 3) array

    Returns
    -------
    (..., 3) array
        Pan and roll in (-pi, pi], tilt in [-pi, pi].

    Examples
    --------
    >>> angles = np.array([0.4, 1.3, -0.02])
    >>> bool(np.allclose(angles_from_rotation(rotation_from_angles(angles)), angles))
    True
    """
    # a copy: NumPy 1.26 and 2.0 round differently near the end of non-contiguous arrays
    r = np.moveaxis(R, (-2, -1), (0, 1)).copy()
    sin_tilt = np.hypot(r[0, 2], r[1, 2])
    # the roll of the solution with sin(tilt) > 0; the other one has pan and roll turned by pi and the tilt negated
    roll = np.arctan2(r[0, 2], r[1, 2])
    sign = np.where(np.abs(roll) <= np.pi / 2, 1.0, -1.0)
    roll = np.where(sin_tilt < 1e-12, 0.0, np.arctan2(sign * r[0, 2], sign * r[1, 2]))
    tilt = np.arctan2(sign * sin_tilt, r[2, 2])
    # with the roll undone, the first row is (cos pan, sin pan, 0), well defined even for a camera looking straight down
    c, s = np.cos(roll), np.sin(roll)
    pan = np.arctan2(c * r[0, 1] - s * r[1, 1], c * r[0, 0] - s * r[1, 0])
    return np.stack([pan, tilt, roll], axis=-1)


def rotation_axes(angles: Array, R: Array) -> Array:
    """Axes, in the camera frame, about which the scene turns as pan, tilt and roll grow.

    ``dXc/dangle_i = -axes[i] x Xc``: pan turns about the world's vertical, roll about the optical axis, tilt about the
    horizontal between them.

    Parameters
    ----------
    angles : (..., 3) array
        Pan, tilt, roll in radians.
    R : (..., 3, 3) array
        Their rotation matrix.

    Returns
    -------
    (..., 3, 3) array
        One unit axis per row.
    """
    axes = np.zeros_like(R)
    axes[..., 0, :] = R[..., :, 2]
    axes[..., 1, 0] = np.cos(angles[..., 2])
    axes[..., 1, 1] = -np.sin(angles[..., 2])
    axes[..., 2, 2] = 1.0
    return axes


def rotation_from_vector(v: Array) -> Array:
    """Rotations (..., 3, 3) about vectors (..., 3), by angles of their lengths: Rodrigues' formula.

    Examples
    --------
    >>> rotation_from_vector(np.array([0.0, 0.0, np.pi / 2])).round(12) + 0.0
    array([[ 0., -1.,  0.],
           [ 1.,  0.,  0.],
           [ 0.,  0.,  1.]])
    """
    angle, K = np.linalg.norm(v, axis=-1)[..., None, None], _cross_matrix(v)
    return np.asarray(np.eye(3) + np.sinc(angle / np.pi) * K + 0.5 * np.square(np.sinc(0.5 * angle / np.pi)) * (K @ K))


def rotation_vector_jacobian(v: Array) -> Array:
    """Derivative (3, 3) of a rotation vector by a small rotation that follows it.

    ``I - [v] / 2 + (1 / |v|^2 - cot(|v| / 2) / (2 |v|)) [v]^2``. Source: Sola, Deray, Atchuthan: A micro Lie theory,
    2018, equation (146).
    """
    angle, K = float(np.linalg.norm(v)), _cross_matrix(v)
    bend = 1.0 / 12.0 if angle < 1e-4 else 1.0 / angle**2 - 0.5 / (angle * np.tan(0.5 * angle))
    return np.asarray(np.eye(3) - 0.5 * K + bend * K @ K)


def _cross_matrix(v: Array) -> Array:
    """Matrices [v] (..., 3, 3) with ``[v] u = v x u``."""
    x, y, z = np.moveaxis(v, -1, 0)
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*v.shape, 3)
