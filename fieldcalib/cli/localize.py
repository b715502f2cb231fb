"""`fieldcalib localize`: images to labelled pixels."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from fieldcalib.cli.frames import add_limits, add_network, load_network, opened, pixels_of
from fieldcalib.fields.soccer import soccer
from fieldcalib.io.files import write_text
from fieldcalib.io.formats import ANNOTATIONS, VIDEOS
from fieldcalib.io.images import IMAGES_AT_ONCE, in_parts
from fieldcalib.io.output_folder import output_folder
from fieldcalib.localize import localize


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command, add its arguments and set ``run``, a function of them that gives the exit code."""
    parser.description = (
        "Find the markings of the field in images, and write them as SoccerNet annotations (<id>.json: "
        "label -> normalised points), as fieldcalib calibrate reads them."
    )
    parser.add_argument("input", nargs="+", type=Path, metavar="INPUT", help="images, or a folder or a zip of them")
    parser.add_argument("--out", required=True, type=Path, metavar="DIR", help="where the annotations go")
    add_network(parser)
    add_limits(parser)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Localize; returns the exit code."""
    from tqdm import tqdm

    if any(map(VIDEOS.recognises, options.input)):
        raise ValueError("expected images: fieldcalib run takes videos")
    field, network = soccer(), load_network(options)
    segments = broken = 0
    with (
        opened(options.input, options.most_bytes, options.most_pixels) as source,
        output_folder(options.out),
        tqdm(total=source.count, unit="frame", disable=None) as progress,
    ):
        for part in in_parts(source.frames, IMAGES_AT_ONCE, pixels_of):
            read = [(frame.id, frame.image) for frame in part if frame.image is not None]
            broken += len(part) - len(read)
            found = localize(field, [image for _, image in read], network)
            for (id, image), one in zip(read, found, strict=True):
                try:
                    annotation = ANNOTATIONS.write(one.pixels, (image.shape[1], image.shape[0]))
                except ValueError as error:
                    print(f"fieldcalib: {id}: {error}", file=sys.stderr)
                    broken += 1
                    continue
                write_text(options.out / ANNOTATIONS.file_name(id), annotation + "\n")
                segments += len(one.pixels)
            progress.update(len(part))
    frames = source.count - broken
    print(f"{segments / max(frames, 1):.1f} segments a frame in {frames} frames in {options.out}")
    return 1 if broken else 0
