"""The basketball courts of FIBA (Official Basketball Rules, art. 2 and 3), the NBA, the NCAA and the NFHS (rule 1)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fieldcalib.fields.field import Field
from fieldcalib.fields.segments import Arc, Segment
from fieldcalib.fields.sports.parts import CENTRE, across, along, court, on_ground, upright, with_top
from fieldcalib.fields.traits import ProbabilityModel, stands_beside

FOOT, INCH = 0.3048, 0.0254
RING_STEEL = 0.018  # thickness: 16 to 20 mm
# Views of games are often cut out of wider pictures: of 164 measured cameras half have their principal point more than
# 0.26 widths from the middle of their views.
PRINCIPAL_POINT = 0.3
# Fitted to 1,500 synthetic frames: `python -m data_tools.probability fit --field basketball-fiba`.
PROBABILITY = {
    "fiba": ProbabilityModel((1.48, -3.26, -1.04, -0.27, -0.14)),
    "nba": ProbabilityModel((1.23, -3.38, -0.73, -0.02, -0.45)),
    "ncaa": ProbabilityModel((1.91, -3.19, -0.89, -0.14, -0.64)),
    "nfhs": ProbabilityModel((1.72, -3.14, -0.58, -0.24, -0.42)),
}


@dataclass(frozen=True)
class Measures:
    """Measures of a court, in metres; distances along the court are from the inner edge of the end line."""

    length: float
    """Between the inner edges of the end lines."""
    width: float
    """Between the inner edges of the side lines."""
    line_width: float
    beyond: float
    """Length of the centre line beyond the side lines."""
    circle: float
    """Radius of centre and free-throw circles, to the outer edge."""
    basket: float
    """Distance of its centre."""
    backboard: float
    """Distance of its face."""
    board: tuple[float, float, float]
    """Width of the backboard, heights of its lower and its upper edge."""
    ring: tuple[float, float]
    """Inner radius and height."""
    three_point: tuple[float, float]
    """Radius of the arc, and distance of the straight lines from the middle of the court, to the outer edges."""
    lane_width: float
    """Between outer edges."""
    free_throw_line: float
    """Distance of its outer edge."""
    no_charge: float | None
    """Radius to the inner edge; None where there is no such arc."""

    @property
    def end(self) -> float:
        """Distance of the middle of the end line from the centre."""
        return 0.5 * self.length + 0.5 * self.line_width

    @property
    def side(self) -> float:
        """Distance of the middle of the side line from the centre."""
        return 0.5 * self.width + 0.5 * self.line_width


FIBA = Measures(
    length=28.0,
    width=15.0,
    line_width=0.05,
    beyond=0.15,
    circle=1.80,
    basket=1.575,
    backboard=1.20,
    board=(1.80, 2.90, 3.95),
    ring=(0.225, 3.05),
    three_point=(6.75, 6.60),
    lane_width=4.90,
    free_throw_line=5.80,
    no_charge=1.25,
)
NBA = Measures(
    length=94 * FOOT,
    width=50 * FOOT,
    line_width=2 * INCH,
    beyond=0.0,
    circle=6 * FOOT,
    basket=5.25 * FOOT,
    backboard=4 * FOOT,
    board=(6 * FOOT, 9.5 * FOOT, 13 * FOOT),
    ring=(9 * INCH, 10 * FOOT),
    three_point=(23.75 * FOOT, 22 * FOOT),
    lane_width=16 * FOOT,
    free_throw_line=19 * FOOT,
    no_charge=4 * FOOT,
)
NCAA = replace(NBA, three_point=(22 * FOOT + 1.75 * INCH, 21 * FOOT + 7.875 * INCH), lane_width=12 * FOOT)
NFHS = replace(  # of high schools
    NCAA, length=84 * FOOT, three_point=(19.75 * FOOT, 19.75 * FOOT), no_charge=None
)
RULES = {"fiba": FIBA, "nba": NBA, "ncaa": NCAA, "nfhs": NFHS}
THROW_IN = (8.325, 0.15)  # FIBA: from the end line to the outer edge, length beyond the side line
TEAM_BENCH = (5.0, 2.0)  # FIBA: from the centre to the inner edge, length beyond the side line
INNER_CIRCLE = 2 * FOOT  # NBA: radius of the inner edge
INNER_LANE = 12 * FOOT  # NBA: width between outer edges
HASH_MARK = (28 * FOOT, 3 * FOOT)  # NBA: from the end line, length into the court
SUBSTITUTION = (4 * FOOT, 4 * FOOT)  # NBA: from the centre line, length beyond the side line; between the inner edges


def basketball(rules: str = "fiba") -> Field:
    """A basketball court: all lines and circles, backboards and rims.

    Lines run along the middle of the paint. "left" and "right" are the baskets as the main camera sees them, "top"
    is the far side and "bottom" the near one, but "upper" and "lower" are the edges of a backboard, between its
    vertical ones. The free-throw circle includes its dashed half. Marks along the lane are left out: they are
    10 cm long.

    A court that is turned by 180 degrees is the same court. Marks on one side only, that of the scorer's
    table or the other one, are therefore on both sides here: the throw-in and team bench lines of FIBA and the
    substitution marks of the NBA.

    Parameters
    ----------
    rules : {"fiba", "nba", "ncaa", "nfhs"}
        FIBA: 28 x 15 m. NBA: 94 x 50 ft, with the inner circle and the inner lane lines, and with 28-foot marks. NCAA,
        of colleges: as large, with a lane of 12 ft and the three-point line of FIBA. NFHS, of high schools: 84 x 50 ft,
        with a three-point line at 19 ft 9 in and no arc below the basket.

    Raises
    ------
    ValueError
        If there are no such rules.

    Examples
    --------
    >>> basketball("fiba")["End line right"].start
    (14.025, -7.525, 0.0)
    >>> sorted(basketball("nba").keys() - basketball("fiba").keys())[0]
    '28-foot mark left bottom'
    """
    if not isinstance(rules, str) or rules not in RULES:
        raise ValueError(f"expected the rules of a basketball court, {', '.join(map(repr, RULES))}, got {rules!r}")
    m, more = RULES[rules], {"fiba": _only_fiba, "nba": _only_nba}.get(rules, dict)()
    return court(
        (m.length, m.width),
        _quarter(m),
        more,
        line_width=m.line_width,
        stands=stands_beside(m.length, m.width, away=(4.0, 35.0), up=(1.5, 15.0), principal_point=PRINCIPAL_POINT),
        farthest_camera=80.0,
        surface="wood",
        probability=PROBABILITY[rules],
    )


def _quarter(m: Measures) -> dict[str, Segment]:
    """The lines of both rule books, the backboard and the rim."""
    half, beyond = 0.5 * m.line_width, 0.5 * m.width + m.line_width + m.beyond
    basket, board = 0.5 * m.length - m.basket, 0.5 * m.length - m.backboard
    lane, free_throw = 0.5 * m.lane_width - half, 0.5 * m.length - m.free_throw_line + half
    arc, arc_y = (outer - half for outer in m.three_point)
    turn = float(np.arcsin(arc_y / arc))
    (board_width, lower, upper), (ring, height) = m.board, m.ring
    return {
        "Side line bottom": along(m.end, m.side),
        "Centre line": across(0.0, beyond if m.beyond else m.side),
        "Centre circle": Arc(CENTRE, m.circle - half),
        "End line right": across(m.end, m.side),
        "Three-point arc right": Arc((basket, 0.0, 0.0), arc, np.pi - turn, np.pi + turn),
        **with_top(
            {"Three-point line right bottom": on_ground((basket - arc * float(np.cos(turn)), arc_y), (m.end, arc_y))}
        ),
        "Lane right bottom": on_ground((free_throw, lane), (m.end, lane)),
        "Free-throw line right": across(free_throw, lane),
        "Free-throw circle right": Arc((free_throw, 0.0, 0.0), m.circle - half, 0.5 * np.pi, 1.5 * np.pi),
        **({} if m.no_charge is None else _no_charge(basket, board, m.no_charge + half)),
        "Rim right": Arc((basket, 0.0, -height), ring + 0.5 * RING_STEEL),
        "Backboard right upper": across(board, 0.5 * board_width, -upper),
        "Backboard right lower": across(board, 0.5 * board_width, -lower),
        "Backboard right bottom": upright(board, 0.5 * board_width, upper, lower),
    }


def _no_charge(basket: float, board: float, radius: float) -> dict[str, Segment]:
    """The arc below a basket, and its straight ends up to the face of the backboard."""
    return {
        "No-charge arc right": Arc((basket, 0.0, 0.0), radius, 0.5 * np.pi, 1.5 * np.pi),
        "No-charge line right bottom": on_ground((basket, radius), (board, radius)),
    }


def _only_fiba() -> dict[str, Segment]:
    half, side = 0.5 * FIBA.line_width, FIBA.side
    throw_in, bench = 0.5 * FIBA.length - THROW_IN[0] + half, TEAM_BENCH[0] + half
    return {
        "Throw-in line right bottom": on_ground((throw_in, side), (throw_in, side + half + THROW_IN[1])),
        "Team bench line right bottom": on_ground((bench, side), (bench, side + half + TEAM_BENCH[1])),
    }


def _only_nba() -> dict[str, Segment]:
    half, side = 0.5 * NBA.line_width, NBA.side
    lane, free_throw = 0.5 * INNER_LANE - half, 0.5 * NBA.length - NBA.free_throw_line + half
    mark, substitution = 0.5 * NBA.length - HASH_MARK[0] - half, half + SUBSTITUTION[0] + half
    return {
        "Inner centre circle": Arc(CENTRE, INNER_CIRCLE + half),
        "Inner lane right bottom": on_ground((free_throw, lane), (NBA.end, lane)),
        "28-foot mark right bottom": on_ground((mark, side - half - HASH_MARK[1]), (mark, side)),
        "Substitution mark right bottom": on_ground(
            (substitution, side), (substitution, side + half + SUBSTITUTION[1])
        ),
    }
