"""The results in the folder of an editor: read as a run wrote them, and written so that other commands can use them.

Files are replaced together (`fieldcalib.editor.label_versions`), and replaced files are kept in ``history/0001``,
``0002`` and so on. Only files are replaced that a run has written, according to its record, or that were written here,
and that nobody has changed since. The files of a clip, ``clip.jsonl`` and ``tripods.json``, agree with
``cameras.jsonl``, or have a note that says where they do not.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, replace
from dataclasses import field as attribute
from pathlib import Path
from types import MappingProxyType
from typing import Any

from fieldcalib._whole_files import whole_file, write_text
from fieldcalib.assess.findings import Finding, What
from fieldcalib.assess.result import Calibration
from fieldcalib.assess.video import VideoCalibration
from fieldcalib.draw.clip_plot import plot_sequence
from fieldcalib.editor.clip import BESIDE, SAME, largest_move, with_cuts
from fieldcalib.editor.frame_states import Row, Spilled
from fieldcalib.editor.journal import finish_save
from fieldcalib.editor.label_files import LABELS, label_file
from fieldcalib.editor.label_versions import MISSING, Announce, Kept, Staged, State, Versions
from fieldcalib.io.decoders import DEFAULT_RATE
from fieldcalib.io.files import BrokenFileError, named_in_errors, parse_json_object, read_regular_file
from fieldcalib.io.formats import CAMERAS, OVERLAYS
from fieldcalib.io.image_files import encode_image
from fieldcalib.io.output_folder import LineLog
from fieldcalib.io.parquet import write_parquet
from fieldcalib.io.results import LINES, SOLVER, TABLE, ResultFile, Texts, lines_file, split_line
from fieldcalib.run_folder.clip_results import read_clip, write_clip
from fieldcalib.run_folder.record import RECORD, Outcome, RunOptions, RunRecord
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

HISTORY = "history"
DRAWING = ".fieldcalib-drawing"  # folder for files that are being drawn
COMMAND = "open"
OF_CLIP = (TRIPODS, CLIP)
SHARED = (LINES, SOLVER, TABLE, SUMMARY, *OF_CLIP)  # files of all frames
DRAWN = (OVERLAY, MOTION, WORST, REPORT)  # files that show cameras; when cameras change, they are moved to the history
MOVED = {name: str(Finding(What.MOVED, name)) for name in DRAWN}
"""Notes that a file was moved to the history, by name of the file."""


@dataclass(frozen=True)
class Saved:
    """A frame to be written."""

    id: str
    calibration: Calibration
    basis: str
    """Basis of the camera, as "labelled by hand"; empty if there is none to record."""
    files: Mapping[str, bytes | None]
    """Contents of other files of the frame, by name in the folder; None to remove a file."""


@dataclass(frozen=True)
class LastSave:
    """Report of a save."""

    replaced: Kept | None = None
    """The files that it replaced, and where they are kept."""
    failed: Mapping[str, str] = attribute(default_factory=dict)
    """Reasons why frames could not be saved, by id."""


@dataclass(frozen=True)
class NewRun:
    """Values for ``run.json`` of results that no run has begun."""

    options: Mapping[str, Any]
    source: Sequence[Path] = ()
    """Paths of the pictures or of the video."""
    rate: float = DEFAULT_RATE
    """Frames per second."""

    def record(self, folder: Path, frames: int) -> RunRecord:
        """Make the record for ``run.json``."""
        record = RunRecord.of(RunOptions(folder, self.options, COMMAND), [], unit=1)
        return replace(record, frames=frames, source=[str(path.absolute()) for path in self.source])


class Stored:
    """Results in a folder, which may be empty or not exist yet.

    Parameters
    ----------
    folder : Path
    overwrite : bool
        Whether files may be replaced that were written neither by a run nor from the page.

    Raises
    ------
    BrokenFileError
        If a line is no result.
    """

    def __init__(self, folder: Path, *, overwrite: bool = False) -> None:
        self.folder = folder
        self.versions = Versions(folder, HISTORY, replaces=overwrite)
        self._file: ResultFile | None = None
        self._numbers: dict[str, int] = {}
        self.saves = 0
        """How often cameras were saved here, or a save was taken back."""
        self.replaced: Kept | None = None
        """The files that the last save replaced."""
        with suppress(OSError):  # another program writes there, or the disk is full: the next save completes it
            finish_save(folder, self.versions)
        self._read()

    def _read(self) -> None:
        """Read the ids of the frames, and register the shared files that a run has written."""
        record = self.record
        if record is not None:
            self.versions.read_now((RECORD, *SHARED, *(DRAWN if record.command != COMMAND else ())))
        has_results = self.has_results(self.folder)
        self._file = ResultFile(lines_file(self.folder)) if has_results else None
        self._numbers = {id: number for number, id in enumerate(self.ids)}

    def know(self, written: Mapping[str, State]) -> bool:
        """Register files that were written here; returns whether a run has replaced them since, except the labels."""
        record = written.get(RECORD, MISSING)
        is_replaced = record != MISSING and not record.is_of(self.folder / RECORD)
        known = {name: state for name, state in written.items() if not is_replaced or name.startswith(LABELS)}
        self.versions.know(known)
        self._read()
        return is_replaced

    def _expect(self, id: str) -> None:
        """Register the files of a frame that a run has written; the camera's only if it agrees with its line."""
        record, overlay = self.record, OVERLAYS.file_name(id)
        if id not in self or record is None or self._file is None:
            return
        if record.command != COMMAND and overlay in record.files_of(id) and not self.versions.knows(overlay):
            self.versions.read_now([overlay])
        for camera, content in record.camera_file(self._file.main(self._numbers[id])).items():
            path, is_own = self.folder / camera, self.versions.is_own(camera)
            if not is_own and State.of(path).size == len(content) and path.read_bytes() == content:
                self.versions.read_now([camera])

    def check_in_the_way(self, ids: Iterable[str], reads: Sequence[Path]) -> None:
        """Check that saving would replace neither given label files nor, in a folder without a run, files of others.

        Raises
        ------
        FileExistsError
            If it would; the message names the file.
        """
        for path in reads:
            if (self.folder / LABELS).resolve() in path.resolve().parents or (
                path.resolve().parent == self.folder.resolve() and path.name.startswith(LABELS)
            ):
                raise FileExistsError(
                    f"{path} is read, and saving labels into {self.folder} would write over it: give another folder "
                    "(--out); labels that the page has saved there are shown without --labels"
                )
        if self.record is not None:
            return
        of_frames = (name for id in ids for name in (OVERLAYS.file_name(id), label_file(id)))
        if foreign := self.versions.foreign([RECORD, *SHARED, *of_frames]):
            raise FileExistsError(
                f"{self.folder / foreign[0]} is there already, and no run has written it: give another folder (--out), "
                "or --overwrite to replace it"
            )

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
        """Record of the run that wrote the results."""
        return RunRecord.read(self.folder)

    @property
    def is_begun_here(self) -> bool:
        """Whether the results were begun by the editor and not by a run: then only frames that were opened have any."""
        record = self.record
        return record is not None and record.command == COMMAND

    def calibration(self, id: str) -> Calibration | None:
        """The calibration of a frame; None if there is none."""
        number = self._numbers.get(id)
        if self._file is None or number is None or number in self._file.unreadable:
            return None
        return self._file.calibration(number)

    def basis(self, id: str) -> str:
        """Basis of the camera of a frame; empty if none is recorded."""
        number = self._numbers.get(id)
        return "" if self._file is None or number is None else str(self._file.main(number).get("basis", ""))

    @property
    def cuts(self) -> list[int]:
        """First frames of the shots of a clip, counted from the first frame; empty if they are not recorded.

        Raises
        ------
        BrokenFileError
            If ``tripods.json`` exists but does not have them.
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
        """Joint calibration of the frames of a clip; None if there is none that can be read."""
        try:
            return read_clip(self.folder / CLIP)[0]
        except (FileNotFoundError, BrokenFileError):
            return None

    def rows(self) -> Iterator[tuple[str, Row]]:
        """Yield the id and the table's row of each frame."""
        for line in () if self._file is None else self._file.mains():
            yield line["id"], Row.of_line(line)

    def save(
        self,
        frames: Iterable[Saved],
        order: Sequence[str],
        new: NewRun,
        announce: Announce,
        *,
        clip: VideoCalibration | None = None,
        more: Mapping[str, bytes | None] = MappingProxyType({}),
        cuts: Sequence[int] | None = None,
    ) -> None:
        """Write frames, and all files that depend on them; the folder exists, and no other process writes to it.

        Parameters
        ----------
        frames : iterable of Saved
        order : sequence of str
            Ids of all frames, in the order of the lines.
        new : NewRun
            Values for the record, if there is none yet.
        announce : callable
            As of `Versions.replacing`.
        clip : VideoCalibration, optional
            The calibration of all frames of a clip together.
        more : mapping of str to bytes or None
            Contents of other files, as in `Saved.files`.
        cuts : sequence of int, optional
            First frames of the shots, as a person has set them; of a clip that was not solved with them.

        Raises
        ------
        ChangedFileError
            If a file would be replaced that was written neither by a run nor from the page, or that was changed since;
            then nothing is written.
        UnfinishedSaveError
            If files could not be moved to their places after they were announced.
        OSError
            If one cannot be written; then nothing is changed.
        """
        self.versions.check([RECORD, LINES, SOLVER, TABLE, SUMMARY])  # they are read too
        is_whole = self._file is None or not is_unfinished(self.folder)
        record = self.record or new.record(self.folder, len(order))
        with self.versions.replacing(announce, beside=[RECORD]) as staged:
            changed, texts = dict[str, int](), Spilled()
            has_changed = False
            for one in frames:
                self._expect(one.id)
                has_changed = has_changed or self._has_changed(one)
                outcome = Outcome.of(one.id, one.calibration, details={"basis": one.basis} if one.basis else {})
                camera = {CAMERAS.file_name(one.id): None, **record.camera_file(outcome.line)}
                for name, content in {**camera, **one.files}.items():
                    staged.put(name, content)
                main, solver = (json.dumps(part).encode() for part in split_line(outcome.line))
                changed[one.id] = texts.add((main, solver))
            for name, content in more.items():
                staged.put(name, content)
            clip = self._as_edited(has_changed, cuts) if clip is None else clip
            for name in DRAWN if has_changed else ():
                staged.put(name, None)
            self._draw_motion(staged, clip, new.rate)
            if self.record is None:
                record.write(staged.folder)
            _write_lines(
                staged.folder, self._lines(changed, texts, order), as_table=lines_file(self.folder).name == TABLE
            )
            if clip is not None:
                write_clip(staged.folder, clip, new.rate)
            if is_whole:
                file = ResultFile(lines_file(staged.folder))
                self._write_summary(staged, record, file.mains(), new.options, None if clip is None else clip.remarks)

    def note_saved(self, replaced: Kept | None) -> None:
        """Read the results again after a save, or after one was taken back, and remember the files it replaced."""
        self.saves, self.replaced = self.saves + 1, replaced
        self._read()

    def take_back(self, announce: Announce) -> None:
        """Restore the files that the last save replaced.

        Raises
        ------
        ChangedFileError, UnfinishedSaveError, OSError
            As `save`.
        """
        assert self.replaced is not None
        self.versions.restore(self.replaced, announce)

    def _has_changed(self, one: Saved) -> bool:
        """Whether the camera or the status of a frame differs from that in the files."""
        before = self.calibration(one.id)
        if before is None or before.status != one.calibration.status:
            return True
        old, new = before.camera, one.calibration.camera
        return not (old is new or largest_move(old, new) < SAME)

    def _as_edited(self, has_changed: bool, cuts: Sequence[int] | None) -> VideoCalibration | None:
        """Update the stored clip: its cuts, and a finding if frames differ from it; None if nothing changes."""
        before = self.clip()
        if before is None:
            return None
        clip = before if cuts is None else with_cuts(before, cuts)
        if has_changed and BESIDE not in clip.findings:
            clip = replace(clip, findings=(*clip.findings, BESIDE))
        return None if (clip.shots, clip.findings) == (before.shots, before.findings) else clip

    def _draw_motion(self, staged: Staged, clip: VideoCalibration | None, rate: float) -> None:
        """Draw the plot of a clip again, if the frames agree with the clip."""
        is_gone = (MOTION in staged.removed and self.versions.knows(MOTION)) or MOTION in self.moved
        if is_gone and clip is not None and BESIDE not in clip.findings:
            staged.put(MOTION, encode_image(plot_sequence(clip, frames_per_second=rate), Path(MOTION).suffix))

    def _lines(self, changed: Mapping[str, int], texts: Spilled, order: Sequence[str]) -> Iterator[Texts]:
        """Yield the record of each frame, replaced where it changed; sorted by `order` if that names every frame."""
        ids = order if self._numbers.keys() <= set(order) else (*self.ids, *order)
        for id in dict.fromkeys(ids):
            if id in changed:
                yield texts[changed[id]]
            elif self._file is not None and id in self._numbers:
                yield _texts(self._file, self._numbers[id])

    def _write_summary(
        self,
        staged: Staged,
        record: RunRecord,
        lines: Iterable[Mapping[str, Any]],
        options: Mapping[str, Any],
        notes: Sequence[str] | None = None,
    ) -> None:
        """Write the summary, with the options and times of the run and the present counts.

        `notes` are those of the clip, None to keep the old ones; notes on files moved to the history are added.
        """
        before = self._summary
        moved = before.get("moved", [])
        old = before.get("notes", [])[: -len(moved) or None]
        removed = {name for name in staged.removed if self.versions.knows(name)}
        gone = [name for name in DRAWN if not staged.has(name) and (name in removed or name in moved)]
        rest = old if notes is None else notes
        counted = staged.path(f"{SUMMARY}.counted")
        with LineLog(counted) as log:
            results = ResultsWriter(staged.folder, record, log, notes=[*rest, *(MOVED[name] for name in gone)])
            for line in lines:
                results.restore(line)
        counted.unlink()
        summary = {**results.summary(before.get("options", options), 0.0)}
        kept = {name: before[name] for name in ("seconds", "milliseconds_per_frame") if name in before}
        told = {"moved": gone} if gone else {}
        write_text(staged.folder / SUMMARY, json.dumps({**summary, **told, **kept}, indent=2) + "\n")

    @property
    def _summary(self) -> dict[str, Any]:
        """Summary that a run or the editor has written; empty if there is none."""
        is_own = self.versions.knows(SUMMARY) and (self.folder / SUMMARY).is_file()
        return read_summary(self.folder) if is_own else {}

    @property
    def moved(self) -> list[str]:
        """Names of files that show cameras, and were moved to the history when cameras changed."""
        moved = self._summary.get("moved", [])
        return [name for name in DRAWN if name in moved and not (self.folder / name).is_file()]

    @contextmanager
    def drawing(self) -> Iterator[Path]:
        """Provide a folder for drawings, on the same disk, which is removed at the end of the context."""
        folder = self.folder / DRAWING
        shutil.rmtree(folder, ignore_errors=True)  # left by a process that was killed
        folder.mkdir()
        try:
            yield folder
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    def draw(self, drawn: Path, options: Mapping[str, Any], announce: Announce) -> None:
        """Move drawn files here from a folder on the same disk, and remove the notes that they are missing.

        Raises
        ------
        ChangedFileError, UnfinishedSaveError, OSError
            As `save`.
        """
        with self.versions.replacing(announce) as staged:
            for path in drawn.iterdir():
                path.replace(staged.path(path.name))
            record = self.record
            if self._file is not None and record is not None and not is_unfinished(self.folder):
                self._write_summary(staged, record, self._file.mains(), options)

    def write(self, files: Mapping[str, bytes], announce: Announce) -> None:
        """Write other files.

        Raises
        ------
        ChangedFileError, UnfinishedSaveError, OSError
            As `save`.
        """
        with self.versions.replacing(announce) as staged:
            for name, content in files.items():
                staged.put(name, content)


def _first_frame(shot: object) -> int:
    first = shot.get("first_frame") if isinstance(shot, dict) else None
    if isinstance(first, bool) or not isinstance(first, int) or first < 0:
        raise BrokenFileError(f"'shots': expected the number of a 'first_frame' in each, got {shot!s:.100}")
    return first


def _texts(file: ResultFile, number: int) -> Texts:
    """The lines of a frame as they are written: two, also of a frame whose line is whole."""
    main, solver = file.texts(number)
    if solver:
        return main, solver
    first, second = (json.dumps(part).encode() for part in split_line(file.line(number)))
    return first, second


def _write_lines(folder: Path, lines: Iterator[Texts], *, as_table: bool) -> None:
    if as_table:
        write_parquet(((main + b"\n", solver + b"\n") for main, solver in lines), folder / TABLE)
        return
    with ExitStack() as files:
        main_file, solver_file = (files.enter_context(whole_file(folder / name)) for name in (LINES, SOLVER))
        for main, solver in lines:
            main_file.write(main + b"\n")
            solver_file.write(solver + b"\n")


def source_of(folder: Path) -> list[Path]:
    """Paths of the input, from the record of a run.

    Raises
    ------
    ValueError
        If there is no record, or the input is no longer there.
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
