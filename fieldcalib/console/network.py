"""The segmentation network of a command: --model, --provider, --threads."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from fieldcalib._interrupts import interrupts_end_the_process
from fieldcalib._messages import say
from fieldcalib.console.arguments import count
from fieldcalib.console.field_options import field_of
from fieldcalib.console.options import given, option
from fieldcalib.fields.field import Field
from fieldcalib.localize import Network, SegmentationNetwork
from fieldcalib.localize.network import CPU
from fieldcalib.localize.network_grid import BACKGROUND, classes_without_segment


@dataclass(frozen=True)
class NetworkOptions:
    """The segmentation network, its field, and what it runs on."""

    field: Field
    field_name: str
    """Name of the field on the command line."""
    model: Path | None = option(
        "network in ONNX, FILE.json beside it (the one that is included)", type=Path, metavar="FILE"
    )
    provider: str = option(f"onnxruntime's name of what runs the network ({CPU})", default=CPU, metavar="NAME")
    threads: int = option("of the processor (2)", default=2, type=count, metavar="N")

    @classmethod
    def of(cls, options: argparse.Namespace) -> NetworkOptions:
        """Take the options of the network, and --field."""
        return given(cls, options, field=field_of(options), field_name=options.field)

    @property
    def video_threads(self) -> int:
        """Threads to decode or encode a video: two are open at a time, of the input or of input and overlay."""
        return max(self.threads // 2, 1)


class OtherFieldError(ValueError):
    """The network of the package does not know the field, and no other one is given."""


def or_search(load: Callable[[], SegmentationNetwork]) -> SegmentationNetwork | None:
    """The network that is loaded; None where that of the package does not know the field: courts are searched for."""
    try:
        return load()
    except OtherFieldError:
        say("the network that comes with fieldcalib knows soccer fields only: courts are found by search")
        return None


def digest_of(network: Network | None) -> str:
    """Digest of a network of one's own and its JSON; empty for that of the package, which is of its version."""
    source = network.source if isinstance(network, SegmentationNetwork) else None
    return "" if source is None or source.model is None else source.digest


def load_network(options: NetworkOptions) -> SegmentationNetwork:
    """Load the network, and OpenCV, which reads the images: both with that many threads.

    Copies of the network in other processes have one thread.

    Raises
    ------
    OtherFieldError
        If the network that comes with the package is for another field than --field.
    ValueError
        If --model is.
    """
    with interrupts_end_the_process():
        import cv2

        cv2.setNumThreads(options.threads)
        network = SegmentationNetwork.load(options.model, provider=options.provider, threads=options.threads)
    unknown = classes_without_segment(network.classes, options.field)
    if not unknown:
        source = network.source and replace(network.source, threads=1)
        return replace(network, source=source)
    if options.model is None:
        raise OtherFieldError(
            f"the network that comes with fieldcalib knows soccer fields only: --field {options.field_name} needs one "
            f"that was trained for it, --model NETWORK.onnx; labelled pixels need none, see fieldcalib calibrate"
        )
    raise ValueError(
        f"--field {options.field_name} has no segment {unknown[0]!r}, which is a class of --model {options.model}: "
        f"give the field that it was trained for, or name the class {BACKGROUND!r} in "
        f"{options.model.with_suffix('.json')}"
    )
