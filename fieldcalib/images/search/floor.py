"""The floor of a court in a picture, without knowing the field: where markings may be.

A floor is the largest smooth area in the lower half of a picture. A small picture shows no lines and hardly any
players; neighbouring pixels of a floor are alike there, also where light falls unevenly. Lines, reflections and players
divide a floor into several areas of a colour. Whatever lies between them, such as lanes of other colours and letters,
belongs to the floor: it is their convex hull.
"""

from __future__ import annotations

import numpy as np

from fieldcalib._types import BoolArray
from fieldcalib.io.image_files import Image, size_of

WIDTH, NARROW = 320, 5  # columns (or rows, if it is higher) of the small picture; px: narrower things are smoothed away
SMOOTH = 9  # levels: largest difference within the neighbourhood of a pixel of an area; the grain of wood has some
LEAST = 0.002  # share of the picture: smaller areas do not count
LIGHTNESS, COLOUR = 45.0, 12.0  # by which the areas of a floor differ at most, in CIELAB from 0 to 255
BORDER = 7  # px of the small picture, around the hull: outer lines lie on its edge


def floor_of(image: Image) -> BoolArray:
    """Find the floor in a picture; returns a mask (height, width), everywhere true if there is no smooth area.

    Examples
    --------
    >>> picture = np.random.default_rng(0).integers(0, 255, (360, 640, 3)).astype(np.uint8)  # a crowd
    >>> picture[200:, 100:500] = (90, 140, 190)
    >>> picture[200:, 300:304] = 255  # a line
    >>> floor = floor_of(picture)
    >>> [bool(floor[row, column]) for row, column in ((300, 302), (300, 50), (100, 302))]
    [True, False, False]
    """
    import cv2

    size = [max(round(side * WIDTH / max(size_of(image))), NARROW) for side in size_of(image)]
    small = cv2.medianBlur(cv2.medianBlur(cv2.resize(image, size, interpolation=cv2.INTER_AREA), NARROW), NARROW)
    is_smooth = np.max(cv2.morphologyEx(small, cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8)), axis=2) <= SMOOTH
    _, area = cv2.connectedComponents(is_smooth.astype(np.uint8), connectivity=4)
    count, lower = (np.bincount(part[part > 0], minlength=np.max(area) + 1) for part in (area, area[size[1] // 2 :]))
    channels = cv2.split(cv2.cvtColor(small, cv2.COLOR_BGR2LAB))
    colour = np.array([np.bincount(area.ravel(), one.ravel()) for one in channels]) / np.maximum(count, 1)
    off = np.abs(colour - colour[:, [np.argmax(lower)]])
    least = min(LEAST * area.size, np.max(lower))  # 0 if nothing is smooth, which is then area 0
    own = (count >= least) & (off[0] < LIGHTNESS) & (np.hypot(off[1], off[2]) < COLOUR)
    hull = cv2.convexHull(np.argwhere(own[area])[:, ::-1].astype(np.int32))
    mask = cv2.dilate(cv2.fillConvexPoly(np.zeros(area.shape, np.uint8), hull, 1), np.ones((BORDER, BORDER), np.uint8))
    return np.asarray(cv2.resize(mask, size_of(image), interpolation=cv2.INTER_NEAREST) > 0)
