"""The padel court (FIP Rules of Padel, rule 1), with its net and its walls."""

from __future__ import annotations

from fieldcalib.fields.field import Field
from fieldcalib.fields.sports.parts import across, along, court, hanging_net, upright
from fieldcalib.fields.traits import Paint, ProbabilityModel, stands_beside

# In metres.
LENGTH, WIDTH = 20.0, 10.0  # between the walls
LINE_WIDTH = 0.05
SERVICE_LINE = 6.95  # from the net to the edge towards it: the other edge is 3 m from the back wall
OVERLAP = 0.20  # of the central service line beyond the service line
NET_CENTRE, NET_POSTS = 0.88, 0.92  # height
WALL, STEEL = 0.10, "#30363c"  # thickness of the walls as seen from above; colour
GLASS, FENCE = 3.0, 4.0  # heights of the back walls: glass, and wire mesh above it
# Fitted to 1,500 synthetic frames: `python -m data_tools.probability fit --field padel`.
PROBABILITY = ProbabilityModel((1.66, -3.04, -0.73, -0.35, -0.16))


def padel() -> Field:
    """A padel court: service lines, the net with its posts, and the walls, of which the court has no lines.

    Lines run along the middle of the paint, walls where their inner side is. "left" and "right" are the sides of
    the net as the main camera sees them, which looks across the court, "top" is the far side and "bottom" the near one.
    "Back wall" and "Side wall" are the feet of the walls, "Glass" and "Fence" the upper edges of a back wall's glass
    and of the mesh above it, and "Corner" the vertical line where two walls meet. The net has two halves, since it
    sags. Most cameras of padel stand behind a back wall: the stand "behind left goal".

    A court that is turned by 180 degrees is the same court.

    Examples
    --------
    >>> padel()["Corner right bottom"]
    Line(start=(10.0, 5.0, -4.0), end=(10.0, 5.0, 0.0))
    """
    end, side, service = 0.5 * LENGTH, 0.5 * WIDTH, SERVICE_LINE + 0.5 * LINE_WIDTH
    segments = {
        "Central service line": along(SERVICE_LINE + LINE_WIDTH + OVERLAP, 0.0),
        "Service line right": across(service, side),
        "Back wall right": across(end, side),
        "Glass right": across(end, side, -GLASS),
        "Fence right": across(end, side, -FENCE),
        "Corner right bottom": upright(end, side, FENCE),
    }
    return court(
        (LENGTH, WIDTH),
        segments,
        {"Side wall bottom": along(end, side)},
        hanging_net(side, NET_CENTRE, NET_POSTS),
        line_width=LINE_WIDTH,
        stands=stands_beside(LENGTH, WIDTH, away=(2.0, 25.0), up=(1.5, 12.0)),
        paint=dict.fromkeys(("Back wall", "Side wall"), Paint(width=WALL, colour=STEEL)),
        farthest_camera=60.0,
        surface="turf",
        probability=PROBABILITY,
    )
