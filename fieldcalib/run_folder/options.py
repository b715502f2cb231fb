"""Options of a run: --out, --format, --jobs, --shard, --resume, --overwrite, --strict."""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from fieldcalib.console.arguments import JSON_LINES, PARQUET, count
from fieldcalib.console.options import given, option, switch
from fieldcalib.io.field_files import is_field_file

# Options that do not change the results of a frame, or that the record of a run has elsewhere.
NOT_RECORDED = frozenset(
    {"run", "command", "out", "strict", "most_bytes", "most_pixels", "jobs", "resume", "overwrite", "shard", "report"}
)


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
        """Parse "K/N", for argparse.

        Examples
        --------
        >>> Shard.parse("2/8")
        Shard(number=2, of=8)
        """
        number, _, of = text.partition("/")
        if not (number.isdecimal() and of.isdecimal() and 1 <= int(number) <= int(of)):
            raise argparse.ArgumentTypeError(f"expected K/N with K from 1 to N, as 1/8, got {text!r}")
        return cls(int(number), int(of))


@dataclass(frozen=True)
class RunOptions:
    """Options of everything that writes a folder of results."""

    out: Path
    recorded: Mapping[str, Any]
    """All options that change results, as JSON: for run.json and summary.json."""
    command: str = ""
    field_file: Path | None = None
    """The field's file, if it is the user's own."""
    format: str = JSON_LINES
    jobs: int = option(
        "processes, each with one thread; the results are the same (1)", default=1, type=count, metavar="N"
    )
    shard: Shard | None = option(
        "do only the K-th of N parts of the work, for several machines; fieldcalib join puts them together (all)",
        type=Shard.parse,
        metavar="K/N",
    )
    resume: bool = switch("go on with the run in DIR where it stopped; the files are the same then", exclusive="again")
    overwrite: bool = switch("remove the results of an earlier run in DIR first", exclusive="again")
    strict: bool = False
    """Whether all files are read before anything is written."""

    @classmethod
    def of(cls, options: argparse.Namespace) -> RunOptions:
        """Take them from a command line, which need not have all of them."""
        field = getattr(options, "field", "")  # a folder may have the name of a sport
        file = Path(field) if is_field_file(field) else None
        return given(cls, options, recorded=recorded(options), field_file=file)

    @property
    def writes_table(self) -> bool:
        """Whether cameras.parquet is written in the place of cameras.jsonl."""
        return self.format == PARQUET

    def changed(self, out: Path, **options: Any) -> RunOptions:
        """The run with another folder and other recorded options."""
        return replace(self, out=out, recorded={**self.recorded, **_as_json(options)})


def recorded(options: argparse.Namespace) -> dict[str, Any]:
    """Options that change results, as JSON."""
    return _as_json({name: value for name, value in vars(options).items() if name not in NOT_RECORDED})


def _as_json(options: Mapping[str, Any]) -> dict[str, Any]:
    return json.loads(json.dumps(options, default=str))  # type: ignore[no-any-return]
