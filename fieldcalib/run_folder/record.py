"""The record of a run, run.json: its options and its input, written before the work, so that the run can be resumed.

A record may have been edited, or come from others, so it is checked when it is read. The names of files in it decide
which files are removed when a run is replaced, and which are joined from shards. So only names that runs write are
accepted, which cannot lead to another folder.

`RunOptions` are the options of a run: where and how it writes, and which part of the work it does.

The record of a frame: its outcome, its line in cameras.jsonl and its files. Frames to look at (`ToLookAt`) are printed
at the end of a run: the first few whose verdict is not good, with their reasons, and where to find the others.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from dataclasses import field as attribute
from hashlib import sha256
from pathlib import Path
from types import MappingProxyType
from typing import Any, Protocol

import numpy as np

import fieldcalib
from fieldcalib._progress import counted
from fieldcalib._types import Array
from fieldcalib._whole_files import write_text
from fieldcalib.assess.advice import Remedy, Tool, advice_from_json, how
from fieldcalib.assess.findings import Finding, Status, Verdict, What, first_reason
from fieldcalib.assess.result import Calibration
from fieldcalib.fields.records import field_from_record
from fieldcalib.geometry.camera import ANGLE_NAMES, Camera
from fieldcalib.io.files import BrokenFileError, FrameFile, can_name_files, parse_json_object, read_regular_file
from fieldcalib.io.formats import ANNOTATIONS, CAMERAS, HOMOGRAPHIES, OTHER_ANNOTATIONS, OVERLAYS
from fieldcalib.io.image_files import Image
from fieldcalib.io.results import BROKEN, FORMAT, OLD_FORMATS, broken_line
from fieldcalib.problem.layout import ANGLES, CENTER, LOG_F
from fieldcalib.solve.from_homography import on_level_ground

ESTIMATED = "estimated"  # value of options: a size or shape is estimated from the images
JSON_LINES, PARQUET = "jsonl", "parquet"

RECORD = "run.json"
ID = "<id>"  # placeholder for the id of a frame in the names of files
CAMERA_FILE = CAMERAS.file_name(ID)
OF_PICTURES = ("run", "open")  # commands whose cameras are found in pictures
WITHHELD = (Status.REJECTED, Status.IMPROBABLE)  # statuses from thresholds of the user
ONE_FILE_NAME = "localized"  # name, without ending, of the one file that localize writes in some formats
WRITTEN = frozenset(  # allowed names of files in records
    [CAMERA_FILE, OVERLAYS.file_name(ID), ANNOTATIONS.file_name(ID), HOMOGRAPHIES.file_name(ID)]
    + [form.file_name(name) for form in OTHER_ANNOTATIONS.values() for name in (ID, ONE_FILE_NAME)]
)
MOST_IN_UNIT = 1_000_000  # frames
TEXT, WHOLE_NUMBER, TEXTS = "a text", "a whole number from 0", "a list of texts"
KINDS = {  # kinds of the values of a record, by name
    **dict.fromkeys(("command", "names", "contents", "version", "network"), TEXT),
    **dict.fromkeys(("frames", "unit", "format"), WHOLE_NUMBER),
    **dict.fromkeys(("writes", "source"), TEXTS),
}
OPTIONS = {  # kinds of the options that are read from records, by name
    **dict.fromkeys(("start", "end", "format", "field"), TEXT),
    "step": WHOLE_NUMBER,
}
# options that are not recorded: the input is recorded by its digests, threads do not change results
NOT_COMPARED = frozenset({"input", "threads", "arguments"})
SQUASHED = (What.NOT_SQUARE, What.WAS_SQUASHED)
METRES = (0.5, 1.0)  # tolerances of the probabilities in cameras.jsonl
SIZE_KEYS = ("field_length", "field_width", "field_standard_deviations")
NAMED = 5  # number of stretches of frames that are listed


@dataclass(frozen=True)
class Shard:
    """Every n-th unit of the work."""

    number: int
    """Counted from 1."""
    of: int

    def __str__(self) -> str:
        """Format as on the command line."""
        return f"{self.number}/{self.of}"

    @classmethod
    def parse(cls, text: str) -> Shard:
        """Parse "K/N"; a ValueError if it is invalid.

        Examples
        --------
        >>> Shard.parse("2/8")
        Shard(number=2, of=8)
        """
        number, _, of = text.partition("/")
        if not (number.isdecimal() and of.isdecimal() and 1 <= int(number) <= int(of)):
            raise ValueError(f"expected K/N with K from 1 to N, as 1/8, got {text!r}")
        return cls(int(number), int(of))


@dataclass(frozen=True)
class RunOptions:
    """Options of a command that writes a folder of results."""

    out: Path
    recorded: Mapping[str, Any]
    """All options that affect results, as JSON, for run.json and summary.json."""
    command: str = ""
    arguments: Sequence[str] = ()
    """The command line."""
    field_file: Path | None = None
    """The field's file, if it is the user's own."""
    format: str = JSON_LINES
    jobs: int = 1
    """Number of processes, each with one thread; results do not depend on it."""
    shard: Shard | None = None
    """The part of the work to do, if it is shared among several machines."""
    resume: bool = False
    """Whether to resume the run in the folder."""
    overwrite: bool = False
    """Whether to remove the results of an earlier run first."""
    strict: bool = False
    """Whether all files are read before anything is written."""
    camera_files: bool = False
    """Whether each camera gets a file, too."""

    @property
    def writes_table(self) -> bool:
        """Whether cameras.parquet is written instead of cameras.jsonl."""
        return self.format == PARQUET

    def changed(self, out: Path, **options: Any) -> RunOptions:
        """Change the folder and some recorded options."""
        return replace(self, out=out, recorded={**self.recorded, **as_json(options)})


def as_json(options: Mapping[str, Any]) -> dict[str, Any]:
    """Convert options to JSON; values that JSON does not have become texts."""
    return json.loads(json.dumps(options, default=str))  # type: ignore[no-any-return]


@dataclass(frozen=True)
class RunRecord:
    """The record of a run, as kept in its folder."""

    command: str
    options: Mapping[str, Any]
    """Options that change the results."""
    frames: int
    """Number of frames in the input; 0 if it is not known before reading."""
    names: str
    """Digest of the names of the input's files."""
    contents: str
    """Digest of the sizes and times of the input's files."""
    unit: int
    """Number of frames in a unit."""
    shard: str | None
    """The shard of the units, as K/N."""
    writes: tuple[str, ...]
    """Names of a frame's files, with <id> for its id."""
    version: str = fieldcalib.__version__
    format: int = FORMAT
    """Version of the files that are written."""
    source: Sequence[str] = ()
    """Paths of the input, from which its frames can be read again; empty if it is not in files."""
    network: str = ""
    """Digest of the user's own network; empty if it was that of the package, or none."""

    @property
    def is_of_stream(self) -> bool:
        """Whether its input cannot be read again, so that the run cannot be resumed."""
        return not (self.frames or self.source)

    @classmethod
    def of(
        cls,
        run: RunOptions,
        files: Sequence[FrameFile],
        *,
        unit: int,
        writes: Iterable[str] = (),
        more: Any = None,
        network: str = "",
    ) -> RunRecord:
        """Record a run on some files, which `writes` files of such names for each frame, beside that of its camera.

        `more` is JSON of anything else that its results depend on.
        """
        writes = (*[CAMERA_FILE] * run.camera_files, *writes)
        kept = {name: value for name, value in run.recorded.items() if name not in NOT_COMPARED}
        names = _digest([file.id for file in files])
        field = None if run.field_file is None else FrameFile(str(run.field_file), run.field_file).state
        contents = _digest([[*(file.state for file in files)], field, more])
        shard = None if run.shard is None else str(run.shard)
        source = [str(Path(one).absolute()) for one in run.recorded.get("input", ()) if Path(one).exists()]
        return cls(run.command, kept, len(files), names, contents, unit, shard, writes, source=source, network=network)

    @classmethod
    def read(cls, folder: Path) -> RunRecord | None:
        """Read the record in a folder, None if there is none.

        Raises
        ------
        BrokenFileError
            If the file is not a valid record; the message begins with its path.
        """
        path = folder / RECORD
        if not path.exists():
            return None
        try:
            record = parse_json_object(read_regular_file(path), "a run")
            _check(record)
            return cls(**{"format": OLD_FORMATS[0], **record, "writes": tuple(record["writes"])})
        except (BrokenFileError, KeyError, TypeError) as error:  # the latter two from missing or unknown keys
            raise BrokenFileError(f"{path}: is no record of a run: {error}") from None

    def files_of(self, id: str) -> list[str]:
        """Names of the files that a frame may have; [] if its id cannot be part of a file's name."""
        return [name.replace(ID, id) for name in self.writes] if can_name_files(id) else []

    def write(self, folder: Path) -> None:
        """Write the record to a folder."""
        write_text(folder / RECORD, json.dumps(asdict(self), indent=2) + "\n")

    def differences(self, other: RunRecord, *, of_shards: bool = False) -> str:
        """Describe how another run differs, empty if it does not; `of_shards` leaves out the shard."""
        if self.command != other.command:
            return f"it is of {self.command}, not of {other.command}"
        if self.version != other.version:
            return f"it is of version {self.version}, this is {other.version}"
        if self.format != other.format:
            return f"its files are of format {self.format}, this fieldcalib writes format {other.format}"
        names = [name for name in {**self.options, **other.options} if self._at(name) != other._at(name)]
        if names:
            options = {name: f"--{name.replace('_', '-')}" for name in names}
            return "; ".join(f"{options[name]} was {self._at(name)!r}, is {other._at(name)!r}" for name in names)
        if self.network != other.network:
            return "the network of --model has changed, its file or its JSON"
        if not of_shards and self.shard != other.shard:
            return f"--shard was {self.shard}, is {other.shard}"
        if self.frames != other.frames:
            return f"the input has other frames: there were {self.frames}, there are {other.frames}"
        if self.names != other.names:
            return f"the input has other frames: {self.frames} as before, but of other names"
        if self.contents != other.contents:
            return "the files of the input have other sizes or times"
        return ""

    @property
    def given(self) -> set[str]:
        """Names of the options that were given, without those that only have their default."""
        return {name for name, value in self.options.items() if value not in (None, False, ESTIMATED)}

    def keeps(self, line: Mapping[str, Any]) -> bool:
        """Whether a frame has a camera that counts, by its line of cameras.jsonl.

        A camera found in a picture counts if its verdict is not "reject", or with --keep-rejected; one of labels unless
        a threshold of the user withholds it.
        """
        if line.get("K") is None or self.command not in OF_PICTURES:
            return line.get("K") is not None and line["status"] not in WITHHELD
        return line["status"] == Status.ACCEPTED or bool(self._at("keep_rejected"))

    def camera_file(self, line: Mapping[str, Any]) -> dict[str, bytes]:
        """The file of a camera that counts, by its name, if the run writes such files."""
        is_written = CAMERA_FILE in self.writes and self.keeps(line)
        return {CAMERAS.file_name(line["id"]): camera_content(line)} if is_written else {}

    def _at(self, name: str) -> Any:
        return self.options.get(name)


def _check(record: Mapping[str, Any]) -> None:
    """Raise a BrokenFileError if a value of a record is invalid."""
    _check_kinds(record, KINDS)
    if not isinstance(record.get("options", {}), dict):
        raise BrokenFileError(f"'options': expected an object, got {record['options']!s:.100}")
    options = {name: value for name, value in record.get("options", {}).items() if value is not None}
    _check_kinds(options, OPTIONS)
    if not 1 <= record.get("unit", 1) <= MOST_IN_UNIT:
        raise BrokenFileError(f"'unit': expected a number of frames from 1 to {MOST_IN_UNIT}, got {record['unit']}")
    if record.get("shard") is not None:
        try:
            Shard.parse(str(record["shard"]))
        except ValueError as error:
            raise BrokenFileError(f"'shard': {error}") from None
    for name in record.get("writes", ()):
        if name not in WRITTEN:
            raise BrokenFileError(f"'writes': expected names of files that runs write, got {name!r:.100}")


def _check_kinds(values: Mapping[str, Any], kinds: Mapping[str, str]) -> None:
    for name in values.keys() & kinds.keys():
        if not _is(values[name], kinds[name]):
            raise BrokenFileError(f"{name!r}: expected {kinds[name]}, got {values[name]!s:.100}")


def _is(value: Any, kind: str) -> bool:
    if kind == TEXT:
        return isinstance(value, str)
    if kind == WHOLE_NUMBER:
        return isinstance(value, int) and not isinstance(value, bool) and value >= 0
    return isinstance(value, list) and all(isinstance(one, str) for one in value)


def _digest(what: Any) -> str:
    return sha256(json.dumps(what).encode()).hexdigest()[:32]


class Item(Protocol):
    """A frame to be worked on: a file, or a frame of a video."""

    @property
    def id(self) -> str:
        """Name of the frame."""

    @property
    def path(self) -> Path | str:
        """File of the frame, for messages."""


@dataclass(frozen=True)
class Outcome:
    """The results of a frame that are written."""

    line: Mapping[str, Any]
    """The frame's line of cameras.jsonl; it has the keys id and status."""
    squashed: bool = False
    """Whether there is a finding that the pixels are not square."""
    files: Mapping[str, bytes] = attribute(default_factory=dict)
    """Contents of the files of the frame, by name."""
    complaint: str = ""
    """A line for stderr: which file is broken, and why."""
    picture: Image | None = None
    """Picture for the overlay video."""
    is_written: bool = False
    """Whether an earlier part of the run has written it."""

    @property
    def id(self) -> str:
        """Name of the frame."""
        return str(self.line["id"])

    @classmethod
    def broken(cls, item: Item, problem: str) -> Outcome:
        """Make the outcome of a frame that cannot be read."""
        return cls(broken_line(item.id, problem), complaint=f"{item.path}: {problem}")

    @classmethod
    def of(
        cls,
        id: str,
        calibration: Calibration,
        *,
        eq3: float | None = None,
        details: Mapping[str, Any] = MappingProxyType({}),
        files: Mapping[str, bytes] = MappingProxyType({}),
        picture: Image | None = None,
    ) -> Outcome:
        """Make the outcome of a calibration; `eq3` is TVCalib's loss, `details` are more keys of the line."""
        squashed = calibration.has_finding(*SQUASHED)
        return cls(calibration_line(id, calibration, eq3) | dict(details), squashed, files, picture=picture)


def kind_of(line: Mapping[str, Any]) -> tuple[str, str]:
    """Most serious finding in a frame's line, and the marking it is about; without findings the status and ""."""
    first: Mapping[str, str] = next(iter(line.get("findings", ())), {})
    return first.get("what", line["status"]), first.get("about", "")


def camera_content(line: Mapping[str, Any]) -> bytes:
    """Content of the file of a camera, from the line of its frame; on raised ground, that of `on_level_ground`."""
    camera, field = Camera.from_dict(line), line.get("field") or {}
    if {"builder", "ground"} <= field.keys():  # fields of other builders are whole in solver.jsonl alone
        camera = on_level_ground(camera, field_from_record(field))
    return (CAMERAS.write(camera) + "\n").encode()


def is_squashed(line: Mapping[str, Any]) -> bool:
    """Whether a frame's line of cameras.jsonl says that the pixels of the picture are not square."""
    return has_finding(line, *SQUASHED)


def has_finding(line: Mapping[str, Any], *what: What) -> bool:
    """Whether a frame's line of cameras.jsonl has any of some findings; lines of earlier versions have none."""
    return any(one.get("what") in what for one in line.get("findings", ()))


def calibration_line(id: str, calibration: Calibration, eq3: float | None) -> dict[str, Any]:
    """Make the line of a frame in cameras.jsonl."""
    line: dict[str, Any] = {"id": id, "status": str(calibration.status), "message": calibration.message}
    line |= {"verdict": str(calibration.verdict), "reason": calibration.reason, "remedy": calibration.remedy}
    line["findings"] = [one.to_dict() for one in calibration.findings]
    line["advice"] = [str(one) for one in calibration.advice]
    line |= calibration.to_dict()
    if calibration.camera is not None:
        line |= {"rms_as_labelled_px": _number(calibration.rms_as_labelled), "loss_ndc_eq3": eq3}
    if calibration.camera is not None and calibration.knows_errors:
        line["standard_deviations"] = _standard_deviations(calibration.camera, calibration.covariance)
    line |= _estimated_field(calibration)
    if calibration.has_probability:
        line |= {f"probability_right_{metres:g}m": _number(calibration.probability(metres)) for metres in METRES}
    return line


def _estimated_field(calibration: Calibration) -> dict[str, Any]:
    """Size and crown of the field, each with standard deviations, if they were estimated from the frame; else empty."""
    field, line = calibration.field, dict[str, Any]()
    if field is None or calibration.solved is None:
        return line
    layout, deviations = calibration.uncertainty.layout, np.sqrt(np.diagonal(calibration.covariance))
    shift = np.zeros(3) if layout.field_size is None else layout.field_size.shift
    if np.any(shift[:2]):
        size = field.length, field.width, deviations[layout.field_size_block].tolist()
        line |= dict(zip(SIZE_KEYS, size, strict=True))
    if shift[2]:
        (deviation,) = deviations[layout.crown_block].tolist()
        line["field_crown_m"] = {"value": field.terrain.crown, "standard_deviation": deviation}
    return line


def _standard_deviations(camera: Camera, covariance: Array) -> dict[str, Any]:
    sigma = np.sqrt(np.diagonal(covariance))
    degrees = map(_number, np.degrees(sigma[ANGLES]))
    return {
        "focal_length_px": _number(camera.focal_length * sigma[LOG_F]),
        "C": [_number(metres) for metres in sigma[CENTER]],
        "angles_degrees": dict(zip(ANGLE_NAMES, degrees, strict=True)),
    }


def _number(value: float) -> float | None:
    """Convert a number for JSON, which has neither infinity nor NaN: these become None."""
    return float(value) if np.isfinite(value) else None


@dataclass(frozen=True)
class Stretch:
    """Consecutive frames whose reasons differ at most in their numbers."""

    first: str
    """Id of the first frame."""
    verdict: str
    reason: Finding
    """Reason of all frames, with the span of its numbers, or that of the first one in words."""
    kind: tuple[str, str]
    """Kind of the reason (`kind_of`); successive frames of one kind make a stretch."""
    differ: bool = False
    """Whether the reason is in the words of the first frame, while other frames have other words."""
    count: int = 1
    last: str = ""
    """Id of the last frame of several."""

    def __str__(self) -> str:
        """Format for stderr."""
        which = f"{self.first} to {self.last}, {self.count} frames" if self.last else self.first
        return f"{which}: {self.verdict}, {'for example ' * self.differ}{self.reason}"


@dataclass
class ToLookAt:
    """Collects the frames of a run whose verdict is not good.

    Examples
    --------
    >>> seen = ToLookAt()
    >>> seen.add({"id": "000000", "status": "accepted", "verdict": "good"})
    >>> for id, px in ("000001", 9.0), ("000002", 7.0):
    ...     found = [Finding(What.OFF_PAINT, "Middle line", (px,)).to_dict()]
    ...     seen.add({"id": id, "status": "accepted", "verdict": "check", "findings": found})
    >>> print(seen.message("out/cameras.jsonl"))
    2 frames to look at (all reasons and remedies: out/cameras.jsonl):
      000001 to 000002, 2 frames: check, 'Middle line' lies 7 to 9 px beside its paint
    >>> reject = {"status": "degenerate", "verdict": "reject", "reason": "too few lines"}
    >>> seen.add({"id": "000003", **reject, "remedy": "more markings", "advice": ["by hand"]})
    >>> print(seen.message("out/cameras.jsonl").splitlines()[-1])
      what would help: more markings; on the command line: fieldcalib open
    """

    stretches: list[Stretch] = attribute(default_factory=list)
    """First stretches of frames that are not good."""
    count: int = 0
    """Number of all frames that are not good."""
    named: int = 0
    """Number of frames in `stretches`."""
    remedies: dict[Remedy, list[tuple[str, str]]] = attribute(default_factory=dict)
    """Remedies of the frames in `stretches`, in order, each with the first and the last of successive frames."""
    _is_next: bool = False
    _last: str = ""

    def add(self, line: Mapping[str, Any]) -> None:
        """Add the next frame by its line of cameras.jsonl; one that could not be read is skipped."""
        id, verdict, kind = line["id"], line.get("verdict"), kind_of(line)
        if line["status"] == BROKEN or not verdict or verdict == Verdict.GOOD:
            self._is_next = False
            return
        self.count += 1
        reason = first_reason(line)
        last = self.stretches[-1] if self._is_next else None
        if last is not None and (last.verdict, last.kind) == (verdict, kind):
            both = last.reason.joined(reason)
            differ = last.differ or (both.what is What.SAID and both != reason)
            self.stretches[-1] = replace(last, reason=both, differ=differ, count=last.count + 1, last=id)
        elif len(self.stretches) < NAMED:
            self.stretches.append(Stretch(id, verdict, reason, kind))
        else:
            self._is_next = False
            return
        self._is_next = True
        self.named += 1
        if line.get("remedy"):
            remedy = Remedy(line["remedy"], advice_from_json(line.get("advice")))
            helped = self.remedies.setdefault(remedy, [])
            goes_on = helped and last is not None and helped[-1][1] == self._last
            first = helped.pop()[0] if goes_on else id
            helped.append((first, id))
        self._last = id

    def message(self, *where: str, given: Iterable[str] = ()) -> str:
        """Format the list of frames, and where to find all of them; empty if all are good; options that were given."""
        if not self.count:
            return ""
        head = f"{counted(self.count, 'frame')} to look at (all reasons and remedies: {', '.join(where)}):"
        rest = [f"and {self.count - self.named} more"] if self.count > self.named else []
        help = []
        for remedy, helped in self.remedies.items():
            each = [first if first == last else f"{first} to {last}" for first, last in helped]
            whom = f" {', '.join(each)}" if len(self.remedies) > 1 else ""
            said = how(remedy.advice, Tool.COMMAND, given)
            help.append(f"what would help{whom}: {remedy.text}{f'; on the command line: {said}' if said else ''}")
        return "\n  ".join([head, *map(str, self.stretches), *rest, *help])
