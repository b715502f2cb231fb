"""`fieldcalib localize`: images to labelled pixels."""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import fieldcalib
from fieldcalib._progress import counted, show
from fieldcalib._whole_files import write_text
from fieldcalib.console.arguments import (
    NetworkOptions,
    add_image_limits,
    add_inputs,
    add_labels,
    add_run_options,
    add_sized_field,
    digest_of,
    folder_name,
    load_network,
    run_options,
)
from fieldcalib.console.options import add_options, given
from fieldcalib.io.annotations import Annotation, names_of, renamed
from fieldcalib.io.files import BrokenFileError, FrameFile, parse_json_object
from fieldcalib.io.formats import ANNOTATIONS, FILE_PER_IMAGE, OTHER_ANNOTATIONS, VIDEOS
from fieldcalib.io.frame_source import Frame, ReadImage, pixels_of
from fieldcalib.io.image_files import IMAGES_AT_ONCE, Image, in_parts, size_of
from fieldcalib.io.output_folder import whole_lines
from fieldcalib.io.results import BROKEN
from fieldcalib.localize import Localization, Network, localize
from fieldcalib.problem.labelled_pixels import Pixels
from fieldcalib.run_folder.engine import image_files, outcomes_of
from fieldcalib.run_folder.labelled_frames import check_labels
from fieldcalib.run_folder.record import ID, ONE_FILE_NAME, Outcome, RunRecord
from fieldcalib.run_folder.results import LOCALIZED, ResultsWriter, finish, open_run_folder
from fieldcalib.run_folder.work_units import UnitResult, work

LOCALIZED_STATUS = "localized"
SOCCERNET = "soccernet"
FORMATS = (SOCCERNET, *OTHER_ANNOTATIONS)
ONE_FILE = frozenset(OTHER_ANNOTATIONS) - {FILE_PER_IMAGE}  # formats with one file for all frames


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command and add its arguments, which `run` takes."""
    parser.description = (
        "Find the markings of the field in images, and write them as SoccerNet annotations (<id>.json: "
        "label -> normalised points), or as those of other tools, to be corrected there. fieldcalib calibrate reads "
        "them."
    )
    add_inputs(parser, "images, folders and zips of them")
    parser.add_argument("--out", required=True, type=folder_name, metavar="DIR", help="where the annotations go")
    add_sized_field(parser)
    parser.add_argument(
        "--format",
        choices=FORMATS,
        default=SOCCERNET,
        help=f"of the annotations; labelme: <id>.json; others: one file of all frames, localized.xml or localized.json "
        f"({SOCCERNET})",
    )
    add_labels(parser)
    add_options(parser, NetworkOptions)
    add_image_limits(parser)
    add_run_options(parser)


def run(options: argparse.Namespace) -> int:
    """Localize; returns the exit code."""
    began = time.perf_counter()
    if any(map(VIDEOS.recognises, options.input)):
        raise ValueError("expected images: fieldcalib run takes videos")
    run, network_options = run_options(options), NetworkOptions.of(options)
    labels, field, format = options.labels or {}, network_options.field, options.format
    check_labels(labels, field)
    read = given(ReadImage, options)
    names = names_of(labels, field)  # a ValueError if that cannot be
    network = load_network(network_options)
    method = ImageLocalizer(network_options, read, names, format, run.out, network)
    files = image_files(options.input)
    record = RunRecord.of(run, files, unit=IMAGES_AT_ONCE, writes=[_file_name(format, ID)], network=digest_of(network))
    with open_run_folder(run, record, LOCALIZED, files) as results:
        work(run, results, files, IMAGES_AT_ONCE, method, len(files))
        results.check_readable()
        summary = localized_summary(results, run.recorded, time.perf_counter() - began)
        if run.shard is None:
            write_all(run.out, format)
        finish(run.out, summary)
    count = summary["annotations"]
    show(f"{summary['segments'] / max(count, 1):.1f} segments a frame in {counted(count, 'frame')} in {run.out}")
    return results.exit_code


def write_all(out: Path, format: str) -> None:
    """Write the file of all frames in ``localized.jsonl``, where the format has one."""
    if format in ONE_FILE:
        content = OTHER_ANNOTATIONS[format].write(_annotations(out / LOCALIZED))
        write_text(out / _file_name(format, ""), content)


def _annotations(log: Path) -> Iterator[Annotation]:
    for line in map(parse_localized, whole_lines(log)):
        if line["status"] != BROKEN:
            pixels = {label: np.array(xy) for label, xy in line["pixels"].items()}
            width, height = line["image_size"]
            yield Annotation(line["id"], pixels, (width, height), line["image"])


def parse_localized(text: bytes) -> dict[str, Any]:
    """Parse and check the line of a frame in ``localized.jsonl``; a BrokenFileError if it is none."""
    line = parse_json_object(text, "a frame")
    if not all(isinstance(line.get(key), str) for key in ("id", "status")):
        raise BrokenFileError("expected a frame with the keys 'id' and 'status', texts")
    if not isinstance(line.get("segments", 0), int) or not isinstance(line.get("image", ""), str):
        raise BrokenFileError(f"frame {line['id']}: expected a number of 'segments', and 'image' as a text")
    try:
        width, height = map(int, line.get("image_size", (1, 1)))
        points = [np.array(xy, dtype=float).reshape(-1, 2) for xy in line.get("pixels", {}).values()]
    except (AttributeError, TypeError, ValueError, OverflowError) as error:
        raise BrokenFileError(f"frame {line['id']}: expected the pixels of labels and an image size: {error}") from None
    if min(width, height) < 1 or not all(np.isfinite(xy).all() for xy in points):
        raise BrokenFileError(f"frame {line['id']}: its pixels or its image size are none")
    return line


def _file_name(format: str, id: str) -> str:
    """Name of the file of a frame's annotation, or of the file of all annotations."""
    if format == SOCCERNET:
        return ANNOTATIONS.file_name(id)
    return OTHER_ANNOTATIONS[format].file_name(ONE_FILE_NAME if format in ONE_FILE else id)


def localized_summary(results: ResultsWriter, options: Mapping[str, Any], seconds: float) -> dict[str, Any]:
    """Content of summary.json; `seconds` is how long everything took."""
    lines = map(parse_localized, whole_lines(results.out / LOCALIZED))
    return {
        "frames": results.done,
        "annotations": results.done - results.statuses[BROKEN],
        "segments": sum(line.get("segments", 0) for line in lines),
        "seconds": {"total": seconds},
        "options": options,
        "version": fieldcalib.__version__,
    }


@dataclass(frozen=True)
class ImageLocalizer:
    """Finds the markings in images."""

    network_options: NetworkOptions
    read: ReadImage
    names: Mapping[str, str]
    """Labels in the annotations, by those of the field."""
    format: str
    out: Path
    network: Network

    def __call__(self, files: tuple[FrameFile, ...]) -> UnitResult:
        """Read the images and find the markings."""
        parts = in_parts(map(self.read, files), IMAGES_AT_ONCE, pixels_of)
        return UnitResult([outcome for part in parts for outcome in self._of_part(part)])

    def _of_part(self, frames: Sequence[Frame]) -> list[Outcome]:
        images = [frame.image for frame in frames if frame.image is not None]
        return outcomes_of(frames, localize(self.network_options.field, images, self.network), self._outcome)

    def _outcome(self, frame: Frame, image: Image, found: Localization) -> Outcome:
        size = size_of(image)
        line: dict[str, Any] = {"id": frame.id, "status": LOCALIZED_STATUS, "message": ""}
        line["segments"] = len(found.pixels)
        content = ""
        try:
            if self.format == SOCCERNET:
                content = ANNOTATIONS.write(renamed(found.pixels, self.names), size) + "\n"
            elif self.format in ONE_FILE:
                line |= {"image": Path(frame.path).name, "image_size": size}
                line["pixels"] = {label: xy.tolist() for label, xy in self._paths(found).items()}
            else:
                of_frame = Annotation(frame.id, self._paths(found), size, _relative_path(self.out, Path(frame.path)))
                content = OTHER_ANNOTATIONS[self.format].write([of_frame])
        except ValueError as error:
            return Outcome.broken(frame, str(error))
        files = {_file_name(self.format, frame.id): content.encode()} if content else {}
        return Outcome(line, files=files)

    def _paths(self, found: Localization) -> Pixels:
        """The pixels of each segment, by its name, in their order along it: other tools draw lines between them."""
        field = self.network_options.field
        return {self.names[label]: xy[field[label].order(xy)] for label, xy in found.pixels.items()}


def _relative_path(folder: Path, image: Path) -> str:
    """The path of an image relative to a folder; its name if it lies in a zip."""
    if not image.exists():
        return image.name
    try:
        return Path(os.path.relpath(image, folder)).as_posix()
    except ValueError:  # another drive
        return str(image.absolute())
