"""Advice on a camera in plain words, and how it is followed on the command line, in Python and on the page.

A result is read by people who use different tools: its `remedy` names none of them, and each tool adds `how`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from enum import Enum, StrEnum
from types import MappingProxyType
from typing import NamedTuple

from fieldcalib._types import expect, several
from fieldcalib.assess.findings import TEXTS, Finding, Status, What
from fieldcalib.fields.field import Field

LOOK = "look at the overlay"
BY_HAND = "labelled by hand"
KNOWN_CAMERA = "what is known of the camera"
PICTURE = "what the picture is of"
OTHER_FIELD = "name the field"

LEFT_OUT = "leave out what you gave and may be wrong"


class Advice(StrEnum):
    """What a remedy asks for; each tool has its own way to do it (`HOW`)."""

    LOOK = "look"
    BY_HAND = "by hand"
    KNOWN_CAMERA = "known camera"
    PICTURE = "picture"
    PART = "part of a frame"
    OTHER_FIELD = "other field"
    FIELD_SIZE = "field size"
    GROUND = "ground"


class Remedy(NamedTuple):
    """What would help a camera: in words, and as what is asked for."""

    text: str = ""
    advice: tuple[Advice, ...] = ()


NOTHING = Remedy()
OTHER_SPORT = Remedy(f"if it is another sport, {OTHER_FIELD}", (Advice.OTHER_FIELD,))
OFF_PAINT = Remedy(
    f"{LOOK}; give the known length and width of the field, or, of grass, how much higher its middle is",
    (Advice.LOOK, Advice.FIELD_SIZE, Advice.GROUND),
)
OFF_PAINT_OF_KNOWN_GROUND = Remedy(
    f"{LOOK}; give the known length and width of the field", (Advice.LOOK, Advice.FIELD_SIZE)
)
OFF_PAINT_OF_KNOWN_SIZE = Remedy(f"{LOOK}; markings {BY_HAND}", (Advice.LOOK, Advice.BY_HAND))
ONE_VIEW = Remedy("cut the view that you want out of the picture")
NOT_WHOLE = Remedy(
    f"say {PICTURE}: a part of a frame, a whole frame of that shape, or a squashed one", (Advice.PICTURE,)
)
WHICH_PART = Remedy("say which part of a frame the picture is, or that nothing is cut off", (Advice.PART,))
MORE_THAN_GROUND = Remedy(
    "where heights or the camera itself matter: its known focal length, or a goal in view, or another thing above the "
    "ground",
    (Advice.KNOWN_CAMERA,),
)
IF_ON_PAINT = Remedy(
    f"{LOOK}: if the projected markings lie on their paint, use the camera; if not, markings {BY_HAND}",
    (Advice.LOOK, Advice.BY_HAND),
)
MORE_LABELS = Remedy(f"more markings in view, or {KNOWN_CAMERA}", (Advice.KNOWN_CAMERA,))
RIGHT_SIZE = Remedy("check the length and width of the field", (Advice.FIELD_SIZE,))
WITHOUT_GIVEN = Remedy(LEFT_OUT, (Advice.KNOWN_CAMERA, Advice.PART))
MENDED_LABELS = Remedy("correct these labels, or leave them out")
SMALLER = Remedy(f"if the field is a smaller one, {OTHER_FIELD}", (Advice.OTHER_FIELD,))
NOT_SOCCER = Remedy(f"if it is not soccer, {OTHER_FIELD}", (Advice.OTHER_FIELD,))


class Tool(Enum):
    """What a reader of advice uses."""

    COMMAND = "command line"
    PYTHON = "Python"
    PAGE = "page"


HOW: Mapping[Advice, Mapping[Tool, str]] = MappingProxyType(
    {Advice(one): {Tool(tool): text for tool, text in ways.items()} for one, ways in TEXTS["how"].items()}
)
"""What to do in each tool."""


def how(advice: Iterable[Advice], tool: Tool, given: Iterable[str] = ()) -> str:
    """How advice is followed in a tool; empty where nothing is to be said, or an option for it was `given` already.

    Examples
    --------
    >>> how([Advice.LOOK, Advice.FIELD_SIZE], Tool.COMMAND)
    'run --show-paint; --field-length and --field-width with --field-size known'
    >>> how([], Tool.PAGE)
    ''
    """
    expect(tool, Tool, "Tool.PYTHON")
    asked = [one for one in several(advice, "advice") if isinstance(one, Advice)]
    followed = {one for one, options in TEXTS["how unless"].items() if not {*given}.isdisjoint(options)}
    return "; ".join(ways[tool] for one, ways in HOW.items() if one in asked and one not in followed)


def advice_from_json(record: object) -> tuple[Advice, ...]:
    """Advice from the line of a frame; none from lines of earlier versions, or what is none."""
    names = record if isinstance(record, list) else ()
    return tuple(one for one in Advice if one in names)


REMEDIES: Mapping[Status, Remedy] = MappingProxyType(
    {
        Status.REJECTED: Remedy("check the labels of the segments with the largest errors, or give a larger tau"),
        Status.IMPROBABLE: Remedy(
            f"markings {BY_HAND}, or {KNOWN_CAMERA}; if anything was given, {LEFT_OUT}",
            (Advice.BY_HAND, Advice.KNOWN_CAMERA),
        ),
        Status.TOO_FEW_SEGMENTS: Remedy(f"more markings in view, or {BY_HAND}", (Advice.BY_HAND,)),
        Status.DEGENERATE: Remedy(
            f"a marking elsewhere in view, or {BY_HAND}, that is not parallel to the others", (Advice.BY_HAND,)
        ),
        Status.NOT_CONVERGED: Remedy(f"markings {BY_HAND}", (Advice.BY_HAND,)),
        Status.IMPLAUSIBLE: Remedy(
            f"markings {BY_HAND}; check the field and its size; say {PICTURE}, if it was cropped or squashed",
            (Advice.BY_HAND, Advice.PICTURE),
        ),
    }
)
OF_LABELS: Mapping[Status, Remedy] = MappingProxyType(
    {
        Status.NOT_CONVERGED: Remedy("check the labels; more iterations may help (criteria, in Python)"),
        Status.IMPLAUSIBLE: Remedy(
            f"check the labels, the field and its size; say {PICTURE}, if it was cropped or squashed", (Advice.PICTURE,)
        ),
    }
)
"""Remedies of labels that a person set, where these differ."""


CAUSE_REMEDIES: Mapping[What, Remedy] = MappingProxyType(
    {
        What.LEFT_HANDED: Remedy("turn that axis of the points over"),
        What.OTHER_AXES: Remedy("turn these axes of the points over"),
        **dict.fromkeys(
            (What.OTHER_PICTURE, What.BORDER), Remedy("give the size of the picture that the pixels are of")
        ),
        What.WANTS_LENS: Remedy("let the lens be estimated, or give it", (Advice.KNOWN_CAMERA,)),
        What.EXCHANGED_SIDES: Remedy("exchange these two in all labels"),
        What.PICTURE_CORNERS: Remedy("click the corners of the field itself, or other points of it that are in view"),
        What.RANK: Remedy("compute H from four or more points, of which no three lie on one line"),
        What.TWO_WIDTHS: Remedy(f"another line or mark, {BY_HAND}", (Advice.BY_HAND,)),
        What.NOT_LEVEL: Remedy("give that height as the crown of the field", (Advice.GROUND,)),
        What.UNCHECKED: Remedy("a fifth point, or a known focal length", (Advice.KNOWN_CAMERA,)),
        What.AT_EDGE: Remedy("leave out points that are not where they are said to be"),
        What.FARTHEST: Remedy("check the points that are farther off than the others, or leave them out"),
        What.ONE_OF: Remedy("more points tell which of them is wrong"),
    }
)
"""Remedies of what was typed wrong, the most certain first."""
QUESTIONS: Mapping[What, Remedy] = MappingProxyType(
    {
        **dict.fromkeys((What.OFF_PAINT, What.PAST_END, What.NO_PAINT, What.LITTLE_PAINT), OFF_PAINT),
        What.SEVERAL_VIEWS: ONE_VIEW,
        What.WIDE_PAINT: SMALLER,
        What.SHAPE: NOT_WHOLE,
        What.NARROW: OFF_PAINT_OF_KNOWN_SIZE,
        What.STRAY: MENDED_LABELS,
        What.OTHER_SIZE: RIGHT_SIZE,
        What.CONTRADICTED: WITHOUT_GIVEN,
        **dict.fromkeys((What.PART, What.ENLARGED, What.IN_WINDOW), WHICH_PART),
        What.MORE_LENS: MORE_LABELS,
        What.GROUND_ONLY: MORE_THAN_GROUND,
    }
)
"""Remedies of what is open about an accepted camera, the most important first."""
LABEL_QUESTIONS = MappingProxyType(
    {**QUESTIONS, **dict.fromkeys((What.SUSPECTS, What.MISSED, What.OUTSIDE), MENDED_LABELS)}
)
"""Remedies of what is open about an accepted camera of labels that a person set."""


def remedy_of(status: Status, findings: Iterable[Finding], field: Field | None, *, are_annotated: bool) -> Remedy:
    """The remedy of a camera with a status and findings.

    It depends on what is known of the size and the ground of the field, and on whether a person labelled the picture.

    Examples
    --------
    >>> from fieldcalib.assess.findings import CUT
    >>> remedy_of(Status.ACCEPTED, [CUT], None, are_annotated=True).text
    'say which part of a frame the picture is, or that nothing is cut off'
    """
    found, accepted = {one.what for one in findings}, status is Status.ACCEPTED
    questions = LABEL_QUESTIONS if are_annotated else QUESTIONS
    of_findings = {**CAUSE_REMEDIES, **(questions if accepted else {})}
    first = next((remedy for what, remedy in of_findings.items() if what in found), NOTHING)
    if first is OFF_PAINT and (field is None or field.size_known or not field.moves_with_size):
        return OFF_PAINT_OF_KNOWN_SIZE
    if first is OFF_PAINT and field is not None and field.ground is not None:
        return OFF_PAINT_OF_KNOWN_GROUND
    if first is not NOTHING or accepted:
        return first
    sports = {What.MAY_BE_OTHER_SPORT: NOT_SOCCER, What.SEARCHED: OTHER_SPORT}
    remedy = OF_LABELS.get(status, REMEDIES[status]) if are_annotated else REMEDIES[status]
    every = [remedy, *(sport for what, sport in sports.items() if what in found)]
    return Remedy("; ".join(one.text for one in every), tuple(one for each in every for one in each.advice))


class NoCameraError(ValueError):
    """Error on using the camera of a calibration without one: it has the reason, and advice."""

    def __init__(self, status: Status, message: str) -> None:
        super().__init__(expect(status, Status, "Status.DEGENERATE"), message)
        self.status, self.reason, self.remedy = status, message, REMEDIES.get(status, NOTHING).text

    def __str__(self) -> str:
        return f"there is no camera: {self.reason} ({self.status}). What would help: {self.remedy}"
