"""A report of a run: one HTML file with pictures, a table of all frames, plots and a map, which needs no network.

The file is at most `MOST_BYTES` long, whatever the number of frames: pictures are made smaller and then fewer, and rows
of good frames are left out last. The file says what was left out.
"""

from __future__ import annotations

import base64
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

import fieldcalib
from fieldcalib._progress import Progress, progress_bar
from fieldcalib._types import IntArray
from fieldcalib.assess.result import Calibration
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.io.files import BrokenFileError, write_text
from fieldcalib.io.image import Image
from fieldcalib.io.image_size import stored_size
from fieldcalib.results.collection import Results
from fieldcalib.results.sources import Pictures
from fieldcalib.run_folder.results import is_finished, read_summary
from fieldcalib.web.bundle import as_json, bundled, one_file, styles
from fieldcalib.web.records import camera_record, curves_of, field_record, view_of
from fieldcalib.web.report_advice import Commands, remedy_of
from fieldcalib.web.report_table import ReportTable
from fieldcalib.web.thumbnails import Thumbnails, frames_to_show

MOST_BYTES = 20_000_000  # of the file
PICTURE_BYTES = 7_500_000  # of JPEGs, of which the file has base64: 4/3 of them
TABLE_BYTES, STATE_BYTES = 7_000_000, 2_500_000  # of the table, and of what is drawn on pictures
MOST_VIEWS = 20_000  # frames: of more the table has no views of the ground, which would be left out of it anyway
STYLES = ("style", "report")


def write_report(results: Results, path: str | os.PathLike[str], title: str = "", *, progress: Progress = True) -> None:
    """Write the report of results as one HTML file, which opens in any browser without a network.

    Pictures are read again from the input, as far as it is still where it was.

    Parameters
    ----------
    results : Results
        As of `fieldcalib.calibrate` or `fieldcalib.read`.
    path : path
        The file, e.g. ``report.html``.
    title : str
        Heading; by default the name of the folder of the results.
    progress : bool or function
        Whether progress is shown while pictures are read, or a function that gets it, see `fieldcalib.calibrate`.

    Raises
    ------
    OSError
        If it cannot be written.
    """
    field = next((one.field for one in results.values() if one.field is not None), soccer())
    commands = Commands.of(results)
    whole = ReportTable.of(results.frames.mains(), field, commands, with_views=len(results.frames.ids) <= MOST_VIEWS)
    pictures = thumbnails(results, frames_to_show(whole.count, whole.worst), progress)
    numbers = {id: number for number, id in enumerate(results.frames.ids)}
    states = _states(results, pictures, numbers, commands)
    table = whole.within(TABLE_BYTES, [numbers[id] for id in states])
    kept = np.array([numbers[id] for id in table.columns["id"]], dtype=int)
    title = title or ("fieldcalib" if results.folder is None else results.folder.resolve().name)
    report = {
        "title": title,
        **_clip(results, kept),
        "about": _about(results),
        "field": field_record(field),
        **table.to_record(),
        "states": states,
    }
    jpegs = {id: base64.b64encode(pictures[id]).decode() for id in states}
    data = {"report": report, "pictures": jpegs}
    write_text(Path(path), one_file(title, styles(*STYLES), bundled("report"), data))


def _clip(results: Results, kept: IntArray) -> dict[str, Any]:
    """Whether there are plots over time, the frame rate, and the first frames of shots in a table of some frames."""
    video, rate, frames = results.video, results.frames_per_second, len(results.frames.ids)
    if video is None or rate is None:
        return {"plots": results.pictures.is_video, "rate": None, "cuts": []}
    readable = np.flatnonzero([id in results for id in results.frames.ids])
    starts = readable[np.array([shot.start for shot in video.shots], dtype=int)]
    return {"plots": True, "rate": rate * len(kept) / max(frames, 1), "cuts": np.searchsorted(kept, starts).tolist()}


def _about(results: Results) -> dict[str, Any]:
    """What is written about the run."""
    if results.folder is not None and is_finished(results.folder):
        return read_summary(results.folder)
    notes = {"notes": list(results.notes)} if results.notes else {}
    return {
        "frames": len(results.frames.ids),
        **notes,
        "options": dict(results.options),
        "version": fieldcalib.__version__,
    }


def thumbnails(results: Results, numbers: Sequence[int], progress: Progress = False) -> dict[str, bytes]:
    """Pictures of frames as JPEG by id; `numbers` has the most important ones first.

    The frames of a video are read one after the other, and no more pictures are in memory than their budget has bytes.
    """
    ids, pictures = results.frames.ids, results.pictures
    found = Thumbnails([ids[number] for number in numbers if ids[number] in results], PICTURE_BYTES)
    with progress_bar(unit="frame", total=len(ids), desc="report", progress=progress) as counter:
        for id, image in _images(pictures, found.wanted):
            found.add(id, image)
            counter.update()
    return found.jpegs


def _images(pictures: Pictures, ids: Sequence[str]) -> Iterator[tuple[str, Image]]:
    """All frames of a video, or the pictures of some frames, as far as they can be read."""
    if pictures.is_video:
        some = pictures.frames() if ids and pictures.has(ids[0]) else ()
        yield from ((frame.id, frame.image) for frame in some if frame.image is not None)
        return
    for id in ids:
        if pictures.has(id):
            with suppress(BrokenFileError):  # replaced since
                yield id, pictures.image(id)


def _states(
    results: Results, pictures: Mapping[str, bytes], numbers: Mapping[str, int], commands: Commands
) -> dict[str, Any]:
    """What is drawn on the pictures of frames, of as many as fit their bytes."""
    states: dict[str, Any] = {}
    size = 0
    for id, jpeg in pictures.items():
        line = results.frames.main(numbers[id])
        said = {"remedy": line["remedy"], "here": commands.how(remedy_of(line))} if line.get("remedy") else {}
        state = {**said, **_drawn(results[id], stored_size(jpeg))}
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
