"""Frames in units that are worked on by several processes: the same units, and so the same results, with any number."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from functools import partial
from itertools import chain, islice
from typing import TypeVar

from fieldcalib.console.arguments import count
from fieldcalib.console.progress import progress_bar
from fieldcalib.processes.jobs import Processes, in_order
from fieldcalib.processes.other_process import ProcessEndedError
from fieldcalib.run_folder.results import Outcome, Results

Item = TypeVar("Item")

LARGEST_UNIT, LEAST_UNITS, SMALLEST_UNIT = 256, 4, 64


@dataclass(frozen=True)
class Shard:
    """Every n-th unit."""

    number: int
    """From 1."""
    of: int

    def __str__(self) -> str:
        """As on the command line."""
        return f"{self.number}/{self.of}"

    @classmethod
    def parse(cls, text: str) -> Shard:
        """What "K/N" says, for argparse.

        Examples
        --------
        >>> Shard.parse("2/8")
        Shard(number=2, of=8)
        """
        number, _, of = text.partition("/")
        if not (number.isdecimal() and of.isdecimal() and 1 <= int(number) <= int(of)):
            raise argparse.ArgumentTypeError(f"expected K/N with K from 1 to N, as 1/8, got {text!r}")
        return cls(int(number), int(of))


@dataclass(frozen=True)
class Made:
    """What was made of a unit."""

    outcomes: Sequence[Outcome]
    seconds: float = 0.0
    """Of the calibrations."""
    said: str = ""
    """For stdout."""


def add_again(parser: argparse.ArgumentParser) -> None:
    """--resume and --overwrite, of everything that writes results."""
    again = parser.add_mutually_exclusive_group()
    again.add_argument(
        "--resume", action="store_true", help="go on with the run in DIR where it stopped; the files are the same then"
    )
    again.add_argument("--overwrite", action="store_true", help="remove the results of an earlier run in DIR first")


def add_processes(parser: argparse.ArgumentParser) -> None:
    """--jobs."""
    parser.add_argument(
        "--jobs",
        type=count,
        default=1,
        metavar="N",
        help="processes, each with one thread; the results are the same (1)",
    )


def add_jobs(parser: argparse.ArgumentParser) -> None:
    """--jobs, --shard, --resume and --overwrite of everything that works on frames one by one."""
    add_processes(parser)
    parser.add_argument(
        "--shard",
        type=Shard.parse,
        metavar="K/N",
        help="do only the K-th of N parts of the work, for several machines; fieldcalib join puts them together (all)",
    )
    add_again(parser)


def unit_size(frames: int) -> int:
    """How many frames are worked on together: many are quicker, and processes need some to share.

    Examples
    --------
    >>> unit_size(3), unit_size(728), unit_size(100_000)
    (64, 182, 256)
    """
    return min(max(-(-frames // LEAST_UNITS), SMALLEST_UNIT), LARGEST_UNIT)


def units_of(items: Iterable[Item], size: int, shard: Shard | None = None) -> Iterator[tuple[Item, ...]]:
    """Items in units of some size, the last one of what is left; of a shard every n-th.

    Examples
    --------
    >>> list(units_of("abcde", 2)), list(units_of("abcde", 2, Shard(2, 2)))
    ([('a', 'b'), ('c', 'd'), ('e',)], [('c', 'd')])
    """
    rest = iter(items)
    units = iter(lambda: tuple(islice(rest, size)), ())
    return units if shard is None else islice(units, shard.number - 1, None, shard.of)


def frames_of_shard(frames: int, size: int, shard: Shard | None) -> int:
    """How many of some frames are in the units of a shard.

    Examples
    --------
    >>> frames_of_shard(20, 8, Shard(1, 2)), frames_of_shard(20, 8, None)
    (12, 20)
    """
    return sum(map(len, units_of(range(frames), size, shard)))


@contextmanager
def processes_of(options: argparse.Namespace) -> Iterator[Executor | None]:
    """What works on units; None with one job, which is done here."""
    with nullcontext() if options.jobs == 1 else Processes(options.jobs) as executor:
        yield executor


def work(
    options: argparse.Namespace,
    results: Results,
    items: Iterable[Item],
    size: int,
    function: Callable[[tuple[Item, ...]], Made],
    lost: Callable[[Item, str], Outcome],
    total: int,
    write: Callable[[Outcome], None] | None = None,
) -> None:
    """Write what a function makes of items, `size` of them at once, in their order; those that are done are left out.

    With `write` it gets all of them. A frame whose process ends is `lost`, with what is wrong with it; the others of
    its unit are done.
    """
    with (
        processes_of(options) as executor,
        progress_bar(total=frames_of_shard(total, size, options.shard), unit="frame") as progress,
    ):
        units = units_of(items, size, options.shard)
        done = results.done if write is None else 0
        progress.update(done)
        rest, half = _rest(units, done)
        rescue = None if executor is None else partial(_rescued, executor, function, lost)
        for made in in_order(executor, function, rest, ahead=2 * options.jobs, rescue=rescue):
            if made.said:
                print(made.said)
            results.calibrating += made.seconds
            for outcome in made.outcomes[half:]:
                (write or results.add)(outcome)
                progress.update()
            half = 0


def _rest(units: Iterable[tuple[Item, ...]], done: int) -> tuple[Iterable[tuple[Item, ...]], int]:
    """The units that are not done, and how many frames of the first of these are.

    That one is worked on as a whole again, for the same results.
    """
    left = iter(units)
    for unit in left:
        if done < len(unit):
            return chain([unit], left), done
        done -= len(unit)
    return (), 0


def _rescued(
    executor: Executor,
    function: Callable[[tuple[Item, ...]], Made],
    lost: Callable[[Item, str], Outcome],
    unit: tuple[Item, ...],
    _: ProcessEndedError,
) -> Made:
    """What is made of a unit whose process has ended: once more as a whole, then frame by frame."""
    try:
        return executor.submit(function, unit).result()
    except ProcessEndedError as error:
        if len(unit) == 1:
            problem = f"the process that worked on it ended with exit code {error.exit_code}"
            return Made([lost(unit[0], problem)])
        parts = [_rescued(executor, function, lost, (item,), error) for item in unit]
    outcomes = [outcome for part in parts for outcome in part.outcomes]
    said = "\n".join(part.said for part in parts if part.said)
    return Made(outcomes, sum(part.seconds for part in parts), said)
