"""Sources of frames: a video, files of images, or arrays; read in order any number of times, or one by its number.

A live stream is no such source, as its frames come only once (`fieldcalib.io.streams`). The module also decides whether
an input is a video, a stream or images, and whether its frames are calibrated together (`is_clip`).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import OrderedDict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import chain, count, islice
from pathlib import Path
from threading import Lock
from typing import Any, TypeVar

import numpy as np

from fieldcalib._progress import Progress, progress_bar, say, waiting_for
from fieldcalib._types import is_number
from fieldcalib.io.clips import OneSize, Reading, in_order
from fieldcalib.io.decoders import DEFAULT_RATE
from fieldcalib.io.files import BrokenFileError, FrameFile, named_in_errors
from fieldcalib.io.formats import IMAGES, VIDEOS
from fieldcalib.io.frame_range import WHOLE, Cut, ends_before
from fieldcalib.io.image_files import MOST_PIXELS, Image, checked_image, size_of
from fieldcalib.io.streams import Input, Stream
from fieldcalib.io.videos import FrameReader, VideoReader
from fieldcalib.problem.picture_shape import Crop, Placement
from fieldcalib.run_folder.labelled_frames import name_skipped
from fieldcalib.run_folder.record import Outcome
from fieldcalib.run_folder.work_units import read_each

PASSES = ("looking", "matching", "finding lines")  # names of the passes over the frames of a clip, in this order
AGAIN, DRAWING = "finding lines again", "drawing"  # names of further passes
SOLVING = "solving the clip"  # name of the work between passes
REPLACED = "the frames are not those that were read before: was the input replaced in the meantime? Run it again"
MOST_BYTES = 256_000_000  # largest file of an image
CACHE_BYTES = 64_000_000  # of the images in memory: 10 of 1920 x 1080
HELD_BYTES = 540_000_000  # of the frames of a clip in memory: the 85 at which its shape is looked at, of 1920 x 1080

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


def ignored(*told: object) -> None:
    """Do nothing: what is told is of no interest, and any image is accepted."""


@dataclass(frozen=True)
class ReadImage:
    """Reads images from files; `check` may raise a BrokenFileError for an image. Frames of a video pass through."""

    most_bytes: float = MOST_BYTES
    most_pixels: float = MOST_PIXELS
    check: Callable[[Image], object] = ignored

    def __call__(self, item: FrameFile | Frame) -> Frame:
        """Read the image of a file."""
        if isinstance(item, Frame):
            return item
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

    def learn(self, reading: Reading) -> None:
        """Take over what readings of parts have told, and tell it."""
        self.broken |= reading.broken
        self.loss = reading.loss

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
    """Images in memory, checked when they are read; their ids are their numbers with six digits."""

    def __init__(self, images: Sequence[Image], cut: Cut = WHOLE) -> None:
        super().__init__()
        self._images, self._cut = images, cut

    @cached_property
    def _numbers(self) -> Sequence[int]:
        return in_cut(range(len(self._images)), self._cut, ignored)

    @cached_property
    def ids(self) -> Sequence[str]:
        """The numbers of the images."""
        return [f"{number:06d}" for number in self._numbers]

    def __iter__(self) -> Iterator[Frame]:
        for id, number in zip(self.ids, self._numbers, strict=True):
            yield Frame(id, checked_image(self._images[number]))

    def part(self, begin: int, end: int) -> ArrayFrames:
        """Some of the images, which only go to another process."""
        some = ArrayFrames([self._images[number] for number in self._numbers[begin:end]])
        some.ids = self.ids[begin:end]
        return some

    def _read(self, number: int) -> Image:
        return checked_image(self._images[self._numbers[number]])


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
        one_size = OneSize()
        for file in self.files:
            if file.id in self.broken:
                yield Frame(file.id, None, self.broken[file.id], file.path)
                continue
            frame = self._one(file)
            if frame.image is None:
                self.broken[frame.id] = frame.problem
                self._tell(f"{frame.path}: {frame.problem}")
            elif self._is_clip:
                one_size.check(file, frame.image)
            yield frame

    def part(self, begin: int, end: int) -> FileFrames:
        """The images of some of the files."""
        return FileFrames(self.files[begin:end], self._one, ignored, is_clip=self._is_clip)

    def learn(self, reading: Reading) -> None:
        """Take over what readings of parts have told, and tell of images that cannot be read."""
        for file in self.files:
            if file.id in reading.broken and file.id not in self.broken:
                self._tell(f"{file.path}: {reading.broken[file.id]}")
        super().learn(reading)

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
        """Some of the frames; the video has been looked at."""
        assert self._reader is not None
        cut = Cut.part(self._reader.numbers[begin:end])
        return VideoFrames(self._path, cut, self._one, self._threads, ignored)

    def learn(self, reading: Reading) -> None:
        """Take over what readings of parts have told, and tell of frames that are not there."""
        if reading.loss and not self.loss:
            self._tell(reading.loss)
        super().learn(reading)

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

    def opened(self) -> AbstractContextManager[Iterable[Image]]:
        """The frames, each reading of which is a pass."""
        return nullcontext(self)

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
        self.source.learn(reading)

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
        self._bytes += bytes_of(frame)
        while self._bytes > self._most_held:
            self._bytes -= bytes_of(self._held.pop(next(iter(self._held))))

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


def outcomes_of(
    frames: Iterable[Frame], results: Iterable[T], outcome: Callable[[Frame, Image, T], Outcome]
) -> list[Outcome]:
    """Make the outcomes of frames, from the results for the frames that could be read."""
    rest = iter(results)
    return [
        Outcome.broken(frame, frame.problem) if frame.image is None else outcome(frame, frame.image, next(rest))
        for frame in frames
    ]


def bytes_of(frame: Frame) -> int:
    """Number of bytes of its image in memory."""
    return 0 if frame.image is None else frame.image.nbytes


def pixels_of(frame: Frame) -> int:
    """Number of pixels in memory."""
    return 0 if frame.image is None else frame.image.shape[0] * frame.image.shape[1]
