"""Key points that other models find: named points of a field, their pixels and weights.

A model knows its points by number. What counts here is which marking a number stands for, not where the model's own
code draws it: roboflow/sports has a pitch of 120 x 70 m in centimetres from the far left corner, with penalty areas of
41 x 20.15 m, and puts the points 11, 12, 19 and 20, where the penalty arcs meet the penalty areas, 1.84 m farther out,
where nothing is painted. Annotated and detected are the markings of real pitches, which are those of `soccer`: on 107
annotated frames those four points lie 1.9 px from there, and 17 px from where the model's code has them (1280 x 720).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fieldcalib._types import FIELD, Array, expect, listed, number, real_array
from fieldcalib.fields.field import Field
from fieldcalib.fields.segments import Point
from fieldcalib.fields.sports.soccer import CIRCLE_RADIUS, soccer
from fieldcalib.geometry.camera import checked_image_size
from fieldcalib.io.pnlcalib import KEYPOINTS, NAMES, keypoint_field, keypoint_name, keypoints_by_name

ROBOFLOW = tuple(NAMES["roboflow"])
MODELS: Mapping[str, tuple[str, ...]] = {
    "roboflow-32": ROBOFLOW,
    "pnlcalib-57": tuple(keypoint_name(id) for id in range(1, KEYPOINTS + 1)),
}
CONFIDENCES = ("keypoint_confidence", "confidence", "conf")  # of supervision, of its older versions, of ultralytics


@dataclass(frozen=True, eq=False)
class KeyPoints:
    """Named points of a field in one image: arguments of `calibrate_from_points`, and of `calibrate_from_segments`."""

    names: tuple[str, ...]
    object_points: Array
    """(N, 3), metres."""
    image_points: Array
    """(N, 2), pixels."""
    weights: Array
    """(N,)"""
    field: Field
    """The field, with all points of the model."""

    @property
    def image_segments(self) -> dict[str, Array]:
        """The pixel of each name, (1, 2)."""
        return {name: xy[None] for name, xy in zip(self.names, self.image_points, strict=True)}

    @property
    def segment_weights(self) -> dict[str, float]:
        """The weight of each name."""
        return dict(zip(self.names, self.weights.tolist(), strict=True))


def key_points(
    result: Any,
    model: str | Sequence[str | None] = "roboflow-32",
    *,
    field: Field | None = None,
    image_size: tuple[int, int] | None = None,
    least_confidence: float = 0.5,
) -> KeyPoints:
    """Key points that a model has found in one image, for `calibrate_from_points`.

    Points that were not found (at (0, 0), not finite, not visible, or of too little confidence) are left out; the
    others weigh the square of their confidence. That was measured on PnLCalib's (`fieldcalib.io.pnlcalib`).

    Parameters
    ----------
    result : object, (K, 2) or (K, 3) array_like, or mapping
        Of one image: a result of ultralytics' pose models or its ``keypoints``, `supervision.KeyPoints`, which are read
        by their attributes; an array of x, y in pixels and perhaps confidence; or the dict of PnLCalib and No Bells
        Just Whistles, id -> x, y, p, normalised by width and height. Of several pitches in an image, the one with the
        largest confidences is taken.
    model : {"roboflow-32", "pnlcalib-57"} or sequence of str or None
        Whose points: those of roboflow/sports, those of PnLCalib and No Bells Just Whistles, or the name in `field` of
        each point of a model of one's own, None for points that are not used.
    field : Field, optional
        By default `soccer()`, of 105 x 68 m: the points lie on its markings, whatever size the model's own code has.
    image_size : (int, int), optional
        Width and height in pixels, for coordinates that are normalised.
    least_confidence : float
        Points below are left out; those of PnLCalib's dict, whose confidences are the heights of peaks, are not.

    Raises
    ------
    ValueError
        An unknown model or name, a result of another kind, of several images or with another number of points, or
        normalised coordinates without an image size.

    Examples
    --------
    >>> from fieldcalib import Camera, calibrate_from_points
    >>> truth = Camera.from_angles(-0.3, 1.35, 0.0, 1600.0, (0.0, 68.0, -17.0), (960, 540))
    >>> pixels = truth.project([point_field("roboflow-32")[name].X for name in ROBOFLOW])
    >>> sure = (pixels >= 0).all(axis=1) & (pixels < truth.image_size).all(axis=1)
    >>> found = key_points(np.column_stack([pixels, 0.9 * sure]), "roboflow-32")
    >>> found.names[:2]
    ('TL_PITCH_CORNER', 'L_PENALTY_AREA_TL_CORNER')
    >>> size = truth.image_size
    >>> calibration = calibrate_from_points(found.object_points, found.image_points, size, weights=found.weights)
    >>> round(calibration.camera.focal_length, -2)
    1600.0
    """
    named, image_size = point_field(model, field), None if image_size is None else checked_image_size(image_size)
    if isinstance(result, Mapping):
        if model != "pnlcalib-57":
            raise ValueError("expected the result of a model or an array of points; a dict by id is of 'pnlcalib-57'")
        if image_size is None:
            raise ValueError("PnLCalib's coordinates are normalised: image_size=(width, height) is needed")
        detected = keypoints_by_name(result, image_size)
        pixels = [np.empty((0, 2)), *detected.image_segments.values()]
        return _of(tuple(detected.weights), np.concatenate(pixels), np.array([*detected.weights.values()]), named)
    xy, confidence = _surest(result)
    names: tuple[str | None, ...] = MODELS[model] if isinstance(model, str) else tuple(model)
    if len(xy) not in (0, len(names)):
        whose = model if isinstance(model, str) else "the given names"
        raise ValueError(
            f"expected {len(names)} points, those of {whose}, got {len(xy)}: is it the result of a model of "
            f"the pitch, and not of players' poses?"
        )
    found = (
        np.isfinite(xy).all(axis=1)
        & np.any(xy != 0.0, axis=1)
        & (confidence >= number(least_confidence, "least_confidence"))
    )
    used = [index for index in np.flatnonzero(found) if names[index] is not None]
    return _of(tuple(str(names[index]) for index in used), xy[used], np.square(confidence[used]), named)


def point_field(model: str | Sequence[str | None], field: Field | None = None) -> Field:
    """A field with all points of a model: those that SoccerNet names, and others."""
    field = soccer() if field is None else expect(field, Field, FIELD)
    if not isinstance(model, str):
        unknown = [
            name
            for name in listed(model, "the name of a model, or the names of its points")
            if name is not None and not (isinstance(name, str) and name in field)
        ]
        if unknown:
            raise ValueError(f"the field has no point {unknown[0]!r}: names are those of `field.points`")
        lines = [name for name in model if name is not None and not field[name].is_point]
        if lines:
            raise ValueError(f"{lines[0]!r} is no point of the field")
        return field
    if model == "pnlcalib-57":
        return keypoint_field(field)
    if model == "roboflow-32":
        sides = {"CENTER_CIRCLE_LEFT": -CIRCLE_RADIUS, "CENTER_CIRCLE_RIGHT": CIRCLE_RADIUS}
        return field.with_segments({name: Point((x, 0.0, 0.0)) for name, x in sides.items()})
    raise ValueError(f"model must be one of {', '.join(MODELS)}, or the names of its points, got {model!r}")


def _of(names: tuple[str, ...], xy: Array, weights: Array, field: Field) -> KeyPoints:
    X = np.array([field.points[name].X for name in names]).reshape(-1, 3)
    return KeyPoints(names, X, xy, weights, field)


def _surest(result: Any) -> tuple[Array, Array]:
    """Pixels (K, 2) and confidences (K,) of the surest pitch in a result; K = 0 where there is none."""
    if isinstance(result, list | tuple) and result and any(hasattr(result[0], key) for key in ("keypoints", "xy")):
        raise ValueError(f"expected the result of one image, got a list of {len(result)}: give each by itself")
    source = getattr(result, "keypoints", result)
    if source is None:
        raise ValueError("the result has no keypoints: expected one of a pose model")
    if not hasattr(source, "xy"):
        return _of_array(source)
    xy = _array(source.xy)
    if xy.ndim == 2:
        xy = xy[None]
    if xy.ndim != 3 or xy.shape[-1] != 2:
        raise ValueError(f"expected keypoints of shape (n, K, 2), got {xy.shape}")
    if not xy.size:
        return np.empty((0, 2)), np.empty(0)
    given = next((value for key in CONFIDENCES if (value := getattr(source, key, None)) is not None), None)
    confidence = np.ones(xy.shape[:2]) if given is None else _array(given).reshape(xy.shape[:2])
    visible = getattr(source, "visible", None)
    if visible is not None:
        confidence = confidence * (_array(visible).reshape(xy.shape[:2]) > 0.0)
    surest = int(np.argmax(confidence.sum(axis=1)))
    return xy[surest], confidence[surest]


def _of_array(values: Any) -> tuple[Array, Array]:
    try:
        points = _array(values)
    except ValueError:
        points = np.empty(())
    if points.ndim != 2 or points.shape[1] not in (2, 3):
        shape = f" of shape {points.shape}" if points.ndim else ""
        several = ": give the points of one pitch in one image" if points.ndim > 2 else ""
        raise ValueError(
            f"expected a result with `keypoints` or `xy`, or an array of shape (K, 2) or (K, 3), got "
            f"{type(values).__name__}{shape}{several}"
        )
    confidence = points[:, 2] if points.shape[1] == 3 else np.ones(len(points))
    return points[:, :2], confidence


def _array(values: Any) -> Array:
    """A NumPy array of what may be a tensor on another device."""
    return real_array(values.cpu() if hasattr(values, "cpu") else values)
