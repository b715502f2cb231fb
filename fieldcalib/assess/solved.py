"""Errors of a frame that was solved by itself or in a batch, computed from its problem at the solution."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from fieldcalib._json import to_json
from fieldcalib._types import Array
from fieldcalib.assess.cropping_evidence import (
    SQUASHED_LOG_ODDS,
    Picture,
    differs_in_aspect,
    log_ratio_of_cut,
    seems_part,
)
from fieldcalib.assess.findings import Finding
from fieldcalib.assess.probability import OddsTerms, odds_terms, probability_right, surprises
from fieldcalib.assess.uncertainty import Uncertainty, uncertainties
from fieldcalib.fields.field import Field
from fieldcalib.geometry.camera import Camera
from fieldcalib.problem.evaluation import Evaluation, evaluate
from fieldcalib.problem.pixel_table import PixelTable
from fieldcalib.problem.records import check_parameters, problem_from_record, problem_to_record, sized


class Solved:
    """One of B solved frames. Its errors are computed when they are first needed, and cached.

    It is copied, pickled and written without the other frames.

    Parameters
    ----------
    evaluation : Evaluation
        B frames at their solutions.
    unit : (B, n) array
        Standard deviations in whose units information is measured.
    frame : int
        Index of the frame.
    """

    are_known = True

    def __init__(self, evaluation: Evaluation, unit: Array, frame: int = 0) -> None:
        self.evaluation, self.unit, self.frame = evaluation, unit, frame
        # cached: the uncertainty, the one on the last field that was asked for, and the terms of the log odds there
        self._uncertainty: Uncertainty | None = None
        self._on: Uncertainty | None = None
        self._terms: tuple[Field, tuple[OddsTerms, OddsTerms]] | None = None

    @staticmethod
    def compute(several: Sequence[Solved], field: Field | None = None) -> None:
        """Compute and cache the uncertainties of frames of one evaluation, all at once.

        On a field with a probability model, compute the terms of their log odds of being right too.
        """
        first, index = several[0], np.array([one.frame for one in several])
        found = uncertainties(first.evaluation.take(index).trimmed, first.unit[index])
        for one, uncertainty in zip(several, found, strict=True):
            one._uncertainty = uncertainty
        if field is not None and field.probability is not None:
            for one, terms in zip(several, odds_terms(found, field), strict=True):
                one._terms = field, terms

    @property
    def alone(self) -> Solved:
        """The frame without the others and their padding."""
        one = np.array([self.frame])
        return Solved(self.evaluation.take(one).trimmed, self.unit[one])

    @property
    def pixels(self) -> PixelTable:
        """The labelled pixels of the frame, and the weights that it was solved with."""
        return self.evaluation.problem.observations.take(np.array([self.frame])).pixels

    @property
    def camera(self) -> Camera:
        """The camera as it was solved: of a squashed or cropped picture that of its frame with square pixels."""
        return self.evaluation.problem.layout.camera(self.evaluation.theta[self.frame])

    @property
    def are_computed(self) -> bool:
        """Whether the uncertainty is cached."""
        return self._uncertainty is not None

    @property
    def uncertainty(self) -> Uncertainty:
        """The estimate of the frame with no field in view: its errors are relative to the centre mark."""
        if self._uncertainty is None:
            self.compute([self])
        assert self._uncertainty is not None
        return self._uncertainty

    def on(self, field: Field | None) -> Uncertainty:
        """The estimate of the frame with this field in view."""
        if self._on is None or self._on.field is not field:
            self._on = self.uncertainty.on(field)
        return self._on

    def probability(self, field: Field, metres: float, *, size_known: bool, level: bool) -> float:
        """Probability that no point of the field in view is off by more than `metres`, by the labels."""
        assert field.probability is not None
        if self._terms is None or self._terms[0] is not field:
            self._terms = field, odds_terms([self.uncertainty], field)[0]
        rows, weights = self._terms[1][bool(level or size_known)]
        if size_known:
            rows, weights = rows[:1], np.ones(1)
        return probability_right(field.probability, rows, weights, metres)

    def doubts(self, picture: Picture | None) -> tuple[Finding, ...]:
        """Evidence of the labels against an ordinary camera and, if a picture is given, against a whole frame."""
        unusual = surprises(self.uncertainty)
        if picture is None:
            return unusual
        solved = self.uncertainty.camera  # in a frame with square pixels
        log_ratio = SQUASHED_LOG_ODDS * differs_in_aspect(picture.camera, solved)
        if picture.are_annotated:
            log_ratio += log_ratio_of_cut(picture.field, self.pixels.by_label(0), solved)
        part = seems_part(self.on(picture.field), picture.probability, log_ratio, picture.declared)
        return (*part, *unusual)

    def to_record(self) -> dict[str, Any]:
        """The keys of `Calibration.to_dict` that hold it."""
        return {"solved": self.to_dict()}

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
        problem = problem_from_record(record["problem"])
        theta, unit = (sized(record[name], (problem.layout.size,), repr(name))[None] for name in ("theta", "unit"))
        check_parameters(problem.layout, theta)
        return cls(evaluate(problem, theta), unit)

    def __reduce__(self) -> tuple[Callable[..., Solved], tuple[dict[str, Any]]]:
        return Solved.from_dict, (self.to_dict(),)
