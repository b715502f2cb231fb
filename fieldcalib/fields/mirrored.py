"""Halves of a field from one: most fields are mirrored, and rule books describe one half."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeAlias

from fieldcalib.fields.segments import Segment

Vector: TypeAlias = tuple[float, float, float]

LEFT_RIGHT, TOP_BOTTOM = ("right", "left"), ("bottom", "top")


def with_left(right: Mapping[str, Segment]) -> dict[str, Segment]:
    """Segments of the right half of a field, and those of the left one: "right" in their labels becomes "left".

    Raises
    ------
    ValueError
        If a label has no word "right" in it.

    Examples
    --------
    >>> with_left({"Goal line right": Line((20.0, -10.0, 0.0), (20.0, 10.0, 0.0))})["Goal line left"]
    Line(start=(-20.0, -10.0, 0.0), end=(-20.0, 10.0, 0.0))
    """
    return {**right, **_mirrored(right, (-1.0, 1.0, 1.0), *LEFT_RIGHT)}


def with_top(bottom: Mapping[str, Segment]) -> dict[str, Segment]:
    """Segments of the near half of a field, and those of the far one: "bottom" in their labels becomes "top".

    Raises
    ------
    ValueError
        If a label has no word "bottom" in it.

    Examples
    --------
    >>> with_top({"Corner arc bottom": Arc((20.0, 10.0, 0.0), 1.0, 0.0, 1.5)})["Corner arc top"].center
    (20.0, -10.0, 0.0)
    """
    return {**bottom, **_mirrored(bottom, (1.0, -1.0, 1.0), *TOP_BOTTOM)}


def _mirrored(segments: Mapping[str, Segment], signs: Vector, word: str, other: str) -> dict[str, Segment]:
    found = {}
    for label, segment in segments.items():
        words = label.split(" ")
        if word not in words:
            raise ValueError(f"expected the word {word!r} in the label of what is mirrored, got {label!r}")
        found[" ".join(other if one == word else one for one in words)] = segment.mirrored(signs)
    return found
