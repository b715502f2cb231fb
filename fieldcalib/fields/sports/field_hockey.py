"""The field of hockey (FIH Rules of Hockey, "Field and equipment"), with its goals."""

from __future__ import annotations

from fieldcalib.fields.field import Field
from fieldcalib.fields.segments import Point, Segment
from fieldcalib.fields.sports.parts import across, along, court, on_ground, right_area, right_goal
from fieldcalib.fields.traits import GRASS, Paint, ProbabilityModel, stands_beside

# Outer edges of the lines, in metres.
LENGTH, WIDTH = 91.40, 55.00
LINE_WIDTH = 0.075
TWENTY_THREE = 22.90  # from the back line to the far edge of the 23-metre line
CIRCLE = 14.63  # outer radius, around the inner sides of the posts, and the straight part's distance
CIRCLE_STRAIGHT = 3.66
BROKEN_CIRCLE = CIRCLE + 5.0
BROKEN = (0.30, 3.0)  # its dashes, and the gaps between them
SPOT_DIAMETER = 0.15
SPOT = 6.40  # of its centre, from the inner edge of the goal line
SIDE_MARKS = (("5 m", 5.0), ("14.63 m", CIRCLE))  # outside the side lines, from the back line
BACK_MARKS = (("5 m", 5.0), ("10 m", 10.0))  # outside the back lines, from the outer edge of the nearer post
MARK_LENGTH = 0.30
GOAL_WIDTH, GOAL_HEIGHT = 3.66, 2.14  # inside
POST = 0.05  # width of posts and crossbar
# Fitted to 1,500 synthetic frames: `python -m data_tools.probability fit --field field-hockey`.
PROBABILITY = ProbabilityModel((1.45, -2.96, -1.18, -0.06, -0.4))


def field_hockey() -> Field:
    """A field for hockey: outline, 23-metre and centre lines, circles, penalty spots, marks and goals.

    Lines run along the middle of the paint. "left" and "right" are the ends as the main camera sees them, "top" is
    its far side, "bottom" the near one.

    * "Side line top", "Back line left", "Centre line", "23-metre line left".
    * The circle is "Circle left line", its straight part, and the quarters "Circle left arc top" and "bottom"; the
      broken one 5 m further out is named alike, "Broken circle left arc top".
    * Marks of 30 cm outside the lines: "Side mark left bottom 5 m" and "14.63 m", "Back mark left bottom 5 m" and
      "10 m".
    * "Goal left crossbar", "Goal left post top".
    * Points: "Penalty spot left", "Corner left top", "Centre line and side line top", "23-metre line and side line left
      top".

    Only the labels tell the two ends apart: a field that is turned by 180 degrees looks the same.

    Examples
    --------
    >>> round(field_hockey()["Circle right arc bottom"].radius, 4)
    14.5925
    >>> round(field_hockey()["Penalty spot right"].X[0], 3)
    39.225
    """
    half, end, outer = 0.5 * LINE_WIDTH, 0.5 * LENGTH, 0.5 * WIDTH  # outer edges
    back, side, x23 = end - half, outer - half, end - TWENTY_THREE + half
    post = 0.5 * GOAL_WIDTH + POST
    bottom = {
        "Side line bottom": along(back, side),
        "Centre line and side line bottom": Point((0.0, side, 0.0)),
        "Centre line": across(0.0, side),
    }
    right = {
        "Back line right": across(back, side),
        "23-metre line right": across(x23, side),
        "Penalty spot right": Point((end - LINE_WIDTH - SPOT, 0.0, 0.0)),
        **right_area("Circle", end, 0.5 * CIRCLE_STRAIGHT, CIRCLE - half),
        **right_area("Broken circle", end, 0.5 * CIRCLE_STRAIGHT, BROKEN_CIRCLE - half),
        **right_goal(back, GOAL_WIDTH, GOAL_HEIGHT, POST),
    }
    corner: dict[str, Segment] = {
        "Corner right bottom": Point((back, side, 0.0)),
        "23-metre line and side line right bottom": Point((x23, side, 0.0)),
    }
    for name, distance in SIDE_MARKS:
        x = end - distance + half
        corner[f"Side mark right bottom {name}"] = on_ground((x, outer), (x, outer + MARK_LENGTH))
    for name, distance in BACK_MARKS:
        y = post + distance - half
        corner[f"Back mark right bottom {name}"] = on_ground((end, y), (end + MARK_LENGTH, y))
    return court(
        (LENGTH, WIDTH),
        right,
        corner,
        bottom,
        line_width=LINE_WIDTH,
        stands=stands_beside(LENGTH, WIDTH, away=(5.0, 60.0), up=(3.0, 30.0)),
        paint={"Penalty spot": Paint(width=SPOT_DIAMETER), "Broken circle": Paint(dashes=BROKEN)},
        farthest_camera=200.0,
        surface="turf",
        probability=PROBABILITY,
        crown=GRASS,
    )
