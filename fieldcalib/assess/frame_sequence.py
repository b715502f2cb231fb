"""A sequence of calibrations of the frames of a clip, each made on access."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Self, TypeVar, overload

import numpy as np

from fieldcalib._types import IntArray
from fieldcalib.assess.result import Calibration
from fieldcalib.geometry.camera import Camera

T = TypeVar("T")


class FrameSequence(Sequence[Calibration]):
    """A sequence of one calibration for each frame; subclasses store the frames.

    A slice is of the same class. Two sequences are equal if their `to_dict` is.
    """

    @abstractmethod
    def _frame(self, t: int) -> Calibration:
        """The calibration of frame t."""

    @abstractmethod
    def _at(self, index: IntArray) -> Self:
        """A sequence of some of the frames, in that order."""

    @abstractmethod
    def to_dict(self) -> dict[str, Any]:
        """The sequence as a dict for `json.dumps`."""

    @overload
    def __getitem__(self, index: int) -> Calibration: ...

    @overload
    def __getitem__(self, index: slice) -> Self: ...

    def __getitem__(self, index: int | slice) -> Calibration | Self:
        frames = range(len(self))
        if isinstance(index, slice):
            return self._at(np.array(frames[index], dtype=np.intp))
        try:
            return self._frame(frames[index])
        except IndexError:
            raise IndexError(f"frame {index} is out of range: there are {len(self)} frames") from None

    def __iter__(self) -> Iterator[Calibration]:
        return (self._frame(t) for t in range(len(self)))

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        return self is other or self.to_dict() == other.to_dict()

    @property
    def cameras(self) -> list[Camera | None]:
        """Cameras of the frames; None for frames without one."""
        return [frame.camera for frame in self]


def read_record(record: Mapping[str, Any], what: str, version: int, read: Callable[[Mapping[str, Any]], T]) -> T:
    """Read the record of a sequence of frames by `read`.

    Raises
    ------
    ValueError
        If the record has another version, a key is missing, or a value is invalid.
    """
    try:
        if record["version"] != version:
            raise ValueError(
                f"expected {what} of version {version}, got {record['version']!r}: another fieldcalib wrote it, "
                f"use that or calibrate again"
            )
        return read(record)
    except KeyError as error:
        raise ValueError(f"is no calibration of {what}: the key {error} is missing") from None
    except (TypeError, AttributeError) as error:
        raise ValueError(f"is no calibration of {what}: {error}") from error
