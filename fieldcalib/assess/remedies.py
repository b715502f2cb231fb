"""Advice on a camera in plain words, and how it is followed on the command line, in Python and on the page.

A result is read by people who use different tools: its `remedy` names none of them, and each tool adds `how`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from enum import Enum, StrEnum
from types import MappingProxyType
from typing import NamedTuple

from fieldcalib.fields.catalogue import FIELDS

LOOK = "look at the overlay"
BY_HAND = "labelled by hand"
KNOWN_CAMERA = "what is known of the camera"
PICTURE = "what the picture is of"
OTHER_FIELD = "name the field"


class Advice(StrEnum):
    """What a remedy asks for; each tool has its own way to do it (`HOW`)."""

    LOOK = "look"
    BY_HAND = "by hand"
    KNOWN_CAMERA = "known camera"
    PICTURE = "picture"
    OTHER_FIELD = "other field"
    FIELD_SIZE = "field size"


class Remedy(NamedTuple):
    """What would help a camera: in words, and as what is asked for."""

    text: str = ""
    advice: tuple[Advice, ...] = ()

    def and_also(self, *others: Remedy) -> Remedy:
        """Several remedies as one."""
        several = (self, *others)
        return Remedy("; ".join(one.text for one in several), tuple(one for each in several for one in each.advice))


NOTHING = Remedy()
LEFT_OUT = "leave out what you gave and may be wrong"
OTHER_SPORT = Remedy(f"if it is another sport, {OTHER_FIELD}", (Advice.OTHER_FIELD,))
OFF_PAINT = Remedy(f"{LOOK}; give the known length and width of the field", (Advice.LOOK, Advice.FIELD_SIZE))
NOT_WHOLE = Remedy(
    f"say {PICTURE}: a part of a frame, a whole frame of that shape, or a squashed one", (Advice.PICTURE,)
)
SMALLER = Remedy(f"{LOOK}; if the field is a smaller one, {OTHER_FIELD}", (Advice.LOOK, Advice.OTHER_FIELD))
NOT_SOCCER = Remedy(
    f"if it is not soccer, {OTHER_FIELD}: {', '.join(name for name in FIELDS if name != 'soccer')}",
    (Advice.OTHER_FIELD,),
)


class Tool(Enum):
    """What a reader of advice uses."""

    COMMAND = "command line"
    PYTHON = "Python"
    PAGE = "page"


HOW: Mapping[Advice, Mapping[Tool, str]] = MappingProxyType(
    {
        Advice.LOOK: {
            Tool.COMMAND: "run --show-paint",
            Tool.PYTHON: "results.overlay(id, show_paint=True)",
            Tool.PAGE: "orange lines lie beside their paint",
        },
        Advice.BY_HAND: {
            Tool.COMMAND: "fieldcalib open",
            Tool.PYTHON: "fieldcalib.Editor(source)",
            Tool.PAGE: "choose a marking on the map, and click along it",
        },
        Advice.KNOWN_CAMERA: {
            Tool.COMMAND: "--intrinsics, --position, --rotation",
            Tool.PYTHON: "camera_matrix=, rvec=, tvec= with flags=",
            Tool.PAGE: "the tab Camera has focal length, position and lens, each with a lock",
        },
        Advice.PICTURE: {
            Tool.COMMAND: "--crop-of (its own size with +0+0 if nothing is cut off), --aspect or --display-size",
            Tool.PYTHON: "put the part into a frame of the whole size, or give its camera_matrix=",
            Tool.PAGE: "in the tab Camera, lock Shown as: 16:9 if the picture was squashed from it; and Principal "
            "point if nothing was cut off. A part of a frame: fieldcalib run with --crop-of, and open its results",
        },
        Advice.OTHER_FIELD: {
            Tool.COMMAND: "--field tennis, or auto",
            Tool.PYTHON: 'field="tennis", or "auto"',
            Tool.PAGE: "fieldcalib open with --field tennis",
        },
        Advice.FIELD_SIZE: {
            Tool.COMMAND: "--field-length and --field-width with --field-size known",
            Tool.PYTHON: "field=fieldcalib.soccer(length, width, size_known=True)",
            Tool.PAGE: "type the size of the field in the tab Camera",
        },
    }
)
"""What to do in each tool."""


def how(advice: Iterable[Advice], tool: Tool) -> str:
    """How advice is followed in a tool; empty where nothing is to be said.

    Examples
    --------
    >>> how([Advice.LOOK, Advice.FIELD_SIZE], Tool.COMMAND)
    'run --show-paint; --field-length and --field-width with --field-size known'
    >>> how([], Tool.PAGE)
    ''
    """
    asked = set(advice)
    return "; ".join(ways[tool] for one, ways in HOW.items() if one in asked)


def advice_from_json(record: object) -> tuple[Advice, ...]:
    """Advice from the line of a frame; none from lines of earlier versions, or what is none."""
    names = record if isinstance(record, list) else ()
    return tuple(one for one in Advice if one in names)
