"""Closest points on the images of segments, and the search for them along curves.

Every observed pixel p belongs to a segment. Its closest point X* is where the image of the segment, lens included,
comes nearest to p; n is the unit normal of the image there and ``r = n . (p - pi(X*))`` the signed distance, in pixels
of the real image. Arrays have their components first (`fieldcalib.problem.projection`).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple, Protocol

import numpy as np

from fieldcalib._types import Array, BoolArray, IntArray
from fieldcalib.fields.ground import Terrain
from fieldcalib.geometry.lens.model import dot

LEAST_LENGTH = 1e-300  # added to the length of a vector: no division by zero
LEAST_DEPTH = 1e-9  # m: a point in the camera's plane has no image, but must not raise an error
# A batch iterates until all of its frames have converged. Further steps must be within rounding: otherwise a camera
# would depend on the other frames of its batch.
# After a last step as small as these, the error of Newton's method, and terms of third order, are that small.
LINE_STEPS, LINE_STEP = 20, 1e-5  # px; five steps at 50 px and a broadcast lens, up to 20 near the fold of a strong one
CURVE_STEPS, CURVE_STEP = 20, 1e-6  # of the curve's parameter
LEAST_BEND = 0.1  # of the second derivative of half the squared distance, in squared lengths of the tangent
LARGEST_TURN = 0.5  # of a step on a circle, radians


class View(Protocol):
    """B cameras, with the methods that closest points need: see `fieldcalib.problem.projection.Projection`."""

    is_pinhole: bool
    terrain: Terrain | None
    """The ground that segments stand on, of B fields; None where it is level."""

    @property
    def reach(self) -> float:
        """Length of ideal offsets up to which the lens is certainly one-to-one, pixels."""

    @property
    def down(self) -> Array:
        """The world's z axis in scaled camera coordinates, (3, B, 1)."""

    def directions(self, d: Array, /) -> Array:
        """World directions (B, N, 3) in scaled camera coordinates, (3, B, N)."""

    def points(self, X: Array, /) -> Array:
        """World points (B, N, 3) in scaled camera coordinates, (3, B, N)."""

    def observed_offset(self, xy: Array, /) -> Array:
        """Observed pixels (B, N, 2) as real offsets, (2, B, N)."""

    def nearly_ideal_offset(self, d: Array, /) -> Array:
        """Approximate ideal offsets of real ones."""

    def real_offset(self, s: Array, /) -> Array:
        """Real offsets of ideal ones."""

    def follow(self, s: Array, ds: Array, dds: Array, /) -> tuple[Array, ...]:
        """Real offsets of points of curves, and their first two derivatives from those of the ideal ones."""


class ClosestPoints(NamedTuple):
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
        """The closest points of some of the residuals."""
        return ClosestPoints(*(values[..., part] for values in self))

    def take(self, index: IntArray | slice) -> ClosestPoints:
        """The closest points of the frames `index`."""
        return ClosestPoints(self.r[index], self.s[:, index], self.inverse_depth[index], self.normal[:, index])

    def replaced(self, index: IntArray, other: ClosestPoints) -> ClosestPoints:
        """The closest points, with `other` in place of the frames `index`."""
        merged = ClosestPoints(*(values.copy() for values in self))
        for values, new in zip(merged, other, strict=True):
            values[..., index, :] = new
        return merged

    @staticmethod
    def joined(parts: list[ClosestPoints]) -> ClosestPoints:
        """The residuals of all parts, one part after the other."""
        if len(parts) == 1:
            return parts[0]
        return ClosestPoints(*(np.concatenate(values, axis=-1) for values in zip(*parts, strict=True)))


class CurveSearch:
    """Newton's method for the points of parametrised curves whose real images are closest to observed pixels.

    For each of `iterations`, the caller passes a curve's point and its first two derivatives, in scaled camera
    coordinates, to `step` and adds the result to the curve's parameter; then `found` are the closest points. A curve
    that the ground lifts, where that is not level, has x and y in the world behind these coordinates, (5, B, N).
    """

    def __init__(self, view: View, observed: Array, seen: BoolArray) -> None:
        self.view = view
        self.observed = observed
        self.seen = seen
        self.moved = np.inf

    @property
    def iterations(self) -> Iterator[int]:
        """Numbers of the iterations, which end when terms of third order in the largest step are negligible."""
        for iteration in range(CURVE_STEPS):
            if self.moved < CURVE_STEP:
                return
            yield iteration

    def step(self, point: Array, tangent: Array, curvature: Array, largest: float) -> Array:
        """Change of the curve's parameter (B, N) towards the closest point, at most `largest`."""
        if self.view.terrain is not None and len(point) > 3:
            down, lift = self.view.down, self.view.terrain.lift(point[3:], tangent[3:], curvature[3:])
            point, tangent, curvature = (
                of_level[:3] + of_ground * down
                for of_level, of_ground in zip((point, tangent, curvature), lift, strict=True)
            )
        inverse_depth = 1.0 / away_from_zero(point[2])
        s = point[:2] * inverse_depth
        ds = (tangent[:2] - s * tangent[2]) * inverse_depth
        dds = (curvature[:2] - s * curvature[2] - 2.0 * ds * tangent[2]) * inverse_depth
        real, T, dT = self.view.follow(s, ds, dds)
        step = newton_step(self.observed - real, T, dT, largest)
        self.moved = float((np.abs(step) * self.seen).max(initial=0.0))
        self.last = T, dT, s, ds, dds, inverse_depth, tangent[2], curvature[2], step
        return step

    @property
    def found(self) -> ClosestPoints:
        """The closest points, extrapolated to second order from where the last step began."""
        T, dT, s, ds, dds, inverse_depth, dz, ddz, step = self.last
        step = np.where(np.abs(step) < CURVE_STEP, step, 0.0)  # points that have not converged stay on the curve
        normal = left_normal(T + step * dT)
        s = s + step * (ds + 0.5 * step * dds)
        inverse_depth = inverse_depth / (1.0 + step * (dz + 0.5 * step * ddz) * inverse_depth)
        return ClosestPoints(dot(normal, self.observed - self.view.real_offset(s)), s, inverse_depth, normal)


def newton_step(offset: Array, T: Array, dT: Array, largest: float) -> Array:
    """Newton's step, at most `largest`, along a curve with tangent T and its derivative dT to the point closest to
    where `offset` leads."""
    TT = dot(T, T) + LEAST_LENGTH
    # the second derivative of half the squared distance, kept positive: never towards a maximum
    step = dot(offset, T) / np.maximum(TT - dot(offset, dT), LEAST_BEND * TT)
    return np.asarray(np.minimum(np.maximum(step, -largest), largest))  # np.clip is slower on small arrays


def at_points(view: View, xy: Array, X: Array) -> list[ClosestPoints]:
    """The x and the y residuals of pixels (B, N, 2) against the world points X (B, N, 3)."""
    h = view.points(on_ground(view, X))
    inverse_depth = 1.0 / away_from_zero(h[2])
    s = h[:2] * inverse_depth
    dx, dy = view.observed_offset(xy) - view.real_offset(s)
    zero, one = np.zeros_like(dx), np.ones_like(dx)
    x, y = np.array([one, zero]), np.array([zero, one])
    return [ClosestPoints(dx, s, inverse_depth, x), ClosestPoints(dy, s, inverse_depth, y)]


def on_ground(view: View, X: Array) -> Array:
    """Points (B, N, 3) of a level field where they stand on the ground."""
    return X if view.terrain is None else view.terrain.raised(X)


def cross(a: Array, b: Array) -> Array:
    """Cross products of vectors in space."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def unit(a: Array) -> Array:
    """Plane vectors scaled to length 1."""
    return np.asarray(a * (1.0 / (np.sqrt(dot(a, a)) + LEAST_LENGTH)))


def left_normal(T: Array) -> Array:
    """Unit vectors a quarter turn from the tangents T: for a line's tangent (-ny, nx) its normal (nx, ny)."""
    return unit(np.array([T[1], -T[0]]))


def away_from_zero(depth: Array) -> Array:
    """Depths without an exact zero."""
    is_least = np.abs(depth) < LEAST_DEPTH
    return np.where(is_least, LEAST_DEPTH, depth) if is_least.any() else depth
