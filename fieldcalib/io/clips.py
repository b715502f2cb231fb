"""The frames of a clip, which are read several times: of a video, of the images of a folder or a zip, or of arrays.

A clip is all frames of a source, or a part of them; each of its images lies in a whole frame (`Placement`).
"""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from itertools import count, islice
from typing import Any, NamedTuple

import numpy as np

from fieldcalib._progress import Progress, progress_bar
from fieldcalib._types import file_path
from fieldcalib.io.files import BrokenFileError
from fieldcalib.io.formats import IMAGES
from fieldcalib.io.frame_source import ArrayFrames, FileFrames, Frame, FrameSource, ReadImage, VideoFrames, in_order
from fieldcalib.io.image_files import Image, size_of
from fieldcalib.problem.picture_shape import Crop, Placement

PASSES = ("looking", "matching", "finding lines")  # names of the passes over the frames of a clip, in this order
AGAIN, DRAWING = "finding lines again", "drawing"  # names of further passes
SOLVING = "solving the clip"  # name of the work between passes
REPLACED = "the frames are not those that were read before: was the input replaced in the meantime? Run it again"
HELD_BYTES = 540_000_000  # of the frames of a clip in memory: the 85 at which its shape is looked at, of 1920 x 1080


class Reading(NamedTuple):
    """What the frames of a clip, or of a part of it, turned out to be when they were read."""

    ids: Sequence[str]
    """Names of the frames in order, those included that cannot be read; empty if they have none."""
    broken: Mapping[str, str]
    """Problems of frames that cannot be read, by id."""
    loss: str
    """Message about frames that were announced but are not there."""

    @classmethod
    def joined(cls, parts: Sequence[Reading]) -> Reading:
        """Join what the readings of parts have told."""
        losses = [part.loss for part in parts if part.loss]
        others = "another part" if len(losses) == 2 else f"{len(losses) - 1} other parts"
        more = f"; others are missing in {others} of it" if len(losses) > 1 else ""
        broken = {id: problem for part in parts for id, problem in part.broken.items()}
        return cls([id for part in parts for id in part.ids], broken, losses[0] + more if losses else "")


def part_of_frame(part: Crop | None, image: Image) -> Placement:
    """Placement of an image that is a part of a frame, or a whole one."""
    return placed(size_of(image), size_of(image), part)


whole_frame = partial(part_of_frame, None)
"""Placement of an image that is a whole frame."""


def placed(size: tuple[int, int], display_size: tuple[int, int], part: Crop | None) -> Placement:
    """Placement of images of a size, as shown, in their frames; a BrokenFileError if they do not fit there."""
    if part is not None and np.any(np.add(part.corner, display_size) > part.frame_size):
        width, height = display_size
        raise BrokenFileError(f"does not fit, with {width} x {height} pixels, into the frame of {part}")
    return Placement(size, display_size, part)


class ClipInput:
    """The frames of a clip, in which its images lie; they can be read several times, with progress.

    The last frames, as many as fit into `HELD_BYTES`, stay in memory, so that they are decoded once. The next reading
    goes on where one was left before its end.
    """

    def __init__(
        self, source: FrameSource, placement: Callable[[Image], Placement] = whole_frame, progress: Progress = True
    ) -> None:
        self.source, self._placement, self.progress = source, placement, progress
        self.ids: Sequence[str] = []
        """Ids of all frames, in order; known after the first pass."""
        self._passes = iter(PASSES)
        self._first: Placement | None = None
        self._most_held, self._announced = HELD_BYTES, 0
        self._held: dict[int, Frame] = {}
        self._newest, self._bytes = -1, 0  # number of the last frame that was held, and size of all that are
        self._left: tuple[Iterator[Frame], int] | None = None  # a reading that was left, and how many frames it gave

    @property
    def pixel_aspect(self) -> float:
        """Width of a pixel as shown, in heights."""
        return self.source.pixel_aspect

    @property
    def count(self) -> int:
        """Number of frames, as the input announces; they are counted if it does not."""
        return len(self.ids) or self.source.count or sum(1 for _ in self.source)

    def part(self, begin: int, end: int) -> ClipInput:
        """Some of the frames, which do not stay in memory, nor do those that were read so far."""
        self._held.clear()
        part = ClipInput(self.source.part(begin, end), self._placement, self.progress)
        part._passes, part._most_held, part._announced = iter(PASSES[1:]), 0, end - begin
        return part

    def __getstate__(self) -> dict[str, Any]:
        """Everything that another process needs, which shows no progress."""
        return {**self.__dict__, "progress": False}

    def told(self) -> Reading:
        """What the last reading has told."""
        return Reading(self.ids, self.source.broken, self.source.loss)

    def learn(self, reading: Reading) -> None:
        """Take over what was told by the readings of all parts."""
        self.ids = reading.ids
        self.source.learn(reading.broken, reading.loss)

    def frame_size(self) -> tuple[int, int]:
        """Width and height of the frames, from the first one that can be read."""
        placement = self.placement()
        return (0, 0) if placement is None else placement.frame_size

    def placement(self) -> Placement | None:
        """Placement of the images in their frames, from the first one that can be read; None if there is none."""
        if self._first is None:
            first = next((frame.image for frame in self._read() if frame.image is not None), None)
            self._first = None if first is None else self._placement(first)
        return self._first

    def _read(self) -> Iterator[Frame]:
        """Yield the images as they are, those in memory without reading them again."""
        (reading, given), self._left = self._left or (iter(self.source), 0), None
        try:
            for number in count():
                frame = self._held.get(number)
                if frame is None:
                    if self.ids and number == len(self.ids) and given != number:
                        return  # the last ones were in memory
                    if given > number:
                        reading, given = iter(self.source), 0
                    frame, given = next(islice(reading, number - given, None), None), number + 1
                    if frame is None:
                        return
                    self._hold(number, frame)
                yield frame
        finally:
            self._left = reading, given

    def _hold(self, number: int, frame: Frame) -> None:
        """Keep a frame in memory, unless one after it was read already; the first ones make room for it."""
        if number <= self._newest:
            return
        self._held[number], self._newest = frame, number
        self._bytes += frame.bytes
        while self._bytes > self._most_held:
            self._bytes -= self._held.pop(next(iter(self._held))).bytes

    def __iter__(self) -> Iterator[Image]:
        """Yield the frames, for the images that can be read."""
        self.placement()  # it is known from then on
        for frame in self.frames(next(self._passes, AGAIN)):
            if frame.image is not None:
                yield self._placement(frame.image).image_in_frame(frame.image)

    def frames(self, stage: str = DRAWING) -> Iterator[Frame]:
        """Yield the images as they are, with progress under the name `stage`."""
        ids: list[str] = []
        total = len(self.ids) or self._announced or self.source.count or None
        with progress_bar(desc=stage, total=total, unit="frame", progress=self.progress) as progress:
            for frame in self._read():
                if self.ids and self.ids[len(ids) : len(ids) + 1] != [frame.id]:
                    raise BrokenFileError(REPLACED)
                ids.append(frame.id)
                yield frame
                progress.update()
        if self.ids and len(ids) < len(self.ids):
            raise BrokenFileError(REPLACED)
        self.ids = ids


def clip_input(source: object) -> ClipInput:
    """Recognise a clip: a video, a folder or zip of images of one size, or the images themselves.

    Raises
    ------
    ValueError
        If it is none of these; an iterator can be read once only.
    FileNotFoundError, BrokenFileError
        As `find_files` of a folder or a zip, and as `VideoReader`.
    """
    if isinstance(source, ClipInput):
        return source
    return ClipInput(_source(source), progress=False)


def _source(source: object) -> FrameSource:
    if isinstance(source, str | os.PathLike):
        path = file_path(source, "a video or of a folder of images")
        if path.is_dir() or path.suffix.lower() == ".zip":
            return FileFrames(in_order(IMAGES.find([path])), ReadImage(math.inf, skips_broken=False))
        return VideoFrames(path, tell=warnings.warn).looked_at()
    if isinstance(source, np.ndarray) and source.ndim < 4:
        raise ValueError(f"expected the images of a clip, got one array of shape {source.shape}: give [image]")
    if isinstance(source, Iterator):
        raise ValueError("expected a path or a sequence of images, got an iterator: the frames are read twice")
    if not isinstance(source, Iterable):
        raise ValueError(
            f"expected the path of a video or of a folder of images, or a sequence of images, got {source!r}"
        )
    return ArrayFrames(source)
