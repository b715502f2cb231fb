"""The commands, and their arguments."""

from __future__ import annotations

import argparse
from pathlib import Path

import fieldcalib
from fieldcalib.cli import calibrate, evaluate, join, localize, run
from fieldcalib.io.output_folder import output_folder


def command_parser() -> argparse.ArgumentParser:
    """What reads the command line; each command sets ``run``, a function of the options that gives the exit code."""
    parser = argparse.ArgumentParser(
        prog="fieldcalib", description="Calibrate cameras from the markings of a sports field."
    )
    parser.add_argument("--version", action="version", version=f"fieldcalib {fieldcalib.__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    run.add_parser(commands)
    localize.add_parser(commands)
    calibrate.add_parser(commands)
    evaluate.add_parser(commands)
    join.add_parser(commands)

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

    with output_folder(options.out):
        run_demo(options.out)
    return 0
