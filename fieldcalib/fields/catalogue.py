"""All fields by name, as the command line knows them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from types import MappingProxyType

from fieldcalib.fields.field import Field
from fieldcalib.fields.soccer import soccer
from fieldcalib.fields.sports.american_football import american_football
from fieldcalib.fields.sports.badminton import badminton
from fieldcalib.fields.sports.basketball import basketball
from fieldcalib.fields.sports.field_hockey import field_hockey
from fieldcalib.fields.sports.futsal import futsal
from fieldcalib.fields.sports.handball import handball
from fieldcalib.fields.sports.ice_hockey import ice_hockey, ice_hockey_iihf
from fieldcalib.fields.sports.padel import padel
from fieldcalib.fields.sports.rugby_union import rugby_union
from fieldcalib.fields.sports.tennis import tennis
from fieldcalib.fields.sports.volleyball import volleyball

FIELDS: Mapping[str, Callable[[], Field]] = MappingProxyType(
    {
        "american-football-ncaa": partial(american_football, "ncaa"),
        "american-football-nfl": partial(american_football, "nfl"),
        "badminton": badminton,
        "basketball-fiba": partial(basketball, "fiba"),
        "basketball-nba": partial(basketball, "nba"),
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


def field_named(name: str) -> Field:
    """A field by its name in `FIELDS`.

    Raises
    ------
    ValueError
        If there is none.

    Examples
    --------
    >>> field_named("tennis").length
    23.77
    """
    if name not in FIELDS:
        raise ValueError(f"expected a field among {', '.join(FIELDS)}, got {name!r}")
    return FIELDS[name]()
