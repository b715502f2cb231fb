"""The badminton court (BWF Laws of Badminton, law 1), with its net."""

from __future__ import annotations

from fieldcalib.fields.field import Field
from fieldcalib.fields.sports.parts import across, along, court, hanging_net, on_ground
from fieldcalib.fields.traits import ProbabilityModel, stands_beside

# In metres. Lines belong to the areas that they bound: to the outer edges.
LENGTH, WIDTH, SINGLES_WIDTH = 13.40, 6.10, 5.18
LINE_WIDTH = 0.04
SHORT_SERVICE = 1.98  # from the net to the edge towards it
LONG_SERVICE = 0.76  # from the back line
NET_CENTRE, NET_POSTS = 1.524, 1.55  # height
# Fitted to 1,500 synthetic frames: `python -m data_tools.probability fit --field badminton`.
PROBABILITY = ProbabilityModel((1.07, -3.31, -1.18, -0.28, -0.12))


def badminton() -> Field:
    """A badminton court for doubles and singles: all lines, and the net with its posts on the doubles side lines.

    Lines run along the middle of the paint. "left" and "right" are the sides of the net as the main camera sees
    them, which looks across the court, "top" is the far side and "bottom" the near one; the net has two halves,
    since it sags. Most cameras of badminton stand behind a back line: the stand "behind left goal".

    A court that is turned by 180 degrees is the same court.

    Examples
    --------
    >>> badminton()["Short service line right"].start[0]
    2.0
    """
    half, end = 0.5 * LINE_WIDTH, 0.5 * LENGTH
    back, short, long = end - half, SHORT_SERVICE + half, end - LONG_SERVICE - half
    side, singles = 0.5 * WIDTH - half, 0.5 * SINGLES_WIDTH - half
    right = {
        "Back line right": across(back, side),
        "Long service line right": across(long, side),
        "Short service line right": across(short, side),
        "Centre line right": on_ground((short, 0.0), (back, 0.0)),
    }
    bottom = {"Side line bottom": along(back, side), "Singles side line bottom": along(back, singles)}
    return court(
        (LENGTH, WIDTH),
        right,
        bottom,
        hanging_net(side, NET_CENTRE, NET_POSTS),
        line_width=LINE_WIDTH,
        stands=stands_beside(LENGTH, WIDTH, away=(3.0, 30.0), up=(1.5, 12.0)),
        farthest_camera=60.0,
        surface="floor",
        probability=PROBABILITY,
    )
