"""Calibrations packed for transfer from another process: solver state that several of them share is pickled once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from fieldcalib._types import Array
from fieldcalib.assess.camera_errors import NoErrors
from fieldcalib.assess.result import Calibration
from fieldcalib.assess.solved import Solved
from fieldcalib.fields.field import Field
from fieldcalib.problem.evaluation import Evaluation


@dataclass(frozen=True, eq=False)
class PackedCalibrations:
    """Calibrations without solver state; the shared state is stored once."""

    calibrations: Sequence[Calibration]
    """The calibrations without solver state and field."""
    states: Mapping[int, tuple[Evaluation, Array]]
    """Solver states, each with the unit of its parameters."""
    places: Sequence[tuple[int, int] | None]
    """Index of each calibration's state and of its frame therein; None without solver state."""

    @classmethod
    def of(cls, calibrations: Sequence[Calibration]) -> PackedCalibrations:
        """Pack calibrations of one field, as `calibrate_batch` returns them."""
        solved = [one.solved for one in calibrations]
        return cls(
            [replace(one, errors=NoErrors(), field=None) for one in calibrations],
            {id(one.evaluation): (one.evaluation, one.unit) for one in solved if one is not None},
            [None if one is None else (id(one.evaluation), one.frame) for one in solved],
        )

    def unpacked(self, field: Field | None) -> list[Calibration]:
        """The calibrations with solver state and field."""
        return [
            replace(
                one,
                errors=NoErrors() if place is None else Solved(*self.states[place[0]], place[1]),
                field=None if one.camera is None else field,
            )
            for one, place in zip(self.calibrations, self.places, strict=True)
        ]
