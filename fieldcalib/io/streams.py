"""Videos that can be read only once, standard input and URLs, and receivers of their cameras."""

from __future__ import annotations

import json
import re
import socket
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from reprlib import repr as short
from types import MappingProxyType
from typing import Any, Self, TypeAlias
from urllib.parse import urlsplit

from fieldcalib.geometry.camera import Camera
from fieldcalib.io.decoders import NO_VIDEO, AvDecoder, check_av
from fieldcalib.io.exports.freed import freed_packet
from fieldcalib.io.files import BrokenFileError
from fieldcalib.io.frame_range import WHOLE, Cut
from fieldcalib.io.image_files import MOST_PIXELS
from fieldcalib.io.results import split_line
from fieldcalib.io.videos import FrameReader

STDIN = "-"
# A password may have @ and /: what follows "name:" up to the last @ is one, unless it begins as a port does.
URL = re.compile(r"([a-z][a-z0-9+.-]*)://(?:[^/]*@|[^/:@?#]+:(?!\d*(?:/|$)).*@)?(.+)", re.IGNORECASE)
WAITING = ("http", "https")  # schemes of servers that wait for the reader
SECRET = re.compile(r"(?<=[?&])(?P<name>(?:pass\w*|pwd|token|key|secret|auth|sig\w*)=)[^&#]*", re.IGNORECASE)
PORTS: Mapping[str, int] = MappingProxyType({"http": 80, "https": 443, "rtsp": 554, "rtsps": 322, "rtmp": 1935})
"""Usual ports of schemes whose servers listen for connections by TCP."""
ANSWER = 5.0  # seconds in which a server must answer to count as reachable
NO_ANSWER = "is the address right, does the server run, and can this machine reach it (network, VPN, firewall)?"
NO_STREAM = (
    "answers, but sends no video that can be read: are the path of the address, the user and the password right?"
)
LINES, FREED = "json", "freed"  # schemes of receivers
STREAMABLE = "Matroska and MPEG-TS can be streamed, MP4 if its index comes first (ffmpeg -movflags faststart)"


@dataclass(frozen=True)
class Stream:
    """The source of a stream: ``-`` for standard input, or a URL that FFmpeg knows, as ``rtsp://host/path``."""

    location: str = field(repr=False)

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
        """Format for messages, without user, password and keys.

        Examples
        --------
        >>> str(Stream("rtsp://user:p@ss@host:554/live?token=123&low"))
        'rtsp://host:554/live?token=...&low'
        """
        if self.location == STDIN:
            return "standard input"
        found = URL.fullmatch(self.location)
        return SECRET.sub(r"\g<name>...", self.location if found is None else f"{found[1]}://{found[2]}")

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


Input: TypeAlias = Path | Stream
"""The path of a file or a folder, or a stream."""


def why_closed(stream: Stream) -> str:
    """Reason and advice for a URL that cannot be opened, without user and password.

    Its server is asked for a connection, where that is one by TCP: a wrong name, a network that does not reach it and
    a server without such a stream are told apart.

    Examples
    --------
    >>> why_closed(Stream("udp://:1234"))
    'is the address right, does the server run, and can this machine reach it (network, VPN, firewall)?'
    """
    try:
        parts = urlsplit(stream.location)
        port = parts.port or PORTS.get(parts.scheme.lower())
    except ValueError:
        return f"expected an address as rtsp://host:554/path: {NO_ANSWER}"
    if parts.hostname is None or port is None:
        return NO_ANSWER
    try:
        socket.create_connection((parts.hostname, port), timeout=ANSWER).close()
    except socket.gaierror:
        return f"the name {parts.hostname} is not known: {NO_ANSWER}"
    except OSError as error:
        return f"nothing answers at {parts.hostname}, port {port} ({error.strerror or error}): {NO_ANSWER}"
    return f"{parts.hostname} {NO_STREAM} If they are: {STREAMABLE}"


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
        check_av("streams are read")
        location = "pipe:0" if stream.location == STDIN else stream.location
        try:
            super().__init__(AvDecoder(location, threads), str(stream), most_pixels, cut)
        except BrokenFileError as error:
            if NO_VIDEO not in str(error):
                raise
            if stream.location == STDIN:
                raise BrokenFileError(f"{stream}: {NO_VIDEO}; {STREAMABLE}") from None
            raise BrokenFileError(f"{stream} cannot be opened: {why_closed(stream)}") from None

    def end(self) -> str:
        """Message if the stream ended before its cut; empty otherwise."""
        return f"{self._stream}: no more frames after {self._read}" * (self._read < len(self.numbers))


class Receiver:
    """A program that gets the camera of each frame by UDP, and for which nothing waits; a context manager.

    Parameters
    ----------
    address : str
        ``json://HOST:PORT`` for lines of ``cameras.jsonl``, ``freed://HOST:PORT`` for FreeD packets
        (`fieldcalib.io.exports.freed`).

    Raises
    ------
    ValueError
        If it is no such address, or its name is not known.

    Examples
    --------
    >>> with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as program:
    ...     program.bind(("127.0.0.1", 0))
    ...     with Receiver(f"json://127.0.0.1:{program.getsockname()[1]}") as receiver:
    ...         receiver.send({"id": "000000", "verdict": "reject"}, None)
    ...     program.recv(1000)
    b'{"id": "000000", "verdict": "reject"}'
    """

    def __init__(self, address: str) -> None:
        try:
            parts = urlsplit(address)
            self._format, host, port = parts.scheme, parts.hostname, parts.port if not any(parts[2:]) else None
        except ValueError:
            host = port = None
        if not (host and port and self._format in (LINES, FREED)):
            expected = f"{FREED}://192.168.1.20:40000 or {LINES}://192.168.1.20:40001"
            raise ValueError(f"expected the address of a receiver as {expected}, got {short(address)}")
        try:
            family, kind, protocol, _, place = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
        except socket.gaierror:
            raise ValueError(f"the name {host} of the receiver {address} is not known") from None
        self._address, self._to, self._lost = address, place, Counter[str]()
        self._socket = socket.socket(family, kind, protocol)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self._socket.close()

    def send(self, line: Mapping[str, Any], camera: Camera | None) -> None:
        """Send the line of a frame, or its camera, if there is one; what cannot be sent is lost."""
        try:
            if self._format == LINES:
                self._socket.sendto(json.dumps(split_line(line)[0]).encode(), self._to)
            elif camera is not None:
                self._socket.sendto(freed_packet(camera), self._to)
        except (OSError, ValueError) as error:  # of the network, or of a camera that FreeD cannot hold
            self._lost[str(error)] += 1

    @property
    def loss(self) -> str:
        """Message about frames that could not be sent; empty if there are none."""
        count, reasons = self._lost.total(), "; ".join(self._lost)
        return f"{count} frames could not be sent to {self._address}: {reasons}" if count else ""
