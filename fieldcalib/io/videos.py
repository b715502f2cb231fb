"""Videos: read frame by frame, and drawn pictures written as one.

Frames are images as in `fieldcalib.io.image_files`, turned as the video's metadata say.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from threading import Lock
from types import TracebackType
from typing import Any, BinaryIO, Self

import numpy as np

from fieldcalib._types import Array
from fieldcalib.io.animations import Animation, is_animated_webp
from fieldcalib.io.encoders import Encoder, open_encoder
from fieldcalib.io.files import BrokenFileError, check_utf8, native_name, replacement
from fieldcalib.io.frame_range import WHOLE, Cut, ends_before
from fieldcalib.io.image import Image, size_of
from fieldcalib.io.image_files import MOST_PIXELS, check_pixels

WITH_COUNT = (".mp4", ".m4v", ".mov", ".avi")  # these store how many frames there are, the others how long they take
LONGEST_SOUND = 1.0  # seconds that the sound may go on after the last frame
IRREGULAR = (
    0.1  # relative deviation of the time between two frames from the frame rate: times are rounded to milliseconds
)
FASTEST = 1000.0  # frames per second: larger frame rates are errors of the file
LEAST_JUMP = 100  # frames: fewer are decoded rather than jumped over
DEFAULT_RATE = 25.0  # frames per second, where the file says nothing
MOST_DAMAGED = 250  # frames in a row, ten seconds: behind more of them nothing is looked for
LONGEST_WAIT = 20.0  # seconds for a damaged frame: OpenCV waits 30 for a source that sends nothing more
_OPENING = Lock()  # held while the variable below is set: another thread that opens a video would read it too
CAPTURE_OPTIONS = "OPENCV_FFMPEG_CAPTURE_OPTIONS"  # environment variable that OpenCV reads when it opens a video
NO_VIDEO = "is no video that OpenCV can read, or its end is missing"

HEADER, SEGMENT = b"\x1a\x45\xdf\xa3", b"\x18\x53\x80\x67"  # ids of the two elements that such a file has
LONGEST = 8  # bytes of a size
UNKNOWN = 0  # size of a live recording


class FrameReader:
    """Frames of whatever OpenCV opens as a video, one after the other; a context manager.

    Frames that cannot be decoded are left out, and those after them keep their numbers.

    Parameters
    ----------
    location : str
        A path, a URL, or what else OpenCV takes.
    name : str
        Its name in messages.
    most_pixels : float
        Largest number of pixels of a frame.
    cut : Cut
        Frames that are read.
    threads : int, optional
        Threads that decode it; as many as there are cores by default.

    Raises
    ------
    BrokenFileError
        If it is no video, has no frame in the cut, or too large ones (`fieldcalib.io.image_files.check_pixels`).
    ValueError
        If there can be no frame in the cut.
    """

    frames_per_second: float
    """Frame rate of the frames that are read, every `step`-th one."""
    numbers: range
    """Numbers of the frames that are read, as far as they exist; the first frame of the video is 0."""

    def __init__(
        self, location: str, name: str, most_pixels: float = MOST_PIXELS, cut: Cut = WHOLE, threads: int | None = None
    ) -> None:
        import cv2

        self._location, self._name, self._threads = location, name, threads
        self._times: list[float] = []  # seconds, of the frames that were read
        self._capture, self._number = _opened(location, threads), -1
        try:
            width, height = (self._capture.get(p) for p in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))
            check_pixels((int(width), int(height)), most_pixels)
            rate = float(self._capture.get(cv2.CAP_PROP_FPS))
            self._rate = rate if 0.0 < rate <= FASTEST else DEFAULT_RATE
            self.numbers = cut.numbers(self._rate)
            self.frames_per_second = self._rate / cut.step
            if not self._grab(1):
                raise BrokenFileError(NO_VIDEO)
            self._frame = self._decoded(self.numbers.start)
            if self._frame is None:
                raise BrokenFileError(self._no_start(cut))
        except BrokenFileError as error:
            self._capture.release()
            raise BrokenFileError(f"{name}: {error}") from None
        except ValueError:
            self._capture.release()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self._capture.release()

    def __iter__(self) -> Iterator[Image]:
        return (image for _, image in self.numbered())

    def numbered(self) -> Iterator[tuple[int, Image]]:
        """The frames, each with its number in the video."""
        while self._frame is not None:
            self._times.append(self._time())
            yield self._number, self._frame
            self._frame = self._decoded(self._number + self.numbers.step)

    def _decoded(self, number: int) -> Image | None:
        """A frame of the cut or, if that is damaged, the next one that is not; None at the end."""
        while number in self.numbers and self._grab(number - self._number):
            if self._number == number:
                is_read, frame = self._capture.retrieve()
                if is_read:
                    return np.asarray(frame, dtype=np.uint8)
            least = max(self._number, number + 1)
            number = least + (self.numbers.start - least) % self.numbers.step
        return None

    def _no_start(self, cut: Cut) -> str:
        """Message that there is no frame at the start of a cut."""
        import cv2

        count = int(self._capture.get(cv2.CAP_PROP_FRAME_COUNT))
        if not 0 < count <= self.numbers.start:  # a stream does not say it, nor does a file that is cut off
            return f"has no frame {self.numbers.start}, the first that is asked for"
        return f"{ends_before(cut.start, count, self._rate)}: there is no frame to begin with"

    def _grab(self, count: int) -> bool:
        """Go on by `count` frames, and past those that are damaged there; return whether there are so many."""
        number = self._number + count
        while self._number < number:
            damaged = _grab_whole(self._capture)
            if damaged is None:
                return False
            self._number += damaged + 1
        return True

    def _missed(self) -> int:
        """Number of frames missing between those that were read, by their times; 0 if these are not regular."""
        return _missed(np.array(self._times), self.frames_per_second)

    def _time(self) -> float:
        """Time of the frame that was read last, in seconds."""
        import cv2

        return float(self._capture.get(cv2.CAP_PROP_POS_MSEC)) / 1e3


class VideoReader(FrameReader):
    """Frames of a video file, one after the other; a context manager.

    Parameters
    ----------
    path : Path
    most_pixels, cut, threads
        As for a `FrameReader`.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    BrokenFileError, ValueError
        As for a `FrameReader`.
    """

    count: int
    """Number of frames that are read, as the file says: often right; 0 if it does not say."""
    beyond: str
    """Message if the end of the cut lies beyond that of the video; empty otherwise."""

    def __init__(
        self, path: Path, most_pixels: float = MOST_PIXELS, *, cut: Cut = WHOLE, threads: int | None = None
    ) -> None:
        import cv2

        if not path.is_file():
            raise FileNotFoundError(f"{path} does not exist: expected a video")
        if not path.stat().st_size:  # also of files of the kernel, which may be read without end
            raise BrokenFileError(f"{path}: {NO_VIDEO}")
        self._path = path
        super().__init__(native_name(path), str(path), most_pixels, cut, threads)
        self._announced = max(int(self._capture.get(cv2.CAP_PROP_FRAME_COUNT)), 0)
        self.beyond = self._beyond(cut)
        self.count = len(self.numbers[: max(-(-(self._announced - self.numbers.start) // self.numbers.step), 0)])

    def _grab(self, count: int) -> bool:
        """Go on by `count` frames; by a jump if they are many, and it arrives at the right frame."""
        import cv2

        if count < LEAST_JUMP:
            return super()._grab(count)
        number, there = self._number + count, self._time() + count / self._rate
        jumped = self._capture.set(cv2.CAP_PROP_POS_FRAMES, number) and self._capture.grab()
        if jumped and abs(self._time() - there) * self._rate < 0.5:
            self._number = number
            return True
        self._capture.release()  # its times are not regular, or it has no index
        self._capture, self._number = _opened(self._location, self._threads), -1
        return super()._grab(number + 1)

    def _beyond(self, cut: Cut) -> str:
        is_sure = self._path.suffix.lower() in WITH_COUNT or self.numbers.stop > self._announced + self._rate
        beyond = cut.beyond(self._announced, self._rate) if self._announced and is_sure else ""
        return f"{self._path} {beyond}" if beyond else ""

    def loss(self) -> str:
        """Message if announced frames cannot be read, empty otherwise; to be called after all others were read."""
        if (lost := self.lost_frames()) > 0:
            announced, read = max(self.count, len(self._times) + lost), len(self._times)
            return f"{self._path}: announces {announced} frames, {read} can be read"
        if len(self._times) < len(self.numbers) and (missing := missing_bytes(self._path)):
            return f"{self._path}: its end is missing, {missing} bytes: {len(self._times)} frames can be read"
        return ""

    def lost_frames(self) -> int:
        """Number of announced frames that cannot be read; to be called after all others were read.

        An MP4 may announce frames before its edit list begins, which are decoded but not shown: they are not lost.
        """
        left = self.count - len(self._times)
        if self._path.suffix.lower() not in WITH_COUNT:
            missed = self._missed()
            after = min(left - missed, self._frames_after())
            return missed + (after if after > LONGEST_SOUND * self.frames_per_second else 0)
        if left <= 0:
            return 0
        can_be_decoded = count_frames(self._path, self._threads, "ignore_editlist;1")
        return min(max(self._announced - can_be_decoded, 0), left)

    def _frames_after(self) -> int:
        """Number of frames that the time from the last frame to the end of the video or of the cut has room for.

        Where the frame rate varies, fewer frames than announced last as long.
        """
        if not self._times:
            return self.count
        end = min(self.numbers.stop, self._announced) / self._rate
        return max(round((end - self._times[-1]) * self.frames_per_second) - 1, 0)


class FramesByNumber:
    """Frames of a video file in any order; a context manager.

    Parameters
    ----------
    path : Path
    most_pixels : float
        As for a `FrameReader`.

    Raises
    ------
    FileNotFoundError, BrokenFileError
        As for a `VideoReader`.
    """

    count: int
    """Number of frames, as far as the file says it: the last ones may be missing."""
    frames_per_second: float
    first: Image
    """The image of the first frame that can be read."""
    first_number: int
    """Its number."""

    def __init__(self, path: Path, most_pixels: float = MOST_PIXELS) -> None:
        reader = VideoReader(path, most_pixels)
        self.frames_per_second = reader.frames_per_second
        self.first_number, self.first = next(reader.numbered())
        self._path = path
        self._capture, self._next = reader._capture, self.first_number + 1
        self._begin = reader._time() - self.first_number / self.frames_per_second  # seconds, of frame 0
        self.count = self._counted(reader.count)

    def _counted(self, announced: int) -> int:
        """Number of frames, without those that an MP4 announces before its edit list begins."""
        import cv2

        self._capture.set(cv2.CAP_PROP_POS_FRAMES, announced - 1)
        if not self._capture.grab():
            shown = int(self._capture.get(cv2.CAP_PROP_POS_FRAMES))
            announced = shown if 0 < shown < announced else announced
        self._next = announced
        return announced

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self._capture.release()

    def read(self, number: int) -> Image | None:
        """The image of a frame; None if it cannot be read."""
        if not 0 <= number - self._next < LEAST_JUMP and self._is_at(number):
            return self._retrieved()
        if number < self._next:
            self._reopen()
        while self._next <= number:
            damaged = _grab_whole(self._capture)
            if damaged is None:
                self._reopen()
                return None
            self._next += damaged + 1
        return self._retrieved() if self._next == number + 1 else None

    def _is_at(self, number: int) -> bool:
        """Jump to a frame, and grab it; false if the jump does not arrive there: times are irregular, or no index."""
        import cv2

        there = self._begin + number / self.frames_per_second
        if self._capture.set(cv2.CAP_PROP_POS_FRAMES, number) and self._capture.grab():
            self._next = number + 1
            if abs(self._time() - there) * self.frames_per_second < 0.5:
                return True
        self._reopen()
        return False

    def _reopen(self) -> None:
        self._capture.release()
        self._capture, self._next = _opened(native_name(self._path), None), 0

    def _time(self) -> float:
        import cv2

        return float(self._capture.get(cv2.CAP_PROP_POS_MSEC)) / 1e3

    def _retrieved(self) -> Image | None:
        is_read, frame = self._capture.retrieve()
        return np.asarray(frame, dtype=np.uint8) if is_read else None


def _opened(location: str, threads: int | None, options: str = "") -> Any:
    """OpenCV's reader of a video, with that many threads for decoding, and options of FFmpeg."""
    import cv2

    check_utf8(location)
    if is_animated_webp(Path(location)):
        return Animation(Path(location))
    parameters = [] if threads is None else [cv2.CAP_PROP_N_THREADS, threads]
    with _OPENING, _environment(CAPTURE_OPTIONS, options):
        return cv2.VideoCapture(location, cv2.CAP_ANY, parameters)


def _grab_whole(capture: Any) -> int | None:
    """Go to the next frame that can be decoded; returns the number of those that cannot before it, None at the end.

    OpenCV gives up at a damaged frame, but goes on behind it when it is asked again.
    """
    for damaged in range(MOST_DAMAGED):
        began = time.monotonic()
        if capture.grab():
            return damaged
        if time.monotonic() - began > LONGEST_WAIT:
            break
    return None


def _missed(times: Array, rate: float) -> int:
    """Number of frames missing between others, by their times in seconds; 0 if they are not at that rate.

    Examples
    --------
    >>> _missed(np.array([0.0, 0.04, 0.08, 0.12, 0.24, 0.28]), rate=25.0)
    2
    """
    steps = np.diff(times) * rate
    if not len(steps) or abs(np.median(steps) - 1.0) > IRREGULAR:
        return 0
    return int(np.sum(np.rint(steps[steps > 1.5]) - 1.0))


def count_frames(path: Path, threads: int | None = None, options: str = "") -> int:
    """Number of frames of a file that can be decoded, with options of FFmpeg; 0 if it is no video."""
    capture = _opened(native_name(path), threads, options)
    count = 0
    while _grab_whole(capture) is not None:
        count += 1
    capture.release()
    return count


@contextmanager
def _environment(name: str, value: str) -> Iterator[None]:
    """Set an environment variable while the context lasts; an empty value changes nothing."""
    old = os.environ.get(name)
    if value:
        os.environ[name] = value
    try:
        yield
    finally:
        if value and old is None:
            del os.environ[name]
        elif value and old is not None:
            os.environ[name] = old


class VideoWriter:
    """An MP4 of images, whole or not at all; a context manager. Images of another size than the first are resized.

    It is compressed by the best encoder that is installed (`fieldcalib.io.encoders`). Codecs have one colour for 2 x 2
    pixels: where the images have an odd number of rows or columns, the last one is repeated.

    Raises
    ------
    BrokenFileError
        If the path is not in UTF-8.
    ValueError
        If the frame rate is none, or larger than those of videos.
    OSError
        At the end, if not every image is in the file, as when the disk is full.
    """

    note: str = ""
    """Note about the file for the user, to follow its name; empty until there is an image."""

    def __init__(self, path: Path, frames_per_second: float, *, threads: int | None = None) -> None:
        check_utf8(path)
        if not 0.0 < frames_per_second <= FASTEST:
            raise ValueError(f"{path}: expected at most {FASTEST:g} frames per second, got {frames_per_second:g}")
        self._path, self._frames_per_second, self._threads = path, frames_per_second, threads
        self._replacement = ExitStack()
        self._encoder: Encoder | None = None
        self._size = (0, 0)
        self._written = 0

    def __enter__(self) -> Self:
        return self

    def write(self, image: Image) -> None:
        """Append an image.

        Raises
        ------
        OSError
            If no video can be written there.
        """
        import cv2

        if self._encoder is None:
            handle, self._unfinished = self._replacement.enter_context(replacement(self._path))
            os.close(handle)
            self._size = size_of(image)
            width, height = (length + length % 2 for length in self._size)
            try:
                self._encoder = open_encoder(self._unfinished, self._frames_per_second, (width, height), self._threads)
            except OSError as error:
                raise OSError(f"{self._path}: {error}") from None
            self.note = self._encoder.note
        sized = image if image.shape[1::-1] == self._size else np.asarray(cv2.resize(image, self._size), np.uint8)
        self._encoder.write(np.pad(sized, ((0, self._size[1] % 2), (0, self._size[0] % 2), (0, 0)), mode="edge"))
        self._written += 1

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if self._encoder is not None:
            self._encoder.close()
        if error is not None:
            self._replacement.__exit__(kind, error, traceback)
            return
        with self._replacement:
            found = count_frames(self._unfinished, self._threads) if self._written else 0
            if found != self._written:
                raise OSError(f"{self._path}: {found} of {self._written} frames were written: is the disk full?")


def missing_bytes(path: Path) -> int:
    """Number of bytes that are missing at the end of a Matroska file; 0 for any other file, or if it does not say.

    The size of an element is a number of 1 to 8 bytes: the zeros before its first bit count the further bytes.
    """
    with path.open("rb") as file:
        if file.read(len(HEADER)) != HEADER:
            return 0
        file.seek(_size(file), 1)
        if file.read(len(SEGMENT)) != SEGMENT:
            return 0
        size = _size(file)
        end = file.tell() + size
    return max(end - path.stat().st_size, 0) if size != UNKNOWN else 0


def _size(file: BinaryIO) -> int:
    first = file.read(1)
    if not first or not first[0]:
        return UNKNOWN
    length = LONGEST + 1 - first[0].bit_length()
    bits = 7 * length
    value = int.from_bytes(first + file.read(length - 1), "big") & ((1 << bits) - 1)
    return UNKNOWN if value == (1 << bits) - 1 else value
