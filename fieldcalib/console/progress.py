"""Progress of long work: a bar on a terminal and in a notebook, lines elsewhere, or a function of the caller's."""

from __future__ import annotations

import importlib
import importlib.util
import io
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias

if TYPE_CHECKING:
    from tqdm import tqdm

INTERVAL = 10.0  # seconds from one line to the next

Progress: TypeAlias = bool | Callable[[int, int | None, str], object]
"""Whether progress is shown, or a function of how many are done, how many there are (None: not known), and the stage:
an error that it raises ends the work."""


class Counter(Protocol):
    """Counts what is done."""

    def update(self, n: int = 1) -> object:
        """Count `n` more."""


@contextmanager
def progress_bar(
    *, unit: str, total: int | None = None, initial: int = 0, desc: str = "", progress: Progress = True
) -> Iterator[Counter]:
    """Show the progress of one stage of the work while the context lasts.

    On a terminal and in a notebook there is a bar, by tqdm; elsewhere a line on stderr every ten seconds with what is
    done, the rate, and the time left.

    Parameters
    ----------
    unit : str
        What is counted, in the singular.
    total : int, optional
        How many there are, as far as it is known.
    initial : int
        How many were done before, as by a run that is resumed; they do not count for the rate.
    desc : str
        Name of the stage.
    progress : bool or function
        False shows nothing; a function gets what is done, the total and the stage, at the beginning and after each.

    Examples
    --------
    >>> with progress_bar(unit="frame", total=2) as progress:
    ...     progress.update()
    >>> with progress_bar(unit="frame", total=2, desc="looking", progress=print) as progress:
    ...     progress.update()
    0 2 looking
    1 2 looking
    """
    if progress is False:
        yield _Silent()
    elif progress is not True:
        yield _Told(progress, total, initial, desc)
    elif _is_drawn():
        with _bar(unit, total, initial, desc) as bar:
            yield bar
    else:
        yield _Lines(unit, total, initial, desc)


class _Silent:
    """Shows nothing."""

    def update(self, n: int = 1) -> None:
        """Count `n` more."""


class _Told:
    """Tells a function of the caller's."""

    def __init__(
        self, function: Callable[[int, int | None, str], object], total: int | None, initial: int, stage: str
    ) -> None:
        self._function, self._total, self._stage, self._done = function, total, stage, initial
        self.update(0)

    def update(self, n: int = 1) -> None:
        """Count `n` more."""
        self._done += n
        self._function(self._done, self._total, self._stage)


class _Lines:
    """Prints a line on stderr now and then, where that is a file or a pipe."""

    def __init__(self, unit: str, total: int | None, initial: int, stage: str) -> None:
        self._unit, self._total, self._stage = unit, total, stage
        self._initial, self._done, self._begin = initial, initial, time.monotonic()
        self._next = self._begin + INTERVAL if _has_file(sys.stderr) else float("inf")

    def update(self, n: int = 1) -> None:
        """Count `n` more."""
        self._done += n
        now = time.monotonic()
        if now >= self._next and self._done > self._initial:
            self._next = now + INTERVAL
            print(f"fieldcalib: {self._line(now - self._begin)}", file=sys.stderr, flush=True)

    def _line(self, seconds: float) -> str:
        rate = (self._done - self._initial) / seconds
        stage = f"{self._stage}: " if self._stage else ""
        line = f"{stage}{self._done}{f' of {self._total}' if self._total else ''} {self._unit}s, {rate:.3g} a second"
        if self._total and self._total >= self._done:
            line += f", {_clock((self._total - self._done) / rate)} left"
        return line


def _clock(seconds: float) -> str:
    """A time as H:MM:SS or M:SS.

    Examples
    --------
    >>> _clock(75.4), _clock(3661.0)
    ('1:15', '1:01:01')
    """
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"


def _has_file(stream: Any) -> bool:
    """Whether a stream is of a file, a pipe or a terminal, not kept in memory by somebody who prints it later."""
    try:
        stream.fileno()
    except (AttributeError, OSError, io.UnsupportedOperation):
        return False
    return True


def _is_drawn() -> bool:
    """Whether bars can be drawn: stderr is a terminal, or this is a notebook."""
    return (sys.stderr is not None and sys.stderr.isatty()) or _is_notebook()


def _is_notebook() -> bool:
    """Whether this process is the kernel of a notebook."""
    ipython = sys.modules.get("IPython")
    shell = None if ipython is None else ipython.get_ipython()
    return type(shell).__name__ == "ZMQInteractiveShell"


def _bar(unit: str, total: int | None, initial: int, desc: str) -> tqdm:
    """A bar of tqdm that prints no error if an interrupt hits its construction, as tqdm's own does."""
    in_page = _is_notebook() and importlib.util.find_spec("ipywidgets") is not None
    kind: Any = importlib.import_module("tqdm.notebook" if in_page else "tqdm").tqdm

    class Bar(kind):  # type: ignore[misc]
        disable = True
        monitor_interval = 0  # no monitor thread for each bar

    return Bar(unit=unit, total=total, initial=initial, desc=desc)
