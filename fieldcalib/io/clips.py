"""The frames of a clip, which are read more than once: a video, or the images of a folder or a zip.

Images are in the order of the numbers in their names, and of one size.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path

import numpy as np

from fieldcalib._types import file_path
from fieldcalib.io.files import FrameFile, named_in_errors
from fieldcalib.io.formats import IMAGES
from fieldcalib.io.image_files import Image, size_of
from fieldcalib.io.videos import VideoReader


def clip_reader(source: object) -> Callable[[], AbstractContextManager[Iterable[Image]]]:
    """Make a function that opens a clip: a video, a folder or zip of images, or the images themselves.

    Raises
    ------
    ValueError
        If it is none of these; an iterator can be read once only.
    FileNotFoundError, BrokenFileError
        As `find_files` of a folder or a zip, and as `VideoReader` when a video is opened.
    """
    if isinstance(source, str | os.PathLike):
        path = file_path(source, "a video or of a folder of images")
        if path.is_dir() or path.suffix.lower() == ".zip":
            images = ImageFiles(path)
            return lambda: nullcontext(images)
        return lambda: VideoReader(path)
    if isinstance(source, np.ndarray) and source.ndim < 4:
        raise ValueError(f"expected the images of a clip, got one array of shape {source.shape}: give [image]")
    if isinstance(source, Iterator):
        raise ValueError("expected a path or a sequence of images, got an iterator: the frames are read twice")
    if not isinstance(source, Iterable):
        raise ValueError(
            f"expected the path of a video or of a folder of images, or a sequence of images, got {source!r}"
        )
    return lambda: nullcontext(source)


class ImageFiles:
    """The images of a folder or a zip; a broken image raises a BrokenFileError that names it."""

    def __init__(self, path: Path) -> None:
        self._files = in_order(IMAGES.find([path]))

    def __iter__(self) -> Iterator[Image]:
        one_size = OneSize()
        for file in self._files:
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
