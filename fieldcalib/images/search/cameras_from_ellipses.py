"""Hypotheses for the camera from an ellipse in a picture, taken as a circle of the field, and one line.

An ellipse does not determine the focal length of a camera with square pixels, no lens and a given principal point, so
several focal lengths are tried. For each, the cone of rays through the ellipse is cut in circles by planes of two
orientations (Kanatani and Liu, 3D interpretation of conics and orthogonality, 1993); a plane is kept if it is level for
a camera nearly without roll. The circle's radius then gives the height of the camera, and a line in the picture, which
runs across or along the field, gives the direction in which the camera looks. This finds rinks, where two lines of each
direction are rarely in view.
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

SMALLEST = 1.5  # m, radius: smaller circles are spots
FORWARD = np.array([0.0, 0.0, 1.0])


def circle_hypotheses(
    ellipses: Sequence[Ellipse], lines: LongLines, field: Field, size: tuple[int, int], widened: float = 1.0
) -> Cameras:
    """Cameras that project a circle of a field onto an ellipse of the picture, and a line of the field onto a line.

    The principal point is in the middle; `widened` as in `focal_lengths`. On a field that looks the same when turned by
    180 degrees, each camera also represents the turned one.
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
    """Circles on the ground of which a field has arcs: x and y of the centre, and the radius, (N, 3) metres.

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
    """Pairs of focal length and level ground plane for which an ellipse of the picture is a circle on the ground."""

    f: Array
    """Focal lengths, in widths of the picture, (N,)."""
    down: Array
    """Direction of gravity in camera coordinates, unit vectors, (N, 3)."""
    centre: Array
    """Centre of the circle in camera coordinates if the camera is 1 m above the ground, (N, 3)."""
    radius: Array
    """Radius of the circle if the camera is 1 m above the ground, (N,)."""
    along: Array
    """Direction of a line on the ground in camera coordinates, unit vectors, (N, 3); NaN while unknown."""
    size: tuple[int, int]

    @classmethod
    def of(cls, ellipses: Sequence[Ellipse], focal_lengths: Array, size: tuple[int, int]) -> SeenCircles:
        """Combine all ellipses with all focal lengths; keep the level planes below the camera."""
        conics = np.array([one.conic(0.5 * np.array(size), size[0]) for one in ellipses])
        K = np.stack([np.diag([f, f, 1.0]) for f in focal_lengths])
        Q = np.einsum("fij,ejk,fkl->efil", K, conics, K).reshape(-1, 3, 3)
        f = np.tile(focal_lengths, len(ellipses))
        value, vector = np.linalg.eigh(Q)  # one negative value, two positive ones, in ascending order
        least, middle, largest = value.T
        # a plane that cuts the cone in a circle contains the eigenvector of the middle eigenvalue and leans to one of
        # two sides: its normal is a combination of the other two eigenvectors
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
        """Combine each pair with each line that lies below its horizon."""
        line, ends = lines.seen_from(0.5 * np.array(self.size), float(self.size[0]))
        view, chosen = (one.ravel() for one in np.indices((len(self.f), len(line))))
        every = self.take(view)
        below = np.all(np.einsum("nek,nk->ne", rays_of(ends[chosen], every.f), every.down) > 0.0, axis=1)
        along = unit(np.cross(planes_of(line[chosen], every.f), every.down))
        return replace(every, along=along).take(below)

    def cameras(self, circle: Array, *, turn: int, are_across: bool) -> Cameras:
        """Solve for the cameras if the ellipse is this `circle` of the field, and lines run across or along the field.

        Lines across have constant x. With a `turn` of 1 they run in the direction of the field's axis, with -1 in the
        opposite direction.
        """
        own = turn * self.along
        other = np.cross(own, self.down) if are_across else np.cross(self.down, own)
        R = np.stack([other, own, self.down] if are_across else [own, other, self.down], axis=2)
        x, y, radius = circle
        height = radius / self.radius
        C = np.array([x, y, 0.0]) - height[:, None] * np.einsum("nij,ni->nj", R, self.centre)
        return Cameras.centred(self.f * self.size[0], R, C, self.size)

    def take(self, index: BoolArray | IntArray) -> SeenCircles:
        """Select by mask or by index."""
        f, down, centre = self.f[index], self.down[index], self.centre[index]
        return SeenCircles(f, down, centre, self.radius[index], self.along[index], self.size)


def _squared(Q: Array, v: Array) -> Array:
    """``v' Q v`` of matrices (N, 3, 3) and vectors (N, 3)."""
    return np.asarray(np.einsum("ni,nij,nj->n", v, Q, v))
