"""Several Python processes as an executor, and results in the order of what they are made of, by any executor."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from threading import Lock, local
from typing import ParamSpec, TypeVar

from fieldcalib._types import whole_number
from fieldcalib.processes.other_process import OtherProcess, ProcessEndedError

P = ParamSpec("P")
T = TypeVar("T")
Item = TypeVar("Item")

AHEAD = 16  # items that are worked on while others are waited for


class Processes(Executor):
    """An executor of Python processes with one thread each, which start with the first tasks.

    Unlike `concurrent.futures.ProcessPoolExecutor` it needs no guard in the caller's script, and a process that dies
    takes only its task with it: that raises a `ProcessEndedError`, and the next one gets a new process. Functions must
    be those of modules, not of the script.

    Parameters
    ----------
    jobs : int
        Number of processes.

    Examples
    --------
    >>> with Processes(2) as processes:
    ...     list(processes.map(abs, [-1, 2, -3]))
    [1, 2, 3]
    """

    def __init__(self, jobs: int) -> None:
        self.jobs = whole_number(jobs, "jobs", 1)
        self._threads = ThreadPoolExecutor(self.jobs, "process")
        self._own = local()  # of each thread: its process
        self._all: set[OtherProcess] = set()
        self._lock = Lock()
        self._is_closed = False

    def submit(self, function: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Run a function in one of the processes; its result as a future."""
        return self._threads.submit(self._run, function, *args, **kwargs)

    def _run(self, function: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> T:
        process: OtherProcess | None = getattr(self._own, "process", None)
        if process is None or process.has_ended:
            process = self._own.process = self._started_for(process)
        return process.run(function, *args, **kwargs)

    def _started_for(self, ended: OtherProcess | None) -> OtherProcess:
        """A new process, for one that has ended or that was not started yet."""
        process = OtherProcess()
        with self._lock:
            self._all = (self._all - {ended}) | {process}
            is_closed = self._is_closed
        if ended is not None:
            ended.close()
        if is_closed:  # in the meantime
            process.close()
        return process

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes; with `wait`, after their tasks."""
        self._threads.shutdown(wait, cancel_futures=cancel_futures)
        with self._lock:
            self._is_closed = True
            left = list(self._all)
            self._all.clear()
        for process in left:
            process.close()

    def __exit__(self, kind: object, error: object, traceback: object) -> None:
        """End the processes; after an error or an interrupt, at once."""
        if error is not None:
            self.shutdown(wait=False, cancel_futures=True)
        self.shutdown()


def in_order(
    executor: Executor | None,
    function: Callable[[Item], T],
    items: Iterable[Item],
    *,
    ahead: int = AHEAD,
    rescue: Callable[[Item, ProcessEndedError], T] | None = None,
) -> Iterator[T]:
    """The results of a function, in the order of its arguments, from any executor.

    Items are taken, and results held, up to `ahead` in advance, so that memory does not grow with their number.

    Parameters
    ----------
    executor : Executor, optional
        Any of `concurrent.futures`, or another with `submit`: that of dask's clients. None calls the function here.
    function, items
        As of `map`.
    ahead : int
        Items that are worked on while others are waited for.
    rescue : callable, optional
        Gives the result of an item whose process has ended.

    Examples
    --------
    >>> with ThreadPoolExecutor() as threads:
    ...     list(in_order(threads, abs, [-1, 2, -3]))
    [1, 2, 3]
    """
    if executor is not None and not hasattr(executor, "submit"):
        raise ValueError(f"expected an executor, as fieldcalib.processes.Processes(2), got {executor!r}")
    if executor is None:
        yield from map(function, items)
        return
    waiting: deque[tuple[Item, Future[T]]] = deque()

    def first() -> T:
        item, future = waiting.popleft()
        try:
            return future.result()
        except ProcessEndedError as error:
            if rescue is None:
                raise
            return rescue(item, error)

    try:
        for item in items:
            waiting.append((item, executor.submit(function, item)))
            if len(waiting) > ahead:
                yield first()
        while waiting:
            yield first()
    finally:
        for _, future in waiting:
            future.cancel()
