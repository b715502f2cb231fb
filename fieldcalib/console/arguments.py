"""Argument types and arguments that several commands share.

INPUT of a command line: paths, lists of paths in text files, streams.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from fieldcalib.fields.field import Field
from fieldcalib.fields.stands import DISTRIBUTIONS
from fieldcalib.io.annotation_files import read_labels
from fieldcalib.io.field_files import is_field_file
from fieldcalib.io.files import MOST_BYTES
from fieldcalib.io.frame_range import Cut, Position
from fieldcalib.io.image_files import MOST_PIXELS
from fieldcalib.io.parquet import imported_pyarrow
from fieldcalib.io.streams import Input, Stream
from fieldcalib.run_folder.frame_source import MOST_BYTES as MOST_BYTES_OF_IMAGE
from fieldcalib.run_folder.labelled_frames import AnnotationReader
from fieldcalib.run_folder.record import JSON_LINES, PARQUET, RunOptions, Shard, as_json
from fieldcalib.solve.solver_options import ALL, LENS_FLAGS

LIST = "@"  # prefix of the name of a text file that lists inputs

T = TypeVar("T")

NO_PRIOR = "none"
# Options that do not change the results of a frame, or that the record of a run has elsewhere.
NOT_RECORDED = frozenset(
    {"run", "command", "out", "strict", "most_bytes", "most_pixels", "jobs", "resume", "overwrite", "shard", "report"}
)


def add_inputs(parser: argparse.ArgumentParser, help: str, *, streams: bool = False) -> None:
    """INPUT..., with lists."""
    action = _WithStreams if streams else _Inputs
    more = f"; {LIST}FILE: the paths in a text file, one a line, relative to its folder"
    parser.add_argument("input", nargs="+", action=action, metavar="INPUT", help=help + more)


class _Inputs(argparse.Action):
    """Turns texts into paths and streams, and reads lists of them."""

    streams = False

    def __call__(
        self, parser: argparse.ArgumentParser, namespace: argparse.Namespace, values: Any, option: str | None = None
    ) -> None:
        try:
            setattr(namespace, self.dest, list(_listed(values, self.streams)))
        except (OSError, ValueError) as error:
            parser.error(str(error))


class _WithStreams(_Inputs):
    streams = True


def _listed(texts: Sequence[str], streams: bool) -> Iterator[Input]:
    for text in texts:
        if not text:  # as of an unset shell variable
            raise ValueError("expected a path, got nothing; . is this folder")
        if not text.startswith(LIST):
            yield _input(text, Path(), streams)
            continue
        path = Path(text.removeprefix(LIST))
        if not path.exists():
            raise ValueError(f"{path} does not exist: expected a text file with a path on each line")
        lines = path.read_text("utf-8-sig", errors="surrogateescape").splitlines()
        paths = [line.strip() for line in lines if line.strip()]
        if not paths:
            raise ValueError(f"{path} lists nothing: expected a path on each line")
        for line in paths:
            yield _input(line, path.parent, streams)


def _input(text: str, folder: Path, streams: bool) -> Input:
    return Stream(text) if streams and Stream.recognises(text) else folder / text


class Default(str):
    """The default value of an option, of a type of its own: the same text given by the user is a `str`."""


USUAL_LENS = Default("k1")


def number(text: str, is_allowed: Callable[[float], bool], what: str) -> float:
    """A number that is allowed, for argparse; `what` describes it in the message of the error."""
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not is_allowed(value):
        raise argparse.ArgumentTypeError(f"expected {what}, got {text!r}")
    return value


def positive(text: str) -> float:
    """A positive number, for argparse."""
    return number(text, lambda value: 0.0 < value < np.inf, "a positive number")


def folder_name(text: str) -> Path:
    """The path of a folder for results, for argparse; an empty text, as of an unset shell variable, is refused."""
    if not text:
        raise argparse.ArgumentTypeError("expected the name of a folder, got nothing; . is this one")
    return Path(text)


def millions(text: str) -> float:
    """A positive number of millions, for argparse."""
    return positive(text) * 1e6


def count(text: str) -> int:
    """A whole number from 1, for argparse."""
    if not (text.isdecimal() and int(text) >= 1):
        raise argparse.ArgumentTypeError(f"expected a whole number from 1, got {text!r}")
    return int(text)


def probability(text: str) -> float:
    """A number from 0 to 1, for argparse."""
    return number(text, lambda value: 0.0 <= value <= 1.0, "a number from 0 to 1")


def image_size(text: str) -> tuple[int, int]:
    """(width, height) of "WIDTHxHEIGHT", for argparse."""
    try:
        width, height = (int(v) for v in text.lower().split("x"))
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected WIDTHxHEIGHT, as 960x540, got {text!r}") from None
    if min(width, height) < 1:
        raise argparse.ArgumentTypeError(f"expected positive numbers, got {text!r}")
    return width, height


def told_by(parse: Callable[[str], T]) -> Callable[[str], T]:
    """Make a type for argparse whose error messages are those of `parse`."""

    def parsed(text: str) -> T:
        try:
            return parse(text)
        except (ValueError, ImportError) as error:
            raise argparse.ArgumentTypeError(str(error)) from None

    return parsed


def add_input_and_output(parser: argparse.ArgumentParser) -> None:
    """INPUT, --size, --labels, --out, --format, --strict and --max-megabytes, to calibrate annotated frames."""
    add_inputs(parser, "folders, zips of them, single files")
    add_size(parser, "of the images, e.g. 960x540; SoccerNet's annotations do not say it (as the files say)")
    add_labels(parser)
    parser.add_argument("--out", required=True, type=folder_name, metavar="DIR", help="where the results go")
    add_format(parser)
    parser.add_argument("--strict", action="store_true", help="read all files first, and do nothing if one is broken")
    add_most_bytes(parser)


def add_size(parser: argparse.ArgumentParser, help: str, *, required: bool = False) -> None:
    """--size, the size of images."""
    parser.add_argument("--size", required=required, type=image_size, metavar="WxH", help=help)


def add_labels(parser: argparse.ArgumentParser) -> None:
    """--labels."""
    parser.add_argument(
        "--labels",
        type=told_by(read_labels),
        metavar="FILE",
        help="JSON or YAML that maps labels of the annotations to those of the field, or to null (they are the same)",
    )


def add_format(parser: argparse.ArgumentParser) -> None:
    """--format."""
    parser.add_argument(
        "--format",
        type=told_by(_format),
        choices=(JSON_LINES, PARQUET),
        default=JSON_LINES,
        help=f"of the lines of all frames: cameras.jsonl, or at the end a table, cameras.parquet ({JSON_LINES})",
    )


def _format(text: str) -> str:
    if text == PARQUET:
        imported_pyarrow()  # an ImportError before the work, not after it
    return text


RUN_OPTIONS: Mapping[str, Mapping[str, Any]] = {
    "jobs": {
        "type": count,
        "default": 1,
        "metavar": "N",
        "help": "processes, each with one thread; the results are the same (1)",
    },
    "shard": {
        "type": told_by(Shard.parse),
        "metavar": "K/N",
        "help": "do only the K-th of N parts of the work, for several machines; fieldcalib join puts them together "
        "(all)",
    },
    "resume": {
        "action": "store_true",
        "help": "go on with the run in DIR where it stopped; the files are the same then",
    },
    "overwrite": {"action": "store_true", "help": "remove the results of an earlier run in DIR first"},
}


def add_run_options(parser: argparse.ArgumentParser, *names: str) -> None:
    """--jobs, --shard, --resume and --overwrite, or some of them."""
    names = names or tuple(RUN_OPTIONS)
    again = parser.add_mutually_exclusive_group() if {"resume", "overwrite"} & set(names) else parser
    for name in names:
        group = again if name in ("resume", "overwrite") else parser
        group.add_argument(f"--{name}", **RUN_OPTIONS[name])


def run_options(options: argparse.Namespace) -> RunOptions:
    """The options of a run, of which a command line need not have all."""
    given = {one.name: getattr(options, one.name) for one in fields(RunOptions) if hasattr(options, one.name)}
    recorded = as_json({name: value for name, value in vars(options).items() if name not in NOT_RECORDED})
    field = getattr(options, "field", "")  # a folder may have the name of a sport
    file = Path(field) if is_field_file(field) else None
    return RunOptions(**given | {"recorded": recorded, "field_file": file})


def add_image_limits(parser: argparse.ArgumentParser) -> None:
    """--max-megabytes and --max-megapixels, of `ReadImage`."""
    add_most_bytes(parser, "image files", MOST_BYTES_OF_IMAGE)
    help, most = f"larger images are broken ({MOST_PIXELS / 1e6:g})", MOST_PIXELS
    parser.add_argument("--max-megapixels", dest="most_pixels", type=millions, default=most, metavar="N", help=help)


def annotation_reader(options: argparse.Namespace, field: Field) -> AnnotationReader:
    """What reads the annotations that the options of `add_input_and_output` describe."""
    return AnnotationReader(field, options.size, options.labels or {}, options.most_bytes)


def add_cut(parser: argparse.ArgumentParser) -> None:
    """--start, --end and --step."""
    where, position = "a time, [[H:]M:]S, or the number of a frame from 0, as 750f", told_by(Position.parse)
    parser.add_argument("--start", type=position, metavar="T", help=f"first frame: {where}")
    parser.add_argument("--end", type=position, metavar="T", help="the frame after the last one, as --start")
    parser.add_argument("--step", type=count, default=1, metavar="N", help="take every N-th frame (1)")


def cut_of(options: argparse.Namespace) -> Cut:
    """The cut that the options of `add_cut` describe."""
    return Cut(options.start or Position(frame=0), options.end, options.step)


def add_most_bytes(parser: argparse.ArgumentParser, files: str = "files", most: float = MOST_BYTES) -> None:
    """--max-megabytes, the limit for files that are read into memory as a whole."""
    help = f"larger {files} are broken, unpacked if they lie in a zip ({most / 1e6:g})"
    parser.add_argument("--max-megabytes", dest="most_bytes", type=millions, default=most, metavar="N", help=help)


def add_camera(parser: argparse.ArgumentParser, **more_priors: str) -> None:
    """--prior, with more choices and what each of them means, and --lens."""
    meanings = [", ".join([ALL, *DISTRIBUTIONS]), *(f"{name}: {meaning}" for name, meaning in more_priors.items())]
    parser.add_argument(
        "--prior",
        default=ALL,
        metavar="NAME",
        help=f"where the camera stands: {'; '.join(meanings)}; {NO_PRIOR}: solve without a prior ({ALL})",
    )
    parser.add_argument(
        "--lens",
        choices=LENS_FLAGS,
        default=USUAL_LENS,
        help="what is estimated of the lens: nothing, k1, k1 and k2, OpenCV's k1 k2 p1 p2 k3, cv2.fisheye's k1 k2 k3 "
        f"k4, or as much as the labels call for ({USUAL_LENS})",
    )
