"""The files of frames: found in folders and zips, and read up to a size.

Members of zips are unpacked part by part: what a part becomes in memory is bounded.

YAML, as far as JSON could hold it too: without aliases, and without keys that are given twice.
"""

from __future__ import annotations

import bz2
import copy
import json
import math
import os
import re
import stat
import zipfile
import zlib
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import IO, Any, Protocol, TypeAlias

import yaml

PACKED_AT_ONCE = 4096  # bytes
HIDDEN = re.compile(r"\.")
ESCAPE = re.compile(r"\\u(dc[89a-f][0-9a-f])")  # bytes from 128 on in Python's names of files
YAML = (".yaml", ".yml")
MOST_BYTES = 64_000_000  # of a file: a million labelled pixels are 50 MB of JSON
LONGEST_ID = 240  # bytes: with "overlay_" and ".jpg" around it, it is still a file's name (255)
READ_AT_ONCE = 4096  # bytes: LZMA unpacks each part as a whole, to 7000 times that at most
# Errors of reading nested JSON whose lists, numbers and keys are not what they should be.
WRONG_RECORD = (ValueError, KeyError, TypeError, IndexError, AttributeError, ArithmeticError)
Zipped: TypeAlias = tuple[zipfile.ZipFile, zipfile.ZipInfo]


class Readable(Protocol):
    """A file that is read from its beginning to its end."""

    def read(self, count: int, /) -> bytes:
        """At most that many bytes; none at the end."""


@contextmanager
def open_member(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> Iterator[Readable]:
    """Open a member of a zip, to be read in parts.

    Errors are those of `zipfile`, of many classes.
    """
    if member.compress_type != zipfile.ZIP_BZIP2:
        with archive.open(member) as file:
            yield file
        return
    packed = copy.copy(member)
    packed.compress_type, packed.file_size = zipfile.ZIP_STORED, member.compress_size
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
                raise zipfile.BadZipFile("its end is missing")
            part = self._unpacker.decompress(packed, count)
        self._checksum = zlib.crc32(part, self._checksum)
        if self._unpacker.eof and not part and self._checksum != self._expected:
            raise zipfile.BadZipFile("its checksum is not that in the zip")
        return part


class BrokenFileError(ValueError):
    """A file that does not hold what its format promises; the message says what is wrong with it."""


@contextmanager
def named_in_errors(path: object) -> Iterator[None]:
    """Let the message of a BrokenFileError begin with the path or name of its file."""
    try:
        yield
    except BrokenFileError as error:
        raise BrokenFileError(f"{path}: {error}") from None


@dataclass(frozen=True)
class FrameFile:
    """A file of one frame, in a folder or in a zip."""

    id: str
    path: Path
    """Path of the file; in a zip the path of the zip, then that of the member."""
    zipped: Zipped | None = None
    """The open zip and the member of it."""

    @property
    def on_disk(self) -> Path:
        """The file itself, or the zip that it lies in."""
        return self.path if self.zipped is None else Path(str(self.zipped[0].filename))

    def read(self, most_bytes: float = MOST_BYTES) -> bytes:
        """Read the content.

        Raises
        ------
        BrokenFileError
            If it cannot be read, is no regular file (a pipe or a device may have no end), has more than `most_bytes`,
            unpacked, or if the id is too long to name the files of a result.
        """
        if len(os.fsencode(self.id)) > LONGEST_ID:
            raise BrokenFileError(f"the name has more than {LONGEST_ID} bytes: no result could be named after it")
        if self.zipped is None:
            return read_regular_file(self.path, most_bytes)
        archive, member = self.zipped
        _check_bytes(member.file_size, most_bytes)
        try:
            with open_member(archive, member) as file:
                content = _read_all(file, most_bytes)
        except BrokenFileError:
            raise
        except Exception as error:  # the decompressors' errors have no class in common
            raise BrokenFileError(f"cannot be read: {str(error) or type(error).__name__}") from error
        if len(content) != member.file_size:
            raise BrokenFileError(f"has {len(content)} bytes, and its zip states {member.file_size}")
        return content

    def read_beginning(self, count: int) -> bytes:
        """Read the first bytes; none if it cannot be read."""
        try:
            if self.zipped is not None:
                archive, member = self.zipped
                with open_member(archive, member) as file:
                    return file.read(count)
            with open_regular_file(self.path) as file:
                return file.read(count) or b""  # None where it would wait
        except Exception:  # `read` reports what is wrong
            return b""

    @property
    def state(self) -> tuple[int, int]:
        """Size and time of the last change, in a zip size and CRC; -1 if missing. Changes with the content."""
        if self.zipped is not None:
            return self.zipped[1].file_size, self.zipped[1].CRC
        try:
            status = self.path.stat()
        except OSError:
            return -1, -1
        return status.st_size, status.st_mtime_ns

    def __reduce__(self) -> tuple[object, ...]:
        """Pickle for other processes, which open the zip themselves."""
        if self.zipped is None:
            return FrameFile, (self.id, self.path)
        archive, member = self.zipped
        return _of_zip, (self.id, self.path, archive.filename, member.filename)


def can_name_files(id: str) -> bool:
    """Whether the results of a frame may be named after its id: it leads to no other folder, and is not too long.

    Examples
    --------
    >>> can_name_files("00001"), can_name_files("../00001"), can_name_files("1" * 300), can_name_files("")
    (True, False, False, False)
    """
    try:
        return Path(id).name == id != "" and "\0" not in id and len(os.fsencode(id)) <= LONGEST_ID
    except UnicodeEncodeError:
        return False


def _of_zip(id: str, path: Path, archive: str, member: str) -> FrameFile:
    opened = _opened(archive)
    return FrameFile(id, path, (opened, opened.getinfo(member)))


_opened = lru_cache(maxsize=4)(zipfile.ZipFile)  # the zip of pickled files is opened once for all of its members


def check_utf8(path: object) -> None:
    """Check that a name is in UTF-8, as libraries in C take it: OpenCV ends the process at others.

    Raises
    ------
    BrokenFileError
        If it is not; the message begins with the name.

    Examples
    --------
    >>> check_utf8(Path("clip.mp4"))
    """
    try:
        str(path).encode()
    except UnicodeEncodeError:
        raise BrokenFileError(
            f"{path}: videos need names in UTF-8, in all folders of their path: rename it, or make a link to it"
        ) from None


def escaped(name: str) -> str:
    r"""A name for text of others, with escapes for bytes that are not UTF-8, as in what is printed; see `unescaped`.

    Examples
    --------
    >>> escaped("T\udcfcrkei"), unescaped(escaped("T\udcfcrkei")) == "T\udcfcrkei"
    ('T\\udcfcrkei', True)
    """
    return name.encode(errors="backslashreplace").decode()


def unescaped(name: str) -> str:
    """The name of which `escaped` made another."""
    return ESCAPE.sub(lambda found: chr(int(found[1], 16)), name)


def native_name(path: Path) -> str:
    """The name of a file for OpenCV and FFmpeg, which take ``12:30.mp4`` for a protocol.

    Raises
    ------
    BrokenFileError
        As `check_utf8`.

    Examples
    --------
    >>> native_name(Path("12:30.mp4")) == os.path.join(".", "12:30.mp4")
    True
    """
    check_utf8(path)
    return str(path) if path.is_absolute() else os.path.join(".", path)


def read_regular_file(path: Path, most_bytes: float = MOST_BYTES) -> bytes:
    """Read a file.

    Raises
    ------
    BrokenFileError
        If it cannot be read, is no regular file, or has more than `most_bytes`.

    Examples
    --------
    >>> read_regular_file(Path("."))
    Traceback (most recent call last):
        ...
    fieldcalib.io.files.BrokenFileError: cannot be read: it is no regular file
    """
    with open_regular_file(path, most_bytes) as file:
        return _read_all(file, most_bytes)


@contextmanager
def open_regular_file(path: Path, most_bytes: float = math.inf) -> Iterator[IO[bytes]]:
    """Open a file that is read in parts, while the context lasts.

    Raises
    ------
    BrokenFileError
        If it cannot be read, is no regular file, or has more than `most_bytes`.
    """
    try:
        status = path.stat()
        if not stat.S_ISREG(status.st_mode):  # before it is opened: opening a pipe waits for a writer
            raise BrokenFileError("cannot be read: it is no regular file")
        _check_bytes(status.st_size, most_bytes)
        with open(path, "rb", opener=_open_at_once) as file:
            yield file
    except OSError as error:
        raise BrokenFileError(f"cannot be read: {error}") from error


def _open_at_once(path: str, flags: int) -> int:
    """Open a file whose reads do not wait: the kernel's log, ``/proc/kmsg``, says that it is a regular file."""
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))


def _read_all(file: Readable, most_bytes: float) -> bytes:
    content = bytearray()
    while part := file.read(READ_AT_ONCE):
        content += part
        _check_bytes(len(content), most_bytes)  # a file may grow, a zip may state less than there is
    return bytes(content)


def _check_bytes(count: int, most_bytes: float) -> None:
    if count > most_bytes:
        raise BrokenFileError(f"has more than {most_bytes / 1e6:g} MB; --max-megabytes of a command allows more")


def find_files(
    inputs: Iterable[Path],
    what: str,
    *,
    prefix: str = "",
    suffix: str | tuple[str, ...],
    others: re.Pattern[str] = HIDDEN,
    apart: bool = False,
) -> list[FrameFile]:
    """Find files named ``<prefix><id><suffix>`` in folders and zips, and single files, in the order of their names.

    Parameters
    ----------
    inputs : iterable of Path
        Folders, zips, and single files, which are taken whatever they are called.
    what : str
        What each file holds, for messages.
    prefix : str
    suffix : str or tuple of str
        Beginning and end of a name, around the id of the frame; of several suffixes any, in upper or lower case. The
        id of a single file is its name without ending and prefix.
    others : re.Pattern
        Matches the beginning of the names of files that are something else.
    apart : bool
        Whether files of one folder that differ in their ending only are different frames: their whole names are their
        ids then.

    Raises
    ------
    FileNotFoundError
        If an input does not exist or holds no such file.
    BrokenFileError
        If a zip is broken, or two files would be the same frame.
    """
    suffixes = (suffix,) if isinstance(suffix, str) else suffix
    files: list[FrameFile] = []
    for path in inputs:
        if not path.exists():
            one_of = " or ".join(suffixes)
            raise FileNotFoundError(f"{path} does not exist: expected a folder, a zip or a {one_of} file")
        chosen = [
            FrameFile(member.stem.removeprefix(prefix), member, zipped)
            for member, zipped in _members(path)
            if member is path or is_named(member.name, prefix, suffixes, others)
        ]
        if not chosen:
            names = " or ".join(f"{prefix}<id>{ending}" for ending in suffixes)
            has_folders = path.is_dir() and any(one.is_dir() for one in path.iterdir())
            hint = "; folders in it are not searched" if has_folders else ""
            raise FileNotFoundError(f"{path} holds no {what}: expected files named {names}{hint}")
        files += chosen
    if apart:
        alike = Counter({file.path: (file.path.parent, file.id) for file in files}.values())
        files = [replace(file, id=file.path.name) if alike[file.path.parent, file.id] > 1 else file for file in files]
    found: dict[str, FrameFile] = {}
    for file in files:
        if file.id in found:
            raise BrokenFileError(
                f"{file.path} and {found[file.id].path} are the same frame {file.id}: rename one of them"
            )
        found[file.id] = file
    return files


def is_named(name: str, prefix: str, suffixes: tuple[str, ...], others: re.Pattern[str]) -> bool:
    """Whether a name has the prefix and a suffix, in upper or lower case, and matches none of the `others`."""
    endings = tuple(suffix.lower() for suffix in suffixes)
    return name.startswith(prefix) and name.lower().endswith(endings) and not others.match(name)


def files_beside(inputs: Iterable[Path], used: Iterable[FrameFile]) -> list[Path]:
    """The files in folders and zips that are not used; hidden ones are not counted."""
    paths = {file.path for file in used}
    members = (member for path in inputs for member, _ in _members(path) if member is not path)
    return [path for path in members if path not in paths and not HIDDEN.match(path.name) and not path.is_dir()]


def _members(path: Path) -> Iterator[tuple[Path, Zipped | None]]:
    """Members of a folder or a zip in the order of names; the path itself if it is neither."""
    if path.is_dir():
        yield from ((member, None) for member in sorted(path.iterdir()))
    elif path.is_file() and path.suffix.lower() == ".zip":
        try:
            archive = zipfile.ZipFile(path)  # left open, to be read from
        except Exception as error:  # a damaged directory raises errors of many classes
            raise BrokenFileError(f"{path}: {error}") from error
        for member in sorted(archive.infolist(), key=lambda member: member.filename):
            name = member.filename
            if not name.endswith("/") and "__MACOSX/" not in name:
                yield path / name.lstrip("/"), (archive, member)
    else:
        yield path, None


def parse_json(content: bytes | str) -> Any:
    """Parse JSON.

    Raises
    ------
    BrokenFileError
        If it is no JSON, or if an object in it has a key twice.
    """
    try:
        return json.loads(content, object_pairs_hook=without_repeats)
    except BrokenFileError:
        raise
    except (ValueError, RecursionError) as error:
        raise BrokenFileError(f"is no JSON: {error}") from error


def parse_json_object(content: bytes | str, what: str) -> dict[str, Any]:
    """Parse a JSON object; `what` names its content, for messages.

    Raises
    ------
    BrokenFileError
        If it is no JSON or no object, or if an object in it has a key twice.

    Examples
    --------
    >>> parse_json_object('{"Middle line": []}', "labels")
    {'Middle line': []}
    """
    value = parse_json(content)
    if not isinstance(value, dict):
        raise BrokenFileError(f"expected a JSON object of {what}, got {type(value).__name__}")
    return value


class _Loader(yaml.SafeLoader):  # type: ignore[misc]
    """Refuses aliases, a few of which stand for more values than there is memory for, and repeated keys."""

    def compose_node(self, parent: Any, index: Any) -> Any:
        if self.check_event(yaml.AliasEvent):
            raise BrokenFileError(f"has the alias *{self.peek_event().anchor}: write its values out")
        return super().compose_node(parent, index)

    def construct_mapping(self, node: Any, deep: bool = False) -> Any:
        without_repeats([(self.construct_object(key, deep=True), None) for key, _ in node.value])
        return super().construct_mapping(node, deep)


def parse_yaml(content: bytes | str) -> Any:
    """Parse YAML.

    Raises
    ------
    BrokenFileError
        If it is no YAML, has aliases, or a mapping in it has a key twice.

    Examples
    --------
    >>> parse_yaml("length: 20")
    {'length': 20}
    """
    try:
        return yaml.load(content, _Loader)
    except BrokenFileError:
        raise
    except (yaml.YAMLError, ValueError, TypeError, RecursionError) as error:  # TypeError: of a key that is a list
        raise BrokenFileError(f"is no YAML: {error}") from None


def read_json_or_yaml(path: Path) -> Any:
    """Read a file of JSON, or of YAML if it has such an ending.

    Raises
    ------
    BrokenFileError
        If it cannot be read, or is neither.
    """
    content = read_regular_file(path)
    return parse_yaml(content) if path.suffix.lower() in YAML else parse_json(content)


def without_repeats(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Make a dict of a JSON object; Python's parser would let the last of equal keys replace the others."""
    value = dict(pairs)
    if len(value) < len(pairs):
        twice, _ = Counter(key for key, _ in pairs).most_common(1)[0]
        raise BrokenFileError(f"the key {twice!r} is given twice")
    return value


def error_message(error: Exception) -> str:
    """The problem of a file, for messages; a MemoryError has no text of its own."""
    return str(error) or "there is not enough memory for it"
