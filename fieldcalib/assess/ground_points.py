"""Positions on the field, with errors, of pixels such as the feet of players."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib._types import Array, is_number
from fieldcalib.assess.estimate import MARKINGS_IN_VIEW, PIXEL_SD, RelativeTo
from fieldcalib.assess.result import Calibration
from fieldcalib.geometry.camera import Camera

MOST_NOISE = 1e6  # px
STEP = 0.01  # px, of central differences: their relative error is the square of STEP / distance to the horizon


@dataclass(frozen=True)
class GroundPoints:
    """Points on the field with their errors."""

    X: Array
    """(..., 3) metres, z = 0 where the ground is level; NaN for pixels that do not show the ground."""
    covariance: Array
    """Covariance of x and y, (..., 2, 2), square metres; NaN where there is no point or the errors of the camera are
    unknown, infinite where nothing determines x and y."""

    @property
    def standard_deviations(self) -> Array:
        """Standard deviations of x and y, (..., 2), metres."""
        return np.asarray(np.sqrt(np.diagonal(self.covariance, axis1=-2, axis2=-1)))

    @property
    def correlation(self) -> Array:
        """Correlation of the errors of x and y, (...,); NaN where a standard deviation is 0, infinite or not known."""
        with np.errstate(invalid="ignore", divide="ignore"):
            correlation: Array = self.covariance[..., 0, 1] / self.standard_deviations.prod(axis=-1)
            return correlation


def locate_on_ground(
    calibration: Calibration, xy: ArrayLike, *, pixel_sd: float = PIXEL_SD, relative_to: RelativeTo = MARKINGS_IN_VIEW
) -> GroundPoints:
    """The ground points that are seen at pixels, with the errors of the camera and of the pixels.

    ``covariance = J_theta V J_theta^T + sd^2 J_xy J_xy^T`` with V the covariance of the camera's parameters and J the
    derivatives of the ground points by them and by the pixels. All points of a frame share the errors of the camera:
    players who stand beside each other are off in the same direction.

    Parameters
    ----------
    calibration : Calibration
        A calibration with a camera.
    xy : (..., 2) array_like
        Pixels, such as those of `fieldcalib.io.boxes.foot_points`.
    pixel_sd : float
        Standard deviation of each coordinate of the pixels, by default that of boxes of detectors and of clicks; with
        0 they are exact, and only the errors of the camera count.
    relative_to : "markings in view" or "centre mark"
        Reference of the errors (`fieldcalib.assess.estimate`); it matters where the size of the field is not known.
        Points are relative to the centre mark of the assumed field in either case.

    Returns
    -------
    GroundPoints

    Raises
    ------
    ValueError
        If `calibration` is of another type or has no camera (`NoCameraError`), `pixel_sd` is negative, the pixels have
        another shape, or `relative_to` has another value.

    Examples
    --------
    >>> from fieldcalib import calibrate_from_segments, soccer
    >>> truth = Camera.from_angles(0.2, 1.35, 0.01, 1400.0, (1.0, 65.0, -16.0), (960, 540))
    >>> labels = ("Side line top", "Side line right", "Big rect. right main", "Big rect. right top")
    >>> pixels = {label: truth.project(soccer()[label].sample(9.0)) for label in labels}
    >>> found = locate_on_ground(calibrate_from_segments(soccer(), pixels, (960, 540)), [[480, 300], [480, -300]])
    >>> np.isfinite(found.standard_deviations).all(axis=-1)  # the second one is above the horizon
    array([ True, False])
    """
    if not isinstance(calibration, Calibration):
        is_camera = isinstance(calibration, Camera)
        hint = "; camera.image_to_field(xy) gives the points, a camera alone has no errors" * is_camera
        raise ValueError(f"expected a Calibration, got a {type(calibration).__name__}{hint}")
    if not (is_number(pixel_sd) and 0.0 <= pixel_sd <= MOST_NOISE):
        raise ValueError(f"pixel_sd must be a standard deviation in pixels, 0 to {MOST_NOISE:g}, got {pixel_sd}")
    X = calibration.image_to_field(xy)
    if calibration.knows_errors:
        # at ground points, not at pixels: pixels of a squashed or cropped picture are not pixels of its frame
        on_ground = np.concatenate([X[..., :2], np.zeros_like(X[..., :1])], axis=-1)  # 0 also where X is NaN
        covariance = calibration.uncertainty.at_field(on_ground, relative_to=relative_to).covariance
    else:
        covariance = np.full((*X.shape[:-1], 2, 2), np.nan)
    if pixel_sd > 0.0:
        J = ground_by_pixel(calibration, np.asarray(xy, dtype=float))
        covariance = covariance + pixel_sd**2 * J @ np.swapaxes(J, -2, -1)
    return GroundPoints(X, covariance)


def ground_by_pixel(calibration: Calibration, xy: Array) -> Array:
    """Derivatives (..., 2, 2) of ground points by their pixels (..., 2)."""
    steps = STEP * np.eye(2).reshape(2, *[1] * (xy.ndim - 1), 2)
    columns = (calibration.image_to_field(xy + steps) - calibration.image_to_field(xy - steps)) / (2.0 * STEP)
    return np.moveaxis(columns, 0, -1)[..., :2, :]
