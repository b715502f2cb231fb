"""State of an editor's frames: their edits and cameras, and the table of all frames with verdicts, angles and concern.

A frame has up to three cameras: found without a person (`FrameState.base`), from its marks, or of a solution of the
clip (`FrameState.found`).
"""

from __future__ import annotations

import os
import pickle
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from itertools import count
from tempfile import TemporaryFile
from threading import Lock, RLock
from typing import Any, NamedTuple
from weakref import finalize

import numpy as np

from fieldcalib.assess.findings import Verdict
from fieldcalib.assess.result import Calibration
from fieldcalib.editor.edit import Edit, History, Marks
from fieldcalib.editor.fitting import is_to_search
from fieldcalib.editor.journal import FrameHistory
from fieldcalib.fields.field import Field
from fieldcalib.geometry.camera import ANGLE_NAMES
from fieldcalib.io.frame_source import FrameSource

BY_HAND = "labelled by hand"  # basis of a frame that a person has labelled
BY_HAND_TOO = "labelled by hand and by the network"  # basis of such a frame that has marks of the network too
MOST_IN_MEMORY = 100  # calibrations of 0.1 MB each: enough for the frames that a person goes back and forth between

CONCERN = {Verdict.GOOD: 0.0, Verdict.CHECK: 0.4, Verdict.REJECT: 0.7}  # least concern by verdict
REST = 0.3  # concern added in proportion to the probability that the camera is wrong


class Spilled:
    """Store of values by keys that it assigns: the last used ones in memory, all others in a temporary file.

    Parameters
    ----------
    most : int
        Number of values in memory.

    Examples
    --------
    >>> spilled = Spilled(most=1)
    >>> keys = [spilled.add(value) for value in "abc"]
    >>> [spilled[key] for key in keys]
    ['a', 'b', 'c']
    """

    def __init__(self, most: int = MOST_IN_MEMORY) -> None:
        self._most = most
        self._near: OrderedDict[int, Any] = OrderedDict()
        self._far = TemporaryFile()  # noqa: SIM115 - it lasts as long as this
        finalize(self, self._far.close)
        self._places: dict[int, tuple[int, int]] = {}
        self._keys = count()
        self._lock = Lock()

    def add(self, value: Any) -> int:
        """Take a value; returns its key."""
        with self._lock:
            key = next(self._keys)
            self._near[key] = value
            self._spill()
            return key

    def __getitem__(self, key: int) -> Any:
        with self._lock:
            if key in self._near:
                self._near.move_to_end(key)
                return self._near[key]
            offset, size = self._places[key]
            self._far.seek(offset)
            value = pickle.loads(self._far.read(size))
            self._near[key] = value
            self._spill()
            return value

    def _spill(self) -> None:
        """Write values to the file, once each, until few are left in memory."""
        while len(self._near) > self._most:
            key, value = self._near.popitem(last=False)
            if key not in self._places:
                content = pickle.dumps(value)
                self._places[key] = self._far.seek(0, os.SEEK_END), len(content)
                self._far.write(content)


class Row(NamedTuple):
    """The row of a frame in the table."""

    verdict: str = ""
    reason: str = ""
    concern: float = 0.0
    """Urgency of checking the frame, 0 to 1."""
    pan: float | None = None
    tilt: float | None = None
    roll: float | None = None
    """Pan, tilt and roll are in degrees."""
    focal_length: float | None = None
    """Pixels."""
    basis: str = ""
    by_hand: bool = False

    @classmethod
    def of(cls, calibration: Calibration, basis: str = "", *, by_hand: bool = False) -> Row:
        """Make the row of a calibration."""
        probability = calibration.probability() if calibration.has_probability else float("nan")
        pan, tilt, roll, f = None, None, None, None
        if calibration.camera is not None:
            pan, tilt, roll = (round(angle, 4) for angle in np.degrees(calibration.camera.angles).tolist())
            f = round(calibration.camera.focal_length, 2)
        verdict = calibration.verdict
        concern = _concern(verdict, probability)
        return cls(str(verdict), calibration.reason, concern, pan, tilt, roll, f, basis, by_hand)

    @classmethod
    def of_line(cls, line: Mapping[str, Any]) -> Row:
        """Make the row of a line of ``cameras.jsonl``."""
        verdict = str(line.get("verdict", ""))
        known = line.get("probability_right_1m")
        probability = float("nan") if known is None else float(known)
        degrees, K = line.get("angles_degrees") or {}, line.get("K")
        pan, tilt, roll = (degrees.get(name) for name in ANGLE_NAMES)
        return cls(
            verdict,
            str(line.get("reason") or line.get("message", "")),
            _concern(Verdict(verdict), probability) if verdict else 1.0,
            pan,
            tilt,
            roll,
            None if K is None else float(K[0][0]),
            str(line.get("basis", "")),
        )


def _concern(verdict: Verdict, probability: float) -> float:
    """Urgency of checking a frame, from its verdict and the probability that its camera is right, 0 to 1."""
    share = 1.0 - probability if np.isfinite(probability) else 0.5
    return round(CONCERN[verdict] + REST * share, 4)


@dataclass(frozen=True)
class Table:
    """Rows of all frames as columns, for JSON."""

    ids: Sequence[str]
    rows: Sequence[Row]

    def columns(self) -> dict[str, list[Any]]:
        """Values by the name of the column."""
        values = zip(*self.rows, strict=True) if self.rows else ((),) * len(Row._fields)
        return {"id": list(self.ids), **{name: list(one) for name, one in zip(Row._fields, values, strict=True)}}


class FrameState:
    """The edits and the cameras of a frame.

    Parameters
    ----------
    edits : FrameHistory, or Edit
        The edits; an `Edit` is the automatic state of a frame that nobody has changed.
    values : Spilled
        Store for what takes much memory: calibrations, and states of frames that nobody has changed.
    has_begun : bool
        Whether the journal has the first state of the frame.
    base : Calibration, optional
    """

    def __init__(
        self, edits: FrameHistory | Edit, values: Spilled, *, has_begun: bool = False, base: Calibration | None = None
    ) -> None:
        self._values = values
        self._edits: FrameHistory | int = values.add(edits) if isinstance(edits, Edit) else edits
        self.has_begun = has_begun
        self._base: int | None = None
        self._found: int | None = None
        self._kept: tuple[Edit, int] | None = None
        self.base = base

    @property
    def edits(self) -> FrameHistory:
        """Edits of the frame, for reading; to change them use `touched`."""
        if isinstance(self._edits, FrameHistory):
            return self._edits
        found = self._values[self._edits]
        return FrameHistory(History(found), found)

    def touched(self) -> FrameHistory:
        """Edits of the frame, to be changed: from now on they are kept in memory."""
        self._edits = self.edits
        return self._edits

    @property
    def is_untouched(self) -> bool:
        """Whether neither the edits of the frame nor their saved state was ever changed."""
        return not isinstance(self._edits, FrameHistory)

    @property
    def is_saved(self) -> bool:
        """Whether the present state is in the files of the folder, or was found without a person."""
        return self.is_untouched or self.edits.is_saved

    @property
    def is_anchor(self) -> bool:
        """Whether a person has labelled the frame, or given values for it."""
        return not self.is_untouched and not self.edits.history.present.automatic

    @property
    def is_to_search(self) -> bool:
        """Whether the court is still to be searched for."""
        return self.base is not None and is_to_search(self.base)

    @property
    def revision(self) -> int:
        """How often the frame was changed."""
        return 0 if self.is_untouched else self.edits.revision

    @property
    def base(self) -> Calibration | None:
        """The camera that was found without a person."""
        return None if self._base is None else self._values[self._base]

    @base.setter
    def base(self, calibration: Calibration | None) -> None:
        self._base = None if calibration is None else self._values.add(calibration)

    @property
    def found(self) -> Calibration | None:
        """The camera from the marks, or from a solution of the clip in which they count."""
        return None if self._found is None else self._values[self._found]

    @found.setter
    def found(self, calibration: Calibration | None) -> None:
        self._found = None if calibration is None else self._values.add(calibration)

    @property
    def is_of_clip(self) -> bool:
        """Whether the camera is the clip's: the marks are those with which a solution of the clip was kept."""
        return self._kept is not None and self._kept[0] == self.edits.history.present

    def change(self, history: History[Edit], found: Calibration | None) -> None:
        """Take a new state of the edits; `found` is its camera, if it is known.

        Going back to the marks with which a solution of the clip was kept restores the clip's camera.
        """
        edits = self.touched()
        edits.history = history
        edits.revision += 1
        if self._kept is not None and self.is_of_clip:
            self._found = self._kept[1]
        else:
            self.found = found

    def keep(self, calibration: Calibration) -> None:
        """Take over the camera of the clip, for the present marks."""
        self.found = calibration
        assert self._found is not None
        self._kept = self.edits.history.present, self._found

    def copy(self) -> FrameState:
        """Copy the present state, to go back to it by `before`."""
        other = copy(self)
        other._edits = self._edits if isinstance(self._edits, int) else replace(self._edits)
        return other

    def before(self, other: FrameState) -> None:
        """Go back to the state before a solution of the clip was kept; edits made since then stay."""
        self._base, self._kept = other._base, other._kept
        if not self.is_untouched:
            self.edits.saved, self.edits.saved_before = other.edits.saved, other.edits.saved_before
        if self.revision == other.revision:
            self._found = other._found
        else:
            self._found = self._kept[1] if self._kept is not None and self.is_of_clip else None


class FrameStates(dict[int, FrameState]):
    """States of the frames that were opened or labelled, by number; and the table and the cuts of all frames.

    Parameters
    ----------
    frames : FrameSource
    field : Field
        The field that the frames show.
    cuts : sequence of int
        First frames of the shots of a clip, as far as they are known.
    has_own_cuts : bool
        Whether a person has set them.
    """

    def __init__(self, frames: FrameSource, field: Field, cuts: Sequence[int], *, has_own_cuts: bool) -> None:
        super().__init__()
        self.frames, self.field = frames, field
        self.cuts, self.has_own_cuts = list(cuts), has_own_cuts
        self.numbers = {id: number for number, id in enumerate(frames.ids)}
        """Numbers of the frames by id."""
        self.rows = [Row()] * len(frames)
        """Rows of the table, one per frame."""
        self.version = 0
        """How often the table or the cuts have changed."""
        self.spilled = Spilled()
        """Store in which the states keep what takes much memory."""
        self.lock = RLock()
        """Held while frames are changed; reading is safe without."""

    @property
    def is_clip(self) -> bool:
        """Whether the frames are those of a video."""
        return self.frames.rate is not None

    def revision(self, number: int) -> int:
        """How often a frame was changed."""
        state = self.get(number)
        return 0 if state is None else state.revision

    def show(self, number: int, row: Row) -> None:
        """Show a row in the table."""
        if self.rows[number] != row:
            self.rows[number] = row
            self.version += 1


def is_by_hand(basis: str) -> bool:
    """Whether the basis of a frame says that a person has mended it."""
    return basis in (BY_HAND, BY_HAND_TOO)


def basis_of(marks: Marks) -> str:
    """Basis of a camera that is calibrated from marks."""
    return BY_HAND if all(one.by_hand for one in marks.all) else BY_HAND_TOO
