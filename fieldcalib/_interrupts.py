"""Interrupts (Ctrl-C) and requests to end (SIGTERM), during imports and during the work."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

# Functions whose exceptions Python prints and forgets: finalizers, and those of llvmlite that LLVM calls while Numba
# loads or compiles a function. LLVM takes seconds, after which a signal is handled in the first function called.
LOSING = ("__del__", "_raw_object_cache_notify", "_raw_object_cache_getbuffer")
SOON = 0.01  # s


class Terminated(KeyboardInterrupt):
    """The process was asked to end, by `kill`, a scheduler or a shutdown."""


@contextmanager
def interrupts_reach_the_work() -> Iterator[None]:
    """Let SIGTERM raise `Terminated`, so that everything is cleaned up as after Ctrl-C, and neither of both be lost.

    Nothing changes where they are ignored or handled by other code, or in another thread than the main one.
    """
    before: dict[signal.Signals, Any] = {signal.SIGINT: signal.default_int_handler, signal.SIGTERM: signal.SIG_DFL}
    changed = [number for number, handler in before.items() if _is_handled_by(number, handler)]
    for number in changed:
        signal.signal(number, _interrupt)
    try:
        yield
    finally:
        for number in changed:
            if signal.getsignal(number) is _interrupt:
                signal.signal(number, before[number])


def ignore_interrupts() -> None:
    """Let interrupts come too late: the work is done, and only the interpreter is still to end."""
    for number in (signal.SIGINT, signal.SIGTERM):
        if _is_handled_by(number, signal.default_int_handler, signal.SIG_DFL, _interrupt):
            signal.signal(number, signal.SIG_IGN)


def _is_handled_by(number: signal.Signals, *handlers: object) -> bool:
    is_main = threading.current_thread() is threading.main_thread()
    return is_main and signal.getsignal(number) in handlers


def _interrupt(number: int, frame: FrameType | None) -> None:
    """Raise what a signal stands for; a little later where it would be lost."""
    while frame is not None:
        if frame.f_code.co_name in LOSING:
            threading.Timer(SOON, _send, [number]).start()
            return
        frame = frame.f_back
    raise Terminated if number == signal.SIGTERM else KeyboardInterrupt


def _send(number: int) -> None:
    if os.name == "posix":
        os.kill(os.getpid(), number)  # wakes the main thread
    else:
        signal.raise_signal(number)


@contextmanager
def interrupts_end_the_process() -> Iterator[None]:
    """Let interrupts end the process at once; for imports, in which extension modules lose a KeyboardInterrupt.

    Nothing changes where interrupts are ignored or handled by other code, or in another thread than the main one.
    """
    own = (signal.default_int_handler, _interrupt)
    before = {
        number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM) if _is_handled_by(number, *own)
    }
    for number in before:
        signal.signal(number, signal.SIG_DFL)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
