"""Frames of one camera that were solved together, and cameras from which they are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from fieldcalib._types import Array, BoolArray, IntArray
from fieldcalib.assess.level import if_level
from fieldcalib.assess.misfit import Misfit, misfit
from fieldcalib.assess.result import Calibration
from fieldcalib.problem.evaluation import Evaluation
from fieldcalib.problem.layout import CENTER, Layout, Role
from fieldcalib.solve.joint_problem import labels_of
from fieldcalib.solve.tripod import Labels, PixelNoise


@dataclass(frozen=True, eq=False)
class SolvedTogether:
    """Frames that were solved together."""

    index: IntArray
    """Which they are, (B,)."""
    evaluation: Evaluation
    whole: Array
    """Covariance of what they share, and then of what is kept of the field's size, (S + c, S + c)."""
    noise: PixelNoise
    labelled: int
    """How many of them have labels that took part."""

    @cached_property
    def misfit(self) -> Misfit:
        """Misfit of their labels."""
        return misfit(self.evaluation)

    @property
    def layout(self) -> Layout:
        """Layout of their parameters."""
        return self.evaluation.problem.layout

    @property
    def covariance(self) -> Array:
        """Covariance of what they share, (S, S)."""
        shared = int(np.count_nonzero(self.layout.shared))
        return self.whole[:shared, :shared]

    @property
    def covariance_if_level(self) -> Array:
        """Covariance of what they share if the field were known to be level, (S, S)."""
        layout = self.layout
        index = np.concatenate([np.flatnonzero(layout.roles == role) for role in (Role.SHARED, Role.CONSIDERED)])
        shared = len(self.covariance)
        return if_level(self.whole, layout.is_crown[index])[:shared, :shared]

    @property
    def is_tied(self) -> BoolArray:
        """Which of them are tied to others, (B,)."""
        pairs = self.evaluation.problem.background
        tied = np.zeros(len(self.index), dtype=bool)
        if pairs is not None:
            tied[pairs.first] = tied[pairs.second] = True
        return tied

    @property
    def cameras(self) -> dict[int, Array]:
        """Parameters of the frames that are tied."""
        return {int(self.index[k]): self.evaluation.theta[k] for k in np.flatnonzero(self.is_tied)}


class Start(NamedTuple):
    """Cameras of some frames, from which they are solved together."""

    layout: Layout
    theta: Mapping[int, Array]
    """Parameters (n,), by frame."""
    labels: Mapping[int, Labels]
    """Labels of some of these frames."""

    @classmethod
    def of(cls, found: Mapping[int, Calibration]) -> Start | None:
        """Start from frames that were calibrated by themselves; None without any."""
        parts = {t: c.solved.alone.evaluation for t, c in found.items() if c.solved is not None}
        if not parts:
            return None
        layout = next(iter(parts.values())).problem.layout
        return cls(
            layout, {t: part.theta[0] for t, part in parts.items()}, {t: labels_of(part) for t, part in parts.items()}
        )

    def moved(self, centre: Array, size: tuple[float, float]) -> Start:
        """At another centre (3,), with a field whose length and width are so much larger."""
        theta, model = {t: one.copy() for t, one in self.theta.items()}, self.layout.field_size
        for one in theta.values():
            one[CENTER] = centre
            if model is not None:
                block = self.layout.field_size_block
                one[block] = np.clip(one[block] + size, *model.limits)
        return self._replace(theta=theta)
