"""The lines of ``cameras.jsonl`` as a table in Parquet, which pandas, DuckDB and others query, many folders at once.

The columns are the keys of the lines, and of those of ``solver.jsonl``, that have the same meaning in every frame; and
``line`` and ``solver``: both texts as they were, from which everything is read back.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator, Mapping
from itertools import islice
from pathlib import Path
from types import ModuleType
from typing import Any

from fieldcalib._extras import imported
from fieldcalib._whole_files import replacement
from fieldcalib.io.files import BrokenFileError, escaped

ROW_GROUP = 1000  # lines of a row group: 10 MB in memory
TEXT, SOLVER_TEXT = "line", "solver"
TEXTS = ("id", "status", "message", "verdict", "reason", "remedy", "basis", "lens")
PROBABILITIES = ("probability_right_0.5m", "probability_right_1m")
NUMBERS = ("time_s", "rms_px", "rms_as_labelled_px", "loss_ndc", "loss_ndc_eq3", *PROBABILITIES)


def write_parquet(lines: Iterable[tuple[bytes, bytes]], path: Path) -> None:
    """Write lines of ``cameras.jsonl``, each with that of ``solver.jsonl``, as a table, whole or not at all.

    Raises
    ------
    ImportError
        If pyarrow is not installed.
    OSError
        If the file cannot be written.
    """
    pyarrow, parquet = imported_pyarrow()
    schema, texts = _schema(pyarrow), iter(lines)
    with replacement(path) as (handle, temporary):
        os.close(handle)
        with parquet.ParquetWriter(temporary, schema, compression="zstd") as writer:
            while rows := [_row(*pair) for pair in islice(texts, ROW_GROUP)]:
                writer.write_table(pyarrow.Table.from_pylist(rows, schema))


def read_parquet(path: Path) -> Iterator[tuple[bytes, bytes]]:
    """The lines that `write_parquet` was given, one pair after the other, without their ends.

    The second of a pair is empty where an older version wrote the table.

    Raises
    ------
    ImportError
        If pyarrow is not installed.
    BrokenFileError
        If the file is no such table.
    """
    pyarrow, parquet = imported_pyarrow()
    try:
        with parquet.ParquetFile(path) as file:
            if TEXT not in file.schema_arrow.names:
                raise BrokenFileError(f"{path}: has no column {TEXT!r}: is it a cameras.parquet?")
            columns = [name for name in (TEXT, SOLVER_TEXT) if name in file.schema_arrow.names]
            for batch in file.iter_batches(ROW_GROUP, columns=columns):
                for row in batch.to_pylist():
                    yield row[TEXT].encode(), row.get(SOLVER_TEXT, "").encode()
    except BrokenFileError:
        raise
    except (pyarrow.ArrowException, OSError, ValueError, AttributeError) as error:  # of damaged bytes, and no texts
        raise BrokenFileError(f"{path}: cannot be read as Parquet: {error}") from error


def imported_pyarrow() -> tuple[ModuleType, ModuleType]:
    """``pyarrow`` and ``pyarrow.parquet``.

    Raises
    ------
    ImportError
        If it is not installed, with how to install it.
    """
    pyarrow, parquet = (imported(name, "parquet", "Parquet") for name in ("pyarrow", "pyarrow.parquet"))
    return pyarrow, parquet


def _schema(pyarrow: ModuleType) -> Any:
    """Schema of the table, equal for every run, so that tables of many runs can be joined."""
    real, text = pyarrow.float64(), pyarrow.string()
    vector = pyarrow.list_(real, 3)
    angles = pyarrow.struct([(name, real) for name in ("pan", "tilt", "roll")])
    deviations = pyarrow.struct([("focal_length_px", real), ("C", vector), ("angles_degrees", angles)])
    field = pyarrow.struct([("length", real), ("width", real)])
    columns = dict.fromkeys(TEXTS, text) | dict.fromkeys(NUMBERS, real)
    columns |= {"image_size": pyarrow.list_(pyarrow.int64(), 2), "field": field}
    columns |= {"K": pyarrow.list_(vector, 3), "dist": pyarrow.list_(real), "R": pyarrow.list_(vector, 3), "C": vector}
    columns |= {"angles_degrees": angles, "standard_deviations": deviations}
    columns |= {"segment_errors_px": pyarrow.map_(text, real), "suspect_labels": pyarrow.list_(text)}
    columns |= {TEXT: text, SOLVER_TEXT: text}
    return pyarrow.schema(list(columns.items()))


def _row(text: bytes, solver: bytes) -> dict[str, Any]:
    """The columns of a frame; missing values are null."""
    line: Mapping[str, Any] = {**json.loads(text), **json.loads(solver)}
    row = dict(line) | {name: _number(line.get(name)) for name in NUMBERS}
    row |= {TEXT: text.decode().rstrip("\n"), SOLVER_TEXT: solver.decode().rstrip("\n")}
    row |= {name: escaped(line[name]) for name in TEXTS if name in line}
    errors = line.get("segment_errors_px") or {}
    row["segment_errors_px"] = [(label, _number(error)) for label, error in errors.items()]
    row["suspect_labels"] = [suspect["label"] for suspect in line.get("suspect_labels") or ()]
    return row


def _number(value: Any) -> float | None:
    """A number of JSON, where infinity is a text."""
    return None if value is None else float(value)
