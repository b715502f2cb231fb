"""The folder of results of an editor: read as a run wrote it, and written so that other commands go on from there.

Files are replaced whole. What is replaced is kept in ``history/0001``, ``0002`` and so on. A file that another program
has changed since it was read or written here is not replaced.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from fieldcalib.assess.result import Calibration
from fieldcalib.editor.table import Row
from fieldcalib.io.files import (
    BrokenFileError,
    FrameFile,
    parse_json_object,
    read_regular_file,
    write_bytes,
    write_text,
)
from fieldcalib.io.formats import CAMERAS
from fieldcalib.io.line_log import LineLog
from fieldcalib.io.results import BROKEN, LINES, SOLVER, TABLE, lines_file, result_lines, write_lines
from fieldcalib.run_folder.options import RunOptions
from fieldcalib.run_folder.outcome import Outcome
from fieldcalib.run_folder.record import RECORD, RunRecord
from fieldcalib.run_folder.results import SUMMARY, TRIPODS, ResultsWriter, is_unfinished

BY_HAND = "labelled by hand"  # basis of a frame that a person has mended
HISTORY = "history"
COMMAND = "open"

State = tuple[int, int]
"""Size and time of the last change of a file; -1 if there is none."""


class ChangedFileError(ValueError):
    """A file that another program has changed since it was read."""


@dataclass(frozen=True)
class Saved:
    """A frame to be written."""

    id: str
    calibration: Calibration
    basis: str
    """What the camera rests on; empty if nothing is to be said."""
    files: Mapping[str, bytes | None]
    """More files of it, by name in the folder; None removes one."""


class Stored:
    """Results in a folder, which may be empty or not exist yet.

    Parameters
    ----------
    folder : Path
    written : mapping of str to (int, int)
        States of files that were written here before, as `save` returns them.

    Raises
    ------
    BrokenFileError
        If a line is no result.
    """

    def __init__(self, folder: Path, written: Mapping[str, State] | None = None) -> None:
        self.folder = folder
        self.lines: dict[str, dict[str, Any]] = {}
        """Lines of ``cameras.jsonl`` by id."""
        self._expected = {
            **(written or {}),
            **{name: _state(folder / name) for name in (LINES, SOLVER, TABLE, SUMMARY)},
        }
        if self.has_results(folder):
            for number, text in enumerate(result_lines(lines_file(folder)), 1):
                try:
                    line = parse_json_object(text, "a frame's result")
                    self.lines[str(line["id"])] = line
                except (KeyError, BrokenFileError) as error:
                    raise BrokenFileError(f"{lines_file(folder)}, line {number}: is no result: {error}") from None

    @staticmethod
    def has_results(folder: Path) -> bool:
        """Whether a folder has results."""
        return (folder / LINES).is_file() or (folder / TABLE).is_file()

    @property
    def record(self) -> RunRecord | None:
        """The record of the run that wrote them."""
        return RunRecord.read(self.folder)

    def calibration(self, id: str) -> Calibration | None:
        """The calibration of a frame; None if there is none."""
        line = self.lines.get(id)
        if line is None or line.get("status") == BROKEN:
            return None
        return Calibration.from_dict(line)

    @property
    def cuts(self) -> list[int]:
        """First frames of the shots of a clip, counted from the first frame; empty where nothing says them."""
        path = self.folder / TRIPODS
        if not path.is_file():
            return []
        shots = parse_json_object(read_regular_file(path), "a clip's tripods").get("shots", [])
        return [int(shot.get("first_frame", shot.get("start"))) for shot in shots]

    def rows(self) -> Iterator[tuple[str, Row]]:
        """What the table says about each frame."""
        for id, line in self.lines.items():
            yield id, Row.of_line(line)

    def expect(self, names: Sequence[str]) -> None:
        """Remember the states of files that are read now, unless they were read or written before."""
        for name in names:
            self._expected.setdefault(name, _state(self.folder / name))

    def save(self, frames: Sequence[Saved], order: Sequence[str], options: Mapping[str, Any]) -> dict[str, State]:
        """Write frames, and all files that depend on them; the folder exists, and no other process writes to it.

        Parameters
        ----------
        frames : sequence of Saved
        order : sequence of str
            Ids of all frames, in the order of the lines.
        options : mapping
            Of the record of a run, where there is none yet.

        Returns
        -------
        dict of str to (int, int)
            The states of the files that were written.

        Raises
        ------
        ChangedFileError
            If another program has changed one of them; then nothing is written.
        OSError
            If one cannot be written.
        """
        files: dict[str, bytes | None] = {}
        lines = dict(self.lines)
        for one in frames:
            outcome = _outcome(one)
            lines[one.id] = dict(outcome.line)
            files |= {CAMERAS.file_name(one.id): None, **one.files, **outcome.files}
        lines = {id: lines[id] for id in dict.fromkeys((*_ordered(self.lines, order), *lines)) if id in lines}
        names = [*files, LINES, SOLVER, TABLE, SUMMARY]
        self._check(names)
        self._keep(names)
        self._write(files)
        is_whole = not self.lines or not is_unfinished(self.folder)
        if self.record is None:
            _record(self.folder, options, len(order)).write(self.folder)
        write_lines(self.folder, list(lines.values()))
        if is_whole:
            _write_summary(self.folder, list(lines.values()), options)
        self.lines = lines
        self._expected |= {name: _state(self.folder / name) for name in names}
        return {name: self._expected[name] for name in files}

    def write(self, files: Mapping[str, bytes]) -> dict[str, State]:
        """Write other files; returns their states.

        Raises
        ------
        ChangedFileError, OSError
            As `save`.
        """
        self._check(list(files))
        self._keep(list(files))
        self._write(files)
        self._expected |= {name: _state(self.folder / name) for name in files}
        return {name: self._expected[name] for name in files}

    def _check(self, names: Sequence[str]) -> None:
        """Raise a ChangedFileError if files are not as they were."""
        for name in names:
            now = _state(self.folder / name)
            if now not in (MISSING, self._expected.get(name, MISSING)):
                raise ChangedFileError(
                    f"{name} was changed by another program, and nothing was saved: move it out of {self.folder}, or "
                    "end this one and open the folder again; what was edited here is kept"
                )

    def _keep(self, names: Sequence[str]) -> None:
        """Keep the present versions of files."""
        present = [name for name in names if (self.folder / name).is_file()]
        if not present:
            return
        history = self.folder / HISTORY
        numbers = [int(one.name) for one in history.iterdir() if one.name.isdecimal()] if history.is_dir() else []
        version = history / f"{max(numbers, default=0) + 1:04d}"
        for name in present:
            kept = version / name
            kept.parent.mkdir(parents=True, exist_ok=True)
            try:
                os.link(self.folder / name, kept)  # files are replaced, not changed: the link keeps this version
            except OSError:
                shutil.copy2(self.folder / name, kept)

    def _write(self, files: Mapping[str, bytes | None]) -> None:
        """Write files, and remove those whose content is None."""
        for name, content in files.items():
            path = self.folder / name
            if content is None:
                path.unlink(missing_ok=True)
            else:
                path.parent.mkdir(exist_ok=True)
                write_bytes(path, content)


MISSING: State = (-1, -1)


def _state(path: Path) -> State:
    return FrameFile("", path).state


def _outcome(one: Saved) -> Outcome:
    details = {"basis": one.basis} if one.basis else {}
    return Outcome.of(one.id, one.calibration, keeps=bool(one.calibration), details=details)


def _ordered(lines: Mapping[str, Any], order: Sequence[str]) -> list[str]:
    """Ids of frames as a run orders them: those that have lines as they are, if the others come after them."""
    return list(lines) if lines.keys() - set(order) else list(order)


def _write_summary(folder: Path, lines: Sequence[Mapping[str, Any]], options: Mapping[str, Any]) -> None:
    """Write the summary: with the options, times and notes of the run, and the counts of now."""
    before = json.loads((folder / SUMMARY).read_text()) if (folder / SUMMARY).is_file() else {}
    with LineLog(folder / f"{SUMMARY}.counted") as log:
        results = ResultsWriter(folder, log, notes=before.get("notes", ()))
        for line in lines:
            results.restore(line)
        (folder / f"{SUMMARY}.counted").unlink()
    summary = {**results.summary(before.get("options", options), 0.0)}
    kept = {name: before[name] for name in ("seconds", "milliseconds_per_frame") if name in before}
    write_text(folder / SUMMARY, json.dumps({**summary, **kept}, indent=2) + "\n")


def _record(folder: Path, options: Mapping[str, Any], frames: int) -> RunRecord:
    """The record of results that no run has begun."""
    run = RunOptions(folder, dict(options), COMMAND)
    record = RunRecord.of(run, [], unit=1, writes=[CAMERAS.file_name("<id>")])
    return replace(record, frames=frames)


def source_of(folder: Path) -> list[Path]:
    """The input that the record of a run names.

    Raises
    ------
    ValueError
        If there is none, or it is no longer there.
    """
    record = RunRecord.read(folder)
    paths = [Path(one) for one in getattr(record, "source", ())]
    if not paths or not all(path.exists() for path in paths):
        where = ", ".join(map(str, paths)) or "nothing"
        raise ValueError(
            f"{folder} does not say where its pictures are ({where} in {RECORD}): give them, and this folder by --out"
        )
    return paths
