"""The size of an image from the header of its file, before anything is decoded: OpenCV has no function for that.

A file of a megabyte may state 20,000 x 20,000 pixels, which take more than a gigabyte when they are decoded.
"""

from __future__ import annotations

import struct

from fieldcalib.io.jpeg import BEGIN as JPEG
from fieldcalib.io.jpeg import jpeg_size

PNG, BMP = b"\x89PNG\r\n\x1a\n", b"BM"
TIFF = {b"II": "<", b"MM": ">"}  # byte orders
TIFF_TAGS = (256, 257)  # ImageWidth and ImageLength
TIFF_TYPES = {3: "H", 4: "I", 16: "Q"}  # SHORT, LONG, LONG8


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
        elif content.startswith(JPEG):
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
    """Size in the first directory."""
    if content[2:4] == struct.pack(order + "H", 43):  # BigTIFF
        first, count, entry, offset = 8, "Q", 20, 12
    else:
        first, count, entry, offset = 4, "H", 12, 8
    (start,) = struct.unpack_from(order + ("Q" if count == "Q" else "I"), content, first)
    (entries,) = struct.unpack_from(order + count, content, start)
    start += struct.calcsize(count)
    found: dict[int, int] = {}
    for position in range(start, start + entry * entries, entry):
        tag, kind = struct.unpack_from(order + "HH", content, position)
        if tag in TIFF_TAGS:
            (found[tag],) = struct.unpack_from(order + TIFF_TYPES[kind], content, position + offset)
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
