"""Advice on a camera in plain words, and how it is followed on the command line, in Python and on the page.

A result is read by people who use different tools: its `remedy` names none of them, and each tool adds `how`.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum
from types import MappingProxyType

from fieldcalib.fields.catalogue import FIELDS

LOOK = "look at the overlay"
BY_HAND = "labelled by hand"
KNOWN_CAMERA = "what is known of the camera"
PICTURE = "what the picture is of"
OTHER_FIELD = "name the field"

OTHER_SPORT = f"if it is another sport, {OTHER_FIELD}"
LEFT_OUT = "leave out what you gave and may be wrong"

OFF_PAINT = f"{LOOK}; give the known length and width of the field"
NOT_WHOLE = f"say {PICTURE}: a part of a frame, a whole frame of that shape, or a squashed one"
SMALLER = f"{LOOK}; if the field is a smaller one, {OTHER_FIELD}"
NOT_SOCCER = f"if it is not soccer, {OTHER_FIELD}: {', '.join(name for name in FIELDS if name != 'soccer')}"


class Tool(Enum):
    """What a reader of advice uses."""

    COMMAND = "command line"
    PYTHON = "Python"
    PAGE = "page"


_FIELD_SIZE = {
    Tool.COMMAND: "--field-length and --field-width with --field-size known",
    Tool.PYTHON: "field=fieldcalib.soccer(length, width, size_known=True)",
    Tool.PAGE: "type the size of the field in the tab Camera",
}
HOW: Mapping[str, Mapping[Tool, str]] = MappingProxyType(
    {
        LOOK: {
            Tool.COMMAND: "run --show-paint",
            Tool.PYTHON: "results.overlay(id, show_paint=True)",
            Tool.PAGE: "orange lines lie beside their paint",
        },
        BY_HAND: {
            Tool.COMMAND: "fieldcalib open",
            Tool.PYTHON: "fieldcalib.Editor(source)",
            Tool.PAGE: "choose a marking on the map, and click along it",
        },
        KNOWN_CAMERA: {
            Tool.COMMAND: "--intrinsics, --position, --rotation",
            Tool.PYTHON: "camera_matrix=, rvec=, tvec= with flags=",
            Tool.PAGE: "the tab Camera has focal length, position and lens, each with a lock",
        },
        PICTURE: {
            Tool.COMMAND: "--crop-of (its own size with +0+0 if nothing is cut off), --aspect or --display-size",
            Tool.PYTHON: "put the part into a frame of the whole size, or give its camera_matrix=",
            Tool.PAGE: "in the tab Camera, lock Shown as: 16:9 if the picture was squashed from it; and Principal "
            "point if nothing was cut off. A part of a frame: fieldcalib run with --crop-of, and open its results",
        },
        OTHER_FIELD: {
            Tool.COMMAND: "--field tennis, or auto",
            Tool.PYTHON: 'field="tennis", or "auto"',
            Tool.PAGE: "fieldcalib open with --field tennis",
        },
        **dict.fromkeys(("known length", "known width"), _FIELD_SIZE),
    }
)
"""What to do in each tool, by words of a remedy."""


def how(remedy: str, tool: Tool) -> str:
    """How the advice of a remedy is followed in a tool; empty where nothing is to be said.

    Examples
    --------
    >>> how("look at the overlay; give the known length and width of the field", Tool.COMMAND)
    'run --show-paint; --field-length and --field-width with --field-size known'
    >>> how("check the labels", Tool.PAGE)
    ''
    """
    return "; ".join(dict.fromkeys(ways[tool] for words, ways in HOW.items() if words in remedy))
