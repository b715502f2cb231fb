"""The files of frames: found in folders and zips, read, and written whole or not at all."""

from __future__ import annotations

import json
import os
import re
import tempfile
import zipfile
import zlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

HIDDEN = re.compile(r"\.")


class BrokenFileError(ValueError):
    """A file that does not hold what its format promises; the message says what is wrong with it."""


@dataclass(frozen=True)
class FrameFile:
    """What a file says of one frame; the file lies in a folder or in a zip."""

    id: str
    path: Path | zipfile.Path

    def read(self) -> bytes:
        """The content.

        Raises
        ------
        BrokenFileError
            If it cannot be read.
        """
        try:
            return self.path.read_bytes()
        except (OSError, EOFError, RuntimeError, zipfile.BadZipFile, zlib.error) as error:  # encrypted: RuntimeError
            raise BrokenFileError(f"cannot be read: {error}") from error


def find_files(
    inputs: Iterable[Path],
    what: str,
    *,
    prefix: str = "",
    suffix: str | tuple[str, ...],
    others: re.Pattern[str] = HIDDEN,
) -> list[FrameFile]:
    """Files named ``<prefix><id><suffix>`` in folders and zips, and single files, in the order of their names.

    Parameters
    ----------
    inputs : iterable of Path
        Folders, zips, and single files, which are taken whatever they are called.
    what : str
        What each file holds, for messages.
    prefix : str
    suffix : str or tuple of str
        Around the id of the frame; of a single file the id is the name without ending and prefix. One of several
        suffixes will do, in upper or lower case.
    others : re.Pattern
        Matches the beginning of the names of files that are something else.

    Raises
    ------
    FileNotFoundError
        If an input does not exist or holds no such file.
    BrokenFileError
        If a zip is none, or two files would be the same frame.
    """

    suffixes = (suffix,) if isinstance(suffix, str) else suffix
    endings = tuple(ending.lower() for ending in suffixes)

    def is_wanted(name: str) -> bool:
        return name.startswith(prefix) and name.lower().endswith(endings) and not others.match(name)

    found: dict[str, FrameFile] = {}
    for path in inputs:
        if not path.exists():
            one_of = " or ".join(suffixes)
            raise FileNotFoundError(f"{path} does not exist: expected a folder, a zip or a {one_of} file")
        count = len(found)
        for member in _members(path):
            if member is not path and not is_wanted(member.name):
                continue
            file = FrameFile(Path(member.name).stem.removeprefix(prefix), member)
            if file.id in found:
                raise BrokenFileError(
                    f"{file.path} and {found[file.id].path} are the same frame {file.id}: rename one of them"
                )
            found[file.id] = file
        if len(found) == count:
            names = " or ".join(f"{prefix}<id>{ending}" for ending in suffixes)
            raise FileNotFoundError(f"{path} holds no {what}: expected files named {names}")
    return list(found.values())


def _members(path: Path) -> Iterator[Path | zipfile.Path]:
    """What lies in a folder or in a zip, in the order of names; the path itself if it is neither."""
    if path.is_dir():
        yield from sorted(path.iterdir())
    elif path.suffix.lower() == ".zip":
        try:
            archive = zipfile.ZipFile(path)  # left open, to be read from
        except (OSError, zipfile.BadZipFile) as error:
            raise BrokenFileError(f"{path}: {error}") from error
        yield from (zipfile.Path(archive, name) for name in sorted(archive.namelist()) if "__MACOSX/" not in name)
    else:
        yield path


def parse_json_object(content: bytes | str, what: str) -> dict[str, Any]:
    """A JSON object as a dict; `what` says what is in it, for messages.

    Raises
    ------
    BrokenFileError
        If it is no JSON or no object.

    Examples
    --------
    >>> parse_json_object('{"Middle line": []}', "labels")
    {'Middle line': []}
    """
    try:
        value = json.loads(content)
    except (ValueError, RecursionError) as error:
        raise BrokenFileError(f"is no JSON: {error}") from error
    if not isinstance(value, dict):
        raise BrokenFileError(f"expected a JSON object of {what}, got {type(value).__name__}")
    return value


@contextmanager
def whole_file(path: Path) -> Iterator[BinaryIO]:
    """A file to be written, by way of a temporary one beside it: a reader sees the old file or the new one, never half.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "a.bin"
    ...     with whole_file(path) as file:
    ...         _ = file.write(b"whole")
    ...         path.exists()
    ...     path.read_bytes()
    False
    b'whole'
    """
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "wb") as file:
            yield file
        umask = os.umask(0)  # the mode that open() would have given; mkstemp's is private
        os.umask(umask)
        os.chmod(temporary, 0o666 & ~umask)
        os.replace(temporary, path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise


def write_bytes(path: Path, data: bytes) -> None:
    """Write a file, whole or not at all, see `whole_file`."""
    with whole_file(path) as file:
        file.write(data)


def write_text(path: Path, text: str) -> None:
    """Write a text file in UTF-8, with its line ends as they are, whole or not at all."""
    write_bytes(path, text.encode())
