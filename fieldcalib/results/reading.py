"""Results of a folder, read back."""

from __future__ import annotations

import os
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

from fieldcalib._checks import file_path
from fieldcalib.io.cuts import Cut, Position
from fieldcalib.io.files import BrokenFileError
from fieldcalib.io.results import ResultFile, lines_file
from fieldcalib.results.collection import Results
from fieldcalib.results.frames import StoredFrames
from fieldcalib.results.sources import Pictures
from fieldcalib.run_folder.clip_results import read_clip
from fieldcalib.run_folder.record import RECORD, RunRecord
from fieldcalib.run_folder.results import CLIP


def read(folder: str | os.PathLike[str]) -> Results:
    """The results that `fieldcalib run`, `fieldcalib calibrate` or `Results.save` wrote to a folder.

    Parameters
    ----------
    folder : path
        With a ``cameras.jsonl`` or ``cameras.parquet``; or the path of that file. Its frames are parsed when they are
        asked for: an hour of video opens in a second.

    Returns
    -------
    Results
        A mapping of ids to `Calibration`. An unfinished run has the frames that are done.

    Raises
    ------
    FileNotFoundError
        If there is neither.
    ImportError
        If it is a ``cameras.parquet`` and pyarrow is not installed.
    BrokenFileError
        If a line is no result, or of another version; the message begins with file and line. Lines that begin as they
        should are read, and errors in them raised, when they are asked for.

    Examples
    --------
    >>> import json, tempfile
    >>> line = {"id": "00001", "status": "broken file", "message": "is no JSON"}
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = (Path(folder) / "cameras.jsonl").write_text(json.dumps(line))
    ...     results = read(folder)
    ...     len(results), results.broken
    (0, {'00001': 'is no JSON'})
    """
    path = file_path(folder, "a folder of results")
    if path.is_dir():
        path = lines_file(path)
    frames = StoredFrames(ResultFile(path))
    home = path.parent
    record, clip = RunRecord.read(home), home / CLIP
    options: Mapping[str, Any] = {} if record is None else record.options
    return Results(
        frames,
        Pictures() if record is None else _pictures(record, home, is_clip=clip.is_file()),
        partial(read_clip, clip) if clip.is_file() else None,
        "run" if record is None else record.command,
        options,
        home,
    )


def _pictures(record: RunRecord, home: Path, *, is_clip: bool) -> Pictures:
    """Where the pictures of a run are."""
    start, end = (record.options.get(name) for name in ("start", "end"))
    try:
        begin, stop = Position.parse(start or "0f"), None if end is None else Position.parse(end)
    except ValueError as error:
        raise BrokenFileError(f"{home / RECORD}: {error}") from None
    cut = Cut(begin, stop, record.options.get("step") or 1)
    return Pictures(tuple(map(Path, record.source)), cut=cut, is_clip=is_clip)
