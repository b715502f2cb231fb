"""The frames of a clip, which are read several times: of a video, of files of images, or of arrays."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Protocol

from fieldcalib._messages import say
from fieldcalib._progress import Progress, progress_bar
from fieldcalib.assess.placement import Placement
from fieldcalib.io.clips import OneSize, in_order
from fieldcalib.io.files import BrokenFileError, FrameFile
from fieldcalib.io.formats import VIDEOS
from fieldcalib.io.frame_range import WHOLE, Cut
from fieldcalib.io.image import Image, checked_image, size_of
from fieldcalib.io.videos import DEFAULT_RATE
from fieldcalib.run_folder.images import Frame, ReadImage, checked_frames, ignored, image_files, in_cut

PASSES = ("looking", "matching", "finding lines")  # of the frames while a clip is calibrated, in this order
AGAIN, DRAWING = "finding lines again", "drawing"  # further ones
SOLVING = "solving the clip"  # between them
READ = ReadImage()
REPLACED = "the frames are not those that were read before: was the input replaced in the meantime? Run it again"


def whole_frame(image: Image) -> Placement:
    """The placement of an image that is a whole frame."""
    return Placement(size_of(image), size_of(image), None)


class ClipSource(Protocol):
    """Frames that can be read again and again."""

    @property
    def files(self) -> Sequence[FrameFile]:
        """Files that they are read from."""

    @property
    def frames_per_second(self) -> float:
        """Frame rate."""

    @property
    def count(self) -> int:
        """Number of frames that are announced; 0 if it is not known."""

    @property
    def broken(self) -> dict[str, str]:
        """Problems of frames that cannot be read, by id; known after the first pass."""

    @property
    def loss(self) -> str:
        """Message about frames that the input announced and does not have."""

    def __iter__(self) -> Iterator[Frame]:
        """The frames in order."""


class VideoClip:
    """The frames of a video; `tell` gets a message about announced frames that cannot be read, once."""

    def __init__(
        self,
        path: Path,
        cut: Cut = WHOLE,
        read: ReadImage = READ,
        threads: int | None = None,
        tell: Callable[[str], object] = say,
    ) -> None:
        self._path, self._cut, self._read, self._threads, self._tell = path, cut, read, threads, tell
        self.files = [FrameFile(path.stem, path)]
        self._state = self.files[0].state
        self.frames_per_second = DEFAULT_RATE
        self.count = 0
        self.broken: dict[str, str] = {}
        self.loss = self._beyond = ""
        next(iter(self))  # what is wrong with it shows before anything is written
        if self._beyond:
            tell(self._beyond)

    def __iter__(self) -> Iterator[Frame]:
        path, most = self._path, self._read.most_pixels
        if self.files[0].state != self._state:
            raise BrokenFileError(f"{path}: was replaced while it was read: run it again")
        with VIDEOS.read(path, most, cut=self._cut, threads=self._threads) as video:
            self.frames_per_second, self.count, self._beyond = video.frames_per_second, video.count, video.beyond
            yield from checked_frames(path, video, self._read.check)
            if not self.loss and (loss := video.loss()):
                self.loss = loss
                self._tell(loss)


class FilesClip:
    """Images of files, all of one size; `tell` gets what is wrong with one, once."""

    def __init__(self, files: Sequence[FrameFile], read: ReadImage = READ, tell: Callable[[str], object] = say) -> None:
        self.files, self._read, self._tell = files, read, tell
        self.frames_per_second = DEFAULT_RATE
        self.count = len(files)
        self.broken: dict[str, str] = {}
        self.loss = ""

    def __iter__(self) -> Iterator[Frame]:
        one_size = OneSize()
        for file in self.files:
            if file.id in self.broken:
                yield Frame(file.id, None, self.broken[file.id], file.path)
                continue
            frame = self._read(file)
            if frame.image is None:
                self.broken[frame.id] = frame.problem
                self._tell(f"{frame.path}: {frame.problem}")
            else:
                one_size.check(file, frame.image)
            yield frame


@dataclass(frozen=True)
class ArraysClip:
    """Images in memory, whose ids are their numbers with six digits."""

    images: Sequence[Image]
    cut: Cut = WHOLE
    files, frames_per_second, loss = (), DEFAULT_RATE, ""

    @property
    def broken(self) -> dict[str, str]:
        """No frame is broken."""
        return {}

    @property
    def count(self) -> int:
        """Number of frames."""
        return len(self._numbers)

    @cached_property
    def _numbers(self) -> Sequence[int]:
        return in_cut(range(len(self.images)), self.cut, ignored)

    def __iter__(self) -> Iterator[Frame]:
        for number in self._numbers:
            yield Frame(f"{number:06d}", checked_image(self.images[number]))


def clip_frames(paths: Sequence[Path], cut: Cut, read: ReadImage, threads: int | None = None) -> ClipSource:
    """The frames of a video, or of files of images in the order of the numbers in their names.

    Raises
    ------
    FileNotFoundError, BrokenFileError, ValueError
        As `fieldcalib.run_folder.images.opened`.
    """
    if VIDEOS.recognises(paths[0]):
        return VideoClip(paths[0], cut, read, threads)
    return FilesClip(in_cut(in_order(image_files(paths)), cut, say), read)


class ClipInput:
    """The images of a clip as parts of their frames; they can be read several times, with progress."""

    def __init__(
        self, source: ClipSource, placement: Callable[[Image], Placement] = whole_frame, progress: Progress = True
    ) -> None:
        self.source, self._placement, self._progress = source, placement, progress
        self.ids: list[str] = []
        """Ids of all frames, in order; known after the first pass."""
        self._passes = iter(PASSES)

    def frame_size(self) -> tuple[int, int]:
        """Width and height of the frames, by the first one that can be read."""
        placement = self.placement()
        return (0, 0) if placement is None else placement.frame_size

    def placement(self) -> Placement | None:
        """Where the images lie in their frames, by the first one that can be read; None if there is none."""
        first = next((frame.image for frame in self.source if frame.image is not None), None)
        return None if first is None else self._placement(first)

    def __iter__(self) -> Iterator[Image]:
        """The images that can be read, as parts of their frames."""
        for frame in self.frames(next(self._passes, AGAIN)):
            if frame.image is not None:
                yield self._placement(frame.image).image_in_frame(frame.image)

    def frames(self, stage: str = DRAWING) -> Iterator[Frame]:
        """The images as they are; `stage` is shown."""
        ids: list[str] = []
        count = len(self.ids) or self.source.count or None
        with progress_bar(desc=stage, total=count, unit="frame", progress=self._progress) as progress:
            for frame in self.source:
                if self.ids and self.ids[len(ids) : len(ids) + 1] != [frame.id]:
                    raise BrokenFileError(REPLACED)
                ids.append(frame.id)
                yield frame
                progress.update()
        if self.ids and len(ids) < len(self.ids):
            raise BrokenFileError(REPLACED)
        self.ids = ids
