"""Options of the command line as fields of frozen dataclasses: name, type, default and help in one place.

A parser that suggests what was meant by an unknown option, choice or command.
"""

from __future__ import annotations

import argparse
import difflib
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import field, fields
from typing import Any, NoReturn, TypeVar, cast

from fieldcalib._progress import printable

T = TypeVar("T")
OPTION = "option"  # key of the metadata of such fields

NEGATIVE = re.compile(r"-\.?\d")  # how a negative number begins
SYNONYMS = {"sport": "field", "from": "start", "to": "end", "image-size": "size"}  # what people try first
SIZES, OF_SIZE = ("--size", "--image-size"), "; pictures and videos have a size: leave it out"
COMMAND = "COMMAND"
LIKE = 0.65  # least similarity, from 0 to 1, of a name that is suggested: none for --frames or --gpu


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


def did_you_mean(text: str, known: Iterable[str]) -> str:
    """A question to append to a message about an unknown name; empty if no known name is similar.

    Examples
    --------
    >>> did_you_mean("--feild-size", ["--field", "--field-size", "--out"])
    '; did you mean --field-size?'
    >>> did_you_mean("--sport", ["--field", "--report"])
    '; did you mean --field?'
    >>> did_you_mean("yes", ["estimated", "nominal"])
    ''
    """
    names = {one.lstrip("-"): one for one in known}  # dashes, which all options have, make none of them similar
    tried = text.lower().lstrip("-")
    meant = SYNONYMS.get(tried, "")
    close = [meant] if meant in names else difflib.get_close_matches(tried, list(names), n=1, cutoff=LIKE)
    return f"; did you mean {names[close[0]]}?" if close else ""


class Parser(argparse.ArgumentParser):
    """An `argparse.ArgumentParser` whose errors are short, and end with a suggestion.

    Examples
    --------
    >>> parser = Parser(exit_on_error=False)
    >>> _ = parser.add_argument("--field-size", choices=["estimated", "nominal"])
    >>> parser.parse_args(["--field-size", "nominl"])
    Traceback (most recent call last):
        ...
    argparse.ArgumentError: argument --field-size: invalid choice: ...; did you mean nominal?
    """

    chosen: Parser | None = None
    """The parser of the command that is given."""
    _given: Sequence[str] = ()

    def parse_known_args(  # type: ignore[override]
        self, args: Sequence[str] | None = None, namespace: Any = None
    ) -> tuple[argparse.Namespace, list[str]]:
        """Parse as `argparse` does, and keep the arguments for error messages."""
        self._given = args or ()
        return cast(tuple[argparse.Namespace, list[str]], super().parse_known_args(args, namespace))

    def _print_message(self, message: str, file: Any = None) -> None:
        super()._print_message(printable(message), file)

    def error(self, message: str) -> NoReturn:
        """Say what is wrong, what missing options are for, and suggest names for options that do not exist."""
        command = self.chosen or self
        options = [name for action in command._actions for name in action.option_strings]
        unknown = [name for name in _options_in(self._given) if not any(one.startswith(name) for one in options)]
        sizes = () if "--size" in options else SIZES
        hints = {name: OF_SIZE if name in sizes else did_you_mean(name, options) for name in unknown}
        said = (hint if name in message else f"; there is no {name}{hint}" for name, hint in hints.items() if hint)
        name, missing = command.prog, message.partition("arguments are required: ")[2].split(", ")
        lacking = [one for one in command._actions if one.option_strings and "/".join(one.option_strings) in missing]
        takes = [(one.option_strings[0], one.metavar or ", ".join(one.choices or ()), one.help) for one in lacking]
        if self._subparsers is not None and COMMAND in missing:
            message += f", one of {', '.join(self._subparsers._group_actions[0].choices or ())}"
        meant = "".join(f"\n  {option} {value}: {help}" for option, value, help in takes)
        self.exit(2, f"usage: {name} ..., all options: {name} --help\n{name}: error: {message}{''.join(said)}{meant}\n")

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        try:
            super()._check_value(action, value)
        except argparse.ArgumentError as error:
            hint = did_you_mean(str(value), map(str, action.choices or ()))
            raise argparse.ArgumentError(action, f"{error.message}{hint}") from None


def _options_in(arguments: Sequence[str]) -> list[str]:
    """Arguments that look like options, without their values."""
    before = arguments[: arguments.index("--")] if "--" in arguments else arguments
    return [one.split("=")[0] for one in before if one.startswith("-") and len(one) > 1 and not NEGATIVE.match(one)]
