"""The shape of the pictures of a live video, as they come: black borders, and whether they were squashed.

Borders begin with those of the first picture that shows something. What is shown in them by a later one ends them at
once, larger ones begin where the last pictures that were looked at all have them. Whether pictures were squashed is
asked when some have been seen; until that is known every camera is to be checked.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future

import numpy as np

from fieldcalib.assess.placement import Placement, Shape
from fieldcalib.assess.whole_picture import SHAPE
from fieldcalib.images.borders import shown_part
from fieldcalib.images.clip_shape import APART, DARK, SEEN, LookedAt, placement_within, shape_of_odds, shape_within
from fieldcalib.io.image import Image
from fieldcalib.solve.aspect import may_be_squashed

ASKED = SEEN // 2, SEEN  # pictures after which it is asked whether they were squashed
SAME = 2  # px: borders that differ by no more are the same, up to compression


class LiveShape:
    """Looks at some of the pictures of a video as they come.

    Parameters
    ----------
    asked : LookedAt
        What is asked of the pictures.
    submit : callable
        Begins to ask whether some pictures were squashed, and says when it is known.
    """

    def __init__(
        self,
        asked: LookedAt,
        submit: Callable[[Callable[[Sequence[Image]], float], list[Image]], Future[float]],
    ) -> None:
        self._asked, self._submit = asked, submit
        self._size = (0, 0)
        self._next = 0  # picture that is looked at,
        self._index = 0  # and the one that comes
        self._corners: deque[tuple[int, int]] = deque(maxlen=SEEN)
        self._corner = (0, 0)
        self._parts: list[Image] = []
        self._running: Future[float] | None = None
        self._log_odds: float | None = None
        self.shape: Shape | None = None
        """Of the pictures; None if they are as they seem."""

    def update(self, image: Image) -> bool:
        """Take the next picture; whether frames now lie elsewhere in the pictures than before."""
        if not (self._asked.take_off_borders or self._asked.estimate_aspect):
            return False
        index, self._index = self._index, self._index + 1
        self._size = image.shape[1], image.shape[0]
        if index >= self._next and np.mean(image[::APART, ::APART]) > DARK:
            self._next = index + APART
            self._look(image)
        if self._running is not None and self._running.done():
            self._log_odds, self._running = self._running.result(), None
        before, self.shape = self.shape, self._seen()
        return _placement(before, self._size) != _placement(self.shape, self._size)

    def image_in_frame(self, image: Image) -> Image:
        """The frame that a picture shows."""
        return image if self.shape is None else self.shape.placement.image_in_frame(image)

    def _look(self, image: Image) -> None:
        if self._asked.take_off_borders:
            self._corners.append(shown_part(image).corner)
            least = np.min(list(self._corners), axis=0)
            grown = np.max(least - self._corner) > SAME and len(self._corners) in (1, SEEN)
            if grown or np.max(self._corner - least) > SAME:
                self._corner = (int(least[0]), int(least[1]))
                self._parts, self._running, self._log_odds = [], None, None
        if not self._asked.estimate_aspect or len(self._parts) >= SEEN:
            return
        part = self._placement.image_in_frame(image)
        if may_be_squashed((part.shape[1], part.shape[0])):
            self._parts.append(part.copy())  # the caller may use its image again
            if len(self._parts) in ASKED and self._running is None and not self._is_sure():
                self._running = self._submit(self._asked.log_odds, list(self._parts))

    @property
    def _placement(self) -> Placement:
        """Of frames between the borders."""
        return placement_within(self._size, self._corner) or Placement(self._size, self._size, None)

    def _is_sure(self) -> bool:
        if self._log_odds is None:
            return False
        shape = shape_of_odds(self._log_odds, self._placement, self._placement.frame_size)
        return shape is None or not shape.complaints

    def _seen(self) -> Shape | None:
        placement = self._placement
        if self._log_odds is not None:
            return shape_of_odds(self._log_odds, placement, placement.frame_size)
        doubt = (SHAPE,) if self._parts else ()
        if placement.is_whole:
            return Shape(placement, "", doubt) if doubt else None
        return Shape(placement, shape_within(placement).message, doubt)


def _placement(shape: Shape | None, size: tuple[int, int]) -> Placement:
    return Placement(size, size, None) if shape is None else shape.placement
