"""The command line: `fieldcalib run`, `localize`, `calibrate`, `evaluate` and others.

Only little is imported before `main` runs: until then an interrupt would end in a traceback.
"""

from __future__ import annotations

import gc
import os
import sys
from collections.abc import Sequence
from functools import partial

from fieldcalib._interrupts import ignore_interrupts, interrupts_end_the_process
from fieldcalib.console.program import exit_code
from fieldcalib.processes.threads import one_thread_for_blas


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code: 0 done, 1 something was broken, 2 wrong usage."""
    code = exit_code(partial(_run, arguments))
    if arguments is None:  # the process ends with it
        ignore_interrupts()
    return code


def _run(arguments: Sequence[str] | None) -> int:
    _check_environment()
    one_thread_for_blas()
    gc.set_threshold(10_000)  # after 700 objects each, there are 400 collections in a short run, without garbage
    given = sys.argv[1:] if arguments is None else arguments
    with interrupts_end_the_process():
        from fieldcalib.cli.commands import command_parser, with_values_joined

        parser = command_parser(given)
    options = parser.parse_args(with_values_joined(given))
    return int(options.run(options))


def _check_environment() -> None:
    """Check a variable that NumPy reads when SciPy is imported; its error would not name it."""
    epoch = os.environ.get("SOURCE_DATE_EPOCH", "0")
    try:
        int(epoch)
    except ValueError:
        raise ValueError(
            f"the environment variable SOURCE_DATE_EPOCH must be a number of seconds, got {epoch!r}: unset it"
        ) from None


if __name__ == "__main__":
    sys.exit(main())
