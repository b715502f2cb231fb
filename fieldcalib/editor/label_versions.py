"""Replacement of several files of a folder together: all or none, and only files that were written here before.

New files are first written into a folder beside the others (`STAGED`). Then their names and states are announced, to be
noted on the disk, and only then they are moved to their places. If the process ends in between, `Versions.finish`
completes the move from the note. Replaced files are kept in folders ``0001``, ``0002`` and so on.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from hashlib import blake2b
from pathlib import Path
from typing import NamedTuple

from fieldcalib._whole_files import write_bytes

STAGED = ".fieldcalib-saving"  # folder in which files are written until all of them are complete
DIGEST_BYTES = 16


class State(NamedTuple):
    """Size, time and digest of a file, by which a change of its content is recognised."""

    size: int
    """Bytes; -1 if there is no file."""
    time: int
    """Time of the last change, ns."""
    digest: str = ""
    """Digest of the content, hexadecimal; empty if unknown."""

    @classmethod
    def of(cls, path: Path, *, with_digest: bool = False) -> State:
        """Read the state of a file; for a link it is the link's own, not that of its target."""
        try:
            status = path.lstat()
        except (FileNotFoundError, NotADirectoryError):
            return MISSING
        digest = _digest(path) if with_digest else ""
        return cls(status.st_size, status.st_mtime_ns, digest)

    def is_of(self, path: Path) -> bool:
        """Whether a file has this content; if the time differs, as for a copy, the digest decides."""
        now = State.of(path)
        if (now.size, now.time) == (self.size, self.time):
            return not path.is_symlink()
        return now.size == self.size and self.digest != "" and not path.is_symlink() and _digest(path) == self.digest

    def is_content_of(self, path: Path) -> bool:
        """Whether a file has the same size and digest."""
        return State.of(path).size == self.size and _digest(path) == self.digest


MISSING = State(-1, -1)


def _digest(path: Path) -> str:
    found = blake2b(digest_size=DIGEST_BYTES)
    with path.open("rb") as file:
        while part := file.read(1 << 20):
            found.update(part)
    return found.hexdigest()


class Kept(NamedTuple):
    """Files as they were before they were replaced."""

    folder: Path | None
    """Folder with the old versions of the files that existed; None if none did."""
    names: tuple[str, ...]
    """Names of all files that were written or removed; those not in the folder did not exist before."""


class ChangedFileError(ValueError):
    """Raised if a file would be replaced that was not written here, or was changed since."""


class UnfinishedSaveError(OSError):
    """Raised if files could not all be moved to their places; `Versions.finish` completes it."""


class Staged:
    """New files that wait to be moved into a folder together.

    Parameters
    ----------
    folder : Path
        Folder in which they are written, by their names in the final folder.
    there : Path
        The final folder.
    """

    def __init__(self, folder: Path, there: Path) -> None:
        self.folder, self._there = folder, there
        self.removed: set[str] = set()

    def path(self, name: str) -> Path:
        """Path at which to write a file."""
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        self.removed.discard(name)
        return path

    def put(self, name: str, content: bytes | None) -> None:
        """Write a file, or remove it if the content is None."""
        if content is not None:
            write_bytes(self.path(name), content)
        else:
            (self.folder / name).unlink(missing_ok=True)
            self.removed.add(name)

    def has(self, name: str) -> bool:
        """Whether the final folder will have a file."""
        return (self.folder / name).is_file() or (name not in self.removed and (self._there / name).is_file())

    @property
    def names(self) -> list[str]:
        """Names of the files that wait."""
        return sorted(path.relative_to(self.folder).as_posix() for path in self.folder.rglob("*") if path.is_file())


class Announced(NamedTuple):
    """Files that are about to be moved to their places."""

    states: Mapping[str, State]
    """New states by name; `MISSING` for a file that is removed."""
    before: Mapping[str, State]
    """States of the files that are replaced, by name; without files that did not exist."""


Announce = Callable[[Announced], None]
"""Notes announced files on the disk; if it raises an error, all files stay as they are."""


class Versions:
    """The files of a folder that were written here, by name, with a history of older versions.

    Parameters
    ----------
    folder : Path
    history : str
        Name of the folder of the older versions, in `folder`.
    replaces : bool
        Whether files may be replaced that were not written here.
    """

    def __init__(self, folder: Path, history: str, *, replaces: bool = False) -> None:
        self.folder, self._history, self._replaces = folder, history, replaces
        self._known: dict[str, State] = {}
        self.kept: Kept | None = None
        """The files that were replaced last."""

    def know(self, states: Mapping[str, State]) -> None:
        """Register the states of files that were written here."""
        self._known |= states

    def read_now(self, names: Iterable[str]) -> None:
        """Register the present states of files that may be replaced, as a run wrote them."""
        self._known |= {name: State.of(self.folder / name) for name in names}

    def knows(self, name: str) -> bool:
        """Whether a file was written here."""
        return self._known.get(name, MISSING) != MISSING

    def is_own(self, name: str) -> bool:
        """Whether an existing file was written here, and has not changed since."""
        return self.knows(name) and self._known[name].is_of(self.folder / name)

    def foreign(self, names: Iterable[str]) -> list[str]:
        """Select the files that exist and may not be replaced."""
        there = [name for name in names if os.path.lexists(self.folder / name)]
        if self._replaces:
            return [name for name in there if (self.folder / name).is_symlink()]
        return [name for name in there if not self.is_own(name)]

    @contextmanager
    def replacing(self, announce: Announce, beside: Iterable[str] = ()) -> Iterator[Staged]:
        """Replace files together: they are staged while the context lasts, and moved to their places at its end.

        Files are removed only if they were written here. Afterwards `self.kept` has the replaced files.

        Parameters
        ----------
        announce : callable
        beside : iterable of str
            Files whose present states are announced too: if one of them changes, the announcement is void.

        Raises
        ------
        ChangedFileError
            If a file that would be replaced was not written here, or was changed since; then nothing is written.
        UnfinishedSaveError
            If files could not be moved to their places after they were announced.
        OSError
            If one cannot be written; then nothing is changed.
        """
        staging = self.folder / STAGED
        self._check_no_link([STAGED])
        shutil.rmtree(staging, ignore_errors=True)
        kept: Kept | None = None
        try:
            staging.mkdir()
            staged = Staged(staging, self.folder)
            yield staged
            states = {name: State.of(staging / name, with_digest=True) for name in staged.names}
            for name in list(states):
                if self.is_own(name) and states[name].is_content_of(self.folder / name):
                    (staging / name).unlink()  # it is there already
                    del states[name]
            removed = [name for name in sorted(staged.removed) if self.knows(name)]
            kept = self._keep([*states], removed)
            states |= dict.fromkeys(removed, MISSING)
            states |= {name: State.of(self.folder / name) for name in beside if name not in states}
            there = {name: State.of(self.folder / name) for name in states}
            announced = Announced(states, {name: state for name, state in there.items() if state != MISSING})
            announce(announced)
        except BaseException:
            shutil.rmtree(staging, ignore_errors=True)
            if kept is not None and kept.folder is not None:
                shutil.rmtree(kept.folder, ignore_errors=True)
            raise
        self.kept = kept
        self.finish(announced)

    def finish(self, announced: Announced) -> bool:
        """Move announced files to their places, as far as they are not there yet.

        Returns
        -------
        bool
            Whether all are in place; false if one is lost, or another program has written in its place meanwhile.

        Raises
        ------
        UnfinishedSaveError
            If one cannot be moved.
        """
        states, staging = announced.states, self.folder / STAGED
        try:
            self._check_no_link([*states, STAGED])
            for name in states if self._can_finish(announced) else ():
                if states[name] == MISSING:
                    (self.folder / name).unlink(missing_ok=True)
                elif (staging / name).exists():
                    (self.folder / name).parent.mkdir(parents=True, exist_ok=True)
                    os.replace(staging / name, self.folder / name)
        except (OSError, ChangedFileError) as error:
            said = error.strerror if isinstance(error, OSError) else str(error)
            raise UnfinishedSaveError(
                f"not all files could be written ({said}): mend that and save again, or open the folder again; it goes "
                "on from there"
            ) from error
        shutil.rmtree(staging, ignore_errors=True)
        is_done = all(state.is_of(self.folder / name) for name, state in states.items())
        if is_done:
            self.know(states)
        return is_done

    def _can_finish(self, announced: Announced) -> bool:
        """Whether all announced files are staged or in place, and none would replace another program's file."""
        for name, state in announced.states.items():
            path = self.folder / name
            if state.is_of(path):
                continue
            before = announced.before.get(name, MISSING)
            if not (state == MISSING or state.is_of(self.folder / STAGED / name)) or not before.is_of(path):
                return False
        return True

    def _keep(self, names: list[str], removed: list[str]) -> Kept:
        """Check files that are about to be replaced or removed, and copy their present versions to the history."""
        self._check_no_link([self._history])
        self.check([*names, *removed])
        there = [name for name in (*names, *removed) if (self.folder / name).is_file()]
        return Kept(self._copied(there), (*names, *removed))

    def check(self, names: Iterable[str]) -> None:
        """Raise a ChangedFileError if any of the files exists and may not be replaced, or lies behind a link."""
        names = list(names)
        self._check_no_link(names)
        if foreign := self.foreign(names):
            raise ChangedFileError(
                f"{foreign[0]} was changed by another program, or is none of those that were written here; nothing was "
                f"saved: move it out of {self.folder} and save again, or end this one and open the folder with "
                "--overwrite; what was edited here is kept"
            )

    def _check_no_link(self, names: Iterable[str]) -> None:
        """Raise a ChangedFileError if a folder between this one and a file is a link, which may lead anywhere."""
        for part in {part for name in names for part in (Path(name), *Path(name).parents)} - {Path()}:
            if (self.folder / part).is_symlink() and (self.folder / part).is_dir():
                raise ChangedFileError(
                    f"{part} is a link, and nothing is written through it: remove it from {self.folder} and save again"
                )

    def _copied(self, names: list[str]) -> Path | None:
        if not names:
            return None
        history = self.folder / self._history
        there = history.iterdir() if history.is_dir() else ()
        version = history / f"{max((int(one.name) for one in there if one.name.isdecimal()), default=0) + 1:04d}"
        try:
            for name in names:
                kept = version / name
                kept.parent.mkdir(parents=True, exist_ok=True)
                try:
                    os.link(self.folder / name, kept)  # files are replaced, not changed: the link keeps this version
                except OSError:
                    shutil.copy2(self.folder / name, kept)
        except BaseException:
            shutil.rmtree(version, ignore_errors=True)
            with suppress(OSError):  # others are in it
                history.rmdir()
            raise
        return version

    def restore(self, kept: Kept, announce: Announce) -> None:
        """Restore files, and remove those that did not exist before; their present versions go to the history.

        Raises
        ------
        ChangedFileError, UnfinishedSaveError, OSError
            As `replacing`.
        """
        with self.replacing(announce) as staged:
            for name in kept.names:
                old = None if kept.folder is None else kept.folder / name
                if old is not None and old.is_file():
                    shutil.copyfile(old, staged.path(name))
                else:
                    staged.put(name, None)
