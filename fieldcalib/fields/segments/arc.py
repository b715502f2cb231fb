"""Arcs: pixels are measured against the whole circle, by Newton's method on the angle."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from fieldcalib._types import Array, IntArray, number, positive, real_array, whole_number
from fieldcalib.fields.segments.closest import LARGEST_TURN, ClosestPoints, CurveSearch, View, cross, unit
from fieldcalib.fields.segments.rows import Ends, Rows
from fieldcalib.fields.segments.segment import (
    MOST_SAMPLES,
    Parts,
    Ring,
    Segment,
    Vector,
    middles,
    mirrored_point,
    some_pixels,
    steps,
    vector,
)
from fieldcalib.geometry.lens.model import dot


class ArcRows(Rows):
    """Pixels of arcs: the vectors of a row are the centre, and u and v times the radius."""

    name, vectors = "arcs", 3
    compiled = ("ARCS",)

    def closest_points(self, view: View) -> list[ClosestPoints]:
        """Points on whole circles ``A + cos(phi) U + sin(phi) V``, found by Newton's method on phi.

        The search starts at the angle under which the pixel's ray meets the circle's plane, at the height of the
        ground at its centre. The angle is kept as radius and tangent, which a step rotates without trigonometric
        functions; behind their scaled camera coordinates are x and y in the world, where the ground is not level.
        """
        A = middle = view.points(self.geometry[:, :, 0])
        if view.terrain is not None:
            middle = view.points(view.terrain.raised(self.geometry[:, :, 0]))
        U, V = view.directions(self.geometry[:, :, 1]), view.directions(self.geometry[:, :, 2])
        d = view.observed_offset(self.xy)
        p = view.nearly_ideal_offset(d)
        # [U V A] (c, s, 1) ~ (p, 1) by Cramer's rule, without the depth, which is infinite at the horizon
        VA, AU = cross(V, middle), cross(middle, U)
        side = np.where(dot(U[:2], VA[:2]) + U[2] * VA[2] < 0.0, -1.0, 1.0)
        c, s = unit(side * np.array([dot(VA[:2], p) + VA[2], dot(AU[:2], p) + AU[2]]))

        if view.terrain is not None:
            ground = np.moveaxis(self.geometry[:, :, :3, :2], (2, 3), (0, 1))
            A, U, V = (np.concatenate([one, xy]) for one, xy in zip((A, U, V), ground, strict=True))
        radius, tangent = c * U + s * V, c * V - s * U
        search = CurveSearch(view, d, self.label >= 0)
        for _ in search.iterations:
            step = search.step(A + radius, tangent, -radius, LARGEST_TURN)
            turn = 1.0 / np.sqrt(1.0 + step * step)
            radius, tangent = turn * (radius + step * tangent), turn * (tangent - step * radius)
        return [search.found]

    def past_ends(self, X: Array, spans: Array) -> Ends:
        """Which points X (T, N, 3) of the whole circles lie past an end of the arc."""
        middle, half = np.moveaxis(spans[self.label], -1, 0)
        centre, u, v = np.moveaxis(self.geometry[:, :, :3], 2, 0)
        angle = np.arctan2(np.sum((X - centre) * v, axis=-1), np.sum((X - centre) * u, axis=-1))
        turn = (angle - middle + np.pi) % (2.0 * np.pi) - np.pi  # from the middle of the arc
        inside = np.clip(turn, -half, half)
        phi = (middle + inside)[..., None]
        return Ends(turn != inside, centre + np.cos(phi) * u + np.sin(phi) * v, np.zeros_like(turn))

    @property
    def extent(self) -> tuple[Array, Array]:
        """Centre (T, N, 3) and diameter (T, N) of the circles, metres."""
        return self.geometry[:, :, 0], 2.0 * np.linalg.norm(self.geometry[:, :, 1], axis=-1)


@dataclass(frozen=True)
class Arc(Segment):
    """Part of a circle: ``center + radius (cos(phi) u + sin(phi) v)`` for phi from `start` to `stop` (radians).

    u and v are orthogonal unit vectors; by default they span the ground. Pixels are measured against the whole circle.

    Examples
    --------
    >>> Arc((0.0, 0.0, 0.0), radius=9.15).sample(spacing=20.0).round(2)[:2]
    array([[ 9.15,  0.  ,  0.  ],
           [-4.57,  7.92,  0.  ]])
    """

    center: Vector
    radius: float
    start: float = 0.0
    stop: float = 2.0 * np.pi
    u: Vector = (1.0, 0.0, 0.0)
    v: Vector = (0.0, 1.0, 0.0)

    is_arc = True
    rows = ArcRows

    def __post_init__(self) -> None:
        object.__setattr__(self, "center", vector(self.center, "the centre of an Arc"))
        object.__setattr__(self, "u", vector(self.u, "the axis u of an Arc"))
        object.__setattr__(self, "v", vector(self.v, "the axis v of an Arc"))
        axes = np.array([self.u, self.v])
        if not np.allclose(axes @ axes.T, np.eye(2), atol=1e-9):
            raise ValueError(f"an Arc needs orthogonal unit vectors u and v, got u = {self.u}, v = {self.v}")
        positive(self.radius, "the radius of an Arc")
        for name in ("start", "stop"):
            if not math.isfinite(number(getattr(self, name), f"the angle {name} of an Arc")):
                raise ValueError(f"the angle {name} of an Arc must be finite, got {getattr(self, name)}")
        if abs(self.stop - self.start) > 4.0 * np.pi:
            raise ValueError(f"the angles of an Arc are radians, got {self.start:g} to {self.stop:g}: degrees?")

    def sample(self, spacing: float = 1.0) -> Array:
        """Points from start to stop, at most `spacing` metres of arc apart, (N, 3)."""
        count = steps(self.radius * abs(self.stop - self.start), spacing) + 1
        return self.samples(max(count, 3))

    def at(self, phi: Array) -> Array:
        """Points at angles (N,), (N, 3)."""
        angles = real_array(phi)
        if angles.ndim != 1:
            raise ValueError(f"expected angles (N,) in radians, got an array of shape {angles.shape}")
        c, s = np.cos(angles)[:, None], np.sin(angles)[:, None]
        return np.asarray(self.center + self.radius * (c * self.u + s * self.v))

    def samples(self, count: int) -> Array:
        """Points at equal steps from start to stop, both included, (count, 3)."""
        if whole_number(count, "count") > MOST_SAMPLES:
            raise ValueError(f"count must be at most {MOST_SAMPLES}, got {count}")
        return self.at(np.linspace(self.start, self.stop, int(count)))

    @property
    def vectors(self) -> Array:
        """Centre, radius along u and radius along v, (3, 3)."""
        return np.array([self.center, np.multiply(self.radius, self.u), np.multiply(self.radius, self.v)])

    @property
    def anchors(self) -> Array:
        """The centre twice, (2, 3)."""
        return np.array([self.center, self.center])

    @property
    def span(self) -> tuple[float, float]:
        """Angle of its middle, and half of the angle that it spans."""
        return (self.stop + self.start) / 2.0, abs(self.stop - self.start) / 2.0

    @property
    def ring(self) -> Ring:
        """The arc itself."""
        return Ring(self.center, self.radius, self.start, self.stop, self.u, self.v)

    @property
    def whole(self) -> tuple[Vector, float]:
        """Centre and radius of its circle."""
        return self.center, self.radius

    @property
    def is_whole(self) -> bool:
        """Whether it is a closed circle."""
        return abs(self.stop - self.start) >= 2.0 * np.pi

    @property
    def middle_of_curvature(self) -> Vector:
        """Centre of the arc."""
        return self.center

    def equations(self, pixels: int) -> int:
        """One equation for each pixel, at most the five of a conic."""
        return min(whole_number(pixels, "pixels"), 5)

    def mirrored(self, signs: Vector) -> Arc:
        """The arc with its coordinates multiplied by signs."""
        center, u, v = (mirrored_point(X, signs) for X in (self.center, self.u, self.v))
        return replace(self, center=center, u=u, v=v)

    def evaluated(self, straight: float, bent: float) -> Array:
        """Points (N, 3) every `bent` metres from the start on, and the stop; a whole circle is not closed."""
        length = self.radius * abs(self.stop - self.start)
        steps(length, bent)  # raises
        count = int(length / bent)
        step = np.copysign(min(bent, length) / self.radius, self.stop - self.start)
        phi = self.start + np.arange(count + 1) * step
        closed = np.isclose(abs(self.stop - self.start), 2.0 * np.pi)
        return self.at(phi[:-1] if closed else np.append(phi, self.stop))

    def parts(self, longest: float) -> Parts:
        """Equal parts no longer than `longest` metres; with the field's size they move as the centre does."""
        turn = self.stop - self.start
        length = self.radius * abs(turn)
        phi = self.start + middles(length, longest) * turn
        along = np.cos(phi)[:, None] * self.v - np.sin(phi)[:, None] * self.u
        return Parts(self.at(phi), along, np.zeros(len(phi)), length)

    def order(self, xy: Array) -> IntArray:
        """Order of its pixels (N, 2) by angle around their mean, beginning after the widest gap."""
        xy = some_pixels(xy)
        offset = xy - xy.mean(axis=0)
        angle = np.arctan2(offset[:, 1], offset[:, 0])
        order = np.argsort(angle, kind="stable")
        gaps = np.diff(angle[order], append=angle[order[0]] + 2.0 * np.pi)
        return np.roll(order, -int(np.argmax(gaps)) - 1)
