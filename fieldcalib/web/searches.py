"""The thread that searches pictures for courts where no network knows the field: the page never waits for it."""

from __future__ import annotations

import logging
from threading import Condition, Thread

from fieldcalib.editor.editor import Editor
from fieldcalib.io.files import BrokenFileError

LOG = logging.getLogger("fieldcalib")


class Searches:
    """Searches frames of an editor, those first that somebody looks at."""

    def __init__(self, editor: Editor) -> None:
        self._editor = editor
        self._wanted: dict[int, None] = {}  # the next one at the end
        self._changed = Condition()
        self._is_closed = False
        self._thread: Thread | None = None

    def want(self, number: int, *, first: bool) -> None:
        """Search a frame, if it is to be searched: before all others, or after them."""
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
        """Let the thread end after the search that it is at; returns it, if there is one."""
        with self._changed:
            self._is_closed = True
            self._changed.notify()
        return [] if self._thread is None else [self._thread]

    def _run(self) -> None:
        while (number := self._next()) is not None:
            try:
                self._editor.search(number)
            except BrokenFileError:  # it is said where the frame is looked at
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
