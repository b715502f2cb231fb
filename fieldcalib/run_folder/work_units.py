"""Division of frames into units for several processes; units, and so results, do not depend on their number."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from functools import partial
from itertools import chain, islice
from typing import TypeVar

from fieldcalib._progress import progress_bar, show
from fieldcalib.processes.jobs import Processes, in_order
from fieldcalib.processes.other_process import ProcessEndedError
from fieldcalib.run_folder.record import Item, Outcome, RunOptions, Shard
from fieldcalib.run_folder.results import ResultsWriter

Member = TypeVar("Member")
ItemT = TypeVar("ItemT", bound=Item)
Key = TypeVar("Key")
Result = TypeVar("Result")

LARGEST_UNIT, LEAST_UNITS, SMALLEST_UNIT = 256, 4, 64


@dataclass(frozen=True)
class UnitResult:
    """The results of a unit of frames."""

    outcomes: Sequence[Outcome]
    seconds: float = 0.0
    """Time of the calibrations."""
    message: str = ""
    """Line for stdout."""


def grouped(items: Iterable[Member], key: Callable[[Member], Key]) -> dict[Key, list[Member]]:
    """Group items by key, in lists.

    Examples
    --------
    >>> grouped(["a", "bb", "c"], len)
    {1: ['a', 'c'], 2: ['bb']}
    """
    groups: dict[Key, list[Member]] = {}
    for item in items:
        groups.setdefault(key(item), []).append(item)
    return groups


def in_groups(
    items: Sequence[Member], key: Callable[[Member], Key], function: Callable[[Key, list[Member]], Sequence[Result]]
) -> list[Result]:
    """Apply a function to the items of each key together; the results are in the order of the items.

    Examples
    --------
    >>> in_groups(["a", "bb", "c"], len, lambda length, words: [f"{length} of {len(words)}"] * len(words))
    ['1 of 2', '2 of 1', '1 of 2']
    """
    found: dict[int, Result] = {}
    for value, members in grouped(range(len(items)), lambda index: key(items[index])).items():
        found |= zip(members, function(value, [items[index] for index in members]), strict=True)
    return [found[index] for index in range(len(items))]


def unit_size(frames: int) -> int:
    """Number of frames in a unit: large units are faster, but there must be enough units for several processes.

    Examples
    --------
    >>> unit_size(3), unit_size(728), unit_size(100_000)
    (64, 182, 256)
    """
    return min(max(-(-frames // LEAST_UNITS), SMALLEST_UNIT), LARGEST_UNIT)


def units_of(items: Iterable[Member], size: int, shard: Shard | None = None) -> Iterator[tuple[Member, ...]]:
    """Split items into units of a size, the last of which may be smaller; a shard gets every n-th unit.

    Examples
    --------
    >>> list(units_of("abcde", 2)), list(units_of("abcde", 2, Shard(2, 2)))
    ([('a', 'b'), ('c', 'd'), ('e',)], [('c', 'd')])
    """
    rest = iter(items)
    units = iter(lambda: tuple(islice(rest, size)), ())
    return units if shard is None else islice(units, shard.number - 1, None, shard.of)


def frames_of_shard(frames: int, size: int, shard: Shard | None) -> int:
    """Number of frames in the units of a shard.

    Examples
    --------
    >>> frames_of_shard(20, 8, Shard(1, 2)), frames_of_shard(20, 8, None)
    (12, 20)
    """
    return sum(map(len, units_of(range(frames), size, shard)))


def executor_of(jobs: int) -> AbstractContextManager[Executor | None]:
    """Start processes that work on units; None for one job, which works in this process."""
    return nullcontext() if jobs == 1 else Processes(jobs)


def work(
    run: RunOptions,
    results: ResultsWriter,
    items: Iterable[ItemT],
    size: int,
    function: Callable[[tuple[ItemT, ...]], UnitResult],
    total: int,
    write: Callable[[Outcome], None] | None = None,
) -> None:
    """Apply a function to units of `size` items and write the outcomes in order, without frames that are done already.

    If `write` is given, it is called with the outcomes of all items instead. A frame whose process ends is written as
    broken; the other frames of its unit are done.
    """
    done = results.done if write is None else 0
    with (
        executor_of(run.jobs) as executor,
        progress_bar(total=frames_of_shard(total, size, run.shard), unit="frame", initial=done) as progress,
    ):
        units = units_of(items, size, run.shard)
        rest, skipped = _rest(_checked(units, results), done)
        rescue = None if executor is None else partial(_rescued, executor, function)
        for result in in_order(executor, function, rest, ahead=2 * run.jobs, rescue=rescue):
            if result.message:
                show(result.message)
            results.calibrating += result.seconds
            for outcome in result.outcomes[skipped:]:
                (write or results.add)(outcome)
                progress.update()
            skipped = 0


def _checked(units: Iterable[tuple[ItemT, ...]], results: ResultsWriter) -> Iterator[tuple[ItemT, ...]]:
    """Yield the units, checking that the first frames are those that an earlier part of the run has written."""
    number = 0
    for unit in units:
        for item in unit:
            results.check_restored(number, item.id)
            number += 1
        yield unit


def _rest(units: Iterable[tuple[Member, ...]], done: int) -> tuple[Iterable[tuple[Member, ...]], int]:
    """Find the units that are not done, and how many frames of the first of them are.

    That unit is processed again as a whole, so that the results are the same.
    """
    left = iter(units)
    for unit in left:
        if done < len(unit):
            return chain([unit], left), done
        done -= len(unit)
    return (), 0


def _rescued(
    executor: Executor,
    function: Callable[[tuple[ItemT, ...]], UnitResult],
    unit: tuple[ItemT, ...],
    _: ProcessEndedError,
) -> UnitResult:
    """Process a unit whose process has ended: once more as a whole, then frame by frame."""
    try:
        return executor.submit(function, unit).result()
    except ProcessEndedError as error:
        if len(unit) == 1:
            problem = f"the process that worked on it ended with exit code {error.exit_code}"
            return UnitResult([Outcome.broken(unit[0], problem)])
        parts = [_rescued(executor, function, (item,), error) for item in unit]
    return joined(parts)


def joined(parts: Sequence[UnitResult]) -> UnitResult:
    """Join the results of parts of a unit."""
    outcomes = [outcome for part in parts for outcome in part.outcomes]
    message = "\n".join(part.message for part in parts if part.message)
    return UnitResult(outcomes, sum(part.seconds for part in parts), message)
