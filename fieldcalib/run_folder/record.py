"""The record of a run, run.json: its options and its input, written before the work, so that the run can be resumed.

A record may have been edited, or come from others, so it is checked when it is read. The names of files in it decide
which files are removed when a run is replaced, and which are joined from shards. So only names that runs write are
accepted, which cannot lead to another folder.

`RunOptions` are the options of a run: where and how it writes, and which part of the work it does.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import Any

import fieldcalib
from fieldcalib.io.files import (
    BrokenFileError,
    FrameFile,
    can_name_files,
    parse_json_object,
    read_regular_file,
    write_text,
)
from fieldcalib.io.formats import ANNOTATIONS, CAMERAS, HOMOGRAPHIES, OTHER_ANNOTATIONS, OVERLAYS
from fieldcalib.io.results import FORMAT, OLD_FORMATS

ESTIMATED = "estimated"  # value of options: a size or shape is estimated from the images
JSON_LINES, PARQUET = "jsonl", "parquet"

RECORD = "run.json"
ID = "<id>"  # placeholder for the id of a frame in the names of files
ONE_FILE_NAME = "localized"  # name, without ending, of the one file that localize writes in some formats
WRITTEN = frozenset(  # allowed names of files in records
    [CAMERAS.file_name(ID), OVERLAYS.file_name(ID), ANNOTATIONS.file_name(ID), HOMOGRAPHIES.file_name(ID)]
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
NOT_COMPARED = frozenset({"input", "threads"})


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

    @classmethod
    def of(
        cls,
        run: RunOptions,
        files: Sequence[FrameFile],
        *,
        unit: int,
        writes: Iterable[str],
        more: Any = None,
        network: str = "",
    ) -> RunRecord:
        """Record a run on some files; `more` is JSON of anything else that its results depend on."""
        kept = {name: value for name, value in run.recorded.items() if name not in NOT_COMPARED}
        names = _digest([file.id for file in files])
        field = None if run.field_file is None else FrameFile(str(run.field_file), run.field_file).state
        contents = _digest([[*(file.state for file in files)], field, more])
        shard = None if run.shard is None else str(run.shard)
        source = [str(Path(one).absolute()) for one in run.recorded.get("input", ()) if Path(one).exists()]
        return cls(
            run.command, kept, len(files), names, contents, unit, shard, tuple(writes), source=source, network=network
        )

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
            return "; ".join(f"{_option(name)} was {self._at(name)!r}, is {other._at(name)!r}" for name in names)
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


def _option(name: str) -> str:
    return f"--{name.replace('_', '-')}"
