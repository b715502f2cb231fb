"""A field from its right bottom quarter: mirrored markings, and paint by the beginnings of labels."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from fieldcalib.fields.field import Field
from fieldcalib.fields.mirrored import mirrored
from fieldcalib.fields.segments import Segment
from fieldcalib.fields.traits import LineLook, Paint


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
    >>> from fieldcalib.fields.sports.lines import across
    >>> list(court((20.0, 10.0), {"End line right": across(10.0, 5.0)}, line_width=0.05))
    ['End line right', 'End line left']
    """
    length, width = size
    whole = {label: segment for part in parts for label, segment in mirrored(part).items()}
    defaults: dict[str, Any] = {
        "lines": LineLook(width=line_width, ground_difference=np.inf),
        "paint": {label: one for start, one in paint.items() for label in whole if label.startswith(start)},
        "size_known": True,
    }
    return Field(float(length), float(width), whole, **(defaults | known))
