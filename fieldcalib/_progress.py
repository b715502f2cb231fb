"""Progress of long work: a bar on a terminal and in a notebook, lines elsewhere, or a function of the caller's.

Lines are not tqdm's: it prints none while work stands still, and none of stages that are shorter than its interval.

Reads that take long, as from a network drive that stalls, are told too.

Messages for people: on stderr after the name of the program, results on stdout.
"""

from __future__ import annotations

import importlib
import importlib.util
import io
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias

if TYPE_CHECKING:
    from tqdm import tqdm

INTERVAL = 10.0  # seconds from one line to the next
FIRST, GROWTH = 30.0, 2.0  # seconds until the first warning of a read, and factor from each warning to the next
CHECKS = 30.0  # before the first warning

_waits: dict[int, tuple[Path | str, float]] = {}  # by thread: the file that is read, and the time at which that began
_watcher: threading.Thread | None = None

Progress: TypeAlias = bool | Callable[[int, int | None, str], object]
"""Whether progress is shown, or a function of how many are done, how many there are (None: not known), and the stage:
an error that it raises ends the work."""


def printable(text: str) -> str:
    """Text for a terminal: control characters, as names of files may have, are escaped; ends of lines and tabs stay.

    Examples
    --------
    >>> printable("clip\\x1b[2J.mp4"), printable("±1 m")
    ('clip\\\\x1b[2J.mp4', '±1 m')
    """
    if text.isprintable():
        return text
    return "".join(one if one.isprintable() or one in "\n\t" else ascii(one)[1:-1] for one in text)


def say(message: str) -> None:
    """Print a line on stderr, after the name of the program."""
    print(printable(f"fieldcalib: {message}"), file=sys.stderr, flush=True)


def show(text: str) -> None:
    """Print the result of a command on stdout."""
    print(printable(text))


def counted(number: int, noun: str) -> str:
    """A number with its noun.

    Examples
    --------
    >>> counted(1, "frame"), counted(2, "frame")
    ('1 frame', '2 frames')
    """
    return f"{number} {noun}{'' if number == 1 else 's'}"


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
    if progress is not True:
        yield _Told((lambda *_: None) if progress is False else progress, total, initial, desc)
    elif _is_drawn():
        with _bar(unit, total, initial, desc) as bar:
            yield bar
    else:
        lines = _Lines(unit, total, initial, desc)
        with _LINES.shown(lines):
            yield lines


class _Told:
    """Tells a function of the caller's."""

    def __init__(
        self, function: Callable[[int, int | None, str], object], total: int | None, initial: int, stage: str
    ) -> None:
        if not callable(function):
            raise ValueError(f"progress must be True, False or a function, got {function!r}")
        self._function, self._total, self._stage, self._done = function, total, stage, initial
        self.update(0)

    def update(self, n: int = 1) -> None:
        """Count `n` more."""
        self._done += n
        self._function(self._done, self._total, self._stage)


@contextmanager
def solving(stage: str, progress: Progress = True) -> Iterator[None]:
    """Print, while no other stage is under way, that the work goes on: every ten seconds, where there are no bars."""
    if progress is not True or _is_drawn():
        yield
        return
    with _LINES.shown(_Waiting(stage)):
        yield


class _Lines:
    """Counts what is done of a stage, and says it in a line."""

    def __init__(self, unit: str, total: int | None, initial: int, stage: str) -> None:
        self._unit, self._total, self._stage = unit, total, stage
        self._initial, self._done, self.begin = initial, initial, time.monotonic()
        self._told = initial  # how many were done when the last line was printed
        self._since, self._updates = self.begin, 0  # time of the last update, and how many there were

    def update(self, n: int = 1) -> None:
        """Count `n` more."""
        self._done, self._since, self._updates = self._done + n, time.monotonic(), self._updates + 1
        _LINES.print_if_due(self._since, self)

    @property
    def _counted(self) -> str:
        stage, total = f"{self._stage}: " if self._stage else "", f" of {self._total}" if self._total else ""
        return f"{stage}{self._done}{total} {self._unit}s"

    def slowly(self, now: float) -> str:
        """What is done of it, and the time left, by the updates so far, as of a stage whose parts are stages."""
        line = self._counted
        if self._done > self._initial and self._total:
            each = (self._since - self.begin) / (self._done - self._initial)
            line += f", {_clock(max((self._total - self._done) * each - (now - self._since), 0.0))} left"
        return line

    def line(self, now: float) -> str:
        """What is done of it, the rate, and the time left; how long it has taken where it has not advanced."""
        line, seconds = self._counted, max(now - self.begin, 1e-3)
        if self._done == self._told:
            if now - self._since < 2.0 * (self._since - self.begin) / max(self._updates, 1):  # the next is under way
                return self.slowly(now)
            return f"{line}, {_clock(seconds)} so far"
        rate, self._told = (self._done - self._initial) / seconds, self._done
        line += f", {rate:.3g} a second"
        if self._total and self._total >= self._done:
            line += f", {_clock((self._total - self._done) / rate)} left"
        return line


class _Waiting:
    """Work of which nothing can be counted."""

    def __init__(self, stage: str) -> None:
        self._stage, self.begin = stage, time.monotonic()

    def line(self, now: float) -> str:
        """How long it has taken so far."""
        return f"{self._stage}, {_clock(now - self.begin)} so far"


class _Printer:
    """Prints a line on stderr every ten seconds while there are stages, where that is a file or a pipe.

    Stages may be shorter than that, and may stand still for longer: a thread prints about the one that advanced last.
    """

    def __init__(self) -> None:
        self._stages: list[_Lines | _Waiting] = []  # the one that advanced last is the last
        self._next = -float("inf")  # time of the next line
        self._lock = threading.RLock()
        self._has_ended = threading.Event()

    @contextmanager
    def shown(self, stage: _Lines | _Waiting) -> Iterator[None]:
        """Print about a stage while the context lasts."""
        with self._lock:
            if not self._stages:
                self._begin(stage.begin)
            self._stages.append(stage)
        try:
            yield
        finally:
            with self._lock:
                self._stages.remove(stage)
                if not self._stages:
                    self._has_ended.set()

    def _begin(self, now: float) -> None:
        if abs(now - self._next) > INTERVAL:  # otherwise it is the next stage of some work
            self._next = now + INTERVAL
        self._has_ended = threading.Event()
        threading.Thread(target=self._watch, args=(self._has_ended,), name="progress", daemon=True).start()

    def _watch(self, has_ended: threading.Event) -> None:
        while not has_ended.wait(INTERVAL / 10.0):
            self.print_if_due(time.monotonic())

    def print_if_due(self, now: float, advanced: _Lines | None = None) -> None:
        """Print a line if it is time; `advanced` is the stage that has just advanced."""
        with self._lock:
            if advanced is not None and self._stages and self._stages[-1] is not advanced:
                self._stages.remove(advanced)
                self._stages.append(advanced)
            if now < self._next or not self._stages or not _has_file(sys.stderr):
                return
            self._next = now + INTERVAL
            bars, last = [stage for stage in self._stages if isinstance(stage, _Lines)], self._stages[-1]
            first = min(bars, key=lambda stage: stage.begin, default=last)
            whole = f"{first.slowly(now)}; " if isinstance(first, _Lines) and first is not last else ""
            print(f"fieldcalib: {whole}{last.line(now)}", file=sys.stderr, flush=True)


_LINES = _Printer()


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


@contextmanager
def waiting_for(path: Path | str) -> Iterator[None]:
    """Warn on stderr, with exponential back-off, while the reading of a file takes long."""
    global _watcher
    if _watcher is None:
        _watcher = threading.Thread(target=_watch, daemon=True)
        _watcher.start()
    _waits[threading.get_ident()] = path, time.monotonic()
    try:
        yield
    finally:
        del _waits[threading.get_ident()]


def _watch() -> None:
    next_time: dict[tuple[Path | str, float], float] = {}  # seconds of waiting until the next warning
    while True:
        time.sleep(FIRST / CHECKS)
        waits = list(_waits.values())
        next_time = {one: after for one, after in next_time.items() if one in waits}
        for one in waits:
            path, since = one
            waited = time.monotonic() - since
            if waited >= next_time.get(one, FIRST):
                say(f"{path}: waiting for it for {waited:.0f} seconds")
                next_time[one] = GROWTH * waited
