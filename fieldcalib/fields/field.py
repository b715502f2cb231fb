"""A field: a calibration object that knows its size and its symmetry.

The symmetry is the 180-degree turn about the centre mark that maps the field onto itself.

World: origin at the centre mark, x right along the touchline as the main camera sees it, y towards the main camera,
z down, so that a crossbar is at z = -2.44.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType

import numpy as np

from fieldcalib.fields.segments import Arc, Point, Segment


@dataclass(frozen=True)
class Field(Mapping[str, Segment]):
    """A field: a mapping of labels to segments, with its size in metres.

    Labels are SoccerNet's without the trailing space that one of them has there ("Goal left post left "); looking a
    label up works with and without it.

    Examples
    --------
    >>> from fieldcalib import soccer
    >>> field = soccer()
    >>> field["Goal left post left "] == field["Goal left post left"]
    True
    >>> field.symmetric["Big rect. left top"]
    'Big rect. right bottom'
    """

    length: float
    width: float
    segments: Mapping[str, Segment] = field(repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "segments", MappingProxyType(dict(self.segments)))

    def __reduce__(self) -> tuple[type[Field], tuple[float, float, dict[str, Segment]]]:
        return Field, (self.length, self.width, dict(self.segments))  # a read-only view cannot be pickled

    def __getitem__(self, label: str) -> Segment:
        return self.segments[label.strip() if isinstance(label, str) else label]

    def __iter__(self) -> Iterator[str]:
        return iter(self.segments)

    def __len__(self) -> int:
        return len(self.segments)

    @cached_property
    def points(self) -> Mapping[str, Point]:
        """The named points alone."""
        return MappingProxyType({name: s for name, s in self.segments.items() if isinstance(s, Point)})

    @cached_property
    def markings(self) -> Mapping[str, Segment]:
        """Everything that is painted or stands on the field: lines, posts, crossbars, arcs; without the points."""
        return MappingProxyType({name: s for name, s in self.segments.items() if not isinstance(s, Point)})

    @cached_property
    def symmetric(self) -> Mapping[str, str]:
        """Label -> label of the same segment seen from the other side: the 180-degree turn about the centre mark.

        Segments of `with_segments` that have no counterpart are left out.
        """

        def key(segment: Segment, turn: float) -> tuple[object, ...]:
            X = segment.sample(spacing=0.05) * (turn, turn, 1.0)
            box = np.concatenate([X.min(axis=0), X.max(axis=0)]).round(2) + 0.0  # + 0.0: no negative zeros
            return (type(segment), *box.tolist())

        found: dict[tuple[object, ...], str] = {}
        for name, segment in self.segments.items():
            found.setdefault(key(segment, turn=1.0), name)  # the field's own name, should another one be added to it
        turned = {name: key(segment, turn=-1.0) for name, segment in self.segments.items()}
        return MappingProxyType({name: found[other] for name, other in turned.items() if other in found})

    @cached_property
    def self_symmetric(self) -> frozenset[str]:
        """Labels whose segments, as whole lines and circles, that turn maps onto themselves.

        Examples
        --------
        >>> from fieldcalib import soccer
        >>> sorted(soccer().self_symmetric)[:3]
        ['CENTER_MARK', 'Circle central', 'Circle central left']
        """

        def is_same(segment: Segment, other: Segment) -> bool:
            if isinstance(segment, Arc) and isinstance(other, Arc):
                return segment.center == other.center and segment.radius == other.radius
            return segment == other

        pairs = self.symmetric.items()
        return frozenset(label for label, other in pairs if is_same(self.segments[label], self.segments[other]))

    def with_segments(self, extra: Mapping[str, Segment]) -> Field:
        """The field with more segments: points of one's own, say, that are still points of a field.

        A plain dict of both is no `Field`, and cannot be calibrated with the default prior.

        Raises
        ------
        ValueError
            If the field has one of the names already.

        Examples
        --------
        >>> from fieldcalib import soccer
        >>> field = soccer().with_segments({"corner flag": Point((-52.5, -34.0, -1.5))})
        >>> field.length, field["corner flag"]
        (105.0, Point(X=(-52.5, -34.0, -1.5)))
        """
        names = {name.strip(): segment for name, segment in extra.items()}
        taken = sorted(names.keys() & self.segments.keys())
        if taken:
            raise ValueError(f"the field has a segment {taken[0]!r} already: give yours another name")
        return Field(self.length, self.width, {**self.segments, **names})
