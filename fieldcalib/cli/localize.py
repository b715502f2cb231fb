"""`fieldcalib localize`: images to labelled pixels."""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import fieldcalib
from fieldcalib.console.arguments import add_labels, add_limits, folder_name
from fieldcalib.console.field_options import add_sized_field, field_of
from fieldcalib.console.inputs import add_inputs
from fieldcalib.console.network import add_network, load_network, network_in_process
from fieldcalib.fields.field import Field
from fieldcalib.fields.segments import Arc
from fieldcalib.io.annotation_files import ONE_IMAGE
from fieldcalib.io.annotations import Annotation, names_of, order_along, renamed
from fieldcalib.io.files import FrameFile, write_text
from fieldcalib.io.formats import ANNOTATIONS, OTHER_ANNOTATIONS, VIDEOS
from fieldcalib.io.image import Image
from fieldcalib.io.images import IMAGES_AT_ONCE, in_parts
from fieldcalib.io.line_log import whole_lines
from fieldcalib.io.results import BROKEN
from fieldcalib.localize import Localization, Network, localize
from fieldcalib.problem.labelled_pixels import Pixels
from fieldcalib.run_folder.annotated import check_labels
from fieldcalib.run_folder.images import Frame, ReadImage, lost, opened, pixels_of
from fieldcalib.run_folder.results import LOCALIZED, Outcome, Results, finish, run_folder
from fieldcalib.run_folder.run_record import RunRecord, recorded
from fieldcalib.run_folder.units import Made, add_jobs, work

LOCALIZED_STATUS = "localized"
SOCCERNET = "soccernet"
FORMATS = (SOCCERNET, *OTHER_ANNOTATIONS)
OF_ALL = frozenset(OTHER_ANNOTATIONS) - {ONE_IMAGE}  # have one file for all frames
OF_ALL_FRAMES = Path(LOCALIZED).stem  # its name


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command, add its arguments and set ``run``, a function of them that gives the exit code."""
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
    add_network(parser)
    add_limits(parser)
    add_jobs(parser)
    parser.set_defaults(run=run, command="localize")


def run(options: argparse.Namespace) -> int:
    """Localize; returns the exit code."""
    began = time.perf_counter()
    if any(map(VIDEOS.recognises, options.input)):
        raise ValueError("expected images: fieldcalib run takes videos")
    check_labels(options.labels or {}, field_of(options))
    _names(options)  # a ValueError if that cannot be
    function = FromImages(options, load_network(options))
    with opened(options.input, options.most_pixels) as source:
        writes = [_file_name(options.format, "<id>")]
        record = RunRecord.of(options, source.files, unit=IMAGES_AT_ONCE, writes=writes)
        with run_folder(options, record, LOCALIZED) as results:
            work(options, results, source.files, IMAGES_AT_ONCE, function, lost, source.count)
            summary = localized_summary(results, recorded(options), time.perf_counter() - began)
            if options.shard is None:
                write_all(options.out, options.format)
            finish(options.out, summary)
    frames, segments = summary["annotations"], summary["segments"]
    print(f"{segments / max(frames, 1):.1f} segments a frame in {frames} frames in {options.out}")
    return results.exit_code


def write_all(out: Path, format: str) -> None:
    """Write the file of all frames in ``localized.jsonl``, where the format has one."""
    if format in OF_ALL:
        content = OTHER_ANNOTATIONS[format].write(_annotations(out / LOCALIZED))
        write_text(out / _file_name(format, ""), content)


def _annotations(log: Path) -> Iterator[Annotation]:
    for line in map(json.loads, whole_lines(log)):
        if line["status"] != BROKEN:
            pixels = {label: np.array(xy) for label, xy in line["pixels"].items()}
            width, height = line["image_size"]
            yield Annotation(line["id"], pixels, (width, height), line["image"])


def _file_name(format: str, id: str) -> str:
    """Of a frame's annotation, or of those of all frames."""
    if format == SOCCERNET:
        return ANNOTATIONS.file_name(id)
    return OTHER_ANNOTATIONS[format].file_name(OF_ALL_FRAMES if format in OF_ALL else id)


def localized_summary(results: Results, options: Mapping[str, Any], seconds: float) -> dict[str, Any]:
    """What summary.json says; `seconds` is how long everything took."""
    lines = map(json.loads, whole_lines(results.out / LOCALIZED))
    return {
        "frames": results.done,
        "annotations": results.done - results.statuses[BROKEN],
        "segments": sum(line.get("segments", 0) for line in lines),
        "seconds": {"total": seconds},
        "options": options,
        "version": fieldcalib.__version__,
    }


@dataclass(frozen=True)
class FromImages:
    """The annotations of some images."""

    options: argparse.Namespace
    network: Network
    """Other processes load their own."""

    def __reduce__(self) -> tuple[object, ...]:
        return _in_process, (self.options,)

    def __call__(self, files: tuple[FrameFile, ...]) -> Made:
        """Read the images and find the markings."""
        read = ReadImage(self.options.most_bytes, self.options.most_pixels)
        parts = in_parts(map(read, files), IMAGES_AT_ONCE, pixels_of)
        return Made([outcome for part in parts for outcome in self._of_part(part)])

    def _of_part(self, frames: Sequence[Frame]) -> list[Outcome]:
        images = [frame.image for frame in frames if frame.image is not None]
        found = iter(localize(field_of(self.options), images, self.network))
        return [
            lost(frame, frame.problem) if frame.image is None else self._outcome(frame, frame.image, next(found))
            for frame in frames
        ]

    def _outcome(self, frame: Frame, image: Image, found: Localization) -> Outcome:
        format, size, field = self.options.format, (image.shape[1], image.shape[0]), field_of(self.options)
        line: dict[str, Any] = {"id": frame.id, "status": LOCALIZED_STATUS, "message": ""}
        line["segments"] = len(found.pixels)
        names, content = _names(self.options), ""
        try:
            if format == SOCCERNET:
                content = ANNOTATIONS.write(renamed(found.pixels, names), size) + "\n"
            elif format in OF_ALL:
                line |= {"image": Path(frame.path).name, "image_size": size}
                line["pixels"] = {label: xy.tolist() for label, xy in _paths(found, field, names).items()}
            else:
                of_frame = Annotation(
                    frame.id, _paths(found, field, names), size, _seen_from(self.options.out, Path(frame.path))
                )
                content = OTHER_ANNOTATIONS[format].write([of_frame])
        except ValueError as error:
            return lost(frame, str(error))
        files = {_file_name(format, frame.id): content.encode()} if content else {}
        return Outcome(frame.id, json.dumps(line), LOCALIZED_STATUS, files=files)


def _names(options: argparse.Namespace) -> dict[str, str]:
    """What labels are called in the annotations."""
    return names_of(options.labels or {}, field_of(options))


def _paths(found: Localization, field: Field, names: Mapping[str, str]) -> Pixels:
    """The pixels of each segment, by its name, in their order along it: other tools draw lines between them."""
    return {names[label]: xy[order_along(xy, isinstance(field[label], Arc))] for label, xy in found.pixels.items()}


def _seen_from(folder: Path, image: Path) -> str:
    """The path of an image from a folder, so that the image is found; its name if it lies in a zip."""
    if not image.exists():
        return image.name
    try:
        return Path(os.path.relpath(image, folder)).as_posix()
    except ValueError:  # another drive
        return str(image.absolute())


def _in_process(options: argparse.Namespace) -> FromImages:
    return FromImages(options, network_in_process(options))
