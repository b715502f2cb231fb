"""Locking of a folder of results: one run at a time writes to it.

Nothing is left in the folder by it, as it would be by the package filelock.

Which files a command may write over: none that it reads, and those of others only if it is told to.
"""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

ELSEWHERE = "give another --out"
INTERRUPTED = "remove the folder, if a run of this command was interrupted there, or give another --out"


def check_targets(
    targets: Iterable[Path], reads: Iterable[Path], *, replaces: bool = False, remedy: str = ELSEWHERE
) -> None:
    """Check the files that a command is going to write or to remove, before it does.

    Parameters
    ----------
    targets : iterable of Path
        These files; most of them do not exist yet.
    reads : iterable of Path
        Files that the command reads. Whatever links lead to them, they are not written over.
    replaces : bool
        Whether other files that are there may be replaced: an earlier run of the command wrote them, or the user named
        them.
    remedy : str
        What to do about files that may not be replaced, for the message.

    Raises
    ------
    FileExistsError
        If a target may not be written; the message names it.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     picture = Path(folder) / "a.jpg"
    ...     picture.touch()
    ...     check_targets([picture, Path(folder) / "b.jpg"], [], replaces=True)
    ...     try:
    ...         check_targets([picture], [picture], replaces=True)
    ...     except FileExistsError as error:
    ...         print(str(error).replace(folder, "folder"))
    folder/a.jpg is read by this command, which would write over it: give another --out
    """
    there = [path for path in targets if os.path.lexists(path)]
    if not there:
        return
    read = {identity for path in reads if (identity := _identity(path)) is not None}
    for path in there:
        if _identity(path) in read:
            raise FileExistsError(f"{path} is read by this command, which would write over it: {ELSEWHERE}")
    if not replaces:
        raise FileExistsError(f"{there[0]} is there already: {remedy}")


def _identity(path: Path) -> tuple[int, int] | None:
    """Device and number of a file; None if there is none."""
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_dev, status.st_ino


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
