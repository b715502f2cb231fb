"""What the page is told about a frame and about all frames: values for JSON."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from fieldcalib._json import to_json
from fieldcalib._types import Array
from fieldcalib.assess.result import Calibration
from fieldcalib.editor.editor import Editor
from fieldcalib.editor.fitting import is_left_out, is_stray, mark_errors
from fieldcalib.editor.frame import FrameEditor
from fieldcalib.editor.known import LENSES, Known
from fieldcalib.io.image import size_of
from fieldcalib.web.records import judgement_record, projection_record

ERROR_GRID = (43, 29)  # places along and across the field in the map of errors
NOTHING: dict[str, Any] = {"camera": None, "probability": None, "curves": [], "view": [], "horizon": None}


def frame_state(editor: Editor, number: int, one: FrameEditor, milliseconds: float = 0.0) -> dict[str, Any]:
    """All that the page shows of a frame."""
    return {
        **drawn_state(editor, number, one, milliseconds),
        "judged": True,
        "basis": editor.table.rows[number].basis,
        **judgement_record(one.calibration),
        "next": _next_mark(one),
    }


def drawn_state(editor: Editor, number: int, one: FrameEditor, milliseconds: float = 0.0) -> dict[str, Any]:
    """What the page draws over the picture of a frame, before the verdict on its camera is known."""
    width, height = size_of(one.image)
    return {
        "number": number,
        "id": editor.ids[number],
        "revision": editor.revision(number),
        "width": width,
        "height": height,
        "problem": None,
        "marks": _marks(one),
        "known": asdict(one.known),
        "lenses": list(LENSES),
        "can_undo": one.history.can_undo,
        "can_redo": one.history.can_redo,
        "automatic": one.is_automatic,
        "by_hand": not one.is_automatic,
        "gets_marks": editor.gets_marks(number),
        "judged": False,
        **projection_record(one.calibration, one.field),
        "milliseconds": round(milliseconds, 1),
    }


def broken_state(editor: Editor, number: int, problem: str) -> dict[str, Any]:
    """What the page is told of a frame whose image cannot be read."""
    said = {
        "status": "broken file",
        "message": problem,
        "verdict": "",
        "reason": problem,
        "remedy": "",
        "here": "",
        "basis": "",
    }
    return {
        "number": number,
        "id": editor.ids[number],
        "revision": editor.revision(number),
        "width": 0,
        "height": 0,
        "problem": problem,
        "judged": True,
        "marks": [],
        "known": asdict(Known()),
        "lenses": list(LENSES),
        **dict.fromkeys(("can_undo", "can_redo", "by_hand", "gets_marks"), False),
        "automatic": True,
        **said,
        **dict.fromkeys(("remedy", "here"), ""),
        **NOTHING,
        "next": None,
        "milliseconds": 0.0,
    }


def _marks(one: FrameEditor) -> list[dict[str, Any]]:
    """The marks of a frame, each with its distance from its marking, and whether the others contradict its label.

    Those whose label the field does not know are suspects. Marks of a network that lie beside it are left out of the
    camera: pixels are only fitted where they agree with it.
    """
    calibration, marks = one.calibration, one.marks
    suspects = {suspect.label: suspect.fits for suspect in calibration.suspect_labels}
    return [
        {
            "label": mark.label,
            "x": round(mark.x, 2),
            "y": round(mark.y, 2),
            "by_hand": mark.by_hand,
            "suspect": (
                mark.label in suspects
                or mark.label not in one.field
                or (mark.by_hand and is_stray(error, size_of(one.image)))
            ),
            "left_out": not mark.by_hand and mark.label not in suspects and is_left_out(error, size_of(one.image)),
            "error": to_json(round(error, 2)),
            "fits": suspects.get(mark.label),
        }
        for mark, error in zip(marks.all, _errors(one, calibration).tolist(), strict=True)
    ]


def _errors(one: FrameEditor, calibration: Calibration) -> Array:
    """Distances (N,) of the marks from their markings, pixels; NaN without a camera, or a label of the field."""
    errors = np.full(len(one.marks), np.nan)
    field = calibration.field or one.field
    if calibration.camera is not None:
        is_known = [mark.label in field for mark in one.marks.all]
        errors[is_known] = mark_errors(field, one.marks.of_field(field), [calibration.camera])[0]
    return errors


def _next_mark(one: FrameEditor) -> dict[str, Any] | None:
    calibration = one.calibration
    if calibration.camera is None or calibration.solved is None or calibration.field is None:
        return None
    found = one.next_mark
    if found is None:
        return None
    x, y = found.xy
    return {"label": found.label, "x": round(x, 1), "y": round(y, 1), "gain": to_json(round(found.gain, 4))}


def error_map(one: FrameEditor) -> dict[str, Any]:
    """How far ground points in view move, in metres, if the clicks are 2 px off, over a grid on the field.

    No metres where the camera does not follow from labels of this frame alone.
    """
    calibration, field = one.calibration, one.calibration.field or one.field
    x, y = (np.linspace(-half, half, count) for half, count in zip(field.half_extent, ERROR_GRID, strict=True))
    grid = {"x": x.round(2).tolist(), "y": y.round(2).tolist()}
    if calibration.camera is None or calibration.solved is None or calibration.field is None:
        return {**grid, "metres": None}
    X = np.stack([*np.meshgrid(x, y), np.zeros((len(y), len(x)))], axis=-1)
    xy = calibration.camera.project(X)
    in_view = np.all((xy >= 0.0) & (xy < calibration.camera.image_size), axis=-1)
    return {**grid, "metres": to_json(np.where(in_view, one.click_errors(X), np.nan).round(3))}


def frames_state(editor: Editor) -> dict[str, Any]:
    """The table of all frames, as columns."""
    return {"version": editor.version, **editor.table.columns()}
