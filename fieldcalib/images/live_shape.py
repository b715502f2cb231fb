"""The shape of the pictures of a live video, as they come: black borders, and whether they were squashed.

Borders begin with those of the first picture that shows something. They shrink at once when a later picture shows
something in them, and grow when all of the last pictures that were looked at have larger ones. Whether pictures were
squashed is estimated when some have been seen; until that is known every camera is to be checked.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from dataclasses import replace

import numpy as np

from fieldcalib.assess.placement import Placement, Shape
from fieldcalib.assess.whole_picture import SHAPE
from fieldcalib.images.borders import shape_within, shown_part, within_borders
from fieldcalib.images.clip_shape import APART, DARK, SEEN, ShapeEstimator, shape_of_odds
from fieldcalib.io.image import Image, size_of
from fieldcalib.solve.aspect import may_be_squashed

ASKED = SEEN // 2, SEEN  # numbers of pictures from which the odds of squashed ones are estimated
SAME = 2  # px: borders that differ by no more are the same, up to compression


class LiveShape:
    """Estimates the shape of the pictures of a video as they come.

    Parameters
    ----------
    estimator : ShapeEstimator
    submit : callable
        Starts a function on some pictures, and returns the future of its result.
    """

    def __init__(
        self,
        estimator: ShapeEstimator,
        submit: Callable[[Callable[[Sequence[Image]], float], list[Image]], Future[float]],
    ) -> None:
        self._estimator, self._submit = estimator, submit
        self._size = (0, 0)
        self._next = 0  # number of the next picture that is looked at
        self._index = 0  # number of the next picture
        self._borders: deque[tuple[int, int]] = deque(maxlen=SEEN)  # of the last pictures that were looked at
        self._border = (0, 0)  # columns, rows
        self._parts: list[Image] = []  # frames from which the odds are estimated
        self._running: Future[float] | None = None
        self._log_odds: float | None = None
        self.shape: Shape | None = None
        """Shape of the pictures; None without borders if they were not squashed."""

    def update(self, image: Image) -> bool:
        """Take the next picture; return whether frames now lie elsewhere in the pictures than before."""
        if not (self._estimator.finds_borders or self._estimator.finds_squash):
            return False
        index, self._index = self._index, self._index + 1
        self._size = size_of(image)
        if index >= self._next and np.mean(image[::APART, ::APART]) > DARK:
            self._next = index + APART
            self._look(image)
        if self._running is not None and self._running.done():
            self._log_odds, self._running = self._running.result(), None
        before, self.shape = self.shape, self._estimated()
        return _placement(before, self._size) != _placement(self.shape, self._size)

    def image_in_frame(self, image: Image) -> Image:
        """The frame that a picture shows."""
        return image if self.shape is None else self.shape.placement.image_in_frame(image)

    def _look(self, image: Image) -> None:
        if self._estimator.finds_borders:
            x, y = shown_part(image).corner
            self._borders.append((-x, -y))
            least = np.min(list(self._borders), axis=0)
            grown = np.max(least - self._border) > SAME and len(self._borders) in (1, SEEN)
            if grown or np.max(self._border - least) > SAME:
                self._border = (int(least[0]), int(least[1]))
                self._parts, self._running, self._log_odds = [], None, None
        if not self._estimator.finds_squash or len(self._parts) >= SEEN:
            return
        part = self._placement.image_in_frame(image)
        if may_be_squashed(size_of(part)):
            self._parts.append(part.copy())  # the caller may use its image again
            if len(self._parts) in ASKED and self._running is None and not self._is_sure():
                self._running = self._submit(self._estimator.log_odds, list(self._parts))

    @property
    def _placement(self) -> Placement:
        """Placement of the frames between the borders."""
        return within_borders(self._size, self._border)

    def _is_sure(self) -> bool:
        if self._log_odds is None:
            return False
        shape = shape_of_odds(self._log_odds, self._placement)
        return shape is None or not shape.complaints

    def _estimated(self) -> Shape | None:
        """The shape as far as it is known; while pictures may be squashed every camera is doubted."""
        if self._log_odds is not None:
            return shape_of_odds(self._log_odds, self._placement)
        shape = replace(shape_within(self._placement), complaints=(SHAPE,) if self._parts else ())
        return shape if shape.complaints or not shape.placement.is_whole else None


def _placement(shape: Shape | None, size: tuple[int, int]) -> Placement:
    return Placement(size, size, None) if shape is None else shape.placement
