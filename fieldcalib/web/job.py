"""A clip that is solved or drawn in the background, its progress, and its solution until it is kept or discarded."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from dataclasses import dataclass
from threading import Lock, Thread
from typing import Any

from fieldcalib.editor.clip import Progress, Proposal
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


@dataclass(frozen=True)
class _Task:
    """Work that is to be done."""

    status: _Status
    work: Callable[[Progress], Proposal | None]
    name: str


class ClipJob:
    """Solves or draws the clip of an editor in a thread, one after the other."""

    def __init__(self, editor: Editor) -> None:
        self._editor = editor
        self._status = _Status()
        self._lock = Lock()
        self._next: _Task | None = None
        self._thread: Thread | None = None  # while there is something to do

    def start(self) -> None:
        """Begin to solve; a ValueError if it is being solved already."""
        self._start(self._editor.solve, "solving the clip")

    def draw(self) -> None:
        """Begin to draw files again that show older cameras; a ValueError if the clip is being solved or drawn."""
        self._start(self._drawn, "drawing the clip")

    def _drawn(self, progress: Progress) -> None:
        self._editor.draw(progress)

    def _start(self, work: Callable[[Progress], Proposal | None], what: str) -> None:
        with self._lock:
            if self._status.state == "running":
                raise ValueError("the clip is being solved or drawn already: wait, or cancel that")
            if self._status.state == "ready" and work == self._drawn:
                raise ValueError("keep or discard the solution of the clip first")
            self._status = _Status("running")
            self._next = _Task(self._status, work, what)  # what was cancelled may take a while to end
            if self._thread is None:
                self._thread = Thread(target=self._run, name="clip", daemon=True)
                self._thread.start()

    def _run(self) -> None:
        while (task := self._taken()) is not None:
            self._do(task.status, task.work, task.name)

    def _taken(self) -> _Task | None:
        """Take what is to be done next; the thread ends if that is nothing."""
        with self._lock:
            task, self._next = self._next, None
            if task is None:
                self._thread = None
            return task

    def _do(self, status: _Status, work: Callable[[Progress], Proposal | None], what: str) -> None:
        def progress(done: int, total: int, stage: str) -> None:
            if status.is_cancelled:
                raise _Cancelled
            status.done, status.total, status.stage = done, total, stage

        try:
            status.proposal = work(progress)
            status.state = "none" if status.is_cancelled or status.proposal is None else "ready"
        except _Cancelled:
            status.state = "none"
        except Exception as error:  # it is said on the page
            LOG.exception("%s failed", what)
            status.error, status.state = f"{what} failed: {error}", "failed"

    def cancel(self) -> None:
        """End the work as soon as possible, or drop its solution."""
        with self._lock:
            self._status.is_cancelled = True
            self._status, self._next = _Status(), None

    def keep(self) -> int:
        """Take the solution; a ValueError if there is none."""
        with self._lock:
            count = self._editor.keep(self.proposal)
            self._status = _Status()
        return count

    def undo_keep(self) -> None:
        """Take the solution back that was kept last, which may be kept again; a ValueError if there is none."""
        with self._lock:
            if self._status.state == "running":
                raise ValueError("the clip is being solved or drawn: wait, or cancel that")
            self._status = _Status("ready", proposal=self._editor.undo_keep())

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
            "can_undo_keep": self._editor.can_undo_keep,
            "to_draw": [] if status.state == "running" else self._editor.to_draw,
        }

    def proposed(self, number: int) -> dict[str, Any]:
        """The camera of a frame in the solution, for the page; a ValueError if there is none."""
        calibration = self.proposal.calibrations.get(number)
        if calibration is None:
            raise ValueError("this frame is not in the solution")
        return calibration_record(calibration, self._editor.field)

    def end(self) -> list[Thread]:
        """End the work as soon as possible; returns the thread, if it is still at work."""
        self.cancel()
        thread = self._thread
        return [] if thread is None else [thread]
