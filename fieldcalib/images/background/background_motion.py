"""The motion of the background between two frames (`fieldcalib.images.background.matches` finds the points).

Seen from a tripod, the camera turns and zooms: whatever the depth of the scene, its static points move by
``K2 R2 R1^T K1^-1``, but for the lens. RANSAC finds the motion that most points follow, and Gauss-Newton refines it
(`background_motion`).

Where the centre of the camera moves, points move by their depth. Those of one plane still move by a homography, and a
camera on wires or a drone sees mostly the ground (`plane_motion`). Stands and boards move otherwise, and are left out
like players.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from fieldcalib._types import Array, BoolArray, Float32

# Lengths are in pixels of the reduced frames.
RANSAC_TOLERANCE = 3.0  # px: error of a similarity, which has no lens and no perspective
RANSAC_ITERATIONS = 1000  # at most; two points make a similarity: with a third of inliers, 60 draws find it in 99.9 %
TOLERANCE = (0.3, 2.0)  # px: points with a smaller residual are always background, those with a larger one never
TOLERANCE_IN_SCALES = 4.0  # limit in between, in robust standard deviations
ITERATIONS = 6  # of the fit with lens, at most
PLAIN_ITERATIONS = 3  # of the fit without lens, which starts at the fit with lens
PLAIN_POINTS = 100  # number of points, about, in the fit without lens
CONVERGED = 0.02  # relative change of the scale of the residuals that ends the fit
FIXED_ITERATIONS = 2  # first iterations, on the inliers of RANSAC: its motion is that of the middle of the picture
PRIOR_NOISE = 1.0  # px: standard deviation of a coordinate, large since errors of flow are correlated
FOCAL_PRIOR = (1.25, 0.6)  # mean and deviation of log(focal length / half the diagonal): twice the width
FOCAL_GUESSES = (1.25, 0.7, 1.8)  # values of this log that RANSAC tries in turn
ENOUGH = 0.6  # share of inliers above which the next guesses are skipped
LARGEST_STEP = 0.4  # change of the logs of focal length and zoom in one iteration; the formula ends at 0.5
LARGEST_LENS = 0.4  # relative displacement of the corner by the lens; beyond it, U folds back
LENS_PRIOR = (0.03, 0.05)  # mean and deviation of this displacement; median of broadcast cameras: 0.028
LARGEST_ZOOM = 6.0  # between two frames
LARGEST_ROLL = 0.35  # radians between two frames: a camera on a tripod stays upright
LARGEST_STRETCH = 1.5  # ratio of the scales in two directions, in the middle of the picture
STILL = 0.3  # px: what moves less stands still in the picture; flow of static graphics scatters by 0.05 to 0.1
LEAST_POINTS = 12  # inliers of a motion
PLANE_RANSAC_ITERATIONS = 2000  # at most; four points make a homography: with half of inliers, 72 draws find it in 99 %
PLANE_ITERATIONS = 4  # of the fit of a homography to its inliers


FoundMotion: TypeAlias = tuple[Array, BoolArray, float]
"""A homography (3, 3), which points follow it, (n,), and the scale of their residuals, px."""


def background_motion(x: Array, y: Array, candidates: BoolArray, size: tuple[int, int]) -> FoundMotion | None:
    """The turn and zoom that most candidates follow, among points x (n, 2) that moved to y (n, 2)."""
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
    """(3, 3), takes the middle of the picture to the origin and its corners to distance 1."""
    x, y = 0.5 * np.subtract(size, 1.0)
    unit = np.hypot(x, y)
    return np.array([[1.0 / unit, 0.0, -x / unit], [0.0, 1.0 / unit, -y / unit], [0.0, 0.0, 1.0]])


def mapped(H: Array, xy: Array | Float32) -> Array:
    """Points (n, 2) mapped by a homography; NaN on and behind its vanishing line."""
    h = xy @ H[:, :2].T + H[:, 2]
    w = h[:, 2:]
    return np.asarray(h[:, :2] / np.where(w * np.sign(H[2, 2]) > 0.0, w, np.nan), dtype=np.float64)


def _consensus(p: Array, q: Array, tolerance: float) -> tuple[Motion, BoolArray] | None:
    """A turn and a zoom by RANSAC, and which points follow it; deterministic.

    Lines of sight are projected stereographically, for a few focal lengths in turn. That is conformal, and small
    turns and zooms are similarities but for terms of second order, a quarter of those of the picture itself. They have
    four parameters; the eight of a homography also fit players who run the way that the camera pans.
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
        far = np.sum(np.square(S[:, 2])) / (2.0 * f) ** 2  # 1 is a turn by 90 degrees
        if 1.0 / LARGEST_ZOOM < zoom < LARGEST_ZOOM and abs(roll) < LARGEST_ROLL and far < 0.5:
            best, most = (Motion.of(S[:, 2] / (1.0 - far), zoom, roll, log_f), agree[:, 0] > 0), int(np.sum(agree))
            if most > ENOUGH * len(p):
                break
    return best


@dataclass(frozen=True, eq=False)
class Motion:
    """A camera that turns and zooms: ``U(y) = K2 R K1^-1 U(x)``, ``U(x) = x / (1 + lens |x|^2)``.

    Lengths are relative to half the diagonal, and pixels to the middle of the picture, where the optical axis is.
    """

    turn: Array
    """(3,) rotation vector R = exp([turn]x) of camera coordinates."""
    log_f: float
    log_zoom: float
    lens: float

    @property
    def H(self) -> Array:
        """``K2 R K1^-1``."""
        f = np.exp(self.log_f)
        R, f2 = _rotation(self.turn), f * np.exp(self.log_zoom)
        return np.asarray(np.diag([f2, f2, 1.0]) @ R @ np.diag([1.0 / f, 1.0 / f, 1.0]))

    @classmethod
    def of(cls, middle: Array, zoom: float, roll: float, log_f: float) -> Motion:
        """The motion that takes the middle of the picture to `middle`, with a zoom, roll and focal length.

        Its lens is the mean of the prior.
        """
        f2 = zoom * np.exp(log_f)
        tilt_pan = np.array([-middle[1], middle[0], 0.0])  # the axis about which (0, 0, 1) turns to (middle, f2)
        sine = float(np.linalg.norm(tilt_pan))
        tilt_pan *= np.arctan2(sine, f2) / max(sine, 1e-12)
        turn = _turn(_rotation(tilt_pan) @ _rotation(np.array([0.0, 0.0, roll])))
        return cls(turn, log_f, float(np.log(zoom)), LENS_PRIOR[0])

    def residuals(self, p: Array, q: Array) -> tuple[Array, Array]:
        """``U(q) - K2 R K1^-1 U(p)``, (n, 2), and its negative derivative (n, 2, 6) by rotation, log f, log zoom, lens.

        Pixels determine the shift in the picture, which is pan and tilt times focal length. A step that multiplies the
        focal length by a factor therefore divides pan and tilt by it, so that the fit converges from far away.
        """
        pp, qq = (np.sum(z * z, axis=1, keepdims=True) for z in (p, q))
        R = _rotation(self.turn)
        u, v = p / (1.0 + self.lens * pp), q / (1.0 + self.lens * qq)
        f1, f2 = np.exp(self.log_f), np.exp(self.log_f + self.log_zoom)
        Y = u @ R[:, :2].T + f1 * R[:, 2]
        m = f2 * Y[:, :2] / Y[:, 2:]
        s, t = m[:, 0] / f2, m[:, 1] / f2  # Y = Y3 (s, t, 1)
        J = np.empty((len(p), 2, 6))
        J[:, 0, 0], J[:, 0, 1], J[:, 0, 2] = -f2 * s * t, f2 * (1.0 + s * s), -f2 * t  # dY = d_omega x Y
        J[:, 1, 0], J[:, 1, 1], J[:, 1, 2] = -f2 * (1.0 + t * t), f2 * s * t, f2 * s
        x, y, z = self.turn
        # (I + W / 2 + W^2 / 6) (x, y, 0), W = [turn]x: left Jacobian of the rotation to second order
        scaling = np.array(
            [x - z * y / 2.0 - z * z * x / 6.0, y + z * x / 2.0 - z * z * y / 6.0, z * (x * x + y * y) / 6.0]
        )
        dY_dlog_f = f1 * R[:, 2]
        dY_dlens = (-u * pp / (1.0 + self.lens * pp)) @ R[:, :2].T
        scale = f2 / Y[:, 2:]  # dm = scale (dY12 - (s, t) dY3)
        J[:, :, 3] = m + scale * (dY_dlog_f[:2] - m / f2 * dY_dlog_f[2]) - J[:, :, :3] @ scaling
        J[:, :, 4] = m
        J[:, :, 5] = scale * (dY_dlens[:, :2] - m / f2 * dY_dlens[:, 2:]) + v * qq / (1.0 + self.lens * qq)
        return v - m, J

    def fitted(self, r: Array, J: Array, noise: float, free_lens: bool) -> Motion:
        """The motion after a Gauss-Newton step with priors; `noise` is the standard deviation of a coordinate."""
        J = J.reshape(-1, 6)[:, : 6 if free_lens else 5]
        A, g = J.T @ J, J.T @ r.reshape(-1)
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
    """Least squares motion of a camera that turns and zooms, by Gauss-Newton with hard rejection.

    It has six parameters, and not the nine of a homography with a lens: where all matches lie in a strip of boards, a
    homography is arbitrary in the rest of the picture. Focal length and lens have priors, since small motions do not
    determine them. The lens halves the residuals of frames far apart, so that the tolerance separates players better.

    Returns
    -------
    plain : Motion
        The best motion without lens, which is a homography.
    distance : (n,) array
        Distance of each point from the motion with lens, px; there are `unit` px to a unit of length.
    scale : float
        Robust standard deviation of a coordinate over the inliers, px.
    """
    keep, scale = inlier, np.inf
    for i in range(ITERATIONS + 1):
        r, J = motion.residuals(p, q)
        distance = np.linalg.norm(r, axis=1) * unit
        if i >= FIXED_ITERATIONS:
            keep = distance < tolerance(scale)
            if np.sum(keep) < LEAST_POINTS:
                return None
        before, scale = scale, robust_deviation(r[keep]) * unit
        if i == ITERATIONS or (i > FIXED_ITERATIONS and abs(scale - before) < CONVERGED * scale):
            break
        motion = motion.fitted(r[keep], J[keep], PRIOR_NOISE / unit, True)
    plain = replace(motion, lens=0.0)
    some = np.flatnonzero(keep)[:: 1 + np.sum(keep) // PLAIN_POINTS]
    p, q = p[some], q[some]
    for _ in range(PLAIN_ITERATIONS):
        plain = plain.fitted(*plain.residuals(p, q), PRIOR_NOISE / unit, False)
    return plain, distance, scale


def _rotation(turn: Array) -> Array:
    """exp([turn]x), (3, 3)."""
    import cv2

    return np.asarray(cv2.Rodrigues(turn)[0])


def _turn(R: Array) -> Array:
    """The inverse of `_rotation`, below 180 degrees; cv2.Rodrigues rounds angles below 1e-5 (0.02 px) to 0."""
    axis = 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    sine = float(np.linalg.norm(axis))
    angle = float(np.arctan2(sine, 0.5 * (R[0, 0] + R[1, 1] + R[2, 2] - 1.0)))
    return axis * (angle / sine if sine > 0.0 else 1.0)


def graphics(H: Array, x: Array, y: Array, scale: float) -> BoolArray:
    """Which points stand still in the picture though the background does not."""
    still = np.linalg.norm(y - x, axis=1) < STILL
    return np.asarray(still & (np.linalg.norm(mapped(H, x) - x, axis=1) > tolerance(scale)))


def robust_deviation(r: Array) -> float:
    """Standard deviation of residuals less than half of which are outliers: 1.4826 times the median of their sizes."""
    return 1.4826 * float(np.median(np.abs(r)))


def tolerance(scale: float) -> float:
    """Largest distance, px, of the background from its motion."""
    return float(np.clip(TOLERANCE_IN_SCALES * scale, *TOLERANCE))


def shape_change(H: Array, size: tuple[int, int]) -> tuple[float, float, float]:
    """Zoom, roll (radians) and stretch of a homography in the middle of the picture; zoom 0 where it mirrors."""
    x = np.array([0.5 * size[0], 0.5 * size[1], 1.0])
    m = H @ x
    if m[2] * np.sign(H[2, 2]) <= 0.0:
        return 0.0, 0.0, np.inf
    A = (H[:2, :2] - np.outer(m[:2] / m[2], H[2, :2])) / m[2]
    determinant = float(np.linalg.det(A))
    if determinant <= 0.0:
        return 0.0, 0.0, np.inf
    large, small = np.linalg.svd(A, compute_uv=False)
    return float(np.sqrt(determinant)), float(np.arctan2(A[1, 0] - A[0, 1], A[0, 0] + A[1, 1])), float(large / small)


def is_plausible(H: Array, size: tuple[int, int]) -> bool:
    """Whether a homography may be that of a camera on a tripod; false if it is NaN."""
    zoom, roll, stretch = shape_change(H, size)
    return 1.0 / LARGEST_ZOOM < zoom < LARGEST_ZOOM and abs(roll) < LARGEST_ROLL and stretch < LARGEST_STRETCH


def plane_motion(x: Array, y: Array, candidates: BoolArray, size: tuple[int, int]) -> FoundMotion | None:
    """The motion of points in one plane; arguments and result are those of `background_motion`."""
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
