"""`fieldcalib localize`: images to labelled pixels."""

from __future__ import annotations

import argparse
from pathlib import Path

from fieldcalib.cli.frames import AT_ONCE, add_network, in_parts, load_network, opened
from fieldcalib.fields.soccer import soccer
from fieldcalib.io.files import write_text
from fieldcalib.io.images import is_video
from fieldcalib.io.soccernet import format_annotation
from fieldcalib.localize import localize


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the command line."""
    parser = commands.add_parser(
        "localize",
        help="find the markings in images",
        description="Find the markings of the field in images, and write them as SoccerNet annotations (<id>.json: "
        "label -> normalised points), as fieldcalib calibrate reads them.",
    )
    parser.add_argument("input", nargs="+", type=Path, metavar="INPUT", help="images, or a folder or a zip of them")
    parser.add_argument("--out", required=True, type=Path, metavar="DIR", help="where the annotations go")
    add_network(parser)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Localize; returns the exit code."""
    from tqdm import tqdm

    if any(map(is_video, options.input)):
        raise ValueError("expected images: fieldcalib run takes videos")
    field, network = soccer(), load_network(options)
    segments = broken = 0
    with opened(options.input) as source, tqdm(total=source.count, unit="frame", disable=None) as progress:
        options.out.mkdir(parents=True, exist_ok=True)
        for part in in_parts(source.frames, AT_ONCE):
            read = [(frame.id, frame.image) for frame in part if frame.image is not None]
            found = localize(field, [image for _, image in read], network)
            for (id, image), one in zip(read, found, strict=True):
                annotation = format_annotation(one.pixels, (image.shape[1], image.shape[0]))
                write_text(options.out / f"{id}.json", annotation + "\n")
                segments += len(one.pixels)
            broken += len(part) - len(read)
            progress.update(len(part))
    frames = source.count - broken
    print(f"{segments / max(frames, 1):.1f} segments a frame in {frames} frames in {options.out}")
    return 1 if broken else 0
