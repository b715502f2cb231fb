"""Calibrated frames of a clip against their true cameras: errors, and how often regions contain the truth."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from fieldcalib._types import Array
from fieldcalib.assess.estimate import CENTRE_MARK
from fieldcalib.assess.result import Calibration
from fieldcalib.fields.field import Field
from fieldcalib.geometry.camera import FULL_TURN, Camera
from fieldcalib.problem.layout import ANGLES, CENTER, LOG_F

GRID = (9, 7)  # pixels across and down the picture at which points of the field are compared
UNIT = 1280.0  # columns of the image in whose pixels errors are given
OWN = slice(0, LOG_F + 1)  # pan, tilt, roll and log f


class Compared(NamedTuple):
    """Comparison of a frame with its true camera."""

    basis: str
    """Data that the frame's camera rests on."""
    focal_length_percent: float
    centre_m: float
    field_m: float
    """Median error of the points of the field in view; NaN where none is."""
    image_px: float
    """Median error of these points in an image of `UNIT` columns."""
    holds_focal_length: float
    """Whether the 95 % region contains the truth, 0 or 1."""
    holds_own: float
    """Whether the joint 95 % region of pan, tilt, roll and log f contains the truth, 0 or 1."""
    holds_centre: float
    holds_field: float
    """Share of the points of the field in view whose 95 % ellipse contains the truth."""


def compared(found: Calibration, truth: Camera, field: Field, basis: str) -> Compared:
    """Compare a frame's camera with the true one, on the true field.

    Examples
    --------
    >>> from fieldcalib import calibrate_from_segments, soccer
    >>> field = soccer(size_known=True)
    >>> truth = Camera.from_angles(-0.3, 1.35, 0.0, 1600.0, (0.0, 68.0, -17.0), (960, 540))
    >>> labels = ("Side line left", "Side line top", "Big rect. left main", "Big rect. left top", "Circle left")
    >>> pixels = {label: truth.project(field[label].sample(7.0)) for label in labels}
    >>> result = compared(calibrate_from_segments(field, pixels, (960, 540)), truth, field, "lines")
    >>> result.field_m < 0.2, result.holds_own, result.holds_field
    (True, 1.0, 1.0)
    """
    errors = found.uncertainty
    camera, layout, theta = errors.camera, errors.layout, errors.theta
    own = theta[OWN] - layout.theta(truth)[OWN]
    own[ANGLES] -= FULL_TURN * np.round(own[ANGLES] / FULL_TURN)
    covariance = errors.covariance[OWN, OWN]
    off = camera.C - truth.C
    xy, X = points_in_view(truth, field)
    seen = camera.image_to_field(xy)
    on_ground = (seen - X)[:, :2]
    of_ground = errors.at_image(xy, relative_to=CENTRE_MARK).covariance
    return Compared(
        basis,
        100.0 * abs(camera.focal_length / truth.focal_length - 1.0),
        float(np.linalg.norm(off)),
        _median(np.linalg.norm(on_ground, axis=1)),
        _median(np.linalg.norm(camera.project(X) - xy, axis=1) * UNIT / truth.image_size[0]),
        float(_distances(own[LOG_F:], covariance[LOG_F:, LOG_F:]) <= errors.radius(1)),
        float(_distances(own, covariance) <= errors.radius(4)),
        float(_distances(off, errors.propagated(layout.zoom_jacobian(theta)[CENTER])) <= errors.radius(3)),
        float(np.mean(_distances(on_ground, of_ground) <= errors.radius(2))) if len(X) else np.nan,
    )


def points_in_view(truth: Camera, field: Field) -> tuple[Array, Array]:
    """Pixels (N, 2) of a grid that show the field, and the points that they show, (N, 3)."""
    width, height = truth.image_size
    x, y = np.meshgrid(np.linspace(0.0, width - 1.0, GRID[0]), np.linspace(0.0, height - 1.0, GRID[1]))
    xy = np.stack([x, y], axis=-1).reshape(-1, 2)
    X = truth.image_to_field(xy)
    seen = np.all(np.abs(X[:, :2]) <= (field.length / 2.0, field.width / 2.0), axis=1)  # false for NaN
    return xy[seen], X[seen]


def _distances(off: Array, covariance: Array) -> Array:
    """Mahalanobis distances of errors (..., d) with covariances (..., d, d)."""
    return np.asarray(np.sqrt(np.sum(off * np.linalg.solve(covariance, off[..., None])[..., 0], axis=-1)))


def _median(values: Array) -> float:
    return float(np.median(values)) if len(values) else float("nan")


def summary(frames: Sequence[Compared]) -> dict[str, float]:
    """Number of frames, median of each error, and how often regions contain the truth, percent."""
    table = np.array([frame[1:] for frame in frames], dtype=float)
    names = Compared._fields[1:]
    found: dict[str, float] = {"frames": len(frames)}
    for name, values in zip(names, table.T, strict=True):
        is_share = name.startswith("holds")
        found[name] = round(100.0 * float(np.nanmean(values)), 1) if is_share else round(float(np.nanmedian(values)), 3)
    return found


def by_basis(frames: Iterable[Compared]) -> list[str]:
    """Summarise the frames of each basis in a line of JSON."""
    frames = list(frames)
    lines = []
    for basis in dict.fromkeys(frame.basis for frame in frames):
        some = [frame for frame in frames if frame.basis == basis]
        lines.append(json.dumps({"basis": basis, **summary(some)}))
    return lines
