"""Images of files or of a video, read one after the other."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from fieldcalib.console.arguments import MOST_BYTES_OF_IMAGE
from fieldcalib.console.inputs import Input
from fieldcalib.console.waiting import waiting_for
from fieldcalib.io.cuts import WHOLE, Cut
from fieldcalib.io.files import BrokenFileError, FrameFile, problem
from fieldcalib.io.formats import IMAGES, VIDEOS
from fieldcalib.io.image import Image
from fieldcalib.io.images import MOST_PIXELS
from fieldcalib.io.videos import FrameReader, VideoWriter
from fieldcalib.run_folder.annotated import name_skipped


@dataclass(frozen=True)
class Frame:
    """An image, or what is wrong with it."""

    id: str
    image: Image | None
    problem: str = ""
    path: Path | str = ""
    """Of its file, for messages."""
    is_of_video: bool = False
    line: str = ""
    """What is written of it already, if anything."""


@dataclass(frozen=True)
class Source:
    """Frames to be read one after the other."""

    files: Sequence[FrameFile]
    """Of images, or that of a video."""
    count: int
    """How many there are, of a video as its file says."""
    frames: Iterable[Frame] = ()
    """Of a video; images are read from their files where they are worked on."""
    frames_per_second: float | None = None
    """Of a video."""
    loss: Callable[[], str] = lambda: ""
    """What to say if some of them are not among `frames`, to be asked at the end."""


@dataclass(frozen=True)
class ReadImage:
    """Reads an image, whose `check` may raise a BrokenFileError; those of a video are read already."""

    most_bytes: float = MOST_BYTES_OF_IMAGE
    most_pixels: float = MOST_PIXELS
    check: Callable[[Image], object] | None = None

    def __call__(self, item: FrameFile | Frame) -> Frame:
        """The image, or what is wrong with it."""
        if isinstance(item, Frame):
            return item
        try:
            with waiting_for(item.path):
                content = item.read(self.most_bytes)
            image = IMAGES.read(content, self.most_pixels)
            if self.check is not None:
                self.check(image)
            return Frame(item.id, image, path=item.path)
        except (BrokenFileError, MemoryError) as error:
            return Frame(item.id, None, problem(error), item.path)


@contextmanager
def opened(
    inputs: Sequence[Path],
    most_pixels: float = MOST_PIXELS,
    *,
    check: Callable[[Image], object] = lambda image: None,
    cut: Cut = WHOLE,
    threads: int | None = None,
) -> Iterator[Source]:
    """The files of images, in folders and zips too, or the frames of one video.

    Raises
    ------
    FileNotFoundError, BrokenFileError, ValueError
        As `find_files`, `in_cut` and `VideoReader`, and as `check` for the frames of a video.
    """
    if not VIDEOS.recognises(inputs[0]):
        files = in_cut(image_files(inputs), cut)
        yield Source(files, len(files))
        return
    with VIDEOS.read(inputs[0], most_pixels, cut=cut, threads=threads) as video:
        frames = checked_frames(inputs[0], video, check)
        file = FrameFile(inputs[0].stem, inputs[0])
        yield Source([file], video.count, frames, video.frames_per_second, video.loss)


def image_files(inputs: Sequence[Path]) -> list[FrameFile]:
    """The files of images in folders and zips, and single ones; what else lies there is named on stderr."""
    files = IMAGES.find(inputs)
    name_skipped(inputs, files)
    return files


def in_cut(files: Sequence[FrameFile], cut: Cut) -> list[FrameFile]:
    """Those of some images that are in a cut.

    Raises
    ------
    ValueError
        If there is none, or the cut is one of times.
    """
    numbers = cut.numbers()
    found = list(files[numbers.start : numbers.stop : numbers.step])
    if not found:
        raise ValueError(f"there are {len(files)} images, the first that is asked for is {cut.start}")
    return found


def checked_frames(name: Input, reader: FrameReader, check: Callable[[Image], object]) -> Iterator[Frame]:
    """The frames of a video, whose ids are their numbers with six digits.

    What `check` raises a BrokenFileError for is said of the video's name.
    """
    frames = zip(reader.numbers, reader, strict=False)
    try:
        while True:
            with waiting_for(str(name)):
                number, image = next(frames, (0, None))
            if image is None:
                return
            check(image)
            yield Frame(f"{number:06d}", image, path=str(name), is_of_video=True)
    except BrokenFileError as error:
        raise BrokenFileError(f"{name}: {error}") from None


def frames_lost(source: Source) -> bool:
    """Whether frames were lost that the input announced; it is said on stderr."""
    loss = source.loss()
    if loss:
        print(f"fieldcalib: {loss}", file=sys.stderr)
    return bool(loss)


def say_note(path: Path, video: VideoWriter) -> None:
    """Say on stderr what is to be known about a video that was written, if anything."""
    if video.note:
        print(f"fieldcalib: {path} {video.note}", file=sys.stderr)


def broken_frames(frames: Iterable[Frame]) -> dict[str, str]:
    """What is wrong with the frames that could not be read, by id."""
    return {frame.id: frame.problem for frame in frames if frame.image is None}


def pixels_of(frame: Frame) -> int:
    """How many pixels are in memory."""
    return 0 if frame.image is None else frame.image.shape[0] * frame.image.shape[1]
