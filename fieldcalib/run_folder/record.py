"""The record of a run, run.json: its options and its input, written before the work, for a run that resumes it."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

import fieldcalib
from fieldcalib.io.files import BrokenFileError, FrameFile, parse_json_object, read_regular_file, write_text
from fieldcalib.io.results import FORMAT, OLD_FORMATS
from fieldcalib.run_folder.options import RunOptions

RECORD = "run.json"
NOT_COMPARED = frozenset({"input", "threads"})  # options: the input is recorded by its digests, threads change nothing


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
    """Digest of their sizes and times."""
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
    """Paths of the input, from which its frames can be read again; empty if it is no file."""

    @classmethod
    def of(
        cls, run: RunOptions, files: Sequence[FrameFile], *, unit: int, writes: Iterable[str], more: Any = None
    ) -> RunRecord:
        """Record a run on some files; `more` is what its results depend on beside the options, as JSON."""
        kept = {name: value for name, value in run.recorded.items() if name not in NOT_COMPARED}
        names = _digest([file.id for file in files])
        field = None if run.field_file is None else FrameFile(str(run.field_file), run.field_file).state
        contents = _digest([[*(file.state for file in files)], field, more])
        shard = None if run.shard is None else str(run.shard)
        source = [str(Path(one).absolute()) for one in run.recorded.get("input", ()) if Path(one).exists()]
        return cls(run.command, kept, len(files), names, contents, unit, shard, tuple(writes), source=source)

    @classmethod
    def read(cls, folder: Path) -> RunRecord | None:
        """Read the record in a folder, None if there is none.

        Raises
        ------
        BrokenFileError
            If the file is no record; the message begins with its path.
        """
        path = folder / RECORD
        if not path.exists():
            return None
        try:
            record = parse_json_object(read_regular_file(path), "a run")
            return cls(**{"format": OLD_FORMATS[0], **record, "writes": tuple(record["writes"])})
        except (BrokenFileError, KeyError, TypeError) as error:
            raise BrokenFileError(f"{path}: is no record of a run: {error}") from None

    def write(self, folder: Path) -> None:
        """Write it to a folder."""
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
        if not of_shards and self.shard != other.shard:
            return f"--shard was {self.shard}, is {other.shard}"
        if (self.frames, self.names) != (other.frames, other.names):
            return f"the input has other frames: there were {self.frames}, there are {other.frames}"
        if self.contents != other.contents:
            return "the files of the input have other sizes or times"
        return ""

    def _at(self, name: str) -> Any:
        return self.options.get(name)


def _digest(what: Any) -> str:
    return sha256(json.dumps(what).encode()).hexdigest()[:32]


def _option(name: str) -> str:
    return f"--{name.replace('_', '-')}"
