"""From a folder of annotated frames to a folder of cameras, whatever calibrates them."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from dataclasses import field as attribute
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeAlias, TypeVar

from fieldcalib.assess.compute_errors import compute_errors
from fieldcalib.assess.ndc import ndc_loss
from fieldcalib.assess.result import Calibration, Status
from fieldcalib.cli.results import LOCALIZED, SUMMARY, Outcome, calibration_line, counted, result_folder
from fieldcalib.cli.run_record import RECORD, RunRecord
from fieldcalib.cli.units import Made, processes_of, unit_size, units_of, work
from fieldcalib.cli.waiting import waiting_for
from fieldcalib.fields.field import Field
from fieldcalib.geometry.camera import Camera
from fieldcalib.io.annotation_files import NO_SIZE, AnnotatedFrame, FramesFound, frames_in, is_of_soccernet, parse_frame
from fieldcalib.io.annotations import Labels
from fieldcalib.io.files import MOST_BYTES, BrokenFileError, FrameFile, files_beside
from fieldcalib.io.formats import ANNOTATIONS, CAMERAS
from fieldcalib.io.results import LINES, TABLE
from fieldcalib.io.soccernet import UNKNOWN_LABELS
from fieldcalib.problem.labelled_pixels import Pixels, check_segments, nearest_label, thinned
from fieldcalib.processes.jobs import in_order

P = TypeVar("P")  # a prior, in whatever form

WITHHELD = (Status.REJECTED, Status.IMPROBABLE)  # cameras that the user of `calibrate` did not want
OF_RUN = frozenset({LINES, TABLE, SUMMARY, RECORD, LOCALIZED})
NAMED = 3  # skipped files of a kind


@dataclass(frozen=True)
class Frames:
    """What was read, by frame id in the order of the input."""

    ids: tuple[str, ...]
    pixels: Mapping[str, Pixels]
    broken: Mapping[str, str]
    """What is wrong with the files that could not be read."""
    sizes: Mapping[str, tuple[int, int]]
    """Width and height (px) of the images of `pixels`."""

    def by_size(self) -> dict[tuple[int, int], dict[str, Pixels]]:
        """The frames that were read, those of one size together."""
        groups: dict[tuple[int, int], dict[str, Pixels]] = {}
        for id, pixels in self.pixels.items():
            groups.setdefault(self.sizes[id], {})[id] = pixels
        return groups


@dataclass(frozen=True)
class Found:
    """A calibration, and what else is written of its frame."""

    calibration: Calibration
    details: Mapping[str, Any] = attribute(default_factory=dict)
    """More keys of its line in cameras.jsonl."""
    files: Mapping[str, bytes] = attribute(default_factory=dict)
    """Content by name."""
    said: str = ""
    """For stdout."""


Method: TypeAlias = Callable[[dict[str, Pixels], tuple[int, int]], Sequence[Found]]


def read_frames(inputs: Sequence[Path], field: Field, image_size: tuple[int, int]) -> Frames:
    """Find, read and check annotations; broken files are named on stderr."""
    files = found_annotations(inputs, field, image_size)
    frames = read_annotations(files, field, image_size)
    for file in files:
        if file.id in frames.broken:
            print(f"fieldcalib: {file.path}: {frames.broken[file.id]}", file=sys.stderr)
    return frames


def found_annotations(
    inputs: Sequence[Path],
    field: Field,
    image_size: tuple[int, int] | None,
    labels: Labels = MappingProxyType({}),
    most_bytes: float = MOST_BYTES,
) -> list[FrameFile]:
    """The frames of annotations in folders and zips; what else is there is named on stderr.

    Raises
    ------
    ValueError
        If the size of the images is not given, and there are files of SoccerNet, which do not say it; or if labels are
        mapped to what the field does not have.
    """
    files = ANNOTATIONS.find(inputs)
    name_skipped(inputs, files)
    check_labels(labels, field)
    found = frames_in(files, labels, field, most_bytes)
    if image_size is None:
        nameless = [one for one in found.frames if not isinstance(one, AnnotatedFrame) and is_of_soccernet(one)]
        if nameless:
            raise ValueError(f"{nameless[0].path}: {NO_SIZE}")
    name_left_out(found, field)
    return found.frames


def check_labels(labels: Labels, field: Field) -> None:
    """Raise a ValueError if labels are mapped to what the field does not have."""
    wrong = [ours for ours in labels.values() if ours is not None and ours not in {*field, *UNKNOWN_LABELS}]
    if wrong:
        raise ValueError(f"--labels maps to {wrong[0]!r}, which is no label; {nearest_label(wrong[0], field)}")


def name_left_out(found: FramesFound, field: Field) -> None:
    """Say on stderr which labels and shapes of other tools are left out, each once."""
    for label, count in found.unknown.items():
        hint = f"{nearest_label(label, field)}; --labels says what it is called here"
        print(f"fieldcalib: {label!r} in {counted(count, 'frame')} is left out: unknown; {hint}", file=sys.stderr)
    if found.left_out:
        shapes = ", ".join(
            f"{shape} in {counted(count, 'frame')}" for shape, count in found.left_out.most_common(NAMED)
        )
        more = len(found.left_out) - NAMED
        print(f"fieldcalib: left out {shapes}{f' and {more} more' if more > 0 else ''}", file=sys.stderr)


def read_annotations(
    files: Sequence[FrameFile],
    field: Field,
    image_size: tuple[int, int] | None,
    most_bytes: float = MOST_BYTES,
    labels: Labels = MappingProxyType({}),
) -> Frames:
    """Read and check annotations."""
    pixels: dict[str, Pixels] = {}
    sizes: dict[str, tuple[int, int]] = {}
    broken: dict[str, str] = {}
    for file in files:
        try:
            with waiting_for(file.path):
                found = parse_frame(file, image_size, labels, most_bytes)
            assert found.image_size is not None
            pixels[file.id] = thinned(check_segments(field, found.pixels, found.image_size))
            sizes[file.id] = found.image_size
        except (ValueError, MemoryError) as error:
            broken[file.id] = problem(error)
    return Frames(tuple(file.id for file in files), pixels, broken, sizes)


def problem(error: Exception) -> str:
    """What is wrong with a file; a MemoryError does not say it."""
    return str(error) or "there is not enough memory for it"


def name_skipped(inputs: Iterable[Path], used: Iterable[FrameFile]) -> None:
    """Say on stderr what lies in folders and zips and is not used, in one line: how many of each kind, and the first.

    A frame may be among them, under a name that no frame has.
    """
    by_suffix: dict[str, list[Path]] = {}
    for path in files_beside(inputs, used):
        if path.name not in OF_RUN:
            by_suffix.setdefault(path.suffix or "without ending", []).append(path)
    folders = [member for path in inputs if path.is_dir() for member in sorted(path.iterdir()) if member.is_dir()]
    if folders:
        by_suffix["folders"] = folders
    if by_suffix:
        kinds = (f"{len(paths)} {suffix} ({_first(paths)})" for suffix, paths in by_suffix.items())
        print(f"fieldcalib: skipped {', '.join(kinds)}", file=sys.stderr)


def _first(paths: Sequence[Path]) -> str:
    """The names of a few of several files."""
    names = [path.name for path in paths[:NAMED]]
    return ", ".join([*names, "..."] if len(paths) > NAMED else names)


@dataclass(frozen=True)
class FromAnnotations:
    """What is written of some annotated frames."""

    field: Field
    image_size: tuple[int, int] | None
    """None: as the files say."""
    most_bytes: float
    method: Method
    """Gives the calibrations of frames of one size, by id, in their order; may raise a BrokenFileError about them."""
    labels: Labels = attribute(default_factory=dict)
    """What labels are called here."""

    def __call__(self, files: tuple[FrameFile, ...]) -> Made:
        """Read the files and calibrate."""
        frames = self._read(files)
        broken = dict(frames.broken)
        found: dict[str, Found] = {}
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
            eq3 |= _eq3_losses(self.field, pixels, calibrations)
            found |= of_size
        outcomes = []
        for file in files:
            if file.id in broken:
                outcomes.append(lost(file, broken[file.id]))
                continue
            one = found[file.id]
            line = calibration_line(file.id, one.calibration, eq3.get(file.id)) | dict(one.details)
            outcomes.append(outcome_of(file.id, one, line))
        return Made(outcomes, seconds, "\n".join(one.said for one in found.values() if one.said))

    def first_broken(self, files: tuple[FrameFile, ...]) -> str:
        """The first broken file and what is wrong with it; empty if there is none."""
        broken = self._read(files).broken
        return next((f"{file.path}: {broken[file.id]}" for file in files if file.id in broken), "")

    def _read(self, files: Sequence[FrameFile]) -> Frames:
        return read_annotations(files, self.field, self.image_size, self.most_bytes, self.labels)


def calibrate_folder(
    options: argparse.Namespace,
    field: Field,
    method: Method,
    *,
    at_once: int | None = None,
    writes: Sequence[str] = (CAMERAS.file_name("<id>"),),
    more: Any = None,
) -> int:
    """Read ``options.input``, calibrate by `method`, write to ``options.out``; returns the exit code.

    `method` gets `at_once` frames, or those of them that are of one size; it can be pickled. Of each frame there may
    be files that are named as `writes` says. `more` is what the method depends on beside the options, as JSON.
    """
    labels = options.labels or {}
    files = found_annotations(options.input, field, options.size, labels, options.most_bytes)
    sizes = {file.annotation.image_size for file in files if isinstance(file, AnnotatedFrame)} - {None}
    if at_once is not None and at_once > 1 and len(sizes) > 1:
        raise ValueError(f"images of several sizes are not calibrated together: there are {_of_sizes(sizes)}")
    made = FromAnnotations(field, options.size, options.most_bytes, method, labels)
    size = unit_size(len(files)) if at_once is None else at_once
    return calibrate_files(options, files, made, made.first_broken, size, writes, more)


def _of_sizes(sizes: Iterable[tuple[int, int] | None]) -> str:
    return ", ".join(sorted("{}x{}".format(*size) for size in sizes if size))


def calibrate_files(
    options: argparse.Namespace,
    files: Sequence[FrameFile],
    function: Callable[[tuple[FrameFile, ...]], Made],
    first_broken: Callable[[tuple[FrameFile, ...]], str],
    size: int,
    writes: Sequence[str],
    more: Any = None,
) -> int:
    """Write what a function makes of files, `size` of them at once; returns the exit code."""
    began = time.perf_counter()
    record = RunRecord.of(options, files, unit=size, writes=writes, more=more)
    if options.strict:  # all are read before anything is written
        with processes_of(options) as executor:
            for broken in in_order(
                executor, first_broken, units_of(files, size, options.shard), ahead=2 * options.jobs
            ):
                if broken:
                    print(f"fieldcalib: {broken}", file=sys.stderr)
                    return 1
    with result_folder(options, record, began) as results:
        work(options, results, files, size, function, lost, len(files))
    return results.exit_code


def lost(file: FrameFile, problem: str) -> Outcome:
    """What is written of a file that is broken."""
    return Outcome.broken(file.id, file.path, problem)


def outcome_of(id: str, found: Found, line: Mapping[str, Any]) -> Outcome:
    """What is written of a frame; its camera, if it passes the thresholds that the user has set."""
    keeps = found.calibration.status not in WITHHELD
    return Outcome.of(id, found.calibration, line, keeps=keeps, files=found.files)


def by_prior(
    frames: Mapping[str, Pixels],
    prior_of: Callable[[str], P],
    calibrate: Callable[[list[Pixels], P], Sequence[Calibration]],
) -> list[Calibration]:
    """Calibrate frames, by id, together with those of the same prior; in the order of `frames`."""
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
    """The loss that the paper prints, for the frames that have a camera, each on the field that it was found on."""
    cameras_on: dict[Field, dict[str, Camera]] = {}
    for id, calibration in calibrations.items():
        if calibration.camera is not None:
            cameras_on.setdefault(calibration.field or field, {})[id] = calibration.camera
    losses: dict[str, float] = {}
    for pitch, cameras in cameras_on.items():
        values = ndc_loss(list(cameras.values()), pitch, [frames[id] for id in cameras], kind="eq3")
        losses.update(zip(cameras, values.tolist(), strict=True))
    return losses
