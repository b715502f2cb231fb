"""Standard streams of a process that was started without one of them, as by ``2>&-``."""

from __future__ import annotations

import os
import sys

MODES = {"stdin": "r", "stdout": "w", "stderr": "w"}  # in the order of their descriptors


def open_closed_streams() -> None:
    """Open the null device for each of stdin, stdout and stderr that is closed.

    Without that the next file that is opened, or the pipe to another process, gets its number: what is printed would
    be written there.
    """
    for handle, (name, mode) in enumerate(MODES.items()):
        if getattr(sys, name) is not None:
            continue
        if not _is_open(handle):
            null = os.open(os.devnull, os.O_RDWR)
            if null != handle:
                os.dup2(null, handle)
                os.close(null)
            os.set_inheritable(handle, True)
        setattr(sys, name, open(os.devnull, mode, encoding="utf-8"))  # noqa: SIM115  # until the process ends


def _is_open(handle: int) -> bool:
    try:
        os.fstat(handle)
    except OSError:
        return False
    return True
