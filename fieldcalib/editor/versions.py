"""Files of a folder that are replaced whole: what is replaced is kept, and what others have changed is not replaced."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

from fieldcalib.io.files import FrameFile, whole_file, write_bytes

State = tuple[int, int]
"""Size and time of the last change of a file; -1 if there is none."""
MISSING: State = (-1, -1)


class Kept(NamedTuple):
    """Files as they were before they were replaced."""

    folder: Path | None
    """Where those are that were there; None if none was."""
    names: tuple[str, ...]
    """All of them; those that are not in that folder were not there."""


class ChangedFileError(ValueError):
    """A file that another program has changed since it was read."""


class Versions:
    """Files of a folder by their names in it, and older versions of them in ``0001``, ``0002`` and so on elsewhere.

    Parameters
    ----------
    folder : Path
    history : Path
        Folder of the older versions, on the same disk.
    written : mapping of str to (int, int)
        States of files that were written here before.
    """

    def __init__(self, folder: Path, history: Path, written: Mapping[str, State] | None = None) -> None:
        self.folder, self._history = folder, history
        self._expected = dict(written or {})

    def read_now(self, names: Iterable[str]) -> None:
        """Remember the states of files that are read now."""
        self._expected |= self._states(names)

    def expect(self, names: Iterable[str]) -> None:
        """Remember the states of files that are read now, unless they were read or written before."""
        for name, state in self._states(names).items():
            self._expected.setdefault(name, state)

    def _states(self, names: Iterable[str]) -> dict[str, State]:
        return {name: FrameFile("", self.folder / name).state for name in names}

    def begin(self, names: Iterable[str]) -> Kept:
        """Check files that are about to be replaced, and keep their present versions.

        Raises
        ------
        ChangedFileError
            If another program has changed one of them; then nothing is kept.
        """
        now = self._states(names)
        for name, state in now.items():
            if state not in (MISSING, self._expected.get(name, MISSING)):
                raise ChangedFileError(
                    f"{name} was changed by another program, and nothing was saved: move it out of {self.folder}, or "
                    "end this one and open the folder again; what was edited here is kept"
                )
        return Kept(self._keep([name for name, state in now.items() if state != MISSING]), tuple(now))

    def _keep(self, names: list[str]) -> Path | None:
        if not names:
            return None
        there = self._history.iterdir() if self._history.is_dir() else ()
        version = self._history / f"{max((int(one.name) for one in there if one.name.isdecimal()), default=0) + 1:04d}"
        for name in names:
            kept = version / name
            kept.parent.mkdir(parents=True, exist_ok=True)
            try:
                os.link(self.folder / name, kept)  # files are replaced, not changed: the link keeps this version
            except OSError:
                shutil.copy2(self.folder / name, kept)
        return version

    def restore(self, kept: Kept) -> dict[str, State]:
        """Put files back as they were, and remove those that were not there; the present versions are kept.

        Raises
        ------
        ChangedFileError
            As `begin`.
        """
        self.begin(kept.names)
        for name in kept.names:
            old, path = None if kept.folder is None else kept.folder / name, self.folder / name
            if old is not None and old.is_file():
                with old.open("rb") as before, whole_file(path) as file:
                    shutil.copyfileobj(before, file)
            else:
                path.unlink(missing_ok=True)
        self.read_now(kept.names)
        return self._states(kept.names)

    def write(self, files: Mapping[str, bytes | None]) -> dict[str, State]:
        """Write files, after `begin`, and remove those whose content is None; returns their states."""
        for name, content in files.items():
            path = self.folder / name
            if content is None:
                path.unlink(missing_ok=True)
            else:
                path.parent.mkdir(parents=True, exist_ok=True)
                write_bytes(path, content)
        self.read_now(files)
        return self._states(files)
