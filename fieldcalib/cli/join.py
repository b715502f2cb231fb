"""`fieldcalib join`: merge the results of shards into what one run would have written."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

from fieldcalib._json import texts_from_json
from fieldcalib.cli.clips import Shards, run_clip
from fieldcalib.cli.commands import command_parser, with_values_joined
from fieldcalib.cli.localize import FORMATS, localized_summary, parse_localized, write_all
from fieldcalib.cli.run_options import RunRequest, split_request
from fieldcalib.console.arguments import add_format, add_run_options, folder_name, run_options
from fieldcalib.io.files import BrokenFileError, named_in_errors, parse_json_object, read_regular_file
from fieldcalib.io.output_folder import check_targets
from fieldcalib.io.results import FORMAT, LINES, SOLVER, joined_line, parse_main
from fieldcalib.run_folder.record import PARQUET, Outcome, RunOptions, RunRecord, Shard, is_squashed
from fieldcalib.run_folder.results import (
    LOCALIZED,
    PART_OF_CLIP,
    ResultsWriter,
    finish,
    is_unfinished,
    open_run_folder,
    read_summary,
    texts_in,
    write_table,
)

MOST_NAMED = 20  # shards in a message


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command and add its arguments, which `run` takes."""
    parser.description = (
        "Put the folders that runs with --shard 1/N to N/N wrote together into what one run would have written."
    )
    parser.add_argument("shards", nargs="+", type=Path, metavar="SHARD", help="the folders, in any order")
    parser.add_argument("--out", required=True, type=folder_name, metavar="DIR", help="where the results go")
    add_format(parser)
    add_run_options(parser, "resume", "overwrite")


def run(options: argparse.Namespace) -> int:
    """Join; returns the exit code."""
    record, shards = _in_order(options.shards)
    joined = run_options(options)
    lines = LOCALIZED if record.command == "localize" else LINES
    if lines == LOCALIZED and record.options.get("format") not in FORMATS:
        raise BrokenFileError(
            f"{shards[0]}: the run's format is {record.options.get('format')!r}, not one of {FORMATS}"
        )
    if lines == LOCALIZED and joined.writes_table:
        raise ValueError(f"--format {PARQUET} is of cameras: these shards are of localize")
    summaries = [read_summary(folder) for folder in shards]
    if any(path for folder in shards for path in folder.glob(f"{PART_OF_CLIP}*")):
        return _join_clip(joined, record, shards, summaries[0].get("options", {}))
    check_targets([joined.out / lines], [folder / lines for folder in shards], replaces=True)
    with open_run_folder(joined, record, lines) as results:
        for folder, texts in islice(_lines(shards, lines, record.unit), results.done, None):
            results.add(_outcome(folder, texts, record))
        results.notes = tuple(dict.fromkeys(note for summary in summaries for note in summary.get("notes", ())))
        times = [summary.get("seconds", {}) for summary in summaries]
        results.calibrating = sum(time.get("calibration", 0.0) for time in times)
        results.calibrated = results.verdicts.total()
        seconds = sum(time.get("total", 0.0) for time in times)
        if lines == LOCALIZED:
            write_all(joined.out, record.options["format"])
        made = localized_summary if lines == LOCALIZED else ResultsWriter.summary
        finish(joined.out, made(results, summaries[0].get("options", {}), seconds))
    if lines == LINES:
        results.say(record.options)
        write_table(joined)
    return results.exit_code


def _join_clip(joined: RunOptions, record: RunRecord, shards: Sequence[Path], options: Mapping[str, Any]) -> int:
    """Go on with the run of a clip whose parts are in `shards`, by the command line that these were given."""
    given = texts_from_json(options.get("arguments", []))
    chosen = command_parser(given).parse_args(with_values_joined(given))
    chosen.out, chosen.shard, chosen.format = joined.out, None, joined.format
    chosen.resume, chosen.overwrite = joined.resume, joined.overwrite
    requests = split_request(RunRequest.of(chosen))
    name = shards[0].name  # of several videos each has a folder of its name
    request = requests[0] if len(requests) == 1 else next(one for one in requests if one.run.out.name == name)
    return run_clip(replace(request, run=replace(request.run, out=joined.out)), Shards(record, shards))


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
    missing = [f"{k}/{of}" for k in islice((k for k in range(1, of + 1) if k not in found), MOST_NAMED)]
    if missing:
        raise ValueError(f"expected all shards of the run, missing: {', '.join(missing)}")
    assert first is not None
    return replace(first, shard=None), [found[number] for number in sorted(found)]


def _lines(shards: Sequence[Path], log: str, unit: int) -> Iterator[tuple[Path, tuple[bytes, ...]]]:
    """Lines of all shards in the order of the frames, each with its folder."""
    readers = [(folder, texts_in(folder, log)) for folder in shards]
    while readers:
        for folder, reader in list(readers):
            lines = list(islice(reader, unit))
            yield from ((folder, texts) for texts in lines)
            if len(lines) < unit:
                readers.remove((folder, reader))


def _outcome(folder: Path, texts: tuple[bytes, ...], record: RunRecord) -> Outcome:
    with named_in_errors(folder):
        if len(texts) > 1:
            main, solver = parse_main(texts[0]), parse_json_object(texts[1], "the solution of a frame")
            line = joined_line(main, solver)
            if line["id"] != main["id"]:
                raise BrokenFileError(f"{SOLVER} has frame {line['id']!r} where {LINES} has {main['id']!r}")
        else:
            line = parse_localized(texts[0])
        names = [name for name in record.files_of(line["id"]) if (folder / name).exists()]
        return Outcome(line, is_squashed(line), {name: read_regular_file(folder / name) for name in names})
