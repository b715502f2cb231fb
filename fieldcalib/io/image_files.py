"""Images: OpenCV's uint8 arrays (height, width, 3) in blue, green, red; read from files, and drawn pictures written.

They are read so whatever depth and channels the file has, and turned as its EXIF data says.

The size of an image from the header of its file, before anything is decoded: OpenCV has no function for that.
The package imagesize takes the last of two heights in a TIFF, of which OpenCV decodes the first; Pillow has a limit of
pixels of its own, for the whole process, and takes some files for broken that OpenCV reads.

A file of a megabyte may state 20,000 x 20,000 pixels, which take more than a gigabyte when they are decoded.

JPEG: the segments of a file (ITU-T T.81, annex B), and what tells whether all of its pixels are there.
"""

from __future__ import annotations

import os
import re
import struct
import time
from base64 import b64encode
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from threading import Condition
from typing import Any, Generic, TypeAlias, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from fieldcalib._whole_files import write_bytes
from fieldcalib.io.files import BrokenFileError

Image: TypeAlias = NDArray[np.uint8]
JPEG_BEGIN = b"\xff\xd8"
MARKER = re.compile(rb"\xff[^\x00\xff]")
AFTER_SCAN = re.compile(rb"\xff[^\x00\xff\xd0-\xd7]")  # coded pixels hold stuffed zeros and restart markers
RESTART = re.compile(rb"\xff([\xd0-\xd7])")
SCAN, END = 0xDA, 0xD9
START_OF_FRAME = set(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
WITHOUT_LENGTH = {0x01, *range(0xD0, 0xDA)}  # markers that stand alone
ALL_COEFFICIENTS = (1 << 64) - 1  # of a block, one bit each
GREY = 128  # of all colours, where decoders find no coded pixels
MORE = np.random.default_rng(0).integers(0, 255, 256, dtype=np.uint8).tobytes()  # coded pixels of some kind: no markers
PNG, BMP = b"\x89PNG\r\n\x1a\n", b"BM"
TIFF = {b"II": "<", b"MM": ">"}  # byte orders
TIFF_TAGS = (256, 257)  # ImageWidth and ImageLength
TIFF_TYPES = {3: "H", 4: "I"}  # SHORT, LONG
BIG_TIFF_TYPES = {**TIFF_TYPES, 16: "Q"}  # LONG8: of 8 bytes, which lie elsewhere in a TIFF that is no BigTIFF
MOST_PIXELS = 50_000_000  # of an image: 8K has 33 million
IMAGES_AT_ONCE = 8  # in memory
PIXELS_AT_ONCE = 66_000_000  # of all images in memory together: eight of 4K
NOTEBOOK_WIDTH = 960  # px of a picture in a notebook
LONGEST_SIDE = 32_766  # px: cv2.remap counts pixels in 16 bits
AHEAD = 6  # images that are read while others are worked on
MOST_WAITING = 5  # images of a camera that wait, a fifth of a second
NO_IMAGE = "is no image that OpenCV can read: expected a JPEG, PNG, BMP, TIFF or WebP"
Item = TypeVar("Item")


def size_of(image: Image) -> tuple[int, int]:
    """Width and height in pixels."""
    return image.shape[1], image.shape[0]


def checked_image(image: Any, image_size: tuple[int, int] | None = None) -> Image:
    """The image as an array, or a ValueError that says what is wrong with it.

    Parameters
    ----------
    image : (height, width, 3) uint8 array
        In OpenCV's order: blue, green, red. A picture of PIL will do.
    image_size : (int, int), optional
        Width and height of the camera that goes with it.

    Examples
    --------
    >>> checked_image(np.zeros((540, 960), np.uint8))
    Traceback (most recent call last):
        ...
    ValueError: image must be (height, width, 3) in blue, green, red, got shape (540, 960); \
cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) or cv2.COLOR_BGRA2BGR makes it so
    """
    if image is None:
        raise ValueError("image is None: cv2.imread returns it for a file that is not there or cannot be read")
    if isinstance(image, str | os.PathLike):
        path = os.fspath(image)
        raise ValueError(f"image must be an array (height, width, 3), got the path {path!r}; cv2.imread reads it")
    if hasattr(image, "getbands"):  # a picture of PIL, whose arrays are red, green, blue
        image = np.asarray(image.convert("RGB"))[..., ::-1]
    if isinstance(image, list | tuple):
        raise ValueError(f"image must be an array (height, width, 3) of uint8, got a {type(image).__name__}")
    array = np.asarray(image)
    if array.dtype == object or array.ndim < 2:
        raise ValueError(f"image must be an array (height, width, 3) of uint8, got {type(image).__name__}")
    if array.dtype != np.uint8:
        raise ValueError(
            f"image must be uint8, got {array.dtype}; for values in 0..1 pass (255 * image).round().astype(np.uint8)"
        )
    if array.ndim != 3 or array.shape[2] != 3 or not array.size:
        raise ValueError(
            f"image must be (height, width, 3) in blue, green, red, got shape {array.shape}; "
            f"{_remedy_for(array.shape)} makes it so"
        )
    if image_size is not None and array.shape[1::-1] != image_size:
        width, height = array.shape[1::-1]
        raise ValueError(
            f"image must have the camera's size, {image_size[0]} x {image_size[1]}, got {width} x {height}; "
            f"pass camera.scaled(({width}, {height})) or resize the image"
        )
    return array


def _remedy_for(shape: tuple[int, ...]) -> str:
    """What makes an image of an array of another shape."""
    if 0 in shape:
        return "a picture with pixels"
    if len(shape) == 3 and shape[0] == 3:
        return "image.transpose(1, 2, 0)"
    return "cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) or cv2.COLOR_BGRA2BGR"


def each_checked(images: Iterable[Any]) -> Iterator[Image]:
    """Check several images by `checked_image`, each when it is asked for.

    Examples
    --------
    >>> len(list(each_checked(np.zeros((540, 960, 3), np.uint8) for _ in range(2))))
    2
    """
    if isinstance(images, np.ndarray) and images.ndim < 4:
        raise ValueError(f"expected a list of images, got one array of shape {images.shape}: give [image]")
    if isinstance(images, str | os.PathLike) or not isinstance(images, Iterable):
        raise ValueError(f"expected a list of images, got {images!r}")
    return map(checked_image, images)


def segments(content: bytes) -> Iterator[tuple[int, int]]:
    """The kinds of the markers up to the end of the image, each with the position of what follows it.

    Thumbnails lie within segments, and other data may follow the image, as in the motion photos of phones.

    Raises
    ------
    struct.error
        If there is no end.
    """
    position, pattern = len(JPEG_BEGIN), MARKER
    while marker := pattern.search(content, position):
        kind, position = marker.group()[1], marker.end()
        yield kind, position
        if kind == END:
            return
        if kind not in WITHOUT_LENGTH:
            position += struct.unpack_from(">H", content, position)[0]
        pattern = AFTER_SCAN if kind == SCAN else MARKER
    raise struct.error("no end of the image")


def jpeg_size(content: bytes) -> tuple[int, int]:
    """Width and height in the first frame header; a struct.error if there is none."""
    for kind, position in segments(content):
        if kind in START_OF_FRAME:
            height, width = struct.unpack_from(">HH", content, position + 3)
            return width, height
    raise struct.error("no frame header")


@dataclass(frozen=True)
class CodedPixels:
    """The coded pixels of a file."""

    has_all_scans: bool
    """Whether the scans have all coefficients of all components, to their last bit."""
    begin: int
    """Position of the last scan."""
    end: int
    """Position of what follows it."""

    @classmethod
    def of(cls, content: bytes) -> CodedPixels:
        r"""Find the coded pixels of a file; a struct.error if the end of the image is missing.

        Examples
        --------
        >>> CodedPixels.of(JPEG_BEGIN + b"\xff\xd9 and other data").end
        4
        >>> CodedPixels.of(JPEG_BEGIN + b"\xff\xe1\x00\x04\xff\xd9")
        Traceback (most recent call last):
            ...
        struct.error: no end of the image
        """
        begin, end, components = len(JPEG_BEGIN), 0, b""
        found: dict[int, int] = {}  # bits by component, one for each coefficient
        for kind, position in segments(content):
            if end <= begin:
                end = position
            if kind in START_OF_FRAME:
                components = content[position + 7 : position + 8]
            elif kind == SCAN:
                begin = position
                for component, bits in _scanned(content, position):
                    found[component] = found.get(component, 0) | bits
        has_all = bytes([len(found)]) == components and all(bits == ALL_COEFFICIENTS for bits in found.values())
        return cls(has_all, begin, end)

    def may_be_missing(self, image: Image) -> bool:
        """Whether some may be missing: a corner of the image is as grey as where there are none, or scans are missing.

        Pictures may have such corners, and the standard asks for no scan that only adds detail: `with_more` tells them
        apart.
        """
        corners = image[[0, -1]][:, [0, -1]]  # the last one of the coded picture, which may be turned
        return not self.has_all_scans or bool(np.any(np.all(corners == GREY, axis=-1)))

    def with_more(self, content: bytes) -> bytes:
        """The file with more coded pixels: where none are missing they change nothing.

        Decoders read as many as the image has, and skip others; in the place of missing ones they see noise.
        """
        end = len(content[: self.end - 2].rstrip(b"\xff"))  # without the marker and fill bytes before it
        restarts = RESTART.findall(content, self.begin, end)
        restart = bytes([0xFF, 0xD0 + (restarts[-1][0] - 0xD0 + 1) % 8 if restarts else 0xD0])
        return content[:end] + MORE + restart + MORE + content[end:]


def _scanned(content: bytes, position: int) -> Iterator[tuple[int, int]]:
    """The components of a scan, each with the bits of the coefficients that it has to their last bit."""
    (length,) = struct.unpack_from(">H", content, position)
    header = content[position + 2 : position + length].ljust(4, b"\0")
    first, last, approximation = header[-3:]
    bits = (1 << last + 1) - (1 << first) if approximation & 15 == 0 else 0
    return ((component, bits) for component in header[1:-3:2])


def stored_size(content: bytes) -> tuple[int, int] | None:
    """Width and height that a JPEG, PNG, BMP, TIFF or WebP file states; None if it is none of these.

    Examples
    --------
    >>> stored_size(b"BM" + bytes(12) + struct.pack("<Iii", 40, 960, -540))
    (960, 540)
    """
    try:
        if content.startswith(PNG):
            width, height = struct.unpack_from(">II", content, 16)
        elif content.startswith(BMP):
            (header,) = struct.unpack_from("<I", content, 14)
            width, height = struct.unpack_from("<HH" if header == 12 else "<ii", content, 18)
        elif content.startswith(JPEG_BEGIN):
            width, height = jpeg_size(content)
        elif content[:2] in TIFF:
            width, height = _tiff_size(content, TIFF[content[:2]])
        elif content[:4] == b"RIFF" and content[8:12] == b"WEBP":
            width, height = _webp_size(content)
        else:
            return None
    except (struct.error, KeyError, OverflowError):  # cut off, or a TIFF without a size or with absurd offsets
        return None
    return abs(width), abs(height)  # the rows of a BMP may run upwards


def _tiff_size(content: bytes, order: str) -> tuple[int, int]:
    """Size in the first directory: of a tag that is there twice the first one, which decoders take."""
    if content[2:4] == struct.pack(order + "H", 43):  # BigTIFF
        first, count, entry, offset, types = 8, "Q", 20, 12, BIG_TIFF_TYPES
    else:
        first, count, entry, offset, types = 4, "H", 12, 8, TIFF_TYPES
    (start,) = struct.unpack_from(order + ("Q" if count == "Q" else "I"), content, first)
    (entries,) = struct.unpack_from(order + count, content, start)
    start += struct.calcsize(count)
    found: dict[int, int] = {}
    for position in range(start, start + entry * entries, entry):
        tag, kind = struct.unpack_from(order + "HH", content, position)
        if tag in TIFF_TAGS:
            (found[tag],) = struct.unpack_from(order + types[kind], content, position + offset)
        if len(found) == len(TIFF_TAGS):
            break
    width, height = (found[tag] for tag in TIFF_TAGS)
    return width, height


def _webp_size(content: bytes) -> tuple[int, int]:
    """Size in the first chunk: lossy, lossless or extended."""
    kind = content[12:16]
    if kind == b"VP8 ":
        width, height = struct.unpack_from("<HH", content, 26)
        return width & 0x3FFF, height & 0x3FFF
    if kind == b"VP8L":
        (bits,) = struct.unpack_from("<I", content, 21)
        return (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1
    low, high = struct.unpack_from("<IH", content, 24)  # two numbers of 24 bits
    return (low & 0xFFFFFF) + 1, (low >> 24 | high << 8) + 1


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
    if not content.startswith(JPEG_BEGIN):
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


def html_picture(image: Image, alt: str) -> str:
    """An image as an element of HTML, for a notebook."""
    data = b64encode(encode_image(at_most_wide(image, NOTEBOOK_WIDTH), ".jpg")).decode()
    return f'<img alt="{alt}" src="data:image/jpeg;base64,{data}">'


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


class Newest(Generic[Item]):
    """Reads items in a thread as they come, and yields those that came last, each with the time when it came.

    While an item is worked on, others come: up to `MOST_WAITING` of them wait, older ones are dropped. Times are those
    of `time.monotonic`. An error of the items is raised when those before it were yielded.

    Examples
    --------
    >>> newest = Newest(range(3))
    >>> [item for item, arrived in newest], newest.dropped
    ([0, 1, 2], 0)
    """

    def __init__(self, items: Iterable[Item]) -> None:
        self._items = iter(items)
        self._waiting = deque[tuple[Item, float]]()
        self._changed = Condition()
        self._is_left = False
        self.dropped = 0
        """Number of items that were dropped so far."""

    def __iter__(self) -> Iterator[tuple[Item, float]]:
        with ThreadPoolExecutor(1) as reader:
            end = reader.submit(self._read)
            end.add_done_callback(lambda _: self._notify())
            try:
                while True:
                    with self._changed:
                        self._changed.wait_for(lambda: bool(self._waiting) or end.done())
                        if not self._waiting:
                            break
                        one = self._waiting.popleft()
                    yield one
            finally:
                self._is_left = True
            end.result()

    def _notify(self) -> None:
        with self._changed:
            self._changed.notify()

    def _read(self) -> None:
        for item in self._items:
            with self._changed:
                if self._is_left:
                    return
                self._waiting.append((item, time.monotonic()))
                if len(self._waiting) > MOST_WAITING:
                    self._waiting.popleft()
                    self.dropped += 1
                self._changed.notify()


def spread(count: int, most: int) -> list[int]:
    """Up to `most` of the numbers below `count`, evenly spread.

    Examples
    --------
    >>> spread(10, 4), spread(2, 4)
    ([0, 3, 6, 9], [0, 1])
    """
    return [round(k) for k in np.linspace(0, count - 1, min(count, most)).tolist()]


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
