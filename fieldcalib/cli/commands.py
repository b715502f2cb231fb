"""The commands. Each one is a module of this package, imported only if its command is given."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from itertools import islice, pairwise
from pathlib import Path

import fieldcalib
from fieldcalib.console.options import COMMAND, NEGATIVE, Parser

COMMANDS = {
    "run": "calibrate images, a video or annotated frames",
    "open": "see, mend and label frames in the browser",
    "localize": "find the markings in images",
    "calibrate": "calibrate annotated frames: run does so too",
    "evaluate": "score cameras or homographies against annotations",
    "export": "write cameras in the formats of other tools",
    "project": "boxes of players to metres on the field",
    "minimap": "maps with players and what the camera sees, of images or a clip",
    "topview": "the field as seen from above, of an image or a clip",
    "undistort": "images or a clip without the distortion of the lens",
    "join": "put the results of shards together",
    "demo": "all of it on a rendered clip, with errors against the truth",
}


def with_values_joined(arguments: Sequence[str]) -> list[str]:
    """Join values that begin with a minus sign and a digit to the option before them.

    argparse takes such values for options, unless they are plain numbers.

    Examples
    --------
    >>> with_values_joined(["run", "clip.mp4", "--position", "-3,62,-17", "--strict"])
    ['run', 'clip.mp4', '--position=-3,62,-17', '--strict']
    """
    joined: list[str] = []
    for argument in arguments:
        last = joined[-1] if joined else ""
        if NEGATIVE.match(argument) and last.startswith("--") and last != "--" and "=" not in last:
            joined[-1] = f"{last}={argument}"
        else:
            joined.append(argument)
    return joined


def command_parser(arguments: Sequence[str]) -> Parser:
    """Make a parser for the command line `arguments`: it has the options of the command that they begin with.

    Only that command's module is imported, since importing all of them takes long.
    """
    parser = Parser(prog="fieldcalib", description="Calibrate cameras from the markings of a sports field.")
    parser.add_argument("--version", action="version", version=f"fieldcalib {fieldcalib.__version__}")
    commands = parser.add_subparsers(required=True, metavar=COMMAND)
    given = next((argument for argument in arguments if not argument.startswith("-")), None)
    for name, help in COMMANDS.items():
        command = commands.add_parser(name, help=help)
        if name == given:
            name = "calibrate" if name == "run" and _is_of_labels(arguments) else name
            module = import_module(f"fieldcalib.cli.{name}")
            module.add_arguments(command)
            command.set_defaults(run=module.run, command=name, arguments=list(arguments))
            parser.chosen = command
    return parser


def _is_of_labels(arguments: Sequence[str]) -> bool:
    """Whether the input of a command line is annotations."""
    from fieldcalib.io.formats import are_annotations

    named = (one for before, one in pairwise(arguments) if not before.startswith("--"))  # no values of options
    return any(are_annotations(path) for path in islice(filter(Path.exists, map(Path, named)), 1))
