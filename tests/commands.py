"""The command line as the tests call it."""

import json

from fieldcalib.cli.main import main


def run(*arguments):
    try:
        return main([str(argument) for argument in arguments])
    except SystemExit as error:  # argparse ends so
        return error.code


def lines_of(out):
    return [json.loads(line) for line in (out / "cameras.jsonl").read_text().splitlines()]
