"""What an editor knows of its frames: their edits, and the cameras without a person, by the marks, and of the clip."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from fieldcalib.assess.result import Calibration
from fieldcalib.editor.clip import Proposal
from fieldcalib.editor.frame import Edit
from fieldcalib.editor.journal import FrameHistory
from fieldcalib.editor.marks import Marks
from fieldcalib.editor.stored import BY_HAND, BY_HAND_TOO
from fieldcalib.editor.table import Row


@dataclass
class FrameState:
    """What is known about a frame."""

    edits: FrameHistory
    has_begun: bool = False
    """Whether its journal has begun."""
    base: Calibration | None = None
    found: Calibration | None = None
    """The camera that follows from the marks, or that of the clip with them."""
    kept: tuple[Edit, Calibration] | None = None
    """Marks with which a solution of the clip was kept, and its camera: whoever comes back to them has it again."""

    @property
    def is_of_clip(self) -> bool:
        """Whether the camera is that of the clip."""
        return self.kept is not None and self.kept[0] == self.edits.history.present

    def before(self, other: FrameState) -> None:
        """Go back to what was known before a solution of the clip was kept; what was changed since stays."""
        self.base, self.kept = other.base, other.kept
        self.edits.saved, self.edits.saved_before = other.edits.saved, other.edits.saved_before
        if self.edits.revision == other.edits.revision:
            self.found = other.found
        else:
            self.found = self.kept[1] if self.kept is not None and self.is_of_clip else None

    def keep(self, calibration: Calibration) -> None:
        """Take the camera of the clip with the present marks."""
        self.found, self.kept = calibration, (self.edits.history.present, calibration)


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


def is_anchor(state: FrameState) -> bool:
    """Whether a person has said something of a frame."""
    return not state.edits.history.present.automatic
