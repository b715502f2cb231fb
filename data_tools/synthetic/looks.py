"""Appearance of fields beyond `Field.paint`: grounds, painted areas, bars, surroundings.

Attributes that rule books leave open (floors, turf, the colour of the areas) are drawn from usual ones. Tables are
looked up by the beginnings of labels; the first entry that fits counts.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import Literal, TypeVar, get_args

from data_tools.synthetic import marks
from data_tools.synthetic.areas import Area, Fill
from data_tools.synthetic.colours import Hsv
from data_tools.synthetic.surroundings import Around
from fieldcalib.fields.field import Field
from fieldcalib.fields.segments import Arc
from fieldcalib.fields.sports import ice_hockey as rink

Surface = Literal["wood", "floor", "ice", "hard court", "clay", "sand", "turf", "blue turf", "grass"]
V = TypeVar("V")
ByLabel = tuple[tuple[str, V], ...]

WHITE: Hsv = (20.0, 220.0), (0.0, 0.06), (0.85, 1.0)
YELLOW: Hsv = (45.0, 60.0), (0.5, 0.9), (0.85, 1.0)
ORANGE: Hsv = (12.0, 30.0), (0.6, 0.9), (0.75, 0.95)
RED: Hsv = (-8.0, 8.0), (0.65, 0.95), (0.55, 0.85)
BLUE: Hsv = (205.0, 235.0), (0.6, 0.95), (0.4, 0.75)
LIGHT_BLUE: Hsv = (190.0, 215.0), (0.25, 0.55), (0.8, 0.95)
GREEN: Hsv = (95.0, 165.0), (0.4, 0.85), (0.25, 0.6)
DARK: Hsv = (0.0, 360.0), (0.0, 0.4), (0.08, 0.3)
STEEL: Hsv = (180.0, 240.0), (0.0, 0.15), (0.25, 0.65)
ANY: Hsv = (0.0, 360.0), (0.3, 0.9), (0.2, 0.65)

LIGHT_LINES = (WHITE, WHITE, WHITE, WHITE, YELLOW)
SMALL = 50.0  # m: shorter fields that are not in the catalogue have less room around them
INDOORS = ("wood", "floor", "ice")
MEDIUM = Around((1.5, 5.0), (0.3, 4.0), (0.0, 3.0))  # around courts in halls


@dataclass(frozen=True)
class Look:
    """Appearance of a kind of field."""

    surfaces: Sequence[Surface]
    """Surfaces, one of which is drawn."""
    around: Around = MEDIUM
    colours: Sequence[Hsv] = (WHITE,)
    """Colours for the lines that are white by the rules: one of them is drawn for all."""
    coloured: ByLabel[Hsv] = ()
    """Colours of bars above the ground that are not white."""
    widths: ByLabel[float] = ()
    """Widths of bars above the ground, metres."""
    striped: tuple[str, ...] = ()
    """Beginnings of labels of bars with white stripes."""
    edges: str | None = None
    """Ending of the labels of edges of wide lines: an edge is not a class of its own if its line is one."""
    marks: Callable[[Field], marks.Marks] = marks.no_marks
    """Makes painted markings without a label."""
    fills: Callable[[Field], Sequence[Fill]] = lambda field: ()
    """Makes painted areas, one on top of the other."""
    people: tuple[int, int] = (4, 20)
    """Least and largest number of people."""
    behind: float = 0.2
    """Share of the cameras behind the ends of the field."""
    indoors: bool = True
    nets: bool = True
    """Whether goals have nets."""
    boards: float = 0.0
    """Height of boards that are the border of a rink, metres."""
    overlaid: float = 0.0
    """Share of the floors that have the lines of another court too."""

    def width(self, label: str, default: float) -> float:
        """Width of a bar, metres."""
        return _first(self.widths, label, default)

    def colour(self, label: str, default: Hsv) -> Hsv:
        """Colour of a bar."""
        return _first(self.coloured, label, default)

    def is_edge(self, label: str) -> bool:
        """Whether a label is an edge of a wide line that has a label itself."""
        return self.edges is not None and label.endswith(self.edges)


def _first(table: ByLabel[V], label: str, default: V) -> V:
    return next((value for start, value in table if label.startswith(start)), default)


def look_of(name: str, field: Field) -> Look:
    """The appearance of a field of the catalogue, by its name, or of any other field, by its surface."""
    if name in LOOKS:
        return LOOKS[name]
    ground = next(one for one in get_args(Surface) if one == field.surface)
    return Look(
        (ground,),
        around=MEDIUM if max(field.length, field.width) < SMALL else Around(),
        colours=(WHITE,) if field.lines.lighter else (DARK, BLUE, RED),
        indoors=ground in INDOORS,
    )


def _radius(field: Field, label: str) -> float:
    arc = field[label]
    assert isinstance(arc, Arc)
    return arc.radius


def _basketball(field: Field) -> Sequence[Fill]:
    """Keys, the area within the three-point line, and the centre circle."""
    free_throw, lane = (marks.line_of(field, label) for label in ("Free-throw line right", "Lane right bottom"))
    end = 0.5 * field.length
    key, arc = Area((free_throw.start[0], 0.0), (end, lane.start[1])), field["Three-point arc right"]
    assert isinstance(arc, Arc)
    limits = end, marks.line_of(field, "Three-point line right bottom").start[1]
    colours = (ANY, BLUE, RED, DARK)
    return (
        Fill(Area((arc.center[0], 0.0), (end, 0.0), arc.radius, limits), (ANY, ORANGE), 0.3, 0.7),
        Fill(key, colours, 0.6, 0.9),
        Fill(Area((0.0, 0.0), (0.0, 0.0), _radius(field, "Centre circle")), colours, 0.4, 0.9),
    )


def _before_goals(name: str, field: Field) -> Sequence[Fill]:
    """The area before each goal."""
    line, end = marks.line_of(field, f"{name} right line"), 0.5 * field.length
    area = Area((end, 0.0), (end, line.end[1]), end - line.start[0], (end, 0.5 * field.width))
    return (Fill(area, (ANY, BLUE, ORANGE, RED), 0.6, 0.9),)


def _volleyball(field: Field) -> Sequence[Fill]:
    attack = marks.line_of(field, "Attack line right").start[0]
    return (Fill(Area((0.0, 0.0), (attack, 0.5 * field.width)), (ORANGE, ANY), 0.3, 0.8),)


def _american_football(field: Field) -> Sequence[Fill]:
    """End zones."""
    zone = Area((50.0 * marks.YARD, 0.0), (0.5 * field.length, 0.5 * field.width))
    return (Fill(zone, (ANY, BLUE, RED, GREEN), 0.7, 0.85),)


def _rugby(field: Field) -> Sequence[Fill]:
    """In-goal areas, which are often mown otherwise."""
    dead = marks.line_of(field, "Dead-ball line right").start[0]
    return (Fill(Area((0.5 * field.length, 0.0), (dead, 0.5 * field.width)), (GREEN,), 0.3, 0.5),)


def _ice(rules: rink.RinkRules, field: Field) -> Sequence[Fill]:
    """Creases."""
    goal = marks.line_of(field, "Goal line right").start[0]
    half = min(0.5 * rules.crease_width, rules.crease)
    return (Fill(Area((goal, 0.0), (goal, 0.0), rules.crease, (goal, half)), (LIGHT_BLUE,), 1.0, 0.9),)


def _ice_hockey(rules: rink.RinkRules) -> Look:
    return Look(
        ("ice",),
        around=Around(None, (0.0, 2.5), (0.0, 2.0)),
        coloured=(("Goal", RED),),
        widths=(("Goal", rink.POST),),
        edges="edge",
        fills=partial(_ice, rules),
        people=(6, 14),
        boards=1.07,
    )


BASKETBALL_BARS: ByLabel[float] = (("Rim", 0.018), ("Backboard", 0.05))
BASKETBALL_COLOURS: ByLabel[Hsv] = (("Rim", ORANGE),)
NET_BARS: ByLabel[float] = (("Net post", 0.08), ("Net", 0.06))
NET_COLOURS: ByLabel[Hsv] = (("Net post", STEEL),)


def _basketball_look(marks_of: Callable[[Field], marks.Marks], overlaid: float) -> Look:
    return Look(
        ("wood", "wood", "wood", "floor"),
        around=Around((1.5, 4.0), (0.3, 4.0), (0.0, 2.0)),
        colours=LIGHT_LINES,
        coloured=BASKETBALL_COLOURS,
        widths=BASKETBALL_BARS,
        marks=marks_of,
        fills=_basketball,
        people=(6, 16),
        overlaid=overlaid,
    )


def _football_look() -> Look:
    return Look(
        ("grass", "turf"),
        around=Around((3.0, 9.0), past=(6.0 * marks.FEET, 6.0 * marks.FEET)),
        coloured=(("Goal left", YELLOW), ("Goal right", YELLOW)),
        widths=(("Goal", marks.FEET / 3.0),),
        marks=marks.field_numbers,
        fills=_american_football,
        people=(8, 26),
        indoors=False,
        nets=False,
    )


LOOKS: Mapping[str, Look] = MappingProxyType(
    {
        "american-football-ncaa": _football_look(),
        "american-football-nfl": _football_look(),
        "badminton": Look(
            ("floor", "floor", "wood"),
            around=Around((1.5, 3.0), (0.3, 4.0), (0.0, 2.0)),
            colours=LIGHT_LINES,
            coloured=NET_COLOURS,
            widths=(("Net post", 0.04), ("Net", 0.075)),
            people=(2, 6),
            behind=0.6,
            overlaid=0.2,
        ),
        "basketball-fiba": _basketball_look(marks.fiba_lane, 0.2),
        "basketball-nba": _basketball_look(marks.nba_lane, 0.0),
        "basketball-ncaa": _basketball_look(marks.no_marks, 0.1),
        "basketball-nfhs": _basketball_look(marks.no_marks, 0.3),
        "field-hockey": Look(
            ("blue turf", "blue turf", "grass"),
            around=Around((3.0, 6.0)),
            widths=(("Goal", 0.05),),
            people=(8, 24),
            indoors=False,
        ),
        "futsal": Look(
            ("floor", "wood", "floor"),
            colours=LIGHT_LINES,
            widths=(("Goal", 0.08),),
            fills=partial(_before_goals, "Penalty area"),
            people=(6, 14),
            overlaid=0.2,
        ),
        "handball": Look(
            ("floor", "floor", "wood"),
            colours=LIGHT_LINES,
            widths=(("Goal", 0.08),),
            coloured=(("Goal left", RED), ("Goal right", RED)),
            striped=("Goal left", "Goal right"),
            fills=partial(_before_goals, "Goal area"),
            people=(8, 18),
            overlaid=0.2,
        ),
        "ice-hockey-iihf": _ice_hockey(rink.rules_of("iihf")),
        "ice-hockey-nhl": _ice_hockey(rink.rules_of("nhl")),
        "ice-hockey-nhl-2013": _ice_hockey(rink.rules_of("nhl-2013")),
        "padel": Look(
            ("blue turf",),
            around=Around(None, (1.0, 6.0), (1.0, 5.0)),
            coloured=(("Glass", STEEL), ("Fence", STEEL), ("Corner", STEEL), *NET_COLOURS),
            widths=(("Glass", 0.06), ("Fence", 0.06), ("Corner", 0.08), *NET_BARS),
            people=(2, 5),
            behind=0.7,
        ),
        "rugby-union": Look(
            ("grass",),
            around=Around((3.0, 8.0), past=(11.0, 0.5)),
            widths=(("Goal", 0.12),),
            fills=_rugby,
            people=(10, 34),
            indoors=False,
            nets=False,
        ),
        "tennis": Look(
            ("hard court", "hard court", "clay", "grass"),
            around=Around((3.0, 8.0), (0.3, 4.0), (0.0, 3.0)),
            coloured=NET_COLOURS,
            widths=NET_BARS,
            people=(2, 8),
            behind=0.75,
            indoors=False,
        ),
        "volleyball": Look(
            ("floor", "floor", "wood"),
            around=Around((3.0, 6.0), (0.3, 4.0), (0.0, 2.0)),
            colours=LIGHT_LINES,
            coloured=(("Antenna", RED),),
            striped=("Antenna",),
            widths=(("Antenna", 0.02), ("Net upper", 0.07), ("Net lower", 0.05)),
            fills=_volleyball,
            people=(6, 16),
            behind=0.35,
            overlaid=0.2,
        ),
    }
)
