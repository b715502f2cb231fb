"""Server for the page of an editor on this machine, until Ctrl-C."""

from __future__ import annotations

import asyncio
import errno
import secrets
import socket
import webbrowser
from ipaddress import ip_address
from threading import Timer
from typing import Any

from fieldcalib._extras import imported
from fieldcalib._interrupts import Terminated
from fieldcalib.editor.editor import Editor
from fieldcalib.web.guard import Guard, Hosts, bracketed

LOCAL = ("127.0.0.1", "localhost")
BROWSER_AFTER = 0.2  # seconds after which the browser is opened
ENDING = 1.0  # seconds in which requests may be answered at the end
LARGEST_PORT = 65_535
# addresses reserved for documentation; a socket is connected to one to learn its own address, but nothing is sent
ELSEWHERE = {socket.AF_INET: "192.0.2.1", socket.AF_INET6: "2001:db8::1"}


def serve(editor: Editor, *, host: str = LOCAL[0], port: int = 0, browser: bool = True, frame: int = 0) -> None:
    """Serve the page of an editor until it is interrupted; prints its address.

    Parameters
    ----------
    editor : Editor
    host : str
        The address or name of this machine to listen at; ``0.0.0.0`` or ``::`` for all its addresses.
    port : int
        The port of the address; 0 for a free one.
    browser : bool
        Whether the page is opened.
    frame : int
        Number of the frame that is shown first.

    Raises
    ------
    ImportError
        If the extra ``web`` is not installed.
    ValueError
        If the host is not known, or there is no such port.
    OSError
        If the port is taken, or the host is another machine.
    """
    imported("uvicorn", "web", "the page")
    imported("starlette", "web", "the page")
    from fieldcalib.web.page import Page

    with _listening(host, port) as listening:
        bound, port = listening.getsockname()[:2]
        is_anywhere = ip_address(bound).is_unspecified
        names = frozenset(map(bracketed, (*LOCAL, bound, host.lower())))
        shown = _own_address(listening) if is_anywhere else host
        address = f"http://{bracketed(shown)}:{port}/{(token := secrets.token_urlsafe(24))}/"
        address += f"#{frame}" if frame else ""
        page = Page(editor)
        try:
            print(f"{address}\nCtrl-C ends it", flush=True)
            if browser:
                Timer(BROWSER_AFTER, webbrowser.open, [address]).start()
            _run(page.application(token, Hosts(names, port, any_address=is_anywhere)), listening)
        except Terminated:
            raise
        except KeyboardInterrupt:  # the way to end it
            pass
        finally:
            page.close()


def _listening(host: str, port: int) -> socket.socket:
    """Open a socket that listens at a host; at ``::`` for IPv4 too, if the system supports it."""
    if not 0 <= port <= LARGEST_PORT:
        raise ValueError(f"expected a port from 0 to {LARGEST_PORT}, got {port}")
    try:
        family, *_, place = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)[0]
    except (socket.gaierror, UnicodeError) as error:
        raise ValueError(f"expected an address or a name of this machine as the host, got {host!r}: {error}") from None
    is_both = place[0] == "::" and socket.has_dualstack_ipv6()
    try:
        return socket.create_server(place[:2], family=family, dualstack_ipv6=is_both)
    except OSError as error:
        if error.errno != errno.EADDRINUSE:
            raise
        raise OSError(f"port {port} is taken: give another --port, or none for a free one") from None


def _own_address(listening: socket.socket) -> str:
    """Address of this machine at which others reach a socket that listens at all addresses."""
    is_ipv4 = listening.family == socket.AF_INET or not listening.getsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY)
    families = [socket.AF_INET] * is_ipv4 + [socket.AF_INET6] * (listening.family == socket.AF_INET6)
    for family in families:
        try:
            with socket.socket(family, socket.SOCK_DGRAM) as asked:
                asked.connect((ELSEWHERE[family], 9))
                return str(asked.getsockname()[0])
        except OSError:  # no network of that kind
            continue
    return LOCAL[0] if is_ipv4 else "::1"


def _run(application: Guard, listening: socket.socket) -> None:
    """Answer requests until a signal; the server then ends within a moment, whatever clients do."""
    from uvicorn import Config, Server

    class Ending(Server):
        async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
            asyncio.get_running_loop().call_later(ENDING, self._drop)
            await super().shutdown(sockets)

        def _drop(self) -> None:
            application.end()
            asyncio.get_running_loop().call_later(ENDING, self._close)

        def _close(self) -> None:
            """Close connections whose clients do not read."""
            for connection in list[Any](self.server_state.connections):
                connection.transport.abort()

    config = Config(application, log_level="warning", access_log=False, server_header=False, lifespan="off")
    Ending(config).run(sockets=[listening])
