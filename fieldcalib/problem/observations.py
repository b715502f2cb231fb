"""The labelled pixels of many frames, packed for the solvers.

Padded arrays (T, N, ...) hold the pixels of many frames and their segments, with a weight that is 0 where there is only
padding: one set of rows for each kind of segment (`fieldcalib.fields.segments.rows`). They are made of a flat table
(`fieldcalib.problem.labelled_pixels`), which is the form in which labelled pixels are handed on.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from fieldcalib._types import Array, BoolArray, IntArray
from fieldcalib.fields.field import ObjectSegments, terrain_of
from fieldcalib.fields.ground import Terrain
from fieldcalib.fields.segments import ROWS, EndRows, Rows, Segment
from fieldcalib.fields.segments.closest import ClosestPoints, View
from fieldcalib.problem.labelled_pixels import Pixels, PixelTable, PixelWeights

Kind = TypeVar("Kind", bound=Rows)


class Packable(Protocol):
    """The part of a segment that packing needs."""

    @property
    def rows(self) -> type[Rows]:
        """The class of rows that its labelled pixels are packed in."""

    @property
    def vectors(self) -> Array:
        """Vectors that describe it in these rows, (G, 3), see `Rows.geometry`."""


class FrameLabels(NamedTuple):
    """The labels of one frame, in the order in which they were given."""

    segments: dict[str, Segment]
    """Segment of each label."""
    equations: dict[str, int]
    """Largest number of equations that each label gives."""


@dataclass(frozen=True, eq=False)
class Observations:
    """The labelled pixels of T frames against one calibration object."""

    labels: tuple[str, ...]
    image_size: tuple[int, int]
    segments: tuple[Segment, ...]
    """Segments of the labels; empty if a file kept only the rows."""
    rank: IntArray
    """Order in which the labels of each frame were given, (T, L): ascending numbers, -1 for labels that it lacks."""
    rows: tuple[Rows, ...]
    """One set for each kind, in the order of `fieldcalib.fields.segments.ROWS`, the ends of segments last."""
    motion: Array | None = None
    """Derivatives of the labels' segments by the size of the field (`Field.motion`), (L, 2, 3, 2)."""
    terrain: Terrain | None = None
    """The ground that the segments stand on, of the field as given; None where it is level or unknown."""

    @classmethod
    def of(
        cls,
        object_segments: ObjectSegments,
        table: PixelTable,
        image_size: tuple[int, int],
        motion: Array | None = None,
    ) -> Observations:
        """Pack a table of labelled pixels; `motion` is `Field.motion`.

        Labels are numbered in the order of `object_segments`, whether frames are packed together or one by one.
        """
        labels, segments = tuple(object_segments), tuple(object_segments.values())
        rank, rows = packed(table.numbered(labels), segments)
        return cls(labels, image_size, segments, rank, rows, motion, terrain_of(object_segments))

    def __len__(self) -> int:
        return len(self.rank)

    def of_kind(self, kind: type[Kind]) -> Kind:
        """The rows of one kind."""
        rows = self.rows[ROWS.index(kind)]
        assert isinstance(rows, kind)
        return rows

    @property
    def ends(self) -> EndRows:
        """Rows of the pixels past the end of their segment (`fieldcalib.problem.evaluation`)."""
        return self.of_kind(EndRows)

    def with_ends(self, ends: EndRows) -> Observations:
        """The observations with these ends."""
        return replace(self, rows=(*self.rows[:-1], ends))

    @property
    def without_ends(self) -> Observations:
        """The observations without the rows of ends."""
        return self.with_ends(EndRows.none(len(self)))

    def take(self, index: IntArray | slice) -> Observations:
        """The observations of frames `index`, in that order, repeated where `index` repeats."""
        return replace(self, rank=self.rank[index], rows=tuple(rows.take(index) for rows in self.rows))

    @property
    def trimmed(self) -> Observations:
        """The observations without common padding and without labels that no frame has."""
        used = np.unique(self.label[self.label >= 0])
        number = np.full(len(self.labels) + 1, -1)  # the last entry is for padding
        number[used] = np.arange(len(used))
        rows = [rows.trimmed for rows in self.rows]
        return replace(
            self,
            labels=tuple(self.labels[index] for index in used),
            segments=tuple(self.segments[index] for index in used) if self.segments else (),
            rank=self.rank[:, used],
            rows=tuple(replace(one, label=number[one.label]) for one in rows),
            motion=None if self.motion is None else self.motion[used],
        )

    @cached_property
    def pixels(self) -> PixelTable:
        """The labelled pixels as a flat table, without the rows of ends; labels of a frame are in the order given."""
        seen = [(rows, np.nonzero(rows.label >= 0)) for rows in self.rows[:-1]]
        frame = np.concatenate([at[0] for _, at in seen])
        label, xy, weight = (
            np.concatenate([getattr(rows, name)[at] for rows, at in seen]) for name in ("label", "xy", "weight")
        )
        table = PixelTable(self.labels, len(self), frame, label, xy, weight)
        return table.take(np.lexsort((self.rank[frame, label], frame)))

    @cached_property
    def in_order(self) -> list[list[int]]:
        """Indices of the labels of each frame, in the order in which they were given."""
        orders, absent = np.argsort(self.rank, axis=1, kind="stable").tolist(), np.sum(self.rank < 0, axis=1).tolist()
        return [order[begin:] for order, begin in zip(orders, absent, strict=True)]

    def by_name(self, t: int, values: NDArray[Any]) -> dict[str, Any]:
        """Label -> its value, of `values` (L,), for the labels of frame t."""
        numbers = values.tolist()
        return {self.labels[index]: numbers[index] for index in self.in_order[t]}

    def labels_in(self, t: int) -> FrameLabels:
        """The labels of frame t."""
        segments = {self.labels[index]: self.segments[index] for index in self.in_order[t]}
        return FrameLabels(segments, self.by_name(t, self.equations[t]))

    @cached_property
    def equations(self) -> IntArray:
        """Largest number of equations from the distinct pixels of each label, (T, L) (`Segment.equations`)."""
        table, shape = self.pixels, self.rank.shape
        columns = np.column_stack([table.frame, table.label, table.xy])
        columns = columns[np.lexsort(columns.T[::-1])]
        is_new = np.any(np.diff(columns, axis=0, prepend=np.nan) != 0.0, axis=1)
        frame, label = columns[is_new, :2].astype(np.intp).T
        distinct = np.bincount(frame * shape[1] + label, minlength=self.rank.size).reshape(shape)
        found = np.zeros(shape, dtype=np.intp)
        t, index = np.nonzero(distinct)
        counts = list(zip(index.tolist(), distinct[t, index].tolist(), strict=True))
        equations = {(label, pixels): self.segments[label].equations(pixels) for label, pixels in set(counts)}
        found[t, index] = [equations[count] for count in counts]
        return found

    @cached_property
    def weigh_alike(self) -> BoolArray:
        """Whether all labels of a frame have weight 1, as by default, (T,)."""
        table, count = self.pixels, self.pixels_by_label
        differs = ~np.isclose(table.weight * count[table.frame, table.label], 1.0)
        return np.asarray(np.bincount(table.frame, differs, minlength=len(self)) == 0)

    def relabelled(self, label: IntArray) -> Observations:
        """The pixels under other labels: indices (P,) in the order of `pixels`; negative ones leave a pixel out.

        In frames where all labels weigh alike, the pixels of a new label share a weight of 1.
        """
        table = replace(self.pixels, label=label).take(label >= 0)
        key = table.frame * len(self.labels) + table.label
        _, inverse, count = np.unique(key, return_inverse=True, return_counts=True)
        weight = np.where(self.weigh_alike[table.frame], 1.0 / count[inverse], table.weight)
        return self.with_pixels(replace(table, weight=weight))

    def with_pixels(self, table: PixelTable) -> Observations:
        """Observations of other pixels on the same calibration object."""
        rank, rows = packed(table, self.segments)
        return replace(self, rank=rank, rows=rows)

    def without_labels(self, left_out: BoolArray) -> Observations:
        """Observations in which the labels `left_out` (T, L) have weight 0."""
        frame = np.arange(len(self))[:, None]
        return replace(
            self,
            rows=tuple(
                replace(rows, weight=np.where(left_out[frame, rows.label], 0.0, rows.weight)) for rows in self.rows
            ),
        )

    @cached_property
    def motion_of_rows(self) -> tuple[Array, ...]:
        """Derivatives of the segment of each pixel by the field's size, for each kind of rows (T, N, 3, 2).

        For a line they are those of its middle.
        """
        assert self.motion is not None
        return tuple(rows.motion(self.motion) for rows in self.rows)

    @cached_property
    def motion_of_residuals(self) -> Array:
        """Derivatives of the segment of each residual by the field's size, (T, M, 3, 2); 0 if that is known."""
        if self.motion is None:
            return np.zeros((*self.label.shape, 3, 2))
        return self._by_residual(self.motion_of_rows)

    @cached_property
    def compiled_kinds(self) -> tuple[tuple[str, ...], tuple[int, ...]]:
        """Names of the compiled kinds of residuals, and numbers of the rows that each is of."""
        kinds = [(name, k) for k, rows in enumerate(self.rows) for name in rows.compiled]
        return tuple(name for name, _ in kinds), tuple(k for _, k in kinds)

    @cached_property
    def are_compiled(self) -> bool:
        """Whether compiled code measures all residuals."""
        return all(rows.compiled for rows in self.rows if rows)

    @cached_property
    def compiled_rows(self) -> tuple[tuple[NDArray[Any], ...], ...]:
        """Pixels, weights, labels and geometry of the rows of the compiled kinds, contiguous in memory."""
        rows = [self.rows[k] for k in self.compiled_kinds[1]]
        arrays = ([getattr(one, name) for one in rows] for name in ("xy", "weight", "label", "geometry"))
        return tuple(tuple(map(np.ascontiguousarray, one)) for one in arrays)

    def closest_points(self, view: View) -> ClosestPoints:
        """The closest points of all residuals on the images of the segments, in the order of `weight`."""
        found = [part for rows in self.rows if rows for part in rows.closest_points(view)]
        return ClosestPoints.joined(found or self.rows[0].closest_points(view))

    def moved(self, change: Array) -> Observations:
        """Observations of fields whose length and width have changed by (T, 2) metres."""
        moves = [(motion @ change[:, None, :, None])[..., 0] for motion in self.motion_of_rows]
        return replace(self, rows=tuple(rows.moved(move) for rows, move in zip(self.rows, moves, strict=True)))

    @cached_property
    def columns(self) -> dict[type[Rows], slice]:
        """Slice of the residuals of each kind of rows among all M."""
        ends = np.cumsum([0, *self._residuals_of_rows]).tolist()
        return {type(rows): slice(*part) for rows, part in zip(self.rows, pairwise(ends), strict=True)}

    @cached_property
    def weight(self) -> Array:
        """Weight of every residual, (T, M): kind after kind, and in a kind component after component."""
        return self._by_residual([rows.weight for rows in self.rows])

    @cached_property
    def label(self) -> IntArray:
        """Label index of every residual, (T, M); -1 where there is only padding."""
        return np.asarray(self._by_residual([rows.label for rows in self.rows]), dtype=np.intp)

    @cached_property
    def shares_noise(self) -> BoolArray:
        """Whether a residual has noise in common with the others of its segment, (M,)."""
        return np.repeat([rows.shares_noise for rows in self.rows], self._residuals_of_rows)

    @cached_property
    def pixel_share(self) -> Array:
        """Share of each residual in a labelled pixel, (M,): 1/2 where the pixel has two, 0 for ends."""
        shares = [rows.measures_labels / rows.components for rows in self.rows]
        return np.repeat(shares, self._residuals_of_rows)

    @property
    def _residuals_of_rows(self) -> list[int]:
        return [rows.components * rows.xy.shape[1] for rows in self.rows]

    def by_label(self, values: Array) -> Array:
        """Sums of values (T, M) over the residuals of each label, (T, L)."""
        T, L = len(self), len(self.labels)
        seen = self.label >= 0
        index = (self.label + L * np.arange(T)[:, None])[seen]
        return np.asarray(np.bincount(index, values[seen], minlength=T * L), dtype=float).reshape(T, L)

    @cached_property
    def pixels_by_label(self) -> Array:
        """Number of pixels of each label, without the rows of ends, (T, L)."""
        return self.by_label(np.broadcast_to(self.pixel_share, self.label.shape))

    def _by_residual(self, of_rows: Iterable[NDArray[Any]]) -> NDArray[Any]:
        parts = [values for rows, values in zip(self.rows, of_rows, strict=True) for _ in range(rows.components)]
        return np.concatenate(parts, axis=1)


def pack(
    object_segments: ObjectSegments,
    frames: Sequence[Pixels],
    image_size: tuple[int, int],
    weights: Sequence[PixelWeights | None] | None = None,
    motion: Array | None = None,
) -> Observations:
    """Pack checked frames; `weights` are those of `check_weights`, `motion` is `Field.motion`."""
    return Observations.of(object_segments, PixelTable.of(object_segments, frames, weights), image_size, motion)


def packed(table: PixelTable, segments: Sequence[Packable]) -> tuple[IntArray, tuple[Rows, ...]]:
    """Pack a table: `Observations.rank`, and the rows of each kind, the pixels of a frame one after the other."""
    rank = np.full((table.count, len(segments)), -1)
    key, first = np.unique(table.frame * len(segments) + table.label, return_index=True)
    rank.flat[key] = first
    pixels = table.take(np.lexsort((rank[table.frame, table.label], table.frame)))  # label by label
    kind_of_label = np.array([ROWS.index(segment.rows) for segment in segments], dtype=np.intp)
    kind_of_pixel = kind_of_label[pixels.label]
    rows = []
    for k, kind in enumerate(ROWS):
        is_own = kind_of_pixel == k
        own = pixels.take(is_own) if np.any(is_own) else None
        rows.append(kind.none(table.count) if own is None else _rows_of_kind(kind, own, segments))
    return rank, tuple(rows)


def _rows_of_kind(kind: type[Kind], table: PixelTable, segments: Sequence[Packable]) -> Kind:
    """The rows of one kind, of pixels on segments of that kind."""
    vectors = {index: segments[index].vectors for index in dict.fromkeys(table.label.tolist())}
    depth = max(map(len, vectors.values()))
    geometry = np.zeros((max(vectors) + 1, depth, 3))
    for index, X in vectors.items():
        geometry[index, : len(X)], geometry[index, len(X) :] = X, X[-1]
    column = np.arange(len(table.frame)) - np.searchsorted(table.frame, table.frame)
    rows = kind.none(table.count, int(np.max(column)) + 1, depth)
    rows.xy[table.frame, column] = table.xy
    rows.weight[table.frame, column] = table.weight
    rows.label[table.frame, column] = table.label
    rows.geometry[table.frame, column] = geometry[table.label]
    return rows
