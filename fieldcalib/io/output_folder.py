"""Folders of results, locked: one run at a time writes to them, and a file of lines that grows during a run.

Nothing is left in the folder by locking it, as it would be by the package filelock.

Which files a command may write over: none that it reads, and those of others only if it is told to.
"""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import Self

from fieldcalib._whole_files import named_where_full

ELSEWHERE = "give another --out"
INTERRUPTED = "remove the folder, if a run of this command was interrupted there, or give another --out"
BLOCK = 65_536  # bytes that are read at once


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
    """Make and lock a folder for results while the context lasts; one that an error leaves empty is removed again.

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
    is_new = not path.exists()
    path.mkdir(parents=True, exist_ok=True)
    try:
        with tempfile.TemporaryFile(dir=path):  # an error of writing shows before the work, not after it
            pass
        with locked_folder(path):
            yield
    except BaseException:
        if is_new:
            with suppress(OSError):  # it holds something
                path.rmdir()
        raise


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


class LineLog:
    """Appends lines to a file without delay; a context manager. An incomplete last line is removed first.

    Parameters
    ----------
    path : Path
    count : int, optional
        Lines to keep of those that are there; all by default.
    durable : bool
        Whether each line is on the disk when `append` returns, whatever happens to the machine then.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "log.jsonl"
    ...     _ = path.write_text('{"id": 1}\\n{"id"')
    ...     with LineLog(path) as log:
    ...         log.append('{"id": 2}')
    ...     path.read_text()
    '{"id": 1}\\n{"id": 2}\\n'
    """

    def __init__(self, path: Path, count: int | None = None, *, durable: bool = False) -> None:
        if path.is_symlink():  # the file that it leads to is not of this log
            raise FileExistsError(f"{path} is a link: remove it, or choose another folder")
        self.path, self._durable = path, durable
        self._file = path.open("ab", buffering=0)
        try:
            size = sum(len(line) for index, line in enumerate(whole_lines(path)) if count is None or index < count)
            self._file.truncate(size)
        except BaseException:
            self._file.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def append(self, line: str) -> None:
        """Write a line.

        Raises
        ------
        OSError
            If it cannot be written, as when the disk is full; the file is unchanged then.
        """
        content = memoryview(f"{line}\n".encode())
        size = os.fstat(self._file.fileno()).st_size
        try:
            with named_where_full(self.path):
                while content:
                    content = content[self._file.write(content) :]
                if self._durable:
                    os.fsync(self._file.fileno())
        except BaseException:
            self._file.truncate(size)
            raise


def whole_lines(path: Path) -> Iterator[bytes]:
    """The lines of a file, with their ends; without the last one if it has no end."""
    with path.open("rb", buffering=BLOCK) as file:
        for line in file:
            if line.endswith(b"\n"):
                yield line
