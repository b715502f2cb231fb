"""Hypotheses for the camera from three lines in a picture, taken as two parallel lines of the court and one across.

Three lines do not determine the focal length of a camera with square pixels, no lens and a given principal point, so
several focal lengths are tried. For each, the vanishing point of the two parallel lines gives their direction on the
ground. The third line is perpendicular to it and lies in the plane through the camera and its own image. Both
directions together are the camera's rotation; it must be level, and the three lines must lie below its horizon. The
distance between the two parallel lines on the court gives the camera's height, and each line one coordinate of its
position (Hartley and Zisserman, Multiple View Geometry, chapter 8). This finds courts of which only one line of a
direction shows, or whose lines are bent by a lens.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from fieldcalib._types import Array, IntArray
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
from fieldcalib.images.search.long_lines import LongLines

FACTOR = 1.15  # between successive focal lengths
LEVEL = np.radians(10.0)  # largest roll: broadcast cameras are level to 1 degree, those in halls to 8


def few_line_hypotheses(lines: LongLines, field: Field, size: tuple[int, int], widened: float = 1.0) -> Cameras:
    """Cameras that project two parallel lines of a field, and one across them, onto three lines of the picture.

    The principal point is in the middle; `widened` as in `focal_lengths`. On a field that looks the same when turned by
    180 degrees, each camera also represents the turned one.
    """
    lengths = focal_lengths(field, widened)
    on_field = FieldLines.of(field)
    parts = []
    for are_across in (True, False):
        for turn in ways(field):
            triples = _Triples.of(lines, size, lengths, are_across=are_across, turn=turn)
            parts.append(triples.cameras(on_field, heights(field)))
    return plausible(parts, field, size)


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
        pair, third, index = _combined(parallel_pairs(line, ends), len(line), len(focal_lengths))
        f = focal_lengths[index]
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
        pair_values, third_values = (field.across, field.along) if self.are_across else (field.along, field.across)
        pair_reach, third_reach = (
            (field.across_reach, field.along_reach) if self.are_across else (field.along_reach, field.across_reach)
        )
        two = np.array(list(combinations(range(len(pair_values)), 2)), dtype=np.intp).reshape(-1, 2)
        # two lines of the field determine the height; its range excludes most pairs before the third line is tried
        with np.errstate(divide="ignore", invalid="ignore"):
            height = np.diff(pair_values[two], axis=1)[:, 0] / np.diff(self.u, axis=1)
        t, q = np.nonzero((height > heights[0]) & (height < heights[1]))
        h = height[t, q]
        at_u = pair_values[two[q, 0]] - h * self.u[t, 0]
        third_ends = at_u[:, None] + h[:, None] * self.third_ends[t]
        found = [(np.zeros(0, dtype=np.intp), np.zeros((0, 3)))]
        for value, reach in zip(third_values, third_reach, strict=True):
            at_v = value - h * self.v[t]
            good = are_within(third_ends, reach)
            for k in (0, 1):
                pair_ends = at_v[:, None] + h[:, None] * self.pair_ends[t, k]
                good &= are_within(pair_ends, pair_reach[two[q, k]])
            place = (at_u, at_v, -h) if self.are_across else (at_v, at_u, -h)
            found.append((t[good], np.column_stack(place)[good]))
        index, C = (np.concatenate(parts) for parts in zip(*found, strict=True))
        return Cameras.centred(self.f[index], self.R[index], C, self.size)


def _combined(pairs: IntArray, count: int, focal_lengths: int) -> tuple[IntArray, IntArray, IntArray]:
    """All combinations of pairs (N, 2), other lines (N,) and focal lengths (N,)."""
    pair, third, f = (one.ravel() for one in np.indices((len(pairs), count, focal_lengths)).reshape(3, -1))
    apart = np.all(pairs[pair] != third[:, None], axis=1)
    return pairs[pair[apart]], third[apart], f[apart]


def planes_of(line: Array, f: Array) -> Array:
    """Normals (N, 3) of the planes through the camera centre and lines (N, 3) of the picture."""
    return np.column_stack([line[:, :2] * f[:, None], line[:, 2]])


def rays_of(ends: Array, f: Array) -> Array:
    """Rays (N, 2, 3) through pixels (N, 2, 2), in camera coordinates."""
    return np.concatenate([ends / f[:, None, None], np.ones((*ends.shape[:2], 1))], axis=2)


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(np.sum(a * b, axis=1))
