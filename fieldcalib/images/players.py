"""Compact blobs on the ground of a picture: players, officials, balls and their shadows, which move of their own.

Corners are followed from frame to frame to tell the motion of the camera. In a fast pan the ground is blurred, most
corners that are left lie on players, and players who run the same way look like a background. In three rendered clips
the motion between neighbouring frames was off by up to 0.4 to 1.0 px at 90 % of the pairs with corners on players, and
by up to 0.2 px without.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from fieldcalib._types import Array, BoolArray, IntArray
from fieldcalib.io.image import Image

# Lengths are in pixels of a picture of this width.
WIDTH = 320
COLOUR_BINS = 64  # of each chroma axis
GROUND_BELOW = 1.0 / 3.0  # of the height: where the colour of the ground is taken from
CHROMA, LIGHTNESS = 12.0, 35.0  # of 255 (a, b and L of CIE Lab): what differs by more from the ground is not ground
AROUND = 30  # px across which the lightness of the ground is the same: it has stripes and shadows
THIN = 3  # px: what is thinner is a line, or a net
SMALLEST_AREA = 20  # square px: less may be left of a slanting line
LARGEST_AREA = 0.02  # of the picture
LARGEST_SIDE = (0.15, 0.4)  # of width and height
LONGEST = 5.0  # times as long as wide (ratio of standard deviations): what is longer is a line
RING = 4  # px around the bounding box of a blob
LEAST_GROUND = 0.7  # of this ring: what stands before boards and crowd is not told from them
MARGIN = 5  # px of the dilation


def thumbnail(image: Image) -> Image:
    """A picture reduced to `WIDTH`, if it is wider."""
    import cv2

    height, width = image.shape[:2]
    ratio = max(width / WIDTH, 1.0)
    size = (round(width / ratio), max(round(height / ratio), 1))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_LINEAR))


def blobs_on_ground(image: Image) -> Image:
    """1 where compact things stand on the ground of a thumbnail (height, width, 3) in blue, green, red, else 0.

    Examples
    --------
    >>> image = np.full((180, 320, 3), (60, 140, 60), np.uint8)
    >>> image[90:110, 100:108] = (30, 30, 200)  # a player
    >>> image[:, 200:203] = 255  # a line
    >>> blobs = blobs_on_ground(image)
    >>> int(blobs[100, 104]), int(blobs[100, 201])
    (1, 0)
    """
    import cv2

    ground = _is_ground(cv2.cvtColor(image, cv2.COLOR_BGR2LAB))
    thick: Any = cv2.morphologyEx(1 - ground, cv2.MORPH_OPEN, np.ones((THIN, THIN), np.uint8))
    _, label, boxes, _ = cv2.connectedComponentsWithStats(thick, connectivity=8)
    stands = _are_small(boxes, ground.shape) & (_ground_around(boxes, ground) > LEAST_GROUND)
    stands[0] = False  # the ground
    is_blob = _are_compact(np.where(stands[label], label, 0), len(boxes))
    return np.asarray(cv2.dilate(is_blob[label].astype(np.uint8), np.ones((MARGIN, MARGIN), np.uint8)))


def _is_ground(lab: Any) -> Any:
    """1 where a picture in CIE Lab has the most common colour of its lower part, and the lightness around; else 0."""
    import cv2

    lower = lab[int(GROUND_BELOW * len(lab)) :]
    counts = cv2.calcHist([lower], [1, 2], None, [COLOUR_BINS, COLOUR_BINS], [0, 256, 0, 256])
    common = np.unravel_index(np.argmax(cv2.GaussianBlur(counts, (5, 5), 0.0)), counts.shape)
    colour = (np.array(common) + 0.5) * (256 / COLOUR_BINS)
    has_colour = cv2.inRange(lab, (0.0, *(colour - CHROMA)), (255.0, *(colour + CHROMA)))
    lightness = np.ascontiguousarray(lab[..., 0])
    half = cv2.resize(lightness, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    around = cv2.resize(cv2.medianBlur(half, AROUND // 2), lightness.shape[::-1], interpolation=cv2.INTER_LINEAR)
    return np.minimum(has_colour, cv2.absdiff(lightness, around) < LIGHTNESS).astype(np.uint8)


def _are_small(boxes: IntArray, shape: tuple[int, ...]) -> BoolArray:
    height, width = shape
    sides = np.multiply(LARGEST_SIDE, (width, height))
    area = boxes[:, 4]
    fits = (area >= SMALLEST_AREA) & (area < LARGEST_AREA * height * width)
    return np.asarray(fits & np.all(boxes[:, 2:4] < sides, axis=1))


def _are_compact(label: Array, count: int) -> BoolArray:
    """Whether the pixels of each label but 0 have similar standard deviations along and across."""
    y, x = np.nonzero(label)
    one = label[y, x]
    n = np.maximum(np.bincount(one, minlength=count), 1)
    mx, my, xx, yy, xy = (np.bincount(one, z, count) / n for z in (x, y, x * x, y * y, x * y))
    a, b, c = xx - mx * mx + 1.0 / 12.0, yy - my * my + 1.0 / 12.0, xy - mx * my  # a pixel is a square
    spread = np.hypot(0.5 * (a - b), c)
    is_seen = np.bincount(one, minlength=count) > 0
    return np.asarray(is_seen & (0.5 * (a + b) + spread < LONGEST**2 * (0.5 * (a + b) - spread)))


def _ground_around(boxes: IntArray, ground: Any) -> Array:
    """Share of the ground in a ring around each bounding box."""
    import cv2

    height, width = ground.shape
    total = cv2.integral(ground)

    def inside(margin: int) -> tuple[Array, Array]:
        x0, y0 = np.maximum(boxes[:, 0] - margin, 0), np.maximum(boxes[:, 1] - margin, 0)
        x1 = np.minimum(boxes[:, 0] + boxes[:, 2] + margin, width)
        y1 = np.minimum(boxes[:, 1] + boxes[:, 3] + margin, height)
        return total[y1, x1] - total[y0, x1] - total[y1, x0] + total[y0, x0], (x1 - x0) * (y1 - y0)

    (outer, outer_area), (inner, inner_area) = inside(RING), inside(0)
    return np.asarray((outer - inner) / np.maximum(outer_area - inner_area, 1))
