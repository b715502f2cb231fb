"""Frames of a video tied to keyframes by matches of the static background, in one pass.

Every frame is matched with a keyframe directly, so that errors do not add up from frame to frame; keyframes are matched
with earlier keyframes. Frames that nothing ties to the keyframes before them begin a new piece: behind a cut, or a pan
too fast to follow. Two pieces may show the same scene; what they show joins them.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from fieldcalib._types import Array, Float32
from fieldcalib.images.background_motion import mapped
from fieldcalib.images.matches import Frame, Matches, match_background, match_far, same_picture
from fieldcalib.io.image import Image

EVERY = 12  # frames from one keyframe to the next at most: half a second
BACK = (1, 2, 4)  # keyframes back, with which a keyframe is matched
CORNERS = 150  # of a keyframe that are followed to an ordinary frame
LEAST_IN_VIEW = 0.6  # of a keyframe's picture; with less in view the next one is made
FEW_MATCHES = 40  # with fewer than these the next one is made
CONFIRMED = 8  # frames that are tied to one another, and not to those before, are a new piece
LOST_FOR = 30  # frames, a second: for so long the keyframes before are looked for
LIKENESS_WIDTH = 160  # px: of the picture whose likeness is measured
LOCAL_MEAN = 41  # px of that
LIKENESS_BLOCK = 5  # px of that
LIKENESS_NOISE = 2.0  # grey levels
LEAST_LIKENESS = 0.45
LEAST_LIKENESS_OF_KEY = 0.62


@dataclass(frozen=True, eq=False)
class Tied:
    """A frame of a video and the keyframe that it is tied to."""

    index: int
    """Number of the frame, from 0."""
    piece: int
    """Number of the run of frames that matches connect, from 0 and ascending."""
    key: int
    """Index of its keyframe: its own if it is one; of the last one of the piece if nothing ties the frame."""
    ties: tuple[tuple[int, Matches], ...]
    """Index of a keyframe, and matches from that to this frame.

    Of an ordinary frame to `key`, or none if nothing ties it. Of a keyframe to the keyframes `BACK` before it in its
    piece, as far as they match: none if it is the first.
    """
    duplicate: bool
    """Whether the picture is that of the frame before: the stream repeats a frame, or is frozen."""

    @property
    def is_key(self) -> bool:
        return self.index == self.key


@dataclass(frozen=True, eq=False)
class _View:
    index: int
    frame: Frame
    duplicate: bool

    @cached_property
    def detail(self) -> Float32:
        """The picture in small, less its local mean."""
        import cv2

        grey = self.frame.grey
        width = min(LIKENESS_WIDTH, grey.shape[1])
        size = (width, max(round(grey.shape[0] * width / grey.shape[1]), 1))
        small: Any = cv2.resize(grey, size, interpolation=cv2.INTER_AREA).astype(np.float32)
        return np.asarray(small - cv2.blur(small, (LOCAL_MEAN, LOCAL_MEAN)), np.float32)


def _likeness(first: _View, second: _View, H: Array) -> float:
    """How much of the contrast of either picture is in the other, the first moved by H (full size).

    Per block, the covariance over the larger variance; of the half of the blocks with more contrast, the median. In a
    dissolve with weights 1 - a and a it is 1 - a and a with the two shots, whatever they show: at most one is above
    0.5. Players and boards change some blocks only.
    """
    import cv2

    a: Any = first.detail
    b: Any = second.detail
    height, width = b.shape
    s = np.divide(first.frame.image_size, (width, height))
    T = np.array([[s[0], 0.0, 0.5 * (s[0] - 1.0)], [0.0, s[1], 0.5 * (s[1] - 1.0)], [0.0, 0.0, 1.0]])
    small = np.linalg.inv(T) @ H @ T
    inside = cv2.warpPerspective(np.ones_like(a), small, (width, height), flags=cv2.INTER_NEAREST)
    a = cv2.warpPerspective(a, small, (width, height), flags=cv2.INTER_LINEAR) 
    b = b * inside
    blocks = (max(width // LIKENESS_BLOCK, 1), max(height // LIKENESS_BLOCK, 1))
    seen, aa, bb, ab = (cv2.resize(z, blocks, interpolation=cv2.INTER_AREA).ravel() for z in (inside, a * a, b * b, a * b))
    whole = seen > 0.7
    if not np.any(whole):
        return 0.0
    contrast = np.maximum(aa, bb)[whole] / seen[whole]
    likeness = ab[whole] / seen[whole] / (contrast + LIKENESS_NOISE**2)
    return float(np.median(likeness[contrast >= np.median(contrast)]))


STATS = []


class _Piece:
    """Frames that matches connect: its last keyframes, and how the camera moved last."""

    def __init__(self, first: _View, number: int, every: int) -> None:
        self.number, self.every = number, every
        self.keys: deque[tuple[_View, Array]] = deque([(first, np.eye(3))], maxlen=max(BACK))  # and H to the newest
        self.last = first
        self.matches: Matches | None = None  # from the newest keyframe to the last frame
        self.motion = np.eye(3)  # from the last but one frame to the last

    @property
    def key(self) -> _View:
        return self.keys[-1][0]

    @property
    def H(self) -> Array:
        return np.eye(3) if self.matches is None else self.matches.homography

    def tied(self, view: _View) -> Tied | None:
        """The frame after the last one, tied to the newest keyframe; None if nothing ties it."""
        if view.duplicate and self.matches is not None:
            return self._ordinary(view, self.matches)
        matches = self._checked(self.key, view, self.motion @ self.H)
        if matches is None and self.matches is not None:
            step = match_background(self.last.frame, view.frame, corners=CORNERS)
            matches = None if step is None else self._checked(self.key, view, step.homography @ self.H)
        return None if matches is None else self._added(view, matches)

    def found_again(self, view: _View, missed: int) -> Tied | None:
        """A frame after some that were not tied."""
        for start in (np.linalg.matrix_power(self.motion, missed + 1) @ self.H, self.H):
            matches = self._checked(self.key, view, start)
            if matches is not None:
                return self._added(view, matches)
        older, to_newest = self.keys[-1 - missed % len(self.keys)]
        far = match_far(older.frame, view.frame)
        if far is None or _likeness(older, view, far.homography) < LEAST_LIKENESS_OF_KEY:
            return None
        matches = self._checked(self.key, view, far.homography @ np.linalg.inv(to_newest))
        if matches is not None:
            return self._added(view, matches)
        return self._new_key(view, far.homography @ np.linalg.inv(to_newest))

    def _checked(self, first, view, start, corners=CORNERS):
        matches = match_background(first.frame, view.frame, start=start, corners=corners)
        if matches is None: return None
        like = _likeness(first, view, matches.homography)
        STATS.append((first.index, view.index, len(matches), matches.share, matches.scale, like))
        return matches if like >= LEAST_LIKENESS else None

    def _added(self, view: _View, matches: Matches) -> Tied:
        self.motion = matches.homography @ np.linalg.inv(self.H) if self.matches is not None or True else None
        self.last = view
        if not view.duplicate and self._is_due(view, matches):
            tied = self._new_key(view, matches.homography)
            if tied is not None:
                return tied
        return self._ordinary(view, matches)

    def _ordinary(self, view: _View, matches: Matches) -> Tied:
        self.matches = matches
        return Tied(view.index, self.number, self.key.index, ((self.key.index, matches),), view.duplicate)

    def _is_due(self, view: _View, matches: Matches) -> bool:
        return (
            view.index - self.key.index >= self.every
            or len(matches) < FEW_MATCHES
            or _in_view(matches.homography, view.frame.image_size) < LEAST_IN_VIEW
        )

    def _new_key(self, view: _View, H: Array) -> Tied | None:
        ties = []
        for back in BACK:
            if back <= len(self.keys):
                older, to_newest = self.keys[-back]
                matches = self._checked(older, view, H @ to_newest, 400)
                if matches is not None and _likeness(older, view, matches.homography) >= LEAST_LIKENESS_OF_KEY:
                    ties.append((older.index, matches))
        if not ties:
            return None
        self.keys = deque([(key, H @ to_newest) for key, to_newest in self.keys], maxlen=max(BACK))
        self.keys.append((view, np.eye(3)))
        self.last, self.matches = view, None
        return Tied(view.index, self.number, view.index, tuple(ties), view.duplicate)


GRID = np.stack(np.meshgrid(np.linspace(0.05, 0.95, 10), np.linspace(0.05, 0.95, 10)), axis=-1).reshape(-1, 2)


def _in_view(H: Array, size: tuple[int, int]) -> float:
    """Share of one picture that is in view in the other: the lesser of both."""
    shares = []
    for homography in (H, np.linalg.inv(H)):
        homography = homography / homography[2, 2]
        xy = mapped(homography, GRID * size)
        with np.errstate(invalid="ignore"):
            shares.append(np.mean(np.all((xy >= 0.0) & (xy < size), axis=1)))
    return float(min(shares))


class KeyframeTracker:
    """Ties the frames of a video as they come."""

    def __init__(self, every: int = EVERY) -> None:
        self.every = every
        self.count = 0
        self.piece: _Piece | None = None
        self.candidate: _Piece | None = None
        self.waiting: list[Tied] = []  # of the candidate
        self.last: _View | None = None
        self.lost = 0

    def update(self, image: Image) -> list[Tied]:
        frame = Frame.of(image)
        if self.last is not None and frame.image_size != self.last.frame.image_size:
            (width, height), before = frame.image_size, self.last.frame.image_size
            raise ValueError(
                f"frame {self.count} has {width} x {height} pixels, those before it {before[0]} x {before[1]}"
            )
        view = _View(self.count, frame, self.last is not None and same_picture(self.last.frame, frame))
        self.count += 1
        if not view.duplicate:
            self.last = view
        if self.piece is None:
            self.piece = _Piece(view, 0, self.every)
            return [Tied(view.index, 0, view.index, (), False)]
        if self.candidate is None:
            tied = self.piece.tied(view) 
            if tied is not None:
                return [tied]
        if self.lost < LOST_FOR and not (view.duplicate and self.lost):
            tied = self.piece.found_again(view, self.lost)
            if tied is not None:
                return [*self.finish(), tied]
        self.lost += 1
        tied = None if self.candidate is None else self.candidate.tied(view)
        if tied is not None:
            self.waiting.append(tied)
            if len(self.waiting) < CONFIRMED:
                return []
            ready, self.piece = self.waiting, self.candidate
            self.candidate, self.waiting, self.lost = None, [], 0
            return ready
        given_up = self._untied(self.waiting)
        self.candidate = _Piece(view, self.piece.number + 1, self.every)
        self.waiting = [Tied(view.index, self.piece.number + 1, view.index, (), view.duplicate)]
        return given_up

    def _untied(self, waiting: list[Tied]) -> list[Tied]:
        return [replace(tied, piece=self.piece.number, key=self.piece.key.index, ties=()) for tied in waiting]

    def finish(self) -> list[Tied]:
        """The frames still held back, at the end of the video."""
        given_up = self._untied(self.waiting)
        self.candidate, self.waiting, self.lost = None, [], 0
        return given_up


def tied_frames(images: Iterable[Image], *, every: int = EVERY) -> Iterator[tuple[Image, Tied]]:
    tracker, waiting = KeyframeTracker(every), deque[Image]()
    for image in images:
        waiting.append(image)
        for tied in tracker.update(image):
            yield waiting.popleft(), tied
    for tied in tracker.finish():
        yield waiting.popleft(), tied
