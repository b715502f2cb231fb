"""Background threads of the page: fitting and searching of cameras, and solving and drawing of a clip.

`Worker` fits the cameras of frames. Frames that a person waits for come first, the last requested one before all;
further frames of a folder are calibrated when there is nothing else to do. If a frame is edited several times in the
meantime, only its last state is fitted. After an edit the new markings are sent first; the verdict on their camera is
computed when the page asks for the whole state, or a little later. `Searches` searches frames for the court.

`ClipJob` solves or draws a clip, reports the progress, and holds the solution until it is kept or discarded.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from dataclasses import dataclass
from threading import Condition, Lock, Thread
from typing import Any

from fieldcalib.assess.findings import Verdict
from fieldcalib.editor.clip import Progress, Proposal
from fieldcalib.editor.editor import Editor
from fieldcalib.io.files import BrokenFileError
from fieldcalib.web.records import broken_state, calibration_record, drawn_state, frame_state

LOG = logging.getLogger("fieldcalib")

PAUSE = 0.5  # seconds after which frames that were drawn get their verdicts, if the page has not asked for them


class _Cancelled(Exception):
    """Raised to end cancelled work."""


@dataclass
class _Status:
    """State and progress of the work."""

    state: str = "none"
    done: int = 0
    total: int = 0
    stage: str = ""
    error: str = ""
    is_cancelled: bool = False
    proposal: Proposal | None = None


class ClipJob:
    """Solves or draws the clip of an editor in a thread, one job at a time."""

    def __init__(self, editor: Editor) -> None:
        self._editor = editor
        self._status = _Status()
        self._lock = Lock()
        self._next: tuple[_Status, Callable[[Progress], Proposal | None], str] | None = None  # work, and its name
        self._thread: Thread | None = None  # while there is something to do

    def start(self) -> None:
        """Begin to solve; a ValueError for pictures, or if the clip is being solved already."""
        if not self._editor.is_clip:
            raise ValueError("expected a clip: pictures are mended one by one")
        self._start(self._editor.solve, "solving the clip")

    def draw(self) -> None:
        """Begin to redraw the files that show older cameras; a ValueError if the clip is being solved or drawn."""
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
            self._next = self._status, work, what  # what was cancelled may take a while to end
            if self._thread is None:
                self._thread = Thread(target=self._run, name="clip", daemon=True)
                self._thread.start()

    def _run(self) -> None:
        """Do one work after the other; without any the thread ends."""
        while True:
            with self._lock:
                task, self._next = self._next, None
                if task is None:
                    self._thread = None
                    return
            self._do(*task)

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
        except Exception as error:  # the page shows it
            LOG.exception("%s failed", what)
            status.error, status.state = f"{what} failed: {error}", "failed"

    def cancel(self) -> None:
        """End the work as soon as possible, or discard its solution."""
        with self._lock:
            self._status.is_cancelled = True
            self._status, self._next = _Status(), None

    def keep(self) -> int:
        """Keep the solution; a ValueError if there is none."""
        with self._lock:
            count = self._editor.keep(self.proposal)
            self._status = _Status()
        return count

    def undo_keep(self) -> None:
        """Undo the last `keep`; its solution may be kept again. A ValueError if there is none."""
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
        """Report state and progress of the work to the page."""
        status = self._status
        changes = None
        if status.state == "ready" and status.proposal is not None:
            numbers, ids, rows = list(status.proposal.calibrations), self._editor.ids, self._editor.table.rows
            before_and_after = [rows[n] for n in numbers], status.proposal.calibrations.values()
            moves = [status.proposal.moves[n] for n in numbers]
            changes = {
                "frames": numbers,
                "pixels": [None if math.isnan(move) else round(move, 2) for move in moves],
                "good": [sum(one.verdict == Verdict.GOOD for one in some) for some in before_and_after],
                "contradicted": {ids[n]: what for n, what in status.proposal.contradicted.items()},
            }
        return {
            **{name: getattr(status, name) for name in ("state", "done", "total", "stage", "error")},
            "changes": changes,
            "can_undo_keep": self._editor.can_undo_keep,
            "to_draw": [] if status.state == "running" else self._editor.to_draw,
        }

    def proposed(self, number: int) -> dict[str, Any]:
        """Camera of a frame in the solution, for the page; a ValueError if there is none."""
        calibration = self.proposal.calibrations.get(number)
        if calibration is None:
            raise ValueError("this frame is not in the solution")
        return calibration_record(calibration, self._editor.field)

    def end(self) -> list[Thread]:
        """End the work as soon as possible; returns the thread, if it is still at work."""
        self.cancel()
        thread = self._thread
        return [] if thread is None else [thread]


@dataclass(frozen=True, eq=False)
class _Wanted:
    """A frame whose state somebody waits for."""

    number: int
    done: Future[dict[str, Any]]
    is_whole: bool = True
    """Whether the verdict is wanted too."""
    is_looked_at: bool = True


class Worker:
    """Fits the cameras of an editor's frames, one after the other."""

    def __init__(self, editor: Editor) -> None:
        self._editor = editor
        self._searches = Searches(editor)
        self._wanted: dict[tuple[int, bool], _Wanted] = {}  # by frame and whether whole; the last requested at the end
        self._drawn: dict[int, None] = {}  # frames that were drawn and have no verdict yet
        self._last: tuple[tuple[int, int, int], dict[str, Any]] | None = None  # a state, by frame, revision and version
        self._rest: Iterator[int] = iter(range(0 if editor.is_clip else len(editor)))
        self._changed = Condition()
        self._is_closed = False
        self._thread = Thread(target=self._run, name="fits", daemon=True)
        self._thread.start()

    def state(self, number: int) -> Future[dict[str, Any]]:
        """Future of the state of a frame, whose camera follows from all edits made before its fit begins."""
        return self._want(number, is_whole=True)

    def drawn(self, number: int) -> Future[dict[str, Any]]:
        """Future of what is drawn over a frame: as `state`, without waiting for the verdict."""
        return self._want(number, is_whole=False)

    def _want(self, number: int, *, is_whole: bool) -> Future[dict[str, Any]]:
        with self._changed:
            wanted = self._wanted.pop((number, is_whole), None) or _Wanted(number, Future(), is_whole)
            self._wanted[number, is_whole] = wanted
            self._changed.notify()
            return wanted.done

    def end(self) -> list[Thread]:
        """Let the threads end after their present work; the rest is dropped. Returns the threads still at work."""
        with self._changed:
            self._is_closed = True
            for wanted in self._wanted.values():
                wanted.done.cancel()
            self._changed.notify()
        return [self._thread, *self._searches.end()]

    def _run(self) -> None:
        while (wanted := self._next()) is not None:
            try:
                state = self._state_of(wanted)
            except Exception as error:  # raised again for those who wait for the state
                if not wanted.done.cancelled():
                    wanted.done.set_exception(error)
            else:
                if not wanted.done.cancelled():
                    wanted.done.set_result(state)
                self._searches.want(wanted.number, first=wanted.is_looked_at)

    def _next(self) -> _Wanted | None:
        """The frame to fit next; None at the end."""
        with self._changed:
            while True:
                if self._is_closed:
                    return None
                if self._wanted:
                    return self._wanted.popitem()[1]
                if self._drawn:
                    if not self._changed.wait(PAUSE) and not self._wanted:
                        return _Wanted(self._drawn.popitem()[0], Future())
                    continue
                number = next(self._rest, None)
                if number is not None:
                    return _Wanted(number, Future(), is_looked_at=False)
                self._changed.wait()

    def _state_of(self, wanted: _Wanted) -> dict[str, Any]:
        start, editor, number = time.perf_counter(), self._editor, wanted.number
        try:
            one = editor.with_camera(number)
        except BrokenFileError as error:
            return broken_state(editor, number, str(error))
        if not wanted.is_whole and one.calibration.camera is not None:
            self._drawn[number] = None
            return drawn_state(editor, number, one, 1e3 * (time.perf_counter() - start))
        return self._whole_state(number, start)

    def _whole_state(self, number: int, start: float) -> dict[str, Any]:
        """State with its verdict; the last one is cached, as pages ask again when they are told of their own change."""
        editor, revision = self._editor, self._editor.revision(number)
        if self._last is not None and self._last[0] == (number, revision, editor.version):
            return self._last[1]
        one = editor.fitted(number)
        version = editor.version
        self._drawn.pop(number, None)
        state = frame_state(editor, number, one, 1e3 * (time.perf_counter() - start))
        if state["revision"] == revision and state["by_hand"]:  # other states change when a search ends
            self._last = (number, revision, version), state
        return state


class Searches:
    """Searches frames of an editor for the court in a thread, opened frames first."""

    def __init__(self, editor: Editor) -> None:
        self._editor = editor
        self._wanted: dict[int, None] = {}  # frames to search, the next one at the end
        self._changed = Condition()
        self._is_closed = False
        self._thread: Thread | None = None

    def want(self, number: int, *, first: bool) -> None:
        """Schedule a frame, if it still has to be searched: `first`, or after all others."""
        if not self._editor.is_to_search(number):
            return
        with self._changed:
            known = self._wanted.pop(number, 0) is None
            others = self._wanted
            self._wanted = {**others, number: None} if first or known else {number: None, **others}
            if self._thread is None:
                self._thread = Thread(target=self._run, name="searches", daemon=True)
                self._thread.start()
            self._changed.notify()

    def end(self) -> list[Thread]:
        """Let the thread end after its present search; returns it, if there is one."""
        with self._changed:
            self._is_closed = True
            self._changed.notify()
        return [] if self._thread is None else [self._thread]

    def _run(self) -> None:
        while (number := self._next()) is not None:
            try:
                self._editor.search(number)
            except BrokenFileError:  # reported when the frame is opened
                pass
            except Exception:  # the page goes on without this camera
                LOG.exception("searching frame %s failed", self._editor.ids[number])

    def _next(self) -> int | None:
        """The frame to search next; None at the end."""
        with self._changed:
            while not self._is_closed:
                if self._wanted:
                    return self._wanted.popitem()[0]
                self._changed.wait()
            return None
