"""Paint that an image shows of the markings in view of a camera: at their projections, or beside them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate
from math import inf

from fieldcalib._types import expect, listed, number, truth, whole_number
from fieldcalib.assess.findings import Finding, What, in_words

UNSEEN = 0.2  # a long marking with paint on less than this share is unseen: one marking in 93 right pictures is
LONG = 15  # number of places from which on a marking is long
CONFIRMED = 0.85  # least share of places with paint on confirmed markings: in right frames of a hard clip 0.83 to 0.97
LEAST_MARKINGS, LEAST_PLACES = 3, 8  # confirmed markings that confirm a camera; places that each needs

LEAST_WIDTHS = 6  # places where the width of paint must be measured
# Times the projected width: from here on the paint is so wide that the field may be a smaller one. In 60 right pictures
# it is 0.8 to 1.26 times.
TOO_WIDE = 1.4


@dataclass(frozen=True)
class MarkingInView:
    """A painted marking in view of a camera, and where the image shows its paint.

    Examples
    --------
    >>> line = MarkingInView("Side line bottom", length=412.0, places=30, share=0.1, offset=17.2)
    >>> line.is_beside, line.is_unseen
    (True, False)
    """

    label: str
    length: float
    """Length of its projection, pixels."""
    places: int
    """Number of places along it where paint was looked for."""
    share: float
    """Share of these that show paint where the marking is projected."""
    offset: float
    """Largest distance between the marking and paint that lies beside it, pixels; 0 if there is no such paint."""
    is_expected: bool = True
    """Whether its paint should be visible: equally narrow paint of other markings is."""
    is_bent: bool = False
    """Whether its paint bends away from it: one part lies on the marking, the rest beside it."""
    width: float = 0.0
    """Median width of its paint, in units of the width that the camera projects; 0 where it cannot be measured."""
    widths: int = 0
    """Number of places where its width was measured."""
    past_end: float = 0.0
    """Length of its paint past an end of the marking, pixels; 0 if there is none."""

    def __post_init__(self) -> None:
        """Check what may come from a file.

        Raises
        ------
        ValueError
            If something is of a wrong type, or a number is negative or not finite.
        """
        expect(self.label, str, "Base line")
        for name in ("length", "share", "offset", "width", "places", "widths", "past_end"):
            if not 0.0 <= number(getattr(self, name), name) < inf:
                raise ValueError(f"{name}: expected a number of at least 0, got {getattr(self, name)}")
        for name in ("places", "widths"):
            whole_number(getattr(self, name), name)
        for name in ("is_expected", "is_bent"):
            truth(getattr(self, name), name)

    @property
    def is_beside(self) -> bool:
        """Whether its paint lies beside it."""
        return self.offset > 0.0

    @property
    def is_displaced(self) -> bool:
        """Whether its paint is elsewhere: beside it, or past its end."""
        return self.is_beside or self.past_end > 0.0

    @property
    def is_unseen(self) -> bool:
        """Whether it is long and shows no paint, neither at its projection nor beside it."""
        return self.is_expected and self.places >= LONG and self.share < UNSEEN and not self.is_beside

    @property
    def is_confirmed(self) -> bool:
        """Whether it shows paint nearly everywhere, at enough places."""
        return self.share >= CONFIRMED and self.places >= LEAST_PLACES

    @property
    def is_off(self) -> bool:
        """Whether it is evidence against the camera: its paint lies beside it, is missing, or goes on past its end."""
        return self.is_displaced or self.is_unseen


def checked_markings(markings: Sequence[MarkingInView]) -> tuple[MarkingInView, ...]:
    """The markings if they are some; else a ValueError."""
    example = 'MarkingInView("Middle line", 300.0, 25, share=0.9, offset=0.0)'
    return tuple(expect(one, MarkingInView, example) for one in listed(markings, "markings in view"))


def paint_findings(markings: Sequence[MarkingInView]) -> tuple[Finding, ...]:
    """Find markings whose paint lies beside them, goes on past an end, or is missing; and paint that is too wide.

    Examples
    --------
    >>> near = MarkingInView("Side line bottom", 800.0, 30, share=0.9, offset=0.0)
    >>> list(map(str, paint_findings([near, MarkingInView("Middle line", 300.0, 9, share=0.0, offset=21.4)])))
    ["'Middle line' lies 21 px beside its paint"]
    >>> short = [MarkingInView(name, 80.0, 9, share=0.0, offset=0.0) for name in ("Centre mark", "Service line")]
    >>> len(paint_findings(short)), len(paint_findings(short[:1]))
    (2, 0)
    """
    beside = sorted((one for one in markings if one.is_beside), key=lambda one: -one.offset)
    found = [Finding(What.OFF_PAINT, one.label, (one.offset,)) for one in beside]
    found += [Finding(What.PAST_END, one.label, (one.past_end,)) for one in markings if one.past_end > 0.0]
    found += [Finding(What.NO_PAINT, one.label) for one in _unseen(markings)]
    width = paint_width(markings)
    return (*found, *([Finding(What.WIDE_PAINT, numbers=(width,))] if width > TOO_WIDE else []))


def _unseen(markings: Sequence[MarkingInView]) -> list[MarkingInView]:
    """Markings that are unseen; if none is, short ones without paint that are together as long as one."""
    bare = [one for one in markings if one.is_expected and one.share < UNSEEN and not one.is_beside]
    is_long = sum(one.places for one in bare) >= LONG
    return [one for one in bare if one.is_unseen] or (bare if is_long else [])


def paint_width(markings: Sequence[MarkingInView]) -> float:
    """Median width of the paint in view, in units of the projected width; 0 if it was measured at too few places.

    Examples
    --------
    >>> paint_width([MarkingInView("Middle line", 300.0, 25, share=1.0, offset=0.0, width=1.1, widths=9)])
    1.1
    """
    measured = sorted((one.width, one.widths) for one in markings if one.widths)
    up_to = list(accumulate(widths for _, widths in measured))
    if not measured or up_to[-1] < LEAST_WIDTHS:
        return 0.0
    return next(width for (width, _), places in zip(measured, up_to, strict=True) if 2 * places >= up_to[-1])


def contradiction(markings: Sequence[MarkingInView]) -> str:
    """Reason to reject a camera if more of the paint in view lies beside the markings than on them; else empty.

    Paint that bends away does not count: no camera would project its marking there.
    """
    on = sum(one.share * one.places for one in markings)
    beside = sum((1.0 - one.share) * one.places for one in markings if one.is_beside and not one.is_bent)
    if not beside > on:
        return ""
    return f"most of the paint lies beside the markings: {in_words(*paint_findings(markings))}"


def paint_confirms(markings: Sequence[MarkingInView]) -> bool:
    """Whether the image shows paint nearly everywhere along several markings in view, and no marking contradicts.

    Examples
    --------
    >>> lines = [MarkingInView(name, 400.0, 30, share=0.95, offset=0.0) for name in ("front", "side", "arc")]
    >>> paint_confirms(lines), paint_confirms(lines[:2])
    (True, False)
    """
    confirmed, off = sum(one.is_confirmed for one in markings), any(one.is_off for one in markings)
    return confirmed >= LEAST_MARKINGS and paint_share(markings) >= CONFIRMED and not off


def paint_share(markings: Sequence[MarkingInView]) -> float:
    """Share of the places along the markings in view that show paint; 0 if none is in view."""
    return sum(one.share * one.places for one in markings) / max(sum(one.places for one in markings), 1)
