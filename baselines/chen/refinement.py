"""Refinement: a warp of the image aligns the distance image of a view to the edge image's.

OpenCV's alignment sums in single precision; its results differ in the seventh digit from process to process.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from baselines.chen.edges import EDGE_SIZE, Edges, edge_images, scaling
from fieldcalib._types import Array, Float32

HALF_SIZE = (160, 90)
EPSILON = 1e-3  # change of the correlation at which an alignment ends
IS_LINE = 10  # grey value above which a pixel of an edge image is on a line


@dataclass(frozen=True)
class Step:
    """Options of one alignment."""

    size: tuple[int, int]
    """Width and height of the distance images."""
    truncation: float
    """Largest distance in pixels of an image of 320 x 180."""
    motion: int
    """Motion model, an OpenCV constant such as `cv2.MOTION_HOMOGRAPHY`."""
    iterations: int


def distance_image(edges: Edges, size: tuple[int, int], truncation: float) -> Float32:
    """Distance of each pixel to the nearest line, in pixels of EDGE_SIZE, at most `truncation`."""
    resized = edges if edges.shape[::-1] == size else cv2.resize(edges, size, interpolation=cv2.INTER_AREA)
    distance = cv2.distanceTransform((resized <= IS_LINE).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.asarray(np.minimum(distance * np.float32(EDGE_SIZE[0] / size[0]), np.float32(truncation)), np.float32)


def refined(H: Array, edges: Edges, pieces: Array, steps: tuple[Step, ...]) -> Array:
    """Align the views of homographies to an edge image.

    Each step draws the view and finds the warp W of the image, an affine map or a homography, that maximises the
    correlation of both distance images (`cv2.findTransformECC`; Evangelidis, Psarakis: Parametric Image Alignment
    Using Enhanced Correlation Coefficient Maximization, PAMI 2008): ``H <- W H``. A step that fails changes nothing.

    Parameters
    ----------
    H : (N, 3, 3) array
        Map field points (x, y, 1) in metres to pixels of an image of `cameras.IMAGE_SIZE`.
    edges : (180, 320) uint8 array
    pieces : (M, 2, 2) array
        Straight pieces of the markings, see `edges.ground_pieces`.
    steps : tuple of Step

    Returns
    -------
    (N, 3, 3) array
    """
    for step in steps:
        given = distance_image(edges, step.size, step.truncation)
        views = edge_images(H, pieces, step.size)
        W = np.array([_warp(distance_image(view, step.size, step.truncation), given, step) for view in views])
        resized = scaling(step.size)
        H = np.linalg.solve(resized, W @ resized) @ H
    return H


def mismatch(views: Edges, edges: Edges, truncation: float) -> Array:
    """Mean absolute differences (N,) between the distance images of N views and that of an edge image.

    They are in pixels of EDGE_SIZE; distances are truncated at `truncation`.
    """
    size = views.shape[2], views.shape[1]
    given = distance_image(edges, size, truncation)
    return np.array([np.mean(np.abs(distance_image(view, size, truncation) - given)) for view in views])


def _warp(found: Float32, given: Float32, step: Step) -> Array:
    """Find the warp (3, 3) of one distance image to another; the identity where OpenCV finds none."""
    rows = 3 if step.motion == cv2.MOTION_HOMOGRAPHY else 2
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, step.iterations, EPSILON)
    start = np.eye(rows, 3, dtype=np.float32)
    try:
        _, warp = cv2.findTransformECC(found, given, start, step.motion, criteria)
    except cv2.error:  # the images are uncorrelated, or the correlation would fall
        return np.eye(3)
    whole = np.concatenate([warp, np.eye(3)[rows:]]).astype(float)
    return whole if np.all(np.isfinite(whole)) and np.linalg.det(whole) > 0.0 else np.eye(3)
