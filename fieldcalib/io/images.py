"""Images and videos: found, read, and drawn pictures written.

Images are OpenCV's: uint8, (height, width, 3), blue, green, red, whatever depth and channels the file has; turned as
its EXIF data or its video's metadata say.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from fieldcalib.io.files import BrokenFileError, FrameFile, find_files, write_bytes
from fieldcalib.io.image import Image

IMAGES = (".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp")
VIDEOS = (".mp4", ".m4v", ".mov", ".mkv", ".avi", ".webm", ".ts", ".mpg", ".mpeg")
OVERLAY = "overlay_"  # what the names of our own pictures begin with
NOT_FRAMES = re.compile(rf"\.|{OVERLAY}")
JPEG, JPEG_SCAN, JPEG_END = b"\xff\xd8\xff", b"\xff\xda", b"\xff\xd9"


def find_images(inputs: Iterable[Path]) -> list[FrameFile]:
    """Image files of folders, zips and single files, in the order of their names.

    Raises
    ------
    FileNotFoundError
        If an input does not exist or holds no image.
    BrokenFileError
        If a zip is none, or two files would be the same frame.
    """
    return find_files(inputs, "image", suffix=IMAGES, others=NOT_FRAMES)


def is_video(path: Path) -> bool:
    """Whether a file's name is that of a video.

    Examples
    --------
    >>> is_video(Path("match.MP4")), is_video(Path("match.json"))
    (True, False)
    """
    return path.suffix.lower() in VIDEOS


def parse_image(content: bytes) -> Image:
    """The image in a file's content.

    Raises
    ------
    BrokenFileError
        If it is no image, or a JPEG that is cut off: its lower part would be grey.

    Examples
    --------
    >>> parse_image(b"no image")
    Traceback (most recent call last):
        ...
    fieldcalib.io.files.BrokenFileError: is no image that OpenCV can read
    """
    import cv2

    # in between there are only coded pixels, in which neither mark can occur
    if content.startswith(JPEG) and content.rfind(JPEG_END) < content.rfind(JPEG_SCAN):
        raise BrokenFileError("is cut off: the end of the JPEG is missing")
    try:
        image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR) if content else None
    except cv2.error:  # dimensions that no image has
        image = None
    if image is None:
        raise BrokenFileError("is no image that OpenCV can read")
    return np.asarray(image, dtype=np.uint8)


def write_image(path: Path, image: Image) -> None:
    """Write an image in the format of the path's suffix, whole or not at all."""
    import cv2

    write_bytes(path, cv2.imencode(path.suffix, image)[1].tobytes())


class VideoReader:
    """Frames of a video, one after the other; a context manager.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    BrokenFileError
        If it is no video, or has no frame.
    """

    count: int
    """Number of frames, as the file says: often right."""
    frames_per_second: float

    def __init__(self, path: Path) -> None:
        import cv2

        if not path.is_file():
            raise FileNotFoundError(f"{path} does not exist: expected a video")
        self._capture = cv2.VideoCapture(str(path))
        self._has_frame, self._frame = self._capture.read()
        if not self._has_frame:
            self._capture.release()
            raise BrokenFileError(f"{path}: is no video that OpenCV can read")
        self.count = max(int(self._capture.get(cv2.CAP_PROP_FRAME_COUNT)), 0)
        self.frames_per_second = float(self._capture.get(cv2.CAP_PROP_FPS)) or 25.0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self._capture.release()

    def __iter__(self) -> Iterator[Image]:
        while self._has_frame:
            yield np.asarray(self._frame, dtype=np.uint8)
            self._has_frame, self._frame = self._capture.read()


class VideoWriter:
    """An MP4 of images of one size, whole or not at all; a context manager."""

    def __init__(self, path: Path, frames_per_second: float) -> None:
        self._path, self._frames_per_second = path, frames_per_second
        self._unfinished = path.with_name(f".{path.name}")
        self._writer: Any = None

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

        if self._writer is None:
            size = (image.shape[1], image.shape[0])
            code = cv2.VideoWriter.fourcc(*"mp4v")  # the only codec for MP4 that every build of OpenCV has
            self._writer = cv2.VideoWriter(str(self._unfinished), code, self._frames_per_second, size)
            if not self._writer.isOpened():
                raise OSError(f"{self._path}: OpenCV cannot write an MP4 there")
        self._writer.write(image)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if self._writer is None:
            return
        self._writer.release()
        if kind is None:
            os.replace(self._unfinished, self._path)
        else:
            self._unfinished.unlink(missing_ok=True)
