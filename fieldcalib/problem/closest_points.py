"""The points of the segments' images that are closest to the observed pixels.

Every observed pixel p belongs to a segment. Its closest point X* is where the image of the segment, lens included,
comes nearest to p; n is the unit normal of the image there and ``r = n . (p - pi(X*))`` the signed distance, in pixels
of the real image. Arrays have their components first (`fieldcalib.problem.projection`).

A point, or a pixel of an unordered cloud, has two residuals: n is then the x and the y axis.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields

import numpy as np

from fieldcalib._types import Array, BoolArray, IntArray
from fieldcalib.problem.observations import Observations, Rows
from fieldcalib.problem.projection import Projection

LEAST_LENGTH = 1e-300  # keeps the division by the length of a vector from being one by zero
LEAST_DEPTH = 1e-9  # m: a point in the camera's plane has no image, but must not stop the batch
# The frames of a batch go on until all have converged. What is left then must be rounding: otherwise a camera would
# depend on the frames that it is calibrated with.
LINE_STEPS, LINE_STEP = 6, 1e-9  # px: steps contract by distance x curvature, 1e-2 at 50 px and a strong lens
CURVE_STEPS, CURVE_STEP = 10, 1e-8  # of the curve's parameter
LARGEST_TURN = 0.5  # of a step on a circle, radians
BEHIND_PENALTY = 1e12  # px^2: what a sample behind the camera counts as


@dataclass(frozen=True, eq=False)
class ClosestPoints:
    """The closest points of B x M residuals."""

    r: Array
    """Signed distance of the observed pixel, (B, M)."""
    s: Array
    """Ideal offset of the closest point's image from the principal point, pixels, (2, B, M)."""
    inverse_depth: Array
    """0 at infinity, negative behind the camera, (B, M)."""
    normal: Array
    """Unit normal of the segment's real image at the closest point, (2, B, M)."""

    def columns(self, part: slice | IntArray) -> ClosestPoints:
        """Of some of the residuals."""
        return ClosestPoints(*(getattr(self, name.name)[..., part] for name in fields(self)))

    def take(self, index: IntArray | slice) -> ClosestPoints:
        """Of the frames `index`."""
        return ClosestPoints(self.r[index], self.s[:, index], self.inverse_depth[index], self.normal[:, index])

    def replaced(self, index: IntArray, other: ClosestPoints) -> ClosestPoints:
        """With `other` in place of the frames `index`."""
        merged = {name.name: getattr(self, name.name).copy() for name in fields(self)}
        for name, values in merged.items():
            values[..., index, :] = getattr(other, name)
        return ClosestPoints(**merged)

    @staticmethod
    def joined(parts: list[ClosestPoints]) -> ClosestPoints:
        """Residuals one after the other."""
        if len(parts) == 1:
            return parts[0]
        return ClosestPoints(
            *(np.concatenate([getattr(part, name.name) for part in parts], axis=-1) for name in fields(ClosestPoints))
        )


def closest_points(projection: Projection, observations: Observations) -> ClosestPoints:
    """The closest points of all residuals, in the order of `Observations.weight`."""
    found: list[ClosestPoints] = []
    if observations.lines:
        found.append(_on_lines(projection, observations.lines))
    if observations.arcs:
        found.append(_on_arcs(projection, observations.arcs))
    if observations.curves:
        found.append(_on_sampled_curves(projection, observations.curves))
    if observations.points:
        found.extend(_at_points(projection, observations.points, observations.points.geometry[..., 0, :]))
    if observations.clouds:
        X, _ = _nearest_sample(projection, observations.clouds)
        found.extend(_at_points(projection, observations.clouds, X))
    if observations.ends:
        found.append(end_points(projection, observations.ends))
    return ClosestPoints.joined(found or [_on_lines(projection, observations.lines)])


def end_points(projection: Projection, ends: Rows) -> ClosestPoints:
    """The ends of segments, which `Observations.ends` are measured from along the directions of the rows."""
    along = np.ascontiguousarray(np.moveaxis(ends.geometry[:, :, 1, :2], -1, 0))
    x, y = _at_points(projection, ends, ends.geometry[:, :, 0])
    return ClosestPoints(along[0] * x.r + along[1] * y.r, x.s, x.inverse_depth, along)


def _on_lines(projection: Projection, rows: Rows) -> ClosestPoints:
    """On infinite lines, in closed form; with a lens, refined along the line's curved image."""
    A, D = projection.points(rows.geometry[:, :, 0]), projection.directions(rows.geometry[:, :, 1])
    line = _cross(A, D)  # the image line: right even with an end behind the camera
    scale = 1.0 / (np.sqrt(_dot(line[:2], line[:2])) + LEAST_LENGTH)
    normal = n = line[:2] * scale
    d = projection.observed_offset(rows.xy)
    p = projection.nearly_ideal_offset(d)
    r = _dot(n, p) + line[2] * scale
    s = p - r * n
    along = n[0] * p[1] - n[1] * p[0]  # the closest point's coordinate on the image line
    if not projection.is_pinhole:
        tangent = np.array([-n[1], n[0]])
        seen, reach = rows.label >= 0, projection.layout.lens.rho
        for _ in range(LINE_STEPS):
            real, T = projection.push(s, tangent)
            step = _dot(d - real, T) / (_dot(T, T) + LEAST_LENGTH)
            step = np.minimum(np.maximum(step, -reach), reach)  # bounded where the lens folds back
            s, along = s + step * tangent, along + step
            if (np.abs(step) * seen).max(initial=0.0) < LINE_STEP:
                break
        real, T = projection.push(s, tangent)
        normal = _left_normal(T)
        r = _dot(normal, d - real)
    inverse_depth = (along * D[2] - n[0] * D[1] + n[1] * D[0]) * scale
    return ClosestPoints(r, s, inverse_depth, normal)


def _on_arcs(projection: Projection, rows: Rows) -> ClosestPoints:
    """On whole circles ``A + cos(phi) U + sin(phi) V``, found by Newton's method on phi.

    The search starts at the angle under which the pixel's ray meets the circle's plane. The angle is kept as the unit
    vector (c, s), which a step turns without trigonometry.
    """
    A = projection.points(rows.geometry[:, :, 0])
    U, V = projection.directions(rows.geometry[:, :, 1]), projection.directions(rows.geometry[:, :, 2])
    d = projection.observed_offset(rows.xy)
    p = projection.nearly_ideal_offset(d)
    # [U V A] (c, s, 1) ~ (p, 1) by Cramer's rule; the depth is not needed, so the horizon does no harm
    VA, AU = _cross(V, A), _cross(A, U)
    side = np.where(_dot(U[:2], VA[:2]) + U[2] * VA[2] < 0.0, -1.0, 1.0)
    c, s = _unit(side * np.array([_dot(VA[:2], p) + VA[2], _dot(AU[:2], p) + AU[2]]))

    search = CurveSearch(projection, d, rows.label >= 0)
    for _ in search.iterations:
        radius = c * U + s * V
        step = search.step(A + radius, c * V - s * U, -radius, largest=LARGEST_TURN)
        c, s = _unit(np.array([c - step * s, s + step * c]))
    return search.found


def _on_sampled_curves(projection: Projection, rows: Rows) -> ClosestPoints:
    """On ordered clouds: on the parabola through the nearest sample and its two neighbours."""
    _, nearest = _nearest_sample(projection, rows)
    # padding repeats the last sample: no parabola may reach into it
    own = np.any(rows.geometry != rows.geometry[:, :, -1:], axis=-1)
    last = rows.geometry.shape[2] - np.argmax(own[..., ::-1], axis=-1)
    middle = np.clip(nearest, 1, np.maximum(last - 1, 1))
    before, at, after = (
        projection.points(np.take_along_axis(rows.geometry, (middle + i)[..., None, None], axis=2)[:, :, 0])
        for i in (-1, 0, 1)
    )
    slope, curvature = (after - before) / 2.0, after - 2.0 * at + before
    t = (nearest - middle).astype(float)
    search = CurveSearch(projection, projection.observed_offset(rows.xy), rows.label >= 0)
    for _ in search.iterations:
        t = t + search.step(at + t * (slope + 0.5 * t * curvature), slope + t * curvature, curvature, largest=1.0)
    return search.found


class CurveSearch:
    """Newton's method for the points of parametrised curves whose real images are closest to observed pixels.

    A curve hands `step` its point and its first two derivatives in scaled camera coordinates, and moves its parameter
    by what comes back, until `iterations` ends; `found` are then the points after the last step.
    """

    def __init__(self, projection: Projection, observed: Array, seen: BoolArray) -> None:
        self.projection = projection
        self.observed = observed
        self.seen = seen
        self.moved = np.inf

    @property
    def iterations(self) -> Iterator[int]:
        """Until the largest step is so small that its third order does not count."""
        for iteration in range(CURVE_STEPS):
            if self.moved < CURVE_STEP:
                return
            yield iteration

    def step(self, point: Array, tangent: Array, curvature: Array, largest: float) -> Array:
        """Change of the curve's parameter (B, N) towards the closest point, at most `largest`."""
        inverse_depth = 1.0 / _away_from_zero(point[2])
        s = point[:2] * inverse_depth
        ds = (tangent[:2] - s * tangent[2]) * inverse_depth
        dds = (curvature[:2] - s * curvature[2] - 2.0 * ds * tangent[2]) * inverse_depth
        real, T, dT = self.projection.push(s, ds, dds)
        offset = self.observed - real
        TT = _dot(T, T) + LEAST_LENGTH
        # the second derivative of half the squared distance, kept positive: never towards a maximum
        step = _dot(offset, T) / np.maximum(TT - _dot(offset, dT), 0.1 * TT)
        step = np.minimum(np.maximum(step, -largest), largest)  # np.clip is slower on small arrays
        self.moved = float((np.abs(step) * self.seen).max(initial=0.0))
        self.last = T, dT, s, ds, dds, inverse_depth, tangent[2], curvature[2], step
        return step

    @property
    def found(self) -> ClosestPoints:
        """The closest points: where the last step began, and the step to second order."""
        T, dT, s, ds, dds, inverse_depth, dz, ddz, step = self.last
        step = np.where(np.abs(step) < CURVE_STEP, step, 0.0)  # what has not converged stays on the curve
        normal = _left_normal(T + step * dT)
        s = s + step * (ds + 0.5 * step * dds)
        inverse_depth = inverse_depth / (1.0 + step * (dz + 0.5 * step * ddz) * inverse_depth)
        return ClosestPoints(_dot(normal, self.observed - self.projection.real_offset(s)), s, inverse_depth, normal)


def _at_points(projection: Projection, rows: Rows, X: Array) -> tuple[ClosestPoints, ClosestPoints]:
    """The x and the y residuals of pixels against the world points X (B, N, 3)."""
    h = projection.points(X)
    inverse_depth = 1.0 / _away_from_zero(h[2])
    s = h[:2] * inverse_depth
    dx, dy = projection.observed_offset(rows.xy) - projection.real_offset(s)
    zero, one = np.zeros_like(dx), np.ones_like(dx)
    x, y = np.array([one, zero]), np.array([zero, one])
    return ClosestPoints(dx, s, inverse_depth, x), ClosestPoints(dy, s, inverse_depth, y)


def _nearest_sample(projection: Projection, rows: Rows) -> tuple[Array, IntArray]:
    """The sample (B, N, 3) of each row's cloud whose image is nearest to the pixel, and its index (B, N)."""
    B, N, S, _ = rows.geometry.shape
    h = projection.points(rows.geometry.reshape(B, N * S, 3))
    image = projection.real_offset(h[:2] / _away_from_zero(h[2])).reshape(2, B, N, S)
    distance = np.sum(np.square(image - projection.observed_offset(rows.xy)[..., None]), axis=0)
    distance[h[2].reshape(B, N, S) < 0.0] += BEHIND_PENALTY  # only if nothing is in front
    nearest = np.argmin(distance, axis=-1)
    return np.take_along_axis(rows.geometry, nearest[..., None, None], axis=2)[:, :, 0], nearest


def _dot(a: Array, b: Array) -> Array:
    """Inner products of plane vectors."""
    return np.asarray(a[0] * b[0] + a[1] * b[1])


def _cross(a: Array, b: Array) -> Array:
    """Cross products of vectors in space."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def _unit(a: Array) -> Array:
    """Plane vectors scaled to length 1."""
    return np.asarray(a * (1.0 / (np.sqrt(_dot(a, a)) + LEAST_LENGTH)))


def _left_normal(T: Array) -> Array:
    """Unit vectors a quarter turn from the tangents T: for a line's tangent (-ny, nx) its normal (nx, ny)."""
    return _unit(np.array([T[1], -T[0]]))


def _away_from_zero(depth: Array) -> Array:
    """Depths without an exact zero."""
    return np.where(np.abs(depth) < LEAST_DEPTH, LEAST_DEPTH, depth)
