"""Rinks of ice hockey: NHL (rule book, rule 1), as before the season of 2014, and IIHF (rule book, section 1)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import product
from pathlib import Path

import numpy as np

from fieldcalib._types import is_number, one_of
from fieldcalib.fields.field import Field
from fieldcalib.fields.segments import Arc, Line, Point, Segment
from fieldcalib.fields.sports.parts import CENTRE, across, along, court, on_ground, right_goal
from fieldcalib.fields.traits import UNPAINTED, LineLook, Paint, ProbabilityModel, SizePrior, stands_beside

POST = 0.06  # metres: diameter of the goal's tubes, 2 3/8 in
RED, BLUE, YELLOW = "#c8102e", "#1040a8", "#e3b92c"  # of lines and spots, of the kick plate
KICK_PLATE = 0.10  # metres: how wide it is drawn from above
MEASURES = Path(__file__).parent / "rinks" / "measures.yaml"
RULES = ("nhl", "nhl-2013", "iihf")
SPOTS = ("Face-off spot", "Neutral spot")
LEGAL_IIHF = ((56.0, 61.0), (26.0, 30.0))  # length and width; since 2021 rinks of tournaments are 60 m long
USUAL_IIHF = ((59.5, 60.5), (26.0, 30.0))


@dataclass(frozen=True)
class RinkRules:
    """Measures of a rink, in metres, to the edges of the paint that the rule books name."""

    length: float
    width: float
    corner_radius: float
    line: float
    """Width of goal lines, circles and marks."""
    wide_line: float
    """Width of the blue lines and of the centre line."""
    goal_line: float
    """Middle of the line, from the end boards."""
    blue_line: float
    """Middle of the line, from the end boards."""
    circle: float
    """Outer radius of all face-off circles."""
    circle_x: float
    """Spot of an end, from the end boards."""
    spots_y: float
    """Spots of ends and neutral zone, from the middle of the rink."""
    neutral_spot: float
    """Spot of the neutral zone, from the nearer edge of the blue line."""
    hashes_apart: float
    """Between the inner edges of two hash marks."""
    hash_length: float
    l_corner: tuple[float, float]
    """Edges of an L mark that face the spot, from its centre, along the rink and across."""
    l_legs: tuple[float, float]
    """Lengths from the middle of the paint at the corner."""
    crease: float
    """Outer radius, around the middle of the goal line."""
    crease_width: float
    """Between the outer edges of the straight sides; infinite where the crease is a half circle."""
    spot: float
    """Diameter of all face-off spots but that of the centre."""
    centre_spot: float
    trapezoid: tuple[float, float]
    """Half of its width at the goal line and at the end boards."""
    referee: float
    """Outer radius of the referee's crease."""
    goal: tuple[float, float]
    """Width and height inside the posts and below the crossbar."""
    probability: tuple[float, float, float, float, float]
    """Coefficients of a `ProbabilityModel`, fitted to 1,500 synthetic frames: `python -m data_tools.probability fit
    --field ice-hockey-nhl`."""


@lru_cache
def rules_of(name: str) -> RinkRules:
    """The measures of a rule book, of those in `rinks/measures.yaml`."""
    import yaml  # slow, and few need a rink

    return RinkRules(**yaml.safe_load(MEASURES.read_text(encoding="utf-8"))[name])


def ice_hockey(rules: str = "nhl") -> Field:
    """A rink with its boards, lines, face-off circles and goals.

    "left" and "right" are the ends as the main camera sees them, "top" is its far side, "bottom" the near one.

    * Boards, where they meet the ice: "End board left", "Side board top", "Corner board right bottom" (an arc).
    * "Goal line left", "Centre line", "Blue line left" at the middle of their paint; of wide lines there are the edges
      too: "Blue line left inner edge", which faces the centre, and "outer edge", "Centre line left edge" and "right
      edge".
    * "Centre circle", "Face-off circle right bottom"; at each of the four "Hash mark right bottom TL" (far and left of
      its spot; TR, BL, BR) and an L, "L mark right bottom TL along" the rink and "across".
    * "Crease left" and its straight sides "Crease left top", "Trapezoid left top" behind the goal, and the referee's
      crease, "Referee crease top" or "bottom": the side of the timekeeper, whichever that is.
    * "Goal left crossbar", "Goal left post top".
    * Points: "Centre spot", "Neutral spot right bottom", "Face-off spot right bottom", "L mark right bottom TL corner",
      "along end" and "across end", "Hash mark right bottom TL inner end" (on the circle) and "outer end", and where
      lines meet: "Goal line and boards right bottom", "Goal line and trapezoid right bottom", "Blue line and boards
      right bottom", "Centre line and boards bottom", "Centre line and centre circle bottom".

    Parameters
    ----------
    rules : {"nhl", "nhl-2013", "iihf"}
        The rule book. Until 2014 the hash marks of the NHL were 3 ft apart, and the trapezoid 18 ft wide at the
        goal line. Rinks of the IIHF vary: `ice_hockey_iihf` takes their size.

    Raises
    ------
    ValueError
        If there are no such rules.

    Notes
    -----
    Only the labels tell the two ends apart: a rink that is turned by 180 degrees looks the same.

    The measures of the IIHF's trapezoid are from sportypy, not from the rule book's text.

    Examples
    --------
    >>> [round(x, 4) for x in ice_hockey("nhl")["Face-off spot right bottom"].X]  # 69 and 22 ft
    [21.0312, 6.7056, 0.0]
    >>> round(ice_hockey("iihf")["Blue line left"].start[0], 2)
    -7.14
    """
    one_of(rules, RULES, "rules of ice hockey")
    return ice_hockey_iihf() if rules == "iihf" else _rink(rules_of(rules), size_known=True)


def ice_hockey_iihf(
    length: float = 60.0, width: float = 30.0, *, corner_radius: float = 8.5, size_known: bool = False
) -> Field:
    """A rink of the IIHF, whose width is 26 to 30 m. Labels are those of `ice_hockey`.

    Parameters
    ----------
    length, width : float
        Size between the boards, metres.
    corner_radius : float
        Radius of the boards in the corners, 7.0 to 8.5 m.
    size_known : bool
        Whether the rink in view has exactly this size.

    Raises
    ------
    ValueError
        If the rules do not allow such a size.

    Examples
    --------
    >>> ice_hockey_iihf(width=28.0)["Side board bottom"].start[1]
    14.0
    """
    for name, value, (low, high) in (("long", length, LEGAL_IIHF[0]), ("wide", width, LEGAL_IIHF[1])):
        if not (is_number(value) and low - 1.0 <= value <= high + 1.0):  # `Field.motion` steps a metre beyond
            raise ValueError(f"a rink of the IIHF is {low:g} to {high:g} m {name}, got {value}")
    if not (is_number(corner_radius) and 7.0 <= corner_radius <= 8.5):
        raise ValueError(f"the corners of an IIHF rink have a radius of 7.0 to 8.5 m, got {corner_radius}")
    rules = replace(rules_of("iihf"), length=length, width=width, corner_radius=corner_radius)
    model = SizePrior(LEGAL_IIHF, USUAL_IIHF, build=ice_hockey_iihf, rules="the rule book")
    return _rink(rules, size_known, model)


def _rink(rules: RinkRules, size_known: bool, size_model: SizePrior | None = None) -> Field:
    rink = court(
        (rules.length, rules.width),
        *_quarter(rules),
        line_width=rules.line,
        stands=stands_beside(rules.length, rules.width, away=(5.0, 45.0), up=(3.0, 25.0)),
        farthest_camera=120.0,
        lines=LineLook(width=rules.line, lighter=False, ground_difference=np.inf),
        surface="ice",
        size_model=size_model,
        size_known=size_known,
        probability=ProbabilityModel(tuple(rules.probability)),  # type: ignore[arg-type]
    )
    return replace(rink, paint=_paint(rules, rink.segments))


def _paint(rules: RinkRules, segments: Mapping[str, Segment]) -> dict[str, Paint]:
    """Red lines but for the blue ones and the centre circle, spots, and the kick plate of the boards."""
    found = {label: Paint(colour=RED) for label, one in segments.items() if not one.is_point}
    found |= {label: UNPAINTED for label in segments if label.endswith("edge")}
    found |= {label: Paint(width=KICK_PLATE, colour=YELLOW) for label in segments if " board " in label}
    found |= {label: Paint(width=rules.wide_line, colour=BLUE) for label in ("Blue line left", "Blue line right")}
    found |= {"Centre line": Paint(width=rules.wide_line, colour=RED), "Centre circle": Paint(colour=BLUE)}
    found |= {label: Paint(width=rules.spot, colour=RED) for label in segments if label.startswith(SPOTS)}
    return found | {"Centre spot": Paint(width=rules.centre_spot, colour=BLUE)}


def _quarter(rules: RinkRules) -> Iterator[dict[str, Segment]]:
    """Boards and lines, the marks of the ends, goals and creases, and the points where lines meet."""
    end, side, r, half = 0.5 * rules.length, 0.5 * rules.width, rules.corner_radius, 0.5 * rules.line
    goal, blue, half_wide = end - rules.goal_line, end - rules.blue_line, 0.5 * rules.wide_line
    goal_corner = side - r + float(np.sqrt(r**2 - (r - rules.goal_line) ** 2))  # where goal line and boards meet
    yield {"End board right": across(end, side - r)}
    yield {"Side board bottom": along(end - r, side)}
    yield {"Corner board right bottom": Arc((end - r, side - r, 0.0), r, 0.0, 0.5 * np.pi)}
    yield {
        "Centre line": across(0.0, side),
        "Goal line right": across(goal, goal_corner),
        "Blue line right": across(blue, side),
        "Blue line right inner edge": across(blue - half_wide, side),
        "Blue line right outer edge": across(blue + half_wide, side),
        "Centre line right edge": across(half_wide, side),
    }
    yield _ends(rules)
    radius, (at_goal, at_boards), circle = rules.crease - half, rules.trapezoid, rules.circle - half
    y = min(0.5 * rules.crease_width - half, radius)
    angle = float(np.arcsin(y / radius))
    straight = {} if y == radius else {"Crease right bottom": on_ground((goal - radius * np.cos(angle), y), (goal, y))}
    yield {
        "Crease right": Arc((goal, 0.0, 0.0), radius, np.pi - angle, np.pi + angle),
        **right_goal(goal, *rules.goal, POST),
    }
    yield {
        "Trapezoid right bottom": on_ground((goal, at_goal), (end, at_boards)),
        "Goal line and trapezoid right bottom": Point((goal, at_goal, 0.0)),
        **straight,
    }
    yield {"Referee crease bottom": Arc((0.0, side, 0.0), rules.referee - half, -np.pi, 0.0)}
    yield {
        "Goal line and boards right bottom": Point((goal, goal_corner, 0.0)),
        "Blue line and boards right bottom": Point((blue, side, 0.0)),
    }
    yield {
        "Centre line and boards bottom": Point((0.0, side, 0.0)),
        "Centre line and centre circle bottom": Point((0.0, circle, 0.0)),
        "Centre circle": Arc(CENTRE, circle),
        "Centre spot": Point(CENTRE),
    }


def _ends(rules: RinkRules) -> dict[str, Segment]:
    """Spots and circles of ends and neutral zone, hash marks and L marks."""
    neutral = 0.5 * rules.length - rules.blue_line - 0.5 * rules.wide_line - rules.neutral_spot
    found: dict[str, Segment] = {}
    for (side, left), (end, top) in product((("left", -1.0), ("right", 1.0)), (("top", -1.0), ("bottom", 1.0))):
        x, y = left * (0.5 * rules.length - rules.circle_x), top * rules.spots_y
        found[f"Face-off circle {side} {end}"] = Arc((x, y, 0.0), rules.circle - 0.5 * rules.line)
        found[f"Face-off spot {side} {end}"] = Point((x, y, 0.0))
        found[f"Neutral spot {side} {end}"] = Point((left * neutral, y, 0.0))
        for (tb, sy), (lr, sx) in product((("T", -1.0), ("B", 1.0)), (("L", -1.0), ("R", 1.0))):
            found.update(_marks(rules, (x, y), (sx, sy), f"{side} {end} {tb}{lr}"))
    return found


def _marks(rules: RinkRules, spot: tuple[float, float], signs: tuple[float, float], name: str) -> dict[str, Segment]:
    """Hash mark and L mark in one quarter around a spot."""
    half = 0.5 * rules.line

    def line(x: float, y: float, dx: float, dy: float) -> Line:
        (x0, y0), (sx, sy) = spot, signs
        return on_ground((x0 + sx * x, y0 + sy * y), (x0 + sx * (x + dx), y0 + sy * (y + dy)))

    hash_mark = line(0.5 * rules.hashes_apart + half, rules.circle, 0.0, rules.hash_length)
    corner, (long, short) = (rules.l_corner[0] + half, rules.l_corner[1] + half), rules.l_legs
    legs = {"along": line(*corner, long, 0.0), "across": line(*corner, 0.0, short)}
    return {
        f"Hash mark {name}": hash_mark,
        f"Hash mark {name} inner end": Point(hash_mark.start),
        f"Hash mark {name} outer end": Point(hash_mark.end),
        **{f"L mark {name} {way}": leg for way, leg in legs.items()},
        f"L mark {name} corner": Point(legs["along"].start),
        **{f"L mark {name} {way} end": Point(leg.end) for way, leg in legs.items()},
    }
