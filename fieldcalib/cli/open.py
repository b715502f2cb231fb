"""`fieldcalib open`: a page to see, mend and label pictures, clips and results, in the browser."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from fieldcalib._extras import imported
from fieldcalib._progress import say
from fieldcalib.assess.findings import Verdict
from fieldcalib.console.arguments import add_named_field
from fieldcalib.results.entry import read

if TYPE_CHECKING:
    from fieldcalib.editor.editor import Editor


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command and add its arguments, which `run` takes."""
    parser.description = (
        "Open pictures, a clip or the results of a run in the browser: see the cameras, mend and label frames by "
        "clicks, save labels and cameras. The address that is printed works on this machine only, unless --host lets "
        "others in. Ctrl-C ends it."
    )
    parser.add_argument(
        "source", type=Path, metavar="SOURCE", help="a picture, a folder of pictures, a video, or a folder of results"
    )
    parser.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="folder of the results (SOURCE if it is one, or NAME-fieldcalib beside it)",
    )
    parser.add_argument(
        "--labels",
        type=Path,
        metavar="FILE|DIR",
        help="labels to begin with: annotations of SoccerNet, labelme, CVAT, Label Studio or COCO, by frame id",
    )
    add_named_field(parser)
    parser.set_defaults(field=None)
    parser.add_argument("--port", type=int, default=0, metavar="N", help="of the address (a free one)")
    parser.add_argument(
        "--host",
        default="127.0.0.1",
        metavar="H",
        help="address to listen at; with 0.0.0.0 or :: others can reach it who have its whole address (127.0.0.1)",
    )
    parser.add_argument(
        "--overwrite", action="store_true", help="replace files in DIR that neither a run nor a page has written"
    )
    parser.add_argument("--no-browser", action="store_true", help="print the address only")


def run(options: argparse.Namespace) -> int:
    """Serve the page until it is interrupted; returns the exit code."""
    check_page("fieldcalib open")
    from fieldcalib.editor.editor import Editor
    from fieldcalib.web.server import serve

    given = {"out": options.out, "labels": options.labels, "overwrite": options.overwrite}
    editor = Editor(options.source, options.field, **given)
    _claim(editor)
    serve(editor, host=options.host, port=options.port, browser=not options.no_browser)
    return 0


def _claim(editor: Editor) -> None:
    """Claim the folder of the results for this page, or say why it cannot be."""
    if said := editor.claim():
        say(f"{said}; until then frames can be looked at, and changes are refused")


def check_page(what: str) -> None:
    """Check, before the work, that the packages of the page are there.

    Raises
    ------
    ImportError
        If one is not installed, with how to install it.
    """
    for package in ("starlette", "uvicorn"):
        imported(package, "web", what)


def open_at_first_doubt(out: Path) -> None:
    """Serve the page of a folder of results, at the first frame that is not good, until it is interrupted."""
    from fieldcalib.editor.editor import Editor
    from fieldcalib.web.server import serve

    editor, verdicts = Editor(out), read(out).verdicts
    doubtful = (number for number, id in enumerate(editor.ids) if verdicts.get(id) is not Verdict.GOOD)
    _claim(editor)
    serve(editor, frame=next(doubtful, 0))
