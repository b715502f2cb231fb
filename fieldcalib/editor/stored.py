"""The folder of results of an editor: read as a run wrote it, and written so that other commands go on from there.

Files are replaced whole. What is replaced is kept in ``history/0001``, ``0002`` and so on. A file that another program
has changed since it was read or written here is not replaced. Of a clip ``clip.jsonl`` and ``tripods.json`` agree with
``cameras.jsonl``, or have a note that says where they do not.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

from fieldcalib.assess.result import Calibration
from fieldcalib.assess.video import VideoCalibration
from fieldcalib.draw.clip_plot import plot_sequence
from fieldcalib.editor.clip import BESIDE, SAME, largest_move, with_cuts
from fieldcalib.editor.table import Row
from fieldcalib.editor.versions import Kept, State, Versions
from fieldcalib.io.files import (
    BrokenFileError,
    named_in_errors,
    parse_json_object,
    read_regular_file,
    whole_file,
    write_text,
)
from fieldcalib.io.formats import CAMERAS
from fieldcalib.io.images import encode_image
from fieldcalib.io.line_log import LineLog
from fieldcalib.io.parquet import write_parquet
from fieldcalib.io.results import LINES, SOLVER, TABLE, ResultFile, Texts, lines_file, split_line
from fieldcalib.io.videos import DEFAULT_RATE
from fieldcalib.run_folder.clip_results import read_clip, write_clip
from fieldcalib.run_folder.options import RunOptions
from fieldcalib.run_folder.outcome import Outcome
from fieldcalib.run_folder.record import RECORD, RunRecord
from fieldcalib.run_folder.results import (
    CLIP,
    MOTION,
    OVERLAY,
    REPORT,
    SUMMARY,
    TRIPODS,
    WORST,
    ResultsWriter,
    is_unfinished,
    read_summary,
)

BY_HAND = "labelled by hand"  # basis of a frame that a person has labelled
BY_HAND_TOO = "labelled by hand and by the network"  # of one in which marks of the network are left too
HISTORY = "history"
COMMAND = "open"
OF_CLIP = (TRIPODS, CLIP)
SHARED = (LINES, SOLVER, TABLE, SUMMARY, *OF_CLIP)  # files of all frames
DRAWN = (OVERLAY, MOTION, WORST, REPORT)  # they show cameras: when these change they are moved to the history
MOVED = {name: f"{name} showed cameras that have changed since: it was moved to {HISTORY}" for name in DRAWN}
"""Notes by the name of the file."""


@dataclass(frozen=True)
class Saved:
    """A frame to be written."""

    id: str
    calibration: Calibration
    basis: str
    """What the camera rests on; empty if nothing is to be said."""
    files: Mapping[str, bytes | None]
    """More files of it, by name in the folder; None removes one."""


@dataclass(frozen=True)
class NewRun:
    """What is recorded of results that no run has begun."""

    options: Mapping[str, Any]
    source: Sequence[Path] = ()
    """Paths of the pictures or of the video."""
    rate: float = DEFAULT_RATE
    """Frames per second."""

    def record(self, folder: Path, frames: int) -> RunRecord:
        """The record for ``run.json``."""
        record = RunRecord.of(RunOptions(folder, self.options, COMMAND), [], unit=1, writes=[CAMERAS.file_name("<id>")])
        return replace(record, frames=frames, source=[str(path.absolute()) for path in self.source])


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
        self.versions = Versions(folder, folder / HISTORY, written)
        self._file: ResultFile | None = None
        self._numbers: dict[str, int] = {}
        self.saves = 0
        """How often cameras were saved here, or taken back."""
        self.replaced: Kept | None = None
        """What the last save replaced."""
        self._read()

    def _read(self) -> None:
        """Read the ids of the frames, and remember the states of the files."""
        self.versions.read_now((*SHARED, *DRAWN))
        has_results = self.has_results(self.folder)
        self._file = ResultFile(lines_file(self.folder)) if has_results else None
        self._numbers = {id: number for number, id in enumerate(self.ids)}

    @staticmethod
    def has_results(folder: Path) -> bool:
        """Whether a folder has results."""
        return (folder / LINES).is_file() or (folder / TABLE).is_file()

    @property
    def ids(self) -> Sequence[str]:
        """Names of the frames that have results, in order."""
        return () if self._file is None else self._file.ids

    def __contains__(self, id: str) -> bool:
        return id in self._numbers

    @property
    def record(self) -> RunRecord | None:
        """The record of the run that wrote them."""
        return RunRecord.read(self.folder)

    @property
    def is_begun_here(self) -> bool:
        """Whether no run wrote them: then some frames have results, as far as they were looked at, and others none."""
        record = self.record
        return record is not None and record.command == COMMAND

    def calibration(self, id: str) -> Calibration | None:
        """The calibration of a frame; None if there is none."""
        number = self._numbers.get(id)
        if self._file is None or number is None or number in self._file.broken:
            return None
        return self._file.calibration(number)

    def basis(self, id: str) -> str:
        """What the camera of a frame rests on; empty where nothing is said."""
        number = self._numbers.get(id)
        return "" if self._file is None or number is None else str(self._file.main(number).get("basis", ""))

    @property
    def cuts(self) -> list[int]:
        """First frames of the shots of a clip, counted from the first frame; empty where nothing says them.

        Raises
        ------
        BrokenFileError
            If ``tripods.json`` is there and does not say them.
        """
        path = self.folder / TRIPODS
        if not path.is_file():
            return []
        with named_in_errors(path):
            shots = parse_json_object(read_regular_file(path), "a clip's tripods").get("shots", [])
            if not isinstance(shots, list):
                raise BrokenFileError(f"'shots': expected a list, got {shots!s:.100}")
            return [_first_frame(shot) for shot in shots]

    def clip(self) -> VideoCalibration | None:
        """The calibration of the frames of a clip together; None if there is none that can be read."""
        try:
            return read_clip(self.folder / CLIP)[0]
        except (FileNotFoundError, BrokenFileError):
            return None

    def rows(self) -> Iterator[tuple[str, Row]]:
        """What the table says about each frame."""
        for line in () if self._file is None else self._file.mains():
            yield line["id"], Row.of_line(line)

    def save(
        self,
        frames: Sequence[Saved],
        order: Sequence[str],
        new: NewRun,
        clip: VideoCalibration | None = None,
        more: Mapping[str, bytes | None] = MappingProxyType({}),
        cuts: Sequence[int] | None = None,
    ) -> dict[str, State]:
        """Write frames, and all files that depend on them; the folder exists, and no other process writes to it.

        Parameters
        ----------
        frames : sequence of Saved
        order : sequence of str
            Ids of all frames, in the order of the lines.
        new : NewRun
            For the record of a run, where there is none yet.
        clip : VideoCalibration, optional
            The calibration of all frames of a clip together.
        more : mapping of str to bytes or None
            Other files of all frames, as those of `Saved`.
        cuts : sequence of int, optional
            First frames of the shots, as a person has set them; of a clip that was not solved with them.

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
        files: dict[str, bytes | None] = dict(more)
        changed: dict[str, Outcome] = {}
        has_changed = any(self._has_changed(one) for one in frames)
        clip = self._as_edited(has_changed, cuts) if clip is None else clip
        moved = [name for name in DRAWN if has_changed and (self.folder / name).is_file()]
        for one in frames:
            outcome = changed[one.id] = _outcome(one)
            files |= {CAMERAS.file_name(one.id): None, **one.files, **outcome.files}
        files |= self._drawn_again(moved, clip, new.rate)
        of_all = SHARED if clip is not None else [name for name in SHARED if name not in OF_CLIP]
        self.replaced = self.versions.begin([*files, *of_all, *([RECORD] if self.record is None else [])])
        states = self.versions.write(files)
        self.saves += 1
        is_whole = self._file is None or not is_unfinished(self.folder)
        if self.record is None:
            new.record(self.folder, len(order)).write(self.folder)
        _write_lines(self.folder, self._lines(changed, order))
        if clip is not None:
            write_clip(self.folder, clip, new.rate)
        self._read()
        if is_whole and self._file is not None:
            _write_summary(self.folder, self._file, new.options, None if clip is None else clip.remarks, moved)
        self.versions.read_now((*SHARED, *DRAWN, RECORD))
        return states

    def take_back(self) -> dict[str, State]:
        """Put back what the last save replaced; returns the states of the files.

        Raises
        ------
        ChangedFileError, OSError
            As `save`.
        """
        assert self.replaced is not None
        states, self.replaced = self.versions.restore(self.replaced), None
        self.saves += 1
        self._read()
        return states

    def _has_changed(self, one: Saved) -> bool:
        """Whether the camera or the status of a frame is another one than that in the files."""
        before = self.calibration(one.id)
        if before is None or before.status != one.calibration.status:
            return True
        old, new = before.camera, one.calibration.camera
        return not (old is new or largest_move(old, new) < SAME)

    def _as_edited(self, has_changed: bool, cuts: Sequence[int] | None) -> VideoCalibration | None:
        """The calibration of a clip with other shots, and a note if frames differ; None if nothing is to be written."""
        before = self.clip()
        if before is None:
            return None
        clip = before if cuts is None else with_cuts(before, cuts)
        if has_changed and BESIDE not in clip.notes:
            clip = replace(clip, notes=(*clip.notes, BESIDE))
        return None if (clip.shots, clip.notes) == (before.shots, before.notes) else clip

    def _drawn_again(self, moved: Sequence[str], clip: VideoCalibration | None, rate: float) -> dict[str, bytes | None]:
        """Files that show cameras, None where they are not drawn again: only the plot of a clip is, where it agrees."""
        files: dict[str, bytes | None] = dict.fromkeys(moved)
        if clip is not None and BESIDE not in clip.notes and (MOTION in files or MOTION in self.moved):
            files[MOTION] = encode_image(plot_sequence(clip, frames_per_second=rate), Path(MOTION).suffix)
        return files

    def _lines(self, changed: Mapping[str, Outcome], order: Sequence[str]) -> Iterator[Texts]:
        """The lines of all frames, as they are or changed: in their order, if all have one, else as given."""
        ids = order if self._numbers.keys() <= set(order) else (*self.ids, *order)
        for id in dict.fromkeys(ids):
            if id in changed:
                main, solver = (json.dumps(part).encode() for part in split_line(changed[id].line))
                yield main, solver
            elif self._file is not None and id in self._numbers:
                yield _texts(self._file, self._numbers[id])

    @property
    def moved(self) -> list[str]:
        """Files that show cameras and were moved to the history, as these have changed since."""
        notes = read_summary(self.folder).get("notes", []) if (self.folder / SUMMARY).is_file() else []
        return [name for name in DRAWN if MOVED[name] in notes and not (self.folder / name).is_file()]

    def drew(self, options: Mapping[str, Any]) -> None:
        """Take note of files that were drawn again."""
        if self._file is not None and not is_unfinished(self.folder):
            _write_summary(self.folder, self._file, options, None, [])
        self.versions.read_now((*SHARED, *DRAWN))

    def write(self, files: Mapping[str, bytes]) -> dict[str, State]:
        """Write other files; returns their states.

        Raises
        ------
        ChangedFileError, OSError
            As `save`.
        """
        self.versions.begin(files)
        return self.versions.write(files)


def is_by_hand(basis: str) -> bool:
    """Whether the basis of a frame says that a person has mended it."""
    return basis in (BY_HAND, BY_HAND_TOO)


def _first_frame(shot: object) -> int:
    first = shot.get("first_frame", shot.get("start")) if isinstance(shot, dict) else None
    if isinstance(first, bool) or not isinstance(first, int) or first < 0:
        raise BrokenFileError(f"'shots': expected the number of a 'first_frame' in each, got {shot!s:.100}")
    return first


def _outcome(one: Saved) -> Outcome:
    details = {"basis": one.basis} if one.basis else {}
    return Outcome.of(one.id, one.calibration, keeps=bool(one.calibration), details=details)


def _texts(file: ResultFile, number: int) -> Texts:
    """The lines of a frame in both files, which older folders do not have."""
    main, solver = file.texts(number)
    if solver:
        return main.rstrip(b"\n"), solver.rstrip(b"\n")
    first, second = (json.dumps(part).encode() for part in split_line(file.line(number)))
    return first, second


def _write_lines(folder: Path, lines: Iterator[Texts]) -> None:
    if lines_file(folder).name == TABLE:
        write_parquet(((main + b"\n", solver + b"\n") for main, solver in lines), folder / TABLE)
        return
    with ExitStack() as files:  # solver.jsonl is replaced first
        main_file, solver_file = (files.enter_context(whole_file(folder / name)) for name in (LINES, SOLVER))
        for main, solver in lines:
            main_file.write(main + b"\n")
            solver_file.write(solver + b"\n")


def _write_summary(
    folder: Path, file: ResultFile, options: Mapping[str, Any], notes: Sequence[str] | None, moved: Sequence[str]
) -> None:
    """Write the summary: with the options and times of the run, and the counts of now.

    The notes are those of the clip, None for those of before, and those of files that were moved to the history.
    """
    before = read_summary(folder) if (folder / SUMMARY).is_file() else {}
    old = before.get("notes", [])
    gone = [MOVED[name] for name in DRAWN if not (folder / name).is_file() and (name in moved or MOVED[name] in old)]
    rest = [note for note in (old if notes is None else notes) if note not in MOVED.values()]
    with LineLog(folder / f"{SUMMARY}.counted") as log:
        results = ResultsWriter(folder, log, notes=[*rest, *gone])
        for line in file.mains():
            results.restore(line)
        (folder / f"{SUMMARY}.counted").unlink()
    summary = {**results.summary(before.get("options", options), 0.0)}
    kept = {name: before[name] for name in ("seconds", "milliseconds_per_frame") if name in before}
    write_text(folder / SUMMARY, json.dumps({**summary, **kept}, indent=2) + "\n")


def source_of(folder: Path) -> list[Path]:
    """The input that the record of a run names.

    Raises
    ------
    ValueError
        If there is none, or it is no longer there.
    """
    record = RunRecord.read(folder)
    paths = [Path(one) for one in (() if record is None else record.source)]
    if not paths or not all(path.exists() for path in paths):
        where = ", ".join(map(str, paths)) or "nothing"
        raise ValueError(
            f"{folder} does not say where its pictures are ({where} in {RECORD}): open them, with this "
            f"folder as the one of the results (out)"
        )
    return paths
