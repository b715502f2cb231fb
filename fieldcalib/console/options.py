"""Options of the command line as fields of frozen dataclasses: name, type, default and help in one place."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import field, fields
from typing import Any, TypeVar

T = TypeVar("T")
OPTION = "option"  # key of the metadata of such fields


def option(help: str, *, name: str = "", default: Any = None, exclusive: str = "", **how: Any) -> Any:
    """Declare an option of the command line as a field of a dataclass.

    Parameters
    ----------
    help : str
    name : str
        By default that of the field, with "--" before it and hyphens in it.
    default : object
    exclusive : str
        Options with the same text here exclude each other.
    **how
        Further arguments of `argparse.ArgumentParser.add_argument`.
    """
    declared = {"name": name, "exclusive": exclusive, "how": {"help": help, "default": default, **how}}
    return field(default=default, metadata={OPTION: declared})


def switch(help: str, **more: str) -> Any:
    """Declare an option without a value, which is false if it is not given."""
    return option(help, default=False, action="store_true", **more)


def add_options(parser: argparse.ArgumentParser, kind: type, *names: str) -> None:
    """Add the options that a dataclass declares, or those of some of its fields.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> @dataclass(frozen=True)
    ... class Drawing:
    ...     line_width: int = option("pixels (2)", default=2, type=int, metavar="N")
    ...     in_colour: bool = switch("draw in colour")
    >>> parser = argparse.ArgumentParser()
    >>> add_options(parser, Drawing)
    >>> given(Drawing, parser.parse_args(["--line-width", "3"]))
    Drawing(line_width=3, in_colour=False)
    """
    groups: dict[str, Any] = {"": parser}
    for one in fields(kind):
        declared: Mapping[str, Any] | None = one.metadata.get(OPTION)
        if declared is not None and (not names or one.name in names):
            key = declared["exclusive"]
            if key not in groups:
                groups[key] = parser.add_mutually_exclusive_group()
            name = declared["name"] or f"--{one.name.replace('_', '-')}"
            groups[key].add_argument(name, dest=one.name, **declared["how"])


def given(kind: type[T], options: argparse.Namespace, **others: Any) -> T:
    """Make a dataclass: its fields are the parsed options of the same names, and `others`."""
    found = {one.name: getattr(options, one.name) for one in fields(kind) if hasattr(options, one.name)}  # type: ignore[arg-type]
    return kind(**found | others)
