"""What an input is of: a video, a stream, or images; and whether its frames are calibrated together."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TypeVar

from fieldcalib._messages import say
from fieldcalib.io.formats import IMAGES, VIDEOS
from fieldcalib.io.image import Image
from fieldcalib.io.streams import Input, Stream
from fieldcalib.io.videos import VideoWriter
from fieldcalib.run_folder.frame_record import Outcome
from fieldcalib.run_folder.frame_source import Frame

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
