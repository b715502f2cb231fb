"""Calibrations of the frames of a clip, which are made when they are asked for."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Sequence
from typing import overload

from fieldcalib.assess.result import Calibration
from fieldcalib.geometry.camera import Camera


class FrameSequence(Sequence[Calibration]):
    """A sequence of one calibration for each frame; what has the frames says how many and what each of them is."""

    @abstractmethod
    def _frame(self, t: int) -> Calibration:
        """The calibration of frame t."""

    @overload
    def __getitem__(self, index: int) -> Calibration: ...

    @overload
    def __getitem__(self, index: slice) -> tuple[Calibration, ...]: ...

    def __getitem__(self, index: int | slice) -> Calibration | tuple[Calibration, ...]:
        if isinstance(index, slice):
            return tuple(self._frame(t) for t in range(len(self))[index])
        return self._frame(range(len(self))[index])

    def __iter__(self) -> Iterator[Calibration]:
        return (self._frame(t) for t in range(len(self)))

    @property
    def cameras(self) -> list[Camera | None]:
        """Of the frames."""
        return [frame.camera for frame in self]
