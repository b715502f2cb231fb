"""Interrupts (Ctrl-C) and requests to end (SIGTERM), during imports and during the work."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager


class Terminated(KeyboardInterrupt):
    """The process was asked to end, by `kill`, a scheduler or a shutdown."""


@contextmanager
def requests_to_end_interrupt() -> Iterator[None]:
    """Let SIGTERM raise `Terminated`, so that everything is cleaned up as after Ctrl-C.

    Nothing changes where it is ignored or handled by other code, or in another thread than the main one.
    """
    is_main = threading.current_thread() is threading.main_thread()
    if not is_main or signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL:
        yield
        return
    signal.signal(signal.SIGTERM, _terminate)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


def _terminate(*_: object) -> None:
    raise Terminated


@contextmanager
def interrupts_end_the_process() -> Iterator[None]:
    """Let interrupts end the process at once; for imports, in which extension modules lose a KeyboardInterrupt.

    Nothing changes where interrupts are ignored or handled by other code, or in another thread than the main one.
    """
    own: dict[signal.Signals, Callable[..., object]] = {
        signal.SIGINT: signal.default_int_handler,
        signal.SIGTERM: _terminate,
    }
    is_main = threading.current_thread() is threading.main_thread()
    changed = [number for number, handler in own.items() if is_main and signal.getsignal(number) is handler]
    for number in changed:
        signal.signal(number, signal.SIG_DFL)
    try:
        yield
    finally:
        for number in changed:
            signal.signal(number, own[number])
