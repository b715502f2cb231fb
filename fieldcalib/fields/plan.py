"""A plan of a field as SVG, with what cameras see of it, for notebooks."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import pairwise

import numpy as np

from fieldcalib._types import Array
from fieldcalib.fields.segments import Segment
from fieldcalib.geometry.camera import Camera

WIDTH = 480  # px
MARGIN = 0.08  # around the field, as a share of its diagonal
SPACING = 0.5  # m: of the points along curves
BORDER = 24  # points along each side of a picture
FARTHEST = 4.0  # diagonals of the field: what a camera sees beyond is drawn there
GROUND, PAINT, VIEW = "#3c7a46", "#fff", "#ffe15a"


def plan(length: float, width: float, markings: Iterable[Segment], cameras: Sequence[Camera] = ()) -> str:
    """SVG of markings as seen from above, and of the ground in view of some cameras; see `Field.as_svg`."""
    diagonal = float(np.hypot(length, width))
    half = np.array([length, width]) / 2.0 + MARGIN * diagonal
    (x, y), (across, down) = -half, 2.0 * half
    stroke = f'fill="none" stroke="{PAINT}" stroke-width="{across / WIDTH * 1.4:.3f}"'
    curves = (one.polyline(SPACING)[:, :2] for one in markings if one.is_curve)
    lines = "".join(f'<polyline points="{_points(one)}"/>' for one in curves)
    views = "".join(_view(camera, FARTHEST * diagonal, share=1.0 / max(len(cameras), 1)) for camera in cameras)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" height="{round(WIDTH * down / across)}" '
        f'viewBox="{x:.2f} {y:.2f} {across:.2f} {down:.2f}">'
        f'<rect x="{x:.2f}" y="{y:.2f}" width="{across:.2f}" height="{down:.2f}" fill="{GROUND}"/>'
        f"{views}<g {stroke}>{lines}</g></svg>"
    )


def _view(camera: Camera, farthest: float, share: float) -> str:
    """The part of the ground that a camera sees, as far as it is drawn."""
    along = np.linspace(0.0, 1.0, BORDER)[:, None]
    corners = np.array([(0, 0), (1, 0), (1, 1), (0, 1), (0, 0)], dtype=float)
    border = np.concatenate([a + along * (b - a) for a, b in pairwise(corners)])
    X = camera.image_to_field(border * np.subtract(camera.image_size, 1.0))[:, :2]
    X = X[np.linalg.norm(X, axis=1) <= farthest]  # those above the horizon are NaN
    strength = max(0.45 * share, 0.08)
    return f'<polygon points="{_points(X)}" fill="{VIEW}" fill-opacity="{strength:.2f}"/>' if len(X) > 2 else ""


def _points(X: Array) -> str:
    return " ".join(f"{x:.2f},{y:.2f}" for x, y in X.tolist())
