"""All fields by name, as the command line knows them: most are files in `sports`, the others functions there."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from difflib import get_close_matches
from functools import lru_cache, partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

from fieldcalib._types import one_of
from fieldcalib.fields.field import Field
from fieldcalib.fields.records import field_from_record
from fieldcalib.fields.sports.futsal import futsal
from fieldcalib.fields.sports.ice_hockey import ice_hockey, ice_hockey_iihf
from fieldcalib.fields.sports.rugby_union import rugby_union
from fieldcalib.fields.sports.soccer import soccer

AUTO = "auto"  # in the place of a name: some are tried on some of the pictures
FOLDER = Path(__file__).parent / "sports"
GRIDIRON = ("nfl", "ncaa")
BASKETBALL = ("fiba", "nba", "ncaa", "nfhs")
NETS = {"men": "volleyball", "women": "volleyball-women"}


@lru_cache
def _described(name: str) -> Field:
    """The field that a file describes; fields are immutable."""
    import yaml  # slow, and the field of soccer is no file

    return field_from_record(yaml.safe_load((FOLDER / f"{name}.yaml").read_text(encoding="utf-8")))


def american_football(rules: str = "nfl") -> Field:
    """A field for American football: border, goal lines, yard lines each 5 yards, rows of marks and numbers, goals.

    Lines run along the middle of the paint. Side lines and end lines are the inner edge of the border, which is
    several feet wide. "left" and "right" are the ends as the main camera sees them, "top" is its far side, "bottom" the
    near one. Measures and their sources: `sports/american-football-nfl.yaml`.

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
    return _described(f"american-football-{one_of(rules, GRIDIRON, 'rules of American football')}")


def badminton() -> Field:
    """A badminton court for doubles and singles: all lines, and the net with its posts on the doubles side lines.

    Lines run along the middle of the paint. "left" and "right" are the sides of the net as the main camera sees
    them, which looks across the court, "top" is the far side and "bottom" the near one; the net has two halves,
    since it sags. Most cameras of badminton stand behind a back line: the stand "behind left goal".

    A court that is turned by 180 degrees is the same court. Measures and their sources: `sports/badminton.yaml`.

    Examples
    --------
    >>> badminton()["Short service line right"].start[0]
    2.0
    """
    return _described("badminton")


def basketball(rules: str = "fiba") -> Field:
    """A basketball court: all lines and circles, backboards and rims.

    Lines run along the middle of the paint. "left" and "right" are the baskets as the main camera sees them, "top"
    is the far side and "bottom" the near one, but "upper" and "lower" are the edges of a backboard, between its
    vertical ones. The free-throw circle includes its dashed half. Marks along the lane are left out: they are
    10 cm long.

    A court that is turned by 180 degrees is the same court. Marks on one side only, that of the scorer's
    table or the other one, are therefore on both sides here: the throw-in and team bench lines of FIBA and the
    substitution marks of the NBA. Measures and their sources: `sports/basketball-fiba.yaml` and those beside it.

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
    return _described(f"basketball-{one_of(rules, BASKETBALL, 'rules of a basketball court')}")


def field_hockey() -> Field:
    """A field for hockey: outline, 23-metre and centre lines, circles, penalty spots, marks and goals.

    Lines run along the middle of the paint. "left" and "right" are the ends as the main camera sees them, "top" is
    its far side, "bottom" the near one. Measures and their sources: `sports/field-hockey.yaml`.

    * "Side line top", "Back line left", "Centre line", "23-metre line left".
    * The circle is "Circle left line", its straight part, and the quarters "Circle left arc top" and "bottom"; the
      broken one 5 m further out is named alike, "Broken circle left arc top".
    * Marks of 30 cm outside the lines: "Side mark left bottom 5 m" and "14.63 m", "Back mark left bottom 5 m" and
      "10 m".
    * "Goal left crossbar", "Goal left post top".
    * Points: "Penalty spot left", "Corner left top", "Centre line and side line top", "23-metre line and side line left
      top".

    Only the labels tell the two ends apart: a field that is turned by 180 degrees looks the same.

    Examples
    --------
    >>> field_hockey()["Circle right arc bottom"].radius, field_hockey()["Penalty spot right"].X[0]
    (14.5925, 39.225)
    """
    return _described("field-hockey")


def handball() -> Field:
    """A handball court: all lines, the goal areas, the dashed free-throw lines, and the goals.

    Lines run along the middle of the paint. "left" and "right" are the goals as the main camera sees them, "top" is
    the far side and "bottom" the near one, also of posts. The line from corner to corner is the goal line between the
    posts, where it is wider, and the outer goal line beside them. Goal area and free-throw line are one straight line
    and two arcs each. The throw-off circle, of 2022, is not on every court.

    A court that is turned by 180 degrees is the same court: the substitution marks, which are on the side of the
    benches only, are on both sides here. Measures and their sources: `sports/handball.yaml`.

    Examples
    --------
    >>> handball()["Free-throw right line"].start
    (11.025, -1.5, 0.0)
    """
    return _described("handball")


def padel() -> Field:
    """A padel court: service lines, the net with its posts, and the walls, of which the court has no lines.

    Lines run along the middle of the paint, walls where their inner side is. "left" and "right" are the sides of
    the net as the main camera sees them, which looks across the court, "top" is the far side and "bottom" the near one.
    "Back wall" and "Side wall" are the feet of the walls, "Glass" and "Fence" the upper edges of a back wall's glass
    and of the mesh above it, and "Corner" the vertical line where two walls meet. The net has two halves, since it
    sags. Most cameras of padel stand behind a back wall: the stand "behind left goal".

    A court that is turned by 180 degrees is the same court. Measures and their sources: `sports/padel.yaml`.

    Examples
    --------
    >>> padel()["Corner right bottom"]
    Line(start=(10.0, 5.0, -4.0), end=(10.0, 5.0, 0.0))
    """
    return _described("padel")


def tennis() -> Field:
    """A tennis court for doubles: base, side and service lines, centre marks, and the net with its posts.

    Lines run along the middle of the paint. "left" and "right" are the sides of the net as the main camera sees
    them, which looks across the court, "top" is the far side and "bottom" the near one; the net has two halves,
    since it sags. Most cameras of tennis stand behind a base line: the stand "behind left goal".

    A court that is turned by 180 degrees is the same court. Measures and their sources: `sports/tennis.yaml`.

    Examples
    --------
    >>> tennis()["Service line right"].start[0]
    6.375
    """
    return _described("tennis")


def volleyball(net: str = "men") -> Field:
    """A volleyball court: all lines, the net's edges between the antennae, and the antennae.

    Lines run along the middle of the paint. "left" and "right" are the sides of the net as the main camera sees
    them, "top" is the far side and "bottom" the near one. The dashes that go on with an attack line beyond a side line
    are an extension of their own. Posts are left out: the rules let them stand 0.5 to 1 m from the court.

    A court that is turned by 180 degrees is the same court. Measures and their sources: `sports/volleyball.yaml`.

    Parameters
    ----------
    net : {"men", "women"}
        Whose net it is: 2.43 m high, or 2.24 m, the field "volleyball-women".

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
    return _described(NETS[one_of(net, NETS, "net of a volleyball court")])


_WITH_CODE: dict[str, Callable[..., Field]] = {
    "futsal": futsal,
    "ice-hockey-iihf": ice_hockey_iihf,
    "ice-hockey-nhl": partial(ice_hockey, "nhl"),
    "ice-hockey-nhl-2013": partial(ice_hockey, "nhl-2013"),
    "rugby-union": rugby_union,
    "soccer": soccer,
    "volleyball": volleyball,
}
_OF_FILES: dict[str, Callable[..., Field]] = {
    path.stem: partial(_described, path.stem) for path in FOLDER.glob("*.yaml")
}
FIELDS: Mapping[str, Callable[..., Field]] = MappingProxyType(dict(sorted({**_OF_FILES, **_WITH_CODE}.items())))
COMPARED = (  # in place of `AUTO`; courts of schools are hardly told apart from that of the NBA
    *("american-football-ncaa", "american-football-nfl", "badminton", "basketball-fiba", "basketball-nba"),
    *("field-hockey", "futsal", "handball", "ice-hockey-iihf", "ice-hockey-nhl", "ice-hockey-nhl-2013", "padel"),
    *("rugby-union", "soccer", "tennis", "volleyball"),
)
CALLED_SOCCER = ("football", "association football", "fussball", "futbol")


def likely_fields(text: str) -> str:
    """A question to append to a message about an unknown name: fields with the word in them, else a similar one.

    Examples
    --------
    >>> likely_fields("football"), likely_fields("tenis"), likely_fields("chess")
    ('; did you mean soccer, american-football-ncaa or american-football-nfl?', '; did you mean tennis?', '')
    """
    word = text.lower().strip()
    with_word = ["soccer"] * (word in CALLED_SOCCER) + [name for name in FIELDS if word and word in name]
    *first, last = with_word or get_close_matches(word, FIELDS, n=1) or [""]
    return f"; did you mean {' or '.join(filter(None, (', '.join(first), last)))}?" if last else ""


def field(name: str, **options: Any) -> Field:
    """The field of a sport by its name.

    Parameters
    ----------
    name : str
        A key of `FIELDS`, such as ``"tennis"`` or ``"basketball-nba"``.
    **options
        Arguments of the sport's function, such as `length` and `width` of `soccer`.

    Raises
    ------
    ValueError
        If there is no such field; the message names the nearest ones.
    TypeError
        If the function of the sport has no such argument.

    Examples
    --------
    >>> field("tennis").length, field("soccer", length=104).length
    (23.77, 104.0)
    >>> field("tenis")
    Traceback (most recent call last):
        ...
    ValueError: expected a field among ..., volleyball-women, got 'tenis'; did you mean tennis?
    """
    if isinstance(name, str) and name in FIELDS:
        return FIELDS[name](**options)
    is_file = isinstance(name, str) and name.endswith((".yaml", ".yml", ".json"))
    hint = "; fieldcalib.io.field_files.read_field reads a file" if is_file else likely_fields(str(name))
    raise ValueError(f"expected a field among {', '.join(FIELDS)}, got {name!r}{hint}")


field_named = field  # its name in `fieldcalib.fields`, which has a module `field`
