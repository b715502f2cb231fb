"""Animated WebP, which OpenCV reads, but not as a video (GIF it does)."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from fieldcalib.io.files import BrokenFileError
from fieldcalib.io.image import Image
from fieldcalib.io.image_files import stored_size

SUFFIX = ".webp"
HEAD = 21  # bytes, up to the flags of the extended header
ANIMATED = 2  # of these flags
AT_ONCE = 50  # frames that are decoded together


def is_animated_webp(path: Path) -> bool:
    """Whether a file is an animated WebP, by its name and its first bytes."""
    if path.suffix.lower() != SUFFIX or not path.is_file():
        return False
    try:
        with path.open("rb") as file:
            head = file.read(HEAD)
    except OSError:  # whoever reads it says what is wrong
        return False
    return len(head) == HEAD and head[8:16] == b"WEBPVP8X" and bool(head[20] & ANIMATED)


class Animation:
    """The frames of an animated WebP by those methods of cv2.VideoCapture that videos are read with.

    Raises
    ------
    BrokenFileError
        If OpenCV is older than 4.11, which reads no animations.
    """

    def __init__(self, path: Path) -> None:
        import cv2

        if not hasattr(cv2, "imreadanimation"):
            raise BrokenFileError(f"is an animated WebP, which OpenCV reads from 4.11 on: this is {cv2.__version__}")
        content = path.read_bytes()
        self._path, self._size = path, stored_size(content) or (0, 0)
        self._ends = np.cumsum([max(duration, 1) for duration in _durations(content)], dtype=float)  # milliseconds
        self._number, self._first, self._frames = -1, 0, list[Image]()

    def get(self, property: int) -> float:
        """A property of the video or of the frame that was grabbed last."""
        import cv2

        count = len(self._ends)
        return {
            cv2.CAP_PROP_FRAME_WIDTH: float(self._size[0]),
            cv2.CAP_PROP_FRAME_HEIGHT: float(self._size[1]),
            cv2.CAP_PROP_FRAME_COUNT: float(count),
            cv2.CAP_PROP_FPS: 1e3 / float(np.median(np.diff(self._ends, prepend=0.0))) if count else 0.0,
            cv2.CAP_PROP_POS_MSEC: float(self._ends[self._number - 1]) if self._number > 0 else 0.0,
            cv2.CAP_PROP_POS_FRAMES: self._number + 1.0,
        }.get(property, 0.0)

    def set(self, property: int, value: float) -> bool:
        """Go to a frame, so that it is the next one that is grabbed; other properties cannot be set."""
        import cv2

        if property != cv2.CAP_PROP_POS_FRAMES or not 0 <= value < len(self._ends):
            return False
        self._number = int(value) - 1
        return True

    def grab(self) -> bool:
        """Go on to the next frame; False at the end."""
        if self._number + 1 >= len(self._ends):
            return False
        self._number += 1
        return True

    def retrieve(self) -> tuple[bool, Image | None]:
        """The frame that was grabbed last, and whether it can be read."""
        import cv2

        if not self._first <= self._number < self._first + len(self._frames):
            self._first = self._number - self._number % AT_ONCE
            is_read, found = cv2.imreadanimation(str(self._path), start=self._first, count=AT_ONCE)
            self._frames = [np.asarray(frame[..., :3], np.uint8) for frame in found.frames] if is_read else []
        at = self._number - self._first
        return (True, np.ascontiguousarray(self._frames[at])) if at < len(self._frames) else (False, None)

    def release(self) -> None:
        """Forget the frames."""
        self._frames = []


def _durations(content: bytes) -> Iterator[int]:
    """Durations of the frames in milliseconds: 24 bits behind the position and the size of each, in its chunk."""
    position = 12
    while position + 8 <= len(content):
        kind, length = struct.unpack_from("<4sI", content, position)
        if kind == b"ANMF" and position + 24 <= len(content):
            yield int.from_bytes(content[position + 20 : position + 23], "little")
        position += 8 + length + length % 2
