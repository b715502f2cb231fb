"""The command line: `fieldcalib run`, `localize`, `calibrate`, `evaluate` and `demo`.

Only little is imported before `main` runs: until then an interrupt would end in a traceback.
"""

from __future__ import annotations

import io
import logging
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING

from fieldcalib.cli.interrupts import Terminated, interrupts_end_the_process, requests_to_end_interrupt
from fieldcalib.processes.threads import one_thread_for_blas

if TYPE_CHECKING:
    import argparse


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code: 0 done, 1 something was broken, 2 wrong usage."""
    return _exit_code(partial(_run, arguments))


def run_command(options: argparse.Namespace) -> int:
    """Run what a parser chose; errors that a user can mend become a line on stderr."""
    return _exit_code(partial(options.run, options))


def _run(arguments: Sequence[str] | None) -> int:
    one_thread_for_blas()
    given = sys.argv[1:] if arguments is None else arguments
    with interrupts_end_the_process():
        from fieldcalib.cli.commands import command_parser, with_values_joined

        parser = command_parser(given)
    options = parser.parse_args(with_values_joined(given))
    return int(options.run(options))


@contextmanager
def log_on_stderr() -> Iterator[None]:
    """What the library logs goes to stderr meanwhile."""
    handler, log = logging.StreamHandler(), logging.getLogger("fieldcalib")
    handler.setFormatter(logging.Formatter("fieldcalib: %(message)s"))
    level = log.level
    log.addHandler(handler)
    log.setLevel(logging.INFO)
    try:
        yield
    finally:
        log.setLevel(level)
        log.removeHandler(handler)


def _exit_code(work: Callable[[], int]) -> int:
    """Of some work whose errors become a line on stderr."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # a terminal without "±" is no reason to fail after the work
    try:
        with requests_to_end_interrupt(), log_on_stderr():
            code = int(work())
        sys.stdout.flush()
        return code
    except BrokenPipeError:  # whoever reads has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except Terminated:
        print("fieldcalib: terminated, nothing more is written", file=sys.stderr)
        return 143
    except KeyboardInterrupt:
        print("fieldcalib: interrupted, nothing more is written", file=sys.stderr)
        return 130
    except MemoryError:
        print("fieldcalib: there is not enough memory", file=sys.stderr)
        return 2
    except (OSError, ValueError, ImportError) as error:  # the last one of an extra that is not installed
        print(f"fieldcalib: {error}", file=sys.stderr)
        return 2


if __name__ == "__main__":
    sys.exit(main())
