"""Locking of a folder of results: one run at a time writes to it."""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


class FolderInUseError(OSError):
    """A folder to which another program writes."""


@contextmanager
def output_folder(path: Path) -> Iterator[None]:
    """Make and lock a folder for results while the context lasts.

    Raises
    ------
    OSError
        If the folder cannot be made or written to, or another run or page writes to it (`FolderInUseError`).

    Examples
    --------
    >>> with tempfile.TemporaryDirectory() as folder, output_folder(Path(folder) / "out"):
    ...     (Path(folder) / "out").is_dir()
    True
    """
    if path.is_file():
        raise NotADirectoryError(f"{path} is a file: results need a folder")
    path.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryFile(dir=path):  # an error of writing shows before the work, not after it
        pass
    with locked_folder(path):
        yield


@contextmanager
def locked_folder(path: Path) -> Iterator[None]:
    """Lock a folder that exists while the context lasts.

    Raises
    ------
    FolderInUseError
        If another program has locked it.
    """
    handle = _locked(path)
    try:
        yield
    finally:
        if handle is not None:
            os.close(handle)


if sys.platform == "win32":

    def _locked(path: Path) -> int | None:
        """Lock a folder; the lock lasts until the handle is closed, at the latest when the process ends."""
        try:
            return os.open(path / ".locked", os.O_CREAT | os.O_EXCL | os.O_TEMPORARY)
        except FileExistsError:
            raise _other_run(path) from None

else:
    import fcntl

    def _locked(path: Path) -> int | None:
        """Lock a folder; the lock lasts until the handle is closed, at the latest when the process ends.

        None where the file system has no locks.
        """
        handle = os.open(path, os.O_RDONLY)  # of the folder itself: nothing is left behind
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(handle)
            raise _other_run(path) from None
        except OSError:
            os.close(handle)
            return None
        return handle


def _other_run(path: Path) -> OSError:
    return FolderInUseError(f"another run or page writes to {path}: wait for its end, or give another folder")
