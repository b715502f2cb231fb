"""Reads that do not come back, as from a network drive that stalls: it is said which file is waited for."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

FIRST, GROWTH = 30.0, 2.0  # seconds until it is said, and times so many until it is said again
STEP = 30.0  # of `FIRST`: between two looks

_waits: dict[int, tuple[Path | str, float]] = {}  # by thread: what is read, and since when
_watcher: threading.Thread | None = None


@contextmanager
def waiting_for(path: Path | str) -> Iterator[None]:
    """While a file is read: if that takes long, stderr says so, again and again at growing intervals."""
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
    next_time: dict[tuple[Path | str, float], float] = {}  # seconds of waiting after which it is said
    while True:
        time.sleep(FIRST / STEP)
        waits = list(_waits.values())
        next_time = {one: after for one, after in next_time.items() if one in waits}
        for one in waits:
            path, since = one
            waited = time.monotonic() - since
            if waited >= next_time.get(one, FIRST):
                print(f"fieldcalib: {path}: waiting for it for {waited:.0f} seconds", file=sys.stderr, flush=True)
                next_time[one] = GROWTH * waited
