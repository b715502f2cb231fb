"""Sources of frames: a video, files of images, or arrays; read in order any number of times, or one by its number.

A live stream is no such source, as its frames come only once (`fieldcalib.io.streams`). The module also decides whether
an input is a video, a stream or images, and whether its frames are calibrated together (`is_clip`).
"""

from __future__ import annotations

import re
import sys
from abc import ABC, abstractmethod
from collections import OrderedDict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Sized
from dataclasses import dataclass
from functools import cached_property
from itertools import chain, islice
from pathlib import Path
from threading import Lock
from typing import Any, TypeVar

import numpy as np

from fieldcalib._progress import say, waiting_for
from fieldcalib._types import is_number
from fieldcalib.io.decoders import DEFAULT_RATE
from fieldcalib.io.files import BrokenFileError, FrameFile, error_message, named_in_errors
from fieldcalib.io.formats import IMAGES, VIDEOS
from fieldcalib.io.frame_range import WHOLE, Cut, ends_before
from fieldcalib.io.image_files import MOST_PIXELS, Image, checked_image, size_of
from fieldcalib.io.streams import Input, Stream
from fieldcalib.io.videos import FrameReader, VideoReader

MOST_BYTES = 256_000_000  # largest file of an image
CACHE_BYTES = 64_000_000  # of the images in memory: 10 of 1920 x 1080

EVERY = range(sys.maxsize)  # numbers of frames

T = TypeVar("T")


@dataclass(frozen=True)
class Frame:
    """An image, or the reason why it cannot be read."""

    id: str
    image: Image | None
    problem: str = ""
    path: Path | str = ""
    """File of the image, for messages."""
    is_of_video: bool = False
    line: Mapping[str, Any] | None = None
    """The image's results from an earlier part of the run, if any."""
    seconds: float | None = None
    """Time stamp of a frame of a video, if it is known."""

    @property
    def bytes(self) -> int:
        """Number of bytes of the image in memory."""
        return 0 if self.image is None else self.image.nbytes


def ignored(*told: object) -> None:
    """Do nothing: what is told is of no interest, and any image is accepted."""


def read_each(files: Iterable[FrameFile], read: Callable[[FrameFile], T]) -> tuple[dict[str, T], dict[str, str]]:
    """Read the files of frames; returns the contents, and the problems of broken files, by frame id."""
    found: dict[str, T] = {}
    broken: dict[str, str] = {}
    for file in files:
        try:
            with waiting_for(file.path):
                found[file.id] = read(file)
        except (ValueError, MemoryError) as error:
            broken[file.id] = error_message(error)
    return found, broken


@dataclass(frozen=True)
class ReadImage:
    """Reads images from files; `check` may raise a BrokenFileError for an image. Frames of a video pass through."""

    most_bytes: float = MOST_BYTES
    most_pixels: float = MOST_PIXELS
    check: Callable[[Image], object] = ignored
    skips_broken: bool = True
    """Whether a file that cannot be read becomes a frame without image; otherwise it is an error that names it."""

    def __call__(self, item: FrameFile | Frame) -> Frame:
        """Read the image of a file."""
        if isinstance(item, Frame):
            return item
        if not self.skips_broken:
            with named_in_errors(item.path):
                return Frame(item.id, self.image(item), path=item.path)
        found, broken = read_each([item], self.image)
        return Frame(item.id, found.get(item.id), broken.get(item.id, ""), item.path)

    def image(self, file: FrameFile) -> Image:
        """Read the image of a file; a BrokenFileError or MemoryError if it cannot be read."""
        image = IMAGES.read(file.read(self.most_bytes), self.most_pixels)
        self.check(image)
        return image

    def sized(self, file: FrameFile, size: tuple[int, int] | None = None) -> tuple[Image, tuple[int, int]]:
        """Read the image of a file; also returns its size, or the given one."""
        image = self.image(file)
        return image, size or size_of(image)


READ = ReadImage()


class FrameSource(ABC):
    """Frames that can be iterated over repeatedly, each time from the first, or read one by its number, from 0.

    Reading by number is safe from several threads, and the images last read are cached.
    """

    files: Sequence[FrameFile] = ()
    """Files from which the frames are read."""
    loss: str = ""
    """Message about frames that the input announced but does not have; known once it was read to its end."""
    pixel_aspect: float = 1.0
    """Width of a pixel as shown, in heights, as far as the input states it; known once a frame was read."""

    def __init__(self) -> None:
        self.broken: dict[str, str] = {}
        """Problems of frames that cannot be read, by id; known once the frames were read in order."""
        self._kept: OrderedDict[int, Image] = OrderedDict()
        self._sizes: dict[int, tuple[int, int]] = {}
        self._lock = Lock()

    @property
    def rate(self) -> float | None:
        """Frames per second of a video; None for pictures."""
        return None

    @property
    def frames_per_second(self) -> float:
        """Frame rate; for pictures the default rate."""
        return DEFAULT_RATE if self.rate is None else self.rate

    @property
    def count(self) -> int:
        """Number of frames that the input announces; 0 if unknown."""
        return len(self)

    @property
    @abstractmethod
    def ids(self) -> Sequence[str]:
        """Name of each frame."""

    @abstractmethod
    def __iter__(self) -> Iterator[Frame]:
        """The frames in order."""

    @abstractmethod
    def _read(self, number: int) -> Image:
        """Read the image of a frame; a BrokenFileError if it cannot be read."""

    def __len__(self) -> int:
        return len(self.ids)

    def number(self, number: int) -> int:
        """Check the number of a frame.

        Raises
        ------
        IndexError
            If there is no such frame.
        """
        if not is_number(number) or not 0 <= number < len(self) or number != int(number):
            raise IndexError(f"expected a frame from 0 to {len(self) - 1}, got {number!r}")
        return int(number)

    def image(self, number: int) -> Image:
        """Read the image of a frame, which must not be written to.

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

    def size(self, number: int) -> tuple[int, int]:
        """Width and height of a frame, pixels; raises as `image`."""
        if number not in self._sizes:
            self._sizes[number] = size_of(self.image(number))
        return self._sizes[number]

    def each(self, begin: int, end: int) -> Iterator[Image]:
        """Yield the images of frames from `begin` up to `end`, without caching them."""
        for number in range(begin, end):
            with self._lock:
                image = self._kept.get(number)
                image = self._read(number) if image is None else image
            yield image

    def name(self, number: int) -> str:
        """Name of a frame in annotations of other tools."""
        return self.ids[number]

    @abstractmethod
    def part(self, begin: int, end: int) -> FrameSource:
        """The frames from the `begin`-th up to the `end`-th in order, without messages."""

    def learn(self, broken: Mapping[str, str], loss: str) -> None:
        """Take over what readings of parts have told, and tell it."""
        self.broken |= broken
        self.loss = loss

    def __getstate__(self) -> dict[str, Any]:
        """Everything that another process needs."""
        return {name: value for name, value in self.__dict__.items() if name != "_lock"}

    def __setstate__(self, state: Mapping[str, Any]) -> None:
        """Restore it."""
        self.__dict__ |= state
        self._lock = Lock()

    def close(self) -> None:  # noqa: B027 - pictures and arrays have nothing to close
        """End reading."""


class ArrayFrames(FrameSource):
    """Images that can be iterated over repeatedly, checked when they are read; their ids are their `numbers`."""

    def __init__(self, images: Iterable[Image], numbers: range = EVERY) -> None:
        super().__init__()
        self._images, self._numbers = images, numbers

    @cached_property
    def ids(self) -> Sequence[str]:
        """The numbers of the images."""
        count = len(self._images) if isinstance(self._images, Sized) else sum(1 for _ in self._images)
        return [f"{number:06d}" for number in self._numbers[:count]]

    def __iter__(self) -> Iterator[Frame]:
        for number, image in zip(self._numbers, self._images, strict=False):
            yield Frame(f"{number:06d}", checked_image(image))

    def part(self, begin: int, end: int) -> ArrayFrames:
        """Some of the images; only these go to another process if they are in a list or an array."""
        images, numbers = self._images, self._numbers[begin:end]
        if isinstance(images, list | tuple | np.ndarray):
            return ArrayFrames(images[begin:end], numbers)
        return ArrayFrames(_Some(images, begin, end), numbers)

    def _read(self, number: int) -> Image:
        return checked_image(next(iter(_Some(self._images, number, number + 1))))


@dataclass(frozen=True)
class _Some:
    images: Iterable[Image]
    begin: int
    end: int

    def __iter__(self) -> Iterator[Image]:
        if isinstance(self.images, Sequence):
            return (self.images[k] for k in range(self.begin, self.end))
        return islice(self.images, self.begin, self.end)


class FileFrames(FrameSource):
    """Images in files, or in zips; `tell` is called once for each that cannot be read.

    Images of a clip must be of one size.
    """

    def __init__(
        self,
        files: Sequence[FrameFile],
        read: ReadImage = READ,
        tell: Callable[[str], object] = say,
        *,
        is_clip: bool = True,
    ) -> None:
        super().__init__()
        self.files, self._one, self._tell, self._is_clip = files, read, tell, is_clip

    @cached_property
    def ids(self) -> Sequence[str]:
        """The names of the files without their endings."""
        return [file.id for file in self.files]

    def __iter__(self) -> Iterator[Frame]:
        first: tuple[FrameFile, tuple[int, int]] | None = None  # of a clip
        for file in self.files:
            if file.id in self.broken:
                yield Frame(file.id, None, self.broken[file.id], file.path)
                continue
            frame = self._one(file)
            if frame.image is None:
                self.broken[frame.id] = frame.problem
                self._tell(f"{frame.path}: {frame.problem}")
            elif self._is_clip:
                size = size_of(frame.image)
                first = first or (file, size)
                if size != first[1]:
                    sizes = "{} has {} x {} pixels, {} {} x {}".format(file.path, *size, first[0].path, *first[1])
                    raise ValueError(f"the images of a clip must be of one size: {sizes}")
            yield frame

    def part(self, begin: int, end: int) -> FileFrames:
        """The images of some of the files."""
        return FileFrames(self.files[begin:end], self._one, ignored, is_clip=self._is_clip)

    def learn(self, broken: Mapping[str, str], loss: str) -> None:
        """Take over what readings of parts have told, and tell of images that cannot be read."""
        for file in self.files:
            if file.id in broken and file.id not in self.broken:
                self._tell(f"{file.path}: {broken[file.id]}")
        super().learn(broken, loss)

    def _read(self, number: int) -> Image:
        file = self.files[number]
        try:
            return self._one.image(file)
        except (BrokenFileError, MemoryError) as error:
            raise BrokenFileError(f"{file.path.name}: {error or 'there is not enough memory for it'}") from None

    def name(self, number: int) -> str:
        """The name of the picture's file."""
        return self.files[number].path.name


class VideoFrames(FrameSource):
    """The frames of a video, whose ids are their numbers with six digits.

    Parameters
    ----------
    path : Path
    cut : Cut
        Which frames are read in order.
    read : ReadImage
        Largest number of pixels of a frame, and the check of each frame.
    threads : int, optional
        Number of threads of the decoder.
    tell : function
        Called once with a message about announced frames that cannot be read.
    numbers : sequence of int, optional
        Numbers in the video of the frames that can be read by number; all by default.

    Raises
    ------
    FileNotFoundError, BrokenFileError
        As `fieldcalib.io.videos.VideoReader`.
    """

    def __init__(
        self,
        path: Path,
        cut: Cut = WHOLE,
        read: ReadImage = READ,
        threads: int | None = None,
        tell: Callable[[str], object] = say,
        *,
        numbers: Sequence[int] | None = None,
    ) -> None:
        super().__init__()
        self._path, self._cut, self._one, self._threads, self._tell = path, cut, read, threads, tell
        self._numbers_given = numbers
        self.files = [FrameFile(path.stem, path)]
        self._state = self.files[0].state
        self._reader: VideoReader | None = None  # of the frames in order
        self._begun: Iterator[Frame] | None = None

    def looked_at(self) -> VideoFrames:
        """Read the first frame: what is wrong with the video shows before anything is written.

        The first iteration goes on from there: opening a video that is cut by an edit list decodes what it hides.
        """
        reading = self._frames()
        self._begun = chain([next(reading)], reading)
        assert self._reader is not None
        for remark in filter(None, (self._reader.beyond, self._reader.remark)):
            self._tell(remark)
        return self

    @property
    def rate(self) -> float:
        """Frames per second."""
        return (self._reader or self._video).frames_per_second

    @property
    def count(self) -> int:
        """Number of frames that the file announces; 0 if it does not, or was not looked at."""
        return 0 if self._reader is None else self._reader.count

    def __iter__(self) -> Iterator[Frame]:
        begun, self._begun = self._begun, None
        return self._frames() if begun is None else begun

    def _frames(self) -> Iterator[Frame]:
        path, most = self._path, self._one.most_pixels
        if self.files[0].state != self._state:
            raise BrokenFileError(f"{path}: was replaced while it was read: run it again")
        with VIDEOS.read(path, most, cut=self._cut, threads=self._threads) as video:
            self._reader, self.pixel_aspect = video, video.pixel_aspect
            yield from checked_frames(path, video, self._one.check)
            if not self.loss and (loss := video.loss()):
                self.loss = loss
                self._tell(loss)

    def part(self, begin: int, end: int) -> VideoFrames:
        """Some of the frames; those of a cut by times only if the video has been looked at."""
        numbers = self._cut.numbers() if self._reader is None else self._reader.numbers
        return VideoFrames(self._path, Cut.part(numbers[begin:end]), self._one, self._threads, ignored)

    def learn(self, broken: Mapping[str, str], loss: str) -> None:
        """Take over what readings of parts have told, and tell of frames that are not there."""
        if loss and not self.loss:
            self._tell(loss)
        super().learn(broken, loss)

    @cached_property
    def _video(self) -> VideoReader:
        """The video, which stays open to be read at any place."""
        return VideoReader(self._path)

    @cached_property
    def _numbers(self) -> Sequence[int]:
        return range(self._video.stored) if self._numbers_given is None else self._numbers_given

    @cached_property
    def ids(self) -> Sequence[str]:
        """The numbers of the frames in the video."""
        return [f"{number:06d}" for number in self._numbers]

    def _read(self, number: int) -> Image:
        return self._decoded(self._numbers[number])

    def frame(self, wanted: int) -> Image:
        """Read a frame by its number in the video, whether it is one of `numbers` or not, without caching it.

        Raises
        ------
        BrokenFileError
            If it cannot be read.
        """
        with self._lock:
            return self._decoded(wanted)

    def _decoded(self, wanted: int) -> Image:
        image = self._video.image(wanted)
        if image is None:
            raise BrokenFileError(f"{self._path.name}: frame {wanted} cannot be read: the file is cut off or damaged")
        return image

    def size(self, number: int) -> tuple[int, int]:
        """Width and height of all frames."""
        return self._video.size

    def close(self) -> None:
        """End reading."""
        with self._lock, self._video:
            self._kept.clear()


def in_order(files: Iterable[FrameFile]) -> list[FrameFile]:
    """Sort files by the numbers in their names.

    Examples
    --------
    >>> [file.id for file in in_order(FrameFile(id, Path(id)) for id in ("frame 10", "frame 9"))]
    ['frame 9', 'frame 10']
    """
    return sorted(files, key=lambda file: [(text, int(n or 0)) for text, n in re.findall(r"(\D*)(\d*)", file.id)])


def in_cut(images: Sequence[T], cut: Cut, tell: Callable[[str], object]) -> Sequence[T]:
    """Select the images in a cut; `tell` gets a message if its end lies beyond the last one.

    Raises
    ------
    ValueError
        If no image is left, or the cut is given by times.
    """
    numbers = cut.numbers()
    found = images[numbers.start : numbers.stop : numbers.step]
    if not found:
        raise ValueError(f"the input {ends_before(cut.start, len(images))}: there is no frame to begin with")
    if beyond := cut.beyond(len(images)):
        tell(f"the input {beyond}")
    return found


def checked_frames(name: Input, reader: FrameReader, check: Callable[[Image], object]) -> Iterator[Frame]:
    """Yield the frames of a video, checked; their ids are their numbers with six digits.

    A BrokenFileError raised by `check` gets the name of the video.
    """
    frames = reader.numbered()
    with named_in_errors(name):
        while True:
            with waiting_for(str(name)):
                number, image = next(frames, (0, None))
            if image is None:
                return
            check(image)
            yield Frame(f"{number:06d}", image, path=str(name), is_of_video=True, seconds=reader.seconds)


def is_video(one: Input) -> bool:
    """Whether an input is the file of a video."""
    return not isinstance(one, Stream) and VIDEOS.recognises(one)


def is_clip(first: Input, *, together: bool = False, alone: bool = False) -> bool:
    """Whether frames are calibrated together: those of a video unless `alone`, images if `together`.

    Examples
    --------
    >>> from pathlib import Path
    >>> is_clip(Path("a.mp4")), is_clip(Path("a.mp4"), alone=True), is_clip(Path("a.jpg"))
    (True, False, False)
    """
    return together or (is_video(first) and not alone)


def files_read(inputs: Sequence[Path]) -> list[Path]:
    """Files on the disk that are read for images or for one video; images in a zip count as the zip itself."""
    if VIDEOS.recognises(inputs[0]):
        return list(inputs)
    return [file.on_disk for file in IMAGES.find(inputs)]


def videos_in(one: Input) -> list[Input]:
    """List the videos of a folder that has videos and no images; otherwise the input itself."""
    if isinstance(one, Stream) or not one.is_dir():
        return [one]
    files = sorted(path for path in one.iterdir() if path.is_file())
    if any(map(IMAGES.recognises, files)):
        return [one]
    return [path for path in files if VIDEOS.recognises(path)] or [one]


def pixels_of(frame: Frame) -> int:
    """Number of pixels in memory."""
    return 0 if frame.image is None else frame.image.shape[0] * frame.image.shape[1]
