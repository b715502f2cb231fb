"""`fieldcalib localize`: images to labelled pixels."""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import fieldcalib
from fieldcalib.cli.arguments import folder_name
from fieldcalib.cli.fields import add_sized_field, field_of
from fieldcalib.cli.frames import (
    Frame,
    ReadImage,
    add_limits,
    add_network,
    load_network,
    lost,
    network_in_process,
    opened,
    pixels_of,
)
from fieldcalib.cli.inputs import add_inputs
from fieldcalib.cli.results import LOCALIZED, Outcome, Results, finish, run_folder
from fieldcalib.cli.run_record import RunRecord, recorded
from fieldcalib.cli.units import Made, add_jobs, work
from fieldcalib.io.files import FrameFile
from fieldcalib.io.formats import ANNOTATIONS, VIDEOS
from fieldcalib.io.image import Image
from fieldcalib.io.images import IMAGES_AT_ONCE, in_parts
from fieldcalib.io.line_log import whole_lines
from fieldcalib.io.results import BROKEN
from fieldcalib.localize import Localization, Network, localize

LOCALIZED_STATUS = "localized"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command, add its arguments and set ``run``, a function of them that gives the exit code."""
    parser.description = (
        "Find the markings of the field in images, and write them as SoccerNet annotations (<id>.json: "
        "label -> normalised points), as fieldcalib calibrate reads them."
    )
    add_inputs(parser, "images, folders and zips of them")
    parser.add_argument("--out", required=True, type=folder_name, metavar="DIR", help="where the annotations go")
    add_sized_field(parser)
    add_network(parser)
    add_limits(parser)
    add_jobs(parser)
    parser.set_defaults(run=run, command="localize")


def run(options: argparse.Namespace) -> int:
    """Localize; returns the exit code."""
    began = time.perf_counter()
    if any(map(VIDEOS.recognises, options.input)):
        raise ValueError("expected images: fieldcalib run takes videos")
    function = FromImages(options, load_network(options))
    with opened(options.input, options.most_pixels) as source:
        record = RunRecord.of(options, source.files, unit=IMAGES_AT_ONCE, writes=[ANNOTATIONS.file_name("<id>")])
        with run_folder(options, record, LOCALIZED) as results:
            work(options, results, source.files, IMAGES_AT_ONCE, function, lost, source.count)
            summary = localized_summary(results, recorded(options), time.perf_counter() - began)
            finish(options.out, summary)
    frames, segments = summary["annotations"], summary["segments"]
    print(f"{segments / max(frames, 1):.1f} segments a frame in {frames} frames in {options.out}")
    return results.exit_code


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
        try:
            annotation = ANNOTATIONS.write(found.pixels, (image.shape[1], image.shape[0])) + "\n"
        except ValueError as error:
            return lost(frame, str(error))
        line = {"id": frame.id, "status": LOCALIZED_STATUS, "message": "", "segments": len(found.pixels)}
        files = {ANNOTATIONS.file_name(frame.id): annotation.encode()}
        return Outcome(frame.id, json.dumps(line), LOCALIZED_STATUS, files=files)


def _in_process(options: argparse.Namespace) -> FromImages:
    return FromImages(options, network_in_process(options))
