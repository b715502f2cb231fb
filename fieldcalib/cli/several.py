"""Several videos: each is a run of its own, and what fails does not stop the others.

Clips are worked on by one process each, with `--jobs` several of them side by side.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from functools import partial
from io import StringIO
from pathlib import Path
from typing import TypeAlias

from fieldcalib.console.inputs import Input
from fieldcalib.console.progress import progress_bar
from fieldcalib.io.files import BrokenFileError
from fieldcalib.io.formats import IMAGES, VIDEOS
from fieldcalib.io.streams import Stream
from fieldcalib.processes.jobs import Processes, in_order
from fieldcalib.processes.other_process import ProcessEndedError

OF_IMAGES = "images"  # folder of their results, beside those of videos

Run: TypeAlias = Callable[[argparse.Namespace], int]


@dataclass(frozen=True)
class Ended:
    """A run that came to its end in another process."""

    code: int
    out: str
    """What it has said."""
    err: str


def run_several(
    runs: Sequence[argparse.Namespace], run: Run, side_by_side: Callable[[argparse.Namespace], bool]
) -> int:
    """Run all, those that can be `side_by_side` by ``--jobs`` processes; returns the largest exit code."""
    jobs = runs[0].jobs
    alone: list[argparse.Namespace] = []
    together: list[argparse.Namespace] = []
    for one in runs:
        (together if jobs > 1 and side_by_side(one) else alone).append(one)
    codes = [_code(run, one) for one in alone]
    if together:
        codes += _by_processes(together, run, jobs)
    return max(codes)


def _by_processes(runs: Sequence[argparse.Namespace], run: Run, jobs: int) -> list[int]:
    codes = []
    with (
        Processes(min(jobs, len(runs))) as executor,
        progress_bar(total=len(runs), unit="video") as progress,
    ):
        own = [argparse.Namespace(**{**vars(one), "jobs": 1, "threads": 1}) for one in runs]
        for ended in in_order(executor, partial(_ended, run), own, ahead=jobs, rescue=_lost):
            sys.stdout.write(ended.out)
            sys.stderr.write(ended.err)
            codes.append(ended.code)
            progress.update()
    return codes


def _ended(run: Run, options: argparse.Namespace) -> Ended:
    out, err = StringIO(), StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        code = _code(run, options)
    return Ended(code, out.getvalue(), err.getvalue())


def _code(run: Run, options: argparse.Namespace) -> int:
    """The exit code of a run; an error that ends it is said on stderr."""
    try:
        return run(options)
    except BrokenPipeError:
        raise
    except (OSError, ValueError) as error:
        print(f"fieldcalib: {error}", file=sys.stderr)
        return 1 if isinstance(error, BrokenFileError) else 2


def _lost(options: argparse.Namespace, error: ProcessEndedError) -> Ended:
    problem = f"the process that worked on it ended with exit code {error.exit_code}"
    return Ended(1, "", f"fieldcalib: {options.input[0]}: {problem}: --resume goes on with it\n")


def runs_of(options: argparse.Namespace) -> list[argparse.Namespace]:
    """The options of each run: one for each video and stream, and one for all images.

    Where there are several, or they come from a folder, each has its own folder in ``options.out``, by the name of its
    video.

    Raises
    ------
    ValueError
        If two of them have the same name.
    """
    inputs = [part for one in options.input for part in _parts(one)]
    images = [one for one in inputs if not _is_video(one)]
    groups = [(one.stem if isinstance(one, Path) else one.name, [one]) for one in inputs if _is_video(one)]
    if images:
        groups.insert(0, (OF_IMAGES, images))
    if len(groups) == 1 and inputs == options.input:  # one video of a folder may be joined by others
        return [argparse.Namespace(**{**vars(options), "input": groups[0][1]})]
    seen: dict[str, Sequence[Input]] = {}
    for name, (first, *_) in groups:
        other = seen.setdefault(name.casefold(), [first])[0]
        if other is not first:
            raise ValueError(f"{other} and {first} would both write to {options.out / name}: run them one by one")
    return [argparse.Namespace(**{**vars(options), "input": part, "out": options.out / name}) for name, part in groups]


def _is_video(one: Input) -> bool:
    return isinstance(one, Stream) or VIDEOS.recognises(one)


def _parts(one: Input) -> list[Input]:
    """The videos of a folder that has videos and no images; otherwise the input itself."""
    if isinstance(one, Stream) or not one.is_dir():
        return [one]
    files = sorted(path for path in one.iterdir() if path.is_file())
    if any(map(IMAGES.recognises, files)):
        return [one]
    return [path for path in files if VIDEOS.recognises(path)] or [one]
