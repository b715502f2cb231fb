"""Measuring in a picture: places on the ground, distances, and a line across the field at a player's foot."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib._types import Array
from fieldcalib.assess.estimate import PIXEL_SD
from fieldcalib.assess.ground_points import ground_by_pixel, locate_on_ground
from fieldcalib.assess.result import Calibration
from fieldcalib.draw.scene import SHIFT, fixed_point, image_curves
from fieldcalib.fields.field import Field
from fieldcalib.fields.segments import Line
from fieldcalib.io.image_files import Image, size_of
from fieldcalib.solve.solver_options import pixel_unit

OFFSIDE_COLOUR = (40, 220, 255)  # blue, green, red
THICKNESS = 2.0  # px of a 960 x 540 image
FOOT = 5.0  # px of such an image: radius of the ring around the foot


class GroundPoint(NamedTuple):
    """A place on the ground, with its error relative to the markings in view."""

    X: Array | None
    """x and y from the centre mark, metres, (2,); None above the horizon."""
    sd: Array | None
    """Standard deviations (2,) of x and y, metres; None where they are not known."""
    rms: float | None
    """Root mean square distance to the true place, metres."""


class Distance(NamedTuple):
    """The distance of two places on the ground."""

    metres: float | None
    """The distance; None if one of the places is above the horizon."""
    sd: float | None
    """Standard deviation of the distance, metres; None if unknown."""


def ground_point(calibration: Calibration, xy: ArrayLike) -> GroundPoint:
    """Find the place on the ground that is seen at a pixel, such as that of a foot, which is clicked to `PIXEL_SD`.

    Raises
    ------
    NoCameraError
        If there is no camera.

    Examples
    --------
    >>> from fieldcalib import Camera, calibrate_from_segments, soccer
    >>> truth = Camera.from_angles(0.2, 1.35, 0.01, 1400.0, (1.0, 65.0, -16.0), (960, 540))
    >>> labels = ("Side line top", "Side line right", "Big rect. right main", "Big rect. right top")
    >>> pixels = {label: truth.project(soccer()[label].sample(9.0)) for label in labels}
    >>> found = calibrate_from_segments(soccer(), pixels, (960, 540))
    >>> place = ground_point(found, truth.project((30.0, -10.0, 0.0)))
    >>> bool(np.linalg.norm(place.X - (30.0, -10.0)) < 0.5), bool(place.rms < 2.0)
    (True, True)
    """
    found = locate_on_ground(calibration, np.array([xy], dtype=float))
    X, sd = found.X[0, :2], found.standard_deviations[0]
    if not np.all(np.isfinite(X)):
        return GroundPoint(None, None, None)
    return GroundPoint(X, sd, float(np.hypot(*sd))) if np.all(np.isfinite(sd)) else GroundPoint(X, None, None)


def distance(calibration: Calibration, first: ArrayLike, second: ArrayLike) -> Distance:
    """Compute the distance of the places on the ground that are seen at two pixels.

    With u the unit vector from one place to the other, J1 and J2 their derivatives by the parameters of the camera, and
    V the covariance of these, the variance of exact pixels is ``u (J2 - J1) V (J2 - J1)^T u``: errors that both have in
    common cancel. Clicks are off by `PIXEL_SD` each.

    Raises
    ------
    NoCameraError
        If there is no camera.
    """
    X = calibration.image_to_field(np.array([first, second], dtype=float))
    way = X[1, :2] - X[0, :2]
    length = float(np.hypot(*way))
    if not np.isfinite(length):
        return Distance(None, None)
    if not calibration.knows_errors or length == 0.0:
        return Distance(length, None)
    J, _ = calibration.uncertainty.ground_jacobian(X)
    variance = float(calibration.uncertainty.propagated((way / length) @ (J[1] - J[0])[None])[0, 0])
    by_click = (way / length) @ ground_by_pixel(calibration, np.array([first, second], dtype=float))
    variance += PIXEL_SD**2 * float(np.sum(np.square(by_click)))
    return Distance(length, float(np.sqrt(variance)) if np.isfinite(variance) and variance >= 0.0 else None)


class AcrossLine(NamedTuple):
    """A line across the field, parallel to the goal lines."""

    x: float
    """Metres from the centre mark along the touchline."""
    curves: list[Array]
    """Parts of the line in the picture, pixels (N, 2), bent by the lens."""


def line_across(calibration: Calibration, field: Field, xy: ArrayLike) -> AcrossLine | None:
    """Find the line across the field at the place that is seen at a pixel; None above the horizon.

    Raises
    ------
    NoCameraError
        If there is no camera.
    """
    x = float(calibration.image_to_field(np.array([xy], dtype=float))[0, 0])
    if not np.isfinite(x):
        return None
    field = calibration.field or field
    across = Line((x, -field.width / 2.0, 0.0), (x, field.width / 2.0, 0.0))
    return AcrossLine(x, image_curves(calibration.required_camera, across, field.terrain))


def draw_line_across(image: Image, calibration: Calibration, field: Field, xy: ArrayLike) -> Image:
    """Draw the line across the field at a foot, and a ring around the foot, into a copy of the picture.

    Raises
    ------
    NoCameraError
        If there is no camera.
    ValueError
        If the pixel is above the horizon.
    """
    import cv2

    line = line_across(calibration, field, xy)
    if line is None:
        raise ValueError("expected a pixel on the ground, got one above the horizon")
    picture, unit = image.copy(), pixel_unit(size_of(image))
    thickness = max(round(THICKNESS * unit), 1)
    for curve in line.curves:
        cv2.polylines(picture, [fixed_point(curve)], False, OFFSIDE_COLOUR, thickness, cv2.LINE_AA, SHIFT)
    x, y = fixed_point(np.asarray(xy, dtype=float)).tolist()
    cv2.circle(picture, (x, y), round(FOOT * unit * (1 << SHIFT)), OFFSIDE_COLOUR, thickness, cv2.LINE_AA, SHIFT)
    return picture
