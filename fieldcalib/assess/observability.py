"""What the labels determine: the one answer that verdict, messages and uncertainty share.

The information of the labels is ``J^T W J`` with the weights that the solver gave the residuals, each segment counting
as one pixel, in units of the prior's: along a direction where it is 1, labels and prior say equally much.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fieldcalib._types import Array, BoolArray
from fieldcalib.geometry.lens import LENSES
from fieldcalib.problem.evaluation import Evaluation

READABLE = {"log f": "focal length", "log aspect": "aspect ratio"} | {
    name: opencv for lens in LENSES.values() for name, opencv in zip(lens.names, lens.opencv_names, strict=True)
}
OPEN_DIRECTION = 1e-3  # information from the labels, in units of the prior's, below which a direction counts as open


@dataclass(frozen=True)
class Direction:
    """A direction of the parameters, and how much the labels say about it."""

    information: float
    """Of the labels, in units of the prior's: below 1 the prior says more than they do."""
    parameters: str
    """What makes it up, as "focal length with y"."""

    @property
    def share(self) -> float:
        """Share of the estimate along this direction that comes from the labels, the rest being the prior's."""
        return self.information / (1.0 + self.information)


@dataclass(frozen=True, eq=False)
class Information:
    """What the labels of B frames say about the free parameters."""

    matrix: Array
    """(B, P, P) in units of the prior's."""
    names: tuple[str, ...]
    """Of the P parameters."""
    has_prior: bool

    @classmethod
    def of(cls, evaluation: Evaluation, unit: Array) -> Information:
        """At the cameras of an evaluation, in units of the standard deviations `unit` (B, P)."""
        layout = evaluation.problem.layout
        names = tuple(READABLE.get(name, name) for name, free in zip(layout.names, layout.free, strict=True) if free)
        matrix = evaluation.information * unit[:, :, None] * unit[:, None, :]
        return cls(matrix, names, evaluation.problem.prior is not None)

    def take(self, frames: slice) -> Information:
        """What those of some frames say."""
        return Information(self.matrix[frames], self.names, self.has_prior)

    def about(self, some: BoolArray) -> Information:
        """About some of the parameters (P,), the others being under their prior: the Schur complement."""
        if np.all(some):
            return self
        own = self.matrix[:, some][:, :, some]
        if self.has_prior:
            cross = self.matrix[:, some][:, :, ~some]
            rest = self.matrix[:, ~some][:, :, ~some] + np.eye(int(np.count_nonzero(~some)))
            own = own - cross @ np.linalg.solve(rest, np.swapaxes(cross, 1, 2))
        names = tuple(name for name, wanted in zip(self.names, some, strict=True) if wanted)
        return Information(own, names, self.has_prior)

    @cached_property
    def eigen(self) -> tuple[Array, Array]:
        """Information along its own directions (B, P), ascending, and these as columns (B, P, P)."""
        values, vectors = np.linalg.eigh(self.matrix)
        return np.maximum(values, 0.0), vectors

    def directions(self, frame: int) -> tuple[Direction, ...]:
        """The directions of one frame, what the labels determine least first."""
        values, vectors = self.eigen
        return tuple(
            Direction(float(value), self._named(vector))
            for value, vector in zip(values[frame], vectors[frame].T, strict=True)
        )

    def weakest(self, frame: int) -> Direction:
        """What the labels of one frame determine least."""
        values, vectors = self.eigen
        return Direction(float(values[frame, 0]), self._named(vectors[frame, :, 0]))

    def _named(self, vector: Array) -> str:
        names = np.array(self.names)
        return " with ".join(names[np.abs(vector) > 0.5 * np.abs(vector).max()])
