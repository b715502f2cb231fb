"""Points in space that several cameras of one field see: a ball, a head, a racket."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib._types import Array, expect, listed, number, positive, real_array
from fieldcalib.assess.result import Calibration
from fieldcalib.fields.field import terrain_of
from fieldcalib.geometry.camera import Camera
from fieldcalib.geometry.homography import homogenize
from fieldcalib.problem.picture_shape import Placement

LEAST_ANGLE = 1.0  # degrees between two rays: below it their crossing is open along them
STEP = 1e-4  # metres, of central differences
MOST_STEPS, CONVERGED = 20, 1e-9  # of Gauss and Newton; metres


class SpacePoint(NamedTuple):
    """A point in space with its error."""

    X: Array
    """(3,), metres from the centre mark, z down."""
    covariance: Array
    """(3, 3), square metres."""
    errors: Array
    """Distances (n,) of the pixels from the projections of the point, pixels."""


def triangulate(calibrations: Sequence[Calibration], pixels: ArrayLike, *, pixel_sd: float = 2.0) -> SpacePoint:
    """The point in space that several cameras see at these pixels, with its covariance.

    The pixels are weighted by their own errors and by those of their cameras at the point, ``sd^2 I + J V J^T`` with V
    the covariance of a camera's parameters; errors of different cameras are taken to be independent.

    Parameters
    ----------
    calibrations : sequence of Calibration
        n cameras of one field, two or more.
    pixels : (n, 2) array_like
        The pixel at which each of them sees the point.
    pixel_sd : float
        Standard deviation of each coordinate of a pixel.

    Raises
    ------
    ValueError
        If numbers do not agree or are invalid, a camera is missing (`NoCameraError`), all rays are nearly parallel, or
        they meet behind a camera.

    Examples
    --------
    >>> from fieldcalib import Camera, calibrate_from_segments, soccer
    >>> field = soccer(105.0, 68.0, size_known=True)
    >>> places = ((0.2, (1.0, 65.0, -16.0)), (0.6, (-30.0, 60.0, -14.0)))
    >>> cameras = [Camera.from_angles(pan, 1.35, 0.0, 1400.0, C, (960, 540)) for pan, C in places]
    >>> def labelled(camera):
    ...     return {label: camera.project(one.sample(9.0)) for label, one in field.items() if "rect. right" in label}
    >>> found = [calibrate_from_segments(field, labelled(camera), (960, 540)) for camera in cameras]
    >>> ball = triangulate(found, [camera.project((30.0, -5.0, -3.0)) for camera in cameras])
    >>> ball.X.round(), np.sqrt(np.diagonal(ball.covariance)).round(1)
    (array([30., -5., -3.]), array([0.4, 0.6, 0.2]))
    """
    seen = [expect(one, Calibration, "results[0]") for one in listed(calibrations, "calibrations")]
    cameras, xy = [one.required_camera for one in seen], real_array(pixels)
    if len(seen) < 2 or xy.shape != (len(seen), 2) or not np.all(np.isfinite(xy)):
        raise ValueError(f"expected two calibrations or more, and a pixel of each, got {len(seen)} and {xy.shape}")
    positive(pixel_sd, "pixel_sd")
    C = np.array([camera.C for camera in cameras])
    rays = np.array([homogenize(camera.normalized(one)) @ camera.R for camera, one in zip(cameras, xy, strict=True)])
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    angle = np.degrees(np.arcsin(np.clip(np.max(np.linalg.norm(np.cross(rays[:, None], rays), axis=-1)), 0.0, 1.0)))
    if not angle >= LEAST_ANGLE:
        raise ValueError(f"the rays are nearly parallel ({angle:.2f} degrees): where they meet is open along them")
    across = np.eye(3) - rays[:, :, None] * rays[:, None]
    X = np.linalg.solve(across.sum(axis=0), np.einsum("nij,nj->i", across, C))
    steps, moved = STEP * np.eye(3), [(one.required_camera, _moved(one)) for one in seen]
    for _ in range(MOST_STEPS):
        ahead = [camera.project(X + steps) - camera.project(X - steps) for camera in cameras]
        J = np.swapaxes(ahead, 1, 2) / (2.0 * STEP)
        r = xy - [camera.project(X) for camera in cameras]
        if not (np.all(np.isfinite(J)) and np.all(np.isfinite(r))):
            raise ValueError("the rays do not meet in front of all cameras: are the pixels of one point?")
        by_camera = [
            np.array([one.project(X) - camera.project(X) for one in some]).reshape(-1, 2) for camera, some in moved
        ]
        weights = np.linalg.inv([pixel_sd**2 * np.eye(2) + one.T @ one for one in by_camera])
        JTW = np.swapaxes(J, 1, 2) @ weights
        covariance = np.linalg.inv((JTW @ J).sum(axis=0))
        step = covariance @ np.einsum("nij,nj->i", JTW, r)
        X = X + step
        if np.linalg.norm(step) < CONVERGED:
            break
    return SpacePoint(X, covariance, np.linalg.norm(r, axis=1))


def height_above_ground(
    calibration: Calibration, foot: ArrayLike, top: ArrayLike, *, pixel_sd: float = 2.0
) -> tuple[float, float]:
    """The height of the top of what stands on the ground, from one camera, with its standard deviation, in metres.

    The top is taken to be straight above the foot: the point of that vertical that is nearest to the ray of its pixel.

    Parameters
    ----------
    calibration : Calibration
    foot, top : (2,) array_like
        Pixels where it stands and where it ends.
    pixel_sd : float
        Standard deviation of each coordinate of both pixels.

    Raises
    ------
    ValueError
        If there is no camera (`NoCameraError`), or no ground is seen at the foot.

    Examples
    --------
    >>> from fieldcalib import Camera, calibrate_from_homography
    >>> truth = Camera.from_angles(0.2, 1.35, 0.0, 1400.0, (1.0, 65.0, -16.0), (960, 540))
    >>> found = calibrate_from_homography(truth.homography, (960, 540))
    >>> height, sd = height_above_ground(found, truth.project((9.0, 0.0, 0.0)), truth.project((9.0, 0.0, -1.9)))
    >>> round(height, 2), round(sd, 2)
    (1.9, 0.13)
    """
    camera = expect(calibration, Calibration, 'fieldcalib.read("results")[0]').required_camera
    terrain, xy = terrain_of(calibration.field), real_array([foot, top])

    def height(camera: Camera, xy: Array) -> float:
        X, ray = camera.image_to_field(xy[0], terrain=terrain), homogenize(camera.normalized(xy[1])) @ camera.R
        across = np.eye(3) - np.outer(ray, ray) / (ray @ ray)
        return float(across[2] @ (X - camera.C) / across[2, 2])

    found, moves = height(camera, xy), np.where(np.eye(4), number(pixel_sd, "pixel_sd"), 0.0).reshape(4, 2, 2)
    if not (np.isfinite(found) and np.all(np.isfinite(moves))):
        raise ValueError("no ground is seen at the foot, no ray meets the top, or pixel_sd is not finite")
    steps = [height(camera, xy + one) - found for one in moves]
    steps += [height(one, xy) - found for one in _moved(calibration)]
    return found, float(np.linalg.norm(steps))


def _moved(calibration: Calibration) -> list[Camera]:
    """The camera moved by a standard deviation along each principal axis of its errors; none if they are not known."""
    if not calibration.knows_errors:
        return []
    estimate = calibration.uncertainty
    if not np.all(np.isfinite(estimate.covariance)):
        raise ValueError("the labels leave a camera open: its errors have no bound")
    values, vectors = np.linalg.eigh(estimate.covariance)
    placement = Placement.of_cameras(calibration.required_camera, estimate.camera)
    steps = vectors.T[values > 0.0] * np.sqrt(values[values > 0.0])[:, None]  # the covariance is their outer products
    return [placement.camera_in_picture(estimate.layout.camera(estimate.theta + one)) for one in steps]
