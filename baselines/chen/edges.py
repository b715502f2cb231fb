"""Edge images: markings on the ground as thin white lines on black, from cameras, annotations or masks of lines.

They are uint8 (height, width) of EDGE_SIZE, a quarter of `cameras.IMAGE_SIZE`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from baselines.chen.cameras import IMAGE_SIZE
from fieldcalib._types import Array, BoolArray, Float32
from fieldcalib.draw.scene import NEAR_PLANE, SHIFT
from fieldcalib.fields.field import Field
from fieldcalib.fields.segments import Segment
from fieldcalib.localize.point_selection import BACKGROUND
from fieldcalib.problem.labelled_pixels import Pixels

Edges: TypeAlias = NDArray[np.uint8]

EDGE_SIZE = (320, 180)
ARC_SPACING = 2.0  # m: length of the straight pieces of an arc; they are at most 5 cm off the centre circle
WHITE = 255
LINE_LEVEL = 127  # grey value above which a pixel of a mask is on a line


def scaling(size: tuple[int, int], of: tuple[int, int] = IMAGE_SIZE) -> Array:
    """Scale pixels of an image to another image size, (3, 3); centres of pixels have integer coordinates."""
    s = np.divide(size, of)
    return np.array([[s[0], 0.0, (s[0] - 1.0) / 2.0], [0.0, s[1], (s[1] - 1.0) / 2.0], [0.0, 0.0, 1.0]])


def is_on_ground(segment: Segment) -> bool:
    """Whether a segment is a marking on the ground."""
    return not segment.is_point and not np.any(segment.sample()[:, 2])


def ground_pieces(field: Field) -> Array:
    """Divide the markings on the ground into straight pieces: start and end, (M, 2, 2), metres."""
    pieces = []
    for label, segment in field.markings.items():
        if is_on_ground(segment) and label not in field.half_labels:
            X = segment.corners() if segment.is_straight else segment.sample(ARC_SPACING)
            pieces.append(np.stack([X[:-1, :2], X[1:, :2]], axis=1))
    return np.concatenate(pieces)


def edge_images(H: Array, pieces: Array, size: tuple[int, int] = EDGE_SIZE) -> Edges:
    """Draw edge images of N views, (N, height, width).

    Parameters
    ----------
    H : (N, 3, 3) array
        Field points (x, y, 1) in metres to pixels of an image of IMAGE_SIZE; scale and sign do not matter.
    pieces : (M, 2, 2) array
        Straight pieces of the markings, see `ground_pieces`.
    size : (int, int)
        Width and height of the edge images.

    Examples
    --------
    >>> from baselines.chen.cameras import cameras_of_chen
    >>> from fieldcalib import soccer
    >>> cameras = cameras_of_chen(2, np.random.default_rng(0))
    >>> edge_images(cameras.homographies, ground_pieces(soccer())).shape
    (2, 180, 320)
    """
    xy, visible = _projected(scaling(size) @ H, pieces, size)
    fixed = np.rint(xy * (1 << SHIFT)).astype(np.int32)
    images = np.zeros((len(H), size[1], size[0]), np.uint8)
    for image, ends, drawn in zip(images, fixed, visible, strict=True):
        cv2.polylines(image, list(ends[drawn]), False, WHITE, 1, cv2.LINE_AA, SHIFT)
    return images


def _projected(H: Array, pieces: Array, size: tuple[int, int]) -> tuple[Array, BoolArray]:
    """Project the pieces to pixels, (N, M, 2, 2), cut at the near plane, and find those that may be in the image."""
    above = np.where(np.linalg.det(H) > 0.0, 1.0, -1.0) / np.linalg.norm(H[:, 2, :2], axis=1)
    H = H * above[:, None, None]  # the last row now gives the depth in metres, up to the sine of the tilt
    h = np.einsum("nij,mkj->nmki", H[:, :, :2], pieces) + H[:, None, None, :, 2]
    depth = h[..., 2]
    in_front = depth > NEAR_PLANE
    visible = np.any(in_front, axis=2)
    start, end = h[:, :, 0].copy(), h[:, :, 1].copy()
    with np.errstate(divide="ignore", invalid="ignore"):
        cut = start + ((NEAR_PLANE - depth[..., 0]) / (depth[..., 1] - depth[..., 0]))[..., None] * (end - start)
    crosses = visible[..., None] & ~in_front
    h[:, :, 0] = np.where(crosses[..., :1], cut, start)
    h[:, :, 1] = np.where(crosses[..., 1:], cut, end)
    xy = np.divide(h[..., :2], h[..., 2:], out=np.zeros_like(h[..., :2]), where=visible[..., None, None])
    visible &= np.all((xy.min(axis=2) < size) & (xy.max(axis=2) > -1.0), axis=2)
    return xy, visible


def edges_of_pixels(field: Field, pixels: Pixels, image_size: tuple[int, int]) -> Edges:
    """Draw labelled pixels: those of each marking on the ground are joined in their order along it."""
    image = np.zeros(EDGE_SIZE[::-1], np.uint8)
    resized = scaling(EDGE_SIZE, image_size)
    for label, xy in pixels.items():
        if label in field and is_on_ground(field[label]):
            line = xy[field[label].order(xy)] @ resized[:2, :2] + resized[:2, 2]
            fixed = np.rint(line * (1 << SHIFT)).astype(np.int32)
            cv2.polylines(image, [fixed], False, WHITE, 1, cv2.LINE_AA, SHIFT)
    return image


def edges_of_mask(mask: NDArray[np.uint8]) -> Edges:
    """Thin the lines of a grey mask (height, width) of any size to an edge image."""
    from skimage.morphology import skeletonize

    resized = cv2.resize(mask, EDGE_SIZE, interpolation=cv2.INTER_LINEAR)
    return np.where(skeletonize(resized > LINE_LEVEL), WHITE, 0).astype(np.uint8)  # type: ignore[no-untyped-call]


def edges_of_probabilities(probability: Float32, classes: Sequence[str], field: Field) -> Edges:
    """Thin a network's class probabilities (K, h, w) to an edge image of all markings on the ground."""
    lines = [c for c, label in enumerate(classes) if label != BACKGROUND and is_on_ground(field[label])]
    return edges_of_mask(np.rint(WHITE * np.sum(probability[lines], axis=0)).astype(np.uint8))
