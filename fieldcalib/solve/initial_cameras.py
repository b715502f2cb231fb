"""Initial cameras: one from each camera distribution, pointed at the labels, and one from lines by the DLT.

The solver runs from all of them and keeps the best (`argmin` in the paper, section "Multiple Initialization").
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from fieldcalib._types import Array, BoolArray, IntArray
from fieldcalib.fields.segments import LineRows, Rows
from fieldcalib.fields.traits import DEVIATIONS, SOCCER_SCALE
from fieldcalib.geometry.homography import decompose_homography, fit_lines, homogenize, homography_from_lines
from fieldcalib.geometry.lens import Lens
from fieldcalib.geometry.rotation import angles_from_rotation, rotation_from_angles
from fieldcalib.problem.layout import (
    ANGLES,
    CENTER,
    COMMON,
    LOG_F,
    PAN,
    POSE_AND_ZOOM,
    PRINCIPAL_POINT,
    ROLL,
    TILT,
    GaussianPrior,
    exp_of,
)
from fieldcalib.problem.observations import Observations

SHORT, NEAREST = 1.0 / 8.0, 1.0 / 40.0  # in units of the scale: length of short segments, depth of the nearest one
LEAST_SPREAD = 1e-3  # of the image's diagonal, and of the depth: added to spreads, which may be 0
ON_GROUND = 1e-9  # metres
MOST_MEMBERS = 1_000_000  # pixels, of all frames, times labels whose lines are fitted at a time: some 60 MB
Z = CENTER.stop - 1
FOCAL_LENGTHS = np.array([-1.0, 0.0, 1.0])  # tried by the DLT, in standard deviations
PART_IN_VIEW = 1.5  # segments reach beyond the image, so their middles lie further apart than their pixels


@dataclass(frozen=True)
class InitialCameras:
    """N initial cameras for T frames."""

    theta: Array
    """(N, n)."""
    frame: IntArray
    """Frame of each camera, (N,), ascending."""
    prior: GaussianPrior
    """Prior of the distribution that each camera belongs to, means and sigmas (N, n)."""


def initial_cameras(
    observations: Observations,
    stands: GaussianPrior,
    known: Array,
    scale: float = SOCCER_SCALE,
    lens: Lens | None = None,
) -> InitialCameras:
    """Initial cameras of every frame: from each stand, and by the DLT if there are at least four ground lines.

    If the position is known, there is a single one. Where the lens is one that the DLT cannot do without, there is one
    by the DLT for each of some focal lengths.

    Parameters
    ----------
    observations : Observations
        T frames, each with at least one pixel.
    stands : GaussianPrior
        Priors (K, n) of the stands. A camera of the DLT belongs to the nearest stand, by z-score.
    known : (n,) array
        Parameters given by the user; NaN for unknown ones.
    scale : float
        Size of the part of the object that is usually in view, metres.
    lens : Lens, optional
        The lens that pixels are seen through.
    """
    T, K = len(observations), len(stands.mean)
    if np.isnan(known[CENTER]).any():
        pointed = pointed_camera(observations, stands, known, scale)
        by_lines = [camera_from_lines(one, known, scale) for one in _through_pinhole(observations, known, lens)]
        theta = [*pointed, *(some[found] for some, found in by_lines)]
        frame = [*K * [np.arange(T)], *(np.flatnonzero(found) for _, found in by_lines)]
        member = [np.full(T, i) for i in range(K)] + [_nearest_stand(some, stands) for some in theta[K:]]
    else:
        theta = [pointed_camera(observations, GaussianPrior(stands.mean[0], stands.sigma[0]), known, scale)]
        frame, member = [np.arange(T)], [_nearest_stand(theta[0], stands)]
    order = np.argsort(np.concatenate(frame), kind="stable")
    return InitialCameras(
        np.concatenate(theta)[order], np.concatenate(frame)[order], stands.take(np.concatenate(member)[order])
    )


def cameras_elsewhere(
    observations: Observations, stands: GaussianPrior, known: Array, scale: float, found: Array
) -> InitialCameras:
    """Initial cameras of T frames, higher and lower than the middles of the stands, and those (T, n) found before."""
    T, K = len(observations), len(stands.mean)
    moved, sigma = np.tile(stands.mean, (2, 1)), np.tile(stands.sigma, (2, 1))
    moved[:, Z] += np.repeat((1.0, -1.0), K) * sigma[:, Z]
    theta = np.stack([*pointed_camera(observations, GaussianPrior(moved, sigma), known, scale), found], axis=1)
    member = np.column_stack([np.tile(np.arange(K), (T, 2)), _nearest_stand(found, stands)])
    return InitialCameras(
        theta.reshape(-1, theta.shape[-1]), np.repeat(np.arange(T), 2 * K + 1), stands.take(member.ravel())
    )


def _through_pinhole(observations: Observations, known: Array, lens: Lens | None) -> Iterator[Observations]:
    """The observations as a camera without lens would see them: as they are, but for a lens that bends all lines.

    Such a lens is undone for some focal lengths that it usually has, or for the known one.
    """
    if lens is None or lens.usual_focal_length is None:
        yield observations
        return
    usual, sigma = lens.usual_focal_length
    width, height = observations.image_size
    log_f = usual + np.log(width) + sigma * FOCAL_LENGTHS if np.isnan(known[LOG_F]) else known[LOG_F, None]
    centre = np.where(np.isnan(known[PRINCIPAL_POINT]), (width / 2.0, height / 2.0), known[PRINCIPAL_POINT])
    b = np.nan_to_num(known[len(COMMON) : len(COMMON) + len(lens.names)])
    for f in np.exp(log_f):
        rows = []
        for one in observations.rows:
            s = np.moveaxis(
                lens.undistort(np.moveaxis(one.xy - centre, -1, 0), lens.at_focal_length(b, f)[:, None, None]), 0, -1
            )
            seen = np.all(np.isfinite(s), axis=-1)
            rows.append(
                replace(one, xy=centre + np.where(seen[..., None], s, 0.0), weight=np.where(seen, one.weight, 0.0))
            )
        yield replace(observations, rows=tuple(rows))


def given_cameras(theta: Array, stands: GaussianPrior) -> InitialCameras:
    """Initial cameras from given ones (T, n), one for each frame."""
    return InitialCameras(theta, np.arange(len(theta)), stands.take(_nearest_stand(theta, stands)))


def _nearest_stand(theta: Array, stands: GaussianPrior) -> IntArray:
    """Index (N,) of the stand that is nearest to each camera (N, n), by z-score."""
    z = stands.z_scores(theta[:, None])[..., POSE_AND_ZOOM]
    return np.asarray(np.argmin(np.sum(np.square(z), axis=-1), axis=-1))


def pointed_camera(
    observations: Observations, prior: GaussianPrior, known: Array, scale: float = SOCCER_SCALE
) -> Array:
    """Cameras at the mean position of a prior, turned and zoomed towards the labelled segments, (T, n).

    The middles of the labelled segments, weighted towards short ones, are matched to their pixels: their centroid gives
    pan and tilt, their spread the focal length, within the prior's 95 %. Roll is zero. For K priors, means and sigmas
    (K, n), the cameras are (K, T, n).
    """
    X, xy, weight = _segment_middles(observations, SHORT * scale)
    start = np.where(np.isnan(known), prior.mean, known)
    theta = np.repeat(start[..., None, :], len(X), axis=-2)
    if np.isnan(known[PAN]):
        theta[..., ROLL] = 0.0 if np.isnan(known[ROLL]) else known[ROLL]
        # a copy, see `exp_of`
        x, y, z = np.moveaxis(np.sum(weight * X, axis=1) - theta[..., CENTER], -1, 0).copy()
        theta[..., PAN], theta[..., TILT] = np.arctan2(x, -y), np.arctan2(np.hypot(x, y), z)
    if np.isnan(known[LOG_F]):
        Xc = (X - theta[..., None, CENTER]) @ np.swapaxes(rotation_from_angles(theta[..., ANGLES]), -1, -2)
        x = Xc[..., :2] / np.maximum(Xc[..., 2:], NEAREST * scale)
        least = LEAST_SPREAD * np.hypot(*observations.image_size)
        log_f = np.log(PART_IN_VIEW * (_spread(xy, weight) + least) / (_spread(x, weight) + LEAST_SPREAD))
        mean, margin = prior.mean[..., LOG_F, None], DEVIATIONS * prior.sigma[..., LOG_F, None]
        theta[..., LOG_F] = np.clip(log_f, mean - margin, mean + margin)
    if np.isnan(known[PAN]):
        # the target is to appear at the pixels, not in the middle of the image
        offset = np.sum(weight * xy, axis=1) - theta[..., PRINCIPAL_POINT]
        angle = np.arctan(offset / exp_of(theta, LOG_F)[..., None])
        theta[..., PAN] -= angle[..., 0] / np.maximum(np.sin(theta[..., TILT]), 0.3)
        theta[..., TILT] += angle[..., 1]
    return theta


def straight_above(observations: Observations, mean: Array, scale: float) -> Array:
    """Cameras (T, n) that look straight down where the middles of segments are seen nearest to their pixels.

    All but the pose is that of `mean` (n,), as height and focal length are open against one another; NaN where all
    segments have one middle. Plane and image are complex numbers: ``xy = f / height exp(-i pan) (X - C)``. `scale` is
    the size of the part that is usually in view, metres.
    """
    X, xy, weight = _segment_middles(observations, SHORT * scale)
    points, seen = (p[..., 0] + 1j * p[..., 1] for p in (X, xy - mean[PRINCIPAL_POINT]))
    X0, xy0 = (np.sum(weight[..., 0] * p, axis=1, keepdims=True) for p in (points, seen))
    spread = weight[..., 0] * np.conj(points - X0)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.sum(spread * (seen - xy0), axis=1) / np.sum(spread * (points - X0), axis=1)
        C = X0[:, 0] - xy0[:, 0] / ratio
        theta = np.repeat(mean[None], len(C), axis=0)
        theta[:, ANGLES] = np.angle(ratio)[:, None] * (-1.0, 0.0, 0.0)
        theta[:, CENTER] = np.stack([C.real, C.imag, -np.exp(mean[LOG_F]) / np.abs(ratio)], axis=1)
    return theta


def _segment_middles(observations: Observations, short: float) -> tuple[Array, Array, Array]:
    """Middle of each pixel's segment (T, N, 3), the pixel (T, N, 2), and its weight (T, N, 1), with sum 1 in each
    frame.

    An unknown part of a long segment is in view: weights decrease with the square of the length.
    """
    X, xy, weight = [], [], []
    for rows in observations.rows:
        if not rows:
            continue
        middle, length = rows.extent
        X.append(middle)
        xy.append(rows.xy)
        weight.append(rows.weight / np.square(length + short))  # short segments weigh alike
    w = np.concatenate(weight, axis=1)
    w /= np.sum(w, axis=1, keepdims=True)
    return np.concatenate(X, axis=1), np.concatenate(xy, axis=1), w[..., None]


def _spread(x: Array, weight: Array) -> Array:
    """Weighted standard deviation of points (..., N, D) around their centroids, (...)."""
    centred = x - np.sum(weight * x, axis=-2, keepdims=True)
    return np.asarray(np.sqrt(np.sum(weight * np.square(centred), axis=(-2, -1))))


def camera_from_lines(observations: Observations, known: Array, scale: float = SOCCER_SCALE) -> tuple[Array, BoolArray]:
    """Cameras from the homography of the ground's lines by the DLT, (T, n), and which frames have one, (T,).

    The homography is decomposed with the known principal point or, if unknown, the image's centre.
    """
    T, rows = len(observations), observations.of_kind(LineRows)
    theta = np.broadcast_to(np.where(np.isnan(known), 0.0, known), (T, len(known))).copy()
    image_centre = np.array(observations.image_size) / 2.0
    principal_point = np.where(np.isnan(known[PRINCIPAL_POINT]), image_centre, known[PRINCIPAL_POINT])
    theta[:, PRINCIPAL_POINT] = principal_point
    H, found = ground_homographies(observations, principal_point, scale)
    if not found.any():
        return theta, found
    # a ground point in view: that of the pixels' centroid
    on_ground = _ground_rows(rows)
    pixel = np.sum(on_ground[..., None] * rows.xy, axis=1) / np.maximum(np.sum(on_ground, axis=1), 1)[:, None]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        seen_at = np.linalg.solve(H + 1e-12 * np.eye(3), homogenize(pixel)[..., None])[..., 0]
        f, R, C = decompose_homography(H, principal_point, seen_at[:, :2] / seen_at[:, 2:])
    found &= np.isfinite(f) & np.isfinite(C).all(axis=1) & (f > 0.0)
    theta[found, LOG_F] = np.log(f[found])
    theta[found, ANGLES] = angles_from_rotation(R[found])
    theta[found, CENTER] = C[found]
    given = ~np.isnan(known)
    theta[:, given] = known[given]
    return theta, found


def ground_homographies(
    observations: Observations, principal_point: Array, scale: float = SOCCER_SCALE
) -> tuple[Array, BoolArray]:
    """Homographies of the ground from its lines, by the DLT.

    Lines are fitted to the pixels of each segment, with their lengths in the image as weights.

    Parameters
    ----------
    observations : Observations
        T frames.
    principal_point : (2,) array
        Origin of normalised image coordinates, pixels.
    scale : float
        Unit of normalised field coordinates, metres.

    Returns
    -------
    H : (T, 3, 3) array
        Map field points (x, y, 1) in metres to pixels, up to scale and sign; NaN for frames without one.
    found : (T,) bool array
        Mask of the frames with one: those with four lines on the ground, each labelled at two different pixels.
    """
    T, rows = len(observations), observations.of_kind(LineRows)
    on_ground = _ground_rows(rows)
    labels = np.unique(rows.label[on_ground])
    if len(labels) < 4:
        return np.full((T, 3, 3), np.nan), np.zeros(T, dtype=bool)

    rho = np.hypot(*observations.image_size) / 2.0
    at_once = max(MOST_MEMBERS // rows.label.size, 1)
    parts = [_image_lines(rows, on_ground, labels[k : k + at_once], rho) for k in range(0, len(labels), at_once)]
    image_lines, length = (np.concatenate(part, axis=1) for part in zip(*parts, strict=True))

    known, first = np.unique(rows.label, return_index=True)
    first = first[np.searchsorted(known, labels)]  # every row of a label has its segment
    start, direction = np.moveaxis(rows.geometry.reshape(-1, 2, 3)[first], 1, 0)
    field_lines = np.cross(homogenize(start[:, :2]), homogenize(start[:, :2] + direction[:, :2]))
    to_unit_field = np.diag([1.0 / scale, 1.0 / scale, 1.0])
    cx, cy = principal_point
    to_unit_image = np.array([[1.0 / rho, 0.0, -cx / rho], [0.0, 1.0 / rho, -cy / rho], [0.0, 0.0, 1.0]])
    H = homography_from_lines(
        np.broadcast_to(field_lines, image_lines.shape), image_lines, length, to_unit_field, to_unit_image
    )
    found = np.sum(length > 0.0, axis=1) >= 4
    return np.where(found[:, None, None], H, np.nan), found


def _image_lines(rows: Rows, on_ground: BoolArray, labels: IntArray, rho: float) -> tuple[Array, Array]:
    """Lines (T, L, 3) through the pixels of L labels, and their lengths (T, L) in the image, in `rho` pixels."""
    member = (rows.label[:, None] == labels[:, None]) & on_ground[:, None]  # (T, L, N)
    inside, x = member[..., None], rows.xy[:, None] / rho
    extent = np.max(np.where(inside, x, -np.inf), axis=2) - np.min(np.where(inside, x, np.inf), axis=2)
    length = np.where(member.any(axis=-1), np.linalg.norm(extent, axis=-1), 0.0)
    return fit_lines(rows.xy[:, None], member.astype(float)), length


def _ground_rows(rows: Rows) -> BoolArray:
    """Mask (T, N) of the pixels on lines of the ground."""
    return np.asarray(np.all(np.abs(rows.geometry[..., 2]) < ON_GROUND, axis=-1) & (rows.weight > 0.0))
