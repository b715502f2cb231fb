"""Which frames of a clip belong together, and what the cameras of each such piece share."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from itertools import accumulate, pairwise

import numpy as np

from fieldcalib._types import IntArray


class CameraModel(StrEnum):
    """Model of the camera: the parameters that the frames of a piece share."""

    TRIPOD = "tripod"
    """One place of the camera, its lens, and the size of the field."""
    WINDOW = "window"
    """A tripod, but a principal point for each frame: the picture is a window that moves over a larger one."""
    CUT_OUT = "cut out"
    """A tripod, with a principal point for all that may lie far from the middle: the picture is a fixed part of a
    larger one, or is shown in a part of the screen."""
    PARTS = "parts"
    """A tripod for each part of the piece, which is divided."""
    MOVING = "moving"
    """Lens and size of the field, and centres along a smooth path."""
    ALONE = "alone"
    """Nothing: each frame is calibrated by itself."""


@dataclass(frozen=True, eq=False)
class Pieces:
    """The frames of a clip by piece: runs of frames that matches connect, or parts of these."""

    number: IntArray
    """Number of the piece of each frame, (T,), from 0 and ascending."""
    models: Mapping[int, CameraModel] = field(default_factory=dict)
    """Camera models of pieces; pieces without one have a tripod."""

    @property
    def numbers(self) -> list[int]:
        """The numbers of all pieces, ascending."""
        return sorted(set(self.number.tolist()))

    def frames(self, members: Sequence[int]) -> IntArray:
        """The frames of some pieces, in order."""
        return np.flatnonzero(np.isin(self.number, members))

    def models_of(self, members: Iterable[int]) -> set[CameraModel]:
        """The camera models of some pieces."""
        return {self.models.get(piece, CameraModel.TRIPOD) for piece in members}

    def with_model(self, piece: int, model: CameraModel) -> Pieces:
        """The pieces, one of them with another camera model."""
        return replace(self, models={**self.models, piece: model})

    def divided(self, first: Sequence[int]) -> Pieces:
        """The pieces, divided before some frames."""
        return replace(self, number=self.number + np.searchsorted(first, np.arange(len(self.number)), "right"))

    def joined(self, piece: int) -> Pieces:
        """The pieces, one of them joined to the one before."""
        return replace(self, number=self.number - (self.number >= piece))


def loose_at_end(piece: Sequence[int], linked: Sequence[bool]) -> list[bool]:
    """Which frames are untied, as are all after them in their piece: in a dissolve or a pan too fast to follow.

    They may show the next camera, so labels in them say nothing of the frames before.

    Parameters
    ----------
    piece : (T,) sequence of int
        Ascending.
    linked : (T,) sequence of bool
        Whether something ties a frame to its piece; the first frame of a piece is tied to it.

    Examples
    --------
    >>> loose_at_end([0, 0, 0, 0, 3, 3], [True, False, True, False, True, True])
    [False, False, False, True, False, False]
    """
    last = {p: t for t, (p, is_linked) in enumerate(zip(piece, linked, strict=True)) if is_linked}
    return [t > last[p] for t, p in enumerate(piece)]


def numbered(piece: Sequence[int], loose: Sequence[bool]) -> list[int]:
    """Numbers of pieces from 0, with loose frames as pieces of their own.

    Examples
    --------
    >>> numbered([0, 0, 0, 0, 3, 3], [False, False, False, True, False, False])
    [0, 0, 0, 1, 2, 2]
    """
    both = list(zip(piece, loose, strict=True))
    return list(accumulate((one != other for one, other in pairwise(both)), initial=0))[: len(both)]
