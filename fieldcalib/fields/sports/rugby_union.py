"""The field of rugby union (World Rugby, Laws of the Game, law 1), with its goals."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from fieldcalib._types import is_number
from fieldcalib.fields.field import Field
from fieldcalib.fields.segments import Point, Segment
from fieldcalib.fields.sports.parts import across, along, court, on_ground, upright
from fieldcalib.fields.traits import GRASS, LineLook, Paint, ProbabilityModel, SizePrior, stands_beside

# Law 1, in metres.
LEGAL = ((94.0, 100.0), (68.0, 70.0))  # length and width of the field of play
IN_GOAL = (6.0, 22.0)  # depth
USUAL_IN_GOAL = 10.0
LINE_WIDTH = 0.10  # usual; the law has none
TWENTY_TWO, TEN = 22.0, 10.0  # from the goal line, from the halfway line
FIVE, FIFTEEN = 5.0, 15.0  # from touch, and the dashes in front of the goal line
DASHED = ("10-metre line", "5-metre line", "15-metre line")
DASHES, ROW = (5.0, 5.0), (1.0, 9.0)  # of these lines, of the row in front of a goal line: dashes and gaps, about
POSTS_APART, CROSSBAR = 5.6, 3.0  # between the posts; the top of the crossbar
POSTS = 0.12  # diameter
POSTS_HEIGHT = 15.0  # at least 3.4; those of stadiums reach 10 to 17
# Fitted to 1,500 synthetic frames: `python -m data_tools.probability fit --field rugby-union`.
PROBABILITY = ProbabilityModel((1.57, -2.84, -1.26, -0.14, -0.32))


@dataclass(frozen=True)
class BuilderWithInGoal:
    """Builder of fields of any length and width with in-goal areas of one depth."""

    in_goal: float = USUAL_IN_GOAL

    def __call__(self, length: float, width: float) -> Field:
        """`rugby_union` of a length and a width."""
        return rugby_union(length, width, in_goal=self.in_goal)


def rugby_union(
    length: float = 100.0, width: float = 70.0, *, in_goal: float = USUAL_IN_GOAL, size_known: bool = False
) -> Field:
    """A field for rugby union: outline, goal lines, 22s, halfway line, the dashed lines, in-goal areas and goals.

    Lines run along the middle of the paint. Goal lines and touchlines lie outside the field of play, the lines of
    the 22s inside these; for the others the law names no edge. "left" and "right" are the ends as the main camera sees
    them, "top" is its far side, "bottom" the near one.

    * "Touchline top", "Goal line left", "22-metre line left", "Halfway line", "Dead-ball line left", "Touch-in-goal
      line left top".
    * Dashed: "10-metre line left", "5-metre line top" and "15-metre line top" along the touchlines, and "5-metre dashes
      left", a row in front of the goal line.
    * "Goal left crossbar", "Goal left post top".
    * Points: "Halfway line and touchline top", "Goal line and touchline left top", "22-metre line and touchline left
      top", "Dead-ball corner left top".

    Only the labels tell the two ends apart: a field that is turned by 180 degrees looks the same.

    Parameters
    ----------
    length, width : float
        Size of the field of play, from goal line to goal line and from touch to touch, metres.
    in_goal : float
        Depth of each in-goal area, 6 to 22 m.
    size_known : bool
        Whether the field in view has exactly this size.

    Raises
    ------
    ValueError
        If the law does not allow such a size.

    Examples
    --------
    >>> rugby_union(length=98.0)["22-metre line right"].start[0]
    27.05
    """
    for name, value, (low, high), beyond in (
        ("long", length, LEGAL[0], 1.0),  # `Field.motion` steps a metre beyond
        ("wide", width, LEGAL[1], 1.0),
        ("deep in goal", in_goal, IN_GOAL, 0.0),
    ):
        if not (is_number(value) and low - beyond <= value <= high + beyond):
            raise ValueError(f"a field of rugby union is {low:g} to {high:g} m {name}, got {value}")
    return court(
        (length, width),
        *_markings(length, width, in_goal),
        line_width=LINE_WIDTH,
        stands=stands_beside(length, width, away=(5.0 + in_goal, 75.0), up=(3.0, 40.0)),
        paint={**dict.fromkeys(DASHED, Paint(dashes=DASHES)), "5-metre dashes": Paint(dashes=ROW)},
        lines=LineLook(width=LINE_WIDTH),
        farthest_camera=300.0,
        size_model=SizePrior(LEGAL, LEGAL, build=BuilderWithInGoal(in_goal), rules="law 1"),
        crown=GRASS,
        size_known=size_known,
        probability=PROBABILITY,
    )


def _markings(length: float, width: float, in_goal: float) -> Iterator[dict[str, Segment]]:
    half, end, side = 0.5 * LINE_WIDTH, 0.5 * length, 0.5 * width
    goal, touch, x22, dead = end + half, side + half, end - TWENTY_TWO + half, end + in_goal + half
    five, dashes = side - FIVE, end - FIVE
    post, bar = 0.5 * (POSTS_APART + POSTS), CROSSBAR - 0.5 * POSTS
    yield {
        "Goal line right": across(goal, touch),
        "22-metre line right": across(x22, touch),
        "10-metre line right": across(TEN, touch),
        "Dead-ball line right": across(dead, touch),
        "5-metre dashes right": across(dashes, five + 0.5),
        "Goal right crossbar": across(goal, post, -bar),
    }
    yield {
        "Touchline bottom": along(goal, touch),
        "5-metre line bottom": along(dashes, five),
        "15-metre line bottom": along(dashes, side - FIFTEEN),
        "Halfway line and touchline bottom": Point((0.0, touch, 0.0)),
    }
    yield {
        "Touch-in-goal line right bottom": on_ground((goal, touch), (dead, touch)),
        "Goal right post bottom": upright(goal, post, POSTS_HEIGHT),
        "Goal line and touchline right bottom": Point((goal, touch, 0.0)),
        "22-metre line and touchline right bottom": Point((x22, touch, 0.0)),
        "Dead-ball corner right bottom": Point((dead, touch, 0.0)),
    }
    yield {"Halfway line": across(0.0, touch)}
