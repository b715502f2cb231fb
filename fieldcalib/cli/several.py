"""Several videos: each is a run of its own, and what fails does not stop the others.

Clips are worked on by one process each, with `--jobs` several of them side by side.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from functools import partial
from io import StringIO
from typing import TypeAlias

from fieldcalib._messages import say
from fieldcalib._progress import progress_bar
from fieldcalib.cli.run_options import RunRequest
from fieldcalib.io.files import BrokenFileError
from fieldcalib.processes.jobs import Processes, in_order
from fieldcalib.processes.other_process import ProcessEndedError

RunFunction: TypeAlias = Callable[[RunRequest], int]


@dataclass(frozen=True)
class Ended:
    """The end of a run in another process."""

    code: int
    out: str
    """Text for stdout."""
    err: str
    """Text for stderr."""


def run_several(requests: Sequence[RunRequest], run: RunFunction) -> int:
    """Run all requests, clips by ``--jobs`` processes side by side; returns the largest exit code."""
    jobs = requests[0].run.jobs
    alone: list[RunRequest] = []
    side_by_side: list[RunRequest] = []
    for one in requests:
        (side_by_side if jobs > 1 and one.is_clip and not one.is_stream else alone).append(one)
    codes = [_code(run, one) for one in alone]
    if side_by_side:
        codes += _by_processes(side_by_side, run, jobs)
    return max(codes)


def _by_processes(requests: Sequence[RunRequest], run: RunFunction, jobs: int) -> list[int]:
    codes = []
    with (
        Processes(min(jobs, len(requests))) as executor,
        progress_bar(total=len(requests), unit="video") as progress,
    ):
        own = [one.in_one_thread() for one in requests]
        for ended in in_order(executor, partial(_ended, run), own, ahead=jobs, rescue=_lost):
            sys.stdout.write(ended.out)
            sys.stderr.write(ended.err)
            codes.append(ended.code)
            progress.update()
    return codes


def _ended(run: RunFunction, request: RunRequest) -> Ended:
    out, err = StringIO(), StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        code = _code(run, request)
    return Ended(code, out.getvalue(), err.getvalue())


def _code(run: RunFunction, request: RunRequest) -> int:
    """The exit code of a run; an error that ends it is said on stderr."""
    try:
        return run(request)
    except BrokenPipeError:
        raise
    except (OSError, ValueError) as error:
        say(str(error))
        return 1 if isinstance(error, BrokenFileError) else 2


def _lost(request: RunRequest, error: ProcessEndedError) -> Ended:
    problem = f"the process that worked on it ended with exit code {error.exit_code}"
    return Ended(1, "", f"fieldcalib: {request.input[0]}: {problem}: --resume goes on with it\n")
