"""Images for the page: whole pictures at the size that is shown, and parts of them at full resolution, as JPEG."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from threading import Lock

import numpy as np

from fieldcalib.io.image import Image
from fieldcalib.io.images import at_most_wide
from fieldcalib.run_folder.numbered_frames import NumberedFrames

QUALITY = 88  # of the JPEGs
CACHE_BYTES = 48_000_000  # of the JPEGs in memory
LARGEST = 8192  # px: width of what is sent


class ShownPictures:
    """JPEGs of the frames of an editor; those that were asked for last are kept."""

    def __init__(self, frames: NumberedFrames) -> None:
        self._frames = frames
        self._kept: OrderedDict[tuple[int, ...], bytes] = OrderedDict()
        self._lock = Lock()

    def whole(self, number: int, width: int) -> bytes:
        """A frame, at most `width` pixels wide."""
        return self._jpeg((number, width), lambda image: image, width)

    def crop(self, number: int, corner: tuple[int, int], size: tuple[int, int], width: int) -> bytes:
        """The part of a frame from a corner (x, y) on, at most `width` pixels wide.

        Raises
        ------
        ValueError
            If it is outside the picture.
        """

        def part(image: Image) -> Image:
            height, full = image.shape[:2]
            low = np.maximum(corner, 0)
            high = np.minimum(np.add(corner, size), (full, height))
            if np.any(high <= low):
                raise ValueError(
                    f"expected a part of a picture of {full} x {height}, got {size} pixels from {corner} on"
                )
            return image[low[1] : high[1], low[0] : high[0]]

        return self._jpeg((number, *corner, *size, width), part, width)

    def _jpeg(self, key: tuple[int, ...], part: Callable[[Image], Image], width: int) -> bytes:
        with self._lock:
            if key in self._kept:
                self._kept.move_to_end(key)
                return self._kept[key]
        content = jpeg(part(self._frames.image(key[0])), width)
        with self._lock:
            self._kept[key] = content
            while len(self._kept) > 1 and sum(map(len, self._kept.values())) > CACHE_BYTES:
                self._kept.popitem(last=False)
        return content


def jpeg(image: Image, width: int) -> bytes:
    """An image as JPEG, at most `width` pixels wide."""
    import cv2

    _, content = cv2.imencode(".jpg", at_most_wide(image, width), [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    return content.tobytes()
