"""Videos: read frame by frame, and drawn pictures written as one.

Frames are images as in `fieldcalib.io.image_files`, turned as the video's metadata say.
"""

from __future__ import annotations

import os
import sys
from bisect import bisect_right
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from fractions import Fraction
from pathlib import Path
from threading import Lock
from types import TracebackType
from typing import Any, Self, cast

import numpy as np

from fieldcalib._whole_files import replacement
from fieldcalib.io.decoders import FASTEST, NO_VIDEO, Decoder, check_av, file_decoder
from fieldcalib.io.files import BrokenFileError, check_utf8, named_in_errors, native_name
from fieldcalib.io.frame_range import WHOLE, Cut, ends_before
from fieldcalib.io.image_files import MOST_PIXELS, Image, check_pixels, size_of
from fieldcalib.problem.picture_shape import LEAST_ASPECT

INTERLACED = (
    "is interlaced: every second row shows another moment. Its pictures are taken as they are; ffmpeg -vf bwdif makes "
    "whole ones of them"
)
X264 = "libx264"
# Half of the time of "superfast", with files 15 to 40 % larger and as good (1280 x 720: 8 ms of one core and 27 kB).
X264_OPTIONS = {"preset": "ultrafast", "crf": "20", "x264-params": "cabac=1:8x8dct=1:partitions=i4x4,i8x8"}
COLOUR_RANGE = 224.0 / 255.0  # of the planes of colour in video, around 128
BT709_PRIMARIES, BT709_CURVE, BT601 = 1, 1, 6  # H.264's numbers


class FrameReader:
    """Frames of a video, one after the other; a context manager.

    Frames that cannot be decoded are left out, and those after them keep their numbers.

    Parameters
    ----------
    decoder : Decoder
    name : str
        Its name in messages.
    most_pixels : float
        Largest number of pixels of a frame.
    cut : Cut
        Frames that are read.

    Raises
    ------
    BrokenFileError
        If it has no frame in the cut, or too large ones (`fieldcalib.io.image_files.check_pixels`).
    ValueError
        If there can be no frame in the cut.
    """

    frames_per_second: float
    """Frame rate of the frames that are read, every `step`-th one; where it varies, the average."""
    numbers: range
    """Numbers of the frames that are read, as far as they exist; the first frame of the video is 0."""
    size: tuple[int, int]
    """Width and height of the first frame that is read, in pixels."""
    pixel_aspect: float
    """Width of a pixel as shown, in heights, as the file states it; 1 of most videos."""
    remark: str = ""
    """What is to be known of the frames; empty for most videos."""

    def __init__(self, decoder: Decoder, name: str, most_pixels: float = MOST_PIXELS, cut: Cut = WHOLE) -> None:
        self._decoder, self._name, self._read = decoder, name, 0
        self._lock = Lock()  # PyAV ends the process where a thread closes what another one, reading ahead, decodes
        try:
            with named_in_errors(name):
                check_pixels(decoder.size, most_pixels)
                self.numbers = cut.numbers(decoder.rate, decoder.times)
                self.frames_per_second = decoder.rate / cut.step
                self._frames = decoder.frames(self.numbers.start)
                self._passed = self.numbers.start  # number of the frame after the last one that was decoded
                first = self._next()
                if first is None and not cut.is_part:
                    raise BrokenFileError(self._no_start(cut))
        except ValueError:
            decoder.close()
            raise
        self._first: tuple[int, Image] | None = first
        self.size = (0, 0) if first is None else size_of(first[1])
        self.pixel_aspect = decoder.pixel_aspect if abs(decoder.pixel_aspect - 1.0) > LEAST_ASPECT else 1.0
        if decoder.is_interlaced:
            self.remark = f"{name} {INTERLACED}"

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        with self._lock:
            self._frames = iter(())
            self._decoder.close()

    @property
    def seconds(self) -> float | None:
        """Time stamp of the frame that was read last, as the video states it; None without one."""
        return self._decoder.seconds

    def __iter__(self) -> Iterator[Image]:
        return (image for _, image in self.numbered())

    def numbered(self) -> Iterator[tuple[int, Image]]:
        """The frames, each with its number in the video."""
        while self._first is not None:
            yield self._first
            self._first = self._next()

    def _next(self) -> tuple[int, Image] | None:
        """Number and image of the next frame of the cut that is not damaged; None at the end."""
        with self._lock:
            for number, image in self._frames if self._passed < self.numbers.stop else ():
                self._passed = number + 1
                if number in self.numbers:
                    self._read += 1
                    return number, image()
                if self._passed >= self.numbers.stop:
                    break
        return None

    def _no_start(self, cut: Cut) -> str:
        """Message that there is no frame at the start of a cut."""
        start, count, decoder = self.numbers.start, self._decoder.count, self._decoder
        if not start:
            return NO_VIDEO
        if not 0 < count <= start:  # a stream does not say it, nor does a file that is cut off
            return f"has no frame {start}, the first that is asked for"
        said = ends_before(cut.start, count, decoder.rate, decoder.times)
        return f"{said}: there is no frame to begin with"

    def loss(self) -> str:
        """Message about frames that were left out, empty if there are none; to be called after all others were read."""
        passed = len(range(self.numbers.start, self._passed, self.numbers.step))
        said = f"{self._name}: {passed - self._read} of {passed} frames cannot be decoded, and were left out"
        return said if self._read < passed else ""


class VideoReader(FrameReader):
    """Frames of a video file, one after the other, or in any order by their numbers (`image`); a context manager.

    Parameters
    ----------
    path : Path
    most_pixels, cut
        As for a `FrameReader`.
    threads : int, optional
        Threads that decode it; as many as there are cores by default.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    BrokenFileError, ValueError
        If it is no video, or as for a `FrameReader`.
    """

    count: int
    """Number of frames that are read, as the file announces; 0 if it does not."""
    stored: int
    """Number of frames that are in the file, whether in the cut or not; as it announces if that is not known."""
    beyond: str
    """Message if the end of the cut lies beyond that of the video; empty otherwise."""

    def __init__(
        self, path: Path, most_pixels: float = MOST_PIXELS, *, cut: Cut = WHOLE, threads: int | None = None
    ) -> None:
        location = native_name(path)
        if not path.is_file():
            raise FileNotFoundError(f"{path} does not exist: expected a video")
        if not path.stat().st_size:  # also of files of the kernel, which may be read without end
            raise BrokenFileError(f"{path}: {NO_VIDEO}")
        with named_in_errors(path):
            decoder = file_decoder(path, location, threads)
        super().__init__(decoder, str(path), most_pixels, cut)
        announced, rate, times = decoder.count, decoder.rate, decoder.times
        is_sure = bool(times) or self.numbers.stop > announced + rate
        beyond = cut.beyond(announced, rate, times) if announced and is_sure else ""
        self.beyond, self.stored = f"{path} {beyond}" if beyond else "", len(times) or announced
        self.count = len(self.numbers[: max(-(-(announced - self.numbers.start) // self.numbers.step), 0)])

    def image(self, number: int) -> Image | None:
        """The image of a frame by its number in the video; None if it cannot be read."""
        if self._first is not None and self._first[0] == number:
            return self._first[1]
        self._first, keys = None, self._decoder.keys
        if number < self._passed or bisect_right(keys, number) > bisect_right(keys, self._passed):
            self._frames = self._decoder.frames(number)
        self._passed = sys.maxsize  # at the end
        for found, image in self._frames:
            if found >= number:
                self._passed = found + 1
                return image() if found == number else None
        return None

    def loss(self) -> str:
        """Message about frames that the file announces and that cannot be read, empty if there are none."""
        if not self._decoder.times:
            return super().loss()
        said = f"{self._name}: announces {self.count} frames, {self._read} can be read"
        return said if self._read < self.count else ""


class VideoWriter:
    """An MP4 of images, whole or not at all; a context manager. Images of another size than the first are resized.

    It is H.264, which browsers play, with the index first: they need not load all of it to begin. Codecs have one
    colour for 2 x 2 pixels: where the images have an odd number of rows or columns, the last one is repeated.

    Raises
    ------
    BrokenFileError
        If the path is not in UTF-8.
    ValueError
        If the frame rate is none, or larger than those of videos.
    OSError
        At the end, if not every image is in the file, as when the disk is full.
    """

    def __init__(self, path: Path, frames_per_second: float, *, threads: int | None = None) -> None:
        check_utf8(path)
        if not 0.0 < frames_per_second <= FASTEST:
            raise ValueError(f"{path}: expected at most {FASTEST:g} frames per second, got {frames_per_second:g}")
        self._path, self._threads = path, threads
        self._rate = Fraction(frames_per_second).limit_denominator(100_000)
        self._replacement = ExitStack()
        self._size = (0, 0)
        self._container: Any = None
        self._written = 0

    def __enter__(self) -> Self:
        return self

    def _open(self) -> None:
        """Begin a file for frames of the size, made even."""
        check_av("videos are written")
        import av

        handle, self._unfinished = self._replacement.enter_context(replacement(self._path))
        os.close(handle)
        try:
            container = av.open(native_name(self._unfinished), "w", format="mp4", options={"movflags": "faststart"})
            self._stream = cast(Any, container.add_stream(X264, rate=self._rate, options=X264_OPTIONS))
        except (OSError, ValueError) as error:  # a build without x264
            raise OSError(f"{self._path}: PyAV cannot write H.264 there: {error}") from None
        self._container = container
        self._stream.width, self._stream.height = (length + length % 2 for length in self._size)
        self._stream.pix_fmt = "yuv420p"
        context = self._stream.codec_context
        context.thread_count = self._threads or 0  # 0: as many as there are cores
        context.color_primaries, context.color_trc, context.colorspace = BT709_PRIMARIES, BT709_CURVE, BT601

    def write(self, image: Image) -> None:
        """Append an image.

        Raises
        ------
        OSError
            If no video can be written there.
        ImportError
            If PyAV cannot be imported.
        """
        import cv2

        if self._container is None:
            self._size = size_of(image)
            self._open()
        import av

        sized = image if image.shape[1::-1] == self._size else np.asarray(cv2.resize(image, self._size), np.uint8)
        even = np.pad(sized, ((0, self._size[1] % 2), (0, self._size[0] % 2), (0, 0)), mode="edge")
        self._mux(av.VideoFrame.from_ndarray(_yuv420p(even), format="yuv420p"))
        self._written += 1

    def _mux(self, frame: Any) -> None:
        """Compress and store a frame, None those that are held back; what failed shows when they are counted."""
        with suppress(OSError):
            self._container.mux(self._stream.encode(frame))

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if self._container is not None:
            with suppress(OSError):
                self._mux(None)
                self._container.close()
        if error is not None:
            self._replacement.__exit__(kind, error, traceback)
            return
        with self._replacement:
            found = _count_whole(self._unfinished) if self._written else 0
            if found != self._written:
                raise OSError(f"{self._path}: {found} of {self._written} frames were written: is the disk full?")


def _yuv420p(image: Image) -> Image:
    """Planes of brightness and colour, below one another, of an image (height, width, 3) of even size, by BT.601.

    OpenCV's own planes of colour are of one in 2 x 2 pixels. These are of their mean: thin coloured lines do not
    flicker. FFmpeg's conversion takes twice as long.
    """
    import cv2

    planes = np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2YUV_I420), np.uint8)
    mean = cv2.resize(image, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    _, red, blue = cv2.split(cv2.cvtColor(mean, cv2.COLOR_BGR2YCrCb))
    colour = np.stack([blue, red]).reshape(-1, image.shape[1])
    planes[len(image) :] = cv2.convertScaleAbs(colour, alpha=COLOUR_RANGE, beta=128.0 * (1.0 - COLOUR_RANGE))
    return planes


def _count_whole(path: Path) -> int:
    """Number of frames that are whole in a file; 0 if it is no video."""
    import av

    try:
        with av.open(native_name(path)) as container:
            return sum(packet.size > 0 and not packet.is_corrupt for packet in container.demux(video=0))
    except av.FFmpegError:
        return 0
