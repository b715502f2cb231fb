"""Files that are written whole or not at all.

A temporary file is locked by its writer, and a lock ends with its process: that is how files are found that a killed
process has left.
"""

from __future__ import annotations

import errno
import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import lru_cache
from pathlib import Path
from typing import BinaryIO

NO_ROOM = {errno.ENOSPC, errno.EFBIG, errno.EDQUOT}
TEMPORARY = ".unfinished-"  # prefix of the names of temporary files

if sys.platform == "win32":

    @contextmanager
    def locked(handle: int) -> Iterator[None]:
        """Do nothing: temporary files are not removed here, and need no lock."""
        yield

    def remove_abandoned(folder: Path) -> None:
        """Do nothing: whether a file's writer is alive is not known."""

else:
    import fcntl

    @contextmanager
    def locked(handle: int) -> Iterator[None]:
        """Lock an open file while the context lasts, even if the handle is closed; not where there are no locks."""
        lock = os.dup(handle)
        try:
            with suppress(OSError):
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            yield
        finally:
            os.close(lock)

    @lru_cache(maxsize=100)
    def remove_abandoned(folder: Path) -> None:
        """Remove the temporary files of a folder whose writers are dead; once for each folder in a process.

        Examples
        --------
        >>> import tempfile
        >>> with tempfile.TemporaryDirectory() as name:
        ...     (Path(name) / f"{TEMPORARY}1.mp4").touch()
        ...     remove_abandoned(Path(name))
        ...     list(Path(name).iterdir())
        []
        """
        for path in folder.glob(f"{TEMPORARY}*"):
            with suppress(OSError):  # another process removes it, or one writes to it, or there are no locks
                handle = os.open(path, os.O_RDWR | os.O_NOFOLLOW | os.O_NONBLOCK)
                try:
                    fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    path.unlink()
                finally:
                    os.close(handle)


@contextmanager
def named_where_full(path: Path) -> Iterator[None]:
    """Give the path to errors of writing that name no file: where a disk or a quota is full, or files may not grow."""
    try:
        yield
    except OSError as error:
        if error.errno in NO_ROOM and error.filename is None:
            error.filename = str(path)
        raise


def remove_temporaries(folder: Path) -> None:
    """Remove the temporary files of `replacement` that a killed process has left; no other process may write there."""
    for path in folder.glob(f"{TEMPORARY}*"):
        path.unlink(missing_ok=True)


@contextmanager
def replacement(path: Path) -> Iterator[tuple[int, Path]]:
    """Open a temporary file beside a path, which replaces the path if no error occurs.

    Its name is random, and a link at `path` is replaced, not followed. Those that a killed process has left in the
    folder are removed.
    """
    if not path.parent.is_dir():
        raise FileNotFoundError(errno.ENOENT, "there is no such folder", str(path.parent))
    remove_abandoned(path.parent)
    with ExitStack() as locks:
        while True:
            handle, name = tempfile.mkstemp(dir=path.parent, prefix=TEMPORARY, suffix=path.suffix)
            locks.enter_context(locked(handle))
            if os.path.exists(name):
                break
            os.close(handle)  # another process took it for abandoned before it was locked
        temporary = Path(name)
        try:
            with named_where_full(path):
                yield handle, temporary
            umask = os.umask(0)  # the mode that open() would have given; mkstemp's is private
            os.umask(umask)
            os.chmod(temporary, 0o666 & ~umask)
            os.replace(temporary, path)
        except BaseException:
            temporary.unlink(missing_ok=True)
            raise


@contextmanager
def whole_file(path: Path) -> Iterator[BinaryIO]:
    """Write a file by way of a temporary one beside it: a reader sees the old file or the new one, never a part.

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
    with replacement(path) as (handle, _), os.fdopen(handle, "wb") as file:
        yield file


def write_bytes(path: Path, data: bytes) -> None:
    """Write a file, whole or not at all, see `whole_file`."""
    with whole_file(path) as file:
        file.write(data)


def write_text(path: Path, text: str) -> None:
    """Write a text file in UTF-8, with its line ends as they are, whole or not at all."""
    write_bytes(path, text.encode())
