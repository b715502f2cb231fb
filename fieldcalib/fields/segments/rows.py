"""Labelled pixels of T frames on segments of one kind, padded to N pixels each, and how they are measured.

Ends of segments: pixels past an end have a second residual, their distance from it along the segment's image.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from fieldcalib._types import Array, BoolArray, IntArray
from fieldcalib.fields.segments.closest import ClosestPoints, View, at_points


class Ends(NamedTuple):
    """Which closest points lie past the end of their segment, and that end."""

    past: BoolArray
    """(T, N)."""
    X: Array
    """The nearest point of the segment, (T, N, 3)."""
    along: Array
    """Position of X along the segment, (T, N): 0 at its start, 1 at its end; 0 where the segment moves as a whole."""


@dataclass(frozen=True, eq=False)
class Rows(ABC):
    """Observed pixels on segments of one kind: the protocol of all kinds.

    A pixel has one residual, or one for each of the two axes: those of all pixels along x come first.
    """

    xy: Array
    """Pixels, (T, N, 2)."""
    weight: Array
    """(T, N); 0 where there is only padding."""
    label: IntArray
    """Index into `Observations.labels`, (T, N); -1 where there is only padding."""
    geometry: Array
    """Vectors that describe the segment in the world, (T, N, G, 3); each kind says which."""

    name: ClassVar[str]
    """Name in files."""
    vectors: ClassVar[int]
    """Least number of vectors that describe a segment, G."""
    components: ClassVar[int] = 1
    """Number of residuals of a pixel."""
    measures_labels: ClassVar[bool] = True
    """Whether these are the residuals of labelled pixels, and not further ones of some of them."""
    shares_noise: ClassVar[bool] = True
    """Whether the pixels of a segment share an error, as annotators keep to one side of a line."""
    compiled: ClassVar[tuple[str, ...]] = ()
    """Names of the compiled kinds of residuals, one for each component; none where NumPy alone measures them."""

    def __bool__(self) -> bool:
        return bool(self.xy.shape[1] > 0)

    @abstractmethod
    def closest_points(self, view: View) -> list[ClosestPoints]:
        """The closest points of all residuals, one for each component."""

    def past_ends(self, X: Array, spans: Array) -> Ends | None:
        """Which closest points X (T, N, 3) lie past an end; None where the kind has no ends.

        `spans` are those of the labels' segments (`Segment.span`), (L, 2).
        """
        return None

    @property
    def extent(self) -> tuple[Array, Array]:
        """Middle (T, N, 3) and length (T, N) of the segments, metres."""
        return self.geometry.mean(axis=2), np.linalg.norm(np.ptp(self.geometry, axis=2), axis=-1)

    def motion(self, of_ends: Array) -> Array:
        """Derivatives of the segments by the field's size, (T, N, 3, 2), from those of their ends, (L, 2, 3, 2)."""
        return self._between(of_ends, 0.5)

    def _between(self, of_ends: Array, share: Array | float) -> Array:
        start, end = of_ends[self.label, 0], of_ends[self.label, 1]
        return np.asarray(start + share * (end - start))

    def _each(self, part: Callable[[NDArray[Any]], NDArray[Any]]) -> Self:
        return type(self)(part(self.xy), part(self.weight), part(self.label), part(self.geometry))

    def take(self, index: IntArray | slice) -> Self:
        """The rows of frames `index`, in that order, repeated where `index` repeats."""
        return self._each(lambda values: values[index])

    def choose(self, rows: IntArray) -> Self:
        """The rows of each frame that `rows`, (T, N'), gives by index."""
        frame = np.arange(len(rows))[:, None]
        return self._each(lambda values: values[frame, rows])

    @property
    def trimmed(self) -> Self:
        """The rows without the padding at the end that all frames have."""
        count = int(np.max(np.sum(self.label >= 0, axis=1), initial=0))
        return self._each(lambda values: values[:, :count])

    def moved(self, offset: Array) -> Self:
        """Rows whose segments are displaced by (T, N, 3) metres."""
        geometry = self.geometry.copy()
        geometry[:, :, 0] += offset
        return replace(self, geometry=geometry)

    @classmethod
    def none(cls, frames: int, pixels: int = 0, vectors: int = 0) -> Self:
        """Rows of nothing but padding, with a finite geometry."""
        depth = vectors or cls.vectors
        geometry = np.empty((frames, pixels, depth, 3))
        geometry[:] = np.eye(3)[np.arange(depth) % 3]
        shape = frames, pixels
        return cls(np.zeros((*shape, 2)), np.zeros(shape), np.full(shape, -1), geometry)


class EndRows(Rows):
    """Pixels past the end of their segment (`fieldcalib.problem.evaluation`).

    The vectors of a row: the end X; the direction in the image along which the distance is measured, in the first two
    components; and in the first component the position of X along the segment, 0 or 1.
    """

    name, vectors = "ends", 3
    measures_labels = shares_noise = False
    compiled = ("ENDS",)

    def closest_points(self, view: View) -> list[ClosestPoints]:
        """The ends, measured along the directions of the rows."""
        along = np.ascontiguousarray(np.moveaxis(self.geometry[:, :, 1, :2], -1, 0))
        x, y = at_points(view, self.xy, self.geometry[:, :, 0])
        return [ClosestPoints(along[0] * x.r + along[1] * y.r, x.s, x.inverse_depth, along)]

    def motion(self, of_ends: Array) -> Array:
        """Derivatives of the ends by the size of the field, (T, N, 3, 2)."""
        return self._between(of_ends, self.geometry[:, :, 2, :1, None])
