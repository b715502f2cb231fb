"""The colours of stripes and of the ground beside them: whether stripes may be of one paint.

Blur mixes the paint of a narrow stripe with its ground, so that it has the colour ``g + t (p - g)`` with ground g,
paint p and t from 0 to 1: the direction from the ground towards the stripe is that towards the paint, however narrow it
is, and on any ground. The lines of other sports in a hall, and the boards of a floor, point elsewhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fieldcalib._types import Array, BoolArray, IntArray
from fieldcalib.io.image import Image
from fieldcalib.localize.stripes import Stripes

SIDE = 11.0  # px from the middle of a stripe to the ground
BLUR = 1.0  # px
PURE = 0.7  # quantile of the contrast above which stripes of a paint show it unmixed
LARGEST_ANGLE = np.radians(25.0)  # between the directions towards the stripe and towards the paint
FEWEST_LINES, MOST_OF_LINE = 3, 0.6  # lines of a paint, and share of the stripes of a line that are of its paint
LEAST = 20  # stripes that tell the colour of a paint


@dataclass(frozen=True, eq=False)
class StripeColours:
    """Colours of stripes, blue, green, red."""

    paint: Array
    """(N, 3), in the middle of each."""
    ground: Array
    """(N, 2, 3), on both sides."""

    @classmethod
    def of(cls, image: Image, stripes: Stripes) -> StripeColours:
        """The colours of the stripes of a picture."""
        import cv2

        smooth = np.asarray(cv2.GaussianBlur(image, (0, 0), BLUR), np.uint8)
        side = SIDE * np.column_stack([-np.sin(stripes.angle), np.cos(stripes.angle)])
        middle, *sides = (_sampled(smooth, stripes.xy + step) for step in (0.0 * side, side, -side))
        return cls(middle, np.stack(sides, axis=1))

    def take(self, index: IntArray) -> StripeColours:
        """Some of them."""
        return StripeColours(self.paint[index], self.ground[index])

    def are_like(self, own: BoolArray) -> BoolArray:
        """Which stripes may be of the same paint as those of a mask; all of them if these are few.

        Examples
        --------
        >>> white, yellow, floor = [220.0, 220.0, 220.0], [60.0, 200.0, 210.0], [[90.0, 120.0, 160.0]] * 2
        >>> colours = StripeColours(np.array([white] * 30 + [yellow]), np.array([floor] * 31))
        >>> np.flatnonzero(~colours.are_like(np.arange(31) < 25))
        array([30])
        """
        if np.count_nonzero(own) < LEAST:
            return np.ones(len(own), dtype=bool)
        contrast = np.linalg.norm(self.paint - np.mean(self.ground, axis=1), axis=1)
        paint = np.median(self.paint[own & (contrast >= np.quantile(contrast[own], PURE))], axis=0)
        seen, whole = self.paint[:, None] - self.ground, paint - self.ground
        cosine = np.sum(seen * whole, axis=2) / np.maximum(
            np.linalg.norm(seen, axis=2) * np.linalg.norm(whole, axis=2), 1e-6
        )
        return np.asarray(np.max(cosine, axis=1) > np.cos(LARGEST_ANGLE))

    def paints(self, lines: Sequence[BoolArray]) -> list[BoolArray]:
        """Masks of the stripes of each paint on at least three lines but not on all, that of the longest lines first.

        `lines` are the masks of the stripes on each. Two lines are of one paint if most stripes of one are like the
        other: a thin line shows its paint less purely, so that not both need be.
        """
        like = [self.are_like(one) for one in lines]
        shares = np.array([[np.mean(mask[one]) for one in lines] for mask in like]).reshape(len(lines), len(lines))
        are_alike = np.maximum(shares, shares.T) >= MOST_OF_LINE
        np.fill_diagonal(are_alike, True)
        left, found = list(range(len(lines))), []
        while len(left) >= FEWEST_LINES:
            own = [k for k in left if are_alike[left[0], k]]
            if FEWEST_LINES <= len(own) < len(lines):
                found.append(self.are_like(np.any([lines[k] for k in own], axis=0)))
            left = [k for k in left if k not in own]
        return found


def _sampled(image: Image, xy: Array) -> Array:
    """Colours (N, 3) of the nearest pixels."""
    height, width = image.shape[:2]
    column, row = np.clip(np.round(xy).astype(np.intp), 0, (width - 1, height - 1)).T
    return np.asarray(image[row, column], dtype=float)
