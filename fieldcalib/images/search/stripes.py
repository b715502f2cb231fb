"""Detection of painted stripes in a picture, without knowing the field: their middle, direction and colour.

A stripe is lighter (or darker) than the ground on both of its sides, and the two sides differ less from one another
than the stripe does from them, so that the border between two areas is no stripe. Borders may be asked for as well.
Stripes are looked for in four directions and with several distances to the sides, so that near and far lines are both
found. Neighbouring pixels must agree on the direction: letters, nets and crowds are full of narrow light places, but
these run in all directions.

Pixels are those of the given picture, which `at_working_size` scales: a line of a court is then 2 to 15 px wide.

The colours of stripes and of the ground beside them decide whether stripes may be of one paint (`StripeColours`). Blur
mixes the paint of a narrow stripe with its ground, so that it has the colour ``g + t (p - g)`` with ground g, paint p
and t from 0 to 1. The direction in colour space from the ground towards the stripe is therefore that towards the paint,
however narrow the stripe, and on any ground. Lines of other sports in a hall, and the boards of a floor, have other
directions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fieldcalib._types import Array, BoolArray, Float32, IntArray
from fieldcalib.io.image_files import Image, size_of

WORKING_WIDTH = 1280  # columns; enlarged to this, pictures of 426 columns are searched as well as larger ones
SMALLER_WIDTH = 1120  # columns for a second look, in which lines and arcs come out a little different
LEAST_SIDE = 16  # px: least size of the shorter side of very narrow pictures
SIDES = (3, 6, 11)  # px from the middle of a stripe to the ground on both sides, for narrow and wide stripes
BLUR = 0.8  # px of the picture, against noise and interlacing
ACROSS = ((1, 0), (0, 1), (1, 1), (1, -1))  # directions in which the sides are looked for
DIAGONAL = np.sqrt(0.5)
LEAST_CONTRAST = 6.0  # levels of brightness
LARGEST_DIFFERENCE = 2.0  # of both sides, times the contrast: the line between court and surroundings has unequal sides
STRONG = 40.0  # contrast up to which a stripe's weight in the direction of its neighbourhood grows
MIDDLE_BLUR = 1.2  # px, of the response: without it a wide stripe has its largest response in several pixels
DIRECTION_BLUR = 3.0  # px: size of the neighbourhood that must agree on a direction
LEAST_COHERENCE = 0.55  # of the directions in the neighbourhood: 1 if all are the same, 0 if there is none
MOST = 15_000  # pixels that stand out most are used: boards of a wooden floor and crowds are stripes too
AROUND, LEAST_AROUND = 161, 3.0  # px: size of the neighbourhood from which they stand out; its least mean response
BAND = 32  # rows whose response is computed at once: their arrays fit the processor's cache
LUMA = (0.114, 0.587, 0.299)  # blue, green, red (Rec. 601)

SIDE = 11.0  # px from the middle of a stripe to the ground
COLOUR_BLUR = 1.0  # px
PURE = 0.7  # quantile of the contrast above which stripes of a paint show it unmixed
LARGEST_ANGLE = np.radians(25.0)  # in colour space, between the directions from the ground to stripe and paint
FEWEST_LINES, MOST_OF_LINE = 3, 0.6  # lines of a paint, and share of the stripes of a line that are of its paint
LEAST = 20  # stripes that determine the colour of a paint


@dataclass(frozen=True, eq=False)
class Stripes:
    """Pixels along the middle of stripes."""

    xy: Array
    """Pixels, to a fraction of a pixel across the stripe, (N, 2)."""
    angle: Array
    """Direction in which the stripe runs, from x towards y, radians in [0, pi), (N,)."""
    contrast: Array
    """Difference of the stripe from both sides, levels of brightness, (N,)."""
    size: tuple[int, int]
    """Width and height of the picture."""

    def take(self, index: BoolArray | IntArray) -> Stripes:
        """Select pixels by mask or by index."""
        return Stripes(self.xy[index], self.angle[index], self.contrast[index], self.size)


def at_working_size(image: Image, *, smaller: bool = False) -> Image:
    """Scale a picture to 1280 columns, or to 1280 rows if it is higher than wide; `smaller` for a second look."""
    import cv2

    longer, columns = max(size_of(image)), SMALLER_WIDTH if smaller else WORKING_WIDTH
    if longer == columns:
        return image
    width, height = (max(round(side * columns / longer), LEAST_SIDE) for side in size_of(image))
    how = cv2.INTER_AREA if longer > columns else cv2.INTER_CUBIC
    return np.asarray(cv2.resize(image, (width, height), interpolation=how))


def find_stripes(image: Image, *, lighter: bool | None = True) -> Stripes:
    """Find the painted stripes of a picture that stand out most, without knowing what they belong to.

    Parameters
    ----------
    image : (height, width, 3) uint8 array
        Blue, green, red, of about `WORKING_WIDTH` columns.
    lighter : bool or None
        Whether stripes are lighter than the ground, else they are darker. None finds both, and the edges of areas.

    Examples
    --------
    >>> picture = np.full((90, 160, 3), 90, np.uint8)
    >>> picture[:, 70:75] = 200  # a line, 5 px wide
    >>> picture[:, 120:] = 200  # an area
    >>> stripes = find_stripes(picture)
    >>> np.unique(stripes.xy[:, 0].round()), np.unique(np.degrees(stripes.angle).round())
    (array([72.]), array([90.]))
    """
    return AllStripes.of(image, lighter=lighter).standing_out()


@dataclass(frozen=True, eq=False)
class AllStripes:
    """All stripes of a picture, of which those that stand out most are used."""

    stripes: Stripes
    prominence: Array
    """How much each stands out: its contrast over the mean response around it, (N,)."""

    @classmethod
    def of(cls, image: Image, *, lighter: bool | None, darkest: bool = False) -> AllStripes:
        """Find the stripes of an image as `find_stripes` does, or in the darkest of its channels at each pixel."""
        import cv2

        grey = image.min(axis=2) if darkest else cv2.transform(image, np.array([LUMA], np.float32))
        grey = np.asarray(grey, np.float32)
        luma: Float32 = np.asarray(cv2.GaussianBlur(-grey if lighter is False else grey, (0, 0), BLUR), np.float32)
        sharp = _response(luma, either=lighter is None)
        response: Float32 = np.asarray(cv2.GaussianBlur(sharp, (0, 0), MIDDLE_BLUR), np.float32)
        across, coherence = _direction(np.minimum(response, np.float32(STRONG)))
        x, y, offset = _middles(response, across, coherence)
        normal = across[y, x].astype(float)
        step = np.column_stack([np.cos(normal), np.sin(normal)])
        xy = np.column_stack([x, y]) + offset[:, None] * step
        contrast = response[y, x].astype(float)
        around = cv2.boxFilter(response, -1, (AROUND, AROUND), borderType=cv2.BORDER_REFLECT)[y, x]
        stripes = Stripes(xy, np.mod(normal + 0.5 * np.pi, np.pi), contrast, size_of(image))
        return cls(stripes, contrast / (around + LEAST_AROUND))

    def standing_out(self, area: BoolArray | None = None) -> Stripes:
        """Select the stripes that stand out most, in the picture or in an `area` of it, a mask (height, width)."""
        xy = self.stripes.xy.round().astype(np.intp)
        own = np.arange(len(xy)) if area is None else np.flatnonzero(area[xy[:, 1], xy[:, 0]])
        most = np.argsort(-self.prominence[own], kind="stable")[:MOST]
        return self.stripes.take(own[np.sort(most)])


def _response(luma: Float32, *, either: bool) -> Float32:
    """Contrast of each pixel to both of its sides, averaged over the distances `SIDES`; 0 if it is not lighter.

    With `either`, it may also be darker, or between both sides, as on the edge of an area.
    """
    reach = max(SIDES)
    padded = np.pad(luma, reach, mode="edge")
    bands = [padded[row : row + BAND + 2 * reach] for row in range(0, len(luma), BAND)]
    return np.concatenate([_response_inside(band, reach, either=either) for band in bands])


def _response_inside(luma: Float32, reach: int, *, either: bool) -> Float32:
    """Compute the response `reach` pixels and more from the border."""
    height, width = luma.shape[0] - 2 * reach, luma.shape[1] - 2 * reach
    own = luma[reach:-reach, reach:-reach]
    best = np.zeros_like(own)
    for dx, dy in ACROSS:
        total = np.zeros_like(own)
        for side in SIDES:
            step = side if not (dx and dy) else max(round(side * DIAGONAL), 1)
            x, y = step * dx, step * dy
            one = luma[reach + y : reach + y + height, reach + x : reach + x + width]
            other = luma[reach - y : reach - y + height, reach - x : reach - x + width]
            higher = np.maximum(one, other)  # at the edge of a light area only one side is darker
            contrast = own - higher
            difference = higher + higher - one - other
            largest = LARGEST_DIFFERENCE * contrast
            if either:
                stripe = np.maximum(contrast, higher - difference - own)  # below 0 between both sides: on an edge
                contrast, largest = np.abs(stripe), LARGEST_DIFFERENCE * np.maximum(stripe, -2.0 * stripe)
            is_stripe = (contrast > LEAST_CONTRAST) & (difference < largest)
            total += np.where(is_stripe, contrast, np.float32(0.0))
        np.maximum(best, total, out=best)
    return best / np.float32(len(SIDES))


def _direction(response: Float32) -> tuple[Float32, Float32]:
    """Angle across the stripes around each pixel, from the structure tensor, and its coherence in [0, 1]."""
    import cv2

    dx, dy = cv2.Sobel(response, cv2.CV_32F, 1, 0), cv2.Sobel(response, cv2.CV_32F, 0, 1)
    xx, xy, yy = (cv2.GaussianBlur(product, (0, 0), DIRECTION_BLUR) for product in (dx * dx, dx * dy, dy * dy))
    length, angle = cv2.cartToPolar(xx - yy, 2.0 * xy)
    return 0.5 * angle, length / (xx + yy + np.float32(1.0))


def _middles(response: Float32, across: Float32, coherence: Float32) -> tuple[IntArray, IntArray, Float32]:
    """Columns and rows of pixels in the middle of stripes, and the offset from each across the stripe to its top."""
    candidates = (response > 0.5 * LEAST_CONTRAST) & (coherence > LEAST_COHERENCE)
    candidates[[0, 1, -2, -1]] = candidates[:, [0, 1, -2, -1]] = False
    y, x = np.nonzero(candidates)
    normal = across[y, x]
    nx, ny = np.cos(normal), np.sin(normal)
    middle = response[y, x]
    after, before = (_sampled(response, np.asarray(x + s * nx), np.asarray(y + s * ny)) for s in (1.0, -1.0))
    top = (middle >= before) & (middle > after)
    x, y, before, middle, after = x[top], y[top], before[top], middle[top], after[top]
    return x, y, 0.5 * (after - before) / np.maximum(2.0 * middle - before - after, 1e-6)


def _sampled(values: Float32, x: Array | Float32, y: Array | Float32) -> Float32:
    """Interpolate values bilinearly at places between pixels, none of them at the border."""
    column, row = np.floor(x).astype(np.intp), np.floor(y).astype(np.intp)
    u, v = (x - column).astype(np.float32), (y - row).astype(np.float32)
    upper = (1.0 - u) * values[row, column] + u * values[row, column + 1]
    lower = (1.0 - u) * values[row + 1, column] + u * values[row + 1, column + 1]
    return np.asarray((1.0 - v) * upper + v * lower, np.float32)


@dataclass(frozen=True, eq=False)
class StripeColours:
    """Colours of stripes, blue, green, red."""

    paint: Array
    """Colour in the middle of each stripe, (N, 3)."""
    ground: Array
    """Colours on both sides of each stripe, (N, 2, 3)."""

    @classmethod
    def of(cls, image: Image, stripes: Stripes) -> StripeColours:
        """Sample the colours of the stripes of a picture."""
        import cv2

        smooth = np.asarray(cv2.GaussianBlur(image, (0, 0), COLOUR_BLUR), np.uint8)
        side = SIDE * np.column_stack([-np.sin(stripes.angle), np.cos(stripes.angle)])
        middle, *sides = (_nearest_colours(smooth, stripes.xy + step) for step in (0.0 * side, side, -side))
        return cls(middle, np.stack(sides, axis=1))

    def take(self, index: IntArray) -> StripeColours:
        """Select stripes by index."""
        return StripeColours(self.paint[index], self.ground[index])

    @property
    def are_edges(self) -> BoolArray:
        """Whether the colour of each stripe lies between those of its sides, as on the edge of an area, (N,)."""
        one, other = np.moveaxis(self.paint[:, None] - self.ground, 1, 0)
        return np.asarray(np.sum(one * other, axis=1) < 0.0)

    def are_like(self, own: BoolArray) -> BoolArray:
        """Whether each stripe may be of the same paint as the stripes of the mask `own`; all may if these are too few.

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
        """Masks of the stripes of each paint that is on at least three lines but not on all, by order of the lines.

        `lines` are the masks of the stripes on each line. Two lines are of one paint if most stripes of one of them are
        like the other's: it need not hold both ways, as a thin line shows its paint less purely.
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


def _nearest_colours(image: Image, xy: Array) -> Array:
    """Colours (N, 3) of the nearest pixels."""
    height, width = image.shape[:2]
    column, row = np.clip(np.round(xy).astype(np.intp), 0, (width - 1, height - 1)).T
    return np.asarray(image[row, column], dtype=float)
