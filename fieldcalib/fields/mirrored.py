"""A whole field from a quarter of it: most fields are mirrored, and rule books describe one half."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import groupby
from types import MappingProxyType

from fieldcalib.fields.segments import Segment
from fieldcalib.fields.segments.segment import Vector

NONE: Mapping[str, Segment] = MappingProxyType({})


def mirrored(segments: Mapping[str, Segment]) -> dict[str, Segment]:
    """Segments and their mirror images: "bottom" in a label becomes "top", the far side, and "right" becomes "left".

    A segment with both words in its label gives four, one with neither only itself. Images that are among the segments
    already are kept.

    Examples
    --------
    >>> from fieldcalib import Point
    >>> list(mirrored({"Centre mark": Point((0.0, 0.0, 0.0)), "Corner right bottom": Point((9.0, 9.0, 0.0))}))
    ['Centre mark', 'Corner right bottom', 'Corner right top', 'Corner left bottom', 'Corner left top']
    """
    found: dict[str, Segment] = {}
    for _, run in groupby(segments.items(), key=lambda item: "bottom" in item[0].split(" ")):
        found |= with_top(dict(run), segments)
    return found | _images(found, "right", "left", (-1.0, 1.0, 1.0), found)


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
