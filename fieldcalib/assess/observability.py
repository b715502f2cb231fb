"""Observability: directions of the parameters that the labels determine, for verdict, messages and uncertainty.

The information of the labels is ``J^T W J``, with the solver's weights of the residuals, in which a segment counts as
one pixel. Its unit is the information of the prior: where it is 1, labels and prior count equally.
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
    """A direction of the parameters, and the information of the labels about it."""

    information: float
    """Information from the labels, in units of the prior's: below 1 the prior dominates."""
    parameters: str
    """The parameters that make up the direction, as "focal length with y"."""

    @property
    def share(self) -> float:
        """Share of the estimate along this direction that comes from the labels; the rest comes from the prior."""
        return self.information / (1.0 + self.information)


@dataclass(frozen=True, eq=False)
class Information:
    """Information from the labels of B frames about P free parameters."""

    matrix: Array
    """Information (B, P, P) in units of the prior's."""
    names: tuple[str, ...]
    """Names of the P parameters."""
    has_prior: bool

    @classmethod
    def of(cls, evaluation: Evaluation, unit: Array) -> Information:
        """The information at the cameras of an evaluation, in units of the standard deviations `unit` (B, P)."""
        layout = evaluation.problem.layout
        names = tuple(READABLE.get(name, name) for name, free in zip(layout.names, layout.free, strict=True) if free)
        matrix = evaluation.information * unit[:, :, None] * unit[:, None, :]
        return cls(matrix, names, evaluation.problem.prior is not None)

    def take(self, frames: slice) -> Information:
        """The information of some of the frames."""
        return Information(self.matrix[frames], self.names, self.has_prior)

    def about(self, some: BoolArray) -> Information:
        """The information about some of the parameters (P,), the others being free: the Schur complement."""
        if np.all(some):
            return self
        own = self.matrix[:, some][:, :, some]
        if self.has_prior:
            cross = self.matrix[:, some][:, :, ~some]
            rest = self.matrix[:, ~some][:, :, ~some] + np.eye(int(np.count_nonzero(~some)))
            try:
                own = own - cross @ np.linalg.solve(rest, np.swapaxes(cross, 1, 2))
            except np.linalg.LinAlgError:  # so much information along some directions that 1 is rounded away
                own = own - cross @ np.linalg.pinv(rest, hermitian=True) @ np.swapaxes(cross, 1, 2)
        names = tuple(name for name, wanted in zip(self.names, some, strict=True) if wanted)
        return Information(own, names, self.has_prior)

    @cached_property
    def eigen(self) -> tuple[Array, Array]:
        """Eigenvalues (B, P) of the information, ascending, and its eigenvectors as columns (B, P, P)."""
        values, vectors = np.linalg.eigh(self.matrix)
        return np.maximum(values, 0.0), vectors

    def directions(self, frame: int) -> tuple[Direction, ...]:
        """The directions of one frame, least determined by the labels first."""
        return tuple(self._direction(frame, k) for k in range(len(self.names)))

    def weakest(self, frame: int) -> Direction:
        """The direction that the labels of one frame determine least."""
        return self._direction(frame, 0)

    def _direction(self, frame: int, k: int) -> Direction:
        value, size = self.eigen[0][frame, k], np.abs(self.eigen[1][frame, :, k])
        return Direction(float(value), " with ".join(np.array(self.names)[size > 0.5 * size.max()]))
