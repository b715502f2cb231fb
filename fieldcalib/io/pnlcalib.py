"""Detections of PnLCalib's networks: keypoints of the field and ends of its lines, with confidences.

A file is a JSON object of ``kp``, keypoint id -> x, y, p, and ``lines``, line id -> x_1, y_1, p_1, x_2, y_2, p_2.
Positions are normalised by the image's width and height, not by one less, and lie on a grid of 2 px at 1280 x 720.

Not every keypoint was detected. Those that the network misses are put where two detected lines meet, and get the
confidence 1, which no peak of a heat map reaches: on 93 frames of WC14 the next one is 0.81. They repeat what the lines
say, from ends that are rarely precise enough (median error 5.1 px, against 2.3 px of detected ones), and are left out.
All of the points without paint (58 to 73) are among them.

The error of detected points falls with the confidence p about as 1 / p (4.5 px below 0.3, 1.8 px above 0.7), so they
weigh p^2. On those frames, against annotations, that reaches 93.0 / 97.2 / 97.6 % of segments within 5 / 10 / 20 px;
weights of 1 reach 89.3 / 97.0 / 97.1, and p^2 with the computed points 86.2 / 95.6 / 97.4. The first figure is
optimistic: the weights were chosen on these frames. Chosen on half, they reach 91.9 / 97.1 / 97.6 on the other half.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from fieldcalib._types import Array
from fieldcalib.fields.field import Field
from fieldcalib.fields.segments import Point
from fieldcalib.fields.sports.soccer import (
    CIRCLE_RADIUS,
    PENALTY_AREA_DEPTH,
    PENALTY_AREA_WIDTH,
    PENALTY_MARK_DISTANCE,
    soccer,
)
from fieldcalib.io.files import BrokenFileError, parse_json_object
from fieldcalib.problem.labelled_pixels import Pixels

COMPUTED = 1.0  # confidence of a point that was not detected
KEYPOINTS = 57  # number of keypoints that have paint or stand on the field
WITHOUT_PAINT = 73  # id of the last of the others

# Names of the first points of models, in their order: of roboflow/sports, and those of PnLCalib that SoccerNet names.
NAMES: Mapping[str, Sequence[str]] = json.loads(Path(__file__).with_name("keypoint_names.json").read_text("utf-8"))
MARKS = {45: "L_PENALTY_MARK", 51: "CENTER_MARK", 57: "R_PENALTY_MARK"}
NAMED_KEYPOINTS = MappingProxyType(dict(enumerate(NAMES["pnlcalib"], 1)) | MARKS)

# Labels of lines by id: those of soccer in alphabetical order.
LINES = dict(enumerate(sorted(label for label, segment in soccer().items() if segment.is_straight), 1))


@dataclass(frozen=True)
class Detections:
    """Detections of the networks in one frame: arguments of `calibrate_from_segments`."""

    image_segments: Pixels
    """Pixels of lines (2, 2) and of keypoints (1, 2) by label."""
    weights: dict[str, float]
    """Weights of the keypoints. Lines weigh 1."""


def parse_detections(content: bytes | str, image_size: tuple[int, int]) -> Detections:
    """Detected keypoints and lines of one frame, with weights; to be calibrated against `keypoint_field`.

    Parameters
    ----------
    content : bytes or str
        The file's JSON.
    image_size : (int, int)
        Width and height in pixels.

    Raises
    ------
    BrokenFileError
        If it is no JSON, lacks keypoints or lines, has an unknown id, coordinates that are not normalised, or
        confidences that are not in 0..1.

    Examples
    --------
    >>> found = parse_detections('{"kp": {"51": {"x": 0.5, "y": 0.5, "p": 0.5}}, "lines": {}}', (1280, 720))
    >>> found.image_segments, found.weights
    ({'CENTER_MARK': array([[640., 360.]])}, {'CENTER_MARK': 0.25})
    """
    record = parse_json_object(content, "keypoints and lines")
    found = keypoints_by_name(record.get("kp"), image_size)
    for id, ends in _members(record.get("lines"), "lines", len(LINES)):
        pixels = [_detected(ends, (f"x_{i}", f"y_{i}", f"p_{i}"), f"line {id}", image_size)[0] for i in (1, 2)]
        found.image_segments[LINES[id]] = np.array(pixels)
    return found


def keypoints_by_name(keypoints: Any, image_size: tuple[int, int]) -> Detections:
    """Detected keypoints by name, from the mapping of ids to x, y, p in the networks' code and files.

    Raises
    ------
    BrokenFileError
        As `parse_detections`.
    """
    found = Detections({}, {})
    for id, point in _members(keypoints, "kp", WITHOUT_PAINT):
        xy, p = _detected(point, ("x", "y", "p"), f"keypoint {id}", image_size)
        if p != COMPUTED and id <= KEYPOINTS:
            found.image_segments[keypoint_name(id)] = xy[None]
            found.weights[keypoint_name(id)] = p**2
    return found


def _members(members: Any, key: str, last: int) -> list[tuple[int, Any]]:
    """Detections by id, from 1 to `last`, under a key of a record."""
    if not isinstance(members, Mapping):
        raise BrokenFileError(f"expected an object {key!r} of detections by id, got {members!r}")
    wrong = [id for id in members if not (str(id).isdecimal() and 1 <= int(id) <= last)]
    if wrong:
        raise BrokenFileError(f"{key!r}: expected ids from 1 to {last}, got {wrong[0]!r}")
    return [(int(id), member) for id, member in members.items()]


def _detected(record: Any, keys: tuple[str, str, str], what: str, image_size: tuple[int, int]) -> tuple[Array, float]:
    """A detected pixel (2,) and its confidence."""
    try:
        x, y, p = (float(record[key]) for key in keys)
    except (TypeError, KeyError, ValueError, OverflowError):
        raise BrokenFileError(f"{what}: expected numbers {', '.join(keys)}, got {record!r}") from None
    if not (abs(x) <= 10.0 and abs(y) <= 10.0):  # nor NaN
        raise BrokenFileError(f"{what}: coordinates {x:.6g}, {y:.6g} are not normalised to 0..1")
    if not 0.0 <= p <= 1.0:
        raise BrokenFileError(f"{what}: a confidence must lie in 0..1, got {p:.6g}")
    return np.array([x, y]) * image_size, p


def keypoint_name(id: int) -> str:
    """The label of a keypoint: SoccerNet's name where it has one, else "keypoint 37"."""
    return NAMED_KEYPOINTS.get(id, f"keypoint {id}")


def keypoint_field(field: Field) -> Field:
    """A field with the keypoints that have no name in SoccerNet: points of circles where a tangent, an axis or a
    diagonal touches or meets them, and points of the large areas' main lines.

    Examples
    --------
    >>> from fieldcalib import soccer
    >>> np.round(keypoint_field(soccer())["keypoint 38"].X, 2)
    array([-8.81, -2.46,  0.  ])
    """
    half_length, half_width = field.length / 2.0, field.width / 2.0
    area, mark = half_length - PENALTY_AREA_DEPTH, half_length - PENALTY_MARK_DISTANCE
    # seen from the corners of the large area, and from where the middle line meets the touchlines
    arc_x, arc_y = _tangent_point(mark - area, PENALTY_AREA_WIDTH / 2.0)
    circle_x, circle_y = _tangent_point(0.0, half_width)
    diagonal = CIRCLE_RADIUS / np.sqrt(2.0)
    found: dict[int, tuple[float, float]] = {
        46: (-area, 0.0),
        47: (-mark + CIRCLE_RADIUS, 0.0),
        50: (-CIRCLE_RADIUS, 0.0),
        52: (9.0, 0.0),  # sic: the networks were trained with it there, 0.15 m inside the circle
        55: (mark - CIRCLE_RADIUS, 0.0),
        56: (area, 0.0),
    }
    for sign, ids in ((-1.0, (37, 38, 39, 40, 48, 49)), (1.0, (41, 42, 43, 44, 53, 54))):
        xs = (-mark + arc_x, -circle_x, circle_x, mark - arc_x, -diagonal, diagonal)
        ys = (arc_y, circle_y, circle_y, arc_y, diagonal, diagonal)
        found |= {id: (x, sign * y) for id, x, y in zip(ids, xs, ys, strict=True)}
    return field.with_segments({keypoint_name(id): Point((x, y, 0.0)) for id, (x, y) in found.items()})


def _tangent_point(x: float, y: float) -> tuple[float, float]:
    """The point, on the side of positive x, where the tangent from (x, y) touches the centre circle.

    With d the distance of (x, y), the point lies at the angle acos(radius / d) from the direction to it.
    """
    angle = np.arctan2(y, x) - np.arccos(CIRCLE_RADIUS / np.hypot(x, y))
    return float(CIRCLE_RADIUS * np.cos(angle)), float(CIRCLE_RADIUS * np.sin(angle))
