"""Frames by their numbers, each read on demand: pictures in files, the frames of a video, or arrays."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import OrderedDict
from collections.abc import Iterator, Sequence
from pathlib import Path
from threading import Lock

from fieldcalib._checks import is_number
from fieldcalib.io.files import BrokenFileError, FrameFile
from fieldcalib.io.formats import IMAGES
from fieldcalib.io.image import Image, checked_image, size_of
from fieldcalib.io.videos import FramesByNumber
from fieldcalib.run_folder.images import MOST_BYTES

CACHE_BYTES = 64_000_000  # of the images in memory: 10 of 1920 x 1080


class NumberedFrames(ABC):
    """Frames by their numbers, from 0. Reading is safe from several threads; the images last read are kept."""

    ids: Sequence[str]
    """Name of each frame."""
    rate: float | None = None
    """Frames per second of a video; None for pictures."""

    def __init__(self, ids: Sequence[str]) -> None:
        self.ids = ids
        self._kept: OrderedDict[int, Image] = OrderedDict()
        self._sizes: dict[int, tuple[int, int]] = {}
        self._lock = Lock()

    def __len__(self) -> int:
        return len(self.ids)

    def number(self, number: int) -> int:
        """The number of a frame, checked.

        Raises
        ------
        IndexError
            If there is no such frame.
        """
        if not is_number(number) or not 0 <= number < len(self) or number != int(number):
            raise IndexError(f"expected a frame from 0 to {len(self) - 1}, got {number!r}")
        return int(number)

    def image(self, number: int) -> Image:
        """The image of a frame; do not write to it.

        Raises
        ------
        BrokenFileError
            If it cannot be read.
        IndexError
            If there is no such frame.
        """
        number = self.number(number)
        with self._lock:
            if number in self._kept:
                self._kept.move_to_end(number)
                return self._kept[number]
            image = self._read(number)
            self._kept[number] = image
            while len(self._kept) > 1 and sum(one.nbytes for one in self._kept.values()) > CACHE_BYTES:
                self._kept.popitem(last=False)
            return image

    @abstractmethod
    def _read(self, number: int) -> Image:
        """Read the image of a frame."""

    def size(self, number: int) -> tuple[int, int]:
        """Width and height of a frame, pixels; errors as those of `image`."""
        if number not in self._sizes:
            self._sizes[number] = size_of(self.image(number))
        return self._sizes[number]

    def each(self, begin: int, end: int) -> Iterator[Image]:
        """The images of frames from `begin` to `end`, one after the other, without keeping them."""
        for number in range(begin, end):
            with self._lock:
                image = self._kept.get(number)
                image = self._read(number) if image is None else image
            yield image

    def name(self, number: int) -> str:
        """The name of a frame in annotations of other tools."""
        return self.ids[number]

    def close(self) -> None:  # noqa: B027 - pictures and arrays have nothing to close
        """End reading."""


class NumberedArrays(NumberedFrames):
    """Images in memory, checked when they are read; their ids are their numbers with six digits."""

    def __init__(self, images: Sequence[Image]) -> None:
        super().__init__([f"{number:06d}" for number in range(len(images))])
        self._images = images

    def _read(self, number: int) -> Image:
        return checked_image(self._images[number])


class NumberedFiles(NumberedFrames):
    """Pictures in files, or in zips."""

    def __init__(self, files: Sequence[FrameFile]) -> None:
        super().__init__([file.id for file in files])
        self._files = files

    def _read(self, number: int) -> Image:
        file = self._files[number]
        try:
            return IMAGES.read(file.read(MOST_BYTES))
        except (BrokenFileError, MemoryError) as error:
            raise BrokenFileError(f"{file.path.name}: {error or 'there is not enough memory for it'}") from None

    def name(self, number: int) -> str:
        """The name of the picture's file."""
        return self._files[number].path.name


class NumberedVideo(NumberedFrames):
    """Frames of a video, whose ids are their numbers with six digits.

    Parameters
    ----------
    path : Path
    numbers : sequence of int, optional
        Numbers of the frames in the video; all by default.

    Raises
    ------
    FileNotFoundError, BrokenFileError
        As `fieldcalib.io.videos.FramesByNumber`.
    """

    def __init__(self, path: Path, numbers: Sequence[int] | None = None) -> None:
        self._video = FramesByNumber(path)
        self._numbers: Sequence[int] = range(self._video.count) if numbers is None else numbers
        super().__init__([f"{number:06d}" for number in self._numbers])
        self.rate = self._video.frames_per_second
        self._path = path
        if self._numbers and self._numbers[0] == self._video.first_number:
            self._kept[0] = self._video.first

    def _read(self, number: int) -> Image:
        return self._decoded(self._numbers[number])

    def frame(self, wanted: int) -> Image:
        """Read a frame by its number in the video, whether it is one of `numbers` or not; it is not kept.

        Raises
        ------
        BrokenFileError
            If it cannot be read.
        """
        with self._lock:
            return self._decoded(wanted)

    def _decoded(self, wanted: int) -> Image:
        image = self._video.read(wanted)
        if image is None:
            raise BrokenFileError(f"{self._path.name}: frame {wanted} cannot be read: the file is cut off or damaged")
        return image

    def size(self, number: int) -> tuple[int, int]:
        """Width and height of all frames."""
        return size_of(self._video.first)

    def close(self) -> None:
        """End reading."""
        with self._lock, self._video:
            self._kept.clear()
