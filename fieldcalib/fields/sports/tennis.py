"""The tennis court (ITF Rules of Tennis, rule 1), with its net."""

from __future__ import annotations

from fieldcalib.fields.field import Field
from fieldcalib.fields.mirrored import with_left, with_top
from fieldcalib.fields.segments import Line, Segment
from fieldcalib.fields.stands import stands_beside
from fieldcalib.fields.traits import LineLook

# Outer edges of the lines, in metres.
LENGTH, DOUBLES_WIDTH, SINGLES_WIDTH = 23.77, 10.97, 8.23
SERVICE_LINE = 6.40  # from the net
LINE_WIDTH = 0.05  # 0.025 to 0.05
BASE_LINE_WIDTH = 0.10  # as wide as is allowed, which it mostly is
CENTRE_MARK = 0.10  # inwards from the outer edge of the base line
NET_CENTRE, NET_POSTS = 0.914, 1.07  # height
POST_DISTANCE = 0.914  # of a post from the outer edge of the doubles side line


def tennis() -> Field:
    """A tennis court for doubles: base, side and service lines, centre marks, and the net with its posts.

    Lines are where the middle of the paint is. "left" and "right" are the sides of the net as the main camera sees
    them, who looks across the court; most cameras of tennis stand behind a base line: "behind left goal" is the stand
    there.

    Examples
    --------
    >>> tennis()["Service line right"].start[0]
    6.375
    """
    half = 0.5 * LINE_WIDTH
    base, service = 0.5 * LENGTH - 0.5 * BASE_LINE_WIDTH, SERVICE_LINE - half
    doubles, singles, post = 0.5 * DOUBLES_WIDTH - half, 0.5 * SINGLES_WIDTH - half, 0.5 * DOUBLES_WIDTH + POST_DISTANCE
    segments: dict[str, Segment] = {
        **with_left(
            {
                "Base line right": Line((base, -doubles, 0.0), (base, doubles, 0.0)),
                "Service line right": Line((service, -singles, 0.0), (service, singles, 0.0)),
                "Centre mark right": Line((0.5 * LENGTH - CENTRE_MARK, 0.0, 0.0), (0.5 * LENGTH, 0.0, 0.0)),
            }
        ),
        "Centre service line": Line((-service, 0.0, 0.0), (service, 0.0, 0.0)),
        **with_top(
            {
                "Side line bottom": Line((-base, doubles, 0.0), (base, doubles, 0.0)),
                "Singles side line bottom": Line((-base, singles, 0.0), (base, singles, 0.0)),
                "Net post bottom": Line((0.0, post, -NET_POSTS), (0.0, post, 0.0)),
                "Net bottom": Line((0.0, 0.0, -NET_CENTRE), (0.0, post, -NET_POSTS)),
            }
        ),
    }
    return Field(
        LENGTH,
        DOUBLES_WIDTH,
        segments,
        stands=stands_beside(LENGTH, DOUBLES_WIDTH, away=(5.0, 40.0), up=(1.0, 20.0)),
        farthest_camera=80.0,
        lines=LineLook(width=LINE_WIDTH, ground_difference=1.0),
        size_known=True,
    )
