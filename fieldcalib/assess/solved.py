"""What the uncertainty of a calibration is computed from: its problem at the solution."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Any

import numpy as np

from fieldcalib._json import from_json, to_json
from fieldcalib._types import Array
from fieldcalib.assess.uncertainty import Uncertainty, uncertainties
from fieldcalib.problem.evaluation import Evaluation, evaluate
from fieldcalib.problem.records import problem_from_record, problem_to_record


class Solved:
    """Solved problems, of which `uncertainty` looks at one when it is asked.

    It is copied, pickled and written as one frame alone.

    Parameters
    ----------
    evaluation : Evaluation
        B frames at their solutions.
    unit : (B, n) array
        Standard deviations on which a parameter counts as determined.
    frame : int
        Which of them.
    """

    def __init__(self, evaluation: Evaluation, unit: Array, frame: int = 0) -> None:
        self.evaluation = evaluation
        self.unit = unit
        self.frame = frame

    @property
    def alone(self) -> Solved:
        """The frame without the others that it was solved with, and without the labels that it does not have."""
        one = np.array([self.frame])
        return Solved(self.evaluation.take(one).trimmed, self.unit[one])

    @cached_property
    def uncertainty(self) -> Uncertainty:
        """How far the camera of the frame may be off."""
        alone = self.alone
        (found,) = uncertainties(alone.evaluation, alone.unit)
        return found

    def to_dict(self) -> dict[str, Any]:
        """The problem of the frame and its solution, for `json.dumps`."""
        return {
            "problem": problem_to_record(self.evaluation.problem, self.frame),
            "theta": to_json(self.evaluation.theta[self.frame]),
            "unit": to_json(self.unit[self.frame]),
        }

    @classmethod
    def from_dict(cls, record: Mapping[str, Any]) -> Solved:
        """The inverse of `to_dict`: the closest points are searched again."""
        theta = from_json(record["theta"])[None]
        return cls(evaluate(problem_from_record(record["problem"]), theta), from_json(record["unit"])[None])

    def __reduce__(self) -> tuple[Callable[..., Solved], tuple[dict[str, Any]]]:
        return Solved.from_dict, (self.to_dict(),)
