"""Calibrations on their way from another process: what was solved together is sent once, not frame by frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from fieldcalib._types import Array
from fieldcalib.assess.camera_errors import NoErrors
from fieldcalib.assess.result import Calibration
from fieldcalib.assess.solved import Solved
from fieldcalib.fields.field import Field
from fieldcalib.problem.evaluation import Evaluation


@dataclass(frozen=True, eq=False)
class HandedOver:
    """Calibrations without what `uncertainty` is computed from, and that by itself."""

    calibrations: list[Calibration]
    solved: list[tuple[Evaluation, Array] | None]
    """What is computed from, and its unit: of the calibrations that share one, with the first of them alone."""
    frames: list[int | None]
    """Of each calibration in what is computed from, the last one up to it; None if there is nothing."""

    @classmethod
    def of(cls, calibrations: Sequence[Calibration]) -> HandedOver:
        """Calibrations of one field, as `calibrate_batch` gives them."""
        last: Evaluation | None = None
        solved: list[tuple[Evaluation, Array] | None] = []
        for one in calibrations:
            is_new = one.solved is not None and one.solved.evaluation is not last
            solved.append((one.solved.evaluation, one.solved.unit) if one.solved is not None and is_new else None)
            last = one.solved.evaluation if one.solved is not None else last
        bare = [replace(one, errors=NoErrors(), field=None) for one in calibrations]
        return cls(bare, solved, [None if one.solved is None else one.solved.frame for one in calibrations])

    def received(self, field: Field | None) -> list[Calibration]:
        """The calibrations as they were."""
        found: list[Calibration] = []
        last: tuple[Evaluation, Array] | None = None
        for one, solved, frame in zip(self.calibrations, self.solved, self.frames, strict=True):
            last = last if solved is None else solved
            whole = Solved(*last, frame) if last is not None and frame is not None else NoErrors()
            found.append(replace(one, errors=whole, field=None if one.camera is None else field))
        return found
