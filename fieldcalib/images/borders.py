"""Black borders around the part of a picture that is shown: letterboxes and pillarboxes.

Borders are black, even, and equal on opposite sides: night skies and dark stands are on one side, or have structure.
They are compressed with the picture, so black is not quite zero, and their last rows show a little of the picture.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fieldcalib.assess.placement import Crop, Placement, Shape
from fieldcalib.io.image import Image

BLACK = 30  # brightest channel; black of video is 16
FEW = 0.02  # share of brighter pixels that a black row may have: noise, a logo
EVEN = 4.0  # largest standard deviation of the brightness of a border; dark stands have more
SMALLEST, LARGEST = 0.01, 0.35  # shares of the picture's height or width that one border takes
STEP = 3  # one pixel in three of each row is used


def shown_part(image: Image) -> Placement:
    """The placement of a picture between black borders: above and below, left and right, or both.

    Examples
    --------
    >>> picture = np.zeros((720, 960, 3), np.uint8)
    >>> picture[90:630] = 100
    >>> shown_part(picture).crop
    Crop(frame_size=(960, 540), corner=(0, -90))
    >>> shown_part(picture[:400]).is_whole
    True
    """
    height, width = image.shape[:2]
    rows = _border(image[:, ::STEP])
    columns = _border(np.swapaxes(image[rows : height - rows : STEP], 0, 1))
    return within_borders((width, height), (columns, rows))


def within_borders(image_size: tuple[int, int], border: tuple[int, int]) -> Placement:
    """The placement of frames between borders of `border` columns left and right, and rows above and below.

    Examples
    --------
    >>> within_borders((960, 720), (0, 90)).frame_size
    (960, 540)
    """
    (width, height), (x, y) = image_size, border
    crop = Crop((width - 2 * x, height - 2 * y), (-x, -y)) if x or y else None
    return Placement(image_size, image_size, crop)


def shape_within(placement: Placement) -> Shape:
    """The shape of frames between borders; its message describes the borders, and is empty without any."""
    if placement.is_whole:
        return Shape(placement)
    (width, height), (x, y) = placement.frame_size, placement.corner
    return Shape(placement, f"without black borders: {width} x {height} at {-x}, {-y}")


def _border(pixels: Image) -> int:
    """Rows of the smaller of the borders above and below pixels (N, M, 3); 0 if there are none."""
    count = len(pixels)
    most = int(LARGEST * count)
    least = max(round(SMALLEST * count), 2)
    if any(np.median(pixels[end].max(axis=1)) > BLACK for end in (0, -1)):  # quick: most pictures have none
        return 0
    first, last = (_black_rows(side.max(axis=2)) for side in (pixels[: most + 1], pixels[: -most - 2 : -1]))
    border = min(first, last)
    if not least <= border <= most:
        return 0
    ends = np.concatenate([pixels[:border], pixels[count - border :]]).max(axis=2).astype(float)
    return border if np.std(np.minimum(ends, BLACK)) <= EVEN else 0


def _black_rows(rows: NDArray[np.uint8]) -> int:
    """Number of black rows from the first one on."""
    is_black = np.mean(rows > BLACK, axis=1) <= FEW
    return int(len(rows) if np.all(is_black) else np.argmin(is_black))
