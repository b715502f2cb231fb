"""JPEG images of frames: for the page, whole or in part (`ShownPictures`); and small ones for a report (`Thumbnails`).

The page shows whole pictures at reduced size, and parts of them at full resolution. The number and size of thumbnails
are limited by a budget of bytes.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from dataclasses import field as attribute
from threading import Lock

import numpy as np

from fieldcalib.io.frame_source import FrameSource
from fieldcalib.io.image_files import Image, at_most_wide, parse_image

QUALITY = 88  # of JPEGs for the page
CACHE_BYTES = 48_000_000  # of JPEGs in memory
LARGEST = 8192  # px: largest width of a picture that is sent

PICTURES = 240  # largest number of thumbnails
WIDTHS = (1280, 960, 720, 560, 400, 280)  # px: widths of thumbnails, of which the first is taken with which all fit
THUMBNAIL_QUALITY = 82  # of JPEGs for a report


class ShownPictures:
    """JPEGs of the frames of an editor; the last used ones are cached."""

    def __init__(self, frames: FrameSource) -> None:
        self._frames = frames
        self._kept: OrderedDict[tuple[int, ...], bytes] = OrderedDict()
        self._lock = Lock()

    def whole(self, number: int, width: int) -> bytes:
        """JPEG of a frame, at most `width` pixels wide."""
        return self._jpeg((number, width), lambda image: image, width)

    def crop(self, number: int, corner: tuple[int, int], size: tuple[int, int], width: int) -> bytes:
        """JPEG of the part of a frame with the upper left `corner` (x, y), at most `width` pixels wide.

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


def jpeg(image: Image, width: int, quality: int = QUALITY) -> bytes:
    """Encode an image as JPEG, at most `width` pixels wide."""
    import cv2

    _, content = cv2.imencode(".jpg", at_most_wide(image, width), [cv2.IMWRITE_JPEG_QUALITY, quality])
    return content.tobytes()


@dataclass
class Thumbnails:
    """Pictures of some frames as JPEG, which are made smaller as their number grows, to stay within a budget of bytes.

    Examples
    --------
    >>> thumbnails = Thumbnails(["a", "b"], most_bytes=30_000)
    >>> noise = np.random.default_rng(0).integers(0, 255, (540, 960, 3), dtype=np.uint8)
    >>> for id in ("a", "b", "c"):
    ...     thumbnails.add(id, noise)
    >>> sorted(thumbnails.jpegs), thumbnails.width < 960, thumbnails.size <= 30_000
    (['a', 'b'], True, True)
    """

    wanted: Sequence[str]
    """Ids of frames, the most important ones first."""
    most_bytes: float
    jpegs: dict[str, bytes] = attribute(default_factory=dict)
    """Pictures by id."""
    width: int = WIDTHS[0]
    """Present largest width of a picture, px."""

    def __post_init__(self) -> None:
        self._ranks = {id: rank for rank, id in enumerate(self.wanted)}

    @property
    def size(self) -> int:
        """Bytes of all pictures."""
        return sum(map(len, self.jpegs.values()))

    def add(self, id: str, image: Image) -> None:
        """Add the image of a frame, if it is wanted."""
        if id not in self._ranks:
            return
        self.jpegs[id] = jpeg(image, self.width, THUMBNAIL_QUALITY)
        while self.size > self.most_bytes:
            self._shrink()

    def _shrink(self) -> None:
        """Make all pictures smaller or, at the smallest size, leave the least important one out."""
        narrower = [width for width in WIDTHS if width < self.width]
        if not narrower:
            del self.jpegs[max(self.jpegs, key=self._ranks.__getitem__)]
            return
        self.width = narrower[0]
        self.jpegs = {id: jpeg(parse_image(one), self.width, THUMBNAIL_QUALITY) for id, one in self.jpegs.items()}


def frames_to_show(count: int, worst: Sequence[int], most: int = PICTURES) -> list[int]:
    """Choose the frames that get a picture: alternately one of the worst, and one of frames spread over all.

    Parameters
    ----------
    count : int
        Number of all frames.
    worst : sequence of int
        The worst frames, worst first.
    most : int
        Number of pictures.

    Examples
    --------
    >>> frames_to_show(100, [71, 72], most=6)
    [71, 0, 72, 64, 32, 96]
    """
    bits = max(count - 1, 1).bit_length()
    spread = sorted(range(count), key=lambda number: f"{number:0{bits}b}"[::-1])  # by halves, quarters, ...
    turns = [number for pair in zip(worst, spread, strict=False) for number in pair]
    return list(dict.fromkeys([*turns, *worst[len(spread) :], *spread[len(worst) :]]))[:most]
