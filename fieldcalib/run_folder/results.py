"""The folder that a run writes: frame by frame, so that an end at any time leaves what another run can go on with.

``run.json`` comes first and ``summary.json`` last. In between each frame gets its line in ``cameras.jsonl`` and then
its files. So a frame has all of its files if another line follows; the last one is done again. And no file is without
a line, which says what belongs to the run.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from dataclasses import field as attribute
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

import fieldcalib
from fieldcalib._types import Array
from fieldcalib.assess.result import ANGLE_NAMES, Calibration, Verdict
from fieldcalib.assess.surprises import SQUASHED
from fieldcalib.console.arguments import ESTIMATED, PARQUET
from fieldcalib.geometry.camera import Camera
from fieldcalib.io.files import BrokenFileError, remove_temporaries, whole_file, write_bytes, write_text
from fieldcalib.io.formats import CAMERAS, OVERLAYS, VIDEOS
from fieldcalib.io.image import Image
from fieldcalib.io.line_log import LineLog, whole_lines
from fieldcalib.io.output_folder import output_folder
from fieldcalib.io.parquet import read_parquet, write_parquet
from fieldcalib.io.results import BROKEN, LINES, TABLE, lines_file
from fieldcalib.problem.layout import ANGLES, CENTER, LOG_F
from fieldcalib.run_folder.run_record import RECORD, RunRecord, recorded
from fieldcalib.run_folder.to_look_at import ToLookAt
from fieldcalib.solve.aspect import WAS_SQUASHED

SUMMARY = "summary.json"  # of a run that is finished
MOTION, WORST, TRIPODS = "motion.png", "worst_frames.jpg", "tripods.json"
LOCALIZED = "localized.jsonl"
OVERLAY = VIDEOS.file_name("overlay")
OF_RUNS = (SUMMARY, MOTION, WORST, TRIPODS, OVERLAY)  # names of files that are of no single frame
PART_OF_CLIP = ".part-"  # what the names of files begin with that keep parts of a clip until all are done
METRES = (0.5, 1.0)  # that the probabilities in cameras.jsonl are about
SIZE_KEYS = ("field_length", "field_width", "field_standard_deviations")
# Frames with pixels that are not square, least number and share: of 728 annotated frames none, of the same squashed to
# 640x640 one in fifteen, with width and height swapped more than half.
SUSPICIOUS = 3, 0.05
# Width / height of pictures of which it is asked whether they were squashed or cropped: broadcasts have 4:3 and more.
NEARLY_SQUARE = 0.9, 1.3
DECLARATIONS = ("display_size", "crop_of", "intrinsics")  # options that say what such pictures are,
ASPECT = "aspect"  # as this one does where it is not estimated
AGAIN = "--resume goes on with it, --overwrite begins anew"


@dataclass(frozen=True)
class Outcome:
    """What is written of a frame."""

    id: str
    line: str
    """Of cameras.jsonl."""
    status: str
    verdict: str = ""
    """Empty without a calibration."""
    reason: str = ""
    """Of the verdict."""
    squashed: bool = False
    """Whether the labels say that the pixels are not square."""
    nearly_square: bool = False
    """Whether the picture is; known where there is a camera."""
    files: Mapping[str, bytes] = attribute(default_factory=dict)
    """Content by name."""
    complaint: str = ""
    """For stderr: which file is broken, and why."""
    picture: Image | None = None
    """For the overlay of a video."""
    is_written: bool = False
    """By an earlier part of the run."""

    @classmethod
    def broken(cls, id: str, path: Path | str, problem: str) -> Outcome:
        """That of a file that cannot be read."""
        line = {"id": id, "status": BROKEN, "message": problem}
        return cls(id, json.dumps(line), BROKEN, complaint=f"{path}: {problem}")

    @classmethod
    def of(
        cls,
        id: str,
        calibration: Calibration,
        line: Mapping[str, Any],
        *,
        keeps: bool,
        files: Mapping[str, bytes] = MappingProxyType({}),
        picture: Image | None = None,
    ) -> Outcome:
        """That of a calibration, whose camera has a file if there is one and the run `keeps` it."""
        written = dict(files)
        if keeps and calibration.camera is not None:
            written[CAMERAS.file_name(id)] = (CAMERAS.write(calibration.camera) + "\n").encode()
        squashed = SQUASHED in calibration.concerns or WAS_SQUASHED in calibration.message
        status, verdict = str(calibration.status), str(calibration.verdict)
        square = is_nearly_square(line)
        reason = calibration.reason
        return cls(id, json.dumps(line), status, verdict, reason, squashed, square, written, picture=picture)


@dataclass
class Results:
    """What is written of frames, and counted."""

    out: Path
    log: LineLog
    done: int = 0
    """Frames that are written."""
    statuses: Counter[str] = attribute(default_factory=Counter)
    verdicts: Counter[str] = attribute(default_factory=Counter)
    cameras: int = 0
    to_look_at: ToLookAt = attribute(default_factory=ToLookAt)
    squashed: int = 0
    nearly_square: int = 0
    calibrated: int = 0
    """Frames that were calibrated now, not in an earlier part of the run."""
    calibrating: float = 0.0
    """Seconds that these took, without files and pictures."""
    notes: Sequence[str] = ()
    """What was found of the camera of a clip."""

    def add(self, outcome: Outcome) -> None:
        """Write the line of the next frame, and its files; what is wrong with it is said on stderr."""
        if outcome.complaint:
            print(f"fieldcalib: {outcome.complaint}", file=sys.stderr)
        self.log.append(outcome.line)
        for name, content in outcome.files.items():
            write_bytes(self.out / name, content)
        self._count(outcome.status, outcome.verdict, CAMERAS.file_name(outcome.id) in outcome.files)
        self.to_look_at.add(outcome.id, outcome.verdict, outcome.reason)
        self.squashed += outcome.squashed
        self.nearly_square += outcome.nearly_square
        self.calibrated += bool(outcome.verdict)

    def take_up(self, line: Mapping[str, Any]) -> None:
        """Count a frame that is written already."""
        self._count(line["status"], line.get("verdict", ""), (self.out / CAMERAS.file_name(line["id"])).exists())
        self.to_look_at.add(line["id"], line.get("verdict", ""), line.get("reason", ""))
        self.squashed += is_squashed(line)
        self.nearly_square += is_nearly_square(line)

    def _count(self, status: str, verdict: str, has_camera: bool) -> None:
        self.done += 1
        self.statuses[status] += 1
        if verdict:
            self.verdicts[verdict] += 1
        self.cameras += has_camera

    @property
    def exit_code(self) -> int:
        """1 if files were broken."""
        return 1 if self.statuses[BROKEN] else 0

    def summary(self, options: Mapping[str, Any], seconds: float) -> dict[str, Any]:
        """What summary.json says; `seconds` is how long everything took."""
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
        """Say how many cameras there are, and what makes one doubt that the options say what the pictures are."""
        statuses = ", ".join(f"{count} {status}" for status, count in self.statuses.most_common())
        verdicts = ", ".join(f"{self.verdicts[verdict]} {verdict}" for verdict in Verdict if self.verdicts[verdict])
        counts = "; ".join(filter(None, (statuses, verdicts)))
        print(f"{counted(self.cameras, 'camera')} of {counted(self.done, 'frame')} in {self.out}: {counts}")
        self._say_what_to_look_at(options)
        if self.squashed >= max(SUSPICIOUS[0], SUSPICIOUS[1] * self.verdicts.total()):
            seen = f"{self.squashed} of {counted(self.done, 'frame')} show pixels that are not square"
            print(f"{seen}: is the size right? --aspect declares squashed pictures", file=sys.stderr)
        elif (
            self.nearly_square
            and all(options.get(name, "") is None for name in DECLARATIONS)
            and options.get(ASPECT) in (None, ESTIMATED)
        ):
            verb = "is" if self.nearly_square == 1 else "are"
            print(
                f"{self.nearly_square} of {counted(self.done, 'frame')} {verb} nearly square: pictures of broadcasts "
                f"of that shape were squashed, which --aspect declares, or cropped, which --crop-of does",
                file=sys.stderr,
            )
        others = sum(1 for _ in self.out.glob(CAMERAS.file_name("*"))) - self.cameras
        if others > 0:
            verb = "is" if others == 1 else "are"
            print(f"fieldcalib: {counted(others, 'camera')} in {self.out} {verb} not of this run", file=sys.stderr)

    def _say_what_to_look_at(self, options: Mapping[str, Any]) -> None:
        """Name the first frames that are not good on stderr, and where all are to be seen."""
        where = [self.out / (TABLE if options.get("format") == PARQUET else LINES)]
        if (self.out / WORST).exists():
            where.append(self.out / WORST)
        elif any((self.out / OVERLAYS.file_name(run.first)).exists() for run in self.to_look_at.runs):
            where.append(self.out / OVERLAYS.file_name("<id>"))
        said = self.to_look_at.said(*map(str, where))
        if said:
            print(f"fieldcalib: {said}", file=sys.stderr)


@contextmanager
def result_folder(options: argparse.Namespace, record: RunRecord, began: float) -> Iterator[Results]:
    """``options.out``, for cameras frame by frame; when all went well it gets its summary.json.

    `began` is what `time.perf_counter` said at the start.
    """
    if options.format == PARQUET and options.shard is not None:
        raise ValueError(f"--format {PARQUET} is of whole runs: --shard writes {LINES}, fieldcalib join makes a table")
    with run_folder(options, record) as results:
        yield results
        finish(options.out, results.summary(recorded(options), time.perf_counter() - began))
        results.say(recorded(options))
    leave_table(options)


def leave_table(options: argparse.Namespace) -> None:
    """Put a table in the place of ``cameras.jsonl``, if that is asked for."""
    if options.format == PARQUET:
        with output_folder(options.out):
            write_parquet(whole_lines(options.out / LINES), options.out / TABLE)
            (options.out / LINES).unlink()


@contextmanager
def run_folder(options: argparse.Namespace, record: RunRecord, lines: str = LINES) -> Iterator[Results]:
    """``options.out``, kept from other runs, with what a run that is gone on with has done; `lines` is its log.

    Raises
    ------
    FileExistsError
        If the folder holds the results of a run and neither --resume nor --overwrite is given.
    ValueError
        If the run to go on with had other options, or another input.
    """
    out = options.out
    with output_folder(out):
        _restore_lines(options)
        earlier = None if options.overwrite else _earlier(out, record, resume=options.resume)
        if options.overwrite:
            _clear(out)
        remove_temporaries(out)
        count = _count(out / lines)
        results: Results | None = None
        try:
            if earlier is None:
                record.write(out)
            with LineLog(out / lines, count if is_finished(out) else max(count - 1, 0)) as log:
                results = Results(out, log)
                for text in whole_lines(out / lines):
                    results.take_up(json.loads(text))
                yield results
        except BaseException:
            remove_temporaries(out)  # of an interrupt between the making of one and its use
            if earlier is None and (results is None or not results.done) and not any(out.glob(f"{PART_OF_CLIP}*")):
                _remove_frames(out, record)
                _forget(out)
            elif results is not None:
                done = f"{counted(results.done, 'frame')} done in {out}"
                print(f"fieldcalib: {done}: --resume goes on with the run", file=sys.stderr)
            raise


def _restore_lines(options: argparse.Namespace) -> None:
    """The ``cameras.jsonl`` of a run that is gone on with or replaced and has left it as a table."""
    path = options.out / LINES
    if (options.resume or options.overwrite) and lines_file(options.out) != path:
        with whole_file(path) as file:
            file.writelines(text + b"\n" for text in read_parquet(lines_file(options.out)))


def finish(out: Path, summary: Mapping[str, Any]) -> None:
    """Write the summary of a run, unless it was finished before."""
    if not is_finished(out):
        write_text(out / SUMMARY, json.dumps(summary, indent=2) + "\n")


def is_finished(folder: Path) -> bool:
    """Whether it holds the results of a run that has come to its end."""
    return (folder / SUMMARY).is_file()


def is_unfinished(folder: Path) -> bool:
    """Whether it holds the results of a run that has not come to its end."""
    return (folder / RECORD).is_file() and not is_finished(folder)


def _earlier(out: Path, record: RunRecord, *, resume: bool) -> RunRecord | None:
    """The run in a folder that is to be gone on with, if there is one."""
    earlier = RunRecord.read(out)
    if earlier is None:
        if _used(out):
            raise FileExistsError(f"{out} holds results of an earlier version or of others: --overwrite replaces them")
        return None
    if not resume:
        state = "a run that is not finished" if is_unfinished(out) else "a run"
        raise FileExistsError(f"{out} holds the results of {state}: {AGAIN}")
    other = earlier.differences(record)
    if other:
        raise ValueError(f"the run in {out} cannot be resumed: {other}; --overwrite begins anew")
    return earlier


def _used(out: Path) -> bool:
    """Whether there are results in a folder."""
    return any((out / name).exists() for name in (LINES, TABLE, SUMMARY, LOCALIZED)) or any(
        out.glob(CAMERAS.file_name("*"))
    )


def _count(log: Path) -> int:
    return sum(1 for _ in whole_lines(log)) if log.exists() else 0


def _clear(out: Path) -> None:
    """Remove what an earlier run has written; the names of its frames and its record go last."""
    try:
        earlier = RunRecord.read(out)
    except BrokenFileError:
        earlier = None
    (out / SUMMARY).unlink(missing_ok=True)
    if earlier is not None:
        replace(earlier, contents="replaced").write(out)  # is not resumed from here on
        _remove_frames(out, earlier)
    else:
        for pattern in (CAMERAS.file_name("*"), OVERLAYS.file_name("*")):
            for path in out.glob(pattern):
                path.unlink(missing_ok=True)
    for name in OF_RUNS:
        (out / name).unlink(missing_ok=True)
    _forget(out)


def _remove_frames(out: Path, record: RunRecord) -> None:
    """Remove the files of the frames that a run has written, and of no others."""
    for log in (LINES, LOCALIZED):
        for id in _ids(out / log):
            for name in record.writes:
                (out / name.replace("<id>", id)).unlink(missing_ok=True)


def _forget(out: Path) -> None:
    """Remove what is kept of a run."""
    remove_temporaries(out)
    for path in (*out.glob(f"{PART_OF_CLIP}*"), out / LINES, out / TABLE, out / LOCALIZED, out / RECORD):
        path.unlink(missing_ok=True)


def _ids(log: Path) -> Iterator[str]:
    """The frames in a log, as far as these can name files."""
    for text in whole_lines(log) if log.exists() else ():
        id = json.loads(text).get("id", "")
        if id and Path(id).name == id:
            yield id


def counted(number: int, noun: str) -> str:
    """A number of things.

    Examples
    --------
    >>> counted(1, "frame"), counted(2, "frame")
    ('1 frame', '2 frames')
    """
    return f"{number} {noun}{'' if number == 1 else 's'}"


def is_squashed(line: Mapping[str, Any]) -> bool:
    """Whether a frame's line of cameras.jsonl says that the pixels of the picture are not square."""
    return any(words in line.get("reason", "") for words in (SQUASHED, WAS_SQUASHED))


def is_nearly_square(line: Mapping[str, Any]) -> bool:
    """Whether a frame's line of cameras.jsonl is of a picture of a shape that no broadcast has, and not said squashed.

    Examples
    --------
    >>> is_nearly_square({"image_size": [640, 640]}), is_nearly_square({"image_size": [1440, 1080]})
    (True, False)
    """
    size = line.get("image_size")
    if WAS_SQUASHED in line.get("message", ""):
        return False
    return size is not None and NEARLY_SQUARE[0] <= size[0] / size[1] <= NEARLY_SQUARE[1]


def calibration_line(id: str, calibration: Calibration, eq3: float | None) -> dict[str, Any]:
    """One frame's line of cameras.jsonl."""
    line: dict[str, Any] = {"id": id, "status": str(calibration.status), "message": calibration.message}
    line |= {"verdict": str(calibration.verdict), "reason": calibration.reason, "remedy": calibration.remedy}
    line |= calibration.to_dict()
    if calibration.camera is not None:
        line |= {"rms_as_labelled_px": _number(calibration.rms_as_labelled), "loss_ndc_eq3": eq3}
    if calibration.camera is not None and calibration.knows_errors:
        line["standard_deviations"] = _standard_deviations(calibration.camera, calibration.covariance)
    line |= _of_told_size(calibration)
    if calibration.has_probability:
        line |= {f"probability_right_{metres:g}m": _number(calibration.probability(metres)) for metres in METRES}
    return line


def _of_told_size(calibration: Calibration) -> dict[str, Any]:
    """The size of the field where the frame tells another one than it was given."""
    layout = None if calibration.solved is None else calibration.uncertainty.layout
    if calibration.field is None or layout is None or not np.any(layout.free[layout.field_size_block]):
        return {}
    size = calibration.field.length, calibration.field.width
    deviations = np.sqrt(np.diagonal(calibration.covariance))[layout.field_size_block]
    return dict(zip(SIZE_KEYS, (*size, deviations.tolist()), strict=True))


def _standard_deviations(camera: Camera, covariance: Array) -> dict[str, Any]:
    sigma = np.sqrt(np.diagonal(covariance))
    degrees = map(_number, np.degrees(sigma[ANGLES]))
    return {
        "focal_length_px": _number(camera.focal_length * sigma[LOG_F]),
        "C": [_number(metres) for metres in sigma[CENTER]],
        "angles_degrees": dict(zip(ANGLE_NAMES, degrees, strict=True)),
    }


def _number(value: float) -> float | None:
    """For JSON, which knows neither infinity nor NaN."""
    return float(value) if np.isfinite(value) else None
