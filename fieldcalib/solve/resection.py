"""A camera from points and their images by the DLT, robust to outliers: the initial camera if nothing is known.

Images are offsets from the principal point, (x, y) in square pixels, undistorted.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fieldcalib._types import Array, IntArray
from fieldcalib.geometry.homography import decompose_homography, pose_from_homography
from fieldcalib.geometry.projective import homography_from_points, projection_from_points
from fieldcalib.problem.evaluation import LOG_F_RANGE
from fieldcalib.problem.losses import RobustLoss

LEAST_ON_PLANE, LEAST_IN_SPACE = 4, 6  # points that the DLT needs
FLAT = 1e-6  # of the extent: thinner sets of points are a line, or a plane
DRAWS = 200  # random subsets: if a third of the points are gross errors, one subset of six in twelve has none
SCORED, FINALISTS = 1000, 5  # points on which all draws are scored; the best draws are scored on all points
FARTHEST = 1e6  # px: largest distance; also for points behind the camera


@dataclass(frozen=True)
class Cameras:
    """n cameras with square pixels."""

    f: Array
    """Focal lengths, (n,); NaN for missing cameras."""
    R: Array
    """Rotations, (n, 3, 3)."""
    C: Array
    """Centres, (n, 3)."""

    def joined(self, other: Cameras) -> Cameras:
        """The cameras followed by the other ones."""
        return Cameras(
            np.concatenate([self.f, other.f]), np.concatenate([self.R, other.R]), np.concatenate([self.C, other.C])
        )

    def squared_errors(self, X: Array, u: Array) -> Array:
        """Squared distances (n, N) of the images u (N, 2) to the projections of X (N, 3), square pixels."""
        Xc = (X - self.C[:, None]) @ np.swapaxes(self.R, -1, -2)
        front = Xc[..., 2:] > 0.0
        x = self.f[:, None, None] * Xc[..., :2] / np.where(front, Xc[..., 2:], 1.0)
        error = np.where(front[..., 0], np.sum(np.square(x - u), axis=-1), FARTHEST**2)
        return np.asarray(np.minimum(error, FARTHEST**2) + 0.0 * self.f[:, None])  # NaN stays NaN

    def costs(self, X: Array, u: Array, weight: Array, loss: RobustLoss) -> Array:
        """Robust cost of each camera, (n,), for points with weights (N,); infinite for missing cameras."""
        cost = np.sum(weight * loss.evaluate(self.squared_errors(X, u))[0], axis=-1)
        return np.where(np.isfinite(cost), cost, np.inf)

    def cheapest(self, X: Array, u: Array, weight: Array, loss: RobustLoss, count: int) -> Cameras:
        """The `count` best cameras, the best first."""
        best = np.argsort(self.costs(X, u, weight, loss), kind="stable")[:count]
        return Cameras(self.f[best], self.R[best], self.C[best])


def resect(
    X: Array, u: Array, loss: RobustLoss, width: float, focal_length: float = np.nan, weight: Array | None = None
) -> Cameras | None:
    """The camera of least robust cost among many DLTs.

    The DLTs are of all points, and of many random subsets, some of which have no gross errors: on the plane nearest to
    the points and, if enough of them are off it, in space.

    Parameters
    ----------
    X : (N, 3) array
        Points of the object in any unit.
    u : (N, 2) array
        Images of the points, offsets from the principal point in pixels.
    loss : RobustLoss
        A wide loss.
    width : float
        Width of the image, pixels: focal lengths are of its order, and equal to it if all fit alike (a plane seen
        head-on).
    focal_length : float
        Known focal length, pixels; NaN if unknown.
    weight : (N,) array, optional
        Weight of each point in the cost; by default 1.

    Returns
    -------
    Cameras or None
        One camera; None with fewer than four points, with all of them on a line, or if no camera is possible.

    Examples
    --------
    >>> from fieldcalib.geometry.camera import Camera
    >>> truth = Camera.from_angles(0.3, 1.3, 0.01, 1800.0, (2.0, 70.0, -18.0), (960, 540))
    >>> X = np.array([[0.0, 0, 0], [20, 0, 0], [20, 20, 0], [0, 20, 0], [10, 5, 0]])
    >>> found = resect(X, truth.project(X) - truth.principal_point, RobustLoss("cauchy", 20.0), 960.0)
    >>> found.f.round(3), found.C.round(3)
    (array([1800.]), array([[  2.,  70., -18.]]))
    """
    if len(X) < LEAST_ON_PLANE:
        return None
    weight = np.ones(len(X)) if weight is None else weight
    origin = X.mean(axis=0)
    _, extent, axes = np.linalg.svd(X - origin, full_matrices=False)
    if extent[1] <= FLAT * extent[0]:
        return None
    axes = axes.T * (1.0, 1.0, np.linalg.det(axes))  # a rotation; the last axis is the normal of the plane
    x = (X - origin) @ axes
    in_space = len(X) >= LEAST_IN_SPACE and extent[2] > FLAT * extent[0]

    def cameras(rows: IntArray, f: float) -> Cameras:
        found = _cameras_of_plane(x[rows], u[rows], f)
        if in_space:
            found = found.joined(_cameras_of_space(x[rows], u[rows], f))
        low, high = LOG_F_RANGE
        log_f = np.log(found.f / width)
        possible = np.isfinite(found.C).all(axis=-1) & (log_f > low) & (log_f < high)  # false for NaN
        return Cameras(np.where(possible, found.f, np.nan), found.R, np.where(possible[:, None], found.C, 0.0))

    rng = np.random.default_rng(0)  # the same points give the same camera
    all_points = np.arange(len(X))[None]
    count = min(len(X), SCORED)
    drawn = np.argsort(rng.random((DRAWS, count)), axis=1)[:, : LEAST_IN_SPACE if in_space else LEAST_ON_PLANE]
    scored = np.sort(rng.choice(len(X), count, replace=False))
    subsets = scored[drawn]
    for f in (focal_length, width):
        found = cameras(all_points, f).joined(cameras(subsets, f))
        if np.isfinite(found.f).any():
            best = found.cheapest(x[scored], u[scored], weight[scored], loss, FINALISTS)
            best = best.cheapest(x, u, weight, loss, 1)
            return Cameras(best.f, best.R @ axes.T, origin + best.C @ axes.T)
    return None


def _cameras_of_plane(x: Array, u: Array, f: float) -> Cameras:
    """Cameras from points (n, N, 3) near the plane z = 0, treated as on it."""
    H = homography_from_points(x[..., :2], u, np.ones(x.shape[:2]))
    centroid = np.mean(x[..., :2], axis=-2)  # in front of a camera that sees all points
    if np.isnan(f):
        return Cameras(*decompose_homography(H, np.zeros(2), centroid))
    R, C = pose_from_homography(np.diag([1.0 / f, 1.0 / f, 1.0]) @ H, centroid)
    return Cameras(np.where(np.isnan(C[..., 0]), np.nan, f), R, C)


def _cameras_of_space(x: Array, u: Array, f: float) -> Cameras:
    """Cameras from points (n, N, 3) in space, by ``P = K R [I | -C]``.

    With the rows m_i of ``M = K R``, scaled so that |m3| = 1, ``|m1 x m3|`` and ``|m2 x m3|`` are the focal lengths
    along the two axes (Hartley & Zisserman, section 6.2.4, for K without skew); f is their geometric mean.
    """
    P = projection_from_points(x, u, np.ones(x.shape[:2]))
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        P /= np.linalg.norm(P[..., 2, :3], axis=-1)[..., None, None]
        m1, m2, m3 = np.moveaxis(P[..., :3], -2, 0)
        cofactors = np.stack([np.cross(m2, m3), np.cross(m3, m1), np.cross(m1, m2)], axis=-1)
        det = np.sum(m1 * cofactors[..., 0], axis=-1)
        C = -(cofactors @ P[..., 3:])[..., 0] / det[..., None]
        fx, fy = np.linalg.norm(cofactors[..., 1], axis=-1), np.linalg.norm(cofactors[..., 0], axis=-1)
        focal = np.sqrt(fx * fy) if np.isnan(f) else np.full(len(P), f)
        M = np.sign(det)[..., None, None] * P[..., :3]
        M[..., :2, :] /= focal[..., None, None]
    valid = np.isfinite(C).all(axis=-1) & np.isfinite(M).all(axis=(-1, -2)) & (focal > 0.0)
    U, _, Vh = np.linalg.svd(np.where(valid[..., None, None], M, np.eye(3)))
    return Cameras(np.where(valid, focal, np.nan), U @ Vh, C)
