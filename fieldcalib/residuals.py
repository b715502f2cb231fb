"""The segment reprojection residual and its analytic Jacobian, for many frames and starts at once.

Every observed pixel p belongs to a segment. Its residual is the signed distance, in pixels of the real (distorted)
image, to the image of that segment. One form serves all kinds: with X* the foot point of p on the segment and n the
unit normal of the segment's image at pi(X*),

    r = n . (p - pi(X*)),        dr/dtheta = -n . dpi(X*)/dtheta.

X* is stationary along the curve, so the derivative of the search drops out. A foot point is kept as the ideal offset s
of its image (`fieldcalib.distortion`) and its inverse depth w: the homogeneous camera point (s / f, 1; w). At infinity
w is 0, behind the camera it is negative, and the image of the line is well defined all the same.

A point, or a pixel of an unordered cloud, has two residuals: n is then the x and the y axis.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from fieldcalib._types import Array, BoolArray, IntArray
from fieldcalib.distortion import distort, distort_jacobian, undistort
from fieldcalib.parameters import ANGLES, CENTER, LENS, LOG_ASPECT, LOG_F, PRINCIPAL_POINT
from fieldcalib.rotation import rotation_axes, rotation_from_angles
from fieldcalib.segments import Observations, Rows

# Vectors as separate components, each (B, N): contiguous, which halves the time of everything below.
Vector2: TypeAlias = tuple[Array, Array]
Vector3: TypeAlias = tuple[Array, Array, Array]


def segment_residuals(theta: Array, observations: Observations) -> Array:
    """Signed distances of all observed pixels to the images of their segments.

    Parameters
    ----------
    theta : (B, 12) array
        One parameter vector a frame (`fieldcalib.parameters`).
    observations : Observations
        B frames; to look at one frame from several cameras, repeat it with `Observations.take`.

    Returns
    -------
    (B, M) array
        Residuals in pixels, in the order of `Observations.weight`. Padding has values too: they weigh 0.
    """
    return _feet(View(theta, observations.image_size), observations).r


def segment_residuals_with_jacobian(theta: Array, observations: Observations, free: BoolArray) -> tuple[Array, Array]:
    """The residuals and their derivatives with respect to the free parameters.

    With the foot point's camera coordinates ``Xc = (s / f, 1)``, its inverse depth w and ``g = n dpi/dXc``,

        dr/dangle = axis . (Xc x g),    dr/dC = w R^T g,    dr/dlog f = -n . dpi/ds s.

    Parameters
    ----------
    theta : (B, 12) array
    observations : Observations
    free : (12,) bool array
        Which parameters to differentiate by.

    Returns
    -------
    r : (B, M) array
        As `segment_residuals`.
    J : (B, M, P) array
        One column for each free parameter, in the order of theta.
    """
    view = View(theta, observations.image_size)
    feet = _feet(view, observations)
    return feet.r, _jacobian(view, feet, free)


def foot_inverse_depths(theta: Array, observations: Observations) -> Array:
    """1 / depth of every residual's foot point, (B, M): negative where the camera would have to look backwards."""
    return _feet(View(theta, observations.image_size), observations).inverse_depth


class View:
    """What the residuals need of B parameter vectors, computed once for all rows.

    Scaled camera coordinates are (f Xc, f Yc, Zc): the ratio of their components is the ideal offset.
    """

    def __init__(self, theta: Array, image_size: tuple[int, int]) -> None:
        self.theta = theta
        self.R = rotation_from_angles(theta[:, ANGLES])
        self.f = np.exp(theta[:, LOG_F, None])
        self.rho = float(np.hypot(*image_size) / 2.0)
        self.aspect = np.exp(theta[:, LOG_ASPECT, None])
        self.lens = theta[:, None, LENS]
        # without lens and aspect the real offset is the ideal one, and half of the work falls away
        self.bent = bool(np.any(theta[:, LENS]) or np.any(theta[:, LOG_ASPECT]))
        self._scaled_R = self.R.copy()
        self._scaled_R[:, :2] *= self.f[:, :, None]

    def directions(self, d: Array) -> Vector3:
        """World directions (B, N, 3) in scaled camera coordinates."""
        h = self._scaled_R @ np.swapaxes(d, 1, 2)
        return h[:, 0], h[:, 1], h[:, 2]

    def points(self, X: Array) -> Vector3:
        """World points (B, N, 3) in scaled camera coordinates."""
        return self.directions(X - self.theta[:, None, CENTER])

    def observed_offset(self, xy: Array) -> Vector2:
        """Observed pixels (B, N, 2) as real offsets from the principal point."""
        cx, cy = np.split(self.theta[:, PRINCIPAL_POINT], 2, axis=1)
        return xy[..., 0] - cx, xy[..., 1] - cy

    def ideal_offset(self, d: Vector2) -> Vector2:
        """Real offsets as ideal ones; unchanged where no ray of the lens reaches them."""
        if not self.bent:
            return d
        isotropic = np.stack([d[0], d[1] / self.aspect], axis=-1)
        s = undistort(isotropic, self.lens, self.rho)
        s = np.where(np.isfinite(s), s, isotropic)
        return s[..., 0], s[..., 1]

    def real_offset(self, s: Vector2) -> Vector2:
        """Ideal offsets as real ones: the lens, then the pixels' aspect."""
        if not self.bent:
            return s
        d = distort(np.stack(s, axis=-1), self.lens, self.rho)
        return d[..., 0], d[..., 1] * self.aspect

    def offset_jacobian(self, s: Vector2) -> tuple[Vector2, Vector2]:
        """Rows of the derivative of `real_offset` with respect to s."""
        dd_ds, _ = distort_jacobian(np.stack(s, axis=-1), self.lens, self.rho)
        dd_ds[..., 1, :] *= self.aspect[..., None]
        return (dd_ds[..., 0, 0], dd_ds[..., 0, 1]), (dd_ds[..., 1, 0], dd_ds[..., 1, 1])

    def images(self, s: Vector2, *steps: Vector2) -> tuple[Vector2, ...]:
        """Images in the real plane of small steps at ideal offsets s: the derivative of `real_offset` applied."""
        if not self.bent:
            return steps
        row_x, row_y = self.offset_jacobian(s)
        return tuple((_dot(row_x, step), _dot(row_y, step)) for step in steps)


@dataclass(frozen=True)
class Feet:
    """Foot points of B x M residuals; every array is (B, M)."""

    r: Array
    """Signed distance of the observed pixel."""
    s: Vector2
    """Ideal offset of the foot point's image from the principal point, pixels."""
    inverse_depth: Array
    """0 at infinity, negative behind the camera."""
    normal: Vector2
    """Unit normal of the segment's real image at the foot point."""


def _feet(view: View, observations: Observations) -> Feet:
    """Foot points of all residuals, in the order of `Observations.weight`."""
    found: list[Feet] = []
    if observations.lines:
        found.append(_line_feet(view, observations.lines))
    if observations.arcs:
        found.append(_arc_feet(view, observations.arcs))
    if observations.curves:
        found.append(_sampled_curve_feet(view, observations.curves))
    if observations.points:
        found.extend(_point_feet(view, observations.points, observations.points.geometry[..., 0, :]))
    if observations.clouds:
        X, _ = _nearest_sample(view, observations.clouds)
        found.extend(_point_feet(view, observations.clouds, X))

    def joined(arrays: list[Array]) -> Array:
        return arrays[0] if len(arrays) == 1 else np.concatenate(arrays, axis=1)

    return Feet(
        joined([feet.r for feet in found]),
        (joined([feet.s[0] for feet in found]), joined([feet.s[1] for feet in found])),
        joined([feet.inverse_depth for feet in found]),
        (joined([feet.normal[0] for feet in found]), joined([feet.normal[1] for feet in found])),
    )


def _line_feet(view: View, rows: Rows) -> Feet:
    """Foot points on infinite lines, in closed form; with a lens, refined along the line's curved image."""
    ax, ay, az = view.points(rows.geometry[:, :, 0])
    dx, dy, dz = view.directions(rows.geometry[:, :, 1])
    lx, ly = ay * dz - az * dy, az * dx - ax * dz  # the image line is A x D: right even with an end behind the camera
    lz = ax * dy - ay * dx
    scale = 1.0 / (np.sqrt(lx * lx + ly * ly) + 1e-300)
    nx, ny = lx * scale, ly * scale
    d = view.observed_offset(rows.xy)
    px, py = view.ideal_offset(d)
    r = nx * px + ny * py + lz * scale
    s = px - r * nx, py - r * ny
    along = nx * py - ny * px  # the foot point's coordinate on the image line
    normal = nx, ny
    if view.bent:
        tangent = -ny, nx
        # steps contract by distance x curvature, 1e-2 at 50 px and a strong lens; clipped where the lens folds back
        for _ in range(6):
            (T,) = view.images(s, tangent)
            bx, by = view.real_offset(s)
            step = _dot((d[0] - bx, d[1] - by), T) / (_dot(T, T) + 1e-300)
            step = np.clip(step, -view.rho, view.rho)
            s = s[0] - step * ny, s[1] + step * nx
            along = along + step
        (T,) = view.images(s, tangent)
        bx, by = view.real_offset(s)
        normal = _left_normal(T)
        r = _dot(normal, (d[0] - bx, d[1] - by))
    inverse_depth = (along * dz - (nx * dy - ny * dx)) * scale
    return Feet(r, s, inverse_depth, normal)


def _arc_feet(view: View, rows: Rows) -> Feet:
    """Foot points on whole circles ``A + cos(phi) U + sin(phi) V``, found by Newton's method on phi.

    The search starts at the angle under which the pixel's ray meets the circle's plane. The angle is kept as the unit
    vector (c, s), which a step turns without trigonometry.
    """
    ax, ay, az = A = view.points(rows.geometry[:, :, 0])
    ux, uy, uz = U = view.directions(rows.geometry[:, :, 1])
    vx, vy, vz = V = view.directions(rows.geometry[:, :, 2])
    d = view.observed_offset(rows.xy)
    px, py = view.ideal_offset(d)
    # [U V A] (c, s, 1) ~ (p, 1) by Cramer's rule; the depth is not needed, so the horizon does no harm
    p = px, py, np.ones_like(px)
    VA, AU = _cross(V, A), _cross(A, U)
    side = np.sign(_dot3(U, VA))
    c, s = _unit((side * _dot3(VA, p), side * _dot3(AU, p)))

    search = Search(view, d, rows.weight)
    for _ in search.iterations:
        rx, ry, rz = c * ux + s * vx, c * uy + s * vy, c * uz + s * vz
        tangent = c * vx - s * ux, c * vy - s * uy, c * vz - s * uz
        step = search.step((ax + rx, ay + ry, az + rz), tangent, (-rx, -ry, -rz), largest=0.5)
        c, s = _unit((c - step * s, s + step * c))
    return search.feet


def _sampled_curve_feet(view: View, rows: Rows) -> Feet:
    """Foot points on ordered clouds: on the parabola through the nearest sample and its two neighbours."""
    _, nearest = _nearest_sample(view, rows)
    middle = np.clip(nearest, 1, rows.geometry.shape[2] - 2)
    before, at, after = (
        view.points(np.take_along_axis(rows.geometry, (middle + i)[..., None, None], axis=2)[:, :, 0])
        for i in (-1, 0, 1)
    )
    slope = tuple((b - a) / 2.0 for a, b in zip(before, after, strict=True))
    bend = tuple(a - 2.0 * m + b for a, m, b in zip(before, at, after, strict=True))
    t = (nearest - middle).astype(float)
    search = Search(view, view.observed_offset(rows.xy), rows.weight)
    for _ in search.iterations:
        point = tuple(h + t * (dh + 0.5 * t * ddh) for h, dh, ddh in zip(at, slope, bend, strict=True))
        tangent = tuple(dh + t * ddh for dh, ddh in zip(slope, bend, strict=True))
        t = t + search.step(point, tangent, bend, largest=1.0)
    return search.feet


class Search:
    """Newton's method for the points of parametrised curves whose real images are nearest to observed pixels.

    A curve hands `step` its point and the first two derivatives in scaled camera coordinates and moves its parameter by
    what comes back, until `iterations` ends; `feet` are then the last points seen.
    """

    feet: Feet

    def __init__(self, view: View, observed: Vector2, weight: Array) -> None:
        self.view = view
        self.observed = observed
        self.seen = weight > 0.0
        self.moved = np.inf

    @property
    def iterations(self) -> Iterator[int]:
        """At most ten, fewer when the largest step was so small that the next one would not change a digit."""
        for iteration in range(10):
            if self.moved < 1e-7:  # convergence is quadratic
                return
            yield iteration

    def step(self, point: Vector3, tangent: Vector3, bend: Vector3, largest: float) -> Array:
        """Change of the curve's parameter towards the foot point, at most `largest`."""
        hx, hy, hz = point
        dhx, dhy, dhz = tangent
        ddhx, ddhy, ddhz = bend
        inverse_depth = 1.0 / _away_from_zero(hz)
        s = sx, sy = hx * inverse_depth, hy * inverse_depth
        ds = dsx, dsy = (dhx - sx * dhz) * inverse_depth, (dhy - sy * dhz) * inverse_depth
        dds = (
            (ddhx - sx * ddhz - 2.0 * dsx * dhz) * inverse_depth,
            (ddhy - sy * ddhz - 2.0 * dsy * dhz) * inverse_depth,
        )
        T, dT = self.view.images(s, ds, dds)
        bx, by = self.view.real_offset(s)
        offset = self.observed[0] - bx, self.observed[1] - by
        TT = _dot(T, T) + 1e-300
        convex = TT - _dot(offset, dT)
        # the full second derivative where it is convex, else Gauss-Newton's: never towards a maximum
        step = np.clip(_dot(offset, T) / np.where(convex > 0.2 * TT, convex, TT), -largest, largest)
        normal = _left_normal(T)
        self.feet = Feet(_dot(normal, offset), s, inverse_depth, normal)
        self.moved = float(np.max(np.abs(step) * self.seen, initial=0.0))
        return np.asarray(step)


def _point_feet(view: View, rows: Rows, X: Array) -> tuple[Feet, Feet]:
    """The x and the y residuals of pixels against the world points X (B, N, 3)."""
    hx, hy, hz = view.points(X)
    inverse_depth = 1.0 / _away_from_zero(hz)
    s = hx * inverse_depth, hy * inverse_depth
    dx, dy = view.observed_offset(rows.xy)
    bx, by = view.real_offset(s)
    zero, one = np.zeros_like(hx), np.ones_like(hx)
    return Feet(dx - bx, s, inverse_depth, (one, zero)), Feet(dy - by, s, inverse_depth, (zero, one))


def _nearest_sample(view: View, rows: Rows) -> tuple[Array, IntArray]:
    """The sample (B, N, 3) of each row's cloud whose image is nearest to the pixel, and its index (B, N)."""
    B, N, S, _ = rows.geometry.shape
    hx, hy, hz = view.points(rows.geometry.reshape(B, N * S, 3))
    depth = _away_from_zero(hz)
    bx, by = view.real_offset((hx / depth, hy / depth))
    dx, dy = view.observed_offset(rows.xy)
    distance = np.square(bx.reshape(B, N, S) - dx[..., None]) + np.square(by.reshape(B, N, S) - dy[..., None])
    distance[depth.reshape(B, N, S) < 0.0] += 1e12  # behind the camera only if nothing is in front
    nearest = np.argmin(distance, axis=-1)
    return np.take_along_axis(rows.geometry, nearest[..., None, None], axis=2)[:, :, 0], nearest


def _jacobian(view: View, feet: Feet, free: BoolArray) -> Array:
    """(B, M, P) derivatives of the residuals at their foot points, see `segment_residuals_with_jacobian`."""
    nx, ny = dr_dsx, dr_dsy = feet.normal
    sx, sy = feet.s
    if view.bent:
        row_x, row_y = view.offset_jacobian(feet.s)
        dr_dsx, dr_dsy = nx * row_x[0] + ny * row_y[0], nx * row_x[1] + ny * row_y[1]
    gx, gy, gz = view.f * dr_dsx, view.f * dr_dsy, -(sx * dr_dsx + sy * dr_dsy)

    J = np.empty((len(nx), int(np.sum(free)), nx.shape[1]))  # each column contiguous
    column = iter(np.swapaxes(J, 0, 1))
    if np.any(free[ANGLES]):
        xc, yc = sx / view.f, sy / view.f
        mx, my, mz = yc * gz - gy, gx - xc * gz, xc * gy - yc * gx  # Xc x g
        axes = rotation_axes(view.theta[:, ANGLES], view.R)[..., None]
        for angle in np.flatnonzero(free[ANGLES]):
            next(column)[:] = axes[:, angle, 0] * mx + axes[:, angle, 1] * my + axes[:, angle, 2] * mz
    if free[LOG_F]:
        next(column)[:] = gz
    if np.any(free[CENTER]):
        wx, wy, wz = feet.inverse_depth * gx, feet.inverse_depth * gy, feet.inverse_depth * gz
        for axis in np.flatnonzero(free[CENTER]):
            r = view.R[:, :, axis, None]
            next(column)[:] = r[:, 0] * wx + r[:, 1] * wy + r[:, 2] * wz
    if np.any(free[LENS]):
        _, dd_da = distort_jacobian(np.stack(feet.s, axis=-1), view.lens, view.rho)
        for k in np.flatnonzero(free[LENS]):
            next(column)[:] = -(nx * dd_da[..., 0, k] + ny * view.aspect * dd_da[..., 1, k])
    for axis in np.flatnonzero(free[PRINCIPAL_POINT]):
        next(column)[:] = -feet.normal[axis]
    if free[LOG_ASPECT]:
        next(column)[:] = -ny * view.real_offset(feet.s)[1]
    return np.swapaxes(J, 1, 2)


def _dot(a: Vector2, b: Vector2) -> Array:
    return a[0] * b[0] + a[1] * b[1]


def _dot3(a: Vector3, b: Vector3) -> Array:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Vector3, b: Vector3) -> Vector3:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _unit(a: Vector2) -> Vector2:
    scale = 1.0 / (np.sqrt(_dot(a, a)) + 1e-300)
    return a[0] * scale, a[1] * scale


def _left_normal(T: Vector2) -> Vector2:
    """Unit vectors a quarter turn from the tangents T: for a line's tangent (-ny, nx) its normal (nx, ny)."""
    return _unit((T[1], -T[0]))


def _away_from_zero(depth: Array) -> Array:
    """Depths without an exact zero: a point in the camera's plane has no image, but must not stop the batch."""
    return np.where(np.abs(depth) < 1e-9, 1e-9, depth)
