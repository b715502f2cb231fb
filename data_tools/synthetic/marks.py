"""Marks without a label: the numbers of American football, marks along the lanes of basketball."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import product

import numpy as np

from fieldcalib.fields.field import Field
from fieldcalib.fields.segments import Arc, Line, Segment
from fieldcalib.fields.traits import Paint

Marks = Mapping[str, tuple[Segment, Paint]]
SIGNS = (-1.0, 1.0)
FEET, YARD = 0.3048, 0.9144

# American football: from the figures of the rule books
DIGIT_WIDTH, DIGIT_GAP = 4.0 * FEET, 1.0 * FEET  # the gap is from the yard line
STROKE = 0.25  # m
# Segments of a seven-segment display
DIGITS = {"0": "abcdef", "1": "bc", "2": "abged", "3": "abgcd", "4": "fgbc", "5": "afgcd"}
Share = tuple[float, float]
STROKES: Mapping[str, tuple[Share, Share]] = {  # from the lower left corner, in shares of (width, height)
    "a": ((0.0, 1.0), (1.0, 1.0)),
    "b": ((1.0, 1.0), (1.0, 0.5)),
    "c": ((1.0, 0.5), (1.0, 0.0)),
    "d": ((0.0, 0.0), (1.0, 0.0)),
    "e": ((0.0, 0.0), (0.0, 0.5)),
    "f": ((0.0, 0.5), (0.0, 1.0)),
    "g": ((0.0, 0.5), (1.0, 0.5)),
}

# Basketball: (distance from the end line, length along it) of each mark, and how far they stand out of the lane
FIBA_LANE = ((1.75, 0.40), (3.00, 0.05), (3.90, 0.05)), 0.10
NBA_LANE = ((7.0 * FEET, 1.0 * FEET), (11.0 * FEET, FEET / 6.0), (14.0 * FEET, FEET / 6.0)), 0.5 * FEET
NBA_DASHES = 6


def no_marks(field: Field) -> Marks:
    """No markings."""
    return {}


def field_numbers(field: Field) -> Marks:
    """The numbers 10 to 50 and back, once for each side line.

    Examples
    --------
    >>> from fieldcalib.fields import american_football
    >>> len(field_numbers(american_football())) // 2  # strokes of 9 numbers
    91
    """
    bottom, top = line_of(field, "Number row bottom outer").start[1], line_of(field, "Number row bottom inner").start[1]
    height = bottom - top - STROKE
    found: dict[str, tuple[Segment, Paint]] = {}
    for yard, sign in product(range(-40, 50, 10), SIGNS):
        tens = str((50 - abs(yard)) // 10)
        for digit, left in ((tens, -DIGIT_GAP - DIGIT_WIDTH), ("0", DIGIT_GAP)):
            for stroke in DIGITS[digit]:
                ends = [
                    (
                        yard * YARD + sign * (left + 0.5 * STROKE + u * (DIGIT_WIDTH - STROKE)),
                        sign * (bottom - 0.5 * STROKE - v * height),
                        0.0,
                    )
                    for u, v in STROKES[stroke]
                ]
                found[f"Number {yard} {sign} {left} {stroke}"] = Line(*ends), Paint(width=STROKE)
    return found


def fiba_lane(field: Field) -> Marks:
    """The marks along the lane."""
    return _lane_marks(field, *FIBA_LANE)


def nba_lane(field: Field) -> Marks:
    """The marks along the lane, and the dashed half of the free-throw circle inside it."""
    found = dict(_lane_marks(field, *NBA_LANE))
    for side in ("left", "right"):
        circle = field[f"Free-throw circle {side}"]
        assert isinstance(circle, Arc)
        turn = np.pi / (2 * NBA_DASHES + 1)
        for index in range(NBA_DASHES):
            start = circle.stop + (2 * index + 1) * turn
            found[f"Free-throw circle {side} {index}"] = replace(circle, start=start, stop=start + turn), Paint()
    return found


def _lane_marks(field: Field, marks: tuple[tuple[float, float], ...], out: float) -> Marks:
    y = line_of(field, "Lane right bottom").start[1]
    found: dict[str, tuple[Segment, Paint]] = {}
    for (start, length), side, end in product(marks, SIGNS, SIGNS):
        x = end * (0.5 * field.length - start - 0.5 * length)
        mark = Line((x, side * y, 0.0), (x, side * (y + out), 0.0))
        found[f"Lane mark {start} {side} {end}"] = mark, Paint(width=length)
    return found


def line_of(field: Field, label: str) -> Line:
    """The line with a label."""
    line = field[label]
    assert isinstance(line, Line)
    return line
