"""Images of files or of a video, read one after the other.

What an input is of: a video, a stream, or images; and whether its frames are calibrated together.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from fieldcalib._messages import say
from fieldcalib._progress import waiting_for
from fieldcalib.io.files import FrameFile, named_in_errors
from fieldcalib.io.formats import IMAGES, VIDEOS
from fieldcalib.io.frame_range import WHOLE, Cut, ends_before
from fieldcalib.io.image import Image, size_of
from fieldcalib.io.image_files import MOST_PIXELS
from fieldcalib.io.streams import Input, Stream
from fieldcalib.io.videos import FrameReader, VideoWriter
from fieldcalib.run_folder.frame_record import Outcome
from fieldcalib.run_folder.labelled_frames import name_skipped
from fieldcalib.run_folder.work_units import read_each

MOST_BYTES = 256_000_000  # of the file of an image

T = TypeVar("T")


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
    """The files that are read of images, or of one video: of a zip the zip itself."""
    if VIDEOS.recognises(inputs[0]):
        return list(inputs)
    return [file.on_disk for file in IMAGES.find(inputs)]


def videos_in(one: Input) -> list[Input]:
    """The videos of a folder that has videos and no images; otherwise the input itself."""
    if isinstance(one, Stream) or not one.is_dir():
        return [one]
    files = sorted(path for path in one.iterdir() if path.is_file())
    if any(map(IMAGES.recognises, files)):
        return [one]
    return [path for path in files if VIDEOS.recognises(path)] or [one]


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


@dataclass(frozen=True)
class Source:
    """Frames to be read one after the other."""

    files: Sequence[FrameFile]
    """Files of images, or the file of a video."""
    count: int
    """Number of frames; for a video the number that its file announces."""
    frames: Iterable[Frame] = ()
    """Frames of a video; images are read from their files by the processes that calibrate them."""
    frames_per_second: float | None = None
    """Frame rate of a video."""
    loss: Callable[[], str] = lambda: ""
    """Gives a message about announced frames that were not read; called at the end."""


def accepted(image: Image) -> None:
    """Accept any image: the default of checks."""


@dataclass(frozen=True)
class ReadImage:
    """Reads images of files; `check` may raise a BrokenFileError about one. Frames of a video pass through."""

    most_bytes: float = MOST_BYTES
    most_pixels: float = MOST_PIXELS
    check: Callable[[Image], object] = accepted

    def __call__(self, item: FrameFile | Frame) -> Frame:
        """Read the image of a file."""
        if isinstance(item, Frame):
            return item
        found, broken = read_each([item], self.image)
        return Frame(item.id, found.get(item.id), broken.get(item.id, ""), item.path)

    def image(self, file: FrameFile) -> Image:
        """The image of a file; a BrokenFileError or MemoryError if it cannot be read."""
        image = IMAGES.read(file.read(self.most_bytes), self.most_pixels)
        self.check(image)
        return image

    def sized(self, file: FrameFile, size: tuple[int, int] | None = None) -> tuple[Image, tuple[int, int]]:
        """The image of a file, and its size or another one that is given."""
        image = self.image(file)
        return image, size or size_of(image)


@contextmanager
def opened(
    inputs: Sequence[Path],
    most_pixels: float = MOST_PIXELS,
    *,
    check: Callable[[Image], object] = accepted,
    cut: Cut = WHOLE,
    threads: int | None = None,
) -> Iterator[Source]:
    """Open images in files, folders and zips, or the frames of one video.

    Raises
    ------
    FileNotFoundError, BrokenFileError, ValueError
        As `find_files`, `in_cut` and `VideoReader`, and as `check` for the frames of a video.
    """
    if not VIDEOS.recognises(inputs[0]):
        files = in_cut(image_files(inputs), cut, say)
        yield Source(files, len(files))
        return
    with VIDEOS.read(inputs[0], most_pixels, cut=cut, threads=threads) as video:
        if video.beyond:
            say(video.beyond)
        frames = checked_frames(inputs[0], video, check)
        file = FrameFile(inputs[0].stem, inputs[0])
        yield Source([file], video.count, frames, video.frames_per_second, video.loss)


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
        If there is none, or the cut is one of times.
    """
    numbers = cut.numbers()
    found = images[numbers.start : numbers.stop : numbers.step]
    if not found:
        raise ValueError(f"the input {ends_before(cut.start, len(images))}: there is no frame to begin with")
    if beyond := cut.beyond(len(images)):
        tell(f"the input {beyond}")
    return found


def ignored(message: str) -> None:
    """Tell nobody."""


def checked_frames(name: Input, reader: FrameReader, check: Callable[[Image], object]) -> Iterator[Frame]:
    """The frames of a video, whose ids are their numbers with six digits.

    A BrokenFileError of `check` gets the name of the video.
    """
    frames = reader.numbered()
    with named_in_errors(name):
        while True:
            with waiting_for(str(name)):
                number, image = next(frames, (0, None))
            if image is None:
                return
            check(image)
            yield Frame(f"{number:06d}", image, path=str(name), is_of_video=True)


def say_note(path: Path, video: VideoWriter) -> None:
    """Print the note of a video that was written, if it has one, on stderr."""
    if video.note:
        say(f"{path} {video.note}")


def outcomes_of(
    frames: Iterable[Frame], results: Iterable[T], outcome: Callable[[Frame, Image, T], Outcome]
) -> list[Outcome]:
    """The outcomes of frames, from results for those that could be read."""
    rest = iter(results)
    return [
        Outcome.broken(frame, frame.problem) if frame.image is None else outcome(frame, frame.image, next(rest))
        for frame in frames
    ]


def pixels_of(frame: Frame) -> int:
    """Number of pixels in memory."""
    return 0 if frame.image is None else frame.image.shape[0] * frame.image.shape[1]
