"""The folder of results of an editor: read as a run wrote it, and written so that other commands go on from there."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from fieldcalib.assess.result import Calibration
from fieldcalib.editor.table import Row
from fieldcalib.io.files import BrokenFileError, parse_json_object
from fieldcalib.io.results import BROKEN, LINES, TABLE, lines_file, result_lines
from fieldcalib.run_folder.record import RECORD, RunRecord

BY_HAND = "labelled by hand"  # basis of a frame that a person has mended
TRIPODS = "tripods.json"


class Stored:
    """Results in a folder.

    Parameters
    ----------
    folder : Path
        It may be empty, or not exist yet.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.lines: dict[str, dict[str, Any]] = {}
        """Lines of ``cameras.jsonl`` by id."""
        self._states: dict[str, tuple[int, int]] = {}
        if self.has_results(folder):
            for number, text in enumerate(result_lines(lines_file(folder)), 1):
                try:
                    line = parse_json_object(text, "a frame's result")
                    self.lines[str(line["id"])] = line
                except (KeyError, BrokenFileError) as error:
                    raise BrokenFileError(f"{lines_file(folder)}, line {number}: is no result: {error}") from None

    @staticmethod
    def has_results(folder: Path) -> bool:
        """Whether a folder has results."""
        return (folder / LINES).is_file() or (folder / TABLE).is_file()

    @property
    def record(self) -> RunRecord | None:
        """The record of the run that wrote them."""
        return RunRecord.read(self.folder)

    def calibration(self, id: str) -> Calibration | None:
        """The calibration of a frame; None if there is none."""
        line = self.lines.get(id)
        if line is None or line.get("status") == BROKEN:
            return None
        return Calibration.from_dict(line)

    def rows(self) -> Iterator[tuple[str, Row]]:
        """What the table says about each frame."""
        for id, line in self.lines.items():
            yield id, Row.of_line(line)


def source_of(folder: Path) -> list[Path]:
    """The input that the record of a run names.

    Raises
    ------
    ValueError
        If there is none, or it is no longer there.
    """
    record = RunRecord.read(folder)
    given = [] if record is None else record.options.get("input", [])
    paths = [Path(one) for one in given]
    if not paths or not all(path.exists() for path in paths):
        where = ", ".join(map(str, paths)) or "nothing"
        raise ValueError(
            f"{folder} does not say where its pictures are ({where} in {RECORD}): give them, and this folder by --out"
        )
    return paths
