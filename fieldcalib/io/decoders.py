"""Decoders of videos: frames as they are shown, each with its number and its image.

PyAV's where it can be imported, otherwise OpenCV's; Pillow's for animated WebP, which FFmpeg does not read.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import chain, repeat
from pathlib import Path
from typing import Any, cast

import numpy as np

from fieldcalib.io.files import BrokenFileError, FrameFile
from fieldcalib.io.image_files import Image

DEFAULT_RATE = 25.0  # frames per second, where the file says nothing
FASTEST = 1000.0  # frames per second: larger frame rates are errors of the file
IRREGULAR = 0.1  # relative deviation of the time between two frames from the frame rate: some files round to 1 ms
LEAST_MISSING = 1.5  # frames between the last one and the end that the file states: durations are rounded
MOST_DAMAGED = 250  # frames in a row, ten seconds: behind more of them nothing is looked for
LONGEST_WAIT = 20.0  # seconds for a source that sends nothing more
EARLIER = (0.0, 1.0, 10.0)  # seconds: a search may lead too far, and some streams need frames to recover
MP4 = "mov"  # FFmpeg's name of its format
VP8_SHOWN = 16
NO_VIDEO = "is no video that FFmpeg can read, or its end is missing"

WEBP_HEAD, ANIMATED = 21, 2  # bytes up to the flags of the extended header, one of these flags


class Decoder(ABC):
    """Frames of a video, from any one on."""

    rate = DEFAULT_RATE
    """Frames per second, on average."""
    size = (0, 0)
    """Width and height of the frames before they are turned."""
    count = 0
    """Number of frames that the file announces; 0 if it does not."""
    times: Sequence[float] = ()
    """Seconds of all frames from the first; empty if they are not known before they are decoded."""
    keys: Sequence[int] = ()
    """Numbers of frames where decoding may begin."""
    pixel_aspect = 1.0
    """Width of a pixel as shown, in heights."""
    is_interlaced = False
    """Whether a frame that was decoded shows two fields."""
    seconds: float | None = None
    """Time stamp of the frame that was decoded last; None without one."""

    @abstractmethod
    def frames(self, start: int = 0) -> Iterator[tuple[int, Callable[[], Image]]]:
        """Decode the frames from a number on: their numbers, and functions that make their images, one at a time.

        Frames that cannot be decoded are left out, and those after them keep their numbers.
        """

    def close(self) -> None:  # noqa: B027 - OpenCV and Pillow close their files themselves
        """Close the file."""


def file_decoder(path: Path, location: str, threads: int | None = None) -> Decoder:
    """Open the file of a video; `location` is its name for FFmpeg.

    Raises
    ------
    BrokenFileError
        If it is no video; the message begins without its name.
    """
    if is_animated_webp(path):
        return WebPDecoder(path)
    if not has_av():
        return OpenCVDecoder(location, threads)
    state = path.stat()
    return AvDecoder(location, threads, index_of(location, state.st_size, state.st_mtime_ns))


def has_av() -> bool:
    """Whether PyAV can be imported: it has wheels for most platforms, not for all."""
    try:
        import av  # noqa: F401
    except ImportError:
        return False
    return True


def check_av(user: str) -> None:
    """Raise an ImportError with the remedy if PyAV cannot be imported; `user` is what is done by it."""
    if not has_av():
        raise ImportError(f"{user} by PyAV, which cannot be imported here: pip install av")


@dataclass(frozen=True)
class Index:
    """What the packets of a file tell, without decoding them."""

    shown: Sequence[int]
    """Times of the frames in units of the stream, in order; empty unless each packet is a frame with its time."""
    keys: Sequence[int]
    """Numbers of the frames where decoding may begin."""
    rate: float
    count: int
    """Number of frames: those that the file announces, if some of them are missing."""


@lru_cache(maxsize=4)
def index_of(location: str, *state: int) -> Index:
    """Read the packets of a file; `state` changes with its content. A BrokenFileError if it is no video."""
    container, stream = _opened(location)
    with container:
        frames, decoded, ends = list[tuple[int, bool]](), list[int](), dict[Any, int]()
        for packet in _packets(container):
            of, pts = packet.stream, packet.pts
            if pts is not None:
                ends[of] = max(ends.get(of, pts), pts + (packet.duration or 0))
            if of is stream and _is_shown(packet):
                frames.append((pts, packet.is_keyframe))
                decoded.append(packet.dts or 0)
        rate = _rate_of(stream)
        shown = [] if any(pts is None for pts, _ in frames) else sorted(frames)
        times = [pts for pts, _ in shown]
        if len(set(times)) < len(times) or decoded != sorted(decoded):  # no packets of single frames, or times jump
            shown, times = [], []
        stated = (container.duration or 0) / 1e6
        if not times:
            return Index([], [], rate, round(stated * rate) or len(frames))
        keys = [number for number, (_, is_key) in enumerate(shown) if is_key]
        steps, is_mp4 = np.diff(times) * float(stream.time_base), container.format.name.startswith(MP4)
        is_regular = not len(steps) or abs(np.median(steps) * rate - 1.0) <= IRREGULAR
        if not is_regular:
            rate = _usual(1.0 / float(np.mean(steps)))
        end = max(pts * float(of.time_base) for of, pts in ends.items())
        missing = (stated + (container.start_time or 0) / 1e6 * is_mp4 - end) * rate
        count = len(times) + (round(missing) if missing > LEAST_MISSING else 0)
        if is_regular and not is_mp4:  # whose gaps between frames are meant
            count = max(count + int(np.sum(np.rint(steps[steps * rate > 1.5] * rate) - 1.0)), stream.frames)
        return Index(times, keys, rate, count)


def _is_shown(packet: Any) -> bool:
    """Whether a packet is a frame that is shown: not one hidden by an edit list, or by VP8 (a bit of its header)."""
    return not packet.is_discard and (packet.stream.codec.name != "vp8" or bool(bytes(packet)[0] & VP8_SHOWN))


def _usual(rate: float) -> float:
    """The frame rate of a file, or the default if it states none that can be."""
    return rate if 0.0 < rate <= FASTEST else DEFAULT_RATE


def _rate_of(stream: Any) -> float:
    return _usual(float(stream.average_rate or stream.guessed_rate or 0.0))


def _opened(location: str, **options: Any) -> tuple[Any, Any]:
    """Open a container; returns it and its main video."""
    import av

    with suppress(av.FFmpegError, UnicodeEncodeError):
        container = av.open(location, metadata_errors="replace", **options)
        stream = container.streams.best("video")
        if stream is not None and stream.codec_context is not None:
            return container, stream
        container.close()
    raise BrokenFileError(NO_VIDEO)


def _packets(container: Any, *streams: Any) -> Iterator[Any]:
    """The packets of a container as long as there are any; FFmpeg goes on behind damage when it is asked again."""
    import av

    for _ in range(MOST_DAMAGED):
        try:
            for packet in container.demux(*streams):
                if packet.size:  # the last one has none
                    yield packet
            return
        except av.error.ExitError:  # nothing comes any more
            return
        except av.FFmpegError:
            continue


class AvDecoder(Decoder):
    """PyAV's: exact times, and jumps to any frame, if there is an index of the packets."""

    def __init__(self, location: str, threads: int | None, index: Index | None = None) -> None:
        from av.video.reformatter import VideoReformatter

        self._location, self._threads, self._reformatter = location, threads, VideoReformatter()
        waiting = {"timeout": LONGEST_WAIT, "options": {"rtsp_flags": "prefer_tcp"}}
        self._options = waiting if index is None else {}
        self._open()
        index = index or Index([], [], _rate_of(self._stream), 0)
        self.size, self._unit = (self._stream.width, self._stream.height), float(self._stream.time_base)
        self.rate, self.count, self.keys, self._shown = index.rate, index.count, index.keys, index.shown
        self.times = [(pts - index.shown[0]) * self._unit for pts in index.shown]
        self._numbers = {pts: number for number, pts in enumerate(index.shown)}
        self.pixel_aspect = float(self._stream.sample_aspect_ratio or 1.0)

    def _open(self) -> None:
        (self._container, self._stream), self._is_new = _opened(self._location, **self._options), True
        self._stream.thread_type = "AUTO"
        self._stream.codec_context.thread_count = self._threads or 0  # 0: as many as there are cores

    def close(self) -> None:
        """Close the file."""
        self._container.close()

    def frames(self, start: int = 0) -> Iterator[tuple[int, Callable[[], Image]]]:
        """Decode the frames from a number on."""
        if self._shown and start >= len(self._shown):
            return
        for packets in self._ways(start):
            found = self._decoded(packets)
            first = next((one for one in found if one[0] >= start), None)
            if first is not None and first[0] == start:
                break
        if first is not None:
            yield first
            yield from found

    def _ways(self, start: int) -> Iterator[Iterator[Any]]:
        """Packets from which a frame can be decoded: from a key on, from earlier ones; all, if none can be found."""
        import av

        key, is_found = bisect_right(self.keys, start) - 1, False
        for earlier in EARLIER if key > 0 else ():
            self._is_new, place = False, self._shown[self.keys[key]] - round(earlier / self._unit)
            with suppress(av.FFmpegError):  # where it cannot be searched
                self._container.seek(place, stream=self._stream)
                packets = _packets(self._container, self._stream)
                first = next((packet for packet in packets if packet.is_keyframe), None)
                # frames shown before a key but decoded after it may need frames before it
                if first is not None and first.pts <= self._shown[start]:
                    is_found = True
                    yield chain([first], packets)
        if not is_found:
            if not self._is_new:
                self.close()
                self._open()
            self._is_new = False
            yield _packets(self._container, self._stream)

    def _decoded(self, packets: Iterable[Any]) -> Iterator[tuple[int, Callable[[], Image]]]:
        """Decode packets; the times of frames tell their numbers, or they are counted, those with errors too."""
        import av

        number = -1
        for packet in chain(packets, repeat(None, MOST_DAMAGED)):  # None: the frames that are held back
            try:
                found = self._stream.codec_context.decode(packet)
            except EOFError:
                return
            except av.FFmpegError:
                number += 1
                continue
            if packet is None and not found:
                return
            for frame in found:
                number = self._numbers.get(frame.pts, number) if self._shown else number + 1
                self.seconds = None if frame.pts is None else round(frame.pts * self._unit, 6)
                self.is_interlaced = self.is_interlaced or frame.interlaced_frame
                yield number, partial(self._image, frame)

    def _image(self, frame: Any) -> Image:
        image = cast(Image, self._reformatter.reformat(frame, format="bgr24", threads=1).to_ndarray())
        turns = round(frame.rotation / 90.0) % 4
        return np.ascontiguousarray(np.rot90(image, turns)) if turns else image


class OpenCVDecoder(Decoder):
    """OpenCV's, where PyAV cannot be imported: to go back it begins anew."""

    def __init__(self, location: str, threads: int | None) -> None:
        import cv2

        self._given = location, cv2.CAP_ANY, [] if threads is None else [cv2.CAP_PROP_N_THREADS, threads]
        get = cv2.VideoCapture(*self._given).get
        self.size = int(get(cv2.CAP_PROP_FRAME_WIDTH)), int(get(cv2.CAP_PROP_FRAME_HEIGHT))
        self.rate, self.count = _usual(get(cv2.CAP_PROP_FPS)), max(int(get(cv2.CAP_PROP_FRAME_COUNT)), 0)

    def frames(self, start: int = 0) -> Iterator[tuple[int, Callable[[], Image]]]:
        """Decode the frames from a number on."""
        import cv2

        capture = cv2.VideoCapture(*self._given)
        number = damaged = 0
        while damaged < MOST_DAMAGED:
            if not capture.grab():  # as at a damaged frame, behind which it goes on when it is asked again
                damaged += 1
                continue
            number, damaged = number + damaged, 0
            if number >= start:
                yield number, lambda: np.asarray(capture.retrieve()[1], np.uint8)
            number += 1


class WebPDecoder(Decoder):
    """Pillow's, for animated WebP."""

    def __init__(self, path: Path) -> None:
        from PIL import Image as pillow

        try:
            self._picture = cast(Any, pillow.open(path))
            self.size, self.count = self._picture.size, self._picture.n_frames
            durations = [self._frame(number).info.get("duration") or 1 for number in range(self.count)]  # milliseconds
        except (OSError, ValueError, pillow.DecompressionBombError):
            raise BrokenFileError(NO_VIDEO) from None
        self.times = [0.0, *(np.cumsum(durations[:-1]) / 1e3).tolist()]
        self.keys, self.rate = range(self.count), _usual(1e3 / float(np.median(durations)))

    def frames(self, start: int = 0) -> Iterator[tuple[int, Callable[[], Image]]]:
        """Decode the frames from a number on."""
        for number in range(start, self.count):
            yield number, partial(self._image, number)

    def _image(self, number: int) -> Image:
        return np.ascontiguousarray(np.asarray(self._frame(number).convert("RGB"))[..., ::-1])

    def _frame(self, number: int) -> Any:
        self._picture.seek(number)
        self._picture.load()
        return self._picture


def is_animated_webp(path: Path) -> bool:
    """Whether a file is an animated WebP, by its name and its first bytes."""
    if path.suffix.lower() != ".webp" or not path.is_file():
        return False
    head = FrameFile(path.stem, path).read_beginning(WEBP_HEAD)
    return len(head) == WEBP_HEAD and head[8:16] == b"WEBPVP8X" and bool(head[20] & ANIMATED)
