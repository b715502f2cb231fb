"""The command line: `fieldcalib run`, `localize`, `calibrate`, `evaluate` and others.

Only little is imported before `main` runs: until then an interrupt would end in a traceback.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from functools import partial

from fieldcalib.console.interrupts import interrupts_end_the_process
from fieldcalib.console.program import exit_code
from fieldcalib.processes.threads import one_thread_for_blas


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code: 0 done, 1 something was broken, 2 wrong usage."""
    return exit_code(partial(_run, arguments))


def _run(arguments: Sequence[str] | None) -> int:
    one_thread_for_blas()
    given = sys.argv[1:] if arguments is None else arguments
    with interrupts_end_the_process():
        from fieldcalib.cli.commands import command_parser, with_values_joined

        parser = command_parser(given)
    options = parser.parse_args(with_values_joined(given))
    return int(options.run(options))


if __name__ == "__main__":
    sys.exit(main())
