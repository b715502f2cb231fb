"""The motion of the ground between two frames of a camera that moves: a homography.

Where the centre of the camera moves, points move by their depth. Those of one plane still move by a homography, and a
camera on wires or a drone sees mostly the ground. Stands and boards move otherwise, and are left out like players.
"""

from __future__ import annotations

import numpy as np

from fieldcalib._types import Array, BoolArray
from fieldcalib.images.background_motion import (
    LEAST_POINTS,
    RANSAC_TOLERANCE,
    graphics,
    mapped,
    robust_deviation,
    tolerance,
)

RANSAC_ITERATIONS = 2000  # at most; four points make a homography: with half of inliers, 72 draws find it in 99 %
ITERATIONS = 4  # of the fit to inliers


def plane_motion(
    x: Array, y: Array, candidates: BoolArray, size: tuple[int, int]
) -> tuple[Array, BoolArray, BoolArray, float] | None:
    """The motion of points in one plane; arguments and result are those of `background_motion`."""
    import cv2

    if np.count_nonzero(candidates) < LEAST_POINTS:
        return None
    found, agree = cv2.findHomography(
        x[candidates], y[candidates], cv2.RANSAC, RANSAC_TOLERANCE, maxIters=RANSAC_ITERATIONS, confidence=0.999
    )
    if found is None:
        return None
    near = candidates.copy()
    near[candidates] = agree[:, 0] > 0
    H, scale = np.asarray(found, dtype=float), np.inf
    for _ in range(ITERATIONS):
        if np.count_nonzero(near) < LEAST_POINTS:
            return None
        found, _ = cv2.findHomography(x[near], y[near])
        if found is None:
            return None
        H = np.asarray(found, dtype=float)
        r = np.nan_to_num(y - mapped(H, x), nan=np.inf)  # behind the vanishing line
        scale = robust_deviation(r[near])
        near = np.linalg.norm(r, axis=1) < tolerance(scale)
    graphic = graphics(H, x, y, scale)
    return H, near & ~graphic, graphic, scale
