"""Cameras from an ellipse in a picture that may be a circle of a field, and a line that tells how the field is turned.

An ellipse leaves open the focal length of a camera that has square pixels, no lens and a given principal point. For
each of some focal lengths, the cone of its rays is cut in circles by planes of two directions (Kanatani and Liu, 3D
interpretation of conics and orthogonality, 1993); of these, ground that is level is kept. The circle's radius gives the
height of the camera, and a line in the picture, which runs across or along the field, the direction in which it looks.
So rinks are found, of which hardly two lines of each direction show.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fieldcalib._types import Array, BoolArray, IntArray
from fieldcalib.fields.field import Field
from fieldcalib.images.search.cameras_from_lines import LEVEL, focal_lengths, planes_of, rays_of
from fieldcalib.images.search.court_hypotheses import Cameras, plausible, unit, ways
from fieldcalib.images.search.ellipses import Ellipse
from fieldcalib.images.search.long_lines import LongLines

SMALLEST = 1.5  # m: smaller circles are spots
FORWARD = np.array([0.0, 0.0, 1.0])


def circle_hypotheses(
    ellipses: Sequence[Ellipse], lines: LongLines, field: Field, size: tuple[int, int], widened: float = 1.0
) -> Cameras:
    """Cameras that see a circle of a field, whole or in part, in an ellipse of a picture, and a line of it in a line.

    The principal point is in the middle; `widened` as in `focal_lengths`. On a field that looks the same when it is
    turned by 180 degrees, each camera stands for its twin too.
    """
    circles = circles_of(field)
    parts = []
    if len(ellipses) and len(circles) and len(lines):
        views = SeenCircles.of(ellipses, focal_lengths(field, widened), size).with_directions(lines)
        for turn in ways(field):
            for are_across in (True, False):
                parts += [views.cameras(circle, turn=turn, are_across=are_across) for circle in circles]
    return plausible(parts, field, size)


def circles_of(field: Field) -> Array:
    """x and y of the centre, and the radius of circles on the ground of which a field has arcs, (N, 3) metres.

    Examples
    --------
    >>> from fieldcalib.fields import soccer
    >>> circles_of(soccer()).tolist()
    [[-41.5, 0.0, 9.15], [41.5, 0.0, 9.15], [0.0, 0.0, 9.15]]
    """
    rings = [segment.ring for label, segment in field.items() if field.paint_of(label).is_along]
    on_ground = [ring for ring in rings if ring is not None and not any((ring.center[2], ring.u[2], ring.v[2]))]
    circles = {(*ring.center[:2], ring.radius): None for ring in on_ground if ring.radius > SMALLEST}
    return np.array(list(circles), dtype=float).reshape(-1, 3)


@dataclass(frozen=True, eq=False)
class SeenCircles:
    """Level ground on which an ellipse of a picture is a circle, for a focal length."""

    f: Array
    """Focal lengths, in widths of the picture, (N,)."""
    down: Array
    """Direction of gravity for the camera, unit vectors, (N, 3)."""
    centre: Array
    """Of the circle, as seen by a camera 1 m above the ground, (N, 3)."""
    radius: Array
    """Of the circle for such a camera, (N,)."""
    along: Array
    """Direction of a line on the ground, unit vectors, (N, 3); NaN where it is not yet known."""
    size: tuple[int, int]

    @classmethod
    def of(cls, ellipses: Sequence[Ellipse], focal_lengths: Array, size: tuple[int, int]) -> SeenCircles:
        """All ellipses with all focal lengths."""
        conics = np.array([one.conic(0.5 * np.array(size), size[0]) for one in ellipses])
        K = np.stack([np.diag([f, f, 1.0]) for f in focal_lengths])
        Q = np.einsum("fij,ejk,fkl->efil", K, conics, K).reshape(-1, 3, 3)
        f = np.tile(focal_lengths, len(ellipses))
        value, vector = np.linalg.eigh(Q)  # one negative value, two positive ones, in ascending order
        least, middle, largest = value.T
        # a plane that cuts the cone in a circle runs along the axis of its middle value, and leans to one of two sides
        one = np.sqrt((largest - middle) / (largest - least))[:, None] * vector[:, :, 2]
        other = np.sqrt((middle - least) / (largest - least))[:, None] * vector[:, :, 0]
        down = np.concatenate([one + other, one - other])
        down *= np.sign(down[:, 1:2])
        f, Q = np.tile(f, 2), np.tile(Q, (2, 1, 1))
        centre = np.linalg.solve(Q, down[:, :, None])[:, :, 0]  # the pole of the horizon
        with np.errstate(divide="ignore", invalid="ignore"):
            centre /= np.sum(centre * down, axis=1)[:, None]
            across = unit(np.cross(down, FORWARD))
            radius = np.sqrt(-_squared(Q, centre) / _squared(Q, across))
        good = (np.abs(down[:, 0]) < np.sin(LEVEL)) & (down[:, 1] > 0.0) & (centre[:, 2] > 0.0) & (radius > 0.0)
        unknown = np.full_like(down, np.nan)
        return cls(f, down, centre, radius, unknown, size).take(good)

    def with_directions(self, lines: LongLines) -> SeenCircles:
        """Each with each line that lies below its horizon."""
        line, ends = lines.seen_from(0.5 * np.array(self.size), float(self.size[0]))
        view, chosen = (one.ravel() for one in np.indices((len(self.f), len(line))))
        every = self.take(view)
        below = np.all(np.einsum("nek,nk->ne", rays_of(ends[chosen], every.f), every.down) > 0.0, axis=1)
        along = unit(np.cross(planes_of(line[chosen], every.f), every.down))
        return replace(every, along=along).take(below)

    def cameras(self, circle: Array, *, turn: int, are_across: bool) -> Cameras:
        """The cameras for which the circle is one of the field; lines run across it (x is constant) or along it.

        The direction of the lines is that of the field's axis, or with -1 as `turn` the opposite one.
        """
        own = turn * self.along
        other = np.cross(own, self.down) if are_across else np.cross(self.down, own)
        R = np.stack([other, own, self.down] if are_across else [own, other, self.down], axis=2)
        x, y, radius = circle
        height = radius / self.radius
        C = np.array([x, y, 0.0]) - height[:, None] * np.einsum("nij,ni->nj", R, self.centre)
        return Cameras.centred(self.f * self.size[0], R, C, self.size)

    def take(self, index: BoolArray | IntArray) -> SeenCircles:
        """Some of them, by mask or by index."""
        f, down, centre = self.f[index], self.down[index], self.centre[index]
        return SeenCircles(f, down, centre, self.radius[index], self.along[index], self.size)


def _squared(Q: Array, v: Array) -> Array:
    """``v' Q v`` of matrices (N, 3, 3) and vectors (N, 3)."""
    return np.asarray(np.einsum("ni,nij,nj->n", v, Q, v))
