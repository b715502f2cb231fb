"""Warnings about reads that take long, as from a network drive that stalls."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from fieldcalib.console.program import say

FIRST, GROWTH = 30.0, 2.0  # seconds until the first warning, and factor from each warning to the next
CHECKS = 30.0  # before the first warning

_waits: dict[int, tuple[Path | str, float]] = {}  # by thread: the file that is read, and the time at which that began
_watcher: threading.Thread | None = None


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
