"""Calibration of frames, for results in memory (`fieldcalib.calibrate`) and in a folder (`fieldcalib run`).

    frames of files      `frames_of_files` opens them
    frames one by one    `calibrate_images`
    frames of a clip     `fieldcalib.images.clip.from_video.calibrate_clip`, all together
    frames of a stream   `live_tracker`, each when it comes

Each image lies in a whole frame with square pixels (`Placement`). The frames are calibrated, and their cameras are
converted to pixels of the images.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TypeAlias, TypeVar

import numpy as np

from fieldcalib._progress import say
from fieldcalib.assess.result import Calibration, in_picture
from fieldcalib.images.clip.tracker import Tracker, tracker_of
from fieldcalib.images.from_images import How, calibrate_pictures
from fieldcalib.io.clips import whole_frame
from fieldcalib.io.files import FrameFile
from fieldcalib.io.formats import IMAGES, VIDEOS
from fieldcalib.io.frame_range import WHOLE, Cut
from fieldcalib.io.frame_source import (
    READ,
    FileFrames,
    Frame,
    FrameSource,
    ReadImage,
    VideoFrames,
    checked_frames,
    in_cut,
    in_order,
)
from fieldcalib.io.image_files import Image, Newest
from fieldcalib.io.streams import Stream, StreamReader
from fieldcalib.problem.picture_shape import Placement
from fieldcalib.run_folder.labelled_frames import name_skipped
from fieldcalib.run_folder.record import Outcome

PlaceOf: TypeAlias = Callable[[Image], Placement]
"""Finds the placement of an image in its frame."""
T = TypeVar("T")


def calibrate_images(how: How, images: Sequence[Image], placement: PlaceOf = whole_frame) -> list[Calibration]:
    """Calibrate images one by one, those that stored cameras do not recognise."""
    known = [None if how.stored is None else how.stored.recognised(how.task, image) for image in images]
    left = [(image, placement(image)) for image, one in zip(images, known, strict=True) if one is None]
    found = calibrate_pictures(how, [placed.image_in_frame(image) for image, placed in left])
    others = iter([in_picture(one, placed) for one, (_, placed) in zip(found, left, strict=True)])
    return [next(others) if one is None else one for one in known]


class StreamFrames:
    """The frames of a stream as they come; those of a live one that come faster than they are worked on are dropped."""

    def __init__(self, stream: Stream, reader: StreamReader, placement: PlaceOf = whole_frame) -> None:
        self._stream, self._late = stream, list[float]()
        self._frames = checked_frames(stream, reader, placement)
        self._newest = Newest(self._frames)

    def __iter__(self) -> Iterator[Frame]:
        if not self._stream.is_live:
            yield from self._frames
            return
        for frame, arrived in self._newest:
            yield frame
            self._late.append(time.monotonic() - arrived)

    def lateness(self) -> str:
        """Message on how late the results of a live stream came, and how many frames were dropped; empty of others."""
        if not self._late:
            return ""
        count, dropped = len(self._late), self._newest.dropped
        late = f"results came {np.median(self._late):.2f} s after their frames, at most {max(self._late):.2f} s"
        lost = f"; {dropped} of {count + dropped} frames came faster, and were dropped" if dropped else ""
        return f"{self._stream}: {late}{lost}"


@contextmanager
def live_tracker(
    how: How, stream: Stream, reader: StreamReader, placement: PlaceOf = whole_frame
) -> Generator[tuple[StreamFrames, Tracker]]:
    """Open a stream: its frames as they come, and the tracker that calibrates them (`tracked`)."""
    with tracker_of(how, wait=not stream.is_live) as tracker:
        yield StreamFrames(stream, reader, placement), tracker


def tracked(tracker: Tracker, frame: Frame, placement: PlaceOf = whole_frame) -> Calibration:
    """Calibrate the next frame of a stream."""
    assert frame.image is not None
    placed = placement(frame.image)
    return in_picture(tracker.update(placed.image_in_frame(frame.image)), placed)


def frames_of_files(
    paths: Sequence[Path],
    cut: Cut = WHOLE,
    read: ReadImage = READ,
    threads: int | None = None,
    *,
    is_clip: bool = False,
) -> FrameSource:
    """Open a video, or files of images; images of a clip are in the order of the numbers in their names.

    Files in folders and zips that are not images are named on stderr.

    Raises
    ------
    FileNotFoundError, BrokenFileError, ValueError
        As `find_files`, `in_cut` and `VideoReader`, and as the check of `read` for the frames of a video.
    """
    if VIDEOS.recognises(paths[0]):
        return VideoFrames(paths[0], cut, read, threads).looked_at()
    files = image_files(paths)
    return FileFrames(in_cut(in_order(files) if is_clip else files, cut, say), read, is_clip=is_clip)


def image_files(inputs: Sequence[Path]) -> list[FrameFile]:
    """Find images in folders and zips, and single files; unused files are named on stderr."""
    files = IMAGES.find(inputs)
    name_skipped(inputs, files)
    return files


def outcomes_of(
    frames: Iterable[Frame], results: Iterable[T], outcome: Callable[[Frame, Image, T], Outcome]
) -> list[Outcome]:
    """Make the outcomes of frames, from the results for the frames that could be read."""
    rest = iter(results)
    return [
        Outcome.broken(frame, frame.problem) if frame.image is None else outcome(frame, frame.image, next(rest))
        for frame in frames
    ]
