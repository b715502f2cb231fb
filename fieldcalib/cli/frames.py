"""What `fieldcalib run` and `fieldcalib localize` share: images one after the other, and the network."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TypeVar

from fieldcalib.io.files import BrokenFileError, FrameFile
from fieldcalib.io.image import Image
from fieldcalib.io.images import VideoReader, find_images, is_video, parse_image
from fieldcalib.localize import SegmentationNetwork
from fieldcalib.localize.network import CPU

AT_ONCE = 8  # images in memory

Item = TypeVar("Item")


@dataclass(frozen=True)
class Frame:
    """An image, or what is wrong with it."""

    id: str
    image: Image | None
    problem: str = ""


@dataclass(frozen=True)
class Source:
    """Frames to be read one after the other."""

    frames: Iterable[Frame]
    count: int
    """How many there are, of a video as its file says."""
    frames_per_second: float | None = None
    """Of a video."""


@contextmanager
def opened(inputs: Sequence[Path]) -> Iterator[Source]:
    """The frames of images, folders and zips of them, or of one video, whose ids are six-digit numbers from 0.

    Raises
    ------
    ValueError
        If a video comes with other inputs.
    FileNotFoundError, BrokenFileError
        As `find_images` and `VideoReader`.
    """
    if not any(map(is_video, inputs)):
        files = find_images(inputs)
        yield Source(map(_read, files), len(files))
        return
    if len(inputs) > 1:
        raise ValueError("expected one video, or images and folders of them, got a video and more: run them one by one")
    with VideoReader(inputs[0]) as video:
        frames = (Frame(f"{index:06d}", image) for index, image in enumerate(video))
        yield Source(frames, video.count, video.frames_per_second)


def _read(file: FrameFile) -> Frame:
    """An image; what is wrong with it is said on stderr too."""
    try:
        return Frame(file.id, parse_image(file.read()))
    except BrokenFileError as error:
        print(f"fieldcalib: {file.path}: {error}", file=sys.stderr)
        return Frame(file.id, None, str(error))


def in_parts(items: Iterable[Item], size: int) -> Iterator[list[Item]]:
    """Lists of up to `size` items.

    Examples
    --------
    >>> list(in_parts("abcde", 2))
    [['a', 'b'], ['c', 'd'], ['e']]
    """
    rest = iter(items)
    while part := list(islice(rest, size)):
        yield part


def add_network(parser: argparse.ArgumentParser) -> None:
    """--model, --provider and --threads."""
    parser.add_argument(
        "--model", type=Path, metavar="FILE", help="network in ONNX, FILE.json beside it (the one that comes along)"
    )
    parser.add_argument(
        "--provider", default=CPU, metavar="NAME", help=f"onnxruntime's name of what runs the network ({CPU})"
    )
    parser.add_argument("--threads", type=int, default=2, metavar="N", help="of the processor, for the network (2)")


def add_refinement(parser: argparse.ArgumentParser) -> None:
    """--no-refinement."""
    parser.add_argument(
        "--no-refinement",
        dest="refine",
        action="store_false",
        help="do not look for the white lines in the image: quicker, and less exact",
    )


def load_network(options: argparse.Namespace) -> SegmentationNetwork:
    """The network that the options ask for."""
    return SegmentationNetwork.load(options.model, provider=options.provider, threads=options.threads)
