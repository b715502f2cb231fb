"""JPEG: the segments of a file (ITU-T T.81, annex B), and what tells whether all of its pixels are there."""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from fieldcalib.io.image import Image

BEGIN = b"\xff\xd8"
MARKER = re.compile(rb"\xff[^\x00\xff]")
AFTER_SCAN = re.compile(rb"\xff[^\x00\xff\xd0-\xd7]")  # coded pixels hold stuffed zeros and restart markers
RESTART = re.compile(rb"\xff([\xd0-\xd7])")
SCAN, END = 0xDA, 0xD9
START_OF_FRAME = set(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
WITHOUT_LENGTH = {0x01, *range(0xD0, 0xDA)}  # markers that stand alone
ALL_COEFFICIENTS = (1 << 64) - 1  # of a block, one bit each
GREY = 128  # of all colours, where decoders find no coded pixels
MORE = np.random.default_rng(0).integers(0, 255, 256, dtype=np.uint8).tobytes()  # coded pixels of some kind: no markers


def segments(content: bytes) -> Iterator[tuple[int, int]]:
    """The kinds of the markers up to the end of the image, each with the position of what follows it.

    Thumbnails lie within segments, and other data may follow the image, as in the motion photos of phones.

    Raises
    ------
    struct.error
        If there is no end.
    """
    position, pattern = len(BEGIN), MARKER
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
        >>> CodedPixels.of(BEGIN + b"\xff\xd9 and other data").end
        4
        >>> CodedPixels.of(BEGIN + b"\xff\xe1\x00\x04\xff\xd9")
        Traceback (most recent call last):
            ...
        struct.error: no end of the image
        """
        begin, end, components = len(BEGIN), 0, b""
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
