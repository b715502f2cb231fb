"""Running a command-line program: exit codes, messages on stderr, interrupts.

Only little is imported here: an interrupt before a program runs would end in a traceback.
"""

from __future__ import annotations

import io
import logging
import os
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING, Any, cast

from fieldcalib._interrupts import Terminated, interrupts_reach_the_work
from fieldcalib._progress import printable, say
from fieldcalib.processes.other_process import open_closed_streams

if TYPE_CHECKING:
    import argparse

NO_MEMORY = "there is not enough memory"
UNLOADED = "failed to map segment"  # what the loader says of a shared library for which there is no memory


def run_command(options: argparse.Namespace) -> int:
    """Run what a parser chose, ``options.run``; returns the exit code, see `exit_code`."""
    return exit_code(partial(options.run, options))


class _Formatter(logging.Formatter):
    def format(self, record: logging.LogRecord) -> str:
        return printable(super().format(record))


@contextmanager
def warnings_on_stderr() -> Iterator[None]:
    """Write what the library warns of to stderr, without the line of code that does."""

    def show(message: Warning | str, category: type[Warning], *where: Any) -> None:
        say(str(message)) if issubclass(category, UserWarning) else usual(message, category, *where)

    with warnings.catch_warnings():
        usual, warnings.showwarning = warnings.showwarning, cast(Any, show)
        yield


@contextmanager
def log_on_stderr() -> Iterator[None]:
    """Write what the library logs to stderr."""
    handler, log = logging.StreamHandler(), logging.getLogger("fieldcalib")
    handler.setFormatter(_Formatter("fieldcalib: %(message)s"))
    level = log.level
    log.addHandler(handler)
    log.setLevel(logging.INFO)
    try:
        yield
    finally:
        log.setLevel(level)
        log.removeHandler(handler)


def exit_code(work: Callable[[], int]) -> int:
    """Do some work that returns an exit code; an error that a user can mend becomes a line on stderr, and code 2."""
    open_closed_streams()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # a terminal without "±" is no reason to fail after the work
    try:
        with interrupts_reach_the_work(), log_on_stderr(), warnings_on_stderr():
            code = int(work())
        _flush()
        return code
    except BrokenPipeError:
        say("what was to be printed has no reader any more: it closed the pipe")
        _drop_output()
        return 1
    except Terminated:
        say("terminated, nothing more is written")
        return 143
    except KeyboardInterrupt:
        say("interrupted, nothing more is written")
        return 130
    except MemoryError:
        say(NO_MEMORY)
        return 2
    except (OSError, ValueError, ImportError) as error:  # ImportError: an extra is not installed
        say(_message(error))
        return 2


def _flush() -> None:
    try:
        sys.stdout.flush()
    except BrokenPipeError:
        raise
    except OSError as error:
        error.filename = "standard output"
        _drop_output()
        raise


def _drop_output() -> None:
    """Let nothing more be printed, which Python would try once more at its end."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _message(error: Exception) -> str:
    """Text of an error; of the operating system's without its number, after the file.

    Of a library that could not be loaded it says that memory is short.

    Examples
    --------
    >>> _message(FileNotFoundError(2, "No such file or directory", "none.yaml"))
    'none.yaml: no such file or directory'
    >>> _message(ValueError("expected a camera"))
    'expected a camera'
    >>> _message(ImportError("/lib/_fblas.so: failed to map segment from shared object"))
    'there is not enough memory: /lib/_fblas.so: failed to map segment from shared object'
    """
    unloaded = [one for one in (error, error.__cause__, error.__context__) if UNLOADED in str(one)]
    if unloaded:
        return f"{NO_MEMORY}: {unloaded[0]}"
    if not isinstance(error, OSError) or not error.strerror:
        return str(error)
    said = error.strerror[0].lower() + error.strerror[1:]
    return said if error.filename is None else f"{error.filename}: {said}"
