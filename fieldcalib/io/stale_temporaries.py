"""Temporary files that a killed process has left: each is locked by its writer, and a lock ends with its process."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import lru_cache
from pathlib import Path

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
