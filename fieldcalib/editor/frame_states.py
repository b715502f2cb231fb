"""What an editor knows of its frames: their edits, and the cameras without a person, by the marks, and of the clip."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace

from fieldcalib.assess.result import Calibration
from fieldcalib.editor.clip import Proposal
from fieldcalib.editor.edit import Edit, History, Marks
from fieldcalib.editor.frame_table import Row
from fieldcalib.editor.journal import FrameHistory
from fieldcalib.editor.saved_files import BY_HAND, BY_HAND_TOO, Spilled


class FrameState:
    """What is known about a frame.

    Parameters
    ----------
    edits : FrameHistory, or Edit
        The state of a frame that nobody has changed, as it was found.
    values : Spilled
        Where what takes much memory is kept: calibrations, and the state of a frame that nobody has changed.
    has_begun : bool
        Whether its journal has begun.
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
        """What a person has said of the frame; see `touched` before it is changed."""
        if isinstance(self._edits, FrameHistory):
            return self._edits
        found = self._values[self._edits]
        return FrameHistory(History(found), found)

    def touched(self) -> FrameHistory:
        """The edits, which are about to be changed."""
        self._edits = self.edits
        return self._edits

    @property
    def is_untouched(self) -> bool:
        """Whether nobody has changed the frame, nor whether it is saved."""
        return not isinstance(self._edits, FrameHistory)

    @property
    def is_saved(self) -> bool:
        """Whether the present state is in the files of the folder, or was found without a person."""
        return self.is_untouched or self.edits.is_saved

    @property
    def is_anchor(self) -> bool:
        """Whether a person has said something of the frame."""
        return not self.is_untouched and not self.edits.history.present.automatic

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
        """The camera that follows from the marks, or that of the clip with them."""
        return None if self._found is None else self._values[self._found]

    @found.setter
    def found(self, calibration: Calibration | None) -> None:
        self._found = None if calibration is None else self._values.add(calibration)

    @property
    def is_of_clip(self) -> bool:
        """Whether the camera is that of the clip: the marks are those with which a solution of it was kept."""
        return self._kept is not None and self._kept[0] == self.edits.history.present

    def change(self, history: History[Edit], found: Calibration | None) -> None:
        """Take a new state of the edits; `found` is its camera, if it is known.

        Whoever comes back to marks with which a solution of the clip was kept has its camera again.
        """
        edits = self.touched()
        edits.history = history
        edits.revision += 1
        if self._kept is not None and self.is_of_clip:
            self._found = self._kept[1]
        else:
            self.found = found

    def keep(self, calibration: Calibration) -> None:
        """Take the camera of the clip with the present marks."""
        self.found = calibration
        assert self._found is not None
        self._kept = self.edits.history.present, self._found

    def copy(self) -> FrameState:
        """What is known now, to go back to it by `before`."""
        other = copy(self)
        other._edits = self._edits if isinstance(self._edits, int) else replace(self._edits)
        return other

    def before(self, other: FrameState) -> None:
        """Go back to what was known before a solution of the clip was kept; what was changed since stays."""
        self._base, self._kept = other._base, other._kept
        if not self.is_untouched:
            self.edits.saved, self.edits.saved_before = other.edits.saved, other.edits.saved_before
        if self.revision == other.revision:
            self._found = other._found
        else:
            self._found = self._kept[1] if self._kept is not None and self.is_of_clip else None


@dataclass(frozen=True)
class BeforeKeep:
    """What was known before a solution of a clip was kept."""

    proposal: Proposal
    states: Mapping[int, FrameState]
    rows: Sequence[Row]
    cuts: Sequence[int]
    saves: int
    """The number of the save by which it was kept."""
    saved: Sequence[int]
    """Numbers of the frames whose labels were saved with it."""


def basis_of(marks: Marks) -> str:
    """What a camera rests on that follows from marks."""
    return BY_HAND if all(one.by_hand for one in marks.all) else BY_HAND_TOO
