"""Interrupts (Ctrl-C) while there is nothing to tidy up."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def interrupts_end_the_process() -> Iterator[None]:
    """For imports before anything is written: extension modules turn a KeyboardInterrupt into other errors, or lose it.

    Nothing changes where interrupts are ignored or handled by somebody else, or in another thread than the main one.
    """
    handled = signal.getsignal(signal.SIGINT)
    if handled is not signal.default_int_handler or threading.current_thread() is not threading.main_thread():
        yield
        return
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, handled)
