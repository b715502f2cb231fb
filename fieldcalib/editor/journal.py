"""The journal of an editor: every change is written to the disk before it is confirmed, so that nothing is lost.

A line is a change of a frame (``{"frame": id, "begin": edit, "base": calibration}``, then ``"then": edit``,
``"undo": true`` or ``"redo": true``), the cuts of a clip (``{"cuts": [...]}``), or a note that everything so far was
saved (``{"saved": {name of a file: its size, time and digest}}``, with ``"frames": [ids]`` if not all), that this was
taken back (``"taken_back"``), that other files were written (``"written"``), the format of the labels that were given
(``{"format": name}``), or the field that was chosen (``{"field": name}``). Before files are replaced, the note that
will follow is announced (``{"announced": note, "before": states}``); if the process ends in between, the next one
completes the save. Nothing is ever removed from the journal. An impossible edit is left out when the journal is read,
which ``{"frame": id, "left_out": true}`` then notes.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from dataclasses import field as attribute
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple

from fieldcalib._types import is_number, one_of
from fieldcalib.assess.result import Calibration
from fieldcalib.editor.edit import FARTHEST, Edit, History, Known, Mark, Marks
from fieldcalib.editor.label_files import SOCCERNET
from fieldcalib.editor.label_versions import Announced, State, Versions
from fieldcalib.fields.catalogue import FIELDS
from fieldcalib.fields.field import Field
from fieldcalib.io.files import WRONG_RECORD, BrokenFileError, parse_json_object
from fieldcalib.io.formats import OTHER_ANNOTATIONS
from fieldcalib.io.frame_source import ignored
from fieldcalib.io.output_folder import FolderInUseError, LineLog, locked_folder, output_folder, whole_lines

JOURNAL = "edits.jsonl"
NOTES = frozenset(("saved", "taken_back", "written"))  # keys of notes about files
BEGINNINGS = tuple(f'{{"{kind}"'.encode() for kind in NOTES)  # first bytes of their lines
NOTHING_WRITTEN: Mapping[str, Any] = {"written": {}}  # follows the announcement of a save that did not happen
CHANGES = frozenset(("then", "undo", "redo", "left_out"))


Check = Callable[[Edit], None]
"""Raises a ValueError for an impossible edit."""


@dataclass
class FrameHistory:
    """The edits of a frame, and how often it was changed."""

    history: History[Edit]
    saved: Edit | None = None
    """The state that is in the files of the folder; None if there is none."""
    saved_before: Edit | None = None
    """The state that was in the files before the last save."""
    revision: int = 0
    base: Mapping[str, Any] | None = None
    """The camera that was found without a person, as `Calibration.to_dict` gives it."""
    left_out: int = 0
    """Number of edits at the end of the history that were left out, as they are impossible."""

    @property
    def is_saved(self) -> bool:
        """Whether its present state is in the files of the folder."""
        return self.saved == self.history.present

    def note_saved(self, edit: Edit | None = None) -> None:
        """Note that a state is in the files now, by default the present one."""
        self.saved, self.saved_before = self.history.present if edit is None else edit, self.saved

    def note_taken_back(self) -> None:
        """Note that the last save was taken back."""
        self.saved = self.saved_before

    def change(self, line: Mapping[str, Any], check: Check) -> str:
        """Repeat a change from the journal; returns what is wrong with an edit that is left out, else ""."""
        wrong = ""
        if "left_out" in line:
            self.left_out = 0
            return ""
        if "then" in line:
            try:
                edit = edit_from_record(line["then"])
                check(edit)
                self.history = self.history.then(edit)
                self.left_out = 0
            except ValueError as error:
                self.left_out += 1
                wrong = str(error)
        elif "undo" in line and self.left_out:
            self.left_out -= 1
        else:
            self.history = self.history.undone if "undo" in line else self.history.redone
        self.revision += 1
        return wrong


class Unfinished(NamedTuple):
    """A save that was announced but not yet noted as done; after a restart, the process had ended in between."""

    announced: Announced
    note: Mapping[str, Any]
    """The line of the journal that follows when it is done."""
    edits: Mapping[str, Edit]
    """States of the frames that it saves, by id."""
    done: Callable[[], None] = ignored
    """Called when its files are in place."""


@dataclass
class Replayed:
    """The contents of a journal."""

    check: Check
    frames: dict[str, FrameHistory] = attribute(default_factory=dict)
    cuts: list[int] | None = None
    written: dict[str, State] = attribute(default_factory=dict)
    """States of the files that were written."""
    format: str | None = None
    """The format of labels that were given."""
    size: int = 0
    """Bytes of the journal."""
    left_out: list[str] = attribute(default_factory=list)
    """Messages about impossible edits, each with its frame."""
    unfinished: Unfinished | None = None

    def apply(self, line: dict[str, Any]) -> None:
        """Apply a line; a ValueError if it is not a valid one."""
        if "cuts" in line:
            self.cuts = [int(cut) for cut in line["cuts"]]
        elif "announced" in line:
            self._announce(line)
        elif NOTES & line.keys():
            self._note(line)
        elif "format" in line:
            self.format = one_of(line["format"], (SOCCERNET, *OTHER_ANNOTATIONS), "format")
        elif "field" in line:
            one_of(line["field"], FIELDS, "field")
        elif "begin" in line:
            self._begin(line)
        else:
            self._change(line)

    def forget_saved(self) -> None:
        """Mark all edits by a person as unsaved, since a run has replaced the results."""
        for frame in self.frames.values():
            if not frame.history.present.automatic:
                frame.saved = None

    def remarks(self, field: Field) -> list[str]:
        """Warnings about edits that are left out, and about labels that a field does not have."""
        labels = (mark.label for frame in self.frames.values() for mark in frame.history.present.marks.all)
        unknown = ", ".join(map(repr, dict.fromkeys(label for label in labels if label not in field)))
        said = [f"the field has no {unknown}: such marks are kept, and have no effect"] if unknown else []
        return said + [f"{JOURNAL} has an edit that cannot be, which is left out: {one}" for one in self.left_out]

    def _announce(self, line: Mapping[str, Any]) -> None:
        note = line["announced"]
        ids = [] if "written" in note else note["frames"]
        edits = {id: self.frames[id].history.present for id in ids}
        self.unfinished = Unfinished(Announced(_noted(note), _states(line["before"])), note, edits)

    def _note(self, line: Mapping[str, Any]) -> None:
        states = _noted(line)
        edits = {} if self.unfinished is None else self.unfinished.edits
        for id in () if "written" in line else line.get("frames", self.frames):
            if "saved" in line:
                self.frames[id].note_saved(edits.get(id))
            else:
                self.frames[id].note_taken_back()
        self.written |= states
        self.unfinished = None

    def _begin(self, line: Mapping[str, Any]) -> None:
        id, wrong = str(line["frame"]), ""
        try:
            edit = edit_from_record(line["begin"])
            self.check(edit)
        except ValueError as error:
            edit, wrong = Edit(automatic=True), str(error)
        saved = edit if edit.automatic else None  # labels that were given are in no file of the folder yet
        base = line.get("base")
        if not isinstance(base, dict | None):
            raise ValueError(f"expected a camera as base, got {base!s:.40}")
        self.frames[id] = FrameHistory(History(edit), saved, base=base)
        self._leave_out(id, wrong)

    def _change(self, line: dict[str, Any]) -> None:
        id = str(line.get("frame"))
        frame = self.frames.get(id)
        if frame is None or not CHANGES & line.keys():
            raise ValueError(f"expected a change of a frame that has begun, got {str(line)[:80]}")
        self._leave_out(id, frame.change(line, self.check))

    def _leave_out(self, id: str, wrong: str) -> None:
        if wrong:
            self.left_out.append(f"frame {id}: {wrong}")


def _noted(note: Mapping[str, Any]) -> dict[str, State]:
    """States of the files in a note, by their names in the folder."""
    (kind,) = NOTES & note.keys()
    return _states(note[kind])


def _states(record: Mapping[str, Any]) -> dict[str, State]:
    states = {name: State(int(size), int(time), *map(str, more)) for name, (size, time, *more) in record.items()}
    for name in states:
        path = PurePosixPath(name)
        if path.is_absolute() or ".." in path.parts or not path.parts:
            raise ValueError(f"expected the name of a file in the folder, got {name[:80]!r}")
    return states


def chosen_field(path: Path) -> str | None:
    """Name of the field that was chosen on the page last; None if none was."""
    lines = [text for text in _lines(path) if text.startswith(b'{"field"')]
    return parse_json_object(lines[-1], "a field")["field"] if lines else None


def read_journal(path: Path, check: Check = lambda edit: None) -> Replayed:
    """Read a journal, without an incomplete last line.

    Parameters
    ----------
    path : Path
    check : callable
        Edits for which it raises a ValueError are left out.

    Raises
    ------
    BrokenFileError
        If another line is invalid.
    """
    found = Replayed(check)
    for number, text in enumerate(_lines(path), 1):
        found.size += len(text)
        try:
            found.apply(parse_json_object(text, "a change"))
        except WRONG_RECORD as error:
            said = "" if isinstance(error, ValueError) else f"is no change of a frame: {type(error).__name__} "
            raise BrokenFileError(f"{path}, line {number}: {said}{error}") from None
    return found


def finish_save(folder: Path, versions: Versions) -> None:
    """Complete a save that was announced in the journal of a folder, and whose process has ended; if there is one.

    Raises
    ------
    BrokenFileError
        As `read_journal`.
    OSError
        If another program writes to the folder, or a file cannot be written.
    """
    is_unfinished = False
    for text in _lines(folder / JOURNAL):
        is_unfinished = text.startswith(b'{"announced"') or (is_unfinished and not text.startswith(BEGINNINGS))
    if not is_unfinished:
        return
    replayed = read_journal(folder / JOURNAL)
    if replayed.unfinished is None:
        return
    journal = Journal(folder, replayed.size)
    try:
        journal.open()
        is_done = versions.finish(replayed.unfinished.announced)
        journal.add(**(replayed.unfinished.note if is_done else NOTHING_WRITTEN))
    finally:
        journal.close()


def _lines(path: Path) -> Iterable[bytes]:
    return whole_lines(path) if path.exists() else ()


class Journal:
    """Appends changes to the journal of a folder; both are made with the first change.

    From then on no other program can write results to the folder, until the journal is closed.
    """

    def __init__(self, folder: Path, size: int = 0) -> None:
        self._folder, self._size = folder, size
        self._claim, self._open = ExitStack(), ExitStack()
        self._is_claimed, self._refusal = False, ""
        self._log: LineLog | None = None

    def claim(self) -> str:
        """Lock the folder, if it exists, so that no other program writes to it; returns why that failed, or "".

        A folder that does not exist yet is locked with the first change, which makes it.
        """
        if self._log is None and not self._is_claimed and self._folder.is_dir():
            try:
                self._claim.enter_context(locked_folder(self._folder))
            except FolderInUseError as error:
                return str(error)
            self._is_claimed, self._refusal = True, self._changed_elsewhere()
        return self._refusal

    def _changed_elsewhere(self) -> str:
        """Message that another program has changed the journal; empty if it has not."""
        path = self._folder / JOURNAL
        if sum(map(len, _lines(path))) == self._size:
            return ""
        return f"{path} was changed by another program: end this one and open the folder again"

    def begin(self, id: str, edit: Edit, base: Calibration | None) -> None:
        """Write the state of a frame before its first change."""
        record = None if base is None else base.to_dict()
        self.add(frame=id, begin=edit_to_record(edit), base=record)

    def change(self, id: str, before: History[Edit], after: History[Edit]) -> None:
        """Write the change of a frame: a new edit, an undo or a redo."""
        after = before.changed_to(after)
        if before.can_undo and after == before.undone:
            change: dict[str, Any] = {"undo": True}
        elif before.can_redo and after == before.redone:
            change = {"redo": True}
        else:
            change = {"then": edit_to_record(after.present)}
        self.add(frame=id, **change)

    def announce(self, announced: Announced, kind: str, ids: Sequence[str] = ()) -> dict[str, Any]:
        """Write that a save is about to be done; returns the note for `done`.

        Parameters
        ----------
        announced : Announced
            The files that it writes.
        kind : {"saved", "taken_back", "written"}
            Whether all changes of some frames so far are then in files of the folder, or the last save was taken back,
            or other files were written.
        ids : sequence of str
            The frames that are saved or taken back.
        """
        note: dict[str, Any] = {kind: {name: list(state) for name, state in announced.states.items()}}
        note |= {} if kind == "written" else {"frames": list(ids)}
        self.add(announced=note, before={name: list(state) for name, state in announced.before.items()})
        return note

    def add(self, **line: Any) -> None:
        """Add a line of anything else."""
        self.open().append(json.dumps(line, allow_nan=False))

    def open(self) -> LineLog:
        """Make the folder and its journal, if they do not exist, and lock the folder against other programs.

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


def edit_to_record(edit: Edit) -> dict[str, Any]:
    """Convert an edit to a dict for `json.dumps`; the inverse is `edit_from_record`."""
    return {
        "marks": [[one.label, one.x, one.y, one.by_hand] for one in edit.marks.all],
        "known": asdict(edit.known),
        "automatic": edit.automatic,
    }


def edit_from_record(record: dict[str, Any]) -> Edit:
    """Convert a dict of `edit_to_record` back to an edit.

    Raises
    ------
    ValueError
        If it is not such a dict.

    Examples
    --------
    >>> edit = Edit(Marks().added("Middle line", [(480, 100)]), Known(focal_length=1500.0))
    >>> edit_from_record(edit_to_record(edit)) == edit
    True
    """
    try:
        marks = [Mark(str(label), *_pixel(x, y), bool(by_hand)) for label, x, y, by_hand in record["marks"]]
        known = record["known"].items()
        values: dict[str, Any] = {name: tuple(one) if isinstance(one, list) else one for name, one in known}
        return Edit(Marks(tuple(marks)), Known(**values), bool(record["automatic"]))
    except WRONG_RECORD as error:
        raise ValueError(f"is no edit of a frame: {error}") from None


def _pixel(x: Any, y: Any) -> tuple[float, float]:
    """Check that a pixel has finite coordinates."""
    for value in (x, y):
        if not is_number(value) or not abs(value) < FARTHEST:
            raise ValueError(f"expected pixels below {FARTHEST:g}, got {value!s:.40}")
    return float(x), float(y)
