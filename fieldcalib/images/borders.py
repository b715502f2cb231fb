"""Black borders around the part of a picture that is shown: letterboxes and pillarboxes.

Borders are the same on opposite sides, black, and even: night skies and dark stands are on one side, or have structure.
They are compressed with the picture, so black is not quite zero, and a little of the picture is in their last rows.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fieldcalib.assess.result import Calibration
from fieldcalib.geometry.camera import Camera
from fieldcalib.io.image import Image

BLACK = 30  # brightest channel; black of video is 16
FEW = 0.02  # share of the pixels of a row that may be brighter: noise, a logo does not end a border
EVEN = 4.0  # standard deviation of the brightness of a border; of dark stands it is more
LEAST, LARGEST = 0.01, 0.35  # share of the picture's height or width, of each of two borders
STEP = 3  # pixels along a row, of which one is looked at


@dataclass(frozen=True)
class Shown:
    """The part of a picture that is shown."""

    image_size: tuple[int, int]
    """Size of the whole picture."""
    corner: tuple[int, int] = (0, 0)
    """Pixel of the picture that is the part's first one."""
    size: tuple[int, int] | None = None
    """Size of the part; None if it is the whole picture."""

    @property
    def is_whole(self) -> bool:
        """Whether there are no borders."""
        return self.size is None

    def part(self, image: Image) -> Image:
        """The part of the picture."""
        if self.size is None:
            return image
        (x, y), (width, height) = self.corner, self.size
        return np.ascontiguousarray(image[y : y + height, x : x + width])

    def in_picture(self, calibration: Calibration) -> Calibration:
        """A calibration of the part with its cameras in the picture's pixels, and its errors in the part's."""
        if self.size is None or calibration.camera is None:
            return calibration
        (x, y), (width, height) = self.corner, self.size
        said = f"{calibration.message}; without black borders: {width} x {height} at {x}, {y}"
        others = tuple(map(self._camera, calibration.alternatives))
        return replace(calibration, camera=self._camera(calibration.camera), alternatives=others, message=said)

    def _camera(self, camera: Camera) -> Camera:
        return camera.cropped((-self.corner[0], -self.corner[1]), self.image_size)


def shown_part(image: Image) -> Shown:
    """The part of a picture between black borders above and below it, or left and right of it, or both.

    Examples
    --------
    >>> picture = np.zeros((720, 960, 3), np.uint8)
    >>> picture[90:630] = 100
    >>> shown_part(picture)
    Shown(image_size=(960, 720), corner=(0, 90), size=(960, 540))
    >>> shown_part(picture[:400]).is_whole
    True
    """
    height, width = image.shape[:2]
    rows = _border(image[:, ::STEP])
    columns = _border(np.swapaxes(image[rows : height - rows : STEP], 0, 1))
    if not (rows or columns):
        return Shown((width, height))
    return Shown((width, height), (columns, rows), (width - 2 * columns, height - 2 * rows))


def _border(pixels: Image) -> int:
    """Rows (N, M, 3) of the smaller one of two opposite borders, 0 if there are none."""
    count = len(pixels)
    most = int(LARGEST * count)
    least = max(round(LEAST * count), 2)
    if any(np.median(pixels[end].max(axis=1)) > BLACK for end in (0, -1)):  # quick: most pictures have none
        return 0
    first, last = (_black_rows(side.max(axis=2)) for side in (pixels[: most + 1], pixels[: -most - 2 : -1]))
    border = min(first, last)
    if not least <= border <= most:
        return 0
    ends = np.concatenate([pixels[:border], pixels[count - border :]]).max(axis=2).astype(float)
    return border if np.std(np.minimum(ends, BLACK)) <= EVEN else 0


def _black_rows(rows: NDArray[np.uint8]) -> int:
    """How many rows are black, from the first one on."""
    is_black = np.mean(rows > BLACK, axis=1) <= FEW
    return int(len(rows) if np.all(is_black) else np.argmin(is_black))
