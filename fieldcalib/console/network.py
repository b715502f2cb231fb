"""The segmentation network of a command: --model, --provider, --threads, --no-refinement."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from fieldcalib.console.arguments import count
from fieldcalib.console.field_options import field_of
from fieldcalib.console.interrupts import interrupts_end_the_process
from fieldcalib.fields.field import Field
from fieldcalib.localize import SegmentationNetwork
from fieldcalib.localize.grid import BACKGROUND, classes_without_segment
from fieldcalib.localize.network import CPU


def add_network(parser: argparse.ArgumentParser) -> None:
    """--model, --provider and --threads."""
    parser.add_argument(
        "--model", type=Path, metavar="FILE", help="network in ONNX, FILE.json beside it (the one that is included)"
    )
    parser.add_argument(
        "--provider", default=CPU, metavar="NAME", help=f"onnxruntime's name of what runs the network ({CPU})"
    )
    parser.add_argument("--threads", type=count, default=2, metavar="N", help="of the processor (2)")


def add_refinement(parser: argparse.ArgumentParser) -> None:
    """--no-refinement."""
    parser.add_argument(
        "--no-refinement",
        dest="refine",
        action="store_false",
        help="do not look for the white lines in the image: quicker, and less exact",
    )


@dataclass(frozen=True)
class NetworkOptions:
    """The segmentation network, its field, and what it runs on."""

    field: Field
    field_name: str
    """Name of the field on the command line."""
    model: Path | None
    """File of the network; None for the one that is included."""
    provider: str = CPU
    threads: int = 2

    @classmethod
    def of(cls, options: argparse.Namespace) -> NetworkOptions:
        """Take the options of `add_network` and --field."""
        return cls(field_of(options), options.field, options.model, options.provider, options.threads)

    @property
    def video_threads(self) -> int:
        """Threads to decode or encode a video: two are open at a time, of the input or of input and overlay."""
        return max(self.threads // 2, 1)


def network_in_process(options: NetworkOptions) -> SegmentationNetwork:
    """Load the network in one of several processes, with one thread; it is loaded once."""
    return _loaded(options.model, options.provider)


@lru_cache(maxsize=1)
def _loaded(model: Path | None, provider: str) -> SegmentationNetwork:
    return SegmentationNetwork.load(model, provider=provider, threads=1)


def load_network(options: NetworkOptions) -> SegmentationNetwork:
    """Load the network, and OpenCV, which reads the images: both with that many threads.

    Raises
    ------
    ValueError
        If the network is for another field than --field.
    """
    with interrupts_end_the_process():
        import cv2

        cv2.setNumThreads(options.threads)
        network = SegmentationNetwork.load(options.model, provider=options.provider, threads=options.threads)
    unknown = classes_without_segment(network.classes, options.field)
    if not unknown:
        return network
    if options.model is None:
        raise ValueError(
            f"the network that comes with fieldcalib knows soccer fields only: --field {options.field_name} needs one "
            f"that was trained for it, --model NETWORK.onnx; labelled pixels need none, see fieldcalib calibrate"
        )
    raise ValueError(
        f"--field {options.field_name} has no segment {unknown[0]!r}, which is a class of --model {options.model}: "
        f"give the field that it was trained for, or name the class {BACKGROUND!r} in "
        f"{options.model.with_suffix('.json')}"
    )
