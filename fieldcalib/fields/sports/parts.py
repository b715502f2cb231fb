"""A field from its right bottom quarter: mirrored markings, and paint by the beginnings of labels.

Lines of courts: from side to side, from end to end, on the ground and upright.

Goals, and the check of a size that a user gives.

A whole field from a quarter of it: most fields are mirrored, and rule books describe one half.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import groupby
from types import MappingProxyType
from typing import Any

import numpy as np

from fieldcalib._types import is_number
from fieldcalib.fields.field import Field
from fieldcalib.fields.segments import Line, Segment
from fieldcalib.fields.segments.segment import Vector
from fieldcalib.fields.traits import LineLook, Paint

CENTRE = (0.0, 0.0, 0.0)

NONE: Mapping[str, Segment] = MappingProxyType({})


def across(x: float, y: float, z: float = 0.0) -> Line:
    """The line at x from -y to y, metres.

    Examples
    --------
    >>> across(14.0, 7.5)
    Line(start=(14.0, -7.5, 0.0), end=(14.0, 7.5, 0.0))
    """
    return Line((x, -y, z), (x, y, z))


def along(x: float, y: float) -> Line:
    """The line at y from -x to x, metres.

    Examples
    --------
    >>> along(14.0, 7.5)
    Line(start=(-14.0, 7.5, 0.0), end=(14.0, 7.5, 0.0))
    """
    return Line((-x, y, 0.0), (x, y, 0.0))


def on_ground(start: tuple[float, float], end: tuple[float, float]) -> Line:
    """The line on the ground from one (x, y) to another, metres.

    Examples
    --------
    >>> on_ground((14.0, 7.5), (14.0, 9.0))
    Line(start=(14.0, 7.5, 0.0), end=(14.0, 9.0, 0.0))
    """
    return Line((*start, 0.0), (*end, 0.0))


def upright(x: float, y: float, top: float) -> Line:
    """The vertical line at (x, y) from a height down to the ground, metres.

    Examples
    --------
    >>> upright(20.0, 1.5, 2.0)
    Line(start=(20.0, 1.5, -2.0), end=(20.0, 1.5, 0.0))
    """
    return Line((x, y, -top), (x, y, 0.0))


def right_goal(x: float, width: float, height: float, thickness: float) -> dict[str, Segment]:
    """Crossbar and near post of the right goal, whose middles stand on the line x.

    Width is measured between the posts, height under the crossbar; `thickness` is theirs; all in metres.

    Examples
    --------
    >>> right_goal(20.0, 3.0, 2.0, 0.08)["Goal right post bottom"]
    Line(start=(20.0, 1.54, -2.04), end=(20.0, 1.54, 0.0))
    """
    y, top = 0.5 * (width + thickness), height + 0.5 * thickness
    return {"Goal right crossbar": across(x, y, -top), "Goal right post bottom": upright(x, y, top)}


def mirrored(*parts: Mapping[str, Segment]) -> dict[str, Segment]:
    """Segments, each part followed by its mirror images.

    "bottom" in a label becomes "top", the far side, and "right" becomes "left". A segment with both words in its label
    gives four, one with neither only itself. Images that are among the segments already are kept.

    Examples
    --------
    >>> from fieldcalib import Point
    >>> list(mirrored({"Centre mark": Point((0.0, 0.0, 0.0)), "Corner right bottom": Point((9.0, 9.0, 0.0))}))
    ['Centre mark', 'Corner right bottom', 'Corner right top', 'Corner left bottom', 'Corner left top']
    """
    whole: dict[str, Segment] = {}
    for part in parts:
        found: dict[str, Segment] = {}
        for _, run in groupby(part.items(), key=lambda item: "bottom" in item[0].split(" ")):
            found |= with_top(dict(run), part)
        whole |= found | _images(found, "right", "left", (-1.0, 1.0, 1.0), found)
    return whole


def with_top(segments: Mapping[str, Segment], given: Mapping[str, Segment] = NONE) -> dict[str, Segment]:
    """Segments, and the far-side images of those with "bottom" in their labels, except images in `given`."""
    return {**segments, **_images(segments, "bottom", "top", (1.0, -1.0, 1.0), given)}


def _images(
    segments: Mapping[str, Segment], word: str, other: str, signs: Vector, given: Mapping[str, Segment]
) -> dict[str, Segment]:
    """Mirror images of the segments that have a word in their labels, except images in `given`."""
    words = {label: label.split(" ") for label in segments}
    images = {label: " ".join(other if one == word else one for one in words[label]) for label in segments}
    return {
        images[label]: segment.mirrored(signs)
        for label, segment in segments.items()
        if word in words[label] and images[label] not in given
    }


def court(
    size: tuple[float, float],
    *parts: Mapping[str, Segment],
    line_width: float,
    paint: Mapping[str, Paint] = MappingProxyType({}),
    **known: Any,
) -> Field:
    """A field from the segments of one quarter.

    Parameters
    ----------
    size : (float, float)
        Length and width, metres.
    *parts : mappings of str to segment
        The right bottom quarter, in parts: each is followed by its mirror images (`mirrored`).
    line_width : float
        Metres.
    paint : mapping of str to Paint
        Beginning of labels -> the paint of their segments.
    **known
        Other parameters of `Field`; by default the size is known, and a line may be the border of a painted area.

    Examples
    --------
    >>> from fieldcalib.fields.sports.parts import across
    >>> list(court((20.0, 10.0), {"End line right": across(10.0, 5.0)}, line_width=0.05))
    ['End line right', 'End line left']
    """
    (length, width), whole = size, mirrored(*parts)
    defaults: dict[str, Any] = {
        "lines": LineLook(width=line_width, ground_difference=np.inf),
        "paint": {label: one for start, one in paint.items() for label in whole if label.startswith(start)},
        "size_known": True,
    }
    return Field(float(length), float(width), whole, **(defaults | known))


def check_size(
    pitch: str, size: tuple[float, float], marks: str, least: tuple[float, float], largest: float, usual: str
) -> None:
    """Check the length and width of a pitch, metres.

    Raises
    ------
    ValueError
        If they are no numbers, not above the `least` ones that its `marks` need, or larger than any.

    Examples
    --------
    >>> check_size("court", (40.0, 9.0), "goal areas", (12.0, 15.0), 60.0, "about 40 x 20")
    Traceback (most recent call last):
        ...
    ValueError: a court of 40.0 x 9.0 m has no room for its goal areas: expected metres, about 40 x 20
    """
    length, width = size
    if not (is_number(length) and is_number(width)):
        raise ValueError(f"expected length and width as numbers of metres, got {length!r} and {width!r}")
    if not (length > least[0] and width > least[1]):  # nor NaN
        raise ValueError(f"a {pitch} of {length} x {width} m has no room for its {marks}: expected metres, {usual}")
    if max(size) > largest:
        in_metres = f"expected metres (not centimetres or feet), {usual}"
        raise ValueError(f"a {pitch} of {length} x {width} m is larger than any: {in_metres}")
