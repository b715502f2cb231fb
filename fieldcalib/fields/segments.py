"""Segments of a calibration object, in metres: points, lines, arcs and point clouds.

Any mapping of names to segments is a calibration object.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from fieldcalib._types import Array


@dataclass(frozen=True)
class Point:
    """A labelled point of the object; its residual has two components.

    Examples
    --------
    >>> Point((0.0, 0.0, 0.0)).sample()
    array([[0., 0., 0.]])
    """

    X: tuple[float, float, float]

    def __post_init__(self) -> None:
        object.__setattr__(self, "X", _vector(self.X, "a Point"))

    def sample(self, spacing: float = 1.0) -> Array:
        """The point itself, as a (1, 3) array."""
        return np.array([self.X])


@dataclass(frozen=True)
class Line:
    """A straight segment from `start` to `end`. Pixels are measured against the infinite line through both, and those
    past an end once more against that end (`fieldcalib.problem.segment_ends`).

    Examples
    --------
    >>> Line((0.0, 0.0, 0.0), (0.0, 0.0, -2.44)).sample(spacing=1.0)[:, 2]
    array([ 0.        , -0.81333333, -1.62666667, -2.44      ])
    """

    start: tuple[float, float, float]
    end: tuple[float, float, float]

    def __post_init__(self) -> None:
        object.__setattr__(self, "start", _vector(self.start, "the start of a Line"))
        object.__setattr__(self, "end", _vector(self.end, "the end of a Line"))
        if self.start == self.end:
            raise ValueError(f"a Line needs two different end points, got start = end = {self.start}")

    def sample(self, spacing: float = 1.0) -> Array:
        """Points from start to end, at most `spacing` metres apart, (N, 3)."""
        start, end = np.array(self.start), np.array(self.end)
        count = int(np.ceil(np.linalg.norm(end - start) / spacing)) + 1
        return np.asarray(start + np.linspace(0.0, 1.0, max(count, 2))[:, None] * (end - start))


@dataclass(frozen=True)
class Arc:
    """Part of a circle: ``center + radius (cos(phi) u + sin(phi) v)`` for phi from `start` to `stop` (radians).

    u and v are orthogonal unit vectors; by default they span the ground. Pixels are measured against the whole circle.

    Examples
    --------
    >>> Arc((0.0, 0.0, 0.0), radius=9.15).sample(spacing=20.0).round(2)[:2]
    array([[ 9.15,  0.  ,  0.  ],
           [-4.57,  7.92,  0.  ]])
    """

    center: tuple[float, float, float]
    radius: float
    start: float = 0.0
    stop: float = 2.0 * np.pi
    u: tuple[float, float, float] = (1.0, 0.0, 0.0)
    v: tuple[float, float, float] = (0.0, 1.0, 0.0)

    def __post_init__(self) -> None:
        object.__setattr__(self, "center", _vector(self.center, "the centre of an Arc"))
        object.__setattr__(self, "u", _vector(self.u, "the axis u of an Arc"))
        object.__setattr__(self, "v", _vector(self.v, "the axis v of an Arc"))
        axes = np.array([self.u, self.v])
        if not np.allclose(axes @ axes.T, np.eye(2), atol=1e-9):
            raise ValueError(f"an Arc needs orthogonal unit vectors u and v, got u = {self.u}, v = {self.v}")
        if not self.radius > 0.0:
            raise ValueError(f"an Arc needs a positive radius, got {self.radius}")

    def sample(self, spacing: float = 1.0) -> Array:
        """Points from start to stop, at most `spacing` metres of arc apart, (N, 3)."""
        count = int(np.ceil(self.radius * abs(self.stop - self.start) / spacing)) + 1
        phi = np.linspace(self.start, self.stop, max(count, 3))[:, None]
        return np.asarray(self.center + self.radius * (np.cos(phi) * self.u + np.sin(phi) * self.v))


@dataclass(frozen=True)
class PointCloud:
    """Points of a curve or of a shape, (N, 3).

    An `ordered` cloud is a curve: pixels are measured against the smooth curve through its points. Otherwise each
    pixel is compared, in both coordinates, with the nearest of the points.

    Examples
    --------
    >>> PointCloud([(0.0, 0.0, 0.0), (1.0, 0.1, 0.0), (2.0, 0.4, 0.0)], ordered=True).X.shape
    (3, 3)
    """

    points: tuple[tuple[float, float, float], ...]
    ordered: bool = False

    def __post_init__(self) -> None:
        X = np.array(self.points, dtype=float)
        if X.ndim != 2 or X.shape[1] != 3 or len(X) < (3 if self.ordered else 1):
            least = "three points for an ordered cloud" if self.ordered else "one point"
            raise ValueError(f"a PointCloud needs an (N, 3) array with at least {least}, got shape {X.shape}")
        object.__setattr__(self, "points", tuple(map(tuple, X.tolist())))

    @property
    def X(self) -> Array:
        """The points as an (N, 3) array."""
        return np.array(self.points)

    def sample(self, spacing: float = 1.0) -> Array:
        """The points themselves, (N, 3)."""
        return self.X


def _vector(values: Iterable[float], what: str) -> tuple[float, float, float]:
    """Three finite numbers, or a ValueError that names what they are."""
    array = np.asarray(values, dtype=float)
    if array.shape != (3,) or not np.all(np.isfinite(array)):
        raise ValueError(f"{what} needs three finite coordinates in metres, got {values!r}")
    x, y, z = array.tolist()
    return x, y, z


Segment: TypeAlias = Point | Line | Arc | PointCloud
ObjectSegments: TypeAlias = Mapping[str, Segment]


def outwards(segment: Segment, X: Array, along: Array) -> Array:
    """Unit vectors (N, 3) on the ground across a segment at points (N, 3), away from the middle of the field.

    Of an arc they point away from its own centre. `along` are vectors along the segment there, (N, 3).

    Examples
    --------
    >>> line = Line((-52.5, -34.0, 0.0), (52.5, -34.0, 0.0))
    >>> outwards(line, line.sample(105.0), np.array([[1.0, 0.0, 0.0]])).tolist()
    [[0.0, -1.0, 0.0], [0.0, -1.0, 0.0]]
    """
    across = np.column_stack([along[:, 1], -along[:, 0], np.zeros(len(along))])
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-9)
    centre = segment.center if isinstance(segment, Arc) else (0.0, 0.0, 0.0)
    inside = np.sum(across * (X - centre), axis=1, keepdims=True) < 0.0
    return np.asarray(np.where(inside, -across, across) + 0.0)


def boxes(segments: ObjectSegments) -> tuple[Array, Array]:
    """Least and largest coordinates (L, 3) of each segment, metres."""
    samples = [segment.sample() for segment in segments.values()]
    return np.array([X.min(axis=0) for X in samples]), np.array([X.max(axis=0) for X in samples])


def check_members(segments: ObjectSegments) -> None:
    """Raise a ValueError that names the first member that is no segment."""
    for name, segment in segments.items():
        if not isinstance(segment, Segment):
            raise ValueError(f"{name!r}: expected a Line, Arc, Point or PointCloud, got {segment!r}")
