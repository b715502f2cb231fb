"""What the page is told about a frame, a field and all frames: values for JSON."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict
from string import ascii_lowercase, digits
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib._types import Array
from fieldcalib.assess.result import Calibration
from fieldcalib.editor.editor import Editor
from fieldcalib.editor.fitting import mark_errors
from fieldcalib.editor.frame import LENSES, FrameEditor
from fieldcalib.editor.stored import BY_HAND
from fieldcalib.editor.view import curves_in_view, ground_in_view, horizon
from fieldcalib.fields.field import Field
from fieldcalib.fields.segments import Segment
from fieldcalib.geometry.camera import Camera
from fieldcalib.io.image import size_of
from fieldcalib.problem.layout import ANGLES, CENTER, LOG_F

SPACING = 0.5  # m between the points of a bent marking
KEYS = ascii_lowercase + digits


def number(value: float, digits: int = 6) -> float | None:
    """A number for JSON, which has neither infinity nor NaN."""
    return round(float(value), digits) if np.isfinite(value) else None


def numbers(values: ArrayLike, digits: int = 2) -> list[Any]:
    """An array as nested lists, rounded; what is not finite is null.

    Examples
    --------
    >>> numbers([[1.234, np.nan]])
    [[1.23, None]]
    """
    array = np.asarray(values, dtype=float)
    if array.ndim > 1:
        return [numbers(one, digits) for one in array]
    return [number(one, digits) for one in array.tolist()]


def frame_state(editor: Editor, n: int, one: FrameEditor, milliseconds: float = 0.0) -> dict[str, Any]:
    """All that the page shows of a frame."""
    calibration, (width, height) = one.calibration, size_of(one.image)
    camera = calibration.camera
    field = calibration.field or one.field
    next_mark = _next_mark(one)
    return {
        "number": n,
        "id": editor.ids[n],
        "revision": editor.revision(n),
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
        "status": str(calibration.status),
        "message": calibration.message,
        "verdict": str(calibration.verdict),
        "reason": calibration.reason,
        "remedy": calibration.remedy,
        "basis": BY_HAND if not one.is_automatic else "",
        "camera": None if camera is None else _camera(calibration, camera, field),
        "probability": _probability(calibration),
        "curves": [
            {"label": label, "points": numbers(points, 1), "state": state}
            for label, points, state in curves_in_view(calibration, field)
        ],
        "view": [] if camera is None else numbers(ground_in_view(camera, field)),
        "next": next_mark,
        "horizon": None if camera is None or (line := horizon(camera)) is None else numbers(line, 1),
        "milliseconds": round(milliseconds, 1),
    }


def broken_state(editor: Editor, n: int, problem: str) -> dict[str, Any]:
    """What the page is told of a frame whose image cannot be read."""
    return {
        "number": n,
        "id": editor.ids[n],
        "revision": 0,
        "width": 0,
        "height": 0,
        "problem": problem,
        "marks": [],
        "known": {},
        "lenses": list(LENSES),
        "can_undo": False,
        "can_redo": False,
        "automatic": True,
        "by_hand": False,
        "status": "broken file",
        "message": problem,
        "verdict": "",
        "reason": problem,
        "remedy": "",
        "basis": "",
        "camera": None,
        "probability": None,
        "curves": [],
        "view": [],
        "next": None,
        "horizon": None,
        "milliseconds": 0.0,
    }


def _marks(one: FrameEditor) -> list[dict[str, Any]]:
    calibration, marks = one.calibration, one.marks
    suspects = {suspect.label: suspect.fits for suspect in calibration.suspect_labels}
    field = calibration.field or one.field
    camera = calibration.camera
    errors = np.full(len(marks), np.nan) if camera is None else mark_errors(field, marks, camera)
    return [
        {
            "label": mark.label,
            "x": round(mark.x, 2),
            "y": round(mark.y, 2),
            "by_hand": mark.by_hand,
            "suspect": mark.label in suspects,
            "error": number(error, 2),
            "fits": suspects.get(mark.label),
        }
        for mark, error in zip(marks.all, errors.tolist(), strict=True)
    ]


def _camera(calibration: Calibration, camera: Camera, field: Field) -> dict[str, Any]:
    pan, tilt, roll = numbers(np.degrees(camera.angles), 4)
    return {
        "focal_length": number(camera.focal_length, 2),
        "position": numbers(camera.C, 3),
        "pan": pan,
        "tilt": tilt,
        "roll": roll,
        "dist": numbers(np.ravel(camera.dist), 5),
        "principal_point": numbers(camera.K[:2, 2], 2),
        "field_size": [field.length, field.width],
        "sd": _deviations(calibration, camera),
    }


def _deviations(calibration: Calibration, camera: Camera) -> dict[str, Any] | None:
    if not calibration.knows_errors:
        return None
    with np.errstate(invalid="ignore"):
        sigma = np.sqrt(np.diagonal(calibration.covariance))
    pan, tilt, roll = numbers(np.degrees(sigma[ANGLES]), 4)
    f = number(camera.focal_length * sigma[LOG_F], 2)
    return {"focal_length": f, "position": numbers(sigma[CENTER], 3), "pan": pan, "tilt": tilt, "roll": roll}


def _probability(calibration: Calibration) -> dict[str, Any] | None:
    if calibration.camera is None or calibration.field is None or not calibration.has_probability:
        return None
    value = number(calibration.probability(), 4)
    return None if value is None else {"metres": calibration.field.tolerance, "value": value}


def _next_mark(one: FrameEditor) -> dict[str, Any] | None:
    if one.calibration.camera is None or one.calibration.solved is None or one.calibration.field is None:
        return None
    found = one.next_mark
    if found is None:
        return None
    return {"label": found.label, "x": number(found.xy[0], 1), "y": number(found.xy[1], 1), "gain": number(found.gain)}


def field_state(field: Field) -> dict[str, Any]:
    """A field for the map: its segments as lines in metres, each with a key of one or two letters."""
    keys = keys_of(field)
    return {
        "name": "",
        "length": field.length,
        "width": field.width,
        "margin": 5.0,
        "half_extent": numbers(field.half_extent, 3),
        "surface": field.surface,
        "segments": [
            {
                "label": label,
                "key": keys[label],
                "kind": kind_of(segment),
                "points": numbers(points_of(segment), 3),
                "group": "goal" if np.any(segment.sample()[:, 2]) else "ground",
            }
            for label, segment in field.items()
        ],
    }


def kind_of(segment: Segment) -> str:
    """line, arc, point or cloud."""
    if segment.is_point:
        return "point"
    return "line" if segment.is_straight else "arc" if segment.is_arc else "cloud"


def points_of(segment: Segment) -> Array:
    """Points (N, 3) of a segment, between which it is drawn straight."""
    return segment.sample() if segment.is_point else segment.polyline(SPACING)


def keys_of(field: Iterable[str]) -> dict[str, str]:
    """A key of one or two letters for each label: its initials where they are free, else other ones.

    Examples
    --------
    >>> keys_of(["Middle line", "Side line top", "Side line left", "Mid"])
    {'Middle line': 'ml', 'Side line top': 'st', 'Side line left': 'sl', 'Mid': 'mi'}
    """
    found: dict[str, str] = {}
    taken: set[str] = set()
    for label in field:
        words = [word for word in "".join(c if c.isalnum() else " " for c in label.lower()).split() if word.isascii()]
        letters = "".join(words) or "x"
        ends = [words[0][0] + words[-1][0]] if len(words) > 1 else []
        tries = [*ends, *(letters[0] + other for other in letters[1:]), *(a + b for a in KEYS for b in KEYS)]
        found[label] = next(one for one in tries if one not in taken)
        taken.add(found[label])
    return found


def frames_state(editor: Editor) -> Mapping[str, Any]:
    """The table of all frames, as columns."""
    return {"version": editor.version, **editor.table.columns()}
