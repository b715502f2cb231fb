"""A clip that is solved in the background, its progress, and its solution until it is kept or discarded."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from dataclasses import dataclass
from threading import Lock, Thread
from typing import Any

from fieldcalib.editor.clip import Proposal
from fieldcalib.editor.editor import Editor
from fieldcalib.web.records import calibration_record

LOG = logging.getLogger("fieldcalib")


class _Cancelled(Exception):
    """The work is to end."""


@dataclass
class _Status:
    """Where the work stands."""

    state: str = "none"
    done: int = 0
    total: int = 0
    stage: str = ""
    error: str = ""
    is_cancelled: bool = False
    proposal: Proposal | None = None


class ClipJob:
    """Solves the clip of an editor in a thread, one solution at a time."""

    def __init__(self, editor: Editor) -> None:
        self._editor = editor
        self._status = _Status()
        self._lock = Lock()
        self._thread: Thread | None = None

    def start(self) -> None:
        """Begin to solve; a ValueError if it is being solved already."""
        with self._lock:
            if self._status.state == "running":
                raise ValueError("the clip is being solved already: wait, or cancel that")
            status = self._status = _Status("running")
        self._thread = Thread(target=self._run, args=(status, self._editor.solve), name="clip", daemon=True)
        self._thread.start()

    def _run(self, status: _Status, work: Callable[..., Proposal]) -> None:
        def progress(done: int, total: int, stage: str) -> None:
            if status.is_cancelled:
                raise _Cancelled
            status.done, status.total, status.stage = done, total, stage

        try:
            status.proposal = work(progress)
            status.state = "none" if status.is_cancelled else "ready"
        except _Cancelled:
            status.state = "none"
        except Exception as error:  # it is said on the page
            LOG.exception("solving the clip failed")
            status.error, status.state = f"solving the clip failed: {error}", "failed"

    def cancel(self) -> None:
        """End the work as soon as possible, or drop its solution."""
        with self._lock:
            self._status.is_cancelled = True
            self._status = _Status()

    def keep(self) -> int:
        """Take the solution; a ValueError if there is none."""
        with self._lock:
            count = self._editor.keep(self.proposal)
            self._status = _Status()
        return count

    @property
    def proposal(self) -> Proposal:
        """The solution; a ValueError if there is none."""
        proposal = self._status.proposal
        if proposal is None or self._status.state != "ready":
            raise ValueError("expected a solution of the clip: solve it first")
        return proposal

    def report(self) -> dict[str, Any]:
        """Where the work stands, for the page."""
        status = self._status
        changes = None
        if status.state == "ready" and status.proposal is not None:
            numbers = list(status.proposal.calibrations)
            moves = [status.proposal.moves[n] for n in numbers]
            changes = {
                "frames": numbers,
                "pixels": [None if math.isnan(move) else round(move, 2) for move in moves],
                "verdict": [str(one.verdict) for one in status.proposal.calibrations.values()],
            }
        return {
            "state": status.state,
            "done": status.done,
            "total": status.total,
            "stage": status.stage,
            "error": status.error,
            "changes": changes,
        }

    def proposed(self, number: int) -> dict[str, Any]:
        """The camera of a frame in the solution, for the page; a ValueError if there is none."""
        calibration = self.proposal.calibrations.get(number)
        if calibration is None:
            raise ValueError("this frame is not in the solution")
        return calibration_record(calibration, self._editor.field)

    def close(self) -> None:
        """End the work."""
        self.cancel()
        if self._thread is not None:
            self._thread.join(timeout=5.0)
