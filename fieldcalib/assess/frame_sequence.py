"""A sequence of calibrations of the frames of a clip, each made on access."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, ClassVar, NamedTuple, Self, overload

import numpy as np

from fieldcalib._html import long_table, spread
from fieldcalib._json import reading
from fieldcalib._types import IntArray
from fieldcalib.assess.result import Calibration
from fieldcalib.geometry.camera import CAMERA_TITLES, Camera, camera_cells


class Codec(NamedTuple):
    """How an attribute is written to JSON, and read from it."""

    write: Callable[[Any], Any]
    read: Callable[[Any], Any]

    @property
    def or_none(self) -> Codec:
        """The codec of an attribute that may be None, which is null in JSON."""
        return Codec(
            lambda value: None if value is None else self.write(value),
            lambda value: None if value is None else self.read(value),
        )


class FrameSequence(Sequence[Calibration]):
    """A sequence of one calibration for each frame; subclasses store the frames.

    A slice is of the same class. Two sequences are equal if their `to_dict` is.
    """

    _what: ClassVar[str]
    """Noun for it in messages."""
    _version: ClassVar[int]
    """Version of its `to_dict`."""
    _codecs: ClassVar[Mapping[str, Codec]]
    """Its attributes in JSON."""
    _added: ClassVar[frozenset[str]] = frozenset()
    """Attributes that older files of this version lack, and that are None there."""

    @abstractmethod
    def _frame(self, t: int) -> Calibration:
        """The calibration of frame t."""

    @abstractmethod
    def _check(self) -> None:
        """Check attributes that were read; a ValueError if they do not fit together."""

    @abstractmethod
    def _at(self, index: IntArray) -> Self:
        """A sequence of some of the frames, in that order."""

    def to_dict(self) -> dict[str, Any]:
        """The calibration as a dict for `json.dumps`."""
        return {"version": self._version} | {name: one.write(getattr(self, name)) for name, one in self._codecs.items()}

    @classmethod
    def from_dict(cls, record: Mapping[str, Any]) -> Self:
        """The inverse of `to_dict`.

        Raises
        ------
        ValueError
            If the record has another version, a key is missing, or a value is invalid.
        """
        new: Callable[..., Self] = cls
        with reading(record, f"calibration of {cls._what}", cls._version):
            complete = {**dict.fromkeys(cls._added), **record}
            found = new(**{name: one.read(complete[name]) for name, one in cls._codecs.items()})
            found._check()
        return found

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

    def _repr_html_(self) -> str:
        """The field with what some frames see of it, and a table of these frames, for notebooks."""
        frames = {index: self[index] for index in spread(len(self))}
        cameras = [frame.camera for frame in frames.values() if frame.camera is not None]
        field = next((frame.field for frame in frames.values() if frame.field is not None), None)
        picture = "" if field is None else field.as_svg(cameras)
        rows = [
            [str(index), str(frame.verdict), *camera_cells(frame.camera), frame.reason]
            for index, frame in frames.items()
        ]
        return picture + long_table(["frame", "verdict", *CAMERA_TITLES, "reason"], rows, len(self))

    @property
    def cameras(self) -> list[Camera | None]:
        """Cameras of the frames; None for frames without one."""
        return [frame.camera for frame in self]
