"""Results of a folder of frames, read back."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fieldcalib._extras import imported
from fieldcalib.assess.result import Calibration
from fieldcalib.io.files import BrokenFileError, open_regular_file, parse_json_object
from fieldcalib.io.parquet import read_parquet

if TYPE_CHECKING:
    import pandas

LINES, TABLE = "cameras.jsonl", "cameras.parquet"
BROKEN = "broken file"  # status of a frame whose file could not be read
# keys without a column
FOR_READING_BACK = frozenset({"version", "field", "solved", "errors"})


@dataclass(frozen=True, eq=False, repr=False)
class Results(Mapping[str, Calibration]):
    """Calibrations by the ids of their frames, in the order of the run.

    Frames whose files could not be read have none: they are in `broken`.
    """

    calibrations: Mapping[str, Calibration]
    lines: Sequence[Mapping[str, Any]]
    """Lines of ``cameras.jsonl`` for all frames, see ``docs/files.md``."""

    def __getitem__(self, id: str) -> Calibration:
        return self.calibrations[id]

    def __iter__(self) -> Iterator[str]:
        return iter(self.calibrations)

    def __len__(self) -> int:
        return len(self.calibrations)

    def __repr__(self) -> str:
        return f"Results({len(self)} calibrations, {len(self.broken)} broken files)"

    @cached_property
    def broken(self) -> Mapping[str, str]:
        """Problems of files that could not be read, by id."""
        return {line["id"]: line["message"] for line in self.lines if line["status"] == BROKEN}

    def to_pandas(self) -> pandas.DataFrame:
        """A table with a row for each frame, broken ones included, indexed by id.

        Columns are the keys of ``cameras.jsonl`` without those that only serve to read it back; nested keys are joined
        as "angles_degrees.pan", and matrices and lists are one cell. All are plain values, which pandas writes to any
        format; the `Calibration` of a row is ``results[id]``.

        Raises
        ------
        ImportError
            If pandas is not installed.
        """
        pandas = imported("pandas", "pandas", "to_pandas")
        rows = [{key: value for key, value in line.items() if key not in FOR_READING_BACK} for line in self.lines]
        table = pandas.json_normalize(rows) if rows else pandas.DataFrame(columns=["id"])
        return table.set_index("id")


def lines_file(folder: Path) -> Path:
    """The file in the folder of a run that has the lines of its frames; ``cameras.jsonl`` if there is none."""
    is_table = (folder / TABLE).is_file() and not (folder / LINES).is_file()
    return folder / (TABLE if is_table else LINES)


def result_lines(path: Path) -> Iterator[bytes]:
    """Lines of a ``cameras.jsonl``, without an incomplete last line, or of a table of them.

    Lines are read one by one: all lines of a match may not fit into memory.

    Raises
    ------
    BrokenFileError
        If it cannot be read.
    ImportError
        If it is a table and pyarrow is not installed.
    """
    if is_table(path):
        yield from read_parquet(path)
        return
    with open_regular_file(path) as file:
        for line in file:
            if line.endswith(b"\n") or _is_json(line):
                yield line


def is_table(path: Path) -> bool:
    """Whether the lines of a run are in a table."""
    return path.suffix == Path(TABLE).suffix


def _is_json(text: bytes) -> bool:
    try:
        json.loads(text)
    except ValueError:
        return False
    return True


def read_results(folder: str | os.PathLike[str]) -> Results:
    """The results that `fieldcalib calibrate` or `fieldcalib run` wrote to a folder.

    Parameters
    ----------
    folder : path
        With a ``cameras.jsonl`` or ``cameras.parquet``; or the path of that file.

    Returns
    -------
    Results
        A mapping of ids to `Calibration`; `Results.to_pandas` makes a table of it. An unfinished run
        has the frames that are done.

    Raises
    ------
    FileNotFoundError
        If there is neither.
    ImportError
        If it is a ``cameras.parquet`` and pyarrow is not installed.
    BrokenFileError
        If a line is no result, or of another version; the message begins with file and line.

    Examples
    --------
    >>> import json, tempfile
    >>> line = {"id": "00001", "status": "broken file", "message": "is no JSON"}
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = (Path(folder) / "cameras.jsonl").write_text(json.dumps(line))
    ...     results = read_results(folder)
    >>> len(results), results.broken
    (0, {'00001': 'is no JSON'})
    """
    path = Path(folder)
    if path.is_dir():
        path = lines_file(path)
    if not path.exists():
        raise FileNotFoundError(f"{path} does not exist: expected the folder that a run wrote, with its {LINES}")
    lines: list[dict[str, Any]] = []
    calibrations: dict[str, Calibration] = {}
    for number, text in enumerate(result_lines(path), 1):
        try:
            line = parse_json_object(text, "a frame's result")
            for key in ("id", "status", "message"):
                if not isinstance(line.get(key), str):
                    raise BrokenFileError(f"a result needs the key {key!r} with a text")
            if line["status"] != BROKEN:
                calibrations[line["id"]] = Calibration.from_dict(line)
        except ValueError as error:
            raise BrokenFileError(f"{path}, line {number}: {error}") from error
        lines.append(line)
    return Results(calibrations, lines)
