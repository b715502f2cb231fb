"""The calibration object: named segments in metres. `soccer` builds a football field from its dimensions.

Any mapping of names to segments is a calibration object; a `Field` is one that also knows its size and which label
becomes which under the 180-degree turn that maps the field onto itself.

World: origin at the centre mark, x right along the touchline as the main camera sees it, y towards the main camera,
z down, so that a crossbar is at z = -2.44.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType
from typing import TypeAlias

import numpy as np

from fieldcalib._types import Array

# Laws of the Game, law 1, in metres.
PENALTY_AREA_DEPTH = 16.5
PENALTY_AREA_WIDTH = 40.32
GOAL_AREA_DEPTH = 5.5
GOAL_AREA_WIDTH = 18.32
PENALTY_MARK_DISTANCE = 11.0
CIRCLE_RADIUS = 9.15  # centre circle and penalty arcs
GOAL_WIDTH = 7.32
GOAL_HEIGHT = 2.44


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
    past an end once more against that end (`fieldcalib.ends`).

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


@dataclass(frozen=True)
class Field(Mapping[str, Segment]):
    """A field: a mapping of labels to segments, with its size in metres.

    Labels are SoccerNet's without the trailing space that one of them has there ("Goal left post left "); looking a
    label up works with and without it.

    Examples
    --------
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
        >>> field = soccer().with_segments({"corner flag": Point((-52.5, -34.0, -1.5))})
        >>> field.length, field["corner flag"]
        (105.0, Point(X=(-52.5, -34.0, -1.5)))
        """
        names = {name.strip(): segment for name, segment in extra.items()}
        taken = sorted(names.keys() & self.segments.keys())
        if taken:
            raise ValueError(f"the field has a segment {taken[0]!r} already: give yours another name")
        return Field(self.length, self.width, {**self.segments, **names})


def soccer(length: float = 105.0, width: float = 68.0) -> Field:
    """A football field with goals: 23 straight segments, three circles, two halves of one, and 39 named points.

    Labels and point names are SoccerNet's. "left" and "right" are the goals as the main camera sees them, "top" is the
    far side and "bottom" the near one; the posts of a goal are left and right as seen facing it from the field. The
    halves of the centre circle are "Circle central left" and "Circle central right" (paper, section "Modeling the
    Soccer Field").

    Parameters
    ----------
    length, width : float
        Size of the field in metres: touchline and goal line. The law allows 90 to 120 and 45 to 90.

    Raises
    ------
    ValueError
        If the two penalty areas or the centre circle do not fit into the field.

    Examples
    --------
    >>> soccer()["Side line top"]
    Line(start=(-52.5, -34.0, 0.0), end=(52.5, -34.0, 0.0))
    """
    if not (length > 2.0 * (PENALTY_AREA_DEPTH + CIRCLE_RADIUS) and width > PENALTY_AREA_WIDTH):
        raise ValueError(
            f"a soccer field of {length} x {width} m has no room for its penalty areas and its centre circle: "
            f"expected metres, length about 105 and width about 68"
        )
    x_goal, y_side = length / 2.0, width / 2.0
    segments: dict[str, Segment] = {}
    segments.update(_outline(x_goal, y_side))
    for side, sign in (("left", -1.0), ("right", 1.0)):
        segments.update(_half(side, sign, x_goal))
    segments.update(_centre_circle())
    segments.update(_named_points(x_goal, y_side))
    return Field(float(length), float(width), segments)


def _outline(x_goal: float, y_side: float) -> dict[str, Segment]:
    return {
        "Side line top": Line((-x_goal, -y_side, 0.0), (x_goal, -y_side, 0.0)),
        "Side line bottom": Line((-x_goal, y_side, 0.0), (x_goal, y_side, 0.0)),
        "Side line left": Line((-x_goal, -y_side, 0.0), (-x_goal, y_side, 0.0)),
        "Side line right": Line((x_goal, -y_side, 0.0), (x_goal, y_side, 0.0)),
        "Middle line": Line((0.0, -y_side, 0.0), (0.0, y_side, 0.0)),
    }


def _half(side: str, sign: float, x_goal: float) -> dict[str, Segment]:
    """Penalty area, goal area, goal and penalty arc of one half; x grows with `sign` towards its goal."""
    segments: dict[str, Segment] = {}
    for name, depth, box_width in (
        ("Big rect.", PENALTY_AREA_DEPTH, PENALTY_AREA_WIDTH),
        ("Small rect.", GOAL_AREA_DEPTH, GOAL_AREA_WIDTH),
    ):
        x_main, y = sign * (x_goal - depth), box_width / 2.0
        x_left, x_right = sorted((x_main, sign * x_goal))
        segments[f"{name} {side} top"] = Line((x_left, -y, 0.0), (x_right, -y, 0.0))
        segments[f"{name} {side} bottom"] = Line((x_left, y, 0.0), (x_right, y, 0.0))
        segments[f"{name} {side} main"] = Line((x_main, -y, 0.0), (x_main, y, 0.0))
    x, y, z = sign * x_goal, GOAL_WIDTH / 2.0, -GOAL_HEIGHT
    segments[f"Goal {side} crossbar"] = Line((x, -y, z), (x, y, z))
    segments[f"Goal {side} post left"] = Line((x, -sign * y, z), (x, -sign * y, 0.0))
    segments[f"Goal {side} post right"] = Line((x, sign * y, z), (x, sign * y, 0.0))
    half_angle = np.arccos((PENALTY_AREA_DEPTH - PENALTY_MARK_DISTANCE) / CIRCLE_RADIUS)
    towards_centre = 0.0 if sign < 0.0 else np.pi
    mark = (sign * (x_goal - PENALTY_MARK_DISTANCE), 0.0, 0.0)
    segments[f"Circle {side}"] = Arc(mark, CIRCLE_RADIUS, towards_centre - half_angle, towards_centre + half_angle)
    return segments


def _centre_circle() -> dict[str, Segment]:
    centre, quarter = (0.0, 0.0, 0.0), np.pi / 2.0
    return {
        "Circle central": Arc(centre, CIRCLE_RADIUS),
        "Circle central left": Arc(centre, CIRCLE_RADIUS, quarter, 3.0 * quarter),
        "Circle central right": Arc(centre, CIRCLE_RADIUS, -quarter, quarter),
    }


def _named_points(x_goal: float, y_side: float) -> dict[str, Segment]:
    """SoccerNet's field points: T and B are far and near (top and bottom for goals), L and R as in the image."""
    points: dict[str, tuple[float, float, float]] = {
        "CENTER_MARK": (0.0, 0.0, 0.0),
        "T_TOUCH_AND_HALFWAY_LINES_INTERSECTION": (0.0, -y_side, 0.0),
        "B_TOUCH_AND_HALFWAY_LINES_INTERSECTION": (0.0, y_side, 0.0),
        "T_HALFWAY_LINE_AND_CENTER_CIRCLE_INTERSECTION": (0.0, -CIRCLE_RADIUS, 0.0),
        "B_HALFWAY_LINE_AND_CENTER_CIRCLE_INTERSECTION": (0.0, CIRCLE_RADIUS, 0.0),
    }
    arc_depth = PENALTY_AREA_DEPTH - PENALTY_MARK_DISTANCE
    arc_y = np.sqrt(CIRCLE_RADIUS**2 - arc_depth**2)
    for side, sign in (("L", -1.0), ("R", 1.0)):
        points[f"{side}_PENALTY_MARK"] = (sign * (x_goal - PENALTY_MARK_DISTANCE), 0.0, 0.0)
        for tb, y_sign in (("T", -1.0), ("B", 1.0)):
            points[f"{tb}{side}_PITCH_CORNER"] = (sign * x_goal, y_sign * y_side, 0.0)
            points[f"{tb}{side}_16M_LINE_AND_PENALTY_ARC_INTERSECTION"] = (
                sign * (x_goal - PENALTY_AREA_DEPTH),
                y_sign * arc_y,
                0.0,
            )
            for area, depth, area_width in (
                ("PENALTY", PENALTY_AREA_DEPTH, PENALTY_AREA_WIDTH),
                ("GOAL", GOAL_AREA_DEPTH, GOAL_AREA_WIDTH),
            ):
                for lr, x in zip("LR", sorted((sign * x_goal, sign * (x_goal - depth))), strict=True):
                    points[f"{side}_{area}_AREA_{tb}{lr}_CORNER"] = (x, y_sign * area_width / 2.0, 0.0)
            for lr, y in (("L", -sign), ("R", sign)):
                height = -GOAL_HEIGHT if tb == "T" else 0.0
                points[f"{side}_GOAL_{tb}{lr}_POST"] = (sign * x_goal, y * GOAL_WIDTH / 2.0, height)
    return {name: Point(X) for name, X in points.items()}
