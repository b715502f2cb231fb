"""The journal of an editor: every change, on the disk before it is answered, so that nothing is lost.

A line is a change of a frame (``{"frame": id, "begin": edit}``, then ``"then": edit``, ``"undo": true`` or
``"redo": true``), the cuts of a clip (``{"cuts": [...]}``), or a note that everything so far was saved
(``{"saved": true}``). Nothing is ever removed from it.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass
from dataclasses import field as attribute
from pathlib import Path
from typing import Any

from fieldcalib.editor.frame import Edit
from fieldcalib.editor.marks import History
from fieldcalib.editor.records import edit_from_record, edit_to_record
from fieldcalib.io.files import BrokenFileError, parse_json_object
from fieldcalib.io.line_log import LineLog, whole_lines

JOURNAL = "edits.jsonl"


@dataclass
class FrameHistory:
    """The edits of a frame, and how often it was changed."""

    history: History[Edit]
    revision: int = 0
    is_saved: bool = True
    """Whether its present state is in the files of the folder."""


@dataclass
class Replayed:
    """What a journal says."""

    frames: dict[str, FrameHistory] = attribute(default_factory=dict)
    cuts: list[int] | None = None

    def apply(self, line: dict[str, Any]) -> None:
        """Repeat the change of a line; a ValueError if it is none."""
        if "cuts" in line:
            self.cuts = [int(cut) for cut in line["cuts"]]
        elif "saved" in line:
            for frame in self.frames.values():
                frame.is_saved = True
        elif "begin" in line:
            self.frames[str(line["frame"])] = FrameHistory(History(edit_from_record(line["begin"])))
        else:
            self._change(line)

    def _change(self, line: dict[str, Any]) -> None:
        frame = self.frames.get(str(line.get("frame")))
        if frame is None:
            raise ValueError(f"expected a change of a frame that has begun, got {str(line)[:80]}")
        if "then" in line:
            frame.history = frame.history.then(edit_from_record(line["then"]))
        else:
            frame.history = frame.history.undone if "undo" in line else frame.history.redone
        frame.revision += 1
        frame.is_saved = False


def read_journal(path: Path) -> Replayed:
    """What a journal says, without an incomplete last line.

    Raises
    ------
    BrokenFileError
        If another line is no change.
    """
    found = Replayed()
    for number, text in enumerate(_lines(path), 1):
        try:
            found.apply(parse_json_object(text, "a change"))
        except (ValueError, KeyError, TypeError) as error:
            raise BrokenFileError(f"{path}, line {number}: {error}") from None
    return found


def _lines(path: Path) -> Iterable[bytes]:
    return whole_lines(path) if path.exists() else ()


class Journal:
    """Appends changes to the journal of a folder, which is made with the first change."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._log: LineLog | None = None

    def begin(self, id: str, edit: Edit) -> None:
        """The state of a frame before its first change."""
        self._append({"frame": id, "begin": edit_to_record(edit)})

    def change(self, id: str, before: History[Edit], after: History[Edit]) -> None:
        """The change of a frame: a new edit, an undo or a redo."""
        if before.can_undo and after == before.undone:
            change: dict[str, Any] = {"undo": True}
        elif before.can_redo and after == before.redone:
            change = {"redo": True}
        else:
            change = {"then": edit_to_record(after.present)}
        self._append({"frame": id, **change})

    def cuts(self, cuts: Iterable[int]) -> None:
        """The first frames of the shots of a clip."""
        self._append({"cuts": list(cuts)})

    def saved(self) -> None:
        """A note that all changes so far are in the files of the folder."""
        self._append({"saved": True})

    def _append(self, line: dict[str, Any]) -> None:
        if self._log is None:
            self._folder.mkdir(parents=True, exist_ok=True)
            self._log = LineLog(self._folder / JOURNAL, durable=True)
        self._log.append(json.dumps(line, allow_nan=False))

    def close(self) -> None:
        """Close the file."""
        if self._log is not None:
            self._log.close()
            self._log = None
