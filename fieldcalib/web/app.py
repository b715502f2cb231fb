"""The application behind the page: addresses, and what each answers. It needs the extra ``web``."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable, Mapping
from functools import partial
from importlib.resources import files
from typing import Any

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from fieldcalib.editor.editor import Editor, StaleEdit
from fieldcalib.fields.catalogue import FIELDS
from fieldcalib.io.files import BrokenFileError
from fieldcalib.web.edits import apply
from fieldcalib.web.guard import Guard, TooLargeError
from fieldcalib.web.pictures import LARGEST, Pictures
from fieldcalib.web.state import field_state, frames_state
from fieldcalib.web.worker import Worker

TYPES = {
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".svg": "image/svg+xml",
    ".png": "image/png",
    ".woff2": "font/woff2",
}
INDEX = "index.html"

Answer = Callable[[Request], Awaitable[Response]]


def page_files() -> dict[str, bytes]:
    """The files of the page in the package, by name: nothing else is ever sent from the disk."""
    return {
        one.name: one.read_bytes()
        for one in files("fieldcalib.web").joinpath("static").iterdir()
        if one.is_file() and any(one.name.endswith(ending) for ending in TYPES)
    }


class Page:
    """Answers the page of an editor."""

    def __init__(self, editor: Editor) -> None:
        self.editor = editor
        self.worker = Worker(editor)
        self.pictures = Pictures(editor.frames)
        self.files = page_files()
        if len(editor):
            self.worker.state(0)  # the first frame is calibrated before the browser asks for it

    def application(self, token: str, hosts: list[str]) -> Guard:
        """The ASGI application."""
        get, post = partial(Route, methods=["GET"]), partial(Route, methods=["POST"])
        routes = [
            get("/", answered(self.index)),
            get("/static/{name}", answered(self.static)),
            get("/api/project", answered(self.project)),
            get("/api/frames", answered(self.table)),
            get("/api/field", answered(self.field)),
            get("/api/frame/{n}", answered(self.frame)),
            post("/api/frame/{n}/edit", answered(self.edit)),
            get("/api/frame/{n}/likely", answered(self.likely)),
            get("/image/{n}", answered(self.image)),
            get("/image/{n}/crop", answered(self.crop)),
        ]
        app = Starlette(routes=routes, exception_handlers={404: _not_found, 405: _not_found})
        return Guard(app, token, hosts)

    def close(self) -> None:
        """End the threads and close the files."""
        self.worker.close()
        self.editor.close()

    async def index(self, request: Request) -> Response:
        """The page."""
        return self._file(INDEX)

    async def static(self, request: Request) -> Response:
        """A file of the page."""
        return self._file(request.path_params["name"])

    def _file(self, name: str) -> Response:
        content = self.files.get(name)
        if content is None:
            return problem(404, "there is no such file")
        kind = next(TYPES[ending] for ending in TYPES if name.endswith(ending))
        return Response(content, headers={"content-type": kind})

    async def project(self, request: Request) -> Response:
        """What is opened."""
        editor = self.editor
        return JSONResponse(
            {
                "title": editor.title,
                "kind": "clip" if editor.is_clip else "pictures",
                "folder": "" if editor.stored is None else str(editor.stored.folder),
                "count": len(editor),
                "rate": editor.frames.rate,
                "version": editor.version,
                "can_save": editor.stored is not None,
                "unsaved": editor.unsaved,
                "sports": list(FIELDS),
                "cuts": editor.cuts,
            }
        )

    async def table(self, request: Request) -> Response:
        """All frames."""
        return JSONResponse(frames_state(self.editor))

    async def field(self, request: Request) -> Response:
        """The field."""
        return JSONResponse(field_state(self.editor.field))

    async def frame(self, request: Request) -> Response:
        """The state of a frame."""
        return JSONResponse(await self._state(self._number(request)))

    async def _state(self, number: int) -> dict[str, Any]:
        return await asyncio.wrap_future(self.worker.state(number))

    async def edit(self, request: Request) -> Response:
        """Change a frame."""
        number, body = self._number(request), await _body(request)
        try:
            await run_in_threadpool(apply, self.editor, number, body)
        except StaleEdit as error:
            return JSONResponse({"error": str(error), "state": await self._state(number)}, 409)
        return JSONResponse(await self._state(number))

    async def likely(self, request: Request) -> Response:
        """Labels for a pixel, the likely ones first."""
        number = self._number(request)
        xy = _real(request, "x"), _real(request, "y")
        one = await run_in_threadpool(self.editor.fitted, number)
        return JSONResponse({"labels": one.likely_labels(xy)})

    async def image(self, request: Request) -> Response:
        """A picture."""
        number, width = self._number(request), _whole(request, "width", LARGEST)
        return _jpeg(await run_in_threadpool(self.pictures.whole, number, min(max(width, 1), LARGEST)))

    async def crop(self, request: Request) -> Response:
        """A part of a picture."""
        number = self._number(request)
        x, y, w, h = (_whole(request, name) for name in "xywh")
        width = min(max(_whole(request, "width", LARGEST), 1), LARGEST)
        return _jpeg(await run_in_threadpool(self.pictures.crop, number, (x, y), (w, h), width))

    def _number(self, request: Request) -> int:
        """The number of a frame in the address."""
        text = request.path_params["n"]
        if not (text.isascii() and text.isdecimal() and len(text) < 10) or int(text) >= len(self.editor):
            raise NoSuchFrame(f"expected the number of a frame, from 0 to {len(self.editor) - 1}, got {text[:20]!r}")
        return int(text)


class NoSuchFrame(ValueError):
    """A frame that does not exist."""


def answered(answer: Answer) -> Answer:
    """Turn what a request has wrong into an answer that says so."""

    async def safely(request: Request) -> Response:
        try:
            return await answer(request)
        except NoSuchFrame as error:
            return problem(404, str(error))
        except TooLargeError as error:
            return problem(413, str(error))
        except StaleEdit as error:
            return problem(409, str(error))
        except BrokenFileError as error:
            return problem(422, str(error))
        except ValueError as error:
            return problem(400, str(error))
        except OSError as error:
            return problem(507, f"the file could not be written: {error.strerror}")

    return safely


def problem(status: int, message: str) -> Response:
    """An answer that says what is wrong."""
    return JSONResponse({"error": message}, status)


async def _not_found(request: Request, error: Exception) -> Response:
    return problem(getattr(error, "status_code", 404), "there is nothing at this address")


async def _body(request: Request) -> Mapping[str, Any]:
    """The JSON object that a request has."""
    try:
        body = json.loads(await request.body())
    except TooLargeError:
        raise
    except (ValueError, RecursionError):
        body = None
    if not isinstance(body, dict):
        raise ValueError("expected a JSON object")
    return body


def _real(request: Request, name: str) -> float:
    """A finite number of the query."""
    try:
        value = float(request.query_params.get(name, ""))
    except ValueError:
        value = float("nan")
    if not abs(value) < 1e6:
        raise ValueError(f"expected a number {name}, got {request.query_params.get(name, '')[:40]!r}")
    return value


def _whole(request: Request, name: str, default: int | None = None) -> int:
    """A whole number of the query."""
    if default is not None and name not in request.query_params:
        return default
    return round(_real(request, name))


def _jpeg(content: bytes) -> Response:
    return Response(content, headers={"content-type": "image/jpeg", "cache-control": "private, max-age=3600"})
