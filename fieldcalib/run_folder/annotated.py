"""Annotated frames calibrated by any method, with the results in a folder."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from dataclasses import field as attribute
from functools import partial
from pathlib import Path
from typing import Any, Protocol, TypeAlias, TypeVar

from fieldcalib.assess.compute_errors import compute_errors
from fieldcalib.assess.ndc import ndc_loss
from fieldcalib.assess.result import Calibration, Status
from fieldcalib.console.program import say
from fieldcalib.console.waiting import waiting_for
from fieldcalib.fields.field import Field
from fieldcalib.geometry.camera import Camera
from fieldcalib.io.annotation_files import NO_SIZE, AnnotatedFrame, FramesFound, frames_in, is_of_soccernet, parse_frame
from fieldcalib.io.annotations import Labels
from fieldcalib.io.files import MOST_BYTES, BrokenFileError, FrameFile, error_message, files_beside
from fieldcalib.io.formats import ANNOTATIONS, CAMERAS
from fieldcalib.io.results import LINES, TABLE
from fieldcalib.io.soccernet import UNKNOWN_LABELS
from fieldcalib.problem.labelled_pixels import Pixels, check_segments, nearest_label, thinned
from fieldcalib.processes.jobs import in_order
from fieldcalib.run_folder.options import RunOptions
from fieldcalib.run_folder.outcome import Item, Outcome, calibration_line
from fieldcalib.run_folder.record import RECORD, RunRecord
from fieldcalib.run_folder.results import LOCALIZED, SUMMARY, counted, open_camera_folder
from fieldcalib.run_folder.units import UnitResult, executor_of, unit_size, units_of, work

P = TypeVar("P")  # a prior

WITHHELD = (Status.REJECTED, Status.IMPROBABLE)  # statuses by thresholds of the user, whose cameras are not written
RUN_FILES = frozenset({LINES, TABLE, SUMMARY, RECORD, LOCALIZED})
NAMED = 3  # number of skipped files of each kind that are named
CAMERA_FILES = (CAMERAS.file_name("<id>"),)


@dataclass(frozen=True)
class LabelledFrames:
    """Labelled pixels that were read, by frame id in the order of the input."""

    pixels: Mapping[str, Pixels]
    broken: Mapping[str, str]
    """Problems of files that could not be read, by frame id."""
    sizes: Mapping[str, tuple[int, int]]
    """Width and height (px) of the images of `pixels`."""

    def by_size(self) -> dict[tuple[int, int], dict[str, Pixels]]:
        """The frames that were read, those of one size together."""
        groups: dict[tuple[int, int], dict[str, Pixels]] = {}
        for id, pixels in self.pixels.items():
            groups.setdefault(self.sizes[id], {})[id] = pixels
        return groups


@dataclass(frozen=True)
class AnnotationReader:
    """Finds, reads and checks annotations of frames."""

    field: Field
    image_size: tuple[int, int] | None
    """Size of the images; None if the files have it."""
    labels: Labels = attribute(default_factory=dict)
    """Names of the field's segments by labels in the files."""
    most_bytes: float = MOST_BYTES

    @classmethod
    def of(cls, options: argparse.Namespace, field: Field) -> AnnotationReader:
        """Take the options of `add_input_and_output`."""
        return cls(field, options.size, options.labels or {}, options.most_bytes)

    def find(self, inputs: Sequence[Path]) -> list[FrameFile]:
        """Find the frames of annotations in folders and zips; what else is there is named on stderr.

        Raises
        ------
        ValueError
            If the size of the images is not given, and there are files of SoccerNet, which do not say it; or if labels
            are mapped to what the field does not have.
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

    def read(self, files: Sequence[FrameFile]) -> LabelledFrames:
        """Read and check annotations."""
        pixels: dict[str, Pixels] = {}
        sizes: dict[str, tuple[int, int]] = {}
        broken: dict[str, str] = {}
        for file in files:
            try:
                with waiting_for(file.path):
                    found = parse_frame(file, self.image_size, self.labels, self.most_bytes)
                assert found.image_size is not None
                pixels[file.id] = thinned(check_segments(self.field, found.pixels, found.image_size))
                sizes[file.id] = found.image_size
            except (ValueError, MemoryError) as error:
                broken[file.id] = error_message(error)
        return LabelledFrames(pixels, broken, sizes)


def read_frames(inputs: Sequence[Path], field: Field, image_size: tuple[int, int]) -> LabelledFrames:
    """Find, read and check annotations; broken files are named on stderr."""
    reader = AnnotationReader(field, image_size)
    files = reader.find(inputs)
    frames = reader.read(files)
    for file in files:
        if file.id in frames.broken:
            say(f"{file.path}: {frames.broken[file.id]}")
    return frames


def check_labels(labels: Labels, field: Field) -> None:
    """Raise a ValueError if labels are mapped to what the field does not have."""
    wrong = [ours for ours in labels.values() if ours is not None and ours not in {*field, *UNKNOWN_LABELS}]
    if wrong:
        raise ValueError(f"--labels maps to {wrong[0]!r}, which is no label; {nearest_label(wrong[0], field)}")


def name_left_out(found: FramesFound, field: Field) -> None:
    """Say on stderr which labels and shapes of other tools are left out, each once."""
    for label, count in found.unknown.items():
        hint = f"{nearest_label(label, field)}; --labels says what it is called here"
        say(f"{label!r} in {counted(count, 'frame')} is left out: unknown; {hint}")
    if found.left_out:
        shapes = ", ".join(
            f"{shape} in {counted(count, 'frame')}" for shape, count in found.left_out.most_common(NAMED)
        )
        more = len(found.left_out) - NAMED
        say(f"left out {shapes}{f' and {more} more' if more > 0 else ''}")


def name_skipped(inputs: Iterable[Path], used: Iterable[FrameFile]) -> None:
    """Name unused files in folders and zips on stderr, in one line: how many of each kind, and the first.

    A misnamed frame may be among them.
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
    """The names of a few of several files."""
    names = [path.name for path in paths[:NAMED]]
    return ", ".join([*names, "..."] if len(paths) > NAMED else names)


@dataclass(frozen=True)
class CalibratedFrame:
    """A calibration, and other results of its frame."""

    calibration: Calibration
    details: Mapping[str, Any] = attribute(default_factory=dict)
    """More keys of its line in cameras.jsonl."""
    files: Mapping[str, bytes] = attribute(default_factory=dict)
    """Content by name."""
    message: str = ""
    """Line for stdout."""

    def outcome(self, id: str, eq3: float | None = None) -> Outcome:
        """The outcome of the frame; its camera gets a file if it passes the thresholds of the user."""
        line = calibration_line(id, self.calibration, eq3) | dict(self.details)
        return Outcome.of(self.calibration, line, keeps=self.calibration.status not in WITHHELD, files=self.files)


Method: TypeAlias = Callable[[dict[str, Pixels], tuple[int, int]], Sequence[CalibratedFrame]]


class FileMethod(Protocol):
    """Calibrates frames from their files; other processes get a copy."""

    def __call__(self, files: tuple[FrameFile, ...]) -> UnitResult:
        """Read and calibrate a unit of frames."""

    def broken(self, files: tuple[FrameFile, ...]) -> Mapping[str, str]:
        """Read the files only; returns the problems of those that are broken, by id."""


@dataclass(frozen=True)
class FromAnnotations:
    """Calibrates annotated frames: a `FileMethod`."""

    reader: AnnotationReader
    method: Method
    """Calibrates frames of one size, by id, in their order; may raise a BrokenFileError about them."""

    def __call__(self, files: tuple[FrameFile, ...]) -> UnitResult:
        """Read the files and calibrate."""
        frames = self.reader.read(files)
        broken = dict(frames.broken)
        found: dict[str, CalibratedFrame] = {}
        eq3: dict[str, float] = {}
        seconds = 0.0
        for size, pixels in frames.by_size().items():
            start = time.perf_counter()
            try:
                of_size = dict(zip(pixels, self.method(pixels, size), strict=True))
            except BrokenFileError as error:
                broken |= dict.fromkeys(pixels, str(error))
                continue
            seconds += time.perf_counter() - start
            calibrations = {id: one.calibration for id, one in of_size.items()}
            compute_errors(list(calibrations.values()))
            eq3 |= _eq3_losses(self.reader.field, pixels, calibrations)
            found |= of_size
        return unit_result(files, found, broken, seconds, eq3)

    def broken(self, files: tuple[FrameFile, ...]) -> Mapping[str, str]:
        """Read the files only; returns the problems of those that are broken, by id."""
        return self.reader.read(files).broken


def unit_result(
    files: Sequence[Item],
    found: Mapping[str, CalibratedFrame],
    broken: Mapping[str, str],
    seconds: float,
    eq3: Mapping[str, float] | None = None,
) -> UnitResult:
    """The result of a unit whose frames, by id, are calibrated or broken."""
    losses = eq3 or {}
    outcomes = [
        Outcome.broken(file, broken[file.id])
        if file.id in broken
        else found[file.id].outcome(file.id, losses.get(file.id))
        for file in files
    ]
    return UnitResult(outcomes, seconds, "\n".join(one.message for one in found.values() if one.message))


def calibrate_folder(
    run: RunOptions,
    inputs: Sequence[Path],
    reader: AnnotationReader,
    method: Method,
    *,
    at_once: int | None = None,
    writes: Sequence[str] = CAMERA_FILES,
    more: Any = None,
) -> int:
    """Read annotations, calibrate by `method`, write to the folder of the run; returns the exit code.

    `method`, which can be pickled, gets `at_once` frames, or those of these that are of one size. `writes` are the
    names of the files that a frame may get. `more` is what the results depend on beside the options, as JSON.
    """
    files = reader.find(inputs)
    sizes = {file.annotation.image_size for file in files if isinstance(file, AnnotatedFrame)} - {None}
    if at_once is not None and at_once > 1 and len(sizes) > 1:
        there = ", ".join(sorted("{}x{}".format(*size) for size in sizes if size))
        raise ValueError(f"images of several sizes are not calibrated together: there are {there}")
    size = unit_size(len(files)) if at_once is None else at_once
    return calibrate_files(run, files, FromAnnotations(reader, method), size, writes, more)


def calibrate_files(
    run: RunOptions,
    files: Sequence[FrameFile],
    method: FileMethod,
    size: int,
    writes: Sequence[str] = CAMERA_FILES,
    more: Any = None,
) -> int:
    """Calibrate files, `size` of them at once, and write the results; returns the exit code."""
    began = time.perf_counter()
    record = RunRecord.of(run, files, unit=size, writes=writes, more=more)
    if run.strict:  # all are read before anything is written
        units = units_of(files, size, run.shard)
        with executor_of(run.jobs) as executor:
            for complaint in in_order(executor, partial(_first_broken, method), units, ahead=2 * run.jobs):
                if complaint:
                    say(complaint)
                    return 1
    with open_camera_folder(run, record, began) as results:
        work(run, results, files, size, method, len(files))
    return results.exit_code


def _first_broken(method: FileMethod, files: tuple[FrameFile, ...]) -> str:
    """The first broken file and what is wrong with it; empty if there is none."""
    broken = method.broken(files)
    return next((f"{file.path}: {broken[file.id]}" for file in files if file.id in broken), "")


def by_prior(
    frames: Mapping[str, Pixels],
    prior_of: Callable[[str], P],
    calibrate: Callable[[list[Pixels], P], Sequence[Calibration]],
) -> list[Calibration]:
    """Calibrate frames in groups of the same prior; returns the calibrations in the order of `frames`."""
    ids_of: dict[P, list[str]] = {}
    for id in frames:
        ids_of.setdefault(prior_of(id), []).append(id)
    found: dict[str, Calibration] = {}
    for prior, ids in ids_of.items():
        found.update(zip(ids, calibrate([frames[id] for id in ids], prior), strict=True))
    return [found[id] for id in frames]


def _eq3_losses(
    field: Field, frames: Mapping[str, Pixels], calibrations: Mapping[str, Calibration]
) -> dict[str, float]:
    """The paper's loss (eq. 3) of the frames that have a camera, each on its own field."""
    cameras_on: dict[Field, dict[str, Camera]] = {}
    for id, calibration in calibrations.items():
        if calibration.camera is not None:
            cameras_on.setdefault(calibration.field or field, {})[id] = calibration.camera
    losses: dict[str, float] = {}
    for pitch, cameras in cameras_on.items():
        values = ndc_loss(list(cameras.values()), pitch, [frames[id] for id in cameras], kind="eq3")
        losses.update(zip(cameras, values.tolist(), strict=True))
    return losses
