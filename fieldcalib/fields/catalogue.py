"""All fields by name, as the command line knows them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

from fieldcalib.fields.field import Field
from fieldcalib.fields.soccer import soccer
from fieldcalib.fields.sports.tennis import tennis

FIELDS: Mapping[str, Callable[[], Field]] = MappingProxyType(
    {
        "soccer": soccer,
        "tennis": tennis,
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
