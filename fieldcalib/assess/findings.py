"""What is known of a camera beside its numbers: verdict, status, findings, and labels in doubt.

Code decides by what a `Finding` is; its sentence, in `sentences.json`, is for people.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from fieldcalib._types import expect, number

ENDLESS = 1e5  # px: a line near the horizon may be off by any number
BESIDE = 5.0  # px: nearer pixels lie on the line
UP_TO_SIDE = (
    "the side of the field is not known, as its markings look the same from both: cameras are on the main side by "
    "convention, those of the opposite side, turned by 180 degrees about the centre mark, are in alternatives; --side "
    "(side= in Python) or a prior decides"
)

TEXTS: Mapping[str, Mapping[str, Any]] = json.loads(Path(__file__).with_name("sentences.json").read_text("utf-8"))
UNUSUAL: Mapping[str, str] = TEXTS["unusual"]
"""Sentences of unusual parameters."""


class Verdict(StrEnum):
    """Verdict on a calibration: what to do with it."""

    GOOD = "good"
    """Use it."""
    CHECK = "check"
    """Plausible, but there is evidence against it, or too little for it: look at the frame."""
    REJECT = "reject"
    """Do not use it."""


class Status(StrEnum):
    """Outcome of a calibration. The best camera is given with every status."""

    ACCEPTED = "accepted"
    REJECTED = "rejected by tau"
    """The loss in NDC is above the threshold that the user set."""
    IMPROBABLE = "probably wrong"
    """The probability that the camera is right is below the one that the user requires, the image shows no lines at the
    projected markings, or, in a sequence, the error of the field in view exceeds the field's tolerance."""
    TOO_FEW_SEGMENTS = "too few segments"
    """The labels give fewer equations than there are unknowns; the prior determines the others."""
    DEGENERATE = "degenerate"
    """There are enough equations, but a direction of the parameters is not determined."""
    NOT_CONVERGED = "not converged"
    """The solver reached its limit of iterations."""
    IMPLAUSIBLE = "implausible"
    """The best fit is physically implausible."""


class What(StrEnum):
    """What a finding is; its numbers, in their order, are those of its sentence in `SENTENCES`."""

    OFF_PAINT = "off paint"
    """A marking lies beside its paint, by some pixels."""
    PAST_END = "paint past an end"
    """The paint of a marking goes on past its end, for some pixels."""
    NO_PAINT = "no paint"
    """The image shows no paint where a marking is projected."""
    LITTLE_PAINT = "little paint"
    """The image shows paint on a small share of the markings in view, in percent."""
    WIDE_PAINT = "wide paint"
    """Lines are wider than those of the field, by a factor."""
    IMPROBABLE = "improbable"
    """The camera is more probably wrong: a tolerance in metres, and the probability of being right to it."""
    UNUSUAL = "unusual"
    """A parameter, or a kind of them, is far out in its prior."""
    NOT_SQUARE = "not square"
    """The labels say that the pixels are not square."""
    MORE_LENS = "more lens coefficients"
    """The labels require more lens coefficients than were free, or leave open one that may move places in view."""
    CONTRADICTED = "contradicted"
    """A parameter that was given is not what the labels want: by how much it should be larger; of the part of a frame
    the log evidence against it."""
    OTHER_SIZE = "other size"
    """The field is more probably of another size: length and width in metres."""
    PART = "part of a frame"
    """The picture may be a part of a frame."""
    ENLARGED = "enlarged part"
    """The picture may be an enlarged part of a frame."""
    EXCHANGED_SIZE = "exchanged size"
    """Width and height of a picture may be exchanged: they would be those of a usual one."""
    SHAPE = "shape"
    """Whether a picture was squashed or cut out is open."""
    NARROW = "narrow picture"
    """A network labelled a narrow picture, of which it knows few."""
    SEVERAL_VIEWS = "several views"
    """The picture shows several views side by side."""
    IN_WINDOW = "in a window"
    """The frame may be shown in a window in which no camera was found."""
    UNKNOWN_ERRORS = "unknown errors"
    """The camera does not come from labelled pixels."""
    SUSPECTS = "suspect labels"
    """Some of all labels are contradicted by the others: how many of how many."""
    MISSED = "missed labels"
    """Some of all labels lie far off: how many of how many."""
    MISFIT = "misfit"
    """The labels lie far off by some pixels, all of them."""
    OTHER_SIDE = "other side fits"
    """Nothing tells on which side of the field the camera is."""
    REPEATS = "repeats"
    """The camera may stand further along the field by some metres."""
    BORDER = "border of labels"
    """The labels end at a column of a picture of some width."""
    OUTSIDE = "outside the picture"
    """All pixels of a label lie outside the picture, the nearest by some pixels."""
    STRAY = "stray mark"
    """A mark of a person lies beside the projection of its marking by some pixels."""
    LEFT_HANDED = "left-handed axes"
    """The axes of the points are left-handed: one of them is to be turned over."""
    OTHER_AXES = "other axes"
    """Axes of the points of a field point the other way."""
    EXCHANGED_PIXELS = "exchanged pixels"
    """The pixels are (y, x) instead of (x, y)."""
    OTHER_PICTURE = "other picture"
    """The pixels are those of a picture of another width and height."""
    WANTS_LENS = "wants a lens"
    """Points want a lens, and none was estimated."""
    EXPLAINED = "explained"
    """All of some points then fit, to some pixels."""
    RANK = "rank"
    """A homography of rank 2 maps the ground onto a line."""
    EXCHANGED_SIDES = "exchanged sides"
    """Two sides are exchanged in all labels; the camera is that of the labels as they should be."""
    PICTURE_CORNERS = "corners of the picture"
    """The pixels are the corners of the picture."""
    ONE_OF = "one of the points"
    """Some of a few points are wrong, and nothing tells which."""
    FARTHEST = "farthest points"
    """The points that lie farther off than the others."""
    AT_EDGE = "at the edge"
    """A point that is off lies at the edge of the picture."""
    UNCHECKED = "unchecked distances"
    """Nothing checks the given distances."""
    TWO_WIDTHS = "two widths"
    """A court of another width fits as well: both widths, and the heights of both cameras, in metres."""
    NOT_LEVEL = "not level"
    """The field is higher in the middle than at its touchlines, by some metres, and the camera is that of a level
    one."""
    INACCURATE = "inaccurate"
    """The field in view is known to some metres only."""
    NO_LINE = "no line"
    """Without a line the position of a window is uncertain."""
    SHARED_MISFIT = "misfit of what is shared"
    """The parameters that frames share put the lines of one off by some pixels."""
    OTHER_PLACE = "other place"
    """A camera at another place, x, y and z in metres, fits as well."""
    MIXED = "mixed"
    """The picture may be mixed with that of another camera."""
    SAID = "said"
    """What an earlier version has written in words."""

    RECOGNISED = "recognised"
    """The camera is that of an earlier picture, moved since by some pixels."""
    SEARCHED = "searched"
    """The camera comes from a search without a network."""
    TO_SEARCH = "to search"
    """The court is still to be searched for."""
    WAS_SQUASHED = "was squashed"
    """The picture was squashed from 16:9."""
    FEW_LINES = "few lines"
    """The image has few lines at the projected markings."""
    MAY_BE_OTHER_SPORT = "may be another sport"
    """A network for soccer has seen hardly anything."""
    TOO_FEW_LABELS = "too few labels"
    """Labels, segments or points, give fewer equations than there are unknowns: the three numbers."""
    SEEN_FROM_OPPOSITE = "seen from the opposite side"
    """The camera is on the opposite side if the labels name the ends as seen from the main side."""

    GROUND_ONLY = "ground only"
    """The ground is known, focal length and place of the camera are not: they are those that its prior prefers."""
    RAISED = "raised"
    """The field is higher in the middle than at its touchlines, and the camera is that of this ground: height and
    standard deviation, metres."""

    FRAMES_BESIDE_CLIP = "frames beside the clip"
    """Frames of a clip were mended since it was solved."""
    CUTS_BESIDE_CLIP = "cuts beside the clip"
    """The cuts of a clip were set by hand since it was solved."""
    MOVED = "moved"
    """A drawing of older cameras was moved to the history."""

    @property
    def is_against(self) -> bool:
        """Whether it is evidence against a camera; others say where the camera comes from, or why there is none."""
        return self not in NOTES

    @property
    def explains_all(self) -> bool:
        """Whether it is the cause of all that contradicts a camera."""
        return self in CAUSES


CAUSES = frozenset([What.LEFT_HANDED, What.OTHER_AXES, What.EXCHANGED_PIXELS, What.OTHER_PICTURE, What.EXPLAINED])
NOTES = frozenset(
    [
        *(What.RECOGNISED, What.SEARCHED, What.TO_SEARCH, What.WAS_SQUASHED, What.FEW_LINES, What.MAY_BE_OTHER_SPORT),
        *(What.TOO_FEW_LABELS, What.SEEN_FROM_OPPOSITE, What.GROUND_ONLY, What.RAISED),
        *(What.FRAMES_BESIDE_CLIP, What.CUTS_BESIDE_CLIP, What.MOVED),
    ]
)
SENTENCES: Mapping[What, str] = MappingProxyType({What(what): text for what, text in TEXTS["sentences"].items()})
"""Sentences with the numbers of a finding; those of others depend on more (`Finding.__str__`)."""


class Span(float):
    """Numbers of several frames: the largest of them, in words both ends."""

    least: float

    def __new__(cls, one: float, other: float) -> Span:
        """Make the span of two numbers, or of a span and a number."""
        span = super().__new__(cls, max(one, other))
        span.least = min(one.least if isinstance(one, Span) else one, other)
        return span

    def __format__(self, form: str) -> str:
        return " to ".join(dict.fromkeys([format(self.least, form), super().__format__(form)]))


@dataclass(frozen=True)
class Finding:
    """Something that is known of a camera beside its numbers.

    Examples
    --------
    >>> found = Finding(What.OFF_PAINT, "Middle line", (21.4,))
    >>> str(found), found.what.is_against
    ("'Middle line' lies 21 px beside its paint", True)
    >>> Finding.from_dict(found.to_dict()) == found
    True
    """

    what: What
    about: str = ""
    """The marking, label or parameter that it is about; empty if there is none."""
    numbers: tuple[float, ...] = ()
    """Numbers of the sentence, in its units."""

    def __str__(self) -> str:
        match self.what:
            case What.UNUSUAL:
                return UNUSUAL[self.about]
            case What.CONTRADICTED:
                return f"the labels want {_wanted(self.about, *self.numbers)}"
            case What.TOO_FEW_LABELS:
                labels, equations, unknowns = map(int, self.numbers)
                labelled = f"{labels} {self.about}{'s' * (labels != 1)}"
                more = f"label more {self.about}s, or give what is known of the camera"
                return f"{labelled}: {equations} equations for {unknowns} unknowns; {more}"
            case What.INACCURATE:
                (metres,) = self.numbers
                return f"the field in view is known to {metres:.{1 if metres >= 0.5 else 2}f} m only"
        are, lie = ("is", "lies") if self.numbers[:1] == (1.0,) else ("are", "lie")
        return SENTENCES[self.what].format(*self.numbers, about=self.about, are=are, lie=lie)

    def joined(self, other: Finding) -> Finding:
        """The finding of several frames, which differ in its numbers and in what it is about; words stay the first.

        Examples
        --------
        >>> found = [Finding(What.OFF_PAINT, "Middle line", (px,)) for px in (9.0, 7.0, 8.0)]
        >>> str(found[0].joined(found[1]).joined(found[2]))
        "'Middle line' lies 7 to 9 px beside its paint"
        """
        if self.what is not other.what or self.what is What.SAID:
            return self
        about = self.about if self.about == other.about else "…"
        return Finding(self.what, about, tuple(map(Span, self.numbers, other.numbers)))

    def to_dict(self) -> dict[str, Any]:
        """The finding for `json.dumps`; what it is not about, and numbers that it does not have, are left out."""
        about = {"about": self.about} if self.about else {}
        return {"what": str(self.what), **about, **({"numbers": list(self.numbers)} if self.numbers else {})}

    @classmethod
    def from_dict(cls, record: Mapping[str, Any]) -> Finding:
        """The inverse of `to_dict`; a ValueError if it is none."""
        numbers = tuple(float(number(one, "a number of a finding")) for one in record.get("numbers", ()))
        found = cls(What(record["what"]), expect(record.get("about", ""), str, '"Middle line"'), numbers)
        try:
            str(found)
        except (KeyError, IndexError, TypeError, ValueError):
            raise ValueError(f"expected a finding with its numbers, got {record!s:.100}") from None
        return found


CUT, ENLARGED, SHAPE, NARROW, SEVERAL_VIEWS, IN_WINDOW, WAS_SQUASHED = map(
    Finding, (What.PART, What.ENLARGED, What.SHAPE, What.NARROW, What.SEVERAL_VIEWS, What.IN_WINDOW, What.WAS_SQUASHED)
)
"""What a picture is of (`fieldcalib.problem.picture_shape`)."""


def findings_from_json(record: Any) -> tuple[Finding, ...]:
    """Findings, or the words of earlier versions; a ValueError if they are none."""
    found = expect(record, list, "a list of findings")
    return tuple(Finding(What.SAID, one) if isinstance(one, str) else Finding.from_dict(one) for one in found)


def first_reason(line: Mapping[str, Any]) -> Finding:
    """The most important reason in the line of a frame: evidence against its camera, or the beginning of its words."""
    found = findings_from_json(line.get("findings", []))[:1] if line.get("verdict") == Verdict.CHECK else ()
    against = [one for one in found if one.what.is_against]
    return against[0] if against else Finding(What.SAID, line.get("reason", line.get("message", "")).partition("; ")[0])


def _wanted(name: str, offset: float) -> str:
    """Words for a given parameter that the labels want to be larger by an offset."""
    match name:
        case "log f":
            share = 100.0 * abs(np.expm1(offset))
            return f"a focal length {share:.0f} % {'longer' if offset > 0.0 else 'shorter'} than the given one"
        case "pan" | "tilt" | "roll":
            return f"a {name} {np.degrees(abs(offset)):.1f} degrees from the given one"
        case "x" | "y" | "z":
            return f"a position {abs(offset):.1f} m from the given one (along {name})"
        case "cx" | "cy":
            return f"a principal point {abs(offset):.0f} px from the given one (along {name[1]})"
        case "part":
            return "another part of a frame than the given one"
    return "another lens than the given one"


def in_words(*findings: Finding | SuspectLabel) -> str:
    """Sentences of findings and suspect labels, each once."""
    return "; ".join(dict.fromkeys("; ".join(map(str, findings)).split("; ")))


@dataclass(frozen=True)
class SuspectLabel:
    """A label that the rest of its frame contradicts.

    Examples
    --------
    >>> str(SuspectLabel("Goal left post left", "Goal left post right", 61.3))
    "'Goal left post left' lies 61 px off: 'Goal left post right' fits"
    """

    label: str
    """The label as given."""
    fits: str | None
    """The label whose segment is where the pixels are; None if there is none."""
    error_px: float
    """Root mean square distance of the pixels to the (infinite) line or circle of the given label: small if that runs
    through the pixels, but the segment itself is elsewhere on it."""

    def __post_init__(self) -> None:
        """Check what may come from a file.

        Raises
        ------
        ValueError
            If something is of a wrong type.
        """
        expect(self.label, str, '"Goal left post left"')
        expect(self.fits, (str, type(None)), '"Goal left post right"')
        number(self.error_px, "error_px")

    def __str__(self) -> str:
        fits = "no other label fits" if self.fits is None else f"{self.fits!r} fits"
        px = f"{self.error_px:.0f}" if self.error_px < ENDLESS else f"more than {ENDLESS:.0f}"
        where = f"lies {px} px off" if self.error_px > BESIDE else "ends elsewhere on the same line"
        return f"{self.label!r} {where}: {fits}"
