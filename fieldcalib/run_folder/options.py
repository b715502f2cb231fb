"""Options of a run: where and how it writes, and which part of the work it does."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

ESTIMATED = "estimated"  # value of options: a size or shape is estimated from the images
JSON_LINES, PARQUET = "jsonl", "parquet"


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
        """Parse "K/N"; a ValueError if it is none.

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
    """Options of everything that writes a folder of results."""

    out: Path
    recorded: Mapping[str, Any]
    """All options that change results, as JSON: for run.json and summary.json."""
    command: str = ""
    field_file: Path | None = None
    """The field's file, if it is the user's own."""
    format: str = JSON_LINES
    jobs: int = 1
    """Processes, each with one thread; the results are the same."""
    shard: Shard | None = None
    """The part of the work that is done, for several machines."""
    resume: bool = False
    """Whether to go on with the run in the folder."""
    overwrite: bool = False
    """Whether to remove the results of an earlier run first."""
    strict: bool = False
    """Whether all files are read before anything is written."""

    @property
    def writes_table(self) -> bool:
        """Whether cameras.parquet is written in the place of cameras.jsonl."""
        return self.format == PARQUET

    def changed(self, out: Path, **options: Any) -> RunOptions:
        """The run with another folder and other recorded options."""
        return replace(self, out=out, recorded={**self.recorded, **as_json(options)})


def as_json(options: Mapping[str, Any]) -> dict[str, Any]:
    """Options as JSON; other values as their texts."""
    return json.loads(json.dumps(options, default=str))  # type: ignore[no-any-return]
