"""The command line: `fieldcalib run`, `localize`, `calibrate`, `evaluate` and `demo`."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path

import fieldcalib
from fieldcalib.cli import calibrate, evaluate, localize, run


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code: 0 done, 1 something was broken, 2 wrong usage."""
    return run_command(_parser().parse_args(arguments))


def run_command(options: argparse.Namespace) -> int:
    """Run what a parser chose; errors that a user can mend become a line on stderr."""
    try:
        code = int(options.run(options))
        sys.stdout.flush()
        return code
    except BrokenPipeError:  # whoever reads has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except KeyboardInterrupt:
        print("fieldcalib: interrupted, nothing more is written", file=sys.stderr)
        return 130
    except (OSError, ValueError) as error:
        print(f"fieldcalib: {error}", file=sys.stderr)
        return 2


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="fieldcalib", description="Calibrate cameras from the markings of a sports field."
    )
    parser.add_argument("--version", action="version", version=f"fieldcalib {fieldcalib.__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    run.add_parser(commands)
    localize.add_parser(commands)
    calibrate.add_parser(commands)
    evaluate.add_parser(commands)

    demo = commands.add_parser(
        "demo",
        help="calibrate a synthetic pan over a pitch and draw it",
        description="Render a pan over a pitch with known cameras, calibrate it from noisy pixels, print the errors "
        "and write overlays. Needs no data and no network.",
    )
    demo.add_argument("--out", required=True, type=Path, metavar="DIR", help="where the pictures go")
    demo.set_defaults(run=_demo)
    return parser


def _demo(options: argparse.Namespace) -> int:
    from fieldcalib.cli.demo import run_demo

    run_demo(options.out)
    return 0


if __name__ == "__main__":
    sys.exit(main())
