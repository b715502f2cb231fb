"""The football field, built from its dimensions, and its world: stands, sizes, lines, probabilities."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache

import numpy as np

from fieldcalib._types import is_number, truth
from fieldcalib.fields.field import Field
from fieldcalib.fields.segments import Arc, Point, Segment
from fieldcalib.fields.sports.parts import CENTRE, across, along, on_ground, upright
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


def soccer(length: float = 105.0, width: float = 68.0, *, size_known: bool = False) -> Field:
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

    Raises
    ------
    ValueError
        If the two penalty areas or the centre circle do not fit into the field, if length and width are swapped, or if
        they are not in metres.

    Examples
    --------
    >>> soccer()["Side line top"]
    Line(start=(-52.5, -34.0, 0.0), end=(52.5, -34.0, 0.0))
    """
    if not (is_number(length) and is_number(width)):
        raise ValueError(f"expected length and width as numbers of metres, got {length!r} and {width!r}")
    if not (length > 2.0 * (PENALTY_AREA_DEPTH + CIRCLE_RADIUS) and width > PENALTY_AREA_WIDTH):
        raise ValueError(
            f"a soccer field of {length} x {width} m has no room for its penalty areas and its centre circle: "
            f"expected metres, length about 105 and width about 68"
        )
    if max(length, width) > LARGEST:
        raise ValueError(
            f"a soccer field of {length} x {width} m is larger than any: expected metres (not centimetres or feet), "
            f"length about 105 and width about 68"
        )
    if length <= width and length < ALL_MATCHES[0][0]:
        raise ValueError(
            f"a soccer field is longer than wide, got length = {length} and width = {width}: give both in metres, the "
            f"touchline first, as soccer(105, 68)"
        )
    return _pitch(float(length), float(width), truth(size_known, "size_known"))


@lru_cache(maxsize=64)
def _pitch(length: float, width: float, size_known: bool) -> Field:
    """The field of a size, built once: fields are immutable, and each caches what is derived from it."""
    x_goal, y_side, quarter = length / 2.0, width / 2.0, np.pi / 2.0
    segments = {
        "Side line top": along(x_goal, -y_side),
        "Side line bottom": along(x_goal, y_side),
        "Side line left": across(-x_goal, y_side),
        "Side line right": across(x_goal, y_side),
        "Middle line": across(0.0, y_side),
        **_half("left", -1.0, x_goal),
        **_half("right", 1.0, x_goal),
        "Circle central": Arc(CENTRE, CIRCLE_RADIUS),
        "Circle central left": Arc(CENTRE, CIRCLE_RADIUS, quarter, 3.0 * quarter),
        "Circle central right": Arc(CENTRE, CIRCLE_RADIUS, -quarter, quarter),
        **_named_points(x_goal, y_side),
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
        size_model=SizePrior(ALL_MATCHES, INTERNATIONAL_MATCHES, build=soccer, rules="law 1"),
        crown=GRASS,
        size_known=size_known,
        probability=PROBABILITY,
    )


def soccer_points(points: Mapping[str, Point]) -> Field:
    """A soccer field of unknown size that has the given points only."""
    length, width = LARGEST_FIELD
    return replace(soccer(), length=length, width=width, segments=points, paint={}, halves={}, size_model=None)


def _half(side: str, sign: float, x_goal: float) -> dict[str, Segment]:
    """Penalty area, goal area, goal and penalty arc of one half; x grows with `sign` towards its goal."""
    segments: dict[str, Segment] = {}
    for name, depth, box_width in (
        ("Big rect.", PENALTY_AREA_DEPTH, PENALTY_AREA_WIDTH),
        ("Small rect.", GOAL_AREA_DEPTH, GOAL_AREA_WIDTH),
    ):
        x_main, y = sign * (x_goal - depth), box_width / 2.0
        x_left, x_right = sorted((x_main, sign * x_goal))
        segments[f"{name} {side} top"] = on_ground((x_left, -y), (x_right, -y))
        segments[f"{name} {side} bottom"] = on_ground((x_left, y), (x_right, y))
        segments[f"{name} {side} main"] = across(x_main, y)
    x, y = sign * x_goal, GOAL_WIDTH / 2.0
    segments[f"Goal {side} crossbar"] = across(x, y, -GOAL_HEIGHT)
    segments[f"Goal {side} post left"] = upright(x, -sign * y, GOAL_HEIGHT)
    segments[f"Goal {side} post right"] = upright(x, sign * y, GOAL_HEIGHT)
    half_angle = np.arccos((PENALTY_AREA_DEPTH - PENALTY_MARK_DISTANCE) / CIRCLE_RADIUS)
    towards_centre = 0.0 if sign < 0.0 else np.pi
    mark = (sign * (x_goal - PENALTY_MARK_DISTANCE), 0.0, 0.0)
    segments[f"Circle {side}"] = Arc(mark, CIRCLE_RADIUS, towards_centre - half_angle, towards_centre + half_angle)
    return segments


def _named_points(x_goal: float, y_side: float) -> dict[str, Segment]:
    """SoccerNet's field points: T and B are far and near (top and bottom for goals), L and R as in the image."""
    points: dict[str, tuple[float, float, float]] = {
        "CENTER_MARK": CENTRE,
        "T_TOUCH_AND_HALFWAY_LINES_INTERSECTION": (0.0, -y_side, 0.0),
        "B_TOUCH_AND_HALFWAY_LINES_INTERSECTION": (0.0, y_side, 0.0),
        "T_HALFWAY_LINE_AND_CENTER_CIRCLE_INTERSECTION": (0.0, -CIRCLE_RADIUS, 0.0),
        "B_HALFWAY_LINE_AND_CENTER_CIRCLE_INTERSECTION": (0.0, CIRCLE_RADIUS, 0.0),
    }
    arc_depth = PENALTY_AREA_DEPTH - PENALTY_MARK_DISTANCE
    arc_y = np.sqrt(CIRCLE_RADIUS**2 - arc_depth**2)
    for side, sign in (("L", -1.0), ("R", 1.0)):
        x_area = sign * (x_goal - PENALTY_AREA_DEPTH)
        points[f"{side}_PENALTY_MARK"] = (sign * (x_goal - PENALTY_MARK_DISTANCE), 0.0, 0.0)
        for tb, y_sign in (("T", -1.0), ("B", 1.0)):
            points[f"{tb}{side}_PITCH_CORNER"] = (sign * x_goal, y_sign * y_side, 0.0)
            points[f"{tb}{side}_16M_LINE_AND_PENALTY_ARC_INTERSECTION"] = (x_area, y_sign * arc_y, 0.0)
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
