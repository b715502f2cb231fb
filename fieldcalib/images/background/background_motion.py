"""Estimation of the background's motion between two frames, from points that were followed from one to the other.

A camera on a tripod turns and zooms: apart from lens distortion, static points of the scene move by the homography
``K2 R2 R1^T K1^-1``, whatever their depth. RANSAC finds the motion that most points follow, and Gauss-Newton refines it
(`background_motion`). `fieldcalib.images.background.matches` finds the points.

If the centre of the camera moves, the motion of a point depends on its depth. Points in one plane still move by a
homography, and a camera on wires or a drone sees mostly the ground (`plane_motion`). Stands and boards move
differently, and are left out like players.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from fieldcalib._types import Array, BoolArray, Float32

# Lengths are in pixels of the reduced frames.
RANSAC_TOLERANCE = 3.0  # px: large, as a similarity models no lens and no perspective
RANSAC_ITERATIONS = 1000  # at most; two points make a similarity: with a third of inliers, 60 draws find it in 99.9 %
TOLERANCE = (0.3, 2.0)  # px: points with a smaller residual are always background, those with a larger one never
TOLERANCE_IN_SCALES = 4.0  # residual up to which points in between are background, in robust standard deviations
ITERATIONS = 6  # of the fit with lens, at most
PLAIN_ITERATIONS = 3  # of the fit without lens, which starts at the fit with lens
PLAIN_POINTS = 100  # approximate number of points in the fit without lens
CONVERGED = 0.02  # relative change of the scale of the residuals that ends the fit
FIXED_ITERATIONS = 2  # first iterations, on RANSAC's inliers: its motion holds in the middle of the picture only
PRIOR_NOISE = 1.0  # px: standard deviation of a coordinate, large since errors of flow are correlated
FOCAL_PRIOR = (1.25, 0.6)  # mean and deviation of log(focal length / half the diagonal): twice the width
FOCAL_GUESSES = (1.25, 0.7, 1.8)  # values of this log that RANSAC tries in turn
ENOUGH = 0.6  # share of inliers above which the next guesses are skipped
LARGEST_STEP = 0.4  # change of the logs of focal length and zoom in one iteration; log(1 - 2 step) needs less than 0.5
LARGEST_LENS = 0.4  # relative displacement of the corner by the lens; beyond it, U folds back
LENS_PRIOR = (0.03, 0.05)  # mean and deviation of this displacement; median of broadcast cameras: 0.028
LARGEST_ZOOM = 6.0  # between two frames
LARGEST_ROLL = 0.35  # radians between two frames: a camera on a tripod stays upright
LARGEST_STRETCH = 1.5  # ratio of the scales in two directions, in the middle of the picture
STILL = 0.3  # px: points that move less stand still in the picture; flow of static graphics scatters by 0.05 to 0.1
LEAST_POINTS = 12  # inliers of a motion
PLANE_RANSAC_ITERATIONS = 2000  # at most; four points make a homography: with half of inliers, 72 draws find it in 99 %
PLANE_ITERATIONS = 4  # of the fit of a homography to its inliers


FoundMotion: TypeAlias = tuple[Array, BoolArray, float]
"""A homography (3, 3), whether each point follows it, (n,), and the scale of the residuals of these, px."""


def background_motion(x: Array, y: Array, candidates: BoolArray, size: tuple[int, int]) -> FoundMotion | None:
    """Find the rotation and zoom of the camera that most candidates follow, among points x (n, 2) that moved to y."""
    N = _normalisation(size)
    p, q = mapped(N, x), mapped(N, y)
    found = _consensus(p[candidates], q[candidates], RANSAC_TOLERANCE * N[0, 0])
    if found is None:
        return None
    rough, agree = found
    inlier = candidates.copy()
    inlier[candidates] = agree
    refined = _refined(rough, p, q, inlier, 1.0 / N[0, 0])
    if refined is None:
        return None
    plain, distance, scale = refined
    return np.linalg.inv(N) @ plain.H @ N, distance < tolerance(scale), float(scale)


def _normalisation(size: tuple[int, int]) -> Array:
    """Map (3, 3) that takes the middle of the picture to the origin and its corners to distance 1."""
    x, y = 0.5 * np.subtract(size, 1.0)
    unit = np.hypot(x, y)
    return np.array([[1.0 / unit, 0.0, -x / unit], [0.0, 1.0 / unit, -y / unit], [0.0, 0.0, 1.0]])


def mapped(H: Array, xy: Array | Float32) -> Array:
    """Points (n, 2) mapped by a homography; NaN on and behind its vanishing line."""
    h = xy @ H[:, :2].T + H[:, 2]
    w = h[:, 2:]
    return np.asarray(h[:, :2] / np.where(w * np.sign(H[2, 2]) > 0.0, w, np.nan), dtype=np.float64)


def _consensus(p: Array, q: Array, tolerance: float) -> tuple[Motion, BoolArray] | None:
    """Find a rotation and zoom by RANSAC, and which points follow it; deterministic.

    Lines of sight are projected stereographically, for a few focal lengths in turn. This projection is conformal: small
    rotations and zooms become similarities up to second order terms, which are a quarter as large as in the picture
    itself. A similarity has four parameters; the eight of a homography would also fit players who run in the direction
    in which the camera pans.
    """
    import cv2

    if len(p) < LEAST_POINTS:
        return None
    best: tuple[Motion, BoolArray] | None = None
    most = LEAST_POINTS - 1
    for log_f in FOCAL_GUESSES:
        f = float(np.exp(log_f))
        a, b = (2.0 * z / (1.0 + np.sqrt(1.0 + np.sum(z * z, axis=1, keepdims=True) / f**2)) for z in (p, q))
        S, agree = cv2.estimateAffinePartial2D(
            a, b, method=cv2.RANSAC, ransacReprojThreshold=tolerance, maxIters=RANSAC_ITERATIONS, confidence=0.999
        )
        if S is None or np.sum(agree) <= most:
            continue
        zoom, roll = float(np.hypot(S[0, 0], S[1, 0])), float(np.arctan2(S[1, 0], S[0, 0]))
        far = np.sum(np.square(S[:, 2])) / (2.0 * f) ** 2  # 1 is a rotation by 90 degrees
        if 1.0 / LARGEST_ZOOM < zoom < LARGEST_ZOOM and abs(roll) < LARGEST_ROLL and far < 0.5:
            best, most = (Motion.of(S[:, 2] / (1.0 - far), zoom, roll, log_f), agree[:, 0] > 0), int(np.sum(agree))
            if most > ENOUGH * len(p):
                break
    return best


@dataclass(frozen=True, eq=False)
class Motion:
    """Motion between two pictures of a camera that rotates and zooms.

    ``U(y) = K2 R K1^-1 U(x)`` with the undistortion ``U(x) = x / (1 + lens |x|^2)``. Coordinates are relative to the
    middle of the picture, where the optical axis is, in units of half the diagonal.
    """

    turn: Array
    """Rotation vector (3,) of camera coordinates, R = exp([turn]x)."""
    log_f: float
    """Logarithm of the focal length of the first picture."""
    log_zoom: float
    """Logarithm of the ratio of the second focal length to the first."""
    lens: float

    @property
    def H(self) -> Array:
        """Homography ``K2 R K1^-1`` (3, 3)."""
        f = np.exp(self.log_f)
        R, f2 = _rotation(self.turn), f * np.exp(self.log_zoom)
        return np.asarray(np.diag([f2, f2, 1.0]) @ R @ np.diag([1.0 / f, 1.0 / f, 1.0]))

    @classmethod
    def of(cls, middle: Array, zoom: float, roll: float, log_f: float) -> Motion:
        """Construct the motion that takes the middle of the picture to `middle`, with a zoom, roll and focal length.

        Its lens is the mean of the prior.
        """
        f2 = zoom * np.exp(log_f)
        tilt_pan = np.array([-middle[1], middle[0], 0.0])  # the axis about which (0, 0, 1) turns to (middle, f2)
        sine = float(np.linalg.norm(tilt_pan))
        tilt_pan *= np.arctan2(sine, f2) / max(sine, 1e-12)
        turn = _turn(_rotation(tilt_pan) @ _rotation(np.array([0.0, 0.0, roll])))
        return cls(turn, log_f, float(np.log(zoom)), LENS_PRIOR[0])

    def residuals(self, p: Array, q: Array) -> tuple[Array, Array]:
        """``U(q) - K2 R K1^-1 U(p)`` of points (2, n), (2, n), and its negative derivative (6, 2, n).

        The derivative is by rotation, log f, log zoom and lens. Pixels determine the shift of the picture, which is
        about pan and tilt times focal length. The derivative by log f is therefore taken at constant shift: pan and
        tilt are divided by the factor that multiplies the focal length, so that the fit converges from far away.
        """
        bend_p, bend_q = (1.0 / (1.0 + self.lens * (z[0] * z[0] + z[1] * z[1])) for z in (p, q))
        R = _rotation(self.turn)
        u, v = bend_p * p, bend_q * q
        f1, f2 = np.exp(self.log_f), np.exp(self.log_f + self.log_zoom)
        Y = R[:, :2] @ u + f1 * R[:, 2:]
        scale = f2 / Y[2]  # dm = scale (dY12 - (s, t) dY3)
        s, t = Y[:2] / Y[2]  # Y = Y3 (s, t, 1)
        J = np.empty((6, 2, p.shape[1]))
        m = J[4]
        m[0], m[1] = f2 * s, f2 * t
        J[0, 0], J[1, 0], J[2, 0] = -m[0] * t, f2 + m[0] * s, -m[1]  # dY = d_omega x Y
        J[0, 1], J[1, 1], J[2, 1] = -f2 - m[1] * t, m[1] * s, m[0]
        x, y, z = self.turn
        # (I + W / 2 + W^2 / 6) (x, y, 0), W = [turn]x: left Jacobian of the rotation to second order
        a, b, c = x - z * y / 2.0 - z * z * x / 6.0, y + z * x / 2.0 - z * z * y / 6.0, z * (x * x + y * y) / 6.0
        dY_dlog_f = f1 * R[:, 2]
        dY_dlens = R[:, :2] @ (-(p[0] * p[0] + p[1] * p[1]) * bend_p * u)
        by_lens = (q[0] * q[0] + q[1] * q[1]) * bend_q * v
        for row, along in enumerate((s, t)):
            by_focal_length = scale * (dY_dlog_f[row] - along * dY_dlog_f[2])
            J[3, row] = m[row] + by_focal_length - (a * J[0, row] + b * J[1, row] + c * J[2, row])
            J[5, row] = scale * (dY_dlens[row] - along * dY_dlens[2]) + by_lens[row]
        return v - m, J

    def fitted(self, r: Array, J: Array, noise: float, free_lens: bool) -> Motion:
        """Take a Gauss-Newton step with priors; `noise` is the standard deviation of a coordinate."""
        J = J[: 6 if free_lens else 5].reshape(6 if free_lens else 5, -1)
        A, g = J @ J.T, J @ r.reshape(-1)
        for i, value, (mean, deviation) in ((3, self.log_f, FOCAL_PRIOR), (5, self.lens, LENS_PRIOR)):
            if i < len(g):
                A[i, i] += (noise / deviation) ** 2
                g[i] += (noise / deviation) ** 2 * (mean - value)
        step = np.zeros(6)
        step[: len(g)] = np.linalg.solve(A, g)
        step_f = -0.5 * float(np.log1p(-2.0 * np.clip(step[3], -LARGEST_STEP, LARGEST_STEP)))  # linear in 1 / f^2
        lens = float(np.clip(self.lens + step[5], -LARGEST_LENS, LARGEST_LENS))
        turn = self.turn * (np.exp(-step_f), np.exp(-step_f), 1.0)
        turn = _turn(_rotation(step[:3]) @ _rotation(turn))
        step_zoom = float(np.clip(step[4], -LARGEST_STEP, LARGEST_STEP))
        return Motion(turn, self.log_f + step_f, self.log_zoom + step_zoom, lens)


def _refined(motion: Motion, p: Array, q: Array, inlier: BoolArray, unit: float) -> tuple[Motion, Array, float] | None:
    """Refine the motion of a camera that rotates and zooms by Gauss-Newton, with hard rejection of outliers.

    It has six parameters, and not the nine of a homography with a lens: if all matches lie in a strip of boards, a
    homography is arbitrary in the rest of the picture. Focal length and lens have priors, since small motions do not
    determine them. Modelling the lens halves the residuals of frames far apart, so that the tolerance separates players
    better.

    Returns
    -------
    plain : Motion
        The best motion without lens, which is a homography.
    distance : (n,) array
        Distance of each point from where the motion with lens takes it, px; `unit` is the px per unit of length.
    scale : float
        Robust standard deviation of a coordinate over the inliers, px.
    """
    p, q, keep, scale = np.ascontiguousarray(p.T), np.ascontiguousarray(q.T), inlier, np.inf
    for i in range(ITERATIONS + 1):
        r, J = motion.residuals(p, q)
        distance = np.hypot(*r) * unit
        if i >= FIXED_ITERATIONS:
            keep = distance < tolerance(scale)
            if np.sum(keep) < LEAST_POINTS:
                return None
        before, scale = scale, robust_deviation(r[:, keep]) * unit
        if i == ITERATIONS or (i > FIXED_ITERATIONS and abs(scale - before) < CONVERGED * scale):
            break
        motion = motion.fitted(r[:, keep], J[..., keep], PRIOR_NOISE / unit, True)
    plain = replace(motion, lens=0.0)
    some = np.flatnonzero(keep)[:: 1 + np.sum(keep) // PLAIN_POINTS]
    p, q = p[:, some], q[:, some]
    for _ in range(PLAIN_ITERATIONS):
        plain = plain.fitted(*plain.residuals(p, q), PRIOR_NOISE / unit, False)
    return plain, distance, scale


def _rotation(turn: Array) -> Array:
    """Rotation matrix exp([turn]x), (3, 3)."""
    import cv2

    return np.asarray(cv2.Rodrigues(turn)[0])


def _turn(R: Array) -> Array:
    """Invert `_rotation`, below 180 degrees; cv2.Rodrigues would round angles below 1e-5 (0.02 px) to 0."""
    axis = 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    sine = float(np.linalg.norm(axis))
    angle = float(np.arctan2(sine, 0.5 * (R[0, 0] + R[1, 1] + R[2, 2] - 1.0)))
    return axis * (angle / sine if sine > 0.0 else 1.0)


def graphics(H: Array, x: Array, y: Array, scale: float) -> BoolArray:
    """Whether each point stands still in the picture though the background there moves: a point of static graphics."""
    still = np.linalg.norm(y - x, axis=1) < STILL
    return np.asarray(still & (np.linalg.norm(mapped(H, x) - x, axis=1) > tolerance(scale)))


def robust_deviation(r: Array) -> float:
    """Robust standard deviation of residuals: 1.4826 times the median of their absolute values."""
    size = np.abs(r).ravel()
    size.sort()  # np.median spends more time on checks than on computing
    return 1.4826 * float(0.5 * (size[(len(size) - 1) // 2] + size[len(size) // 2]))


def tolerance(scale: float) -> float:
    """Largest distance, px, of a background point from the motion, for residuals with a standard deviation `scale`."""
    return float(np.clip(TOLERANCE_IN_SCALES * scale, *TOLERANCE))


def shape_change(H: Array, size: tuple[int, int]) -> tuple[float, float, float]:
    """Zoom, roll (radians) and stretch of a homography in the middle of the picture; zoom 0 where it mirrors."""
    x = np.array([0.5 * size[0], 0.5 * size[1], 1.0])
    m = H @ x
    if m[2] * np.sign(H[2, 2]) <= 0.0:
        return 0.0, 0.0, np.inf
    A = (H[:2, :2] - np.outer(m[:2] / m[2], H[2, :2])) / m[2]
    (a, b), (c, d) = A.tolist()
    determinant = a * d - b * c
    if not determinant > 0.0:
        return 0.0, 0.0, np.inf
    mean, difference = 0.5 * np.hypot(a + d, c - b), 0.5 * np.hypot(a - d, c + b)  # of the singular values
    stretch = float((mean + difference) ** 2 / determinant)
    return float(np.sqrt(determinant)), float(np.arctan2(c - b, a + d)), stretch


def is_plausible(H: Array, size: tuple[int, int]) -> bool:
    """Whether a homography may be the motion of a camera on a tripod; false if it is NaN."""
    zoom, roll, stretch = shape_change(H, size)
    return 1.0 / LARGEST_ZOOM < zoom < LARGEST_ZOOM and abs(roll) < LARGEST_ROLL and stretch < LARGEST_STRETCH


def plane_motion(x: Array, y: Array, candidates: BoolArray, size: tuple[int, int]) -> FoundMotion | None:
    """Find the motion of points in one plane; arguments and result as of `background_motion`."""
    import cv2

    if np.count_nonzero(candidates) < LEAST_POINTS:
        return None
    found, agree = cv2.findHomography(
        x[candidates], y[candidates], cv2.RANSAC, RANSAC_TOLERANCE, maxIters=PLANE_RANSAC_ITERATIONS, confidence=0.999
    )
    if found is None:
        return None
    near = candidates.copy()
    near[candidates] = agree[:, 0] > 0
    for _ in range(PLANE_ITERATIONS):
        if np.count_nonzero(near) < LEAST_POINTS:
            return None
        found, _ = cv2.findHomography(x[near], y[near])
        if found is None:
            return None
        H = np.asarray(found, dtype=float)
        r = np.nan_to_num(y - mapped(H, x), nan=np.inf)  # behind the vanishing line
        scale = robust_deviation(r[near])
        near = np.linalg.norm(r, axis=1) < tolerance(scale)
    return H, near, scale
