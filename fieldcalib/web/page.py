"""The web application behind the page: its addresses and their answers (`Page`). It needs the extra ``web``.

Edits of a frame are checked as the page sends them, and applied to the editor (`apply`).
"""

from __future__ import annotations

import asyncio
import json
import os
import time
from collections.abc import Awaitable, Callable, Container, Mapping, Sequence
from functools import partial
from importlib.resources import files
from typing import Any

import numpy as np
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response
from starlette.routing import Route

from fieldcalib._json import to_json
from fieldcalib.assess.ground_points import locate_on_ground
from fieldcalib.draw.overlays import draw_calibration
from fieldcalib.editor.edit import FARTHEST
from fieldcalib.editor.editor import Editor, StaleEdit
from fieldcalib.editor.frame import FrameEditor
from fieldcalib.editor.label_versions import ChangedFileError, UnfinishedSaveError
from fieldcalib.editor.measure import distance, draw_line_across, ground_point, line_across
from fieldcalib.editor.saved_files import HISTORY
from fieldcalib.fields.catalogue import FIELDS
from fieldcalib.fields.field import Field
from fieldcalib.io.files import BrokenFileError
from fieldcalib.io.formats import IMAGES
from fieldcalib.io.image_files import Image, encode_image
from fieldcalib.results.entry import calibrate
from fieldcalib.web.guard import Guard, TooLargeError
from fieldcalib.web.jobs import ClipJob, Worker
from fieldcalib.web.pictures import LARGEST, ShownPictures
from fieldcalib.web.records import calibration_record, error_map, field_record, frames_state

MOST_MARKS = 2000  # largest number of marks of a frame
KNOWN = ("focal_length", "position", "principal_point", "lens", "field_size", "aspect")

TYPES = {
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".svg": "image/svg+xml",
    ".png": "image/png",
    ".woff2": "font/woff2",
}
INDEX = "index.html"
ENDING = 5.0  # seconds in which threads may finish their work at the end

Answer = Callable[[Request], Awaitable[Response]]


def app(
    source: str | os.PathLike[str] | Sequence[Image],
    field: Field | str | None = None,
    *,
    out: str | os.PathLike[str] | None = None,
    labels: str | os.PathLike[str] | None = None,
) -> Starlette:
    """The page of `fieldcalib open` with its addresses as an ASGI application, to mount in another one.

    Who may ask is left to the other application: unlike the page of `fieldcalib open` this one has no token and answers
    every host. Arguments are those of `Editor`. ``app.state.page.close()`` ends its threads and closes its files.

    Raises
    ------
    ImportError
        If the extra ``web`` is not installed.
    FileNotFoundError, BrokenFileError, FileExistsError, ValueError
        As `Editor`.

    Examples
    --------
    >>> from starlette.applications import Starlette
    >>> page = app([np.zeros((54, 96, 3), np.uint8)])
    >>> site = Starlette()
    >>> site.mount("/calibration", page)
    >>> page.state.page.close()
    """
    page = Page(Editor(source, field, out=out, labels=labels))
    application = page.unguarded()
    application.state.page = page
    return application


def apply(editor: Editor, number: int, body: Mapping[str, Any]) -> None:
    """Apply an edit to a frame.

    Raises
    ------
    ValueError
        If it is not an edit, or cannot be applied.
    StaleEdit
        If the frame was changed since the revision on which the edit is based.
    """
    revision = body.get("revision")
    if not isinstance(revision, int) or isinstance(revision, bool):
        raise ValueError("expected the revision of the frame, a whole number: load the frame first")
    what = body.get("do")
    do = EDITS.get(what) if isinstance(what, str) else None
    if do is None:
        raise ValueError(f"expected an edit, one of {', '.join(EDITS)}, got {str(what)[:40]!r}")
    if revision != editor.revision(number):
        raise StaleEdit(f"the frame was changed meanwhile (revision {editor.revision(number)}, not {revision})")
    changed = do(editor, number, body)
    if len(changed.marks) > MOST_MARKS:
        raise ValueError(f"expected at most {MOST_MARKS} marks in a frame")
    editor.put(number, changed, revision)


def _move(editor: Editor, number: int, body: Mapping[str, Any]) -> FrameEditor:
    to = body.get("to")
    if not isinstance(to, dict) or not all(isinstance(key, str) and key.isdecimal() and len(key) < 8 for key in to):
        raise ValueError('expected places by numbers of marks, as {"0": [480, 100]}')
    return editor.begun(number).move({int(key): _points([xy])[0] for key, xy in to.items()}, snap=_snap(body))


def _know(editor: Editor, number: int, body: Mapping[str, Any]) -> FrameEditor:
    values = body.get("values")
    if not isinstance(values, dict) or not values.keys() <= set(KNOWN):
        raise ValueError(f"expected values of {', '.join(KNOWN)}")
    return editor.begun(number).know(**{name: tuple(v) if isinstance(v, list) else v for name, v in values.items()})


def _copy(editor: Editor, number: int, body: Mapping[str, Any]) -> FrameEditor:
    other = body.get("from")
    if not isinstance(other, int) or isinstance(other, bool) or not 0 <= other < len(editor) or other == number:
        raise ValueError(f"expected the number of another frame, from 0 to {len(editor) - 1}")
    return editor.with_marks_of(number, other)


EDITS: Mapping[str, Callable[[Editor, int, Mapping[str, Any]], FrameEditor]] = {
    "mark": lambda editor, n, body: editor.begun(n).mark(_label(body), _points(body.get("xy")), snap=_snap(body)),
    "move": _move,
    "relabel": lambda editor, n, body: editor.begun(n).relabel(_numbers(body), _label(body)),
    "remove": lambda editor, n, body: editor.begun(n).remove(_numbers(body)),
    "know": _know,
    "undo": lambda editor, n, body: editor[n].undo(),
    "redo": lambda editor, n, body: editor[n].redo(),
    "clear": lambda editor, n, body: editor.begun(n).clear(),
    "automatic": lambda editor, n, body: editor.automatic(n),
    "copy": _copy,
}


def _label(body: Mapping[str, Any]) -> str:
    label = body.get("label")
    if not isinstance(label, str) or len(label) > 200:
        raise ValueError("expected the label of a marking, a text of at most 200 characters")
    return label


def _points(value: Any) -> Any:
    """Check pixels (N, 2)."""
    try:
        xy = np.array(value, dtype=float)
    except (TypeError, ValueError):
        xy = np.zeros(0)
    if xy.ndim != 2 or xy.shape[1] != 2 or not len(xy) or len(xy) > MOST_MARKS or not np.all(np.abs(xy) < FARTHEST):
        raise ValueError("expected pixels as [[x, y], ...], finite numbers")
    return xy


def _numbers(body: Mapping[str, Any]) -> list[int]:
    return _whole_numbers(body.get("numbers"), "the numbers of marks, as [0, 3]")


def _whole_numbers(value: Any, what: str) -> list[int]:
    if not isinstance(value, list) or not all(isinstance(one, int) and not isinstance(one, bool) for one in value):
        raise ValueError(f"expected {what}")
    return value


def _snap(body: Mapping[str, Any]) -> bool:
    value = body.get("snap", True)
    if not isinstance(value, bool):
        raise ValueError("expected true or false for snap")
    return value


class Json(Response):
    """Answer in JSON, in ASCII only, as names of files may contain characters that are not valid Unicode."""

    def __init__(self, value: Any, status: int = 200) -> None:
        super().__init__(json.dumps(value, allow_nan=False), status, media_type="application/json")


def page_files() -> dict[str, bytes]:
    """Read the files of the page from the package, by name: no other file is ever sent from the disk."""
    return {
        one.name: one.read_bytes()
        for one in files("fieldcalib.web").joinpath("static").iterdir()
        if one.is_file() and any(one.name.endswith(ending) for ending in TYPES)
    }


class Page:
    """Answers the page of an editor."""

    def __init__(self, editor: Editor) -> None:
        self.files = page_files()
        self._show(editor)

    def _show(self, editor: Editor) -> None:
        self.editor = editor
        self.worker = Worker(editor)
        self.job = ClipJob(editor)
        self.pictures = ShownPictures(editor.frames)
        if len(editor):
            self.worker.state(0)  # the first frame is calibrated before the browser asks for it

    def application(self, token: str, hosts: Container[str]) -> Guard:
        """The ASGI application, of which the guard lets only pages of this server ask."""
        return Guard(self.unguarded(), token, hosts)

    def unguarded(self) -> Starlette:
        """The ASGI application for another one, which says who may ask."""
        get, post = partial(Route, methods=["GET"]), partial(Route, methods=["POST"])
        routes = [
            get("/", answered(self.index)),
            get("/static/{name}", answered(self.static)),
            get("/api/project", answered(self.project)),
            get("/api/frames", answered(self.table)),
            get("/api/field", answered(self.field)),
            post("/api/v1/field", answered(self.change_field)),
            get("/api/frame/{n}", answered(self.frame)),
            post("/api/frame/{n}/edit", answered(self.edit)),
            get("/api/frame/{n}/likely", answered(self.likely)),
            get("/api/frame/{n}/errors", answered(self.errors)),
            get("/api/frame/{n}/ground", answered(self.ground)),
            get("/api/frame/{n}/distance", answered(self.distance)),
            get("/api/frame/{n}/offside", answered(self.offside)),
            get("/api/frame/{n}/offside.png", answered(self.offside_picture)),
            get("/api/frame/{n}/overlay.png", answered(self.overlay_picture)),
            post("/api/save", answered(self.save)),
            post("/api/save_labels", answered(self.save_labels)),
            get("/api/clip/job", answered(self.job_report)),
            get("/api/clip/proposed/{n}", answered(self.proposed)),
            get("/api/clip/next", answered(self.next_to_mend)),
            post("/api/clip/solve", answered(self._told(ClipJob.start))),
            post("/api/clip/draw", answered(self._told(ClipJob.draw))),
            post("/api/clip/cancel", answered(self._told(ClipJob.cancel))),
            post("/api/clip/keep", answered(self.keep)),
            post("/api/clip/undo_keep", answered(self._told(ClipJob.undo_keep))),
            post("/api/clip/discard", answered(self._told(ClipJob.cancel))),
            post("/api/clip/cuts", answered(self.cuts)),
            get("/image/{n}", answered(self.image)),
            get("/image/{n}/crop", answered(self.crop)),
            post("/api/v1/calibrate", answered(self.calibrate)),
        ]
        return Starlette(routes=routes, exception_handlers={404: _not_found, 405: _not_found})

    def close(self) -> None:
        """End the threads and close the files, after a save that is being written."""
        self._end_threads()
        with self.editor.lock:
            self.editor.close()

    def _end_threads(self) -> None:
        until = time.monotonic() + ENDING
        for thread in [*self.job.end(), *self.worker.end()]:
            thread.join(max(until - time.monotonic(), 0.0))

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
        """State of the editor as a whole: title, kind, folder, counts, cuts."""
        editor = self.editor
        return Json(
            {
                "title": editor.title,
                "kind": "clip" if editor.is_clip else "pictures",
                "folder": "" if editor.stored is None else str(editor.stored.folder),
                "count": len(editor),
                "rate": editor.frames.rate,
                "version": editor.version,
                "can_save": editor.stored is not None,
                "refused": editor.claim(),
                "unsaved": editor.unsaved,
                "has_results": editor.stored is not None and len(editor.stored.ids) > 0,
                "field": editor.field_name,
                "sports": list(FIELDS),
                "cuts": editor.cuts,
            }
        )

    async def table(self, request: Request) -> Response:
        """The table of all frames."""
        return Json(frames_state(self.editor))

    async def field(self, request: Request) -> Response:
        """The field."""
        return Json({"name": self.editor.field_name, **field_record(self.editor.field)})

    async def change_field(self, request: Request) -> Response:
        """Open the frames on the field of another sport; the answer is that field."""
        name = (await _body(request)).get("name")
        await run_in_threadpool(self._open_on, str(name))
        return await self.field(request)

    def _open_on(self, name: str) -> None:
        if self.job.report()["state"] in ("running", "ready"):
            raise ValueError("the clip is being solved or drawn: wait, and keep or discard its solution first")
        editor = self.editor
        self._end_threads()
        try:
            editor = editor.on_field(name)
        finally:
            self._show(editor)

    async def frame(self, request: Request) -> Response:
        """The state of a frame."""
        return Json(await self._state(self._number(request)))

    async def _state(self, number: int) -> dict[str, Any]:
        return await asyncio.wrap_future(self.worker.state(number))

    async def edit(self, request: Request) -> Response:
        """Change a frame; the answer has what the page draws, and the verdict only if there is no camera."""
        number, body = self._number(request), await _body(request)
        try:
            await run_in_threadpool(apply, self.editor, number, body)
        except StaleEdit as error:
            return Json({"error": str(error), "code": "StaleEdit", "state": await self._state(number)}, 409)
        return Json(await asyncio.wrap_future(self.worker.drawn(number)))

    async def calibrate(self, request: Request) -> Response:
        """The camera of a picture in the body, and ground points of pixels in the query, ``points=480,300;500,310``."""
        image, texts = IMAGES.read(await request.body()), request.query_params.get("points", "")
        xy = _points([one.split(",") for one in texts.split(";")]) if texts else np.zeros((0, 2))
        field = self.editor.field
        (found,) = (await run_in_threadpool(calibrate, [image], field, progress=False)).values()
        places = locate_on_ground(found, xy) if found.camera is not None else None
        metres = None if places is None else {"X": _rounded(places.X), "sd": _rounded(places.standard_deviations)}
        return Json({**calibration_record(found, field), "metres": metres})

    async def errors(self, request: Request) -> Response:
        """Shift of ground points if all clicks are 2 px off."""
        one = await self._fitted(request)
        return Json(await run_in_threadpool(error_map, one))

    async def ground(self, request: Request) -> Response:
        """The place on the ground at a pixel."""
        one = await self._fitted(request)
        X, sd, rms = ground_point(one.calibration, (_real(request, "x"), _real(request, "y")))
        return Json({"X": _rounded(X), "sd": _rounded(sd), "rms": _rounded(rms)})

    async def distance(self, request: Request) -> Response:
        """The distance of the places at two pixels."""
        one = await self._fitted(request)
        first, second = ((_real(request, f"x{k}"), _real(request, f"y{k}")) for k in (1, 2))
        metres, sd = distance(one.calibration, first, second)
        return Json({"metres": _rounded(metres), "sd": _rounded(sd)})

    async def offside(self, request: Request) -> Response:
        """The line across the field at a pixel."""
        one = await self._fitted(request)
        found = line_across(one.calibration, one.field, (_real(request, "x"), _real(request, "y")))
        if found is None:
            return Json({"line": [], "X": None})
        field = one.calibration.field or one.field
        end = "goal line" if any(label.startswith("Goal") for label in field) else "end line"
        points = [point for curve in found.curves for point in curve.round(1).tolist()]
        to_end = field.length / 2.0 - abs(found.x)
        return Json({"line": points, "X": _rounded(found.x), "to_end": _rounded(to_end), "end": end})

    async def offside_picture(self, request: Request) -> Response:
        """The picture with the line across the field at a pixel."""
        one = await self._fitted(request)
        xy = _real(request, "x"), _real(request, "y")
        drawn = await run_in_threadpool(draw_line_across, one.image, one.calibration, one.field, xy)
        return await _png(drawn, "offside.png")

    async def overlay_picture(self, request: Request) -> Response:
        """The picture with its markings."""
        one = await self._fitted(request)
        field = one.calibration.field or one.field
        return await _png(await run_in_threadpool(draw_calibration, one.image, one.calibration, field), "overlay.png")

    async def _fitted(self, request: Request) -> FrameEditor:
        """The frame in the address, with its camera."""
        number = self._number(request)
        await self._state(number)
        return await run_in_threadpool(self.editor.fitted, number)

    async def save(self, request: Request) -> Response:
        """Write labels and cameras into the folder of results."""
        await _body(request)
        folder, by_hand = self.editor.stored, self.editor.unsaved
        saved = await run_in_threadpool(self.editor.save)
        last = self.editor.last_save
        said = {"folder": str(folder.folder) if folder else "", "history": self._history(), "failed": dict(last.failed)}
        return Json({"saved": saved, "by_hand": by_hand, **said})

    def _history(self) -> str:
        """Folder, within the folder of results, of the files that the last save replaced; empty if it replaced none."""
        replaced = self.editor.last_save.replaced
        return "" if replaced is None or replaced.folder is None else f"{HISTORY}/{replaced.folder.name}"

    async def likely(self, request: Request) -> Response:
        """Labels for a pixel, the likeliest first."""
        one = await self._fitted(request)
        return Json({"labels": one.likely_labels((_real(request, "x"), _real(request, "y")))})

    async def save_labels(self, request: Request) -> Response:
        """Write the labels by hand in a format."""
        format = (await _body(request)).get("format")
        if not isinstance(format, str):
            raise ValueError('expected the name of a format, as {"format": "soccernet"}')
        name = await run_in_threadpool(self.editor.save_labels, format)
        return Json({"file": name, "history": self._history()})

    async def job_report(self, request: Request) -> Response:
        """Progress of the solution of the clip."""
        return Json(await run_in_threadpool(self.job.report))

    async def next_to_mend(self, request: Request) -> Response:
        """Number of the frame to mend next; null if all are good."""
        return Json({"number": await run_in_threadpool(self.editor.next_to_mend)})

    async def proposed(self, request: Request) -> Response:
        """The camera of a frame in the solution that is not kept yet."""
        return Json(await run_in_threadpool(self.job.proposed, self._number(request)))

    def _told(self, change: Callable[[ClipJob], None]) -> Answer:
        """Answer with the report of the job, after a change of it."""

        async def answer(request: Request) -> Response:
            await _body(request)
            await run_in_threadpool(change, self.job)
            return await self.job_report(request)

        return answer

    async def keep(self, request: Request) -> Response:
        """Keep the solution."""
        await _body(request)
        return Json({"saved": await run_in_threadpool(self.job.keep)})

    async def cuts(self, request: Request) -> Response:
        """Set the first frames of the shots."""
        cuts = _whole_numbers((await _body(request)).get("cuts"), 'the numbers of frames, as {"cuts": [0, 120]}')
        await run_in_threadpool(self.editor.set_cuts, cuts)
        return Json({"cuts": self.editor.cuts})

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
    """Raised if a frame does not exist."""


# HTTP statuses by the class of an error, the first one that it is of
STATUSES: Mapping[type[Exception], int] = {
    NoSuchFrame: 404,
    TooLargeError: 413,
    StaleEdit: 409,
    ChangedFileError: 409,
    UnfinishedSaveError: 507,
    BrokenFileError: 422,
    ValueError: 400,
}


def answered(answer: Answer) -> Answer:
    """Turn errors of a request into answers with the status and the message."""

    async def safely(request: Request) -> Response:
        try:
            return await answer(request)
        except ClientDisconnect:
            return problem(400, "the request has no end")  # the client is gone and will not read it
        except (ValueError, UnfinishedSaveError) as error:
            status = next(status for kind, status in STATUSES.items() if isinstance(error, kind))
            return problem(status, str(error), type(error).__name__)
        except OSError as error:
            return problem(507, f"nothing was written: {error.strerror or error}")

    return safely


def problem(status: int, message: str, code: str = "") -> Response:
    """Answer with an error message, and the name of the error if it has one."""
    return Json({"error": message, "code": code}, status)


async def _png(image: Image, name: str) -> Response:
    content = await run_in_threadpool(encode_image, image, ".png")
    return Response(
        content, headers={"content-type": "image/png", "content-disposition": f'attachment; filename="{name}"'}
    )


def _rounded(value: Any) -> Any:
    """Round metres to millimetres; None stays None."""
    return None if value is None else to_json(np.round(value, 3))


async def _not_found(request: Request, error: Exception) -> Response:
    return problem(getattr(error, "status_code", 404), "there is nothing at this address")


async def _body(request: Request) -> Mapping[str, Any]:
    """Parse the body of a request, a JSON object."""
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
    """Parse a finite number of the query."""
    try:
        value = float(request.query_params.get(name, ""))
    except ValueError:
        value = float("nan")
    if not abs(value) < 1e6:
        raise ValueError(f"expected a number {name}, got {request.query_params.get(name, '')[:40]!r}")
    return value


def _whole(request: Request, name: str, default: int | None = None) -> int:
    """Parse a number of the query and round it; `default` if it is missing."""
    if default is not None and name not in request.query_params:
        return default
    return round(_real(request, name))


def _jpeg(content: bytes) -> Response:
    return Response(content, headers={"content-type": "image/jpeg", "cache-control": "private, max-age=3600"})
