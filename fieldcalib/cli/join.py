"""`fieldcalib join`: merge the results of shards into what one run would have written."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

from fieldcalib.cli.localize import localized_summary, write_all
from fieldcalib.console.arguments import PARQUET, add_format, folder_name
from fieldcalib.console.options import add_options
from fieldcalib.io.files import parse_json_object
from fieldcalib.io.line_log import whole_lines
from fieldcalib.io.results import FORMAT, LINES, joined_line, whole_line_pairs
from fieldcalib.run_folder.options import RunOptions, Shard
from fieldcalib.run_folder.outcome import Outcome, is_squashed
from fieldcalib.run_folder.record import RunRecord
from fieldcalib.run_folder.results import (
    LOCALIZED,
    SUMMARY,
    ResultsWriter,
    finish,
    is_unfinished,
    open_run_folder,
    write_table,
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command and add its arguments, which `run` takes."""
    parser.description = (
        "Put the folders that runs with --shard 1/N to N/N wrote together into what one run would have written."
    )
    parser.add_argument("shards", nargs="+", type=Path, metavar="SHARD", help="the folders, in any order")
    parser.add_argument("--out", required=True, type=folder_name, metavar="DIR", help="where the results go")
    add_format(parser)
    add_options(parser, RunOptions, "resume", "overwrite")


def run(options: argparse.Namespace) -> int:
    """Join; returns the exit code."""
    record, shards = _in_order(options.shards)
    joined = RunOptions.of(options)
    lines = LOCALIZED if record.command == "localize" else LINES
    if lines == LOCALIZED and joined.writes_table:
        raise ValueError(f"--format {PARQUET} is of cameras: these shards are of localize")
    summaries = [parse_json_object((folder / SUMMARY).read_bytes(), "a summary") for folder in shards]
    with open_run_folder(joined, record, lines) as results:
        for folder, texts in islice(_lines(shards, lines, record.unit), results.done, None):
            results.add(_outcome(folder, texts, record))
        results.calibrating = sum(summary["seconds"].get("calibration", 0.0) for summary in summaries)
        results.calibrated = results.verdicts.total()
        seconds = sum(summary["seconds"]["total"] for summary in summaries)
        if lines == LOCALIZED:
            write_all(joined.out, record.options["format"])
        made = localized_summary if lines == LOCALIZED else ResultsWriter.summary
        finish(joined.out, made(results, summaries[0]["options"], seconds))
    if lines == LINES:
        results.say(record.options)
        write_table(joined)
    return results.exit_code


def _in_order(folders: Sequence[Path]) -> tuple[RunRecord, list[Path]]:
    """The record of the run that was split into shards, and the folders of these in order.

    Raises
    ------
    ValueError
        If they are not all of the shards of one run, each once and finished.
    """
    found: dict[int, Path] = {}
    first: RunRecord | None = None
    of = 0
    for folder in folders:
        record = RunRecord.read(folder)
        if record is None or record.shard is None:
            raise ValueError(f"{folder} is no shard: expected the folder of a run with --shard K/N")
        if record.format != FORMAT:
            raise ValueError(
                f"{folder} is of format {record.format}, this fieldcalib joins format {FORMAT}: join it with the one "
                f"that wrote it, or run the shards again"
            )
        shard = Shard.parse(record.shard)
        first, of = first or record, of or shard.of
        other = first.differences(record, of_shards=True) or ("" if shard.of == of else f"it is one of {of}")
        if other:
            raise ValueError(f"{folder} and {folders[0]} are not of the same run: {other}")
        if shard.number in found:
            raise ValueError(f"{folder} and {found[shard.number]} are both shard {shard}")
        if is_unfinished(folder):
            raise ValueError(f"{folder}, shard {shard}, is not finished: --resume goes on with it")
        found[shard.number] = folder
    missing = [f"{number}/{of}" for number in range(1, of + 1) if number not in found]
    if missing:
        raise ValueError(f"expected all shards of the run, missing: {', '.join(missing)}")
    assert first is not None
    return replace(first, shard=None), [found[number] for number in sorted(found)]


def _lines(shards: Sequence[Path], log: str, unit: int) -> Iterator[tuple[Path, tuple[bytes, ...]]]:
    """Lines of all shards in the order of the frames, each with its folder."""
    readers = [(folder, _lines_of(folder, log)) for folder in shards]
    while readers:
        for folder, reader in list(readers):
            lines = list(islice(reader, unit))
            yield from ((folder, texts) for texts in lines)
            if len(lines) < unit:
                readers.remove((folder, reader))


def _lines_of(folder: Path, log: str) -> Iterator[tuple[bytes, ...]]:
    return whole_line_pairs(folder) if log == LINES else zip(whole_lines(folder / log), strict=True)


def _outcome(folder: Path, texts: tuple[bytes, ...], record: RunRecord) -> Outcome:
    main, *solver = (parse_json_object(text, "a frame's result") for text in texts)
    line: dict[str, Any] = joined_line(main, solver[0]) if solver else main
    names = [name.replace("<id>", line["id"]) for name in record.writes]
    files = {name: (folder / name).read_bytes() for name in names if (folder / name).exists()}
    return Outcome(line, is_squashed(line), files)
