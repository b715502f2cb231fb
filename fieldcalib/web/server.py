"""Serving the page of an editor on this machine, until Ctrl-C."""

from __future__ import annotations

import secrets
import socket
import webbrowser
from threading import Timer
from typing import Any

from fieldcalib._extras import imported
from fieldcalib.editor.editor import Editor

LOCAL = ("127.0.0.1", "localhost")
BROWSER_AFTER = 0.2  # seconds


def serve(editor: Editor, *, host: str = LOCAL[0], port: int = 0, browser: bool = True) -> None:
    """Serve the page of an editor until it is interrupted; prints its address.

    Raises
    ------
    ImportError
        If the extra ``web`` is not installed.
    OSError
        If the port is taken.
    """
    uvicorn: Any = imported("uvicorn", "web", "the page")
    imported("starlette", "web", "the page")
    from fieldcalib.web.app import Page

    with socket.create_server((host, port)) as listening:
        port = listening.getsockname()[1]
        token = secrets.token_urlsafe(24)
        hosts = [f"{name}:{port}" for name in dict.fromkeys((host, *LOCAL))]
        address = f"http://{host}:{port}/{token}/"
        page = Page(editor)
        config = uvicorn.Config(
            page.application(token, hosts), log_level="warning", access_log=False, server_header=False, lifespan="off"
        )
        print(f"{address}\nCtrl-C ends it", flush=True)
        if browser:
            Timer(BROWSER_AFTER, webbrowser.open, [address]).start()
        try:
            uvicorn.Server(config).run(sockets=[listening])
        except KeyboardInterrupt:  # the way to end it
            pass
        finally:
            page.close()
