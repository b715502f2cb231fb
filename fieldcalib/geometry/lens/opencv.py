"""OpenCV's distortion coefficients, ``dist_coeffs``: their names, their lengths, and how they scale with the zoom."""

from __future__ import annotations

from reprlib import repr as short

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib._checks import real_array
from fieldcalib._types import Array

COEFFICIENTS = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4")  # OpenCV's order
POWERS = np.array([2, 4, 1, 1, 6, 2, 4, 6, 1, 3, 1, 3])  # of rho / f, by which a coefficient is corner-normalised
LENGTHS = (1, 2, 4, 5, 8, 12, 14)  # of dist_coeffs: k1; k1, k2; and the five lengths of OpenCV


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
