"""Straight lines: pixels are measured against the infinite line, in closed form without a lens."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fieldcalib._types import Array, whole_number
from fieldcalib.fields.segments.closest import (
    LEAST_LENGTH,
    LINE_STEP,
    LINE_STEPS,
    ClosestPoints,
    CurveSearch,
    View,
    cross,
    left_normal,
    newton_step,
)
from fieldcalib.fields.segments.rows import Ends, Rows
from fieldcalib.fields.segments.segment import Parts, Segment, Vector, middles, mirrored_point, steps, vector
from fieldcalib.geometry.lens.model import dot

FARTHEST = 1e3  # lengths of a segment: where points at infinity are taken to be
LARGEST_SHARE = 1.0  # of a line's length: the longest step along it


class LineRows(Rows):
    """Pixels of lines: the vectors of a row are the start, and the end minus the start."""

    name, vectors = "lines", 2
    compiled = ("LINES",)

    def closest_points(self, view: View) -> list[ClosestPoints]:
        """Points on infinite lines; with a lens, refined along the line's curved image."""
        A, D = view.points(self.geometry[:, :, 0]), view.directions(self.geometry[:, :, 1])
        line = cross(A, D)  # the image line: right even with an end behind the camera
        scale = 1.0 / (np.sqrt(dot(line[:2], line[:2])) + LEAST_LENGTH)
        normal = n = line[:2] * scale
        d = view.observed_offset(self.xy)
        p = view.nearly_ideal_offset(d)
        r = dot(n, p) + line[2] * scale
        s = p - r * n
        along = n[0] * p[1] - n[1] * p[0]  # the closest point's coordinate on the image line
        if not view.is_pinhole:
            tangent, straight = np.array([-n[1], n[0]]), np.zeros_like(n)
            seen, reach, step = self.label >= 0, view.reach, np.zeros_like(r)
            for _ in range(LINE_STEPS):
                s, along = s + step * tangent, along + step
                real, T, dT = view.follow(s, tangent, straight)
                step = newton_step(d - real, T, dT, reach)  # bounded where the lens folds back
                if (np.abs(step) * seen).max(initial=0.0) < LINE_STEP:
                    break
            step = np.where(np.abs(step) < LINE_STEP, step, 0.0)  # points that have not converged stay on the image
            s, along = s + step * tangent, along + step
            normal = left_normal(T + step * dT)
            r = dot(normal, d - real - step * (T + 0.5 * step * dT))
        denominator = along * D[2] - n[0] * D[1] + n[1] * D[0]
        if view.terrain is not None:
            share = (n[0] * A[1] - n[1] * A[0] - along * A[2]) / np.where(denominator, denominator, LEAST_LENGTH)
            return [self._on_ground(view, A, D, d, share)]
        return [ClosestPoints(r, s, denominator * scale, normal)]

    def _on_ground(self, view: View, A: Array, D: Array, d: Array, share: Array) -> ClosestPoints:
        """Points on lines that follow the ground, from those on level ground: shares (B, N) of the way from A by D."""
        ground = np.moveaxis(self.geometry[:, :, :2, :2], (2, 3), (0, 1))
        A, D = (np.concatenate([one, xy]) for one, xy in zip((A, D), ground, strict=True))
        t = np.clip(share, -FARTHEST, FARTHEST)
        search, zero = CurveSearch(view, d, self.label >= 0), np.zeros_like(D)
        for _ in search.iterations:
            t = t + search.step(A + t * D, D, zero, LARGEST_SHARE)
        found = search.found
        return found._replace(r=-found.r, normal=-found.normal)  # on the side that the normal of ``A x D`` has

    def past_ends(self, X: Array, spans: Array) -> Ends:
        """Which points X (T, N, 3) of the lines lie past an end."""
        start, direction = self.geometry[:, :, 0], self.geometry[:, :, 1]
        share = np.sum((X - start) * direction, axis=-1) / np.sum(np.square(direction), axis=-1)
        inside = np.clip(share, 0.0, 1.0)
        return Ends(share != inside, start + inside[..., None] * direction, inside)

    @property
    def extent(self) -> tuple[Array, Array]:
        """Middle (T, N, 3) and length (T, N) of the lines, metres."""
        start, direction = self.geometry[:, :, 0], self.geometry[:, :, 1]
        return start + 0.5 * direction, np.linalg.norm(direction, axis=-1)


@dataclass(frozen=True)
class Line(Segment):
    """A straight segment from `start` to `end`. Pixels are measured against the infinite line through both; those past
    an end have a second residual against that end (`fieldcalib.problem.evaluation`).

    Examples
    --------
    >>> Line((0.0, 0.0, 0.0), (0.0, 0.0, -2.44)).sample(spacing=1.0)[:, 2]
    array([ 0.        , -0.81333333, -1.62666667, -2.44      ])
    """

    start: Vector
    end: Vector

    is_straight = True
    rows = LineRows

    def __post_init__(self) -> None:
        object.__setattr__(self, "start", vector(self.start, "the start of a Line"))
        object.__setattr__(self, "end", vector(self.end, "the end of a Line"))
        if self.start == self.end:
            raise ValueError(f"a Line needs two different end points, got start = end = {self.start}")

    def sample(self, spacing: float = 1.0) -> Array:
        """Points from start to end, at most `spacing` metres apart, (N, 3)."""
        start, end = np.array(self.start), np.array(self.end)
        count = steps(float(np.linalg.norm(end - start)), spacing) + 1
        return np.asarray(start + np.linspace(0.0, 1.0, max(count, 2))[:, None] * (end - start))

    @property
    def vectors(self) -> Array:
        """Start, and end minus start, (2, 3)."""
        return np.array([self.start, np.subtract(self.end, self.start)])

    def equations(self, pixels: int) -> int:
        """Two equations; one for a single pixel."""
        return min(whole_number(pixels, "pixels"), 2)

    def mirrored(self, signs: Vector) -> Line:
        """The line with its coordinates multiplied by signs."""
        return Line(mirrored_point(self.start, signs), mirrored_point(self.end, signs))

    @property
    def anchors(self) -> Array:
        """Start and end, (2, 3)."""
        return np.array([self.start, self.end])

    def corners(self) -> Array:
        """Start and end, (2, 3)."""
        return self.anchors

    def evaluated(self, straight: float, bent: float) -> Array:
        """Points (N, 3) every `straight` metres from the start on; the last piece is longer."""
        start, direction = self.vectors
        length = float(np.linalg.norm(direction))
        if steps(length, straight) < 2:
            return self.anchors
        places = np.arange(int(length / straight - 1.0) + 1)[:, None] * straight
        return np.concatenate([start + places * direction / length, [self.end]])

    def parts(self, longest: float) -> Parts:
        """Equal parts no longer than `longest` metres."""
        start, direction = self.vectors
        length = float(np.linalg.norm(direction))
        share = middles(length, longest)
        along = np.broadcast_to(direction / length, (len(share), 3))
        return Parts(start + share[:, None] * direction, along, share, length)
