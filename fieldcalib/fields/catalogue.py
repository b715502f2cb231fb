"""All fields by name, as the command line knows them: functions, and files beside them in `sports`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from difflib import get_close_matches
from functools import lru_cache, partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

from fieldcalib.fields.field import Field
from fieldcalib.fields.records import field_from_record
from fieldcalib.fields.sports.american_football import american_football
from fieldcalib.fields.sports.badminton import badminton
from fieldcalib.fields.sports.basketball import basketball
from fieldcalib.fields.sports.field_hockey import field_hockey
from fieldcalib.fields.sports.futsal import futsal
from fieldcalib.fields.sports.handball import handball
from fieldcalib.fields.sports.ice_hockey import ice_hockey, ice_hockey_iihf
from fieldcalib.fields.sports.padel import padel
from fieldcalib.fields.sports.rugby_union import rugby_union
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.fields.sports.tennis import tennis
from fieldcalib.fields.sports.volleyball import volleyball

AUTO = "auto"  # in the place of a name: some are tried on some of the pictures
OF_FILES = Path(__file__).parent / "sports"


@lru_cache
def _described(name: str) -> Field:
    """The field that a file describes; fields are immutable."""
    import yaml  # slow, and most fields are no files

    return field_from_record(yaml.safe_load((OF_FILES / f"{name}.yaml").read_text(encoding="utf-8")))


OF_FUNCTIONS: Mapping[str, Callable[..., Field]] = MappingProxyType(
    {
        "american-football-ncaa": partial(american_football, "ncaa"),
        "american-football-nfl": partial(american_football, "nfl"),
        "badminton": badminton,
        "basketball-fiba": partial(basketball, "fiba"),
        "basketball-nba": partial(basketball, "nba"),
        "basketball-ncaa": partial(basketball, "ncaa"),
        "basketball-nfhs": partial(basketball, "nfhs"),
        "field-hockey": field_hockey,
        "futsal": futsal,
        "handball": handball,
        "ice-hockey-iihf": ice_hockey_iihf,
        "ice-hockey-nhl": partial(ice_hockey, "nhl"),
        "ice-hockey-nhl-2013": partial(ice_hockey, "nhl-2013"),
        "padel": padel,
        "rugby-union": rugby_union,
        "soccer": soccer,
        "tennis": tennis,
        "volleyball": volleyball,
    }
)
_FROM_FILES: dict[str, Callable[..., Field]] = {
    path.stem: partial(_described, path.stem) for path in OF_FILES.glob("*.yaml")
}
FIELDS: Mapping[str, Callable[..., Field]] = MappingProxyType(dict(sorted({**_FROM_FILES, **OF_FUNCTIONS}.items())))
CALLED_SOCCER = ("football", "association football", "fussball", "futbol")
ALIKE = ("basketball-ncaa", "basketball-nfhs")  # hardly told apart from the court of the NBA
COMPARED = tuple(name for name in OF_FUNCTIONS if name not in ALIKE)  # in place of `AUTO`


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
    ValueError: expected a field among ..., volleyball, got 'tenis'; did you mean tennis?
    """
    if isinstance(name, str) and name in FIELDS:
        return FIELDS[name](**options)
    raise ValueError(f"expected a field among {', '.join(FIELDS)}, got {name!r}{likely_fields(str(name))}")


field_named = field  # its name in `fieldcalib.fields`, which has a module `field`
