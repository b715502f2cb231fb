"""What a person sees of a camera: projected markings, the horizon, and the part of the ground in view."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fieldcalib._types import Array
from fieldcalib.assess.result import Calibration
from fieldcalib.draw.scene import image_curves
from fieldcalib.fields.field import Field
from fieldcalib.geometry.camera import Camera

FAR = 1e6  # metres: the ground there is at the horizon
DIRECTIONS = 721  # of the horizon, half a degree apart
BORDER = 24  # points on each side of the picture
MARGIN = 0.02  # of the picture: curves reach a little beyond it


class Curve(NamedTuple):
    """A part of a projected marking."""

    label: str
    points: Array
    """(N, 2) pixels, bent by the lens."""
    state: str
    """paint, beside or unseen, where the image was examined; else plain."""


def curves_in_view(calibration: Calibration, field: Field) -> list[Curve]:
    """The projected markings of a field, as far as they lie in the picture; none without a camera."""
    if calibration.camera is None:
        return []
    states = {
        one.label: "beside" if one.is_beside else "unseen" if one.is_unseen else "paint" for one in calibration.markings
    }
    found = []
    for label, segment in field.markings.items():
        for curve in image_curves(calibration.camera, segment):
            for part in _clipped(curve, calibration.camera.image_size):
                found.append(Curve(label, part, states.get(label, "plain")))
    return found


def _clipped(curve: Array, size: tuple[int, int]) -> list[Array]:
    """The parts of a polyline in a picture and a little beyond."""
    margin = MARGIN * np.array(size)
    inside = np.all((curve > -margin) & (curve < size + margin), axis=1)
    shown = inside.copy()
    shown[1:] |= inside[:-1]
    shown[:-1] |= inside[1:]
    # an edge may cross the picture though both of its ends are outside
    low, high = np.minimum(curve[:-1], curve[1:]), np.maximum(curve[:-1], curve[1:])
    crosses = np.all((high > 0.0) & (low < size), axis=1)
    shown[:-1] |= crosses
    shown[1:] |= crosses
    kept = np.flatnonzero(shown)
    if not len(kept):
        return []
    return [curve[run] for run in np.split(kept, np.flatnonzero(np.diff(kept) > 1) + 1) if len(run) > 1]


def horizon(camera: Camera) -> Array | None:
    """The horizon of the ground in the picture, (N, 2) pixels from left to right; None if it is not in view."""
    angle = np.linspace(-np.pi, np.pi, DIRECTIONS)
    direction = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=-1)
    X = camera.C * (1.0, 1.0, 0.0) + FAR * direction
    xy = camera.project(X)
    size = np.array(camera.image_size)
    with np.errstate(invalid="ignore"):
        near = (camera.depth(X) > 0.0) & np.all((xy > -size) & (xy < 2.0 * size), axis=1)
    xy = xy[near]
    with np.errstate(invalid="ignore"):
        if not np.any(np.all((xy >= 0.0) & (xy < size), axis=1)):
            return None
    return np.asarray(xy[np.argsort(xy[:, 0])])


def ground_in_view(camera: Camera, field: Field, margin: float = 5.0) -> Array:
    """The part of the field, and of a margin around it, that a picture shows: a polygon (N, 2), metres; may be empty.

    The border of the picture is traced to the ground; what lies above the horizon is replaced by points just below it.
    """
    width, height = np.subtract(camera.image_size, 1.0)
    x, y = np.linspace(0.0, width, BORDER), np.linspace(0.0, height, BORDER)
    zero = np.zeros(BORDER)
    border = np.concatenate(
        [
            np.stack([x, zero], axis=-1),
            np.stack([zero + width, y], axis=-1),
            np.stack([x[::-1], zero + height], axis=-1),
            np.stack([zero, y[::-1]], axis=-1),
        ]
    )
    X = camera.image_to_field(border)[:, :2]
    above = horizon(camera)
    if above is not None:
        # points below the horizon by a pixel stand in for those above it
        at = np.stack([border[:, 0], np.interp(border[:, 0], above[:, 0], above[:, 1]) + 1.0], axis=-1)
        lost = ~np.isfinite(X).all(axis=1)
        X[lost] = camera.image_to_field(at[lost])[:, :2]
    X = X[np.isfinite(X).all(axis=1)]
    half = field.half_extent + margin
    return _in_box(X, -half, half)


def _in_box(polygon: Array, low: Array, high: Array) -> Array:
    """The part of a polygon (N, 2) in a box, by cutting it at each side (Sutherland and Hodgman, 1974).

    Examples
    --------
    >>> _in_box(np.array([[0.0, 0.0], [4.0, 0.0], [0.0, 4.0]]), np.array([-1.0, -1.0]), np.array([2.0, 9.0])).tolist()
    [[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 4.0]]
    """
    for axis in (0, 1):
        for sign, limit in ((1.0, low[axis]), (-1.0, -high[axis])):
            inner = sign * polygon[:, axis] - limit
            kept: list[Array] = []
            for k in range(len(polygon)):
                here, there, a, b = polygon[k], polygon[(k + 1) % len(polygon)], inner[k], inner[(k + 1) % len(polygon)]
                if (a >= 0.0) != (b >= 0.0):
                    kept.append(here + a / (a - b) * (there - here))
                if b >= 0.0:
                    kept.append(there)
            polygon = np.array(kept).reshape(-1, 2)
    return polygon
