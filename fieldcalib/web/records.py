"""Data for the page and the report, as dicts for JSON: fields, calibrations, and the states of frames.

Pixels and metres are rounded to what can be seen.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict
from itertools import product
from math import ceil
from string import ascii_lowercase
from typing import Any

import numpy as np

from fieldcalib._json import to_json
from fieldcalib._types import Array
from fieldcalib.assess.advice import Tool, how
from fieldcalib.assess.findings import What
from fieldcalib.assess.paint_in_view import MarkingInView
from fieldcalib.assess.result import Calibration
from fieldcalib.draw.scene import image_curves_of
from fieldcalib.editor.edit import Known
from fieldcalib.editor.editor import Editor
from fieldcalib.editor.fitting import is_left_out, is_stray, mark_errors
from fieldcalib.editor.frame import FrameEditor
from fieldcalib.fields.field import Field
from fieldcalib.geometry.camera import Camera
from fieldcalib.geometry.homography import homogenize
from fieldcalib.io.image_files import size_of
from fieldcalib.problem.layout import ANGLES, CENTER, LOG_F
from fieldcalib.solve.solver_options import LENS_FLAGS

MARGIN = 0.06  # margin around the field on its map, as a share of its diagonal
FARTHEST = 2.0  # diagonals of the field from the camera, beyond which ground is not shown
BORDER = 24  # points along each side of the image that are traced to the ground
BEYOND = 1e6  # m: points of the ground this far off lie on the horizon
AZIMUTHS = 721  # directions in which the horizon is traced

EQUATIONS_OF_A_LINE = 2
ERROR_GRID = (43, 29)  # places along and across the field in the map of errors


def field_record(field: Field) -> dict[str, Any]:
    """Convert a field to a map: its size in metres, and the polylines of its segments.

    Examples
    --------
    >>> from fieldcalib import soccer
    >>> record = field_record(soccer())
    >>> record["length"], record["segments"][0]["label"], record["segments"][0]["key"], record["segments"][0]["group"]
    (105.0, 'Side line top', 'st', 'ground')
    """
    keys = short_keys(field)
    segments = [
        {
            "label": label,
            "key": keys[label],
            "kind": "point" if one.is_point else "line" if one.is_straight else "arc" if one.is_arc else "cloud",
            "points": _rounded(one.sample() if one.is_point or not one.is_curve else one.polyline(1.0), 3),
            "group": "goal" if np.any(one.sample()[:, 2]) else "ground",
        }
        for label, one in field.items()
    ]
    margin = MARGIN * float(np.hypot(field.length, field.width))
    return {"length": field.length, "width": field.width, "margin": round(margin, 1), "segments": segments}


def short_keys(labels: Iterable[str]) -> dict[str, str]:
    """Choose a short key for each label, of letters of the label where they are free.

    Examples
    --------
    >>> short_keys(["Side line top", "Side line bottom", "Circle left", "Circle central", "Middle line"])
    {'Side line top': 'st', 'Side line bottom': 'sb', 'Circle left': 'cl', 'Circle central': 'cc', 'Middle line': 'ml'}
    """
    found: dict[str, str] = {}
    taken: set[str] = set()
    for label in labels:
        found[label] = next(key for key in _candidates(label) if key not in taken)
        taken.add(found[label])
    return found


def _candidates(label: str) -> Iterator[str]:
    letters = "".join(one if one in ascii_lowercase else " " for one in label.lower())
    first, *rest = letters.split() or ["x"]
    yield from (first[0] + word[0] for word in reversed(rest))
    yield from (first[0] + letter for word in (*reversed(rest), first[1:]) for letter in word)
    yield from (first[0] + letter for letter in ascii_lowercase)
    yield from map("".join, product(ascii_lowercase, repeat=2))
    for count in range(3, 99):  # not needed for fields that a person labels, for which 676 pairs are enough
        yield from map("".join, product(ascii_lowercase, repeat=count))


def calibration_record(calibration: Calibration, field: Field) -> dict[str, Any]:
    """Convert a calibration: camera, verdict and reason, projected markings, and the ground in view."""
    return judgement_record(calibration) | projection_record(calibration, field)


def judgement_record(calibration: Calibration) -> dict[str, Any]:
    """Convert the camera of a calibration with its errors, verdict and reason."""
    return {
        "status": str(calibration.status),
        "message": calibration.message,
        "verdict": str(calibration.verdict),
        "reason": calibration.reason,
        "findings": [one.to_dict() for one in calibration.findings],
        "remedy": calibration.remedy,
        "here": how(calibration.advice, Tool.PAGE),
        "more": _more(calibration),
        "probability": _probability(calibration),
        "camera": None if calibration.camera is None else camera_record(calibration),
    }


def _more(calibration: Calibration) -> int | None:
    """Number of markings that are still to be labelled for a camera; None if that is not what is missing."""
    for one in calibration.findings:
        if one.what is What.TOO_FEW_LABELS and not calibration.accepted:
            _, equations, unknowns = one.numbers
            return max(ceil((unknowns - equations) / EQUATIONS_OF_A_LINE), 1)
    return None


def projection_record(calibration: Calibration, field: Field) -> dict[str, Any]:
    """Projected markings, ground in view and horizon of a calibration, which are known before its verdict."""
    camera, of_field = calibration.camera, calibration.field or field
    if camera is None:
        return {"curves": [], "view": [], "horizon": None}
    return {
        "curves": curves_of(camera, of_field, calibration.markings),
        "view": view_of(camera, of_field),
        "horizon": horizon_of(camera),
    }


def camera_record(calibration: Calibration) -> dict[str, Any]:
    """Convert the camera of a calibration, with standard deviations if known; angles in degrees."""
    camera, field = calibration.required_camera, calibration.field
    _, _, _, dist = camera.to_opencv()
    pan, tilt, roll = np.degrees(camera.angles).tolist()
    deviations = None
    if calibration.knows_errors:
        sigma = np.sqrt(np.diagonal(calibration.covariance))
        angles = to_json(np.degrees(sigma[ANGLES]))
        deviations = {"focal_length": to_json(float(camera.focal_length * sigma[LOG_F]))}
        deviations |= {"position": to_json(sigma[CENTER]), **dict(zip(("pan", "tilt", "roll"), angles, strict=True))}
    return {
        "focal_length": camera.focal_length,
        "position": camera.C.tolist(),
        "pan": pan,
        "tilt": tilt,
        "roll": roll,
        "dist": np.ravel(dist).tolist(),
        "principal_point": camera.principal_point.tolist(),
        "aspect": shown_aspect(camera),
        "field_size": None if field is None else [field.length, field.width],
        "sd": deviations,
    }


def shown_aspect(camera: Camera) -> float:
    """Width / height at which the picture of a camera has square pixels.

    Examples
    --------
    >>> camera = Camera.from_angles(0.0, 1.35, 0.0, 1400.0, (0.0, 66.0, -16.0), (1280, 720))
    >>> round(shown_aspect(camera), 4), round(shown_aspect(camera.scaled((640, 640))), 4)
    (1.7778, 1.7778)
    """
    width, height = camera.image_size
    return float(width / height * camera.K[1, 1] / camera.K[0, 0])


def _probability(calibration: Calibration) -> dict[str, float] | None:
    if not calibration.has_probability or calibration.field is None or calibration.camera is None:
        return None
    metres = calibration.field.tolerance
    value = calibration.probability(metres)
    return {"metres": metres, "value": round(value, 4)} if np.isfinite(value) else None


def curves_of(camera: Camera, field: Field, markings: Sequence[MarkingInView] = ()) -> list[dict[str, Any]]:
    """Project the markings of a field to polylines, bent by the lens, each with the state of its paint.

    The state is "paint" if the marking lies on paint, "beside" if its paint lies beside it, "unseen" if it shows no
    paint, and "plain" if paint was not looked for. The halves of a circle, drawn on top of it, have its state.
    """
    states = {one.label: "beside" if one.is_beside else "unseen" if one.is_unseen else "paint" for one in markings}
    of_circles = {half: states.get(circle, "plain") for circle, halves in field.halves.items() for half in halves[:2]}
    return [
        {"label": label, "points": _rounded(curve, 1), "state": states.get(label, of_circles.get(label, "plain"))}
        for label, curves in zip(
            field.markings, image_curves_of(camera, field.markings.values(), field.terrain), strict=True
        )
        for curve in curves
        if _is_in_view(curve, camera.image_size)
    ]


def _is_in_view(curve: Array, image_size: tuple[int, int]) -> bool:
    """Whether the bounding box of a curve meets the image."""
    return bool(np.all(np.max(curve, axis=0) >= 0.0) and np.all(np.min(curve, axis=0) <= image_size))


def view_of(camera: Camera, field: Field, places: int = BORDER) -> list[list[float]]:
    """Polygon (X, Y), metres, of the ground that a camera sees; empty if it sees none.

    Points on the border of the image, `places` on each side, are traced to the ground. Rays that meet the ground more
    than two diagonals of the field away, or not at all, are lowered until they meet it at that distance.

    Examples
    --------
    >>> from fieldcalib import soccer
    >>> camera = Camera.from_angles(0.0, np.radians(75), 0.0, 1500.0, C=(0, 56, -15), image_size=(960, 540))
    >>> np.min(view_of(camera, soccer()), axis=0).round().tolist()
    [-56.0, -123.0]
    """
    if camera.C[2] >= 0.0:
        return []
    width, height = np.array(camera.image_size) - 1.0
    share = np.linspace(0.0, 1.0, places, endpoint=False)
    zero, one = 0.0 * share, 1.0 + 0.0 * share
    sides = [(share, zero), (one, share), (1.0 - share, one), (zero, 1.0 - share)]
    border = np.concatenate([np.stack(side, axis=1) for side in sides]) * (width, height)
    rays = homogenize(camera.normalized(border)) @ camera.R
    rays = rays[np.all(np.isfinite(rays), axis=1)]
    farthest = FARTHEST * float(np.hypot(field.length, field.width))
    away = np.linalg.norm(rays[:, :2], axis=1)
    is_ground = rays[:, 2] > 0.0
    if not np.any(is_ground):
        return []
    down = np.maximum(rays[:, 2], away * -camera.C[2] / farthest)
    return _rounded(camera.C[:2] - camera.C[2] * rays[:, :2] / np.maximum(down, 1e-9)[:, None], 2)


def horizon_of(camera: Camera) -> list[list[float]] | None:
    """Horizon in an image as a polyline of pixels, bent by the lens; None if it is not in view.

    Examples
    --------
    >>> camera = Camera.from_angles(0.0, np.radians(85), 0.0, 1500.0, C=(0, 56, -15), image_size=(960, 540))
    >>> [round(y) for x, y in horizon_of(camera)] == [round(270 - 1500 * np.tan(np.radians(5)))] * 2
    True
    """
    middle = camera.R[2]  # the optical axis
    azimuth = np.arctan2(middle[1], middle[0]) + np.linspace(-0.5 * np.pi, 0.5 * np.pi, AZIMUTHS)
    X = np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros(AZIMUTHS)], axis=-1)
    xy = camera.project(camera.C + BEYOND * X)
    size = np.array(camera.image_size)
    near = np.flatnonzero(np.all(np.abs(xy - size / 2.0) <= 0.75 * size, axis=1))  # false for NaN
    if len(near) < 2 or not _is_in_view(xy[near], camera.image_size):
        return None
    line = xy[near[0] : near[-1] + 1]
    return _rounded(line[[0, -1]] if camera.is_pinhole else line, 1)


def _rounded(values: Array, digits: int) -> list[Any]:
    return np.round(np.asarray(values, dtype=float), digits).tolist()  # type: ignore[no-any-return]


def frame_state(editor: Editor, number: int, one: FrameEditor, milliseconds: float = 0.0) -> dict[str, Any]:
    """State of a frame: everything that the page shows of it."""
    return {
        **drawn_state(editor, number, one, milliseconds),
        "judged": True,
        "basis": editor.table.rows[number].basis,
        **judgement_record(one.calibration),
        "next": _next_mark(one),
    }


def drawn_state(editor: Editor, number: int, one: FrameEditor, milliseconds: float = 0.0) -> dict[str, Any]:
    """Part of the state of a frame that the page draws over its picture, before the verdict is known."""
    return {
        **_state_of(editor, number, size_of(one.image), one.known),
        "problem": None,
        "marks": _marks(one),
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
    """State of a frame whose image cannot be read."""
    return {
        **_state_of(editor, number, (0, 0), Known()),
        **dict.fromkeys(("problem", "message", "reason"), problem),
        "status": "broken file",
        **dict.fromkeys(("verdict", "remedy", "here", "basis"), ""),
        **dict.fromkeys(("can_undo", "can_redo", "by_hand", "gets_marks"), False),
        **dict.fromkeys(("automatic", "judged"), True),
        "marks": [],
        "curves": [],
        "view": [],
        **dict.fromkeys(("camera", "probability", "horizon", "next", "more")),
        "milliseconds": 0.0,
    }


def _state_of(editor: Editor, number: int, size: tuple[int, int], known: Known) -> dict[str, Any]:
    """Part of the state of a frame that it has with and without a picture."""
    place = {"number": number, "id": editor.ids[number], "revision": editor.revision(number)}
    return {**place, "width": size[0], "height": size[1], "known": asdict(known), "lenses": list(LENS_FLAGS)}


def _marks(one: FrameEditor) -> list[dict[str, Any]]:
    """Marks of a frame, each with its distance from the projected marking, and whether it is suspect or left out.

    A mark is suspect if other marks contradict its label, if the field does not have the label, or if a person set it
    far from its marking. Marks of a network that lie beside their marking are left out, as the camera was not fitted
    to them.
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
    """Distances (N,) of the marks from their markings, pixels; NaN without a camera, or without such a label."""
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
    """Shift of ground points in view, in metres, if all clicks are 2 px off, over a grid on the field, and its pixels.

    There are no values if the camera was not calibrated from labels of this frame alone.
    """
    calibration, field = one.calibration, one.calibration.field or one.field
    x, y = (np.linspace(-half, half, count) for half, count in zip(field.half_extent, ERROR_GRID, strict=True))
    grid = {"x": x.round(2).tolist(), "y": y.round(2).tolist()}
    if calibration.camera is None or calibration.solved is None or calibration.field is None:
        return {**grid, "metres": None}
    X = np.stack([*np.meshgrid(x, y), np.zeros((len(y), len(x)))], axis=-1)
    xy = calibration.camera.project(X)
    in_view = np.all((xy >= 0.0) & (xy < calibration.camera.image_size), axis=-1)
    metres = np.where(in_view, one.click_errors(X), np.nan)
    return {**grid, "metres": to_json(metres.round(3)), "pixels": to_json(xy.round(1))}


def frames_state(editor: Editor) -> dict[str, Any]:
    """Table of all frames, as columns, with its version."""
    return {"version": editor.version, **editor.table.columns()}
