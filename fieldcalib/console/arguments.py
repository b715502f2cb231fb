"""Argument types and arguments that several commands share.

INPUT of a command line: paths, lists of paths in text files, streams. Options for the field and the prior; the
segmentation network of a command: --model, --provider, --threads.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from fieldcalib._interrupts import interrupts_end_the_process
from fieldcalib._progress import say
from fieldcalib.console.options import add_options, did_you_mean, given, option, switch
from fieldcalib.fields.catalogue import AUTO, FIELDS, field_named, likely_fields
from fieldcalib.fields.field import Field
from fieldcalib.fields.ground import Ground
from fieldcalib.fields.sports.soccer import LINE_WIDTH, with_line_width
from fieldcalib.fields.traits import DISTRIBUTIONS
from fieldcalib.io.field_files import is_field_file, read_field
from fieldcalib.io.files import MOST_BYTES, BrokenFileError
from fieldcalib.io.formats import read_labels
from fieldcalib.io.frame_range import Cut, Position
from fieldcalib.io.frame_source import MOST_BYTES as MOST_BYTES_OF_IMAGE
from fieldcalib.io.image_files import MOST_PIXELS
from fieldcalib.io.parquet import imported_pyarrow
from fieldcalib.io.streams import Input, Stream
from fieldcalib.localize import Network, SegmentationNetwork
from fieldcalib.localize.network import CPU
from fieldcalib.localize.point_selection import BACKGROUND, classes_without_segment
from fieldcalib.run_folder.labelled_frames import AnnotationReader
from fieldcalib.run_folder.record import ESTIMATED, JSON_LINES, PARQUET, RunOptions, Shard, as_json
from fieldcalib.solve.solver_options import ALL, LENS_FLAGS, Prior

LIST = "@"  # prefix of the name of a text file that lists inputs

T = TypeVar("T")

NO_PRIOR = "none"
# Options that do not change the results of a frame, or that the record of a run has elsewhere.
NOT_RECORDED = frozenset(
    {"run", "command", "arguments", "out", "strict", "most_bytes", "most_pixels", "jobs", "resume", "overwrite"}
    | {"shard", "report"}
)
SOCCER = "soccer"
KNOWN = "known"
NOMINAL = "nominal"
FIELD_SIZES = (ESTIMATED, NOMINAL, KNOWN)


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


def add_cameras_and_out(parser: argparse.ArgumentParser, metavar: str, written: str) -> None:
    """--cameras, results that are read, and --out, what is `written` with them."""
    parser.add_argument("--cameras", required=True, type=Path, metavar="DIR", help="results of run or calibrate")
    parser.add_argument("--out", required=True, type=Path, metavar=metavar, help=written)


def add_input_and_output(parser: argparse.ArgumentParser) -> None:
    """INPUT, --size, --labels, --out, --format, --strict and --max-megabytes, to calibrate annotated frames."""
    add_inputs(parser, "folders, zips of them, single files")
    add_size(parser, "of the images, e.g. 960x540; SoccerNet's annotations do not say it (as the files say)")
    add_labels(parser)
    parser.add_argument("--out", required=True, type=folder_name, metavar="DIR", help="where the results go")
    add_format(parser)
    add_camera_files(parser)
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


def add_camera_files(parser: argparse.ArgumentParser) -> None:
    """Add the option that writes each camera as a file, too."""
    parser.add_argument(
        "--camera-files", action="store_true", help="write camera_<id>.json of each camera too, in SoccerNet's format"
    )


def _format(text: str) -> str:
    if text == PARQUET:
        imported_pyarrow()  # an ImportError before the work, not after it
    return text


@dataclass(frozen=True)
class _RunArguments:
    """How much of the work is done by whom, and what becomes of an earlier run in the folder."""

    jobs: int = option(
        "processes, each with one thread; the results are the same (1)", default=1, type=count, metavar="N"
    )
    shard: Shard | None = option(
        "do only the K-th of N parts of the work, for several machines; fieldcalib join puts them together (all)",
        type=told_by(Shard.parse),
        metavar="K/N",
    )
    resume: bool = switch("go on with the run in DIR where it stopped; the files are the same then", exclusive="again")
    overwrite: bool = switch("remove the results of an earlier run in DIR first", exclusive="again")


def add_run_options(parser: argparse.ArgumentParser, *names: str) -> None:
    """--jobs, --shard, --resume and --overwrite, or some of them."""
    add_options(parser, _RunArguments, *names)


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
    """--field, --field-length, --field-width, --line-width and --crown."""
    add_named_field(parser, auto=auto)
    sizes = {"length": "touchline in metres, where fields differ (soccer: 105)", "width": "goal line in metres (68)"}
    for name, help in sizes.items():
        parser.add_argument(f"--field-{name}", type=positive, metavar="M", help=help)
    parser.add_argument(
        "--line-width",
        type=_metres,
        metavar="M",
        help="width of a soccer field's lines in metres: their middles are the markings, their outer edges are where "
        f"the law measures (clips: {LINE_WIDTH}; else 0, as benchmarks take it)",
    )
    parser.add_argument(
        "--crown",
        type=_metres,
        metavar="M",
        help="height of the middle of the field above its touchlines in metres, if it is known: 0 for level ground "
        "(by default clips and pictures tell it, where they can)",
    )


def _metres(text: str) -> float:
    """A length of 0 or more, for argparse."""
    return number(text, lambda value: 0.0 <= value < np.inf, "metres, 0 or more")


def add_named_field(parser: argparse.ArgumentParser, *, auto: bool = False) -> None:
    """--field."""
    parser.add_argument(
        "--field",
        type=_name_or_auto if auto else _name,
        default=SOCCER,
        metavar="NAME",
        help=f"{', '.join(FIELDS)}, or a .yaml or .json file with one of your own ({SOCCER})"
        + f"; {AUTO}: the one that some of the pictures show" * auto,
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
    line_width = getattr(options, "line_width", None)
    if line_width is not None:
        field = with_line_width(field, line_width)
    crown = getattr(options, "crown", None)
    if crown is not None:
        field = field.with_ground(Ground(crown))
    return replace(field, size_known=True) if getattr(options, "field_size", None) == KNOWN else field


def prior_of(options: argparse.Namespace) -> Prior:
    """The prior that --prior names.

    Raises
    ------
    ValueError
        If the field has no such stand.
    """
    if options.prior == NO_PRIOR:
        return None
    field, prior = field_of(options), str(options.prior)
    known = (ALL, *field.named_stands)
    if prior not in known:
        hint = did_you_mean(prior, (*known, NO_PRIOR))
        raise ValueError(f"--prior {prior}: expected {', '.join(known)} or {NO_PRIOR}{hint}")
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
        say("the court is found by search, which needs no network")
        return None


def digest_of(network: Network | None) -> str:
    """Digest of a network of one's own and its JSON; empty for that of the package, which is of its version."""
    source = network.source if isinstance(network, SegmentationNetwork) else None
    return "" if source is None or source.model is None else source.digest


def load_network(options: NetworkOptions) -> SegmentationNetwork:
    """Load the network, and OpenCV, which reads the images: both with that many threads.

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
        return network
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
