"""Crowned pitches for synthetic pictures and labels, drawn without `fieldcalib.fields.ground`.

The ground is a parabola, or a roof with its ridge along the middle of the length; goals and points stand on it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fieldcalib._types import Array, Float32
from fieldcalib.draw.ground import Ground
from fieldcalib.fields.field import Field
from fieldcalib.fields.segments import Line, Point, PointCloud, Segment
from fieldcalib.geometry.camera import Camera

SPACING = 0.1  # m between the points of a curve
ROUNDS = 4  # fixed-point iterations of where a ray meets the ground: to a millimetre from any camera on a stand


def on_crown(X: Array, field: Field, crown: float, *, roof: bool = False) -> Array:
    """Points (..., 3) of a level field, raised to the ground of one that is crowned by `crown` metres.

    Examples
    --------
    >>> from fieldcalib.fields.sports.soccer import soccer
    >>> on_crown(np.array([[3.0, 0.0, 0.0], [3.0, 34.0, 0.0]]), soccer(), 0.3)  # z points down
    array([[ 3. ,  0. , -0.3],
           [ 3. , 34. ,  0. ]])
    """
    return np.concatenate([X[..., :2], X[..., 2:] - _height(X[..., 1:2], field, crown, roof)], axis=-1) + 0.0


def crowned(field: Field, crown: float, *, roof: bool = False) -> Field:
    """A field with its segments raised to a crowned ground; halves of circles are left out.

    Examples
    --------
    >>> from fieldcalib.fields.sports.soccer import soccer
    >>> float(crowned(soccer(), 0.3)["Middle line"].sample()[:, 2].min().round(3))  # z points down
    -0.3
    """

    def raised(segment: Segment) -> Segment:
        X = on_crown(segment.sample(SPACING), field, crown, roof=roof)
        if isinstance(segment, Point):
            return Point(tuple(X[0].tolist()))
        if np.ptp(X[:, :2], axis=0).max() == 0.0:  # a post
            return Line(tuple(X[0].tolist()), tuple(X[-1].tolist()))
        return PointCloud(tuple(map(tuple, X.tolist())), ordered=True)

    kept = {label: raised(one) for label, one in field.segments.items() if label not in field.half_labels}
    return replace(field, segments=kept, halves={})


def crowned_ground(camera: Camera, ray: Float32, field: Field, crown: float, *, roof: bool = False) -> Ground:
    """Points where the rays of a camera's pixels meet a crowned ground; NaN above the horizon.

    Examples
    --------
    >>> from fieldcalib.draw.ground import rays
    >>> from fieldcalib.fields.sports.soccer import soccer
    >>> camera = Camera.from_angles(0.0, 1.3, 0.0, 1500.0, (0.0, 60.0, -15.0), (960, 540))
    >>> x, y = crowned_ground(camera, rays(camera), soccer(), 0.3).xy[:, 260, 480]
    >>> bool(np.allclose(camera.project(on_crown(np.array([x, y, 0.0]), soccer(), 0.3)), (480, 260), atol=0.01))
    True
    """
    C = camera.C.astype(np.float32)
    with np.errstate(divide="ignore", invalid="ignore"):
        xy = Ground.of_rays(camera, ray).xy
        for _ in range(ROUNDS):
            scale = (-_height(xy[1], field, crown, roof).astype(np.float32) - C[2]) / ray[2]
            scale[~(scale > 0.0)] = np.nan
            xy = C[:2, None, None] + scale * ray[:2]
        along_column, along_row = np.gradient(xy, axis=(1, 2))
    return Ground(xy, np.asarray(along_row, np.float32), np.asarray(along_column, np.float32))


def _height(y: Array | Float32, field: Field, crown: float, roof: bool) -> Array:
    """Height of the ground at y, metres."""
    from_middle = np.abs(2.0 * y / field.width)
    return np.asarray(crown * np.maximum(1.0 - (from_middle if roof else np.square(from_middle)), 0.0))
