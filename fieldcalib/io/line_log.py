"""A file of lines that grows during a run, so that results survive the end of the process."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import Self

from fieldcalib.io.files import named_where_full

BLOCK = 65_536  # bytes that are read at once


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
