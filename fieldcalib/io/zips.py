"""Members of zips, unpacked part by part: what a part becomes in memory is bounded."""

from __future__ import annotations

import bz2
import copy
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from typing import IO, Protocol
from zipfile import ZIP_BZIP2, ZIP_STORED, BadZipFile, ZipFile, ZipInfo

PACKED_AT_ONCE = 4096  # bytes


class Readable(Protocol):
    """A file that is read from its beginning to its end."""

    def read(self, count: int, /) -> bytes:
        """At most that many bytes; none at the end."""


@contextmanager
def open_member(archive: ZipFile, member: ZipInfo) -> Iterator[Readable]:
    """Open a member of a zip, to be read in parts.

    Errors are those of `zipfile`, of many classes.
    """
    if member.compress_type != ZIP_BZIP2:
        with archive.open(member) as file:
            yield file
        return
    packed = copy.copy(member)
    packed.compress_type, packed.file_size = ZIP_STORED, member.compress_size
    del packed.CRC  # that of the unpacked content
    with archive.open(packed) as file:
        yield _Bzip2Member(file, member.CRC)


class _Bzip2Member:
    """A member in bzip2, unpacked as far as it is read. `zipfile` unpacks 4 kB as a whole, to 10 GB at most."""

    def __init__(self, packed: IO[bytes], checksum: int) -> None:
        self._packed, self._expected, self._checksum = packed, checksum, 0
        self._unpacker = bz2.BZ2Decompressor()

    def read(self, count: int, /) -> bytes:
        part = b""
        while not part and not self._unpacker.eof:
            packed = self._packed.read(PACKED_AT_ONCE) if self._unpacker.needs_input else b""
            if self._unpacker.needs_input and not packed:
                raise BadZipFile("its end is missing")
            part = self._unpacker.decompress(packed, count)
        self._checksum = zlib.crc32(part, self._checksum)
        if self._unpacker.eof and not part and self._checksum != self._expected:
            raise BadZipFile("its checksum is not that in the zip")
        return part
