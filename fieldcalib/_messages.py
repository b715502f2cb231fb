"""Messages for people: on stderr after the name of the program, results on stdout."""

from __future__ import annotations

import sys


def printable(text: str) -> str:
    """Text for a terminal: control characters, as names of files may have, are escaped; ends of lines and tabs stay.

    Examples
    --------
    >>> printable("clip\\x1b[2J.mp4"), printable("±1 m")
    ('clip\\\\x1b[2J.mp4', '±1 m')
    """
    if text.isprintable():
        return text
    return "".join(one if one.isprintable() or one in "\n\t" else ascii(one)[1:-1] for one in text)


def say(message: str) -> None:
    """Print a line on stderr, after the name of the program."""
    print(printable(f"fieldcalib: {message}"), file=sys.stderr, flush=True)


def show(text: str) -> None:
    """Print the result of a command on stdout."""
    print(printable(text))


def counted(number: int, noun: str) -> str:
    """A number with its noun.

    Examples
    --------
    >>> counted(1, "frame"), counted(2, "frame")
    ('1 frame', '2 frames')
    """
    return f"{number} {noun}{'' if number == 1 else 's'}"
