"""The volleyball court (FIVB Official Volleyball Rules, rules 1 and 2), with its net."""

from __future__ import annotations

from fieldcalib.fields.field import Field
from fieldcalib.fields.segments import Line
from fieldcalib.fields.sports.parts import across, along, court, on_ground
from fieldcalib.fields.traits import Paint, ProbabilityModel, stands_beside

# In metres, to the outer edges of the lines.
LENGTH, WIDTH = 18.0, 9.0
LINE_WIDTH = 0.05
ATTACK_LINE = 3.0  # from the middle of the centre line to the rear edge
ATTACK_EXTENSION = (0.20, 1.75)  # dashes, from and to this distance from the side line
ATTACK_DASHES = (0.15, 0.20)  # and the gaps between them
SERVICE_MARK = (0.20, 0.15)  # behind the end line, length
NET_HEIGHTS = {"men": 2.43, "women": 2.24}
NET_DEPTH = 1.0  # from the upper to the lower edge
ANTENNA = (1.80, 0.80)  # length, and the part above the net
# Fitted to 1,500 synthetic frames: `python -m data_tools.probability fit --field volleyball`.
PROBABILITY = ProbabilityModel((0.14, -2.83, -1.34, -0.02, 0.06))


def volleyball(net: str = "men") -> Field:
    """A volleyball court: all lines, the net's edges between the antennae, and the antennae.

    Lines run along the middle of the paint. "left" and "right" are the sides of the net as the main camera sees
    them, "top" is the far side and "bottom" the near one. The dashes that go on with an attack line beyond a side line
    are an extension of their own. Posts are left out: the rules let them stand 0.5 to 1 m from the court.

    A court that is turned by 180 degrees is the same court.

    Parameters
    ----------
    net : {"men", "women"}
        Whose net it is: 2.43 m high, or 2.24 m.

    Raises
    ------
    ValueError
        If the net is another one.

    Examples
    --------
    >>> volleyball()["Attack line right"].start
    (2.975, -4.475, 0.0)
    >>> volleyball("women")["Net upper edge"].start
    (0.0, -4.5, -2.24)
    """
    if not isinstance(net, str) or net not in NET_HEIGHTS:
        raise ValueError(f"expected the net of a volleyball court, 'men' or 'women', got {net!r}")
    half, end, side = 0.5 * LINE_WIDTH, 0.5 * LENGTH, 0.5 * WIDTH  # outer edges
    attack, upper, lower = ATTACK_LINE - half, -NET_HEIGHTS[net], NET_DEPTH - NET_HEIGHTS[net]
    behind, (length, above) = end + SERVICE_MARK[0], ANTENNA
    segments = {
        "Side line bottom": along(end - half, side - half),
        "Centre line": across(0.0, side - half),
        "End line right": across(end - half, side - half),
        "Attack line right": across(attack, side - half),
        "Attack line extension right bottom": on_ground(*((attack, side + y) for y in ATTACK_EXTENSION)),
        "Service mark right bottom": on_ground((behind, side - half), (behind + SERVICE_MARK[1], side - half)),
    }
    net_segments = {
        "Net upper edge": across(0.0, side, upper),
        "Net lower edge": across(0.0, side, lower),
        "Antenna bottom": Line((0.0, side, upper - above), (0.0, side, upper - above + length)),
    }
    return court(
        (LENGTH, WIDTH),
        segments,
        net_segments,
        line_width=LINE_WIDTH,
        stands=stands_beside(LENGTH, WIDTH, away=(4.0, 35.0), up=(1.5, 15.0)),
        paint={"Attack line extension": Paint(dashes=ATTACK_DASHES)},
        farthest_camera=80.0,
        surface="floor",
        probability=PROBABILITY,
    )
