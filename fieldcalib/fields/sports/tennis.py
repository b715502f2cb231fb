"""The tennis court (ITF Rules of Tennis, rule 1), with its net."""

from __future__ import annotations

from fieldcalib.fields.field import Field
from fieldcalib.fields.sports.parts import across, along, court, hanging_net, on_ground
from fieldcalib.fields.traits import Paint, ProbabilityModel, stands_beside

# Outer edges of the lines, in metres.
LENGTH, DOUBLES_WIDTH, SINGLES_WIDTH = 23.77, 10.97, 8.23
SERVICE_LINE = 6.40  # from the net
LINE_WIDTH = 0.05  # 0.025 to 0.05
BASE_LINE_WIDTH = 0.10  # as wide as is allowed, which it mostly is
CENTRE_MARK = 0.10  # inwards from the inner edge of the base line
NET_CENTRE, NET_POSTS = 0.914, 1.07  # height
POST_DISTANCE = 0.914  # of a post from the outer edge of the doubles side line
# Fitted to 1,500 labelled frames and as heavy a set of 308 rendered pictures (`data_tools.photographs fit`). Of
# 1,153 such pictures 632 are good, 14 of them off by more than the tolerance; by labels alone they were 603 and 18.
PROBABILITY = ProbabilityModel((0.0, -2.88, -1.41, -0.23, 0.43), least_in_picture=0.83)


def tennis() -> Field:
    """A tennis court for doubles: base, side and service lines, centre marks, and the net with its posts.

    Lines run along the middle of the paint. "left" and "right" are the sides of the net as the main camera sees
    them, which looks across the court, "top" is the far side and "bottom" the near one; the net has two halves,
    since it sags. Most cameras of tennis stand behind a base line: the stand "behind left goal".

    A court that is turned by 180 degrees is the same court.

    Examples
    --------
    >>> tennis()["Service line right"].start[0]
    6.375
    """
    half, inside = 0.5 * LINE_WIDTH, 0.5 * LENGTH - BASE_LINE_WIDTH
    base, service = 0.5 * LENGTH - 0.5 * BASE_LINE_WIDTH, SERVICE_LINE - half
    doubles, singles, post = 0.5 * DOUBLES_WIDTH - half, 0.5 * SINGLES_WIDTH - half, 0.5 * DOUBLES_WIDTH + POST_DISTANCE
    right = {
        "Base line right": across(base, doubles),
        "Service line right": across(service, singles),
        "Centre mark right": on_ground((inside - CENTRE_MARK, 0.0), (inside, 0.0)),
    }
    bottom = {
        "Centre service line": along(service, 0.0),
        "Side line bottom": along(base, doubles),
        "Singles side line bottom": along(base, singles),
    }
    return court(
        (LENGTH, DOUBLES_WIDTH),
        right,
        bottom,
        hanging_net(post, NET_CENTRE, NET_POSTS),
        line_width=LINE_WIDTH,
        stands=stands_beside(LENGTH, DOUBLES_WIDTH, away=(5.0, 40.0), up=(1.0, 20.0)),
        paint={"Base line": Paint(width=BASE_LINE_WIDTH)},
        farthest_camera=80.0,
        surface="hard court",
        probability=PROBABILITY,
    )
