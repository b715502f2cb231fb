"""Homographies from pixels to metres on the ground, and what lens and ground leave of each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fieldcalib._html import long_table, table
from fieldcalib._types import CAMERA, FIELD, Array, expect
from fieldcalib.fields.field import Field
from fieldcalib.geometry.camera import Camera
from fieldcalib.geometry.homography import dehomogenize, homogenize

SAMPLES = 33  # along each axis of the picture
BORDER_SAMPLES = 129  # along each side of the field


@dataclass(frozen=True, eq=False)
class FieldHomography:
    """Homographies (3, 3) from pixels (x, y, 1) of a picture to ground points (x, y, 1) in metres.

    With a lens, or on ground that is not level, no homography maps the pixels of the picture exactly: `from_raw` is
    the one nearest to the camera, in pixels, over the part of the field in view.

    Examples
    --------
    >>> from fieldcalib import soccer
    >>> camera = Camera.from_angles(0.2, 1.35, 0.0, 1400.0, (0, 65, -16), (960, 540), k=(0.05, 0.0))
    >>> found = field_homography(camera, soccer())
    >>> exact = camera.image_to_field([700.0, 400.0])[:2]
    >>> bool(np.linalg.norm(dehomogenize(found.from_raw @ [700.0, 400.0, 1.0]) - exact) <= found.largest_m)
    True
    """

    from_undistorted: Array
    """Of pixels without the distortion of the lens (as ``cv2.undistort`` makes pictures): exact on level ground, else
    the nearest one too."""
    from_raw: Array
    """Of the pixels of the picture as it is; NaN if less than four points of the field are in view."""
    rms_px: float
    """Root mean square distance by which `from_raw` misses the camera, pixels, over the field in view."""
    largest_px: float
    """The largest one, in the picture and along the border of the field."""
    rms_m: float
    """The same on the ground, metres."""
    largest_m: float

    def _repr_html_(self) -> str:
        """Both matrices and what the lens leaves, for notebooks."""
        raw, exact = ([[f"{value:.6g}" for value in row] for row in H] for H in (self.from_raw, self.from_undistorted))
        left = {
            "left by lens and ground, rms": f"{self.rms_px:.2f} px, {self.rms_m:.3f} m",
            "largest": f"{self.largest_px:.2f} px, {self.largest_m:.3f} m",
        }
        names = (("from raw pixels", raw), ("from undistorted pixels", exact))
        return "".join(long_table([name, "", ""], H, len(H)) for name, H in names) + table(left)


def field_homography(camera: Camera, field: Field) -> FieldHomography:
    """The homographies of a camera, and what lens and ground leave over the part of the field in view.

    Raises
    ------
    ValueError
        If one of the two is something else.
    """
    xy, X = pixels_of_ground(expect(camera, Camera, CAMERA), expect(field, Field, FIELD))
    exact = _inverse(camera.pinhole_homography)
    if field.terrain.is_level and not np.any(camera.dist):
        return FieldHomography(exact, exact, 0.0, 0.0, 0.0, 0.0)
    if not field.terrain.is_level:
        straight = _fitted(X, dehomogenize(homogenize(camera.normalized(xy)) @ camera.K.T))
        exact = exact if straight is None else _inverse(straight)
    fitted = _fitted(X, xy)
    if fitted is None:
        return FieldHomography(exact, np.full((3, 3), np.nan), *4 * [float("nan")])
    raw = _inverse(fitted)
    on_border = _border_in_view(camera, field)
    xy, X, count = np.concatenate([xy, on_border[0]]), np.concatenate([X, on_border[1]]), len(xy)
    pixels = np.linalg.norm(dehomogenize(homogenize(X) @ fitted.T) - xy, axis=-1)
    metres = np.linalg.norm(dehomogenize(homogenize(xy) @ raw.T) - X, axis=-1)
    rms_px, rms_m = _rms(pixels[:count]), _rms(metres[:count])
    return FieldHomography(exact, raw, rms_px, float(pixels.max()), rms_m, float(metres.max()))


def pixels_of_ground(camera: Camera, field: Field) -> tuple[Array, Array]:
    """Pixels (N, 2) of the picture that show the field, on a grid, and their ground points (N, 2)."""
    axes = (np.linspace(0.0, size - 1.0, SAMPLES) for size in camera.image_size)
    xy = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    X = camera.image_to_field(xy, terrain=field.terrain)[:, :2]
    shows = np.all(np.abs(X) <= (field.length / 2.0, field.width / 2.0), axis=-1)  # false for NaN
    return xy[shows], X[shows]


def _border_in_view(camera: Camera, field: Field) -> tuple[Array, Array]:
    """Pixels (N, 2) and ground points (N, 2) of the border of the field, where most errors are largest."""
    grid = np.stack(np.meshgrid(*2 * [np.linspace(-1.0, 1.0, BORDER_SAMPLES)]), axis=-1).reshape(-1, 2)
    sides = grid[np.abs(grid).max(axis=1) == 1.0]
    X = np.pad(0.5 * sides * (field.length, field.width), ((0, 0), (0, 1)))
    xy = camera.project(field.terrain.raised(X))
    seen = np.all((xy >= 0.0) & (xy <= np.subtract(camera.image_size, 1.0)), axis=-1)  # false for NaN
    return xy[seen], X[seen, :2]


def _fitted(X: Array, xy: Array) -> Array | None:
    """The homography from ground points to pixels with least squares of the distances in pixels."""
    import cv2

    if len(X) < 4:
        return None
    found, _ = cv2.findHomography(X, xy, 0)
    return None if found is None else np.asarray(found, dtype=float)


def _inverse(H: Array) -> Array:
    """The inverse of a homography, scaled so that its last entry is 1."""
    inverse = np.asarray(np.linalg.inv(H))
    return np.asarray(inverse / inverse[2, 2])


def _rms(distances: Array) -> float:
    return float(np.sqrt(np.mean(np.square(distances))))
