"""Points in space that several cameras of one field see: a ball, a head, a racket."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import block_diag

from fieldcalib._types import Array, expect, listed, number, positive, real_array
from fieldcalib.assess.estimate import PIXEL_SD
from fieldcalib.assess.result import Calibration
from fieldcalib.fields.field import terrain_of
from fieldcalib.geometry.camera import Camera
from fieldcalib.geometry.homography import homogenize
from fieldcalib.problem.picture_shape import Placement

LEAST_ANGLE = 1.0  # degrees between two rays: below it their crossing is open along them
STEP = 1e-4  # metres, and standard deviations of parameters, of central differences
MOST_STEPS, CONVERGED = 20, 1e-9  # of Gauss and Newton; metres


class SpacePoint(NamedTuple):
    """A point in space with its error."""

    X: Array
    """(3,), metres from the centre mark, z down."""
    covariance: Array
    """(3, 3), square metres."""
    errors: Array
    """Distances (n,) of the pixels from the projections of the point, pixels."""


def triangulate(calibrations: Sequence[Calibration], pixels: ArrayLike, *, pixel_sd: float = PIXEL_SD) -> SpacePoint:
    """The point in space that several cameras see at these pixels, with its covariance.

    The pixels are weighted by their own errors and by those of their cameras at the point, ``sd^2 I + J V J^T`` with V
    the covariance of a camera's parameters. Cameras on a field of one size have its error in common
    (`joint_covariance`); apart from that their errors are independent.

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
    (array([30., -5., -3.]), array([0.3, 0.6, 0.1]))
    """
    seen = [expect(one, Calibration, "results[0]") for one in listed(calibrations, "calibrations")]
    cameras, xy = [one.required_camera for one in seen], real_array(pixels)
    if len(seen) < 2 or xy.shape != (len(seen), 2) or not np.all(np.isfinite(xy)):
        raise ValueError(
            f"expected calibrations, two or more, and a finite pixel of one point in each, got {len(seen)}, {xy.shape}"
        )
    positive(pixel_sd, "pixel_sd")
    C = np.array([camera.C for camera in cameras])
    rays = np.array([homogenize(camera.normalized(one)) @ camera.R for camera, one in zip(cameras, xy, strict=True)])
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    angle = np.degrees(np.arcsin(np.clip(np.max(np.linalg.norm(np.cross(rays[:, None], rays), axis=-1)), 0.0, 1.0)))
    if not angle >= LEAST_ANGLE:
        raise ValueError(f"the rays are nearly parallel ({angle:.2f} degrees): where they meet is open along them")
    across = np.eye(3) - rays[:, :, None] * rays[:, None]
    X = np.linalg.solve(across.sum(axis=0), np.einsum("nij,nj->i", across, C))
    G = block_diag(*[_by_parameters(one, lambda camera: camera.project(X)) for one in seen])
    weights = np.linalg.inv(pixel_sd**2 * np.eye(xy.size) + G @ joint_covariance(seen) @ G.T)
    steps = STEP * np.eye(3)
    for _ in range(MOST_STEPS):
        ahead = [camera.project(X + steps) - camera.project(X - steps) for camera in cameras]
        J = np.swapaxes(ahead, 1, 2).reshape(-1, 3) / (2.0 * STEP)
        r = np.ravel(xy - [camera.project(X) for camera in cameras])
        if not (np.all(np.isfinite(J)) and np.all(np.isfinite(r)) and np.all(np.isfinite(weights))):
            raise ValueError("the rays do not meet in front of all cameras: are the pixels of one point?")
        covariance = np.asarray(np.linalg.inv(J.T @ weights @ J), dtype=np.float64)
        step = covariance @ J.T @ weights @ r
        X = X + step
        if np.linalg.norm(step) < CONVERGED:
            break
    return SpacePoint(X, covariance, np.linalg.norm(r.reshape(-1, 2), axis=1))


def height_above_ground(
    calibration: Calibration, foot: ArrayLike, top: ArrayLike, *, pixel_sd: float = PIXEL_SD
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
    if xy.shape != (2, 2):
        raise ValueError(f"expected the pixel (x, y) of one foot and of one top, got an array of shape {xy.shape}")

    def height(camera: Camera, xy: Array) -> float:
        X, ray = camera.image_to_field(xy[0], terrain=terrain), homogenize(camera.normalized(xy[1])) @ camera.R
        across = np.eye(3) - np.outer(ray, ray) / (ray @ ray)
        return float(across[2] @ (X - camera.C) / across[2, 2])

    found, moves = height(camera, xy), np.where(np.eye(4), number(pixel_sd, "pixel_sd"), 0.0).reshape(4, 2, 2)
    if not (np.isfinite(found) and np.all(np.isfinite(moves))):
        raise ValueError("no ground is seen at the foot, no ray meets the top, or pixel_sd is not finite")
    moves = np.array([height(camera, xy + one) - found for one in moves])
    (by_camera,) = _by_parameters(calibration, lambda one: np.array([height(one, xy)]))
    return found, float(np.sqrt(moves @ moves + by_camera @ joint_covariance([calibration]) @ by_camera))


def joint_covariance(calibrations: Sequence[Calibration]) -> Array:
    """The covariance of the parameters of several cameras of one field, one camera after the other.

    Errors of different cameras are independent but for that of the size of their field, s: with P the covariance of a
    camera on a field of known size and K the derivatives of its parameters by the size, it has the blocks
    ``P_i + K_i V K_i^T`` and ``K_i V K_j^T``, V being the covariance of s. Cameras on fields of different sizes, or of
    known size, have nothing in common.

    Parameters
    ----------
    calibrations : sequence of Calibration
        Cameras as `calibrate_rig` gives them.

    Returns
    -------
    (N, N) array
        N is the sum of the sizes of the layouts, whose `names` are in ``calibration.uncertainty.layout``; a camera of a
        homography, whose errors are not known, has none.

    Raises
    ------
    ValueError
        If the errors of a camera have no bound, or there are no calibrations.

    Examples
    --------
    >>> import fieldcalib
    >>> field = fieldcalib.soccer()
    >>> angles = (-0.4, 1.35, 0.0), (0.4, 1.35, 0.0)
    >>> cameras = [fieldcalib.Camera.from_angles(*a, 700.0, (40 * a[0], 62.0, -15.0), (960, 540)) for a in angles]
    >>> pixels = [{a: camera.project(field[a].sample(4.0)) for a in field if "rect" in a} for camera in cameras]
    >>> rig = fieldcalib.calibrate_rig(dict(zip("ab", pixels)), image_size=(960, 540), progress=False)
    >>> joint = joint_covariance([results[0] for results in rig.values()])
    >>> n, x = len(joint) // 2, rig["a"][0].uncertainty.layout.names.index("x")
    >>> round(float(joint[x, n + x] / joint[x, x]), 1)  # on a longer field they stand farther apart
    -0.2
    """
    seen = [expect(one, Calibration, "results[0]") for one in listed(calibrations, "calibrations")]
    if not seen:
        raise ValueError("expected one calibration or more, got none")
    is_shared = len({None if one.field is None else (one.field.length, one.field.width) for one in seen}) == 1
    own, common = zip(*(_errors(one, is_shared=is_shared) for one in seen), strict=True)
    return np.asarray(block_diag(*own) + np.vstack(common) @ np.vstack(common).T)


def _errors(calibration: Calibration, *, is_shared: bool) -> tuple[Array, Array]:
    """Covariance (n, n) of a camera on a field of known size, and what a deviation of each size adds to it, (n, 2)."""
    if not calibration.knows_errors:
        return np.zeros((0, 0)), np.zeros((0, 2))
    covariance, size = calibration.uncertainty.covariance, calibration.uncertainty.layout.field_size_block
    if not np.all(np.isfinite(covariance)):
        raise ValueError("the labels leave a camera open: its errors have no bound")
    values, vectors = np.linalg.eigh(covariance[size, size])
    if not (is_shared and np.any(values > 0.0)):
        return covariance, np.zeros((len(covariance), 2))
    inverse = np.where(values > 0.0, 1.0 / np.sqrt(np.maximum(values, np.finfo(float).tiny)), 0.0)
    common = covariance[:, size] @ (vectors * inverse) @ vectors.T
    return covariance - common @ common.T, common


def _by_parameters(calibration: Calibration, seen: Callable[[Camera], Array]) -> Array:
    """Derivatives (m, n) of what a camera sees by its parameters; n is 0 if their errors are not known."""
    camera = calibration.required_camera
    if not calibration.knows_errors:
        return np.zeros((len(seen(camera)), 0))
    estimate = calibration.uncertainty
    placement, steps = Placement.of_cameras(camera, estimate.camera), STEP * np.sqrt(np.diagonal(estimate.covariance))
    ends = (estimate.theta + side * np.diag(steps) for side in (1.0, -1.0))
    after, before = ([seen(placement.camera_in_picture(estimate.layout.camera(one))) for one in some] for some in ends)
    return np.subtract(after, before).T / np.where(steps > 0.0, 2.0 * steps, 1.0)
