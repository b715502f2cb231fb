"""The handball court (IHF Rules of the Game, rule 1), with its goals."""

from __future__ import annotations

from fieldcalib.fields.field import Field
from fieldcalib.fields.segments import Arc
from fieldcalib.fields.sports.parts import CENTRE, across, along, court, on_ground, right_area, right_goal
from fieldcalib.fields.traits import Paint, ProbabilityModel, stands_beside

# In metres. Lines belong to the areas that they bound, so that areas end at outer edges.
LENGTH, WIDTH = 40.0, 20.0
LINE_WIDTH = 0.05
POST = 0.08  # thickness of posts and crossbar, and width of the goal line between the posts
GOAL_WIDTH, GOAL_HEIGHT = 3.0, 2.0  # inside
GOAL_AREA, FREE_THROW = 6.0, 9.0  # from the goal line, and from the inner rear edges of the posts
DASHES = (0.15, 0.15)  # of the free-throw line, and the gaps between them
SEVEN_METRES, SEVEN_METRE_LINE = 7.0, 1.0  # from the goal line to the edge towards the centre, length
FOUR_METRES, FOUR_METRE_LINE = 4.0, 0.15
SUBSTITUTION, SUBSTITUTION_MARK = 4.5, 0.15  # from the centre line, length to either side of the side line's edges
THROW_OFF_CIRCLE = 4.0  # diameter
# Fitted to 1,500 synthetic frames: `python -m data_tools.probability fit --field handball`.
PROBABILITY = ProbabilityModel((1.41, -3.31, -0.84, -0.2, -0.36))


def handball() -> Field:
    """A handball court: all lines, the goal areas, the dashed free-throw lines, and the goals.

    Lines run along the middle of the paint. "left" and "right" are the goals as the main camera sees them, "top" is
    the far side and "bottom" the near one, also of posts. The line from corner to corner is the goal line between the
    posts, where it is wider, and the outer goal line beside them. Goal area and free-throw line are one straight line
    and two arcs each. The throw-off circle, of 2022, is not on every court.

    A court that is turned by 180 degrees is the same court: the substitution marks, which are on the side of the
    benches only, are on both sides here.

    Examples
    --------
    >>> handball()["Free-throw right line"].start
    (11.025, -1.5, 0.0)
    """
    half, end, side = 0.5 * LINE_WIDTH, 0.5 * LENGTH, 0.5 * WIDTH  # outer edges
    inner, outer = 0.5 * GOAL_WIDTH, 0.5 * GOAL_WIDTH + POST  # edges of the posts
    seven, four, substitution = end - SEVEN_METRES + half, end - FOUR_METRES + half, SUBSTITUTION - half
    mark = side - LINE_WIDTH - SUBSTITUTION_MARK, side + SUBSTITUTION_MARK
    segments = {
        "Side line bottom": along(end - half, side - half),
        "Centre line": across(0.0, side - half),
        "Throw-off circle": Arc(CENTRE, 0.5 * THROW_OFF_CIRCLE - half),
        "Goal line right": across(end - 0.5 * POST, inner),
        **right_area("Goal area", end, inner, GOAL_AREA - half),
        **right_area("Free-throw", end, inner, FREE_THROW - half, reach=side - half),
        "Seven-metre line right": across(seven, 0.5 * SEVEN_METRE_LINE),
        "Four-metre line right": across(four, 0.5 * FOUR_METRE_LINE),
        "Outer goal line right bottom": on_ground((end - half, outer), (end - half, side - half)),
        "Substitution mark right bottom": on_ground(*((substitution, y) for y in mark)),
        **right_goal(end - 0.5 * POST, GOAL_WIDTH, GOAL_HEIGHT, POST),
    }
    return court(
        (LENGTH, WIDTH),
        segments,
        line_width=LINE_WIDTH,
        stands=stands_beside(LENGTH, WIDTH, away=(4.0, 40.0), up=(1.5, 18.0)),
        paint={"Goal line": Paint(width=POST), "Free-throw": Paint(dashes=DASHES)},
        farthest_camera=100.0,
        surface="floor",
        probability=PROBABILITY,
    )
