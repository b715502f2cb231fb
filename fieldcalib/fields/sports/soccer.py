"""The football field, built from its dimensions, and its world: stands, sizes, lines, probabilities."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from fieldcalib._types import is_number, truth
from fieldcalib.fields.field import Field, built
from fieldcalib.fields.segments import Arc, Point, Segment
from fieldcalib.fields.sports.parts import CENTRE, across, along, check_size, on_ground, upright
from fieldcalib.fields.traits import (
    ALL_STANDS,
    GRASS,
    MAIN_TRIBUNE,
    SOCCER_SCALE,
    Halves,
    LineLook,
    Paint,
    ProbabilityModel,
    SizePrior,
)

# Laws of the Game, law 1, in metres.
PENALTY_AREA_DEPTH = 16.5
PENALTY_AREA_WIDTH = 40.32
GOAL_AREA_DEPTH = 5.5
GOAL_AREA_WIDTH = 18.32
PENALTY_MARK_DISTANCE = 11.0
SPOT_DIAMETER = 0.22
CIRCLE_RADIUS = 9.15  # centre circle and penalty arcs
GOAL_WIDTH = 7.32
GOAL_HEIGHT = 2.44
LINE_WIDTH = 0.12  # lines, posts and crossbars: the largest that is allowed
ALL_MATCHES = ((90.0, 120.0), (45.0, 90.0))  # length and width, from and to
INTERNATIONAL_MATCHES = ((100.0, 110.0), (64.0, 75.0))

LARGEST = 200.0  # metres: larger numbers are in another unit
LARGEST_FIELD = (140.0, 120.0)  # metres: no soccer field reaches beyond
FARTHEST_CAMERA = 300.0  # metres: no stand is farther away
# Fitted to 2,000 synthetic frames and to nothing else: `python -m data_tools.probability fit`.
PROBABILITY = ProbabilityModel((1.16, -3.06, -0.91, -0.25, -0.03))


@dataclass(frozen=True)
class SoccerBuilder:
    """Builder of soccer fields of any length and width whose lines have one width."""

    line_width: float | None = None

    def __call__(self, length: float, width: float) -> Field:
        """`soccer` of a length and a width."""
        return soccer(length, width, line_width=self.line_width)


def soccer(
    length: float = 105.0, width: float = 68.0, *, size_known: bool = False, line_width: float | None = None
) -> Field:
    """A football field with goals: 23 straight segments, three circles, two halves of one, and 39 named points.

    Labels and point names are SoccerNet's. "left" and "right" are the goals as the main camera sees them, "top" is the
    far side and "bottom" the near one; the posts of a goal are left and right as seen facing it from the field. The
    halves of the centre circle are "Circle central left" and "Circle central right" (paper, section "Modeling the
    Soccer Field").

    Parameters
    ----------
    length, width : float
        Size of the field in metres: touchline and goal line. The law allows 90 to 120 and 45 to 90.
    size_known : bool
        Whether the pitch in view has exactly this size.
    line_width : float, optional
        Width of the painted lines, metres, at most 0.12. Law 1 measures to their outer edges, as they belong to the
        areas that they bound, so that their middles, which are labelled, lie closer together: 104.88 m for a pitch of
        105 m, 16.38 m for the depth of a penalty area. If it is not given, middles are taken to be at the distances of
        the law, as in SoccerNet's and all other benchmarks; a size that is estimated then comes out 0.5 % too large.
        Clips take 0.12 if it is not given.

    Raises
    ------
    ValueError
        If the two penalty areas or the centre circle do not fit into the field, if length and width are swapped, if
        they are not in metres, or if the law allows no such lines.

    Examples
    --------
    >>> soccer()["Side line top"]
    Line(start=(-52.5, -34.0, 0.0), end=(52.5, -34.0, 0.0))
    >>> soccer(line_width=0.12)["Side line top"]
    Line(start=(-52.44, -33.94, 0.0), end=(52.44, -33.94, 0.0))
    """
    if line_width is not None and not (is_number(line_width) and 0.0 <= line_width <= LINE_WIDTH):
        raise ValueError(f"expected a line_width from 0 to {LINE_WIDTH} m, which the law allows, got {line_width!r}")
    least = 2.0 * (PENALTY_AREA_DEPTH + CIRCLE_RADIUS), PENALTY_AREA_WIDTH
    marks, usual = "penalty areas and its centre circle", "length about 105 and width about 68"
    check_size("soccer field", (length, width), marks, least, LARGEST, usual)
    if length <= width and length < ALL_MATCHES[0][0]:
        raise ValueError(
            f"a soccer field is longer than wide, got length = {length} and width = {width}: give both in metres, the "
            f"touchline first, as soccer(105, 68)"
        )
    return _pitch(float(length), float(width), truth(size_known, "size_known"), line_width)


class _Middles(NamedTuple):
    """Distances of the middles of lines, posts and crossbar, metres.

    Areas and circles end at the outer edges of their lines; a goal is measured between its posts and below its bar.
    """

    x_goal: float
    y_side: float
    areas: Mapping[str, tuple[float, float]]
    """Depth of penalty and goal area from the goal line, and half of their width."""
    mark: float
    """Penalty mark from the goal line."""
    radius: float
    post: float
    """Posts from the middle of the goal."""
    bar: float
    """Height of the crossbar."""

    @classmethod
    def of(cls, length: float, width: float, line_width: float) -> _Middles:
        half = line_width / 2.0
        areas = {
            "Big rect.": (PENALTY_AREA_DEPTH - line_width, PENALTY_AREA_WIDTH / 2.0 - half),
            "Small rect.": (GOAL_AREA_DEPTH - line_width, GOAL_AREA_WIDTH / 2.0 - half),
        }
        ends = length / 2.0 - half, width / 2.0 - half
        goal = GOAL_WIDTH / 2.0 + half, GOAL_HEIGHT + half
        return cls(*ends, areas, PENALTY_MARK_DISTANCE - half, CIRCLE_RADIUS - half, *goal)

    @property
    def beyond_mark(self) -> float:
        """Front of the penalty area from the penalty mark."""
        return self.areas["Big rect."][0] - self.mark


@lru_cache(maxsize=64)
def _pitch(length: float, width: float, size_known: bool, line_width: float | None) -> Field:
    """The field of a size, built once: fields are immutable, and each caches what is derived from it."""
    middles, quarter = _Middles.of(length, width, line_width or 0.0), np.pi / 2.0
    x_goal, y_side, radius = middles.x_goal, middles.y_side, middles.radius
    segments = {
        "Side line top": along(x_goal, -y_side),
        "Side line bottom": along(x_goal, y_side),
        "Side line left": across(-x_goal, y_side),
        "Side line right": across(x_goal, y_side),
        "Middle line": across(0.0, y_side),
        **_half("left", -1.0, middles),
        **_half("right", 1.0, middles),
        "Circle central": Arc(CENTRE, radius),
        "Circle central left": Arc(CENTRE, radius, quarter, 3.0 * quarter),
        "Circle central right": Arc(CENTRE, radius, -quarter, quarter),
        **_named_points(middles),
    }
    return Field(
        length,
        width,
        segments,
        stands=ALL_STANDS,
        more_stands=(MAIN_TRIBUNE,),
        farthest_camera=FARTHEST_CAMERA,
        scale=SOCCER_SCALE,
        lines=LineLook(width=LINE_WIDTH),
        paint={name: Paint(width=SPOT_DIAMETER) for name in ("CENTER_MARK", "L_PENALTY_MARK", "R_PENALTY_MARK")},
        halves={"Circle central": Halves("Circle central left", "Circle central right", line="Middle line")},
        size_model=SizePrior(ALL_MATCHES, INTERNATIONAL_MATCHES, build=SoccerBuilder(line_width), rules="law 1"),
        crown=GRASS,
        size_known=size_known,
        probability=PROBABILITY,
    )


def with_painted_lines(field: Field) -> Field:
    """A soccer field whose line width was not said, with the usual one; any other as it is."""
    is_open = field.size_model is not None and field.size_model.build == SoccerBuilder() and field.is_built
    return with_line_width(field, LINE_WIDTH) if is_open else field


def with_line_width(field: Field, line_width: float) -> Field:
    """A soccer field with lines of another width.

    Raises
    ------
    ValueError
        If it is no field that `soccer` makes.
    """
    if field.size_model is None or not isinstance(field.size_model.build, SoccerBuilder) or not field.is_built:
        raise ValueError("expected a soccer field: the lines of others have the width that their rules say")
    return built(SoccerBuilder(line_width), field.length, field.width, field.size_known, field.ground)


def soccer_points(points: Mapping[str, Point]) -> Field:
    """A soccer field of unknown size that has the given points only."""
    length, width = LARGEST_FIELD
    return replace(soccer(), length=length, width=width, segments=points, paint={}, halves={}, size_model=None)


def _half(side: str, sign: float, middles: _Middles) -> dict[str, Segment]:
    """Penalty area, goal area, goal and penalty arc of one half; x grows with `sign` towards its goal."""
    segments: dict[str, Segment] = {}
    for name, (depth, y) in middles.areas.items():
        x_main = sign * (middles.x_goal - depth)
        x_left, x_right = sorted((x_main, sign * middles.x_goal))
        segments[f"{name} {side} top"] = on_ground((x_left, -y), (x_right, -y))
        segments[f"{name} {side} bottom"] = on_ground((x_left, y), (x_right, y))
        segments[f"{name} {side} main"] = across(x_main, y)
    x, y = sign * middles.x_goal, middles.post
    segments[f"Goal {side} crossbar"] = across(x, y, -middles.bar)
    segments[f"Goal {side} post left"] = upright(x, -sign * y, middles.bar)
    segments[f"Goal {side} post right"] = upright(x, sign * y, middles.bar)
    half_angle = np.arccos(middles.beyond_mark / middles.radius)
    towards_centre = 0.0 if sign < 0.0 else np.pi
    mark = (sign * (middles.x_goal - middles.mark), 0.0, 0.0)
    segments[f"Circle {side}"] = Arc(mark, middles.radius, towards_centre - half_angle, towards_centre + half_angle)
    return segments


def _named_points(middles: _Middles) -> dict[str, Segment]:
    """SoccerNet's field points: T and B are far and near (top and bottom for goals), L and R as in the image."""
    x_goal, y_side, radius = middles.x_goal, middles.y_side, middles.radius
    points: dict[str, tuple[float, float, float]] = {
        "CENTER_MARK": CENTRE,
        "T_TOUCH_AND_HALFWAY_LINES_INTERSECTION": (0.0, -y_side, 0.0),
        "B_TOUCH_AND_HALFWAY_LINES_INTERSECTION": (0.0, y_side, 0.0),
        "T_HALFWAY_LINE_AND_CENTER_CIRCLE_INTERSECTION": (0.0, -radius, 0.0),
        "B_HALFWAY_LINE_AND_CENTER_CIRCLE_INTERSECTION": (0.0, radius, 0.0),
    }
    arc_y = np.sqrt(radius**2 - middles.beyond_mark**2)
    for side, sign in (("L", -1.0), ("R", 1.0)):
        x_area = sign * (x_goal - middles.areas["Big rect."][0])
        points[f"{side}_PENALTY_MARK"] = (sign * (x_goal - middles.mark), 0.0, 0.0)
        for tb, y_sign in (("T", -1.0), ("B", 1.0)):
            points[f"{tb}{side}_PITCH_CORNER"] = (sign * x_goal, y_sign * y_side, 0.0)
            points[f"{tb}{side}_16M_LINE_AND_PENALTY_ARC_INTERSECTION"] = (x_area, y_sign * arc_y, 0.0)
            for area, (depth, y) in zip(("PENALTY", "GOAL"), middles.areas.values(), strict=True):
                for lr, x in zip("LR", sorted((sign * x_goal, sign * (x_goal - depth))), strict=True):
                    points[f"{side}_{area}_AREA_{tb}{lr}_CORNER"] = (x, y_sign * y, 0.0)
            for lr, y in (("L", -sign), ("R", sign)):
                height = -middles.bar if tb == "T" else 0.0
                points[f"{side}_GOAL_{tb}{lr}_POST"] = (sign * x_goal, y * middles.post, height)
    return {name: Point(X) for name, X in points.items()}
