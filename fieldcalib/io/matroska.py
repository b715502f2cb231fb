"""Matroska files (MKV, WebM), as far as it takes to see that their end is missing."""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO

HEADER, SEGMENT = b"\x1a\x45\xdf\xa3", b"\x18\x53\x80\x67"  # ids of the two elements that such a file has
LONGEST = 8  # bytes of a size
UNKNOWN = 0  # size of a live recording


def missing_bytes(path: Path) -> int:
    """Number of bytes that are missing at the end of a Matroska file; 0 for any other file, or if it does not say.

    The size of an element is a number of 1 to 8 bytes: the zeros before its first bit count the further bytes.
    """
    with path.open("rb") as file:
        if file.read(len(HEADER)) != HEADER:
            return 0
        file.seek(_size(file), 1)
        if file.read(len(SEGMENT)) != SEGMENT:
            return 0
        size = _size(file)
        end = file.tell() + size
    return max(end - path.stat().st_size, 0) if size != UNKNOWN else 0


def _size(file: BinaryIO) -> int:
    first = file.read(1)
    if not first or not first[0]:
        return UNKNOWN
    length = LONGEST + 1 - first[0].bit_length()
    bits = 7 * length
    value = int.from_bytes(first + file.read(length - 1), "big") & ((1 << bits) - 1)
    return UNKNOWN if value == (1 << bits) - 1 else value
