"""Videos that can be read only once: standard input and URLs."""

from __future__ import annotations

import re
from dataclasses import dataclass

from fieldcalib.io.cuts import WHOLE, Cut
from fieldcalib.io.files import BrokenFileError
from fieldcalib.io.images import MOST_PIXELS
from fieldcalib.io.videos import NO_VIDEO, FrameReader

STDIN = "-"
URL = re.compile(r"([a-z][a-z0-9+.-]*)://(?:[^/@]*@)?(.+)", re.IGNORECASE)
WAITING = ("http", "https")  # schemes of servers that wait for the reader
STREAMABLE = "Matroska and MPEG-TS can be streamed, MP4 if its index comes first (ffmpeg -movflags faststart)"


@dataclass(frozen=True)
class Stream:
    """The source of a stream: ``-`` for standard input, or a URL that FFmpeg knows, as ``rtsp://host/path``."""

    location: str

    @staticmethod
    def recognises(text: str) -> bool:
        """Whether a text names a stream.

        Examples
        --------
        >>> [Stream.recognises(text) for text in ("-", "rtsp://host/live", "clip.mp4")]
        [True, True, False]
        """
        return text == STDIN or URL.fullmatch(text) is not None

    def __str__(self) -> str:
        """Format for messages, without user and password."""
        if self.location == STDIN:
            return "standard input"
        found = URL.fullmatch(self.location)
        return self.location if found is None else f"{found[1]}://{found[2]}"

    @property
    def name(self) -> str:
        """Name for a folder.

        Examples
        --------
        >>> Stream("-").name, Stream("rtsp://user:word@host:554/live/1?low").name
        ('stdin', 'host_554_live_1_low')
        """
        if self.location == STDIN:
            return "stdin"
        return re.sub(r"[^\w.-]+", "_", str(self).partition("://")[2]).strip("_")

    @property
    def is_live(self) -> bool:
        """Whether the source is live: frames that are not read in time are dropped."""
        found = URL.fullmatch(self.location)
        return found is not None and found[1].lower() not in WAITING


class StreamReader(FrameReader):
    """Frames of a stream, one after the other; a context manager.

    It ends with the last frame that arrives: FFmpeg does not tell a finished stream from an interrupted one.

    Raises
    ------
    BrokenFileError, ValueError
        As for a `FrameReader`. MP4 with its index at the end cannot be streamed; Matroska and MPEG-TS can.
    """

    def __init__(
        self, stream: Stream, most_pixels: float = MOST_PIXELS, *, cut: Cut = WHOLE, threads: int | None = None
    ) -> None:
        self._stream = stream
        location = "pipe:0" if stream.location == STDIN else stream.location
        try:
            super().__init__(location, str(stream), most_pixels, cut, threads)
        except BrokenFileError as error:
            if NO_VIDEO not in str(error):
                raise
            raise BrokenFileError(f"{error}; {STREAMABLE}") from None

    def end(self) -> str:
        """Message if the stream ended before its cut; empty otherwise."""
        return f"{self._stream}: no more frames after {len(self._times)}" * (len(self._times) < len(self.numbers))
