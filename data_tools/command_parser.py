"""Parsers of programs that have several commands, each of which measures something."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from typing import Any

from fieldcalib.console.arguments import count


def parser_of(
    text: str | None, functions: Mapping[str, Callable[..., Any]]
) -> tuple[argparse.ArgumentParser, dict[str, argparse.ArgumentParser]]:
    """A parser with the text of a module as its help, and those of its commands by name.

    The help of a command is the docstring of its function.

    Examples
    --------
    >>> def measure():
    ...     \"\"\"Measure something.\"\"\"
    >>> parser, commands = parser_of("A program.", {"all": measure})
    >>> commands["all"].set_defaults(run=measure)
    >>> parser.parse_args(["all"]).run is measure
    True
    """
    parser = argparse.ArgumentParser(description=text, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    return parser, {name: commands.add_parser(name, help=one.__doc__) for name, one in functions.items()}


def add_made_frames(command: argparse.ArgumentParser, frames: int) -> None:
    """--frames and --seed, of frames that are made by a number."""
    command.add_argument("--frames", type=count, default=frames, help=f"({frames})")
    command.add_argument("--seed", type=int, default=0)
