"""Similarity of two frames of a video once one is moved to the other, and the share of the scene that both show."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from fieldcalib._types import Array, Float32
from fieldcalib.images.background_motion import mapped
from fieldcalib.images.frame import Frame

IN_PICTURE = (np.mgrid[:20, :20].reshape(2, -1).T + 0.5) / 20.0  # (400, 2) shares of width and height
SMALL_WIDTH = 160  # px of the small pictures that are compared
LOCAL = 41  # px of a small picture: the mean over so many is subtracted, as slow shading is alike in any two shots
BLOCK = 5  # px of a small picture
WHOLE = 0.7  # share of a block that must be in view
NOISE = 2.0  # grey levels: contrast below is noise
GRAPHIC = (4.0, 12.0, 5)  # grey levels: alike in place, unlike once moved; px around that belong to it


@dataclass(frozen=True, eq=False)
class View:
    """A frame of a video, with a small picture by which its likeness with others is measured."""

    index: int
    frame: Frame
    duplicate: bool

    @cached_property
    def detail(self) -> Float32:
        """The reduced picture less its local mean."""
        import cv2

        height, width = self.frame.grey.shape
        small_width = min(SMALL_WIDTH, width)
        size = (small_width, max(round(height * small_width / width), 1))
        small: Any = cv2.resize(self.frame.grey, size, interpolation=cv2.INTER_AREA).astype(np.float32)
        return np.asarray(small - cv2.blur(small, (LOCAL, LOCAL)), dtype=np.float32)


def likeness(first: View, second: View, H: Array) -> float:
    """Share of the contrast of either picture that is in the other, once the first is moved by H (in full size).

    It is the covariance over the larger variance in each block, and the median over the half of the blocks with more
    contrast, since players and boards change some blocks only. Graphics, which are the same in place and not once
    moved, are left out. A mixture ``(1 - a) A + a B`` of two shots has a likeness of about 1 - a with A and a with B.
    """
    import cv2

    a: Any = first.detail
    b: Any = second.detail
    height, width = b.shape
    x, y = np.divide(first.frame.image_size, (width, height))
    T = np.array([[x, 0.0, 0.5 * (x - 1.0)], [0.0, y, 0.5 * (y - 1.0)], [0.0, 0.0, 1.0]])
    small = np.linalg.inv(T) @ H @ T
    inside = cv2.warpPerspective(np.ones_like(a), small, (width, height), flags=cv2.INTER_NEAREST)
    moved = cv2.warpPerspective(a, small, (width, height), flags=cv2.INTER_LINEAR)
    same, unlike, around = GRAPHIC
    graphic = ((np.abs(a - b) < same) & (np.abs(moved - b) > unlike)).astype(np.uint8)
    inside[cv2.dilate(graphic, np.ones((around, around), np.uint8)) > 0] = 0.0
    a, b = moved * inside, b * inside
    blocks = (max(width // BLOCK, 1), max(height // BLOCK, 1))
    means = (cv2.resize(z, blocks, interpolation=cv2.INTER_AREA) for z in (inside, a * a, b * b, a * b))
    seen, aa, bb, ab = (mean.ravel() for mean in means)
    whole = seen > WHOLE
    if not np.any(whole):
        return 0.0
    variance = np.maximum(aa, bb)[whole] / seen[whole]
    share = ab[whole] / seen[whole] / (variance + NOISE**2)
    return float(np.median(share[variance >= np.median(variance)]))


def shared_view(H: Array, size: tuple[int, int]) -> float:
    """Share of either picture that is in view in the other; the smaller of both."""
    xy = IN_PICTURE * np.asarray(size, dtype=np.float64)
    back: Array = np.asarray(np.linalg.inv(H), dtype=np.float64)
    with np.errstate(invalid="ignore"):
        inside = [np.all((z >= 0.0) & (z < size), axis=1) for z in (mapped(H, xy), mapped(back, xy))]
    return float(min(np.mean(part) for part in inside))
