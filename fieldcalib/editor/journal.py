"""The journal of an editor: every change, on the disk before it is answered, so that nothing is lost.

A line is a change of a frame (``{"frame": id, "begin": edit, "base": calibration}``, then ``"then": edit``,
``"undo": true`` or ``"redo": true``), the cuts of a clip (``{"cuts": [...]}``), or a note that everything so far was
saved (``{"saved": {name of a file: its size and time}}``, with ``"frames": [ids]`` if not all), that this was taken
back (``"taken_back"``), that other files were written (``"written"``), or the format of the labels that were given
(``{"format": name}``). Nothing is ever removed from it.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from dataclasses import field as attribute
from pathlib import Path
from typing import Any

from fieldcalib.assess.result import Calibration
from fieldcalib.editor.frame import Edit
from fieldcalib.editor.marks import History
from fieldcalib.editor.records import edit_from_record, edit_to_record
from fieldcalib.io.files import BrokenFileError, parse_json_object
from fieldcalib.io.line_log import LineLog, whole_lines
from fieldcalib.io.output_folder import FolderInUseError, locked_folder, output_folder

JOURNAL = "edits.jsonl"


@dataclass
class FrameHistory:
    """The edits of a frame, and how often it was changed."""

    history: History[Edit]
    saved: Edit | None = None
    """The state that is in the files of the folder; None if there is none."""
    saved_before: Edit | None = None
    """The one that was there before the last save."""
    revision: int = 0
    base: Mapping[str, Any] | None = None
    """The camera that was found without a person, as `Calibration.to_dict` gives it."""

    @property
    def is_saved(self) -> bool:
        """Whether its present state is in the files of the folder."""
        return self.saved == self.history.present

    def note_saved(self) -> None:
        """Note that the present state is in the files now."""
        self.saved, self.saved_before = self.history.present, self.saved

    def note_taken_back(self) -> None:
        """Note that the last save was taken back."""
        self.saved = self.saved_before


@dataclass
class Replayed:
    """What a journal says."""

    frames: dict[str, FrameHistory] = attribute(default_factory=dict)
    cuts: list[int] | None = None
    written: dict[str, tuple[int, int]] = attribute(default_factory=dict)
    """States of the files that were written."""
    format: str | None = None
    """The format of labels that were given."""
    size: int = 0
    """Bytes of the journal."""

    def apply(self, line: dict[str, Any]) -> None:
        """Repeat the change of a line; a ValueError if it is none."""
        if "cuts" in line:
            self.cuts = [int(cut) for cut in line["cuts"]]
        elif "saved" in line:
            for id in line.get("frames", self.frames):
                self.frames[id].note_saved()
            self.written |= _states(line["saved"])
        elif "taken_back" in line:
            for id in line["frames"]:
                self.frames[id].note_taken_back()
            self.written |= _states(line["taken_back"])
        elif "written" in line:
            self.written |= _states(line["written"])
        elif "format" in line:
            self.format = str(line["format"])
        elif "begin" in line:
            edit = edit_from_record(line["begin"])
            saved = edit if edit.automatic else None  # labels that were given are in no file of the folder yet
            self.frames[str(line["frame"])] = FrameHistory(History(edit), saved, base=line.get("base"))
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


def read_journal(path: Path) -> Replayed:
    """What a journal says, without an incomplete last line.

    Raises
    ------
    BrokenFileError
        If another line is no change.
    """
    found = Replayed()
    for number, text in enumerate(_lines(path), 1):
        found.size += len(text)
        try:
            found.apply(parse_json_object(text, "a change"))
        except (ValueError, KeyError, TypeError) as error:
            raise BrokenFileError(f"{path}, line {number}: {error}") from None
    return found


def _states(record: Mapping[str, Any]) -> dict[str, tuple[int, int]]:
    return {name: (int(size), int(time)) for name, (size, time) in record.items()}


def _lines(path: Path) -> Iterable[bytes]:
    return whole_lines(path) if path.exists() else ()


class Journal:
    """Appends changes to the journal of a folder, which is made with the first change.

    From then on no other program writes results to the folder, until the journal is closed.
    """

    def __init__(self, folder: Path, size: int = 0) -> None:
        self._folder, self._size = folder, size
        self._claim, self._open = ExitStack(), ExitStack()
        self._is_claimed, self._refusal = False, ""
        self._log: LineLog | None = None

    def claim(self) -> str:
        """Lock the folder, if it is there, so that no other program writes to it; returns in words why that fails.

        A folder that only the journal makes is locked with its first change.
        """
        if self._log is None and not self._is_claimed and self._folder.is_dir():
            try:
                self._claim.enter_context(locked_folder(self._folder))
            except FolderInUseError as error:
                return str(error)
            self._is_claimed, self._refusal = True, self._changed_elsewhere()
        return self._refusal

    def _changed_elsewhere(self) -> str:
        """Words that another program has changed the journal; empty if it has not."""
        path = self._folder / JOURNAL
        if sum(map(len, _lines(path))) == self._size:
            return ""
        return f"{path} was changed by another program: end this one and open the folder again"

    def begin(self, id: str, edit: Edit, base: Calibration | None) -> None:
        """The state of a frame before its first change."""
        record = None if base is None else base.to_dict()
        self._append({"frame": id, "begin": edit_to_record(edit), "base": record})

    def change(self, id: str, before: History[Edit], after: History[Edit]) -> None:
        """The change of a frame: a new edit, an undo or a redo."""
        after = before.changed_to(after)
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

    def saved(self, written: Mapping[str, tuple[int, int]], ids: Sequence[str]) -> None:
        """A note that all changes of some frames so far are in files of the folder."""
        self._append({"saved": dict(written), "frames": list(ids)})

    def taken_back(self, written: Mapping[str, tuple[int, int]], ids: Sequence[str]) -> None:
        """A note that the last save, of some frames, was taken back."""
        self._append({"taken_back": dict(written), "frames": list(ids)})

    def format(self, name: str) -> None:
        """The format of labels that were given."""
        self._append({"format": name})

    def written(self, written: Mapping[str, tuple[int, int]]) -> None:
        """A note of files that were written, beside those of `saved`."""
        self._append({"written": dict(written)})

    def _append(self, line: dict[str, Any]) -> None:
        self.open().append(json.dumps(line, allow_nan=False))

    def open(self) -> LineLog:
        """Make the folder and its journal, if they are not there; no other program may write there then.

        Raises
        ------
        OSError
            If they cannot be made, or another program writes there.
        """
        if self._log is None:
            self._give_up_claim()
            with ExitStack() as opened:
                opened.enter_context(output_folder(self._folder))
                if changed := self._changed_elsewhere():
                    raise OSError(changed)
                self._log = opened.enter_context(LineLog(self._folder / JOURNAL, durable=True))
                self._open = opened.pop_all()
        return self._log

    def close(self) -> None:
        """Close the file."""
        self._log = None
        self._open.close()
        self._give_up_claim()
        self._size = sum(map(len, _lines(self._folder / JOURNAL)))

    def _give_up_claim(self) -> None:
        self._claim.close()
        self._is_claimed = False
