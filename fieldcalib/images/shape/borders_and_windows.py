"""Evidence in pixels for the part of a picture that shows a frame: black borders, and windows.

Black borders (letterboxes and pillarboxes) are black, even, and equal on opposite sides, whereas night skies and dark
stands are on one side only, or have structure. Borders are compressed with the picture, so black is not quite zero, and
their last rows show a little of the picture.

In a window a frame is shown shrunk before a background, or beside other views. The sides of a window are steps of
brightness or colour that are exactly vertical or horizontal, and go on from one corner to the other. A pixel counts as
a step if the change to its neighbour is the largest within a few pixels across the side. Along a side nearly all pixels
of one column (one row) are steps; in stands or grass one in five is by chance. Posts and markings are as steep, but do
not meet others at their ends to form a rectangle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fieldcalib._types import Array, IntArray
from fieldcalib.io.image_files import Image, size_of
from fieldcalib.problem.picture_shape import BROADCAST_SHAPE, Placement

BLACK = 30  # brightest channel; black of video is 16
FEW = 0.02  # share of brighter pixels that a black row may have: noise, a logo
EVEN = 4.0  # largest standard deviation of the brightness of a border; dark stands have more
THINNEST, THICKEST = 0.01, 0.35  # shares of the picture's height or width that one border takes
EVERY = 3  # one pixel in three of each row is used

LOOKED_AT = 200  # approximate number of rows (columns) at which vertical (horizontal) steps are looked for
STEP = 8  # levels: smaller steps are compression and noise
AROUND = 2  # px to each side, among which the step is the largest
COVERED, COVERED_PART = 0.78, 0.42  # least shares of the pixels of a side, and of each of its `PARTS`, that are steps
FAINT, FAINT_PART = 0.45, 0.15  # the same for a weak side: a window that touches no border of the picture may have one
WEAK, STRONG = 1, 2  # certainty of a side
PARTS = np.array([0.0, 0.06, 0.24, 0.41, 0.59, 0.76, 0.94, 1.0])  # bounds of the parts of a side
CANDIDATE, MOST = 0.25, 16  # least share of steps in a whole column for a candidate; largest number of candidates
NARROWEST, LOWEST = 0.25, 0.3  # least width and height of a window, shares of the picture's
SMALLEST = 180  # px: the sides of smaller pictures are too short to be told from chance
NARROWEST_BORDER = 0.01  # share of the picture's size: nearer steps come from compression and resizing
SHOWN = 0.4  # least height of the highest window, as a share of the picture's
SAME_SHAPE = 0.05  # largest log ratio of two aspect ratios that count as the same
SAME = 0.02  # share of the picture's size: sides that are nearer to each other belong to one border


SAME_IN_CLIP = 2  # px: windows of several pictures that differ by no more are the same, up to compression


class Window(NamedTuple):
    """A window in pixels: its first column and row, and the column and row after its last ones."""

    left: int
    top: int
    right: int
    bottom: int


@dataclass(frozen=True, eq=False)
class Sides:
    """Candidates for the vertical sides of windows (or, of the transposed picture, the horizontal ones)."""

    at: tuple[int, ...]
    """Columns; the first and the last are the picture's borders."""
    covered: Array
    """Number of steps of each candidate in the first n of the rows looked at, (candidates, rows + 1)."""
    every: float
    """Rows from one that is looked at to the next."""

    @classmethod
    def of(cls, image: Image) -> Sides:
        """Find the candidates of an image (height, width, 3)."""
        import cv2

        height, width = image.shape[:2]
        every = max(height // LOOKED_AT, 1)
        rows = np.ascontiguousarray(image[::every])  # of a transposed view this copies only what is looked at
        blue, green, red = cv2.split(cv2.absdiff(rows[:, 1:], rows[:, :-1]))
        step = cv2.max(cv2.max(blue, green), red)
        # a step that was resized or compressed lies in two columns
        step = cv2.max(step[:, 1:], step[:, :-1])
        largest = cv2.dilate(step, np.ones((1, 2 * AROUND + 1), np.uint8))
        is_step = (step == largest) & (step >= STEP)
        share = cv2.reduce(is_step.astype(np.float32), 0, cv2.REDUCE_AVG)[0]
        near = cv2.dilate(share[None], np.ones((1, 2 * 2 + 1), np.uint8))[0]
        inside = np.abs(np.arange(len(share)) + 1 - width / 2.0) < (0.5 - NARROWEST_BORDER) * width
        candidates = np.flatnonzero((share == near) & (share >= CANDIDATE) & inside)
        candidates = np.sort(candidates[np.argsort(-share[candidates], kind="stable")[:MOST]])
        inner = np.cumsum(np.pad(is_step[:, candidates].T, ((0, 0), (1, 0))), axis=1)
        border = np.tile(np.arange(len(rows) + 1), (1, 1))
        return cls((0, *(candidates + 1).tolist(), width), np.concatenate([border, inner, border]).astype(float), every)

    def between(self, first: IntArray, last: IntArray) -> IntArray:
        """Whether candidates are sides from rows `first` to rows `last` (n,): 0 for no, `WEAK` or `STRONG`, (n, c)."""
        ends = np.rint((first[:, None] + (last - first)[:, None] * PARTS) / self.every).astype(int)
        ends = np.clip(ends, 0, self.covered.shape[1] - 1)
        shares = np.diff(self.covered[:, ends]) / np.maximum(np.diff(ends), 1)
        least, mean = np.min(shares, axis=-1).T, np.mean(shares, axis=-1).T
        is_weak = (least >= FAINT_PART) & (mean >= FAINT)
        is_strong = (least >= COVERED_PART) & (mean >= COVERED)
        return np.where(is_strong, STRONG, np.where(is_weak, WEAK, 0))


def parts_of(images: Sequence[Image]) -> list[Placement]:
    """Where pictures of one camera may show a frame: between the black borders that all have, and in windows there.

    A window counts if most pictures have it.

    Examples
    --------
    >>> picture = np.zeros((720, 960, 3), np.uint8)
    >>> picture[90:630] = 100
    >>> [one.frame_size for one in parts_of([picture])], [one.is_whole for one in parts_of([picture, picture + 50])]
    ([(960, 540)], [True])
    """
    size = size_of(images[0])
    whole = within_borders(size, np.min([borders_of(image) for image in images], axis=0).tolist())
    found = [windows_of(whole.image_in_frame(image)) for image in images]
    often = max(found, key=lambda some: sum(_are_same(some, other) for other in found))
    if sum(_are_same(often, other) for other in found) <= len(found) / 2:
        often = []
    within = [np.subtract(one, np.tile(whole.corner, 2)).tolist() for one in often]
    return [whole, *(Placement.around(size, left, top, right, bottom) for left, top, right, bottom in within)]


def _are_same(some: Sequence[Window], others: Sequence[Window]) -> bool:
    return len(some) == len(others) and bool(np.all(np.abs(np.subtract(some, others)) <= SAME_IN_CLIP))


def within_borders(image_size: tuple[int, int], borders: tuple[int, int]) -> Placement:
    """Placement of frames between borders: columns left and right, and rows above and below.

    Examples
    --------
    >>> within_borders((960, 720), (0, 90)).frame_size
    (960, 540)
    """
    (width, height), (x, y) = image_size, borders
    return Placement.around(image_size, x, y, width - x, height - y)


def borders_of(image: Image) -> tuple[int, int]:
    """Columns of the black borders left and right, and rows of those above and below; 0 where there are none.

    Examples
    --------
    >>> picture = np.zeros((720, 960, 3), np.uint8)
    >>> picture[90:630] = 100
    >>> borders_of(picture), borders_of(picture[:400])
    ((0, 90), (0, 0))
    """
    rows = _border(image[:, ::EVERY])
    return _border(np.swapaxes(image[rows : len(image) - rows : EVERY], 0, 1)), rows


def _border(pixels: Image) -> int:
    """Height in rows of the smaller of the borders above and below, in pixels (N, M, 3); 0 if there are none."""
    count = len(pixels)
    most = int(THICKEST * count)
    if any(np.median(pixels[end].max(axis=1)) > BLACK for end in (0, -1)):  # quick: most pictures have none
        return 0
    border = min(_black_rows(side.max(axis=2)) for side in (pixels[: most + 1], pixels[: -most - 2 : -1]))
    if not max(round(THINNEST * count), 2) <= border <= most:
        return 0
    ends = np.concatenate([pixels[:border], pixels[count - border :]]).max(axis=2).astype(float)
    return border if np.std(np.minimum(ends, BLACK)) <= EVEN else 0


def _black_rows(rows: NDArray[np.uint8]) -> int:
    """Number of black rows from the first row on."""
    is_black = np.mean(rows > BLACK, axis=1) <= FEW
    return int(len(rows) if np.all(is_black) else np.argmin(is_black))


def windows_of(image: Image) -> list[Window]:
    """Find the windows of a picture to a few pixels, from left to right; none if the picture is one frame.

    Examples
    --------
    >>> picture = np.full((540, 960, 3), 60, np.uint8)
    >>> picture[100:505, 200:920] = np.random.default_rng(0).integers(90, 250, (405, 720, 3))
    >>> windows_of(picture)
    [Window(left=200, top=100, right=919, bottom=504)]
    """
    if min(image.shape[:2]) < SMALLEST:
        return []
    vertical = Sides.of(image)
    horizontal = Sides.of(np.swapaxes(image, 0, 1))
    if len(vertical.at) == len(horizontal.at) == 2:
        return []
    found = _rectangles(vertical, horizontal)
    inner = [one for one in found if not any(_is_within(other, one, size_of(image)) for other in found)]
    windows = _apart([one for one in inner if _may_be_window(one, size_of(image))])
    least = SHOWN * len(image)
    return windows if any(one.bottom - one.top > least for one in windows) else []  # smaller ones are insets


def _rectangles(vertical: Sides, horizontal: Sides) -> list[Window]:
    """Rectangles whose four sides are steps or borders of the picture, and that no side divides."""
    columns, rows = np.array(vertical.at), np.array(horizontal.at)
    across, down = (np.array([*combinations(range(len(at)), 2)]) for at in (columns, rows))
    across = across[np.diff(columns[across])[:, 0] >= NARROWEST * columns[-1]]
    down = down[np.diff(rows[down])[:, 0] >= LOWEST * rows[-1]]
    # a vertical side is only one between the rows of the top and the bottom, so sides are judged for each pair of rows
    upright, level = vertical.between(*rows[down].T), horizontal.between(*columns[across].T)
    certain = np.concatenate([upright[:, across], np.swapaxes(level[:, down], 0, 1)], axis=-1)
    found = []
    for i, j in np.argwhere(np.all(certain > 0, axis=-1)).tolist():
        (left, right), (top, bottom) = columns[across[j]].tolist(), rows[down[i]].tolist()
        one = Window(left, top, right, bottom)
        least = 3 * STRONG + WEAK if _free_sides(one, (columns[-1], rows[-1])) == 4 else 4 * STRONG
        is_divided = _is_divided(columns[upright[i] == STRONG], left, right, columns[-1])
        if np.sum(certain[i, j]) >= least and not is_divided:
            found.append(one)
    return found


def _is_divided(sides: IntArray, first: int, last: int, whole: int) -> bool:
    """Whether any of the sides lies between the sides `first` and `last`, and on neither."""
    gap = SAME * whole
    return bool(np.any((sides > first + gap) & (sides < last - gap)))


def _is_within(inner: Window, outer: Window, size: tuple[int, int]) -> bool:
    """Whether `inner` is `outer` without a narrow frame line around it."""
    off = np.subtract(inner, outer) * (1, 1, -1, -1)
    return bool(np.any(off) and np.all(off >= 0) and np.all(off <= SAME * np.array([*size, *size])))


def _may_be_window(window: Window, size: tuple[int, int]) -> bool:
    """Whether a rectangle has the shape of a window, and not that of a picture divided by a single line.

    It has at least three sides off the picture's border, or an aspect ratio of 16:9 or the picture's, or reaches from
    the top of the picture to the bottom (views side by side). One as wide as the picture counts only if that is upright
    and the margins above and below are equal.
    """
    (width, height), (left, top, right, bottom) = size, window
    if (
        right - left == width
    ):  # a level touchline is as wide, but hardly in an upright picture, or twice at equal heights
        return width < height and top > 0 and abs(top - (height - bottom)) <= SAME * height
    if bottom - top == height:
        return True
    shape = (right - left) / (bottom - top)
    return _free_sides(window, size) > 2 or any(
        abs(np.log(shape / one)) < SAME_SHAPE for one in (width / height, BROADCAST_SHAPE)
    )


def _free_sides(window: Window, size: tuple[int, int]) -> int:
    """Number of sides that are not on the picture's border."""
    return int(np.count_nonzero(np.array(window) != (0, 0, *size)))


def _apart(windows: Sequence[Window]) -> list[Window]:
    """The largest windows that do not overlap, from left to right."""
    found: list[Window] = []
    for one in sorted(windows, key=lambda one: (one.left - one.right) * (one.bottom - one.top)):
        if not any(_overlap(one, other) for other in found):
            found.append(one)
    return sorted(found)


def _overlap(a: Window, b: Window) -> bool:
    return max(a.left, b.left) < min(a.right, b.right) and max(a.top, b.top) < min(a.bottom, b.bottom)
