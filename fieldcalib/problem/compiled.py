"""Closest points and Levenberg-Marquardt, compiled by Numba: one frame after the other.

Mathematics and names are those of `closest_points`, `projection`, `evaluation` and `levenberg_marquardt`, which explain
them. A frame has some dozens of pixels, for which NumPy spends more time on calls than on computing: a batch of frames
takes it six times as long as the scalar code here. `fieldcalib.problem.compilation` says which frames are solved here.
"""

from __future__ import annotations

import math
from typing import NamedTuple, get_args

import numpy as np

from fieldcalib._types import Array, IntArray
from fieldcalib.fields.ground import RIDGE
from fieldcalib.fields.segments import closest as by_numpy
from fieldcalib.fields.segments.closest import ClosestPoints
from fieldcalib.fields.segments.line import FARTHEST, LARGEST_SHARE
from fieldcalib.fields.segments.segment import Vector
from fieldcalib.geometry.lens.model import FOLD, UNDISTORTING_STEPS
from fieldcalib.problem.compile_cache import cached
from fieldcalib.problem.damping import LARGEST_DAMPING, LEAST_DAMPING, LEAST_DIAGONAL, SETTLED, STILL
from fieldcalib.problem.layout import LOG_ASPECT, LOG_F, PAN, ROLL, Bounds
from fieldcalib.problem.losses import LossName, RobustLoss

compiled = cached(error_model="numpy")  # a division by zero is infinite, as in NumPy
inlined = cached(error_model="numpy", inline="always")  # a camera as an argument is forty numbers

A1 = LOG_ASPECT + 1  # where the coefficients (a1, b2) of a radial lens begin in theta
LINES, ARCS, ALONG_X, ALONG_Y, ENDS = range(5)  # kinds of residuals
LINEAR, CAUCHY, SOFT_L1, HUBER = map(get_args(LossName).index, ("linear", "cauchy", "soft_l1", "huber"))


class Limits(NamedTuple):
    """The constants of `fieldcalib.fields.segments.closest`, of the lens and of the projection.

    They are arguments, since Numba's cache is renewed only when this file changes, not when other modules do.
    """

    line_steps: int = by_numpy.LINE_STEPS
    line_step: float = by_numpy.LINE_STEP
    curve_steps: int = by_numpy.CURVE_STEPS
    curve_step: float = by_numpy.CURVE_STEP
    largest_curve_step: float = by_numpy.LARGEST_TURN
    largest_share: float = LARGEST_SHARE
    farthest: float = FARTHEST
    ridge: float = RIDGE
    least_bend: float = by_numpy.LEAST_BEND
    least_length: float = by_numpy.LEAST_LENGTH
    least_depth: float = by_numpy.LEAST_DEPTH
    undistorting_steps: int = UNDISTORTING_STEPS
    fold: float = FOLD


class CameraView(NamedTuple):
    """The quantities of a camera that its projection needs."""

    R: tuple[Vector, Vector, Vector]
    """Rows of the rotation."""
    scaled_R: tuple[Vector, Vector, Vector]
    """Rows of the rotation, the first two multiplied by f."""
    f: float
    cx: float
    cy: float
    aspect: float
    a1: float
    a2: float
    da2_da1: float
    rho: float
    per_rho2: float
    is_pinhole: bool
    cos_roll: float
    sin_roll: float
    limits: Limits


class Raised(NamedTuple):
    """The ground of a frame, `fieldcalib.fields.ground.Terrain`."""

    crown: float
    fall: float
    per_length: float
    """``2 / L``."""
    per_width: float
    x: float
    y: float
    """By how much a segment has moved with the size of the field, metres."""


class Foot(NamedTuple):
    """A closest point: residual, ideal offset, inverse depth and normal of one row of `ClosestPoints`."""

    r: float
    sx: float
    sy: float
    inverse_depth: float
    nx: float
    ny: float


class Loss(NamedTuple):
    """A robust loss: its number, and its scale squared."""

    kind: int
    scale2: float


@compiled
def view_of(theta: Array, rho: float, limits: Limits) -> CameraView:
    """The camera of a parameter vector."""
    c_pan, c_tilt, c_roll = math.cos(theta[0]), math.cos(theta[1]), math.cos(theta[2])
    s_pan, s_tilt, s_roll = math.sin(theta[0]), math.sin(theta[1]), math.sin(theta[2])
    R0 = (c_pan * c_roll - s_pan * c_tilt * s_roll, s_pan * c_roll + c_pan * c_tilt * s_roll, s_tilt * s_roll)
    R1 = (-c_pan * s_roll - s_pan * c_tilt * c_roll, -s_pan * s_roll + c_pan * c_tilt * c_roll, s_tilt * c_roll)
    R2 = (s_pan * s_tilt, -c_pan * s_tilt, c_tilt)
    f = math.exp(theta[LOG_F])
    a1, b2 = (theta[A1], theta[A1 + 1]) if len(theta) > A1 else (0.0, 0.0)
    barrel = min(a1, 0.0)
    return CameraView(
        (R0, R1, R2),
        ((f * R0[0], f * R0[1], f * R0[2]), (f * R1[0], f * R1[1], f * R1[2]), R2),
        f,
        theta[7],
        theta[8],
        math.exp(theta[LOG_ASPECT]),
        a1,
        b2 + limits.fold * barrel * barrel,
        2.0 * limits.fold * barrel,
        rho,
        1.0 / (rho * rho),
        a1 == 0.0 and b2 == 0.0 and theta[LOG_ASPECT] == 0.0,
        c_roll,
        s_roll,
        limits,
    )


@inlined
def centre_of(theta: Array, motion: Array, b: int, i: int, change: Array) -> Vector:
    """The centre of a camera, moved against its row's segment instead of the segment with the size of the field."""
    x, y, z = theta[4], theta[5], theta[6]
    for s in range(len(change)):
        x -= motion[b, i, 0, s] * change[s]
        y -= motion[b, i, 1, s] * change[s]
        z -= motion[b, i, 2, s] * change[s]
    return x, y, z


@inlined
def _direction(view: CameraView, x: float, y: float, z: float) -> Vector:
    """A world direction in scaled camera coordinates."""
    a, b, c = view.scaled_R
    return a[0] * x + a[1] * y + a[2] * z, b[0] * x + b[1] * y + b[2] * z, c[0] * x + c[1] * y + c[2] * z


@inlined
def _point(view: CameraView, C: Vector, geometry: Array, b: int, i: int) -> Vector:
    """The first vector of a row, a world point, in scaled camera coordinates."""
    x, y, z = geometry[b, i, 0, 0], geometry[b, i, 0, 1], geometry[b, i, 0, 2]
    return _direction(view, x - C[0], y - C[1], z - C[2])


@inlined
def _gain(view: CameraView, x: float, y: float) -> tuple[float, float]:
    """``1 + a1 q + a2 q^2`` of the lens at an ideal offset, and ``2 / rho^2`` times its derivative by q."""
    q = (x * x + y * y) * view.per_rho2
    return 1.0 + q * (view.a1 + q * view.a2), 2.0 * view.per_rho2 * (view.a1 + 2.0 * view.a2 * q)


@inlined
def _push(view: CameraView, gain: float, slope: float, sx: float, sy: float, x: float, y: float) -> tuple[float, float]:
    """The image of a small step (x, y) from an ideal offset s."""
    inner = slope * (sx * x + sy * y)
    return gain * x + inner * sx, view.aspect * (gain * y + inner * sy)


@inlined
def _bend(view: CameraView, slope: float, sx: float, sy: float, x: float, y: float) -> tuple[float, float]:
    """The second derivative of the real offset along (x, y), at an ideal offset s."""
    along = sx * x + sy * y
    radial = slope * (x * x + y * y) + 8.0 * view.a2 * (along * view.per_rho2) ** 2
    return radial * sx + 2.0 * slope * along * x, view.aspect * (radial * sy + 2.0 * slope * along * y)


@inlined
def _newton_step(
    ox: float, oy: float, Tx: float, Ty: float, dTx: float, dTy: float, largest: float, limits: Limits
) -> float:
    """Newton's step along a curve to the point closest to where an offset leads, at most `largest`."""
    TT = Tx * Tx + Ty * Ty + limits.least_length
    step = (ox * Tx + oy * Ty) / max(TT - (ox * dTx + oy * dTy), limits.least_bend * TT)
    return min(max(step, -largest), largest)


@inlined
def _unit(x: float, y: float, limits: Limits) -> tuple[float, float]:
    scale = 1.0 / (math.sqrt(x * x + y * y) + limits.least_length)
    return x * scale, y * scale


@inlined
def _nearly_ideal(view: CameraView, dx: float, dy: float) -> tuple[float, float]:
    """Approximate ideal offset of a real one, by a few fixed-point steps."""
    dy = dy / view.aspect
    sx, sy = dx, dy
    if not view.is_pinhole:
        for _ in range(view.limits.undistorting_steps):
            gain, _ = _gain(view, sx, sy)
            sx, sy = sx + (dx - gain * sx), sy + (dy - gain * sy)
    return sx, sy


@inlined
def on_line(view: CameraView, C: Vector, xy: Array, geometry: Array, b: int, i: int) -> Foot:
    """The closest point on an infinite line."""
    ax, ay, az = _point(view, C, geometry, b, i)
    bx, by, bz = _direction(view, geometry[b, i, 1, 0], geometry[b, i, 1, 1], geometry[b, i, 1, 2])
    lx, ly, lz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    scale = 1.0 / (math.sqrt(lx * lx + ly * ly) + view.limits.least_length)
    nx, ny = lx * scale, ly * scale
    dx, dy = xy[b, i, 0] - view.cx, xy[b, i, 1] - view.cy
    px, py = _nearly_ideal(view, dx, dy)
    r = nx * px + ny * py + lz * scale
    sx, sy = px - r * nx, py - r * ny
    along = nx * py - ny * px
    normal_x, normal_y = nx, ny
    if not view.is_pinhole:
        for _ in range(view.limits.line_steps):
            gain, slope = _gain(view, sx, sy)
            Tx, Ty = _push(view, gain, slope, sx, sy, -ny, nx)
            dTx, dTy = _bend(view, slope, sx, sy, -ny, nx)
            ox, oy = dx - gain * sx, dy - view.aspect * gain * sy
            step = _newton_step(ox, oy, Tx, Ty, dTx, dTy, view.rho, view.limits)  # bounded where the lens folds back
            sx, sy, along = sx - step * ny, sy + step * nx, along + step
            if abs(step) < view.limits.line_step:
                break
        gain, slope = _gain(view, sx, sy)
        Tx, Ty = _push(view, gain, slope, sx, sy, -ny, nx)
        normal_x, normal_y = _unit(Ty, -Tx, view.limits)
        r = normal_x * (dx - gain * sx) + normal_y * (dy - view.aspect * gain * sy)
    return Foot(r, sx, sy, (along * bz - nx * by + ny * bx) * scale, normal_x, normal_y)


@inlined
def _first_angle(A: Vector, U: Vector, V: Vector, px: float, py: float, limits: Limits) -> tuple[float, float]:
    """Cosine and sine of the angle at which the ray of an ideal offset meets a circle's plane."""
    VAx, VAy, VAz = V[1] * A[2] - V[2] * A[1], V[2] * A[0] - V[0] * A[2], V[0] * A[1] - V[1] * A[0]
    AUx, AUy, AUz = A[1] * U[2] - A[2] * U[1], A[2] * U[0] - A[0] * U[2], A[0] * U[1] - A[1] * U[0]
    side = -1.0 if U[0] * VAx + U[1] * VAy + U[2] * VAz < 0.0 else 1.0
    return _unit(side * (VAx * px + VAy * py + VAz), side * (AUx * px + AUy * py + AUz), limits)


class CurveStep(NamedTuple):
    """Newton's step along a curve to the point closest to a pixel, and the curve where the step begins."""

    step: float
    sx: float
    sy: float
    dsx: float
    dsy: float
    ddsx: float
    ddsy: float
    inverse_depth: float
    Tx: float
    Ty: float
    dTx: float
    dTy: float
    dz: float
    ddz: float


START = CurveStep(*(14 * (0.0,)))


@inlined
def _step_along(view: CameraView, dx: float, dy: float, P: Vector, T: Vector, N: Vector, largest: float) -> CurveStep:
    """The step from a curve's point P, from its first two derivatives T and N, see `CurveSearch.step`."""
    inverse_depth = 1.0 / (view.limits.least_depth if abs(P[2]) < view.limits.least_depth else P[2])
    sx, sy = P[0] * inverse_depth, P[1] * inverse_depth
    dsx, dsy = (T[0] - sx * T[2]) * inverse_depth, (T[1] - sy * T[2]) * inverse_depth
    ddsx = (N[0] - sx * N[2] - 2.0 * dsx * T[2]) * inverse_depth
    ddsy = (N[1] - sy * N[2] - 2.0 * dsy * T[2]) * inverse_depth
    gain, slope = _gain(view, sx, sy)
    Tx, Ty = _push(view, gain, slope, sx, sy, dsx, dsy)
    dTx, dTy = _push(view, gain, slope, sx, sy, ddsx, ddsy)
    if not view.is_pinhole:
        bend_x, bend_y = _bend(view, slope, sx, sy, dsx, dsy)
        dTx, dTy = dTx + bend_x, dTy + bend_y
    ox, oy = dx - gain * sx, dy - view.aspect * gain * sy
    step = _newton_step(ox, oy, Tx, Ty, dTx, dTy, largest, view.limits)
    return CurveStep(step, sx, sy, dsx, dsy, ddsx, ddsy, inverse_depth, Tx, Ty, dTx, dTy, T[2], N[2])


@inlined
def _foot_after(view: CameraView, dx: float, dy: float, last: CurveStep) -> Foot:
    """The closest point after the last step, see `CurveSearch.found`."""
    step = last.step
    if not abs(step) < view.limits.curve_step:  # a point that has not converged stays on the curve
        step = 0.0
    nx, ny = _unit(last.Ty + step * last.dTy, -last.Tx - step * last.dTx, view.limits)
    sx = last.sx + step * (last.dsx + 0.5 * step * last.ddsx)
    sy = last.sy + step * (last.dsy + 0.5 * step * last.ddsy)
    gain, _ = _gain(view, sx, sy)
    r = nx * (dx - gain * sx) + ny * (dy - view.aspect * gain * sy)
    inverse_depth = last.inverse_depth / (1.0 + step * (last.dz + 0.5 * step * last.ddz) * last.inverse_depth)
    return Foot(r, sx, sy, inverse_depth, nx, ny)


@inlined
def on_arc(view: CameraView, C: Vector, xy: Array, geometry: Array, b: int, i: int) -> Foot:
    """The closest point on a whole circle."""
    limits = view.limits
    A = _point(view, C, geometry, b, i)
    U = _direction(view, geometry[b, i, 1, 0], geometry[b, i, 1, 1], geometry[b, i, 1, 2])
    V = _direction(view, geometry[b, i, 2, 0], geometry[b, i, 2, 1], geometry[b, i, 2, 2])
    dx, dy = xy[b, i, 0] - view.cx, xy[b, i, 1] - view.cy
    px, py = _nearly_ideal(view, dx, dy)
    c, s = _first_angle(A, U, V, px, py, limits)
    last = START
    for _ in range(limits.curve_steps):
        rx, ry, rz = c * U[0] + s * V[0], c * U[1] + s * V[1], c * U[2] + s * V[2]
        T = (c * V[0] - s * U[0], c * V[1] - s * U[1], c * V[2] - s * U[2])
        P = (A[0] + rx, A[1] + ry, A[2] + rz)
        last = _step_along(view, dx, dy, P, T, (-rx, -ry, -rz), limits.largest_curve_step)
        if abs(last.step) < limits.curve_step:
            break
        c, s = _unit(c - last.step * s, s + last.step * c, limits)
    return _foot_after(view, dx, dy, last)


@inlined
def _profile(v: float, ridge: float) -> Vector:
    """A section across the ground, with its derivatives, see `fieldcalib.fields.ground.Profile`."""
    if not abs(v) < 1.0:  # beside the field, or at infinity
        return 0.0, 0.0, 0.0
    r, n = math.sqrt(v * v + ridge * ridge), math.sqrt(1.0 + ridge * ridge) - ridge
    return 1.0 - (r - ridge) / n, -v / (r * n), -ridge * ridge / (r * r * r * n)


@inlined
def _lift(ground: Raised, ridge: float, x: float, y: float, dx: float, dy: float, ddx: float, ddy: float) -> Vector:
    """The lift of a curve by the ground, with its first and second derivative, see `Terrain.lift`."""
    u, du, ddu = ground.per_length * (x + ground.x), ground.per_length * dx, ground.per_length * ddx
    v, dv, ddv = ground.per_width * (y + ground.y), ground.per_width * dy, ground.per_width * ddy
    along, d_along, dd_along = _profile(u, ridge)
    across, d_across, dd_across = _profile(v, ridge)
    return (
        -ground.fall * along - ground.crown * across,
        -ground.fall * d_along * du - ground.crown * d_across * dv,
        -ground.fall * (dd_along * du * du + d_along * ddu) - ground.crown * (dd_across * dv * dv + d_across * ddv),
    )


@inlined
def _first_share(view: CameraView, A: Vector, D: Vector, flat: Foot, farthest: float) -> float:
    """Share of the way from A by D of the closest point on a line that is not raised."""
    lx, ly = A[1] * D[2] - A[2] * D[1], A[2] * D[0] - A[0] * D[2]
    nx, ny = _unit(lx, ly, view.limits)
    along = nx * flat.sy - ny * flat.sx
    denominator = along * D[2] - nx * D[1] + ny * D[0]
    share = (nx * A[1] - ny * A[0] - along * A[2]) / (view.limits.least_length if denominator == 0.0 else denominator)
    return min(max(share, -farthest), farthest)


@compiled
def on_raised(
    kind: int, view: CameraView, C: Vector, ground: Raised, xy: Array, geometry: Array, b: int, i: int
) -> Foot:
    """The closest point on a line or a circle that follows the ground, by Newton's method along it.

    A line is ``A + c U`` with c the share of its length and V = 0; a circle is ``A + c U + s V``.
    """
    limits, is_line = view.limits, kind == LINES
    A, (gx, gy) = _point(view, C, geometry, b, i), (geometry[b, i, 0, 0], geometry[b, i, 0, 1])
    ux, uy = geometry[b, i, 1, 0], geometry[b, i, 1, 1]
    U = _direction(view, ux, uy, geometry[b, i, 1, 2])
    dx, dy = xy[b, i, 0] - view.cx, xy[b, i, 1] - view.cy
    Z = (view.scaled_R[0][2], view.scaled_R[1][2], view.scaled_R[2][2])
    vx = vy = s = 0.0
    if is_line:
        V = (0.0, 0.0, 0.0)
        c = _first_share(view, A, U, on_line(view, C, xy, geometry, b, i), limits.farthest)
    else:
        vx, vy = geometry[b, i, 2, 0], geometry[b, i, 2, 1]
        V = _direction(view, vx, vy, geometry[b, i, 2, 2])
        px, py = _nearly_ideal(view, dx, dy)
        z, dz, ddz = _lift(ground, limits.ridge, gx, gy, 0.0, 0.0, 0.0, 0.0)
        c, s = _first_angle((A[0] + z * Z[0], A[1] + z * Z[1], A[2] + z * Z[2]), U, V, px, py, limits)
    T = N = (0.0, 0.0, 0.0)
    last = START
    for _ in range(limits.curve_steps):
        # first and second derivatives by the share, or by the angle: (c, s)' = (-s, c)
        if is_line:
            z, dz, ddz = _lift(ground, limits.ridge, gx + c * ux, gy + c * uy, ux, uy, 0.0, 0.0)
            T, N = U, (0.0, 0.0, 0.0)
        else:
            rx, ry = c * ux + s * vx, c * uy + s * vy
            z, dz, ddz = _lift(ground, limits.ridge, gx + rx, gy + ry, c * vx - s * ux, c * vy - s * uy, -rx, -ry)
            T = (c * V[0] - s * U[0], c * V[1] - s * U[1], c * V[2] - s * U[2])
            N = (-c * U[0] - s * V[0], -c * U[1] - s * V[1], -c * U[2] - s * V[2])
        P = (
            A[0] + c * U[0] + s * V[0] + z * Z[0],
            A[1] + c * U[1] + s * V[1] + z * Z[1],
            A[2] + c * U[2] + s * V[2] + z * Z[2],
        )
        T = (T[0] + dz * Z[0], T[1] + dz * Z[1], T[2] + dz * Z[2])
        N = (N[0] + ddz * Z[0], N[1] + ddz * Z[1], N[2] + ddz * Z[2])
        last = _step_along(view, dx, dy, P, T, N, limits.largest_share if is_line else limits.largest_curve_step)
        if abs(last.step) < limits.curve_step:
            break
        if is_line:
            c = c + last.step
        else:
            c, s = _unit(c - last.step * s, s + last.step * c, limits)
    foot = _foot_after(view, dx, dy, last)
    return Foot(-foot.r, foot.sx, foot.sy, foot.inverse_depth, -foot.nx, -foot.ny) if is_line else foot


@inlined
def at_point(
    view: CameraView, C: Vector, ground: Raised, xy: Array, geometry: Array, b: int, i: int, normal: tuple[float, float]
) -> Foot:
    """The residual of a world point along a direction of the image."""
    nx, ny = normal
    x, y, z = geometry[b, i, 0, 0], geometry[b, i, 0, 1], geometry[b, i, 0, 2]
    if ground.crown != 0.0 or ground.fall != 0.0:
        z = z + _lift(ground, view.limits.ridge, x, y, 0.0, 0.0, 0.0, 0.0)[0]
    hx, hy, hz = _direction(view, x - C[0], y - C[1], z - C[2])
    inverse_depth = 1.0 / (view.limits.least_depth if abs(hz) < view.limits.least_depth else hz)
    sx, sy = hx * inverse_depth, hy * inverse_depth
    gain, _ = _gain(view, sx, sy)
    r = nx * (xy[b, i, 0] - view.cx - gain * sx) + ny * (xy[b, i, 1] - view.cy - view.aspect * gain * sy)
    return Foot(r, sx, sy, inverse_depth, nx, ny)


@inlined
def foot_of(
    kind: int, view: CameraView, theta: Array, C: Vector, ground: Raised, xy: Array, geometry: Array, b: int, i: int
) -> Foot:
    """The closest point of a residual of a kind, for a centre C that has moved against its segment."""
    ground = Raised(*ground[:4], theta[4] - C[0], theta[5] - C[1])
    if kind in (LINES, ARCS) and (ground.crown != 0.0 or ground.fall != 0.0):
        return on_raised(kind, view, C, ground, xy, geometry, b, i)
    if kind == LINES:
        return on_line(view, C, xy, geometry, b, i)
    if kind == ARCS:
        return on_arc(view, C, xy, geometry, b, i)
    if kind == ALONG_X:
        return at_point(view, C, ground, xy, geometry, b, i, (1.0, 0.0))
    if kind == ALONG_Y:
        return at_point(view, C, ground, xy, geometry, b, i, (0.0, 1.0))
    return at_point(view, C, ground, xy, geometry, b, i, (geometry[b, i, 1, 0], geometry[b, i, 1, 1]))


@inlined
def set_derivatives(view: CameraView, foot: Foot, row: Array) -> None:
    """Write derivatives of a point's image along its normal to `row` (n,): ``n . dpi(X*) / dtheta``, see
    `Projection`."""
    sx, sy, w = foot.sx, foot.sy, foot.inverse_depth
    x, y = foot.nx, view.aspect * foot.ny
    inner = sx * x + sy * y
    gain, slope = _gain(view, sx, sy)
    x, y = gain * x + slope * inner * sx, gain * y + slope * inner * sy  # n dd_ds
    ds_dXc = x * sx + y * sy
    gx, gy, gz = view.f * x, view.f * y, -ds_dXc
    xc, yc = sx / view.f, sy / view.f
    mx, my, mz = yc * gz - gy, gx - xc * gz, xc * gy - yc * gx  # Xc x g
    a, b, c = view.R
    row[0] = -(a[2] * mx + b[2] * my + c[2] * mz)
    row[1] = view.sin_roll * my - view.cos_roll * mx
    row[2] = -mz
    row[LOG_F] = ds_dXc
    row[4] = -w * (a[0] * gx + b[0] * gy + c[0] * gz)
    row[5] = -w * (a[1] * gx + b[1] * gy + c[1] * gz)
    row[6] = -w * (a[2] * gx + b[2] * gy + c[2] * gz)
    row[7], row[8] = foot.nx, foot.ny
    row[LOG_ASPECT] = foot.ny * view.aspect * gain * sy
    if len(row) > A1:
        q = (sx * sx + sy * sy) * view.per_rho2
        row[A1], row[A1 + 1] = q * inner * (1.0 + view.da2_da1 * q), q * q * inner


def loss_of(loss: RobustLoss) -> Loss:
    """A robust loss as an argument of the compiled functions."""
    return Loss(get_args(LossName).index(loss.name), loss.scale**2)


@inlined
def rho_of(loss: Loss, squared: float) -> tuple[float, float]:
    """A robust loss at a squared residual, and its derivative by that, see `RobustLoss.evaluate`."""
    z = squared / loss.scale2
    if loss.kind == CAUCHY:
        return loss.scale2 * math.log1p(z), 1.0 / (1.0 + z)
    if loss.kind == SOFT_L1:
        root = math.sqrt(1.0 + z)
        return loss.scale2 * 2.0 * (root - 1.0), 1.0 / root
    if loss.kind == HUBER:
        root = math.sqrt(max(z, 1.0))
        return (squared if z <= 1.0 else loss.scale2 * (2.0 * root - 1.0)), 1.0 / root
    return squared, 1.0


class Frames(NamedTuple):
    """The rows of B frames, by kind."""

    kinds: tuple[int, ...]
    xy: tuple[Array, ...]
    """(B, N, 2) of each kind."""
    weight: tuple[Array, ...]
    """(B, N), divided by the squared noise."""
    label: tuple[IntArray, ...]
    """(B, N); -1 where there is only padding."""
    geometry: tuple[Array, ...]
    """(B, N, G, 3)."""
    motion: tuple[Array, ...]
    """Derivatives of the segments by the size of the field, (B, N, 3, S)."""
    given: Array
    """Size (S,) of the field for which they are packed; (0,) where the size is not estimated."""
    ground: Array
    """`Raised` of each frame, (B, 4)."""
    size: int
    """Index of the length of the field, which the width follows, among the parameters; -1 without them."""
    crown: int
    """Index of the crown; -1 where it is not estimated."""
    rho: float
    limits: Limits


class Terms(NamedTuple):
    """The losses and the prior of the cost, and which parameters are estimated."""

    loss: Loss
    tails: Loss
    """Loss of the prior of the lens."""
    has_prior: bool
    mean: Array
    """(B, n)."""
    sigma: Array
    free: IntArray
    """Indices (P,) of the parameters that are estimated."""
    log_f_range: Array
    """Least and largest log f, (2,); outside, the cost is infinite."""


class Quadratic(NamedTuple):
    """The cost around a camera, and its damping."""

    gradient: Array
    """(P,)."""
    hessian: Array
    """(P, P)."""
    damping: float
    least_diagonal: float


class Criteria(NamedTuple):
    """Arguments of Levenberg-Marquardt, and its constants; these are arguments for the reason given at `Limits`."""

    max_iterations: int
    tolerance: float
    initial_damping: float
    settled: float = SETTLED
    still: float = STILL
    least_diagonal: float = LEAST_DIAGONAL
    least_damping: float = LEAST_DAMPING
    largest_damping: float = LARGEST_DAMPING


@inlined
def ground_of(frames: Frames, b: int, theta: Array) -> Raised:
    """The ground of a frame at its parameters."""
    given = frames.ground[b]
    crown, per_length, per_width = given[0], given[2], given[3]
    if frames.size >= 0:
        per_length, per_width = 2.0 / theta[frames.size], 2.0 / theta[frames.size + 1]
    if frames.crown >= 0:
        crown = theta[frames.crown]
    return Raised(crown, given[1], per_length, per_width, 0.0, 0.0)


@inlined
def set_derivatives_by_field(
    frames: Frames, view: CameraView, foot: Foot, ground: Raised, motion: Array, theta: Array, row: Array
) -> None:
    """Write derivatives by length, width and crown of the field, as far as they are estimated, to `row` (n,).

    Moving a segment, by `motion` (3, S), is equivalent to moving the camera the other way, see
    `Evaluation.motion_of_points`.
    """
    hx = hy = by_length = by_width = share = 0.0  # slopes, and derivatives of the height
    if frames.crown >= 0 or ground.crown != 0.0 or ground.fall != 0.0:
        depth, (right, down, ahead) = 1.0 / foot.inverse_depth, view.R
        xc, yc = foot.sx / view.f * depth, foot.sy / view.f * depth
        u = ground.per_length * (theta[4] + right[0] * xc + down[0] * yc + ahead[0] * depth)
        v = ground.per_width * (theta[5] + right[1] * xc + down[1] * yc + ahead[1] * depth)
        _, along, _ = _profile(u, view.limits.ridge)
        share, across, _ = _profile(v, view.limits.ridge)
        hx, hy = ground.fall * ground.per_length * along, ground.crown * ground.per_width * across
        by_length = -0.5 * hx * u if abs(u) < 1.0 else 0.0
        by_width = -0.5 * hy * v if abs(v) < 1.0 else 0.0
    for s in range(len(frames.given)):
        rises = hx * motion[0, s] + hy * motion[1, s] + (by_length if s == 0 else by_width)
        row[frames.size + s] = -(row[4] * motion[0, s] + row[5] * motion[1, s] + row[6] * (motion[2, s] - rises))
    if frames.crown >= 0:
        row[frames.crown] = row[6] * share


@compiled
def closest_points(frames: Frames, theta: Array, points: ClosestPoints) -> None:
    """Write the closest points of all residuals (B, M), kind after kind; padding is not written."""
    r, s, inverse_depth, normal = points
    camera = theta.shape[1] if frames.size < 0 else frames.size
    for b in range(len(theta)):
        view = view_of(theta[b, :camera], frames.rho, frames.limits)
        change = theta[b, camera : camera + len(frames.given)] - frames.given
        ground = ground_of(frames, b, theta[b])
        m = 0
        for k in range(len(frames.kinds)):
            kind, label, xy, geometry = frames.kinds[k], frames.label[k], frames.xy[k], frames.geometry[k]
            for i in range(label.shape[1]):
                if label[b, i] >= 0:
                    C = centre_of(theta[b], frames.motion[k], b, i, change)
                    foot = foot_of(kind, view, theta[b], C, ground, xy, geometry, b, i)
                    r[b, m], inverse_depth[b, m] = foot.r, foot.inverse_depth
                    s[0, b, m], s[1, b, m] = foot.sx, foot.sy
                    normal[0, b, m], normal[1, b, m] = foot.nx, foot.ny
                m += 1


@compiled
def normal_equations(
    frames: Frames, terms: Terms, b: int, theta: Array, row: Array, gradient: Array, hessian: Array
) -> float:
    """The cost of frame b at its parameters (n,), infinite if these are out of range; its gradient (P,) and Hessian
    (P, P) are written to the arrays."""
    free = terms.free
    P = len(free)
    gradient[:] = 0.0
    hessian[:] = 0.0
    if not terms.log_f_range[0] < theta[LOG_F] < terms.log_f_range[1]:
        return np.inf
    cost, camera = 0.0, len(theta) if frames.size < 0 else frames.size
    view = view_of(theta[:camera], frames.rho, frames.limits)
    change = theta[camera : camera + len(frames.given)] - frames.given
    ground = ground_of(frames, b, theta)
    for k in range(len(frames.kinds)):
        kind, weights, xy, geometry = frames.kinds[k], frames.weight[k], frames.xy[k], frames.geometry[k]
        motion = frames.motion[k]
        for i in range(weights.shape[1]):
            weight = weights[b, i]
            if weight == 0.0:
                continue
            C = centre_of(theta, motion, b, i, change)
            foot = foot_of(kind, view, theta, C, ground, xy, geometry, b, i)
            rho, slope = rho_of(terms.loss, foot.r * foot.r)
            cost += 0.5 * weight * rho
            set_derivatives(view, foot, row[:camera])
            if frames.size >= 0:
                set_derivatives_by_field(frames, view, foot, ground, motion[b, i], theta, row)
            irls_weight = weight * slope
            for j in range(P):
                row[j] = row[free[j]]  # the free ones are ascending
            for j in range(P):
                scaled = irls_weight * row[j]
                gradient[j] -= scaled * foot.r  # residual: pixel minus closest point
                for c in range(j + 1):
                    hessian[j, c] += scaled * row[c]
    if terms.has_prior:
        for j in range(P):
            n = free[j]
            difference, sigma = theta[n] - terms.mean[b, n], terms.sigma[b, n]
            if n in (PAN, ROLL):
                difference -= 2.0 * math.pi * np.rint(difference / (2.0 * math.pi))
            z = difference / sigma
            rho, slope = rho_of(terms.tails, z * z) if A1 <= n < camera else (z * z, 1.0)
            cost += 0.5 * rho
            gradient[j] += slope * z / sigma
            hessian[j, j] += slope / (sigma * sigma)
    for j in range(P):
        for c in range(j):
            hessian[c, j] = hessian[j, c]
    return cost if math.isfinite(cost) else np.inf


@compiled
def solve(A: Array, x: Array) -> None:
    """Solve ``A x = b`` in place, where x holds b at first, by Gaussian elimination with partial pivoting.

    Where A is singular or infinite, x is no number: that step is not taken, and other frames go on. `np.linalg.solve`
    would raise an error, which ends them all; as Numba compiles it, a step takes twice as long.
    """
    P = len(x)
    for j in range(P):
        best = j
        for i in range(j + 1, P):
            if abs(A[i, j]) > abs(A[best, j]):
                best = i
        if best != j:
            for c in range(j, P):
                A[j, c], A[best, c] = A[best, c], A[j, c]
            x[j], x[best] = x[best], x[j]
        for i in range(j + 1, P):
            factor = A[i, j] / A[j, j]
            for c in range(j + 1, P):
                A[i, c] -= factor * A[j, c]
            x[i] -= factor * x[j]
    for j in range(P - 1, -1, -1):
        for c in range(j + 1, P):
            x[j] -= A[j, c] * x[c]
        x[j] /= A[j, j]


@compiled
def damped_step(theta: Array, free: IntArray, model: Quadratic, to: Bounds, A: Array, step: Array) -> float:
    """Write the step (P,) of a frame at theta, within its bounds; return the predicted change of the cost.

    Parameters at a bound that would leave it are held: they are taken out of the linear system.
    """
    g, H = model.gradient, model.hessian
    P = len(g)
    for j in range(P):
        at = theta[free[j]]
        held = (at <= to.least[j] and g[j] > 0.0) or (at >= to.largest[j] and g[j] < 0.0)
        step[j] = np.nan if held else -g[j]
    for j in range(P):
        for c in range(P):
            A[j, c] = 0.0 if math.isnan(step[j]) or math.isnan(step[c]) else H[j, c]
        A[j, j] = 1.0 if math.isnan(step[j]) else H[j, j] + model.damping * (H[j, j] + model.least_diagonal)
    for j in range(P):
        if math.isnan(step[j]):
            step[j] = 0.0
    solve(A, step)
    shorter = 1.0
    for j in range(P):
        shorter = max(shorter, abs(step[j]) / to.longest[j])
    for j in range(P):
        at = theta[free[j]]
        step[j] = min(max(at + step[j] / shorter, to.least[j]), to.largest[j]) - at
    predicted = 0.0
    for j in range(P):
        along = 0.0
        for c in range(P):
            along += H[j, c] * step[c]
        predicted += step[j] * (g[j] + 0.5 * along)
    return predicted


@compiled
def levenberg_marquardt(
    frames: Frames,
    terms: Terms,
    to: Bounds,
    until: Criteria,
    theta: Array,
    converged: Array,
    iterations: IntArray,
    points: ClosestPoints,
) -> None:
    """Minimise the cost of every frame; theta (B, n) holds the starts, then the solutions, of which are the points."""
    free = terms.free
    P, n = len(free), theta.shape[1]
    g, H, row = np.empty(P), np.empty((P, P)), np.empty(n)
    trial_g, trial_H, A, step = np.empty(P), np.empty((P, P)), np.empty((P, P)), np.empty(P)
    moved = np.empty(n)
    for b in range(len(theta)):
        at = theta[b]
        for j in range(P):
            at[free[j]] = min(max(at[free[j]], to.least[j]), to.largest[j])
        cost = normal_equations(frames, terms, b, at, row, g, H)
        if not math.isfinite(cost):
            continue
        damping, growth = until.initial_damping, 2.0
        for _ in range(until.max_iterations):
            predicted = damped_step(at, free, Quadratic(g, H, damping, until.least_diagonal), to, A, step)
            if abs(predicted) <= max(until.settled * until.tolerance, until.still) * cost:
                converged[b] = True
                break
            moved[:] = at
            for j in range(P):
                moved[free[j]] += step[j]
            trial = normal_equations(frames, terms, b, moved, row, trial_g, trial_H)
            iterations[b] += 1
            better = trial < cost
            decrease = cost - trial if better else 0.0
            done = max(decrease, abs(predicted)) <= until.tolerance * cost
            done |= (not better) and damping > until.largest_damping
            if better:
                gain = min(max((cost - trial) / max(-predicted, 1e-300), 0.0), 1.0)
                damping = max(damping * max(1.0 / 9.0, 1.0 - (2.0 * gain - 1.0) ** 3), until.least_damping)
                growth, cost = 2.0, trial
                at[:] = moved
                g, trial_g = trial_g, g
                H, trial_H = trial_H, H
            else:
                damping, growth = damping * growth, 2.0 * growth
            if done:
                converged[b] = True
                break
    closest_points(frames, theta, points)
