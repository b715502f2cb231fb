"""The futsal pitch (FIFA Futsal Laws of the Game, law 1), with its goals."""

from __future__ import annotations

import numpy as np

from fieldcalib.fields.field import Field
from fieldcalib.fields.segments import Arc, Point
from fieldcalib.fields.sports.parts import CENTRE, across, along, check_size, court, on_ground, right_goal, with_top
from fieldcalib.fields.traits import Paint, ProbabilityModel, SizePrior, stands_beside

# In metres. Lines belong to the areas that they bound, so that areas end at outer edges.
LINE_WIDTH = 0.08
POST = 0.08  # thickness of posts and crossbar
GOAL_WIDTH, GOAL_HEIGHT = 3.0, 2.0  # inside
CENTRE_CIRCLE = 3.0
PENALTY_AREA = 6.0  # from the goal line, and from the outside of the posts
PENALTY_MARK, SECOND_PENALTY_MARK = 6.0, 10.0
SPOT_DIAMETER = 0.12
CORNER_ARC = 0.25
SUBSTITUTION_ZONE = (5.0, 10.0)  # from the halfway line, from and to
SUBSTITUTION_MARK = 0.40  # to either side of the touchline's edges
ALL_MATCHES = ((25.0, 42.0), (16.0, 25.0))  # length and width, from and to
INTERNATIONAL_MATCHES = ((38.0, 42.0), (20.0, 25.0))
LARGEST = 60.0  # metres: larger numbers are in another unit
# Fitted to 1,500 synthetic frames: `python -m data_tools.probability fit --field futsal`.
PROBABILITY = ProbabilityModel((0.66, -2.84, -1.31, -0.01, -0.14))


def futsal(length: float = 40.0, width: float = 20.0, *, size_known: bool = False) -> Field:
    """A futsal pitch: all lines, arcs and marks, and the goals.

    Lines run along the middle of the paint. "left" and "right" are the goals as the main camera sees them, "top" is
    the far side and "bottom" the near one, also of posts. A pitch that is turned by 180 degrees is the same pitch:
    the marks of the substitution zones, which are on one side only, are on both sides here. The marks 5 m from
    corners and from the second penalty marks are left out.

    Parameters
    ----------
    length, width : float
        Size of the pitch between the outer edges of its lines, metres. The law allows 25 to 42 and 16 to 25, for
        international matches 38 to 42 and 20 to 25.
    size_known : bool
        Whether the pitch in view has exactly this size.

    Raises
    ------
    ValueError
        If the penalty areas and the second penalty marks do not fit into the pitch, if length and width are swapped,
        or if they are not in metres.

    Examples
    --------
    >>> futsal()["Penalty area right line"].start
    (14.04, -1.58, 0.0)
    >>> futsal(38.0, 18.0)["Goal line right"].end
    (18.96, 8.96, 0.0)
    """
    posts = 0.5 * GOAL_WIDTH + POST
    least = 2.0 * SECOND_PENALTY_MARK, 2.0 * (posts + PENALTY_AREA)
    usual = "length about 40 and width about 20"
    check_size("futsal pitch", (length, width), "penalty areas and marks", least, LARGEST, usual)
    if length < width:
        raise ValueError(
            f"a futsal pitch is longer than wide, got length = {length} and width = {width}: give the touchline first, "
            f"futsal({width}, {length})"
        )
    half, end, side = 0.5 * LINE_WIDTH, 0.5 * length, 0.5 * width  # outer edges
    (near, far), mark = SUBSTITUTION_ZONE, (side - LINE_WIDTH - SUBSTITUTION_MARK, side + SUBSTITUTION_MARK)
    segments = {
        "Side line bottom": along(end - half, side - half),
        "Halfway line": across(0.0, side - half),
        "Centre circle": Arc(CENTRE, CENTRE_CIRCLE - half),
        "Centre mark": Point(CENTRE),
        "Goal line right": across(end - half, side - half),
        "Penalty area right line": across(end - (PENALTY_AREA - half), posts),
        "Penalty area right arc bottom": Arc((end, posts, 0.0), PENALTY_AREA - half, 0.5 * np.pi, np.pi),
        "Penalty mark right": Point((end - PENALTY_MARK, 0.0, 0.0)),
        "Second penalty mark right": Point((end - SECOND_PENALTY_MARK, 0.0, 0.0)),
        **with_top({"Corner arc right bottom": Arc((end, side, 0.0), CORNER_ARC - half, np.pi, 1.5 * np.pi)}),
        "Inner substitution mark right bottom": on_ground(*((near + half, y) for y in mark)),
        "Outer substitution mark right bottom": on_ground(*((far - half, y) for y in mark)),
        **right_goal(end - half, GOAL_WIDTH, GOAL_HEIGHT, POST),
    }
    return court(
        (length, width),
        segments,
        line_width=LINE_WIDTH,
        stands=stands_beside(40.0, 20.0, away=(4.0, 40.0), up=(1.5, 18.0)),
        paint=dict.fromkeys(("Centre mark", "Penalty mark", "Second penalty mark"), Paint(width=SPOT_DIAMETER)),
        farthest_camera=100.0,
        surface="floor",
        size_model=SizePrior(ALL_MATCHES, INTERNATIONAL_MATCHES, build=futsal, rules="law 1 of futsal"),
        size_known=size_known,
        probability=PROBABILITY,
    )
