"""The frames of results: calibrated now and in memory, or in the files of a run."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property, lru_cache
from types import MappingProxyType
from typing import Any, Protocol, TypeVar

from fieldcalib.assess.result import Calibration
from fieldcalib.io.results import BROKEN, ResultFile, split_line
from fieldcalib.run_folder.outcome import calibration_line

EQ3 = "loss_ndc_eq3"  # key of the paper's loss
CACHED = 256  # calibrations that are kept once they were made or parsed: up to 100 kB each

Value = TypeVar("Value")


class FrameStore(Protocol):
    """Frames by their numbers."""

    @property
    def ids(self) -> Sequence[str]:
        """Ids of all frames in order, broken ones included."""

    @property
    def broken(self) -> Mapping[str, str]:
        """Problems of frames that could not be read, by id."""

    def main(self, number: int) -> Mapping[str, Any]:
        """The line of a frame in ``cameras.jsonl``."""

    def mains(self) -> Iterator[Mapping[str, Any]]:
        """The lines of all frames in ``cameras.jsonl``, in order."""

    def line(self, number: int) -> Mapping[str, Any]:
        """Everything that is kept of a frame."""

    def calibration(self, number: int) -> Calibration:
        """The calibration of a frame that is not broken."""


class KeptFrames:
    """Frames that were calibrated now.

    Parameters
    ----------
    ids : sequence of str
        Of all frames in order.
    calibrations : sequence of Calibration
        Of the frames that could be read, in order.
    broken : mapping of str to str
        Problems of the others, by id.
    details : mapping of str to mapping
        More keys of the lines of frames, by id.
    """

    def __init__(
        self,
        ids: Sequence[str],
        calibrations: Sequence[Calibration],
        broken: Mapping[str, str] = MappingProxyType({}),
        details: Mapping[str, Mapping[str, Any]] = MappingProxyType({}),
    ) -> None:
        self.ids, self.broken, self._details = ids, broken, details
        readable = (number for number, id in enumerate(ids) if id not in broken)
        self._by_number = dict(zip(readable, range(len(calibrations)), strict=True))
        self._calibration = lru_cache(CACHED)(lambda number: calibrations[self._by_number[number]])
        self._line = lru_cache(CACHED)(self._made_line)

    def main(self, number: int) -> Mapping[str, Any]:
        """The line of a frame in ``cameras.jsonl``."""
        return split_line(self.line(number))[0]

    def mains(self) -> Iterator[Mapping[str, Any]]:
        """The lines of all frames in ``cameras.jsonl``, in order."""
        return map(self.main, range(len(self.ids)))

    def line(self, number: int) -> Mapping[str, Any]:
        """Everything that is kept of a frame."""
        return self._line(number)

    def calibration(self, number: int) -> Calibration:
        """The calibration of a frame that is not broken."""
        return self._calibration(number)

    def details(self, id: str) -> dict[str, Any]:
        """More keys of the line of a frame."""
        return dict(self._details.get(id, {}))

    def _made_line(self, number: int) -> Mapping[str, Any]:
        id = self.ids[number]
        if id in self.broken:
            return {"id": id, "status": BROKEN, "message": self.broken[id]}
        details = self.details(id)
        line = calibration_line(id, self.calibration(number), details.pop(EQ3, None)) | details
        return json.loads(json.dumps(line))  # type: ignore[no-any-return]


class StoredFrames:
    """Frames in the files of a run, parsed when they are asked for."""

    def __init__(self, file: ResultFile) -> None:
        self.file, self.ids = file, file.ids
        self._calibration = lru_cache(CACHED)(file.calibration)

    @cached_property
    def broken(self) -> Mapping[str, str]:
        """Problems of frames that could not be read, by id."""
        return {self.ids[number]: self.main(number)["message"] for number in sorted(self.file.broken)}

    def main(self, number: int) -> Mapping[str, Any]:
        """The line of a frame in ``cameras.jsonl``."""
        return self.file.main(number)

    def mains(self) -> Iterator[Mapping[str, Any]]:
        """The lines of all frames in ``cameras.jsonl``, in order."""
        return self.file.mains()

    def line(self, number: int) -> Mapping[str, Any]:
        """Everything that is kept of a frame."""
        return self.file.line(number)

    def calibration(self, number: int) -> Calibration:
        """The calibration of a frame that is not broken."""
        return self._calibration(number)


class Lazy(Mapping[str, Value]):
    """A mapping of ids to values that are made when they are asked for."""

    def __init__(self, numbers: Mapping[str, int], value: Callable[[int], Value]) -> None:
        self._numbers, self._value = numbers, value

    def __getitem__(self, id: str) -> Value:
        return self._value(self._numbers[id])

    def __iter__(self) -> Iterator[str]:
        return iter(self._numbers)

    def __len__(self) -> int:
        return len(self._numbers)

    def __contains__(self, id: object) -> bool:
        return id in self._numbers

    def __repr__(self) -> str:
        return f"<{len(self)} values by id>"


class LazyList(Sequence[Value]):
    """A sequence of values that are made when they are asked for."""

    def __init__(self, count: int, value: Callable[[int], Value]) -> None:
        self._count, self._value = count, value

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, slice):
            return [self._value(number) for number in range(self._count)[index]]
        return self._value(range(self._count)[index])

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Sequence):
            return NotImplemented
        return len(self) == len(other) and all(a == b for a, b in zip(self, other, strict=True))

    __hash__ = None  # type: ignore[assignment]
