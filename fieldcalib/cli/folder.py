"""From a folder of annotated frames to a folder of cameras, whatever calibrates them."""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from dataclasses import field as attribute
from pathlib import Path
from types import MappingProxyType
from typing import Any, BinaryIO, TypeAlias, TypeVar

import numpy as np

import fieldcalib
from fieldcalib._types import Array
from fieldcalib.assess.ndc import ndc_loss
from fieldcalib.assess.result import ANGLE_NAMES, Calibration, Status, Verdict
from fieldcalib.assess.surprises import SQUASHED
from fieldcalib.fields.field import Field
from fieldcalib.fields.soccer import soccer
from fieldcalib.geometry.camera import Camera
from fieldcalib.io.files import MOST_BYTES, FrameFile, files_beside, whole_file, write_text
from fieldcalib.io.formats import ANNOTATIONS, CAMERAS
from fieldcalib.io.output_folder import output_folder
from fieldcalib.io.results import BROKEN, LINES
from fieldcalib.problem.labelled_pixels import Pixels, check_segments, thinned
from fieldcalib.problem.layout import ANGLES, CENTER, LOG_F

Method: TypeAlias = Callable[[dict[str, Pixels]], Sequence[Calibration]]

P = TypeVar("P")  # a prior, in whatever form

FRAMES_AT_ONCE = 256  # calibrated together, between two steps of the progress bar
WITHHELD = (Status.REJECTED, Status.IMPROBABLE)  # cameras that the user of `calibrate` did not want
METRES = (0.5, 1.0)  # that the probabilities in cameras.jsonl are about
# Frames with pixels that are not square, least number and share: of 728 annotated frames none, of the same squashed to
# 640x640 one in fifteen, with width and height swapped more than half.
SUSPICIOUS = 3, 0.05
SUMMARY = "summary.json"  # of a run
NAMED = 3  # skipped files of a kind


@dataclass(frozen=True)
class Frames:
    """What was read, by frame id in the order of the input."""

    ids: tuple[str, ...]
    pixels: Mapping[str, Pixels]
    broken: Mapping[str, str]
    """What is wrong with the files that could not be read."""


def read_frames(
    inputs: Sequence[Path],
    field: Field,
    image_size: tuple[int, int],
    *,
    strict: bool = False,
    most_bytes: float = MOST_BYTES,
) -> Frames:
    """Read and check annotations; broken files are named on stderr, and with `strict` the first one ends it."""
    files = ANNOTATIONS.find(inputs)
    name_skipped(inputs, files)
    pixels: dict[str, Pixels] = {}
    broken: dict[str, str] = {}
    for file in files:
        try:
            frame = ANNOTATIONS.read(file.read(most_bytes), image_size)
            pixels[file.id] = thinned(check_segments(field, frame, image_size))
        except (ValueError, MemoryError) as error:
            broken[file.id] = problem(error)
            print(f"fieldcalib: {file.path}: {broken[file.id]}", file=sys.stderr)
            if strict:
                break
    return Frames(tuple(file.id for file in files), pixels, broken)


def problem(error: Exception) -> str:
    """What is wrong with a file; a MemoryError does not say it."""
    return str(error) or "there is not enough memory for it"


def name_skipped(inputs: Iterable[Path], used: Iterable[FrameFile]) -> None:
    """Say on stderr what lies in folders and zips and is not used, in one line: how many of each kind, and the first.

    A frame may be among them, under a name that no frame has.
    """
    by_suffix: dict[str, list[Path]] = {}
    for path in files_beside(inputs, used):
        if path.name not in (LINES, SUMMARY):
            by_suffix.setdefault(path.suffix or "without ending", []).append(path)
    if by_suffix:
        kinds = (f"{len(paths)} {suffix} ({_first(paths)})" for suffix, paths in by_suffix.items())
        print(f"fieldcalib: skipped {', '.join(kinds)}", file=sys.stderr)


def _first(paths: Sequence[Path]) -> str:
    """The names of a few of several files."""
    names = [path.name for path in paths[:NAMED]]
    return ", ".join([*names, "..."] if len(paths) > NAMED else names)


def calibrate_folder(
    options: argparse.Namespace,
    field: Field,
    method: Method,
    *,
    at_once: int = FRAMES_AT_ONCE,
    details: Mapping[str, Mapping[str, Any]] = MappingProxyType({}),
) -> int:
    """Read ``options.input``, calibrate by `method`, write to ``options.out``; returns the exit code.

    `method` gets at most `at_once` frames, by id, and gives their calibrations in this order. It may fill `details`:
    more keys of the frames' lines in cameras.jsonl, by id.
    """
    from tqdm import tqdm

    began = time.perf_counter()
    frames = read_frames(options.input, field, options.size, strict=options.strict, most_bytes=options.most_bytes)
    if options.strict and frames.broken:
        return 1
    with (
        result_folder(options, began) as results,
        tqdm(total=len(frames.pixels), unit="frame", disable=None) as progress,  # None: only on a terminal
    ):
        for begin in range(0, len(frames.ids), at_once):
            ids = frames.ids[begin : begin + at_once]
            part = {id: frames.pixels[id] for id in ids if id in frames.pixels}
            start = time.perf_counter()
            calibrations = dict(zip(part, method(part) if part else (), strict=True))
            results.calibrating += time.perf_counter() - start
            eq3 = _eq3_losses(field, part, calibrations)
            for id in ids:
                if id in frames.broken:
                    results.add(broken_line(id, frames.broken[id]), None)
                else:
                    line = calibration_line(id, calibrations[id], eq3.get(id)) | dict(details.get(id, {}))
                    results.add(line, calibrations[id])
            progress.update(len(part))
    return 1 if frames.broken else 0


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


def not_withheld(calibration: Calibration) -> bool:
    """Whether the camera passes the thresholds that the user has set."""
    return calibration.status not in WITHHELD


@contextmanager
def result_folder(
    options: argparse.Namespace, began: float, keeps: Callable[[Calibration], bool] = not_withheld
) -> Iterator[Results]:
    """``options.out``, for cameras frame by frame; when all went well it gets its cameras.jsonl and its summary.json.

    `began` is what `time.perf_counter` said at the start; `keeps` says of a calibration whether its camera, if there is
    one, gets a file.
    """
    with output_folder(options.out):
        with whole_file(options.out / LINES) as lines:
            results = Results(options.out, lines, keeps)
            yield results
        results.summarize(began, options)


@dataclass
class Results:
    """What is written of frames, and counted."""

    out: Path
    lines: BinaryIO
    """cameras.jsonl."""
    keeps: Callable[[Calibration], bool]
    """Whether the camera of a calibration gets a file."""
    verdicts: Counter[str] = attribute(default_factory=Counter)
    statuses: Counter[str] = attribute(default_factory=Counter)
    cameras: int = 0
    squashed: int = 0
    """Frames whose labels say that the pixels are not square."""
    calibrating: float = 0.0
    """Seconds that were spent on the calibrations, without files and pictures."""

    def add(self, line: Mapping[str, Any], calibration: Calibration | None) -> None:
        """Write the line of the next frame, and its camera if that is kept.

        An earlier run's camera of a frame that has none now is removed.
        """
        path = self.out / CAMERAS.file_name(line["id"])
        if calibration is None or calibration.camera is None or not self.keeps(calibration):
            if os.path.lexists(path):  # not for a name that is too long
                path.unlink()
        else:
            write_text(path, CAMERAS.write(calibration.camera) + "\n")
            self.cameras += 1
        self.lines.write((json.dumps(line) + "\n").encode())
        self.statuses[line["status"]] += 1
        if calibration is not None:
            self.verdicts[line["verdict"]] += 1
            self.squashed += SQUASHED in calibration.concerns

    def summarize(self, began: float, options: argparse.Namespace) -> None:
        """Write summary.json, and say how many cameras there are."""
        frames = self.statuses.total()
        summary = {
            "frames": frames,
            "cameras": self.cameras,
            "completeness": 100.0 * self.cameras / frames,
            "verdict": {verdict.value: self.verdicts[verdict] for verdict in Verdict},
            "status": dict(self.statuses),
            "seconds": {"calibration": self.calibrating, "total": time.perf_counter() - began},
            "milliseconds_per_frame": 1e3 * self.calibrating / max(self.verdicts.total(), 1),
            "options": _recorded(options),
            "version": fieldcalib.__version__,
        }
        write_text(self.out / SUMMARY, json.dumps(summary, indent=2) + "\n")
        statuses = ", ".join(f"{count} {status}" for status, count in self.statuses.most_common())
        verdicts = ", ".join(f"{self.verdicts[verdict]} {verdict}" for verdict in Verdict if self.verdicts[verdict])
        counts = "; ".join(filter(None, (statuses, verdicts)))
        print(f"{_counted(self.cameras, 'camera')} of {_counted(frames, 'frame')} in {self.out}: {counts}")
        if self.squashed >= max(SUSPICIOUS[0], SUSPICIOUS[1] * self.verdicts.total()):
            seen = f"{self.squashed} of {_counted(frames, 'frame')} show pixels that are not square"
            print(f"{seen}: is the size right? --display-size declares squashed pictures", file=sys.stderr)
        left = sum(1 for path in self.out.glob(CAMERAS.file_name("*"))) - self.cameras
        if left > 0:
            print(f"{_counted(left, 'camera')} of earlier runs left in {self.out}", file=sys.stderr)


def _counted(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"


def _recorded(options: argparse.Namespace) -> dict[str, Any]:
    """The options of a run as JSON, without where its results go and what would have stopped it."""
    unnamed = {"run", "out", "strict", "most_bytes", "most_pixels"}
    return json.loads(json.dumps({k: v for k, v in vars(options).items() if k not in unnamed}, default=str))  # type: ignore[no-any-return]


def _eq3_losses(
    field: Field, frames: Mapping[str, Pixels], calibrations: Mapping[str, Calibration]
) -> dict[str, float]:
    """The loss that the paper prints, for the frames that have a camera, each on the field that it was found on."""
    cameras_on: dict[tuple[float, float], dict[str, Camera]] = {}
    for id, calibration in calibrations.items():
        if calibration.camera is not None:
            pitch = calibration.field or field
            cameras_on.setdefault((pitch.length, pitch.width), {})[id] = calibration.camera
    losses: dict[str, float] = {}
    for size, cameras in cameras_on.items():
        values = ndc_loss(list(cameras.values()), soccer(*size), [frames[id] for id in cameras], kind="eq3")
        losses.update(zip(cameras, values.tolist(), strict=True))
    return losses


def broken_line(id: str, message: str) -> dict[str, Any]:
    """The line of cameras.jsonl of a file that could not be read."""
    return {"id": id, "status": BROKEN, "message": message}


def calibration_line(id: str, calibration: Calibration, eq3: float | None) -> dict[str, Any]:
    """One frame's line of cameras.jsonl."""
    line: dict[str, Any] = {"id": id, "status": str(calibration.status), "message": calibration.message}
    line |= {"verdict": str(calibration.verdict), "reason": calibration.reason}
    line |= calibration.to_dict()
    if calibration.camera is not None:
        line |= {"rms_as_labelled_px": _number(calibration.rms_as_labelled), "loss_ndc_eq3": eq3}
    if calibration.camera is not None and calibration.knows_errors:
        line["standard_deviations"] = _standard_deviations(calibration.camera, calibration.covariance)
    if calibration.has_probability:
        line |= {f"probability_right_{metres:g}m": _number(calibration.probability(metres)) for metres in METRES}
    return line


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
