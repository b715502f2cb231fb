"""Advice on a camera in plain words, and how it is followed on the command line, in Python and on the page.

A result is read by people who use different tools: its `remedy` names none of them, and each tool adds `how`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from enum import Enum, StrEnum
from types import MappingProxyType
from typing import NamedTuple, TypeVar

from fieldcalib._types import expect, several
from fieldcalib.assess.findings import TEXTS, Finding, Status, What
from fieldcalib.fields.field import Field

Kind = TypeVar("Kind", Status, What)


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


def _remedy(said: str | Sequence[str]) -> Remedy:
    """A remedy by its name in `sentences.json`, or of its text and what it asks for."""
    text, *advice = TEXTS["remedies"][said] if isinstance(said, str) else said
    return Remedy(text, tuple(map(Advice, advice)))


def _remedies(kind: type[Kind], which: str) -> Mapping[Kind, Remedy]:
    """A table of `sentences.json`."""
    return MappingProxyType({kind(one): _remedy(said) for one, said in TEXTS[which].items()})


NOTHING = Remedy()
OTHER_SPORT = _remedy("other sport")
OFF_PAINT = _remedy("off paint")
OFF_PAINT_OF_KNOWN_GROUND = _remedy("off paint of known ground")
OFF_PAINT_OF_KNOWN_SIZE = _remedy("off paint of known size")
ONE_VIEW = _remedy("one view")
NOT_WHOLE = _remedy("not whole")
WHICH_PART = _remedy("which part")
MORE_THAN_GROUND = _remedy("more than ground")
IF_ON_PAINT = _remedy("if on paint")
MORE_LABELS = _remedy("more labels")
RIGHT_SIZE = _remedy("right size")
WITHOUT_GIVEN = _remedy("without given")
MENDED_LABELS = _remedy("mended labels")
SMALLER = _remedy("smaller")
NOT_SOCCER = _remedy("not soccer")
REMEDIES = _remedies(Status, "remedies of statuses")
OF_LABELS = _remedies(Status, "remedies of statuses of labels")
"""Remedies of labels that a person set, where these differ."""
CAUSE_REMEDIES = _remedies(What, "remedies of causes")
"""Remedies of what was typed wrong, the most certain first."""
QUESTIONS = _remedies(What, "remedies of questions")
"""Remedies of what is open about an accepted camera, the most important first."""
LABEL_QUESTIONS = MappingProxyType({**QUESTIONS, **_remedies(What, "remedies of questions of labels")})
"""Remedies of what is open about an accepted camera of labels that a person set."""


class Tool(Enum):
    """What a reader of advice uses."""

    COMMAND = "command line"
    PYTHON = "Python"
    PAGE = "page"


HOW: Mapping[Advice, Mapping[Tool, str]] = MappingProxyType(
    {Advice(one): {Tool(tool): text for tool, text in ways.items()} for one, ways in TEXTS["how"].items()}
)
"""What to do in each tool."""


def how(advice: Iterable[Advice], tool: Tool = Tool.PYTHON, given: Iterable[str] = ()) -> str:
    """How advice is followed in a tool; empty where nothing is to be said, or an option for it was `given` already.

    Examples
    --------
    >>> how([Advice.PART])  # of a calibration: how(calibration.advice)
    "crop_of=, as '1920x1080+960+0' (its own size with +0+0 if nothing is cut off)"
    >>> how([Advice.LOOK, Advice.FIELD_SIZE], Tool.COMMAND)
    'run --show-paint; --field-length and --field-width with --field-size known'
    >>> how([], Tool.PAGE)
    ''
    """
    expect(tool, Tool, "Tool.PYTHON")
    asked = [one for one in several(advice, "advice") if isinstance(one, Advice)]
    names = {one for one in several(given, "names of options") if isinstance(one, str)}
    followed = {one for one, options in TEXTS["how unless"].items() if not names.isdisjoint(options)}
    return "; ".join(ways[tool] for one, ways in HOW.items() if one in asked and one not in followed)


def advice_from_json(record: object) -> tuple[Advice, ...]:
    """Advice from the line of a frame; none from lines of earlier versions, or what is none."""
    names = record if isinstance(record, list) else ()
    return tuple(one for one in Advice if one in names)


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
    if first == OFF_PAINT and (field is None or field.size_known or not field.moves_with_size):
        return OFF_PAINT_OF_KNOWN_SIZE
    if first == OFF_PAINT and field is not None and field.ground is not None:
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
