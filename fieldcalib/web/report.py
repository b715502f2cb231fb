"""A report of a run: one HTML file with pictures, a table of all frames, plots and a map, which needs no network.

The file is at most `MOST_BYTES` long, whatever the number of frames: pictures are made smaller and then fewer, and rows
of good frames are left out last. The file says what was left out.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

import fieldcalib
from fieldcalib.assess.result import Calibration
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.io.files import write_text
from fieldcalib.io.image_size import stored_size
from fieldcalib.results.collection import Results
from fieldcalib.web.bundle import as_json, bundled, one_file, styles
from fieldcalib.web.records import camera_record, curves_of, field_record, view_of
from fieldcalib.web.report_table import ReportTable
from fieldcalib.web.thumbnails import Thumbnails, frames_to_show

REPORT = "report.html"
MOST_BYTES = 20_000_000  # of the file
PICTURE_BYTES = 8_700_000  # of JPEGs, of which the file has base64: 4/3 of them
TABLE_BYTES, STATE_BYTES = 5_000_000, 2_500_000  # of the table, and of what is drawn on pictures
STYLES = ("style", "report")


def chosen_frames(ids: Sequence[str], worst: Sequence[int]) -> Thumbnails:
    """Pictures, to be filled, of the frames that a report shows: the worst ones, and others spread over all.

    Parameters
    ----------
    ids : sequence of str
        Ids of all frames.
    worst : sequence of int
        Numbers of the worst frames, worst first.
    """
    return Thumbnails([ids[number] for number in frames_to_show(len(ids), worst)], PICTURE_BYTES)


def write_report(
    results: Results,
    path: Path | str,
    pictures: Mapping[str, bytes] = MappingProxyType({}),
    *,
    title: str = "",
    about: Mapping[str, Any] = MappingProxyType({}),
    rate: float | None = None,
    cuts: Sequence[int] = (),
) -> None:
    """Write the report of results as one HTML file, which opens in any browser without a network.

    Parameters
    ----------
    results : Results
    path : path
        The file, e.g. ``report.html``.
    pictures : mapping of str to bytes
        JPEGs of frames by id, see `chosen_frames`; the others have no picture.
    title : str
        Heading.
    about : mapping
        What is written about the run, e.g. the content of its ``summary.json``.
    rate : float, optional
        Frames per second, of a clip.
    cuts : sequence of int
        Numbers of the first frames of shots, of a clip.
    """
    field = next((one.field for one in results.values() if one.field is not None), soccer())
    lines = results.lines
    numbers = {line["id"]: number for number, line in enumerate(lines)}
    states = _states(results, pictures)
    table = ReportTable.of(lines, field).within(TABLE_BYTES, [numbers[id] for id in states])
    kept = np.array([numbers[id] for id in table.columns["id"]], dtype=int)
    report = {
        "title": title or Path(path).resolve().parent.name,
        "rate": None if rate is None else rate * len(kept) / max(table.count, 1),
        "cuts": np.searchsorted(kept, np.array(cuts, dtype=int)).tolist(),
        "about": {"version": fieldcalib.__version__, **about},
        "field": field_record(field),
        **table.to_record(),
        "states": states,
    }
    jpegs = {id: base64.b64encode(pictures[id]).decode() for id in states}
    data = {"report": report, "pictures": jpegs}
    write_text(Path(path), one_file(report["title"], styles(*STYLES), bundled("report"), data))


def _states(results: Results, pictures: Mapping[str, bytes]) -> dict[str, Any]:
    """What is drawn on the pictures of frames, of as many as fit their bytes."""
    states: dict[str, Any] = {}
    size = 0
    remedies = {line["id"]: line.get("remedy", "") for line in results.lines if line["id"] in pictures}
    for id, jpeg in pictures.items():
        calibration = results.get(id)
        if calibration is None:
            continue
        state = {"remedy": remedies[id], **_drawn(calibration, stored_size(jpeg))}
        size += len(as_json(state))
        if size > STATE_BYTES:
            break
        states[id] = state
    return states


def _drawn(calibration: Calibration, shape: tuple[int, int] | None) -> dict[str, Any]:
    """What is drawn of a calibration; `shape` is the size of its picture."""
    camera = calibration.camera
    width, height = (shape or (1, 1)) if camera is None else camera.image_size
    size = {"width": width, "height": height}
    if camera is None:
        return size
    field = calibration.field or soccer()
    curves, view = curves_of(camera, field, calibration.markings), view_of(camera, field)
    return size | {"camera": camera_record(calibration), "curves": curves, "view": view}
