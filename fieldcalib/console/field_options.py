"""Options for the field and the prior: --field, --field-length, --field-width, --crown, --field-size, --prior.

The segmentation network of a command: --model, --provider, --threads.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from fieldcalib._interrupts import interrupts_end_the_process
from fieldcalib._progress import say
from fieldcalib.console.arguments import NO_PRIOR, count, number, positive
from fieldcalib.console.options import did_you_mean, given, option
from fieldcalib.fields.catalogue import AUTO, FIELDS, field_named, likely_fields
from fieldcalib.fields.field import Field
from fieldcalib.fields.ground import Ground
from fieldcalib.io.field_files import is_field_file, read_field
from fieldcalib.io.files import BrokenFileError
from fieldcalib.localize import Network, SegmentationNetwork
from fieldcalib.localize.network import CPU
from fieldcalib.localize.network_grid import BACKGROUND, classes_without_segment
from fieldcalib.run_folder.record import ESTIMATED
from fieldcalib.solve.solver_options import ALL, Prior

SOCCER = "soccer"
KNOWN = "known"
NOMINAL = "nominal"
FIELD_SIZES = (ESTIMATED, NOMINAL, KNOWN)


def add_field(parser: argparse.ArgumentParser, default: str = NOMINAL, *, auto: bool = False) -> None:
    """--field, --field-length, --field-width, --field-size and --same-field; `auto` may find the field in pictures."""
    add_sized_field(parser, auto=auto)
    parser.add_argument(
        "--field-size",
        choices=FIELD_SIZES,
        default=default,
        help="how well length and width are known; estimated: near the given ones, as far as frames tell them; "
        f"nominal: they stay as given, and probabilities allow for other ones; known: they were measured ({default})",
    )
    parser.add_argument(
        "--same-field", action="store_true", help="the frames show one pitch: its size is estimated from all together"
    )


def add_sized_field(parser: argparse.ArgumentParser, *, auto: bool = False) -> None:
    """--field, --field-length, --field-width and --crown."""
    add_named_field(parser, auto=auto)
    sizes = {"length": "touchline in metres, where fields differ (soccer: 105)", "width": "goal line in metres (68)"}
    for name, help in sizes.items():
        parser.add_argument(f"--field-{name}", type=positive, metavar="M", help=help)
    parser.add_argument(
        "--crown",
        type=_height,
        metavar="M",
        help="height of the middle of the field above its touchlines in metres, if it is known: 0 for level ground "
        "(by default frames of one tripod tell it, where they can)",
    )


def _height(text: str) -> float:
    """A height in metres, for argparse."""
    return number(text, lambda value: 0.0 <= value < np.inf, "a height in metres, 0 or more")


def add_named_field(parser: argparse.ArgumentParser, *, auto: bool = False) -> None:
    """--field."""
    parser.add_argument(
        "--field",
        type=_name_or_auto if auto else _name,
        default=SOCCER,
        metavar="NAME",
        help=f"{', '.join(FIELDS)}, or a .yaml or .json file with one of your own ({SOCCER})"
        + f"; {AUTO}: all are tried on some of the pictures" * auto,
    )


def _name_or_auto(text: str) -> str:
    return text if text == AUTO else _name(text)


def _name(text: str) -> str:
    if text not in FIELDS and not is_field_file(text):
        known = ", ".join(FIELDS)
        raise argparse.ArgumentTypeError(
            f"expected {known}, or a .yaml or .json file, got {text!r}{likely_fields(text)}"
        )
    return text


def field_of(options: argparse.Namespace) -> Field:
    """The field that the options of `add_field`, `add_sized_field` or `add_named_field` describe.

    Raises
    ------
    ValueError
        If its file is no field, or a size is given for a field that has one size.
    """
    field = named_field(options.field)
    length, width = (getattr(options, name, None) for name in ("field_length", "field_width"))
    if length is not None or width is not None:
        if not field.moves_with_size:
            raise ValueError(
                f"--field {options.field} has one size, {field.length:g} x {field.width:g} m: leave out --field-length "
                f"and --field-width"
            )
        field = field.resized(field.length if length is None else length, field.width if width is None else width)
    crown = getattr(options, "crown", None)
    if crown is not None:
        field = field.with_ground(Ground(crown))
    known = getattr(options, "field_size", None) == KNOWN
    return replace(field, size_known=True) if known else field


def prior_of(options: argparse.Namespace) -> Prior:
    """The prior that --prior names.

    Raises
    ------
    ValueError
        If the field has no such stand, or none at all.
    """
    if options.prior == NO_PRIOR:
        return None
    field, prior = field_of(options), str(options.prior)
    known = (ALL, *field.named_stands)
    if prior not in known:
        hint = did_you_mean(prior, (*known, NO_PRIOR))
        raise ValueError(f"--prior {prior}: expected {', '.join(known)} or {NO_PRIOR}{hint}")
    if prior == ALL and not field.stands:
        raise ValueError(
            f"--field {options.field} does not say where its cameras stand: add `stands` to it, or give --prior "
            f"{NO_PRIOR} to calibrate without (docs/how-to/other-sports.md has an example)"
        )
    return prior


@lru_cache(maxsize=1)
def named_field(name: str) -> Field:
    """The field that --field names, of the catalogue or of a file.

    Raises
    ------
    ValueError
        If its file is no field.
    """
    try:
        return field_named(name) if name in FIELDS else read_field(name)
    except BrokenFileError as error:  # of the command line, not of the input
        raise ValueError(str(error)) from None


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
