"""Fields of American football: NFL and NCAA (both rule books, rule 1), with their goals."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from fieldcalib.fields.field import Field
from fieldcalib.fields.segments import Point, Segment
from fieldcalib.fields.sports.parts import across, along, court, upright
from fieldcalib.fields.traits import UNPAINTED, Crown, Paint, ProbabilityModel, stands_beside

FEET, YARD, INCH = 0.3048, 0.9144, 0.0254
LENGTH, WIDTH = 120.0 * YARD, 160.0 * FEET  # between the inner edges of the border, end zones included
GOAL_LINE = 50.0 * YARD  # its edge towards the field, from midfield
YARD_LINES = {yards: (50.0 - yards) * YARD for yards in range(5, 50, 5)}  # of the right half, from midfield
LINE_WIDTH, GOAL_LINE_WIDTH = 4.0 * INCH, 8.0 * INCH
HASH_LENGTH = 2.0 * FEET
BORDER = 6.0 * FEET
TRY_MARK_LENGTH = 1.0 * YARD
NUMBER_HEIGHT = 2.0 * YARD
YELLOW = "#f2cf2e"  # of the goals
POSTS_APART, CROSSBAR = 18.5 * FEET, 10.0 * FEET  # between the uprights; the top of the crossbar
POST = 4.0 * INCH  # diameter of uprights and crossbar
# Grass rises by 10 to 20 in from the side lines to the middle (the NFHS recommends 20), turf in stadiums hardly.
CROWN = Crown(share=0.5, height=14.0 * INCH)
POSTS_HEIGHT = CROSSBAR + 35.0 * FEET  # NFL; 30 ft above the ground at least in the NCAA

# The border lies outside its inner edge; of the two hash rows of a side, only the inner one is painted.
_BORDER = Paint(width=BORDER, outwards=0.5 * BORDER)
_MARKS = Paint(width=HASH_LENGTH, dashes=(LINE_WIDTH, YARD - LINE_WIDTH), outwards=0.5 * HASH_LENGTH)
PAINT: Mapping[str, Paint] = {
    **dict.fromkeys(("Goal line left", "Goal line right"), Paint(width=GOAL_LINE_WIDTH)),
    **dict.fromkeys(("Side line", "End line"), _BORDER),
    **dict.fromkeys(("Goal left", "Goal right"), Paint(colour=YELLOW)),
    **dict.fromkeys(("Side hash row", "Hash row bottom inner", "Hash row top inner"), _MARKS),
    **dict.fromkeys(("Hash row bottom outer", "Hash row top outer", "Number row"), UNPAINTED),
}


@dataclass(frozen=True)
class GridironRules:
    """Measures in which the rule books differ, metres."""

    hashes: float
    """Distance between the inner ends of the two rows of inbounds marks."""
    gap: float
    """Distance between the side line and the ends of yard lines and of the marks along it."""
    numbers: float
    """Distance of the bottoms of the numbers from the side line."""
    try_mark: float
    """Distance from the edge of the goal line towards the field."""
    probability: ProbabilityModel
    """Fitted to 1,500 synthetic frames: `python -m data_tools.probability fit --field american-football-nfl`."""


RULES: Mapping[str, GridironRules] = {
    "nfl": GridironRules(
        hashes=18.5 * FEET,
        gap=8.0 * INCH,
        numbers=12.0 * YARD,
        try_mark=2.0 * YARD,
        probability=ProbabilityModel((1.87, -3.41, -0.54, -0.32, -0.2)),
    ),
    "ncaa": GridironRules(
        hashes=40.0 * FEET,
        gap=4.0 * INCH,
        numbers=7.0 * YARD,
        try_mark=3.0 * YARD,
        probability=ProbabilityModel((1.49, -3.19, -0.61, 0.02, -0.62)),
    ),
}


def american_football(rules: str = "nfl") -> Field:
    """A field for American football: border, goal lines, yard lines each 5 yards, rows of marks and numbers, goals.

    Lines run along the middle of the paint. Side lines and end lines are the inner edge of the border, which is
    several feet wide. "left" and "right" are the ends as the main camera sees them, "top" is its far side, "bottom" the
    near one.

    * "Side line top", "End line left", "Goal line left" (8 in wide), "Yard line left 5" to "Yard line left 45", "Yard
      line 50", "Yard line right 45" and so on.
    * Rows, of which the marks are painted and not the line: "Hash row bottom inner", through the ends of the inbounds
      marks that face the middle of the field, and "outer"; "Side hash row bottom", through the inner ends of the marks
      along the side line; "Number row bottom inner" and "outer", through tops and bottoms of the numbers.
    * "Try mark left", "Goal left crossbar", "Goal left post top".
    * Points: "Hash left 20 bottom", "Hash 50 top", where a yard line meets the inner ends of the inbounds marks;
      "Corner left top", "Goal line and side line left top".

    Parameters
    ----------
    rules : {"nfl", "ncaa"}
        The rule book.

    Raises
    ------
    ValueError
        If there are no such rules.

    Notes
    -----
    Yard lines look alike: labels that are all 5 yards off, and show neither goal line nor numbers, fit a camera that
    stands 5 yards further along the field. Neither the residuals nor a weak prior reveal it: the message of such a
    calibration warns of it. Only the labels tell the two ends apart.

    Examples
    --------
    >>> round(american_football("nfl")["Yard line right 20"].start[0], 3)  # 30 yards
    27.432
    >>> round(american_football("ncaa")["Hash row bottom inner"].start[1], 3)
    6.096
    """
    if not isinstance(rules, str) or rules not in RULES:
        raise ValueError(f"expected rules of American football among {', '.join(RULES)}, got {rules!r}")
    one = RULES[rules]
    return court(
        (LENGTH, WIDTH),
        *_quarter(one),
        line_width=LINE_WIDTH,
        stands=stands_beside(LENGTH, WIDTH, away=(5.0, 75.0), up=(3.0, 50.0)),
        farthest_camera=300.0,
        paint=PAINT,
        probability=one.probability,
        repeats=5.0 * YARD,
        crown=CROWN,
    )


def _quarter(rules: GridironRules) -> Iterator[dict[str, Segment]]:
    """Lines and corners, rows of marks and numbers as lines through their ends, the goal, and ends of marks."""
    end, side, goal, yard_line = 0.5 * LENGTH, 0.5 * WIDTH, GOAL_LINE + 0.5 * GOAL_LINE_WIDTH, 0.5 * WIDTH - rules.gap
    inner, numbers = 0.5 * rules.hashes, side - rules.numbers
    post, bar = 0.5 * (POSTS_APART + POST), CROSSBAR - 0.5 * POST
    yield {
        "End line right": across(end, side),
        "Goal line right": across(goal, side),
        "Try mark right": across(GOAL_LINE - rules.try_mark, 0.5 * TRY_MARK_LENGTH),
        **{f"Yard line right {yards}": across(x, yard_line) for yards, x in YARD_LINES.items()},
    }
    yield {
        "Corner right bottom": Point((end, side, 0.0)),
        "Goal line and side line right bottom": Point((goal, side, 0.0)),
    }
    yield {"Side line bottom": along(end, side), "Yard line 50": across(0.0, yard_line)}
    yield {
        "Hash row bottom inner": along(49.0 * YARD, inner),
        "Hash row bottom outer": along(49.0 * YARD, inner + HASH_LENGTH),
        "Side hash row bottom": along(49.0 * YARD, side - rules.gap - HASH_LENGTH),
        "Number row bottom inner": along(42.0 * YARD, numbers - NUMBER_HEIGHT),
        "Number row bottom outer": along(42.0 * YARD, numbers),
    }
    yield {"Goal right crossbar": across(end, post, -bar)}
    yield {"Goal right post bottom": upright(end, post, POSTS_HEIGHT, bar)}
    yield {f"Hash right {yards} bottom": Point((x, inner, 0.0)) for yards, x in YARD_LINES.items()}
    yield {"Hash 50 bottom": Point((0.0, inner, 0.0))}
