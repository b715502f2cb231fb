"""Encoders of videos: H.264, which browsers play, if an encoder for it is installed.

PyAV's wheels bring x264. OpenCV uses what its build and the system have; its wheels for Linux write MPEG-4 part 2,
which browsers do not play, and VP9, which takes 50 times as long.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path
from typing import Any, Protocol, cast

from fieldcalib._extras import how_to_install
from fieldcalib.io.files import native_name
from fieldcalib.io.image import Image

X264 = "libx264"
# Half of the time of "superfast", with files 15 to 40 % larger and as good (1280 x 720: 8 ms of one core and 27 kB).
X264_OPTIONS = {"preset": "ultrafast", "crf": "20", "x264-params": "cabac=1:8x8dct=1:partitions=i4x4,i8x8"}
BT709_PRIMARIES, BT709_CURVE, BT601 = 1, 1, 6  # H.264's numbers; FFmpeg makes YUV by BT.601, whatever the size
H264, MPEG4 = "avc1", "mp4v"  # as OpenCV calls them; every build of it has the second
NOT_IN_BROWSERS = f"is MPEG-4 part 2, which browsers do not play; for H.264: {how_to_install('video')}"


class Encoder(Protocol):
    """Writes the frames of a video, all of one size with even sides, to its file."""

    note: str
    """Note about the file for the user, to follow its name; may be empty."""

    def write(self, image: Image) -> None:
        """Append a frame."""

    def close(self) -> None:
        """Finish the file. An encoder does not say whether every frame is in it: the disk may be full."""


def open_encoder(path: Path, frames_per_second: float, size: tuple[int, int], threads: int | None = None) -> Encoder:
    """The best encoder that is installed, for frames of a size (width, height), both even.

    `threads` is for H.264, by default as many as there are cores; MPEG-4 takes one.

    Raises
    ------
    OSError
        If no video can be written there.
    """
    if _has_x264():
        return X264Encoder(path, frames_per_second, size, threads)
    return OpenCVEncoder(path, frames_per_second, size)


class X264Encoder:
    """H.264 by PyAV; the index comes first in the file, so that browsers need not load all of it to begin."""

    note = ""

    def __init__(self, path: Path, frames_per_second: float, size: tuple[int, int], threads: int | None) -> None:
        import av

        self._container = av.open(native_name(path), "w", options={"movflags": "faststart"})
        rate = Fraction(frames_per_second).limit_denominator(100_000)
        self._stream = cast(Any, self._container.add_stream(X264, rate=rate, options=X264_OPTIONS))
        self._stream.width, self._stream.height = size
        self._stream.pix_fmt = "yuv420p"
        context = self._stream.codec_context
        context.thread_count = threads or 0  # 0: as many as there are cores
        context.color_primaries, context.color_trc, context.colorspace = BT709_PRIMARIES, BT709_CURVE, BT601
        self._full = False

    def write(self, image: Image) -> None:
        """Append a frame."""
        import av

        # unlike OpenCV's conversion this one takes the mean colour of 2 x 2 pixels: thin coloured lines do not flicker
        self._mux(av.VideoFrame.from_ndarray(image, format="bgr24").reformat(format="yuv420p"))

    def close(self) -> None:
        """Finish the file."""
        self._mux(None)
        try:
            self._container.close()
        except OSError:
            self._full = True

    def _mux(self, frame: Any) -> None:
        """Compress and store a frame; None stores the frames that are held back. Does nothing once the disk is full."""
        if self._full:
            return
        try:
            self._container.mux(self._stream.encode(frame))
        except OSError:
            self._full = True


class OpenCVEncoder:
    """H.264 where this build of OpenCV writes it, otherwise MPEG-4 part 2."""

    def __init__(self, path: Path, frames_per_second: float, size: tuple[int, int]) -> None:
        import cv2

        def opened(code: str) -> Any:
            return cv2.VideoWriter(native_name(path), cv2.VideoWriter.fourcc(*code), frames_per_second, size)

        with _no_messages():
            self._writer = opened(H264)
        self.note = "" if self._writer.isOpened() else NOT_IN_BROWSERS
        if self.note:
            self._writer = opened(MPEG4)
        if not self._writer.isOpened():
            raise OSError("OpenCV cannot write an MP4 there")

    def write(self, image: Image) -> None:
        """Append a frame."""
        self._writer.write(image)

    def close(self) -> None:
        """Finish the file."""
        self._writer.release()


def _has_x264() -> bool:
    """Whether PyAV is installed, and was built with x264."""
    try:
        import av
    except ModuleNotFoundError:
        return False
    return X264 in av.codecs_available


@contextmanager
def _no_messages() -> Iterator[None]:
    """Silence stderr for libraries in C, which print long messages there."""
    try:
        kept = os.dup(2)
    except OSError:  # it is closed
        yield
        return
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)
