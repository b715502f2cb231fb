"""Calibration of annotated frames by any method, with the results written to a folder."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from dataclasses import field as attribute
from functools import partial
from pathlib import Path
from typing import Any, Generic, TypeAlias, TypeVar

from fieldcalib._progress import counted, say
from fieldcalib.assess.ndc import ndc_loss
from fieldcalib.assess.result import Calibration
from fieldcalib.fields.field import Field
from fieldcalib.io.annotations import Labels
from fieldcalib.io.files import MOST_BYTES, BrokenFileError, FrameFile, files_beside
from fieldcalib.io.formats import (
    ANNOTATIONS,
    NO_SIZE,
    AnnotatedFrame,
    FramesFound,
    frames_in,
    is_of_soccernet,
    parse_frame,
)
from fieldcalib.io.frame_source import read_each
from fieldcalib.io.results import LINES, SOLVER, TABLE
from fieldcalib.io.soccernet import UNKNOWN_LABELS
from fieldcalib.problem.labelled_pixels import Pixels, check_segments, nearest_label, thinned
from fieldcalib.processes.jobs import in_order
from fieldcalib.run_folder.record import RECORD, Outcome, RunOptions, RunRecord
from fieldcalib.run_folder.results import LOCALIZED, SUMMARY, open_camera_folder
from fieldcalib.run_folder.work_units import UnitResult, executor_of, grouped, in_groups, unit_size, units_of, work
from fieldcalib.solve.batch import compute_errors

RUN_FILES = frozenset({LINES, SOLVER, TABLE, SUMMARY, RECORD, LOCALIZED})
NAMED = 3  # number of skipped files of each kind that are named


@dataclass(frozen=True)
class AnnotationReader:
    """Finds, reads and checks annotations of frames."""

    field: Field
    image_size: tuple[int, int] | None
    """Size of the images; None if the files give it."""
    labels: Labels = attribute(default_factory=dict)
    """Names of the field's segments by labels in the files."""
    most_bytes: float = MOST_BYTES

    def find(self, inputs: Sequence[Path]) -> list[FrameFile]:
        """Find the frames of annotations in folders and zips; other files there are named on stderr.

        Raises
        ------
        ValueError
            If the size of the images is not given, and there are files of SoccerNet, which do not have it; or if labels
            are mapped to labels that the field does not have.
        """
        files = ANNOTATIONS.find(inputs)
        name_skipped(inputs, files)
        check_labels(self.labels, self.field)
        found = frames_in(files, self.labels, self.field, self.most_bytes)
        if self.image_size is None:
            nameless = [one for one in found.frames if not isinstance(one, AnnotatedFrame) and is_of_soccernet(one)]
            if nameless:
                raise ValueError(f"{nameless[0].path}: {NO_SIZE}")
        name_left_out(found, self.field)
        return found.frames

    def read(self, file: FrameFile) -> tuple[Pixels, tuple[int, int]]:
        """Read and check the annotation of a frame: its labelled pixels, and the size of its image."""
        found = parse_frame(file, self.image_size, self.labels, self.most_bytes)
        assert found.image_size is not None
        return thinned(check_segments(self.field, found.pixels, found.image_size)), found.image_size


def check_labels(labels: Labels, field: Field) -> None:
    """Raise a ValueError if labels are mapped to labels that the field does not have."""
    wrong = [ours for ours in labels.values() if ours is not None and ours not in {*field, *UNKNOWN_LABELS}]
    if wrong:
        raise ValueError(f"--labels maps to {wrong[0]!r}, which is no label; {nearest_label(wrong[0], field)}")


def name_left_out(found: FramesFound, field: Field) -> None:
    """Print on stderr which labels and shapes of other tools are left out, each once."""
    for label, count in found.unknown.items():
        hint = f"{nearest_label(label, field, found.unknown)}; --labels says what it is called here"
        say(f"{label!r} in {counted(count, 'frame')} is left out: unknown; {hint}")
    if found.left_out:
        shapes = ", ".join(
            f"{shape} in {counted(count, 'frame')}" for shape, count in found.left_out.most_common(NAMED)
        )
        more = len(found.left_out) - NAMED
        say(f"left out {shapes}{f' and {more} more' if more > 0 else ''}")


def name_skipped(inputs: Iterable[Path], used: Iterable[FrameFile]) -> None:
    """Name unused files in folders and zips on stderr, in one line: how many of each kind, and the first few.

    A frame with a wrong name may be among them.
    """
    by_suffix: dict[str, list[Path]] = {}
    for path in files_beside(inputs, used):
        if path.name not in RUN_FILES:
            by_suffix.setdefault(path.suffix or "without ending", []).append(path)
    folders = [member for path in inputs if path.is_dir() for member in sorted(path.iterdir()) if member.is_dir()]
    if folders:
        by_suffix["folders"] = folders
    if by_suffix:
        kinds = (f"{len(paths)} {suffix} ({_first(paths)})" for suffix, paths in by_suffix.items())
        say(f"skipped {', '.join(kinds)}")


def _first(paths: Sequence[Path]) -> str:
    """Names of the first few of several files."""
    names = [path.name for path in paths[:NAMED]]
    return ", ".join([*names, "..."] if len(paths) > NAMED else names)


@dataclass(frozen=True)
class CalibratedFrame:
    """A calibration, and other results of its frame."""

    calibration: Calibration
    details: Mapping[str, Any] = attribute(default_factory=dict)
    """More keys of its line in cameras.jsonl."""
    files: Mapping[str, bytes] = attribute(default_factory=dict)
    """Contents of its files, by name."""
    message: str = ""
    """Line for stdout."""

    def outcome(self, id: str, eq3: float | None = None) -> Outcome:
        """Make the outcome of the frame."""
        return Outcome.of(id, self.calibration, eq3=eq3, details=self.details, files=self.files)


Seen = TypeVar("Seen")  # labelled pixels, image or homography of a frame
Size: TypeAlias = tuple[int, int]
Method: TypeAlias = Callable[[dict[str, Seen], Size], Sequence[CalibratedFrame]]
"""Calibrates frames of one size, by id, in their order; may raise a BrokenFileError about them."""


@dataclass(frozen=True)
class FromFiles(Generic[Seen]):
    """Calibrates frames from their files; other processes get a copy."""

    read: Callable[[FrameFile], tuple[Seen, Size]]
    """Reads the labelled pixels, image or homography of a frame, and the size of its image."""
    method: Method[Seen]
    losses: Callable[[dict[str, Seen], Sequence[Calibration]], Mapping[str, float]] | None = None
    """Returns TVCalib's loss (eq. 3) of frames by id."""

    def __call__(self, files: tuple[FrameFile, ...]) -> UnitResult:
        """Read the files and calibrate."""
        seen, broken = read_each(files, self.read)
        found: dict[str, CalibratedFrame] = {}
        eq3: dict[str, float] = {}
        seconds = 0.0
        for size, ids in grouped(seen, lambda id: seen[id][1]).items():
            items = {id: seen[id][0] for id in ids}
            start = time.perf_counter()
            try:
                calibrated = self.method(items, size)
            except BrokenFileError as error:
                broken |= dict.fromkeys(ids, str(error))
                continue
            seconds += time.perf_counter() - start
            if self.losses is not None:
                eq3 |= self.losses(items, [one.calibration for one in calibrated])
            found |= zip(ids, calibrated, strict=True)
        outcomes = [
            Outcome.broken(file, broken[file.id])
            if file.id in broken
            else found[file.id].outcome(file.id, eq3.get(file.id))
            for file in files
        ]
        return UnitResult(outcomes, seconds, "\n".join(one.message for one in found.values() if one.message))


def calibrate_folder(
    run: RunOptions,
    inputs: Sequence[Path],
    reader: AnnotationReader,
    method: Method[Pixels],
    *,
    at_once: int | None = None,
    writes: Sequence[str] = (),
    more: Any = None,
) -> int:
    """Read annotations, calibrate by `method`, write to the folder of the run; returns the exit code.

    `method`, which can be pickled, gets up to `at_once` frames of one size at a time. `writes` are the names of the
    files that a frame may get. `more` is JSON of anything else that the results depend on, for the record.
    """
    files = reader.find(inputs)
    sizes = {file.annotation.image_size for file in files if isinstance(file, AnnotatedFrame)} - {None}
    if at_once is not None and at_once > 1 and len(sizes) > 1:
        there = ", ".join(sorted("{}x{}".format(*size) for size in sizes if size))
        raise ValueError(f"images of several sizes are not calibrated together: there are {there}")
    size = unit_size(len(files)) if at_once is None else at_once
    return calibrate_files(
        run, files, FromFiles(reader.read, method, partial(paper_losses, reader.field)), size, writes, more
    )


def calibrate_files(
    run: RunOptions,
    files: Sequence[FrameFile],
    method: FromFiles[Any],
    size: int,
    writes: Sequence[str] = (),
    more: Any = None,
) -> int:
    """Calibrate files, `size` of them at once, and write the results; returns the exit code."""
    began = time.perf_counter()
    record = RunRecord.of(run, files, unit=size, writes=writes, more=more)
    if run.strict:  # all are read before anything is written
        units = units_of(files, size, run.shard)
        with executor_of(run.jobs) as executor:
            for complaint in in_order(executor, partial(_first_broken, method.read), units, ahead=2 * run.jobs):
                if complaint:
                    say(complaint)
                    return 1
    with open_camera_folder(run, record, began, files) as results:
        work(run, results, files, size, method, len(files))
    return results.exit_code


def _first_broken(read: Callable[[FrameFile], object], files: tuple[FrameFile, ...]) -> str:
    """Message about the first broken file; empty if there is none."""
    _, broken = read_each(files, read)
    return next((f"{file.path}: {broken[file.id]}" for file in files if file.id in broken), "")


def paper_losses(field: Field, frames: Mapping[str, Pixels], calibrations: Sequence[Calibration]) -> dict[str, float]:
    """TVCalib's loss (eq. 3) of the frames that have a camera, each on its own field; computes all errors first."""
    compute_errors(calibrations)
    of = dict(zip(frames, calibrations, strict=True))
    cameras = {id: one.camera for id, one in of.items() if one.camera is not None}

    def on_one_field(pitch: Field, ids: Sequence[str]) -> list[float]:
        values = ndc_loss([cameras[id] for id in ids], pitch, [frames[id] for id in ids], kind="eq3")
        return list(values.tolist())

    return dict(zip(cameras, in_groups(list(cameras), lambda id: of[id].field or field, on_one_field), strict=True))
