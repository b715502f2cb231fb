"""Points along the painted markings of a field, where lines are looked for in images."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from fieldcalib._types import Array, BoolArray, IntArray
from fieldcalib.fields.field import Field, ObjectSegments
from fieldcalib.fields.segments import outwards
from fieldcalib.fields.traits import SOCCER_SCALE, LineLook, Paint

POINT_SPACING = 1.0 / 160.0  # distance of points along a marking, in units of the field's scale
HIGHEST_NET = 2.0  # m: that of volleyball is higher
UPRIGHT = 0.5  # vertical share of the direction of posts; edges of nets sag by less


@dataclass(frozen=True)
class Markings:
    """Points along the middle of the paint of an object's markings, segment by segment."""

    labels: tuple[str, ...]
    member: IntArray
    """Index into `labels` of each point, (N,)."""
    X: Array
    """Points on the field, metres, (N, 3)."""
    along: Array
    """Unit vectors along the segments, (N, 3)."""
    on_ground: BoolArray
    """Whether the whole segment is on the ground, (N,)."""
    width: Array
    """Width of the paint, metres, (N,)."""
    inwards: Array
    """Vectors from the middle of the paint to the segment, which may be the edge of the paint, metres, (N, 3)."""
    is_arc: BoolArray
    """Whether each segment is an arc, (len(labels),)."""
    painted: Array
    """Share of each segment that is painted, less than 1 for dashes, (len(labels),)."""
    look: LineLook
    """Appearance of the lines."""

    @cached_property
    def net(self) -> tuple[str, ...]:
        """Labels of the edges of a low net across the middle of the field, which may be taken for lines on the ground.

        Examples
        --------
        >>> from fieldcalib.fields import tennis, volleyball
        >>> sorted(Markings.of(tennis()).net), Markings.of(volleyball()).net
        (['Net bottom', 'Net top'], ())
        """
        across = ~self.on_ground & (self.X[:, 0] == 0.0) & (np.abs(self.along[:, 2]) < UPRIGHT)
        is_low = np.min(self.X[across, 2], initial=0.0) > -HIGHEST_NET
        return tuple(self.labels[k] for k in np.unique(self.member[across])) if is_low else ()

    @classmethod
    def of(cls, object_segments: ObjectSegments) -> Markings:
        """Sample the markings painted along the segments of an object; a circle that has halves is taken once, whole.

        An object that is no `Field` gets the default `LineLook`. The markings of the last 16 fields are cached.
        """
        return _of_field(object_segments) if isinstance(object_segments, Field) else cls._along(object_segments)

    @classmethod
    def _along(cls, object_segments: ObjectSegments) -> Markings:
        look, scale = LineLook(), SOCCER_SCALE
        paint_of: Callable[[str], Paint] = dict.fromkeys(object_segments, Paint(width=look.width)).__getitem__
        if isinstance(object_segments, Field):
            look, scale = object_segments.lines, object_segments.scale
            paint_of = object_segments.paint_of
        whole = {segment.whole for segment in object_segments.values() if segment.is_whole}
        paint = {label: paint_of(label) for label in object_segments}
        markings = {
            label: segment
            for label, segment in object_segments.items()
            if segment.is_curve and (segment.is_whole or segment.whole not in whole) and paint[label].is_along
        }
        # a segment may be the edge of its paint: lines are looked for in the middle of the paint, `inwards` leads back
        points = [segment.sample(POINT_SPACING * scale) for segment in markings.values()]
        counts = [len(X) for X in points]
        member, X = np.repeat(np.arange(len(points)), counts), np.concatenate([np.zeros((0, 3)), *points])
        if isinstance(object_segments, Field):
            X = object_segments.terrain.raised(X)
        along, inwards = _along(member, X), np.zeros_like(X)
        for index, (label, segment) in enumerate(markings.items()):
            if paint[label].outwards:
                own = member == index
                inwards[own] = -paint[label].outwards * outwards(segment, X[own], along[own])
        return cls(
            tuple(markings),
            member,
            X - inwards,
            along,
            np.repeat(np.array([not np.any(X[:, 2]) for X in points], dtype=bool), counts),
            np.repeat(np.array([paint[label].width for label in markings], dtype=float), counts),
            inwards,
            np.array([segment.is_arc for segment in markings.values()], dtype=bool),
            np.array([paint[label].painted for label in markings], dtype=float),
            look,
        )


@lru_cache(maxsize=16)
def _of_field(field: Field) -> Markings:
    markings = Markings._along(field)
    for values in vars(markings).values():
        if isinstance(values, np.ndarray):
            values.flags.writeable = False
    return markings


def _along(member: IntArray, X: Array) -> Array:
    """Unit vectors (N, 3) along curves at their points X (N, 3), from one neighbour on the same curve to the other."""
    index = np.arange(len(X))
    before, after = np.maximum(index - 1, 0), np.minimum(index + 1, len(X) - 1)
    before, after = (np.where(member[at] == member, at, index) for at in (before, after))
    d = X[after] - X[before]
    return np.asarray(d / np.linalg.norm(d, axis=1, keepdims=True))
