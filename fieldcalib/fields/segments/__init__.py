"""Segments of a calibration object, in metres: points, lines, arcs and point clouds.

Any mapping of names to segments is a calibration object. A kind is one file: the class of its segments, and the class
of the rows in which their labelled pixels are packed and measured. A new kind is a new file and its names here.
"""

from __future__ import annotations

from collections.abc import Mapping
from reprlib import repr as short

import numpy as np

from fieldcalib._types import Array
from fieldcalib.fields.segments.arc import Arc as Arc
from fieldcalib.fields.segments.arc import ArcRows as ArcRows
from fieldcalib.fields.segments.line import Line as Line
from fieldcalib.fields.segments.line import LineRows as LineRows
from fieldcalib.fields.segments.point import Point as Point
from fieldcalib.fields.segments.point import PointRows as PointRows
from fieldcalib.fields.segments.point_cloud import CloudRows, CurveRows
from fieldcalib.fields.segments.point_cloud import PointCloud as PointCloud
from fieldcalib.fields.segments.rows import EndRows as EndRows
from fieldcalib.fields.segments.rows import Rows as Rows
from fieldcalib.fields.segments.segment import Segment as Segment

__all__ = ["Arc", "Line", "Point", "PointCloud"]  # what Tab shows


KINDS: tuple[type[Segment], ...] = (Point, Line, Arc, PointCloud)
ROWS: tuple[type[Rows], ...] = (LineRows, ArcRows, CurveRows, PointRows, CloudRows, EndRows)
"""The order of the residuals."""


def __dir__() -> list[str]:
    return __all__.copy()


def outwards(segment: Segment, X: Array, along: Array) -> Array:
    """Unit vectors (N, 3) on the ground across a segment at points (N, 3), away from the middle of the field.

    For an arc they point away from its own centre. `along` are vectors along the segment there, (N, 3).

    Examples
    --------
    >>> line = Line((-52.5, -34.0, 0.0), (52.5, -34.0, 0.0))
    >>> outwards(line, line.sample(105.0), np.array([[1.0, 0.0, 0.0]])).tolist()
    [[0.0, -1.0, 0.0], [0.0, -1.0, 0.0]]
    """
    across = np.column_stack([along[:, 1], -along[:, 0], np.zeros(len(along))])
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-9)
    inside = np.sum(across * (X - segment.middle_of_curvature), axis=1, keepdims=True) < 0.0
    return np.asarray(np.where(inside, -across, across) + 0.0)


def boxes(segments: Mapping[str, Segment], spacing: float = 1.0) -> tuple[Array, Array]:
    """Least and largest coordinates (L, 3) of each segment, metres; of arcs, of points `spacing` apart."""
    samples = [one.anchors if one.is_straight else one.sample(spacing) for one in segments.values()]
    return np.array([X.min(axis=0) for X in samples]), np.array([X.max(axis=0) for X in samples])


def check_members(segments: Mapping[str, Segment]) -> None:
    """Raise a ValueError that names the first member that is not a segment."""
    for name, segment in segments.items():
        if not isinstance(segment, Segment):
            raise ValueError(f"{name!r}: expected a Line, Arc, Point or PointCloud, got {short(segment)}")
