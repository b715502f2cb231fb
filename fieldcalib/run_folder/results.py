"""The folder of results of a run, written frame by frame, so that a run that ends at any time can be resumed.

``run.json`` is written first and ``summary.json`` last. In between each frame gets its line in ``solver.jsonl``, then
its line in ``cameras.jsonl``, and then its files. So a frame has all of its files if another line follows, and only the
last frame has to be done again. And every file of a frame has a line, which shows that it belongs to the run.
"""

from __future__ import annotations

import json
import math
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, replace
from dataclasses import field as attribute
from itertools import chain
from pathlib import Path
from typing import Any

import fieldcalib
from fieldcalib._progress import counted, say, show
from fieldcalib._whole_files import remove_temporaries, whole_file, write_bytes, write_text
from fieldcalib.assess.advice import WITHOUT_GIVEN
from fieldcalib.assess.findings import Verdict, What
from fieldcalib.io.files import BrokenFileError, FrameFile, named_in_errors, parse_json_object, read_regular_file
from fieldcalib.io.formats import CAMERAS, OVERLAYS, VIDEOS
from fieldcalib.io.output_folder import ELSEWHERE, LineLog, check_targets, output_folder, whole_lines
from fieldcalib.io.parquet import read_parquet, write_parquet
from fieldcalib.io.results import BROKEN, LINES, SOLVER, TABLE, lines_file, parse_main, split_line, whole_line_pairs
from fieldcalib.run_folder.record import (
    CAMERA_FILE,
    ESTIMATED,
    PARQUET,
    RECORD,
    Outcome,
    RunOptions,
    RunRecord,
    ToLookAt,
    has_finding,
    is_squashed,
)

SUMMARY = "summary.json"  # only finished runs have one
MOTION, WORST, TRIPODS, CLIP = "motion.png", "worst_frames.jpg", "tripods.json", "clip.jsonl"
LOCALIZED = "localized.jsonl"
OVERLAY = VIDEOS.file_name("overlay")
REPORT = "report.html"
SHARED_FILES = (SUMMARY, MOTION, WORST, TRIPODS, CLIP, OVERLAY, REPORT)  # files that do not belong to a single frame
WITHOUT_PICTURES = frozenset({"calibrate", "localize"})  # commands that write only the summary of these
PART_OF_CLIP = ".part-"  # prefix of files that keep parts of a clip until all are done
# Least number and share of frames found to have pixels that are not square, for a warning. Of 728 annotated frames none
# is found so, of the same frames squashed to 640x640 one in fifteen, with width and height swapped more than half.
SUSPICIOUS = 3, 0.05
# Width / height of pictures that were probably squashed or cropped: broadcasts have 4:3 and more.
NEARLY_SQUARE = 0.9, 1.3
DECLARATIONS = ("display_size", "crop_of", "intrinsics")  # options that declare the shape of pictures,
GIVEN = (*DECLARATIONS, "position", "rotation")  # options that, if they are wrong, lead to rejected cameras
ASPECT = "aspect"  # option that declares the shape of pictures too, unless its value is "estimated"
OBJECT = "an object"
RESUME, AGAIN = "--resume goes on with it", "--overwrite begins anew"


class UsedFolderError(FileExistsError):
    """Raised if the folder has results already; says which, and by which command line options to go on."""

    def __init__(self, found: str, options: str) -> None:
        super().__init__(f"{found}: {options}")
        self.found = found


@dataclass
class ResultsWriter:
    """Writes the results of frames, and counts them."""

    out: Path
    record: RunRecord
    log: LineLog
    solver: LineLog | None = None
    """The second file of lines; None if there is only one."""
    done: int = 0
    """Number of frames that are written."""
    restored: list[str] = attribute(default_factory=list)
    """Ids of the frames that an earlier part of the run has written, in order."""
    statuses: Counter[str] = attribute(default_factory=Counter)
    verdicts: Counter[str] = attribute(default_factory=Counter)
    cameras: int = 0
    to_look_at: ToLookAt = attribute(default_factory=ToLookAt)
    squashed: int = 0
    nearly_square: int = 0
    calibrated: int = 0
    """Number of frames that were calibrated now, not in an earlier part of the run."""
    calibrating: float = 0.0
    """Seconds that their calibration took, without reading and writing files and pictures."""
    notes: Sequence[str] = ()
    """Notes about the camera of a clip."""
    complaints: list[str] = attribute(default_factory=list)
    """Lines for stderr that are held back until a frame could be read."""

    def add(self, outcome: Outcome) -> None:
        """Write the line of the next frame and its files, and print its complaint, if any, on stderr."""
        self.complaints += filter(None, [outcome.complaint])
        self._append(outcome.line)
        for name, content in {**outcome.files, **self.record.camera_file(outcome.line)}.items():
            if Path(name).name != name:
                raise ValueError(f"frame {outcome.id!r} cannot name a file: give it a name without / and the like")
            write_bytes(self.out / name, content)
        self._count(outcome.line, outcome.squashed)
        self.calibrated += bool(_verdict_on_camera(outcome.line))
        if not self.is_unreadable:
            self.complain()

    @property
    def is_unreadable(self) -> bool:
        """Whether none of the frames could be read."""
        return self.done == self.statuses[BROKEN]

    def complain(self) -> None:
        """Print what was held back."""
        for complaint in self.complaints:
            say(complaint)
        self.complaints.clear()

    def check_readable(self) -> None:
        """Raise a BrokenFileError, with the first complaint, if there are frames and none could be read."""
        if self.done and self.is_unreadable and self.record.shard is None and not self.restored:
            others = f"; nor can {counted(self.done - 1, 'other')} be read" if self.done > 1 else ""
            said = f"{self.complaints[0]}{others}" if self.complaints else "no frame can be read"
            self.complaints.clear()
            raise BrokenFileError(f"{said}; nothing is written")

    def _append(self, line: Mapping[str, Any]) -> None:
        if self.solver is None:
            self.log.append(json.dumps(line))
            return
        main, solver = split_line(line)
        self.solver.append(json.dumps(solver))
        self.log.append(json.dumps(main))

    def check_restored(self, number: int, id: str) -> None:
        """Raise a BrokenFileError if an earlier part of the run has written another frame in the place of this one."""
        if number < len(self.restored) and self.restored[number] != id:
            raise BrokenFileError(
                f"{self.log.path}, line {number + 1}: expected frame {id!r}, got {self.restored[number]!r}: lines are "
                f"missing or were moved; --overwrite begins anew"
            )

    def restore(self, line: Mapping[str, Any]) -> None:
        """Count a frame that was written before."""
        self.restored.append(line["id"])
        self._count(line, is_squashed(line))

    def _count(self, line: Mapping[str, Any], squashed: bool) -> None:
        verdict = _verdict_on_camera(line)
        self.done += 1
        self.statuses[line["status"]] += 1
        if verdict:
            self.verdicts[verdict] += 1
        self.cameras += self.record.keeps(line)
        self.to_look_at.add(line)
        self.squashed += squashed
        self.nearly_square += is_nearly_square(line)

    @property
    def exit_code(self) -> int:
        """1 if files were broken."""
        return 1 if self.statuses[BROKEN] else 0

    def summary(self, options: Mapping[str, Any], seconds: float) -> dict[str, Any]:
        """Content of summary.json; `seconds` is the total time."""
        return {
            "frames": self.done,
            "cameras": self.cameras,
            "completeness": 100.0 * self.cameras / max(self.done, 1),
            "verdict": {verdict.value: self.verdicts[verdict] for verdict in Verdict},
            "status": dict(self.statuses),
            **({"notes": list(self.notes)} if self.notes else {}),
            "seconds": {"calibration": self.calibrating, "total": seconds},
            "milliseconds_per_frame": 1e3 * self.calibrating / max(self.calibrated, 1),
            "options": options,
            "version": fieldcalib.__version__,
        }

    def say(self, options: Mapping[str, Any]) -> None:
        """Print the number of cameras; on stderr also the frames to look at, and doubts about the options."""
        broken = [counted(self.statuses[BROKEN], BROKEN)] * bool(self.statuses[BROKEN])
        counts = [f"{self.verdicts[verdict]} {verdict}" for verdict in Verdict if self.verdicts[verdict]] + broken
        show(f"{counted(self.cameras, 'camera')} of {counted(self.done, 'frame')} in {self.out}: {', '.join(counts)}")
        self._say_what_to_look_at(options)
        self._ask_about_shape(options)
        own = self.cameras if CAMERA_FILE in self.record.writes else 0
        others = sum(1 for _ in self.out.glob(CAMERAS.file_name("*"))) - own
        if others > 0:
            verb = "is" if others == 1 else "are"
            say(f"{counted(others, 'camera')} in {self.out} {verb} not of this run")

    def _ask_about_shape(self, options: Mapping[str, Any]) -> None:
        """Ask on stderr whether the pictures were squashed or cropped, if they look so and no option declares it."""
        frames = counted(self.done, "frame")
        if self.squashed >= max(SUSPICIOUS[0], SUSPICIOUS[1] * self.verdicts.total()):
            seen = f"{self.squashed} of {frames} show pixels that are not square"
            say(f"{seen}: is the size right? --aspect declares squashed pictures")
            return
        is_declared = any(options.get(name, "") is not None for name in DECLARATIONS)
        if self.nearly_square and not is_declared and options.get(ASPECT) in (None, ESTIMATED):
            verb = "is" if self.nearly_square == 1 else "are"
            say(
                f"{self.nearly_square} of {frames} {verb} nearly square: pictures of broadcasts of that shape were "
                f"squashed, which --aspect declares, or cropped, which --crop-of does"
            )

    def _say_what_to_look_at(self, options: Mapping[str, Any]) -> None:
        """Print on stderr the first frames that are not good, and where to find all of them."""
        where = [self.out / (TABLE if options.get("format") == PARQUET else LINES)]
        if (self.out / WORST).exists():
            where.append(self.out / WORST)
        elif any((self.out / OVERLAYS.file_name(stretch.first)).exists() for stretch in self.to_look_at.stretches):
            where.append(self.out / OVERLAYS.file_name("<id>"))
        message = self.to_look_at.message(*map(str, where), given=self.record.given)
        if message:
            say(message)
        given = [f"--{name.replace('_', '-')}" for name in GIVEN if name in self.record.given]
        if given and (self.verdicts[Verdict.REJECT] or WITHOUT_GIVEN in self.to_look_at.remedies):
            say(f"{WITHOUT_GIVEN.text}: {', '.join(given)}")


@contextmanager
def open_camera_folder(
    run: RunOptions, record: RunRecord, began: float, files: Sequence[FrameFile] = ()
) -> Iterator[ResultsWriter]:
    """Open the folder of results for cameras, frame by frame; it gets its summary.json if no error is raised.

    `began` is the value of `time.perf_counter` at the start; `files` as in `open_run_folder`.
    """
    if run.writes_table and run.shard is not None:
        raise ValueError(f"--format {PARQUET} is of whole runs: --shard writes {LINES}, fieldcalib join makes a table")
    with open_run_folder(run, record, files=files) as results:
        yield results
        results.check_readable()
        finish(run.out, results.summary(run.recorded, time.perf_counter() - began))
        if results.done or run.shard is None:
            results.say(run.recorded)
    write_table(run)


def write_table(run: RunOptions) -> None:
    """Replace ``cameras.jsonl`` by a table, if the options ask for it."""
    if run.writes_table:
        with output_folder(run.out):
            write_parquet(whole_line_pairs(run.out), run.out / TABLE)
            (run.out / LINES).unlink()
            (run.out / SOLVER).unlink()


@contextmanager
def open_run_folder(
    run: RunOptions, record: RunRecord, lines: str = LINES, files: Sequence[FrameFile] = ()
) -> Iterator[ResultsWriter]:
    """Lock the folder of results and restore a run that is resumed; `lines` is the name of its log.

    `files` are the files that the run reads; the files of its results are named after their ids.

    Raises
    ------
    UsedFolderError
        If the folder holds the results of a run and neither --resume nor --overwrite is given.
    FileExistsError
        If a file would be overwritten that is read, or that no run has written.
    BrokenFileError
        If the record or a line of the run to be resumed is invalid; the message begins with its file.
    ValueError
        If the run to be resumed had other options, or another input.
    """
    out = run.out
    with output_folder(out):
        earlier = None if run.overwrite else _earlier(out, record, resume=run.resume)
        _check_targets(run, record, lines, files)
        _restore_lines(run)
        if run.overwrite:
            _clear(out)
        remove_temporaries(out)
        count, has_solver = _count(out, lines), lines == LINES
        results: ResultsWriter | None = None
        try:
            if earlier is None:
                record.write(out)
            if run.resume and is_finished(out) and _frames_told(out) > count:
                (out / SUMMARY).unlink()  # lines have been lost since
            kept = count if is_finished(out) else max(count - 1, 0)
            with ExitStack() as logs:
                log = logs.enter_context(LineLog(out / lines, kept))
                solver = logs.enter_context(LineLog(out / SOLVER, kept)) if has_solver else None
                results = ResultsWriter(out, record, log, solver)
                _restore(results, lines)
                yield results
                results.complain()
        except BaseException as error:
            remove_temporaries(out)  # left by an interrupt between the creation of one and its use
            if results is not None:
                results.complain()
            if earlier is None and (results is None or results.is_unreadable) and not any(out.glob(f"{PART_OF_CLIP}*")):
                _remove(_files_of_run(out, record))
                _forget(out)
                if isinstance(error, KeyboardInterrupt):
                    say("no frame was done: run it again")
            elif results is not None and not is_finished(out):
                done = f"{counted(results.done, 'frame')} done in {out}"
                say(done if record.is_of_stream else f"{done}: {RESUME}")
            raise


def _verdict_on_camera(line: Mapping[str, Any]) -> str:
    """The verdict on the calibration of a frame; empty where its file could not be read."""
    return "" if line["status"] == BROKEN else str(line.get("verdict", ""))


def _check_targets(run: RunOptions, record: RunRecord, lines: str, files: Sequence[FrameFile]) -> None:
    """Check the files that a run will write, or remove before, see `fieldcalib.io.output_folder.check_targets`."""
    out, earlier = run.out, _record_or_none(run.out)
    of_run = {RECORD, lines, *((SOLVER, TABLE) if lines == LINES else ()), *shared_files(run.command)}
    of_frames = {name: file.id for file in files for name in record.files_of(file.id)}
    taken = next(iter(sorted(of_run & of_frames.keys())), None)
    if taken is not None:
        raise FileExistsError(
            f"the result of frame {of_frames[taken]!r} would be {taken}, which is a file of the run itself: rename it"
        )
    removed = _files_of_run(out, earlier) if run.overwrite else ()
    reads = [file.on_disk for file in files] + ([run.field_file] if run.field_file is not None else [])
    check_targets(
        chain((out / name for name in (*of_frames, *of_run)), removed),
        reads,
        replaces=run.overwrite or earlier is not None,
        remedy=f"no run has written it; {ELSEWHERE}, or --overwrite to replace it",
    )


def _restore(results: ResultsWriter, lines: str) -> None:
    """Count the frames that an earlier part of the run has written, and check their lines."""
    seen: set[str] = set()
    for number, (main, *more) in enumerate(texts_in(results.out, lines), start=1):
        with named_in_errors(f"{results.out / lines}, line {number}"):
            line = parse_main(main) if more else parse_json_object(main, "a frame")
            id = line.get("id")
            if not isinstance(id, str) or not isinstance(line.get("status"), str):
                raise BrokenFileError("expected the keys 'id' and 'status' with texts")
            if more and parse_json_object(more[0], "the solution of a frame").get("id") != id:
                raise BrokenFileError(f"{SOLVER} has another frame here: --overwrite begins anew")
            if id in seen:
                raise BrokenFileError(f"frame {id!r} is there twice: --overwrite begins anew")
            seen.add(id)
            results.restore(line)


def _restore_lines(run: RunOptions) -> None:
    """Restore the lines of a run that is resumed or replaced from its table; ``cameras.jsonl`` is written last."""
    table = lines_file(run.out)
    if (run.resume or run.overwrite) and table.name == TABLE:
        for index, name in ((1, SOLVER), (0, LINES)):
            with whole_file(run.out / name) as file:
                file.writelines(texts[index] + b"\n" for texts in read_parquet(table))


def finish(out: Path, summary: Mapping[str, Any]) -> None:
    """Write the summary of a run, unless it was finished before."""
    if not is_finished(out):
        write_text(out / SUMMARY, json.dumps(summary, indent=2) + "\n")


def read_summary(folder: Path) -> dict[str, Any]:
    """Read and check the summary of a finished run.

    Raises
    ------
    BrokenFileError
        If it cannot be read or is invalid; the message begins with its path.
    """
    path = folder / SUMMARY
    with named_in_errors(path):
        summary = parse_json_object(read_regular_file(path), "a summary")
        kinds: dict[str, tuple[type, str]] = dict.fromkeys(("seconds", "options"), (dict, OBJECT))
        kinds |= dict.fromkeys(("notes", "moved"), (list, "a list"))
        for name, (kind, what) in kinds.items():
            if not isinstance(summary.get(name, kind()), kind):
                raise BrokenFileError(f"{name!r}: expected {what}, got {summary[name]!s:.100}")
        for name, value in summary.get("seconds", {}).items():
            if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
                raise BrokenFileError(f"'seconds': expected a number as {name!r}, got {value!s:.100}")
    return summary


def is_finished(folder: Path) -> bool:
    """Whether a folder holds the results of a finished run."""
    return (folder / SUMMARY).is_file()


def _frames_told(folder: Path) -> int:
    """Number of frames of a finished run according to its summary; 0 if that is invalid."""
    try:
        frames = read_summary(folder).get("frames")
    except BrokenFileError:
        return 0
    return frames if isinstance(frames, int) else 0


def is_unfinished(folder: Path) -> bool:
    """Whether a folder holds the results of an unfinished run."""
    return (folder / RECORD).is_file() and not is_finished(folder)


def _earlier(out: Path, record: RunRecord, *, resume: bool) -> RunRecord | None:
    """Read the record of the run to be resumed; None if the folder has no results."""
    earlier = RunRecord.read(out)
    if earlier is None:
        if _used(out):
            found = f"{out} holds results of an earlier version or of others"
            raise UsedFolderError(found, "--overwrite replaces them")
        return None
    if not resume:
        state = "a run that is not finished" if is_unfinished(out) else "a run"
        options = AGAIN if record.is_of_stream else f"{RESUME}, {AGAIN}"
        raise UsedFolderError(f"{out} holds the results of {state}", options)
    other = earlier.differences(record)
    if other:
        raise ValueError(f"the run in {out} cannot be resumed: {other}; --overwrite begins anew")
    return earlier


def _used(out: Path) -> bool:
    """Whether there are results in a folder."""
    return any((out / name).exists() for name in (LINES, TABLE, SUMMARY, LOCALIZED)) or any(
        out.glob(CAMERAS.file_name("*"))
    )


def _count(out: Path, lines: str) -> int:
    """Number of frames whose lines are complete."""
    return sum(1 for _ in texts_in(out, lines)) if (out / lines).exists() else 0


def texts_in(folder: Path, lines: str) -> Iterator[tuple[bytes, ...]]:
    """The lines of all frames in a log, each with that of its solution if there is one in the folder."""
    return whole_line_pairs(folder) if lines == LINES else zip(whole_lines(folder / lines), strict=True)


def _record_or_none(out: Path) -> RunRecord | None:
    """The record of the run in a folder, None if there is none that can be read."""
    try:
        return RunRecord.read(out)
    except BrokenFileError:
        return None


def shared_files(command: str) -> tuple[str, ...]:
    """Names of the files that a command may write and that do not belong to a single frame."""
    return (SUMMARY,) if command in WITHOUT_PICTURES else SHARED_FILES


def _files_of_run(out: Path, record: RunRecord | None) -> Iterator[Path]:
    """Yield all files that the run in a folder has written; without a record they are found by their names."""
    if record is not None:
        ids = (id for log in (LINES, LOCALIZED) for id in _ids(out / log))
        yield from (out / name for id in ids for name in record.files_of(id))
    else:
        yield from chain.from_iterable(out.glob(form.file_name("*")) for form in (CAMERAS, OVERLAYS))
    yield from (out / name for name in shared_files("" if record is None else record.command))


def _clear(out: Path) -> None:
    """Remove the results of an earlier run; the lines of its frames and its record are removed last."""
    earlier = _record_or_none(out)
    (out / SUMMARY).unlink(missing_ok=True)
    if earlier is not None:
        replace(earlier, contents="replaced").write(out)  # so that it cannot be resumed from here on
    _remove(_files_of_run(out, earlier))
    _forget(out)


def _remove(paths: Iterable[Path]) -> None:
    for path in paths:
        path.unlink(missing_ok=True)


def _forget(out: Path) -> None:
    """Remove the log, the record and kept parts of a run."""
    remove_temporaries(out)
    _remove(out.glob(f"{PART_OF_CLIP}*"))
    _remove(out / name for name in (LINES, SOLVER, TABLE, LOCALIZED, RECORD))


def _ids(log: Path) -> Iterator[str]:
    """Yield the ids of the frames in a log; invalid lines are skipped."""
    for text in whole_lines(log) if log.is_file() else ():
        with suppress(BrokenFileError):
            id = parse_json_object(text, "a frame").get("id")
            if isinstance(id, str):
                yield id


def is_nearly_square(line: Mapping[str, Any]) -> bool:
    """Whether a line of cameras.jsonl is of a nearly square picture, unlike broadcasts, that was not found squashed.

    Examples
    --------
    >>> is_nearly_square({"image_size": [640, 640]}), is_nearly_square({"image_size": [1440, 1080]})
    (True, False)
    """
    size = line.get("image_size")
    if has_finding(line, What.WAS_SQUASHED):
        return False
    return size is not None and NEARLY_SQUARE[0] <= size[0] / size[1] <= NEARLY_SQUARE[1]
