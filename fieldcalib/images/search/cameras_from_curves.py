"""Hypotheses for the camera from few curves in a picture: three lines, or an ellipse and a line.

Three lines are taken as two parallel lines of the court and one across (`few_line_hypotheses`).

Three lines do not determine the focal length of a camera with square pixels, no lens and a given principal point, so
several focal lengths are tried. For each, the vanishing point of the two parallel lines gives their direction on the
ground. The third line is perpendicular to it and lies in the plane through the camera and its own image. Both
directions together are the camera's rotation; it must be level, and the three lines must lie below its horizon. The
distance between the two parallel lines on the court gives the camera's height, and each line one coordinate of its
position (Hartley and Zisserman, Multiple View Geometry, chapter 8). This finds courts of which only one line of a
direction shows, or whose lines are bent by a lens.

An ellipse is taken as a circle of the field (`circle_hypotheses`). It does not determine the focal length either. For
each one that is tried, the cone of rays through the ellipse is cut in circles by planes of two orientations (Kanatani
and Liu, 3D interpretation of conics and orthogonality, 1993); a plane is kept if it is level for a camera nearly
without roll. The circle's radius then gives the height of the camera, and a line in the picture, which runs across or
along the field, gives the direction in which the camera looks. This finds rinks, where two lines of each direction are
rarely in view.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fieldcalib._types import Array, BoolArray, IntArray
from fieldcalib.fields.field import Field
from fieldcalib.fields.traits import focal_length_from_fov
from fieldcalib.images.search.court_hypotheses import (
    Cameras,
    FieldLines,
    are_within,
    heights,
    parallel_pairs,
    plausible,
    unit,
    ways,
)
from fieldcalib.images.search.ellipses import Ellipse
from fieldcalib.images.search.long_lines import LongLines

FACTOR = 1.15  # between successive focal lengths
LEVEL = np.radians(10.0)  # largest roll: broadcast cameras are level to 1 degree, those in halls to 8
SMALLEST = 1.5  # m, radius: smaller circles are spots


def few_line_hypotheses(lines: LongLines, field: Field, size: tuple[int, int], widened: float = 1.0) -> Cameras:
    """Cameras that project two parallel lines of a field, and one across them, onto three lines of the picture.

    The principal point is in the middle; `widened` as in `focal_lengths`. On a field that looks the same when turned by
    180 degrees, each camera also represents the turned one.
    """
    lengths, on_field = focal_lengths(field, widened), FieldLines.of(field)
    each = ((are_across, turn) for are_across in (True, False) for turn in ways(field))
    triples = (_Triples.of(lines, size, lengths, are_across=one, turn=turn) for one, turn in each)
    return plausible([one.cameras(on_field, heights(field)) for one in triples], field, size)


def focal_lengths(field: Field, widened: float = 1.0) -> Array:
    """Focal lengths to try for the field's cameras, in widths of the picture, in even ratios.

    Removing the distortion of a picture (`fieldcalib.images.search.long_lines.Bend`) widens its field of view by the
    factor `widened`: a wide lens with 90 degrees then has up to 120.
    """
    fov = np.radians([stand.fov for stand in field.stands or field.named_stands.values()])
    least, most = focal_length_from_fov(fov.max(), 1.0) / widened, focal_length_from_fov(fov.min(), 1.0)
    return np.asarray(np.geomspace(least, most, int(np.ceil(np.log(most / least) / np.log(FACTOR))) + 1))


@dataclass(frozen=True, eq=False)
class _Triples:
    """Rotations for which two lines of the picture are parallel on level ground, and a third one perpendicular to them.

    Ground coordinates have their origin below the camera and hold for a camera 1 m above the ground: `u` across the two
    parallel lines, `v` along them.
    """

    f: Array
    """Focal lengths, pixels, (T,)."""
    R: Array
    """Rotations from world to camera; the columns are the field's axes in camera coordinates, (T, 3, 3)."""
    u: Array
    """u of the two parallel lines, in ascending order, (T, 2)."""
    v: Array
    """v of the third line, (T,)."""
    pair_ends: Array
    """v of the ends of the two parallel lines, in ascending order, (T, 2, 2)."""
    third_ends: Array
    """u of the ends of the third line, in ascending order, (T, 2)."""
    size: tuple[int, int]
    are_across: bool
    """Whether the two lines run across the field, so that x is constant on them."""

    @classmethod
    def of(
        cls, lines: LongLines, size: tuple[int, int], focal_lengths: Array, *, are_across: bool, turn: int
    ) -> _Triples:
        """Combine all pairs of lines, third lines and focal lengths; `turn` is -1 for cameras turned by 180 degrees."""
        width = float(size[0])
        line, ends = lines.seen_from(0.5 * np.array(size), width)
        pairs = parallel_pairs(line, ends)
        pair, third, f = (one.ravel() for one in np.indices((len(pairs), len(line), len(focal_lengths))))
        apart = np.all(pairs[pair] != third[:, None], axis=1)
        pair, third, f = pairs[pair[apart]], third[apart], focal_lengths[f[apart]]
        first, second, other = (planes_of(line[one], f) for one in (pair[:, 0], pair[:, 1], third))
        along = unit(np.cross(first, second)) * turn
        across = unit(np.cross(other, along))
        down = np.cross(across, along) if are_across else np.cross(along, across)
        # normals of planes have no sign: the vertical is made to point down, and `turn` tries both directions along
        sign = np.sign(down[:, 1:2])
        across, down = across * sign, down * sign
        good = (np.abs(down[:, 0]) < np.sin(LEVEL)) & (down[:, 1] > 0.0)
        rays = np.stack([rays_of(ends[one], f) for one in (pair[:, 0], pair[:, 1], third)], axis=1)
        depth = np.einsum("nlek,nk->nle", rays, down)
        good &= np.all(depth > 0.0, axis=(1, 2))
        first, second, other, along, across, down = (one[good] for one in (first, second, other, along, across, down))
        with np.errstate(divide="ignore", invalid="ignore"):
            u = np.stack([-_dot(one, down) / _dot(one, across) for one in (first, second)], axis=1)
            v = -_dot(other, down) / _dot(other, along)
            of_ends = rays[good] / depth[good][..., None]
        end_u, end_v = (np.einsum("nlek,nk->nle", of_ends, one) for one in (across, along))
        order = np.argsort(u, axis=1)
        R = np.stack([across, along, down] if are_across else [along, across, down], axis=2)
        u, end_v = np.take_along_axis(u, order, axis=1), np.take_along_axis(end_v[:, :2], order[:, :, None], axis=1)
        end_u, end_v = np.sort(end_u[:, 2], axis=1), np.sort(end_v, axis=2)
        return cls(f[good] * width, R, u, v, end_v, end_u, size, are_across)

    def cameras(self, field: FieldLines, heights: tuple[float, float]) -> Cameras:
        """Solve for the cameras that have lines of a field in these lines, and a height within a range."""
        both = (field.across, field.across_reach), (field.along, field.along_reach)
        (pair_values, pair_reach), (third_values, third_reach) = both if self.are_across else both[::-1]
        two = np.column_stack(np.triu_indices(len(pair_values), 1))
        # two lines of the field determine the height; its range excludes most pairs before the third line is tried
        with np.errstate(divide="ignore", invalid="ignore"):
            height = np.diff(pair_values[two], axis=1)[:, 0] / np.diff(self.u, axis=1)
        t, q = np.nonzero((height > heights[0]) & (height < heights[1]))
        h = height[t, q]
        at_u = pair_values[two[q, 0]] - h * self.u[t, 0]
        third_ends = at_u[:, None] + h[:, None] * self.third_ends[t]
        found = [(np.zeros(0, dtype=np.intp), np.zeros((0, 3)))]
        for value, reach in zip(third_values, third_reach, strict=True):
            for_third = np.flatnonzero(are_within(third_ends, reach))
            own, of_pair, up = t[for_third], two[q[for_third]], h[for_third]
            at_v = value - up * self.v[own]
            good = np.ones(len(own), dtype=bool)
            for k in (0, 1):
                pair_ends = at_v[:, None] + up[:, None] * self.pair_ends[own, k]
                good &= are_within(pair_ends, pair_reach[of_pair[:, k]])
            place = (at_u[for_third], at_v, -up) if self.are_across else (at_v, at_u[for_third], -up)
            found.append((own[good], np.column_stack(place)[good]))
        index, C = (np.concatenate(parts) for parts in zip(*found, strict=True))
        return Cameras.centred(self.f[index], self.R[index], C, self.size)


def planes_of(line: Array, f: Array) -> Array:
    """Normals (N, 3) of the planes through the camera centre and lines (N, 3) of the picture."""
    return np.column_stack([line[:, :2] * f[:, None], line[:, 2]])


def rays_of(ends: Array, f: Array) -> Array:
    """Rays (N, 2, 3) through pixels (N, 2, 2), in camera coordinates."""
    return np.concatenate([ends / f[:, None, None], np.ones((*ends.shape[:2], 1))], axis=2)


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(np.sum(a * b, axis=1))


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
            across = unit(np.cross(down, (0.0, 0.0, 1.0)))
            of_centre, of_across = (np.einsum("ni,nij,nj->n", v, Q, v) for v in (centre, across))
            radius = np.sqrt(-of_centre / of_across)
        good = (np.abs(down[:, 0]) < np.sin(LEVEL)) & (down[:, 1] > 0.0) & (centre[:, 2] > 0.0) & (radius > 0.0)
        return cls(f, down, centre, radius, np.full_like(down, np.nan), size).take(good)

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
