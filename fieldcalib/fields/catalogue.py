"""All fields by name, as the command line knows them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from types import MappingProxyType

from fieldcalib.fields.field import Field
from fieldcalib.fields.soccer import soccer
from fieldcalib.fields.sports.badminton import badminton
from fieldcalib.fields.sports.basketball import basketball
from fieldcalib.fields.sports.futsal import futsal
from fieldcalib.fields.sports.handball import handball
from fieldcalib.fields.sports.padel import padel
from fieldcalib.fields.sports.tennis import tennis
from fieldcalib.fields.sports.volleyball import volleyball

FIELDS: Mapping[str, Callable[[], Field]] = MappingProxyType(
    {
        "badminton": badminton,
        "basketball-fiba": partial(basketball, "fiba"),
        "basketball-nba": partial(basketball, "nba"),
        "futsal": futsal,
        "handball": handball,
        "padel": padel,
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
