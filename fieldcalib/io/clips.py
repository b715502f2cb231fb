"""The frames of a clip, which are read more than once: a video, or the images of a folder or a zip.

Images are in the order of the numbers in their names, and of one size.
"""

from __future__ import annotations

import os
import re
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence, Sized
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import NamedTuple, Protocol, cast

import numpy as np

from fieldcalib._progress import Progress
from fieldcalib._types import file_path
from fieldcalib.io.files import FrameFile, named_in_errors
from fieldcalib.io.formats import IMAGES
from fieldcalib.io.frame_range import WHOLE, Cut
from fieldcalib.io.image_files import Image, size_of
from fieldcalib.io.videos import VideoReader


class ClipFrames(Protocol):
    """The frames of a clip, all or some that follow one another, which can be read any number of times."""

    progress: Progress
    """Whether their progress is shown."""

    @property
    def count(self) -> int:
        """Number of frames, as far as it is known before they are read."""

    def opened(self) -> AbstractContextManager[Iterable[Image]]:
        """Open them, to be read once from the first one on."""

    def part(self, begin: int, end: int) -> ClipFrames:
        """The frames from `begin` up to `end`, which another process can read too."""

    def told(self) -> Reading:
        """What the last reading has told."""

    def learn(self, reading: Reading) -> None:
        """Take over what was told by the readings of all parts."""


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


def clip_frames(source: object) -> ClipFrames:
    """Recognise a clip: a video, a folder or zip of images, or the images themselves.

    Raises
    ------
    ValueError
        If it is none of these; an iterator can be read once only.
    FileNotFoundError, BrokenFileError
        As `find_files` of a folder or a zip, and as `VideoReader` when a video is opened.
    """
    if hasattr(source, "opened"):
        return cast(ClipFrames, source)
    if isinstance(source, str | os.PathLike):
        path = file_path(source, "a video or of a folder of images")
        is_folder = path.is_dir() or path.suffix.lower() == ".zip"
        return Images(ImageFiles(in_order(IMAGES.find([path])))) if is_folder else VideoFile(path)
    if isinstance(source, np.ndarray) and source.ndim < 4:
        raise ValueError(f"expected the images of a clip, got one array of shape {source.shape}: give [image]")
    if isinstance(source, Iterator):
        raise ValueError("expected a path or a sequence of images, got an iterator: the frames are read twice")
    if not isinstance(source, Iterable):
        raise ValueError(
            f"expected the path of a video or of a folder of images, or a sequence of images, got {source!r}"
        )
    return Images(source)


class VideoFile:
    """The frames of the file of a video, or those with some `numbers`."""

    progress: Progress = False

    def __init__(self, path: Path, numbers: range | None = None) -> None:
        self._path, self._numbers = path, numbers
        self._reader: VideoReader | None = None

    @cached_property
    def count(self) -> int:
        """Number of frames, as the file announces; they are counted if it does not."""
        with VideoReader(self._path) as video:
            return video.count or sum(1 for _ in video)

    def opened(self) -> AbstractContextManager[Iterable[Image]]:
        """Open the video."""
        self._reader = VideoReader(self._path, cut=WHOLE if self._numbers is None else Cut.part(self._numbers))
        return self._reader

    def part(self, begin: int, end: int) -> VideoFile:
        """Some of the frames."""
        return VideoFile(self._path, (self._numbers or range(self.count))[begin:end])

    def told(self) -> Reading:
        """What the last reading has told."""
        return Reading((), {}, "" if self._reader is None else self._reader.loss())

    def learn(self, reading: Reading) -> None:
        """Warn of frames that are not there."""
        if reading.loss:
            warnings.warn(reading.loss, stacklevel=4)


class Images:
    """Images of a clip, which can be iterated over repeatedly."""

    progress: Progress = False

    def __init__(self, images: Iterable[Image]) -> None:
        self._images = images

    @cached_property
    def count(self) -> int:
        """Number of images."""
        return len(self._images) if isinstance(self._images, Sized) else sum(1 for _ in self._images)

    def opened(self) -> AbstractContextManager[Iterable[Image]]:
        """The images."""
        return nullcontext(self._images)

    def part(self, begin: int, end: int) -> Images:
        """Some of the images; only these go to another process if they are of files, or in a list or an array."""
        if isinstance(self._images, list | tuple | np.ndarray | ImageFiles):
            return Images(self._images[begin:end])
        return Images(_Some(self._images, begin, end))

    def told(self) -> Reading:
        """Nothing is told: an image that cannot be read is an error."""
        return Reading((), {}, "")

    def learn(self, reading: Reading) -> None:
        """There is nothing to learn."""


@dataclass(frozen=True)
class _Some:
    images: Iterable[Image]
    begin: int
    end: int

    def __iter__(self) -> Iterator[Image]:
        if isinstance(self.images, Sequence):
            return (self.images[k] for k in range(self.begin, self.end))
        return islice(self.images, self.begin, self.end)


@dataclass(frozen=True)
class ImageFiles:
    """Images in files; a broken one raises a BrokenFileError that names it."""

    files: Sequence[FrameFile]

    def __len__(self) -> int:
        return len(self.files)

    def __getitem__(self, some: slice) -> ImageFiles:
        return ImageFiles(self.files[some])

    def __iter__(self) -> Iterator[Image]:
        one_size = OneSize()
        for file in self.files:
            with named_in_errors(file.path):
                image = IMAGES.read(file.read(most_bytes=np.inf))
            one_size.check(file, image)
            yield image


class OneSize:
    """Checks that images have the size of the first one."""

    def __init__(self) -> None:
        self._first: tuple[FrameFile, tuple[int, int]] | None = None

    def check(self, file: FrameFile, image: Image) -> None:
        """Raise a ValueError that names the file, unless its image has that size."""
        size = size_of(image)
        first, first_size = self._first = self._first or (file, size)
        if size != first_size:
            raise ValueError(
                f"the images of a clip must be of one size: {file.path} has {size[0]} x {size[1]} pixels, "
                f"{first.path} {first_size[0]} x {first_size[1]}"
            )


def in_order(files: Iterable[FrameFile]) -> list[FrameFile]:
    """Sort files by the numbers in their names.

    Examples
    --------
    >>> [file.id for file in in_order(FrameFile(id, Path(id)) for id in ("frame 10", "frame 9"))]
    ['frame 9', 'frame 10']
    """
    return sorted(files, key=lambda file: [(text, int(n or 0)) for text, n in re.findall(r"(\D*)(\d*)", file.id)])
