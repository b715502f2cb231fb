"""Images: read, and drawn pictures written.

Images are OpenCV's: uint8, (height, width, 3), blue, green, red, whatever depth and channels the file has; turned as
its EXIF data says.
"""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TypeVar, cast

import numpy as np

from fieldcalib.io.files import BrokenFileError, write_bytes
from fieldcalib.io.image import Image
from fieldcalib.io.image_header import JPEG_BEGIN as JPEG
from fieldcalib.io.image_header import CodedPixels, stored_size

MOST_PIXELS = 50_000_000  # of an image: 8K has 33 million
IMAGES_AT_ONCE = 8  # in memory
PIXELS_AT_ONCE = 66_000_000  # of all images in memory together: eight of 4K
LONGEST_SIDE = 32_766  # px: cv2.remap counts pixels in 16 bits

AHEAD = 6  # images that are read while others are worked on

NO_IMAGE = "is no image that OpenCV can read: expected a JPEG, PNG, BMP, TIFF or WebP"

Item = TypeVar("Item")


def parse_image(content: bytes, most_pixels: float = MOST_PIXELS) -> Image:
    """The image in the content of a JPEG, PNG, BMP, TIFF or WebP file.

    Raises
    ------
    BrokenFileError
        If it is no image, a JPEG that is cut off or has not all pixels (its lower part would be grey), or has too many
        of them, see `check_pixels`.

    Examples
    --------
    >>> parse_image(b"no image")
    Traceback (most recent call last):
        ...
    fieldcalib.io.files.BrokenFileError: is no image that OpenCV can read: expected a JPEG, PNG, BMP, TIFF or WebP
    """
    coded = _coded_pixels(content)
    size = stored_size(content)
    if size is None:
        raise BrokenFileError(NO_IMAGE)
    check_pixels(size, most_pixels)
    image = _decoded(content)
    if image is None:
        raise BrokenFileError(NO_IMAGE)
    if coded is not None and coded.may_be_missing(image):
        again = _decoded(coded.with_more(content))
        if again is None or not np.array_equal(image, again):
            raise BrokenFileError("is damaged: the JPEG has an end, but not all pixels before it")
    return image


def _coded_pixels(content: bytes) -> CodedPixels | None:
    """The coded pixels of a JPEG; None of other files."""
    if not content.startswith(JPEG):
        return None
    try:
        return CodedPixels.of(content)
    except struct.error:
        raise BrokenFileError("is cut off: the end of the JPEG is missing") from None


def _decoded(content: bytes) -> Image | None:
    import cv2

    try:
        image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR)
    except cv2.error:  # dimensions that no image has
        return None
    return None if image is None else np.asarray(image, dtype=np.uint8)


def check_pixels(size: tuple[int, int], most_pixels: float) -> None:
    """Raise a BrokenFileError if an image of this width and height has too many pixels, or a side is too long."""
    width, height = size
    if width * height > most_pixels:
        raise BrokenFileError(
            f"has {width} x {height} pixels, more than {most_pixels / 1e6:g} million; --max-megapixels of a command "
            f"allows more"
        )
    if max(size) > LONGEST_SIDE:
        raise BrokenFileError(f"has {width} x {height} pixels: OpenCV's functions take up to {LONGEST_SIDE} a side")


def encode_image(image: Image, suffix: str = ".jpg") -> bytes:
    """The content of an image file in the format of a suffix."""
    import cv2

    try:
        done, content = cv2.imencode(suffix, image)
    except cv2.error:  # OpenCV 4 raises, 5 returns False
        done = False
    if not done:
        raise ValueError(f"OpenCV cannot write an image of shape {image.shape} as {suffix}")
    return content.tobytes()


def at_most_wide(image: Image, width: int) -> Image:
    """An image, reduced to a width if it is wider.

    Examples
    --------
    >>> at_most_wide(np.zeros((90, 160, 3), np.uint8), 80).shape, at_most_wide(np.zeros((9, 16, 3), np.uint8), 80).shape
    ((45, 80, 3), (9, 16, 3))
    """
    import cv2

    height, full = image.shape[:2]
    if full <= width:
        return image
    size = (width, max(round(height * width / full), 1))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)


def write_image(path: Path, image: Image) -> None:
    """Write an image in the format of the path's suffix, whole or not at all."""
    write_bytes(path, encode_image(image, path.suffix))


def read_ahead(items: Iterable[Item], count: int = AHEAD) -> Iterator[Item]:
    """Read up to `count` items in advance in a thread, so that decoding a video takes no extra time.

    Examples
    --------
    >>> list(read_ahead(range(3)))
    [0, 1, 2]
    """
    rest, end = iter(items), object()
    with ThreadPoolExecutor(1) as reader:
        ready = deque(reader.submit(next, rest, end) for _ in range(count))
        try:
            while (item := ready.popleft().result()) is not end:
                ready.append(reader.submit(next, rest, end))
                yield cast(Item, item)
        finally:
            reader.shutdown(cancel_futures=True)


def in_parts(items: Iterable[Item], size: int, pixels: Callable[[Item], int] = lambda item: 0) -> Iterator[list[Item]]:
    """Lists of up to `size` items, and of less if they have more than `PIXELS_AT_ONCE` pixels together.

    Examples
    --------
    >>> list(in_parts("abcde", 2))
    [['a', 'b'], ['c', 'd'], ['e']]
    """
    part: list[Item] = []
    for item in items:
        part.append(item)
        if len(part) == size or sum(map(pixels, part)) > PIXELS_AT_ONCE:
            yield part
            part = []
    if part:
        yield part
