"""Parts of an input: a first frame, a last frame, and a step between them."""

from __future__ import annotations

import math
import re
import sys
from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

ROUNDED = 1e-6  # frames: rounding of a time that is written in decimals
MILLISECOND = 1e-3  # to which many files round the times of their frames
TIME = re.compile(r"(?:(?:(\d+):)?(\d+):)?(\d+(?:\.\d*)?)", re.ASCII)
FRAME = re.compile(r"(\d+)f", re.ASCII)


@dataclass(frozen=True)
class Position:
    """A place in an input: a time from its beginning, or the number of a frame, from 0."""

    seconds: float | None = None
    frame: int | None = None

    @classmethod
    def parse(cls, text: str) -> Self:
        """Parse ``[[H:]M:]S`` or ``Nf``.

        Raises
        ------
        ValueError
            If it is neither.

        Examples
        --------
        >>> Position.parse("1:30.5"), Position.parse("750f")
        (Position(seconds=90.5, frame=None), Position(seconds=None, frame=750))
        """
        if found := FRAME.fullmatch(text):
            return cls(frame=int(found[1]))
        if found := TIME.fullmatch(text):
            hours, minutes, seconds = (float(part or 0.0) for part in found.groups())
            return cls(seconds=3600.0 * hours + 60.0 * minutes + seconds)
        raise ValueError(f"expected a time, as 90, 1:30 or 1:01:30.5, or a frame, as 750f, got {text!r}")

    def __str__(self) -> str:
        """Format as `parse` reads it."""
        return f"{self.seconds:.10g}" if self.frame is None else f"{self.frame}f"

    def number(self, frames_per_second: float | None, times: Sequence[float] = ()) -> int:
        """The number of the first frame at or after the position.

        `times` are those of all frames where they are known, in seconds from the first; frames after them, and frames
        whose times are not known, come at a rate of `frames_per_second`.

        Raises
        ------
        ValueError
            If it is a time, and the frames have none.

        Examples
        --------
        >>> Position(seconds=1.21).number(25.0), Position(seconds=1.21).number(25.0, [0.0, 1.0, 1.2, 1.5])
        (31, 3)
        """
        if self.frame is not None:
            return self.frame
        if frames_per_second is None or self.seconds is None:
            raise ValueError(f"images have no times: give the number of one, as 750f, not {self}")
        if times and self.seconds <= times[-1]:
            return bisect_left(times, self.seconds - MILLISECOND)
        number, begin = (len(times) - 1, times[-1]) if times else (0, 0.0)
        return number + math.ceil((self.seconds - begin) * frames_per_second - ROUNDED)


@dataclass(frozen=True)
class Cut:
    """Every `step`-th frame from `start` on, before `end`."""

    start: Position = Position(frame=0)
    end: Position | None = None
    step: int = 1
    is_part: bool = False
    """Whether it is a part of what is read, which may have no frame where a file is cut off."""

    @classmethod
    def part(cls, numbers: range) -> Self:
        """The frames with some numbers, as a part of what is read."""
        return cls(Position(frame=numbers.start), Position(frame=numbers.stop), numbers.step, is_part=True)

    def beyond(self, count: int, frames_per_second: float | None = None, times: Sequence[float] = ()) -> str:
        """Message if the end is beyond that of an input of `count` frames; empty otherwise.

        Examples
        --------
        >>> Cut(end=Position(seconds=60.0)).beyond(175, 25.0)
        'ends at 7 s (175 frames), before 60 s: times are in seconds, and 60f is a frame'
        >>> Cut(end=Position(frame=400)).beyond(175)
        'ends after 175 frames, before frame 400'
        """
        if self.end is None or self.end.number(frames_per_second, times) <= count:
            return ""
        return ends_before(self.end, count, frames_per_second, times)

    def numbers(self, frames_per_second: float | None = None, times: Sequence[float] = ()) -> range:
        """The numbers of its frames, those after the end of the input included; images have no frames per second.

        Raises
        ------
        ValueError
            If there is no frame from start to end, or one of them is a time of images.

        Examples
        --------
        >>> Cut(Position(seconds=2.0), Position(seconds=3.0), 10).numbers(25.0)
        range(50, 75, 10)
        """
        start = self.start.number(frames_per_second, times)
        end = sys.maxsize if self.end is None else self.end.number(frames_per_second, times)
        if end <= start:
            raise ValueError(f"there is no frame from {self.start} to {self.end}: the end must come after the start")
        return range(start, end, self.step)


def ends_before(
    place: Position, count: int, frames_per_second: float | None = None, times: Sequence[float] = ()
) -> str:
    """Message that an input of `count` frames ends before a place."""
    frames = f"{count} frame{'s' * (count != 1)}"
    if place.seconds is None or frames_per_second is None:
        return f"ends after {frames}, before frame {place.frame}"
    whole = place.seconds == int(place.seconds)
    hint = f": times are in seconds, and {place}f is a frame" if whole else ""
    seconds = (count - len(times) + 1) / frames_per_second + times[-1] if times else count / frames_per_second
    return f"ends at {seconds:.3g} s ({frames}), before {place} s{hint}"


WHOLE = Cut()
