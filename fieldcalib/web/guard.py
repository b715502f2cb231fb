"""Access control: only requests from pages of this server are answered.

Any web page that is open in the browser can send requests to this machine. Three checks keep pages of other sites out.
The address contains a secret token, which they do not know. The Host header must be a name of this machine or a numeric
address, which another site cannot take on by DNS rebinding. And the Origin header, by which browsers state where a
request comes from, must agree with the Host.

Starlette's middleware for hosts compares no ports, and cannot tell addresses from names.
"""

from __future__ import annotations

import asyncio
import hmac
import json
from collections.abc import Awaitable, Callable, Container, MutableMapping
from dataclasses import dataclass
from ipaddress import IPv6Address, ip_address
from typing import Any, TypeAlias

Message: TypeAlias = MutableMapping[str, Any]
Receive: TypeAlias = Callable[[], Awaitable[Message]]
Send: TypeAlias = Callable[[Message], Awaitable[None]]
Application: TypeAlias = Callable[[Message, Receive, Send], Awaitable[None]]

MOST_BYTES = 1_000_000  # largest body of a request
TAKES_PICTURES, MOST_OF_PICTURE = "/api/v1/calibrate", 64_000_000  # address that takes a larger body, and how large
LONGEST_PATH = 300  # characters
HTTP = 80  # the default port, which addresses leave out
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
HEADERS = (
    (b"content-security-policy", POLICY.encode()),
    (b"referrer-policy", b"no-referrer"),
    (b"x-content-type-options", b"nosniff"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"cache-control", b"no-store"),
)


@dataclass(frozen=True)
class Hosts:
    """The hosts by which a server may be called, in lower case as the Host header has them.

    Examples
    --------
    >>> hosts = Hosts(frozenset({"localhost"}), 8080, any_address=True)
    >>> "localhost:8080" in hosts, "192.168.1.5:8080" in hosts, "[::1]:8080" in hosts, "evil.example:8080" in hosts
    (True, True, True, False)
    """

    names: frozenset[str]
    """Names and addresses of the server."""
    port: int
    any_address: bool = False
    """Whether every numeric address is accepted, as the server listens at all addresses of the machine."""

    def __contains__(self, host: object) -> bool:
        name = str(host).removesuffix(f":{self.port}")
        if name == host and self.port != HTTP:
            return False
        return name in self.names or (self.any_address and _is_address(name))


def _is_address(host: str) -> bool:
    """Whether a host is a numeric address; IPv6 addresses are in brackets."""
    inner = host.removeprefix("[").removesuffix("]")
    try:
        return bracketed(str(ip_address(inner))) == host
    except ValueError:
        return False


def bracketed(host: str) -> str:
    """Format a host for an address: IPv6 addresses get brackets.

    Examples
    --------
    >>> bracketed("::1"), bracketed("127.0.0.1"), bracketed("localhost")
    ('[::1]', '127.0.0.1', 'localhost')
    """
    try:
        return f"[{host}]" if isinstance(ip_address(host), IPv6Address) else host
    except ValueError:
        return host


class Guard:
    """Passes requests on to an application only if they may be answered.

    Parameters
    ----------
    application : callable
        An ASGI application; it gets paths without the token.
    token : str
        The first part of the path of every address.
    hosts : container of str
        Hosts, with the port, by which this server may be called.
    """

    def __init__(self, application: Application, token: str, hosts: Container[str]) -> None:
        self._application = application
        self._token = token.encode()
        self._hosts = hosts
        self._answering: set[asyncio.Task[Any] | None] = set()
        self._is_ended = False

    async def __call__(self, scope: Message, receive: Receive, send: Send) -> None:
        """Answer a request."""
        if scope["type"] == "lifespan":
            await self._application(scope, receive, send)
            return
        if scope["type"] != "http":
            return
        refusal = self._refusal(scope)
        if refusal is not None:
            await _refuse(send, *refusal)
            return
        _, _, path = scope["path"].lstrip("/").partition("/")
        inner = {**scope, "path": f"/{path}", "raw_path": f"/{path}".encode(errors="replace"), "root_path": ""}
        task = asyncio.current_task()
        self._answering.add(task)
        try:
            await self._application(inner, _Body(receive, _most_bytes(scope)), _with_headers(send))
        except asyncio.CancelledError:
            if not self._is_ended:
                raise
            await _refuse(send, 503, "the page has ended")
        finally:
            self._answering.discard(task)

    def end(self) -> None:
        """Cancel the requests that are being answered, whose clients may be silent, or wait for long work."""
        self._is_ended = True
        for task in self._answering:
            if task is not None:
                task.cancel()

    def _refusal(self, scope: Message) -> tuple[int, str] | None:
        """Status and message for a request that is not answered."""
        headers = _headers(scope)
        host, origin = headers.get(b"host", b"").decode("latin-1").lower(), headers.get(b"origin")
        token, slash, _ = scope["path"].lstrip("/").partition("/")
        if host not in self._hosts:
            return 403, f"{host[:60]!r} is no host of this page: open the address that was printed"
        if not slash or not hmac.compare_digest(token.encode(errors="replace"), self._token):
            return 404, "there is nothing here: open the address that was printed, with all of its letters"
        if len(scope["path"]) > LONGEST_PATH:
            return 414, f"expected a path of at most {LONGEST_PATH} characters"
        if scope["method"] not in ("GET", "POST"):
            return 405, f"expected GET or POST, got {scope['method'][:20]}"
        if scope["method"] == "POST":
            return self._refused_post(headers, _most_bytes(scope))
        if origin is not None and not _is_own(origin, host):
            return 403, "requests from pages of other sites are not answered"
        return None

    @staticmethod
    def _refused_post(headers: dict[bytes, bytes], most: int) -> tuple[int, str] | None:
        host = headers[b"host"].decode("latin-1").lower()
        if not _is_own(headers.get(b"origin", b""), host):
            return 403, "requests from pages of other sites are not answered: give the header Origin of this page"
        kind = headers.get(b"content-type", b"").split(b";")[0].strip().lower()
        if kind != b"application/json" and not (kind.startswith(b"image/") and most > MOST_BYTES):
            return 415, "expected the header Content-Type, application/json or that of a picture, as image/jpeg"
        length = headers.get(b"content-length", b"0")
        if not length.isdigit() or int(length[:20]) > most:
            return 413, f"expected a body of at most {most} bytes"
        return None


def _most_bytes(scope: Message) -> int:
    return MOST_OF_PICTURE if scope["path"].endswith(TAKES_PICTURES) else MOST_BYTES


def _is_own(origin: bytes, host: str) -> bool:
    return origin.decode("latin-1").lower() == f"http://{host}"


class TooLargeError(ValueError):
    """Raised if the body of a request is too large."""


class _Body:
    """Receives the body of a request up to the largest size."""

    def __init__(self, receive: Receive, most: int) -> None:
        self._receive, self._most = receive, most
        self._count = 0

    async def __call__(self) -> Message:
        message = await self._receive()
        self._count += len(message.get("body", b""))
        if self._count > self._most:
            raise TooLargeError(f"expected a body of at most {self._most} bytes")
        return message


def _headers(scope: Message) -> dict[bytes, bytes]:
    """Headers of a request; a header that is given twice becomes empty, which every check refuses."""
    found: dict[bytes, bytes] = {}
    for name, value in scope["headers"]:
        found[name] = b"" if name in found else value
    return found


def _with_headers(send: Send) -> Send:
    async def sent(message: Message) -> None:
        if message["type"] == "http.response.start":
            given = {name.lower() for name, _ in message.get("headers", ())}
            more = [(name, value) for name, value in HEADERS if name not in given]
            message = {**message, "headers": [*message.get("headers", ()), *more]}
        await send(message)

    return sent


async def _refuse(send: Send, status: int, problem: str) -> None:
    body = json.dumps({"error": problem}).encode()
    headers = [(b"content-type", b"application/json"), (b"content-length", str(len(body)).encode()), *HEADERS]
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": body})
