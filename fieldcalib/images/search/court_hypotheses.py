"""Hypotheses for the camera from four lines in a picture, taken as two lines across and two along the court.

Two lines of the picture are assumed to be lines across the field (x is constant on them), and two others to be lines
along it. Their four crossings are then the corners of a rectangle on the field, which gives a homography from metres to
pixels. For a camera with square pixels, no lens and a given principal point, its columns h1 and h2 satisfy
``h1' w h2 = 0`` and ``h1' w h1 = h2' w h2`` with ``w = diag(1, 1, f^2)``. Both equations are linear in f^2 (Zhang, A
flexible new technique for camera calibration, 2000), so they determine the focal length, and they agree only if the
rectangle has the right shape. A homography exists for any four lines, but few homographies are those of a camera that
stands where cameras of the field do (`stands`).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fieldcalib._types import Array, BoolArray, IntArray
from fieldcalib.assess.verdict import STEEPLY
from fieldcalib.fields.field import TURN, Field, looks_the_same_turned
from fieldcalib.fields.traits import stand_above
from fieldcalib.geometry.camera import Camera
from fieldcalib.images.search.long_lines import LongLines

SHORTEST = 0.12  # of the field's extent in that direction: shorter markings do not count as long lines
SAME_LINE = 0.01  # m: markings nearer to each other lie on one line
FARTHEST_CUT = 1.2  # picture widths from the middle to the principal point, if the picture is cut out of a larger one
LARGEST_MISFIT = 0.25  # of both equations for f^2, as a share of the squared columns: lens, principal point, noise
FARTHEST_CORNER = 2.5  # picture widths from the middle: lines that cross further away are nearly parallel
MARGIN_FOV, MARGIN_HEIGHT = 1.5, 1.6  # factors by which cameras may exceed the ranges of the stands
HIGHER = 2.0  # the factor above the highest stand: the upper tiers of arenas are 30 m above a court
OVER, OVER_SHARE = 0.3, 0.05  # m, and share of its length, by which a line may be longer than its marking
STEEPEST_ROLL = np.radians(12.0)  # largest roll of a plausible camera
# Rectangles seen from above: cosine of their corners, change of scale across them, misfit of their shape, and a usual
# focal length, in widths of the picture, as they leave it open.
SKEW, PERSPECTIVE, MISSHAPEN, FOCAL_LENGTH_ABOVE = 0.2, 0.4, 0.15, 0.8
INSIDE = 0.35  # share of the field's half extent; no camera stands nearer to the centre


@dataclass(frozen=True, eq=False)
class Cameras:
    """B pinhole cameras of pictures of one size."""

    f: Array
    """Focal lengths, (B,) pixels."""
    c: Array
    """Principal points, (B, 2) pixels."""
    R: Array
    """Rotations from world to camera, (B, 3, 3)."""
    C: Array
    """Positions, (B, 3) metres."""
    size: tuple[int, int]

    def __len__(self) -> int:
        return len(self.f)

    @classmethod
    def centred(cls, f: Array, R: Array, C: Array, size: tuple[int, int]) -> Cameras:
        """Cameras with the principal point in the middle, at one position each, C (B, 3), or all at one (3,)."""
        return cls(f, np.tile(0.5 * np.array(size), (len(f), 1)), R, np.broadcast_to(C, (len(f), 3)), size)

    @classmethod
    def joined(cls, parts: Iterable[Cameras], size: tuple[int, int]) -> Cameras:
        """Concatenate the cameras of several parts, which may be none."""
        every = [cls(np.zeros(0), np.zeros((0, 2)), np.zeros((0, 3, 3)), np.zeros((0, 3)), size), *parts]
        f, c, R, C = (np.concatenate([getattr(one, name) for one in every]) for name in ("f", "c", "R", "C"))
        return cls(f, c, R, C, size)

    def take(self, index: BoolArray | IntArray) -> Cameras:
        """Select cameras by mask or by index."""
        return Cameras(self.f[index], self.c[index], self.R[index], self.C[index], self.size)

    def turned(self, some: BoolArray) -> Cameras:
        """Turn the cameras of a mask (B,) by 180 degrees about the centre mark; the others stay."""
        turn = np.where(some[:, None], TURN, 1.0)
        return Cameras(self.f, self.c, self.R * turn[:, None], self.C * turn, self.size)

    @classmethod
    def of(cls, cameras: Sequence[Camera], size: tuple[int, int]) -> Cameras:
        """Collect some cameras of pictures of one size, without their lenses."""
        K, R, C = (np.array([getattr(one, name) for one in cameras]) for name in ("K", "R", "C"))
        return cls(K[:, 0, 0], K[:, :2, 2], R, C, size)

    @property
    def projections(self) -> Array:
        """Projections (B, 3, 4) of homogeneous world points to pixels."""
        M = self.R * self.f[:, None, None]
        M[:, 2] = self.R[:, 2]
        M[:, :2] += self.c[:, :, None] * self.R[:, 2:]
        return np.concatenate([M, -(M @ self.C[:, :, None])], axis=2)

    def camera(self, index: int) -> Camera:
        """The camera at an index, as a `Camera`."""
        (cx, cy), f = self.c[index].tolist(), float(self.f[index])
        return Camera([[f, 0.0, cx], [0.0, f, cy], [0.0, 0.0, 1.0]], self.R[index], self.C[index], self.size)


@dataclass(frozen=True, eq=False)
class FieldLines:
    """Lines of a field on the ground that are long enough to be seen as lines."""

    across: Array
    """x of the lines across the field, ascending, metres."""
    along: Array
    """y of the lines along the field, ascending, metres."""
    across_reach: Array
    """Least and largest y of the markings on each line across the field, (N, 2)."""
    along_reach: Array
    """Least and largest x of the markings on each line along the field, (M, 2)."""

    @classmethod
    def of(cls, field: Field) -> FieldLines:
        """Collect the painted lines of a field.

        Examples
        --------
        >>> from fieldcalib.fields import volleyball
        >>> lines = FieldLines.of(volleyball())
        >>> lines.across.tolist(), lines.along.tolist()
        ([-8.975, -2.975, 0.0, 2.975, 8.975], [-4.475, 4.475])
        """
        found: tuple[list[tuple[float, float, float]], ...] = [], []
        for label, segment in field.items():
            if not segment.is_straight or not field.paint_of(label).is_along:
                continue
            start, along = segment.vectors
            if start[2] or along[2]:
                continue
            for axis, extent in ((0, field.width), (1, field.length)):
                if abs(along[axis]) < 1e-6 and abs(along[1 - axis]) > SHORTEST * extent:
                    ends = start[1 - axis], start[1 - axis] + along[1 - axis]
                    found[axis].append((float(start[axis]), float(min(ends)), float(max(ends))))
        (across, across_reach), (along, along_reach) = map(_joined, found)
        return cls(across, along, across_reach, along_reach)


def _joined(markings: list[tuple[float, float, float]]) -> tuple[Array, Array]:
    """Positions of lines in ascending order, and their ends; markings within `SAME_LINE` of each other are one line."""
    place, low, high = np.array(sorted(markings), dtype=float).reshape(-1, 3).T
    first = np.flatnonzero(np.append(True, np.diff(place) > SAME_LINE)[: len(place)])
    if not len(first):
        return place, np.zeros((0, 2))
    return place[first], np.column_stack([np.minimum.reduceat(low, first), np.maximum.reduceat(high, first)])


def hypotheses(
    lines: LongLines, field: Field, size: tuple[int, int], row: float | None = None, *, from_above: bool = False
) -> Cameras:
    """Cameras that project two lines across the field and two along it onto two pairs of lines of the picture.

    On a field that looks the same when turned by 180 degrees, each camera also represents the turned one.

    Parameters
    ----------
    lines : LongLines
    field : Field
    size : (int, int)
        Width and height of the picture.
    row : float, optional
        Row of the principal point, from the middle of the picture, in widths of the picture, for a picture cut out of a
        larger one; the column is then solved for. By default the principal point is in the middle.
    from_above : bool
        Whether cameras look down on the field, from where its rectangles are nearly such in the picture.
    """
    on_field = FieldLines.of(field)
    quads = _Quads.of(lines, size, 0.5 * np.array(size) + (0.0, size[0] * (row or 0.0)))
    quads = quads.take(quads.are_rectangles) if from_above else quads
    across, along = (np.column_stack(np.triu_indices(len(one), 1)) for one in (on_field.across, on_field.along))
    found = [(np.zeros(0, dtype=np.intp), np.zeros((0, 2), dtype=np.intp), np.zeros((0, 2), dtype=np.intp))]
    for step in ways(field):
        for i in across[:, ::step]:
            pairs = along[:, ::step]
            reach = on_field.across_reach[i], on_field.along_reach[pairs]
            j, those = np.nonzero(quads.are_within(on_field.across[i], on_field.along[pairs], *reach))
            found.append((those, np.broadcast_to(i, (len(j), 2)), pairs[j]))
    chosen, i, j = (np.concatenate(parts) for parts in zip(*found, strict=True))
    own, x, y = quads.take(chosen), on_field.across[i], on_field.along[j]
    solve = own.from_above if from_above else own.cameras
    return plausible([solve(x, y) if row is None else own.cut_out(x, y)], field, size, from_above=from_above)


def ways(field: Field) -> tuple[int, ...]:
    """Orders in which the field's lines are tried, 1 and -1 (reversed); 1 suffices on a field that looks the same."""
    return (1,) if looks_the_same_turned(field) else (1, -1)


def plausible(parts: Iterable[Cameras], field: Field, size: tuple[int, int], *, from_above: bool = False) -> Cameras:
    """Keep the cameras that stand where cameras of the field do (`stands`), or those `from_above` it.

    On a field that looks the same when turned by 180 degrees, each camera is moved to the canonical side, and also
    represents the turned one.
    """
    joined = Cameras.joined(parts, size)
    joined = joined.take(are_above(joined, field) if from_above else stands(joined, field))
    return on_canonical_side(joined, field) if looks_the_same_turned(field) else joined


def stands(cameras: Cameras, field: Field) -> BoolArray:
    """Whether cameras (B,) have a plausible position, field of view and roll, by the ranges of the field's stands."""
    everywhere = field.stands or tuple(field.named_stands.values())
    fov = np.radians([stand.fov for stand in everywhere])
    low, high = heights(field)
    half_fov = np.arctan(0.5 * cameras.size[0] / cameras.f)
    good = (2.0 * half_fov > fov.min() / MARGIN_FOV) & (2.0 * half_fov < min(fov.max() * MARGIN_FOV, 2.6))
    good &= (-cameras.C[:, 2] > low) & (-cameras.C[:, 2] < high)
    good &= np.linalg.norm(cameras.C, axis=1) < field.farthest_camera
    good &= np.any(np.abs(cameras.C[:, :2]) > INSIDE * np.array(field.half_extent), axis=1)
    right = cameras.R[:, 0]  # the horizontal direction of the picture: level without roll
    return np.asarray(good & (np.abs(right[:, 2]) < np.sin(STEEPEST_ROLL)) & (cameras.R[:, 1, 2] > 0.0))


def are_above(cameras: Cameras, field: Field) -> BoolArray:
    """Whether cameras (B,) look down on the field as those of `stand_above` do."""
    above = stand_above(field.length, field.width, principal_point=1.0)
    half_fov, height = np.degrees(np.arctan(0.5 * cameras.size[0] / cameras.f)), -cameras.C[:, 2]
    good = (2.0 * half_fov > above.fov[0] / MARGIN_FOV) & (2.0 * half_fov < above.fov[1] * MARGIN_FOV)
    good &= (height > -above.z[1] / MARGIN_HEIGHT) & (height < -above.z[0] * MARGIN_HEIGHT)
    good &= np.linalg.norm(cameras.C, axis=1) < field.farthest_camera
    return np.asarray(good & (cameras.R[:, 2, 2] > np.cos(STEEPLY)))


def heights(field: Field) -> tuple[float, float]:
    """Least and largest height of cameras above the ground, metres."""
    z = [height for stand in field.stands or field.named_stands.values() for height in stand.z]
    return -max(z) / MARGIN_HEIGHT, -min(z) * HIGHER


def on_canonical_side(cameras: Cameras, field: Field) -> Cameras:
    """Turn cameras on the far side or behind the right end by 180 degrees about the centre mark.

    Above the field it counts where the lower edge of the picture points to.
    """
    x, y, _ = cameras.C.T
    down_x, down_y, _ = cameras.R[:, 1].T
    is_above = are_above(cameras, field) & (np.abs(x) < 0.5 * field.length) & (np.abs(y) < 0.5 * field.width)
    is_behind = np.abs(x) - 0.5 * field.length > np.abs(y) - 0.5 * field.width
    turn_above = np.where(np.abs(down_x) > np.abs(down_y), down_x > 0.0, down_y < 0.0)
    return cameras.turned(np.where(is_above, turn_above, np.where(is_behind, x > 0.0, y < 0.0)))


@dataclass(frozen=True, eq=False)
class _Quads:
    """Homographies from the unit square to the quadrilaterals between two pairs of lines.

    Pixels are relative to the principal point, in units of the picture's width.
    """

    h1: Array
    """First column of each homography, (N, 3): the image of the direction of the field's x."""
    h2: Array
    """Second column, (N, 3): the image of the direction of the field's y."""
    h3: Array
    """Third column, (N, 3): the image of the corner (0, 0)."""
    ends: Array
    """Coordinates along the sides of the unit square at which the lines end, (N, 4, 2): for the sides x = 0 and 1, then
    y = 0 and 1; NaN beyond the horizon."""
    c: Array
    """Principal point, (2,) pixels."""
    size: tuple[int, int]

    @classmethod
    def of(cls, lines: LongLines, size: tuple[int, int], c: Array) -> _Quads:
        """Combine all pairs of lines across the field with all pairs along it that have no line in common."""
        line, ends = lines.seen_from(c, float(size[0]))
        pairs = parallel_pairs(line, ends)
        first, second = np.repeat(np.arange(len(pairs)), len(pairs)), np.tile(np.arange(len(pairs)), len(pairs))
        a, b = pairs[first], pairs[second]
        apart = np.all(a[:, :, None] != b[:, None, :], axis=(1, 2))
        a, b = a[apart], b[apart]
        a1, a2, b1, b2 = line[a[:, 0]], line[a[:, 1]], line[b[:, 0]], line[b[:, 1]]
        origin, far = np.cross(a1, b1), np.cross(a2, b2)
        of_x, of_y = np.cross(b1, b2), np.cross(a1, a2)  # vanishing points
        # far = alpha of_x + beta of_y + gamma origin
        alpha = _det(far, of_y, origin)[:, None]
        beta = _det(of_x, far, origin)[:, None]
        gamma = _det(of_x, of_y, far)[:, None]
        h1, h2, h3 = alpha * of_x, beta * of_y, gamma * origin
        with np.errstate(divide="ignore", invalid="ignore"):
            scale = 1.0 / h3[:, 2:]
            h1, h2, h3 = h1 * scale, h2 * scale, h3 * scale
        depth = np.stack([h3[:, 2], h3[:, 2] + h1[:, 2], h3[:, 2] + h2[:, 2], h3[:, 2] + h1[:, 2] + h2[:, 2]])
        good = np.all(depth > 0.0, axis=0) & np.all(np.isfinite(h1) & np.isfinite(h2) & np.isfinite(h3), axis=1)
        corners = np.stack([h3, h3 + h1, h3 + h2, h3 + h1 + h2])[:, good]
        good[good] = np.all(np.abs(corners[..., :2] / corners[..., 2:]) < FARTHEST_CORNER, axis=(0, 2))
        h1, h2, h3, a, b = h1[good], h2[good], h3[good], a[good], b[good]
        # seen from above, y is to the right of x, and so it must be in the picture; else swap the two lines along the
        # field
        (xx, xy), (yx, yy) = (((h3 + h)[:, :2] / (h3 + h)[:, 2:] - h3[:, :2] / h3[:, 2:]).T for h in (h1, h2))
        flip = (xx * yy - xy * yx < 0.0)[:, None]
        h3, h1, h2, b = np.where(flip, h3 + h2, h3), h1, np.where(flip, -h2, h2), np.where(flip, b[:, ::-1], b)
        sides = ((h3, h2, a[:, 0]), (h3 + h1, h2, a[:, 1]), (h3, h1, b[:, 0]), (h3 + h2, h1, b[:, 1]))
        places = np.stack([_places(start, along, ends[own]) for start, along, own in sides], axis=1)
        return cls(h1, h2, h3, np.sort(places, axis=2), c, size)

    def take(self, index: BoolArray | IntArray) -> _Quads:
        """Select quadrilaterals by mask or by index."""
        return replace(self, h1=self.h1[index], h2=self.h2[index], h3=self.h3[index], ends=self.ends[index])

    def are_within(self, x: Array, y: Array, x_reach: Array, y_reach: Array) -> BoolArray:
        """Whether the lines of N quadrilaterals end within the markings of M rectangles, (M, N).

        The two x (2,) and the two y (M, 2) of a rectangle are both in ascending or both in descending order.
        `x_reach` (2, 2) has the least and largest y of the markings at each x, `y_reach` (M, 2, 2) the least and
        largest x of those at each y.
        """
        ends = self.ends if x[1] > x[0] else self.ends[:, :, ::-1]
        first, step = y[:, 0, None, None, None], np.diff(y)[..., None, None]
        of_x, of_y = first + ends[:, :2] * step, x[0] + ends[:, 2:] * (x[1] - x[0])
        return np.asarray(np.all(are_within(of_x, x_reach) & are_within(of_y, y_reach[:, None]), axis=2))

    @property
    def are_rectangles(self) -> BoolArray:
        """Whether the quadrilaterals are nearly rectangles in the picture, (N,)."""
        h1, h2 = (np.linalg.norm(h[:, :2] - self.h3[:, :2] * h[:, 2:], axis=1) for h in (self.h1, self.h2))
        dot = np.sum((self.h1 - self.h3 * self.h1[:, 2:])[:, :2] * (self.h2 - self.h3 * self.h2[:, 2:])[:, :2], axis=1)
        perspective = np.maximum(np.abs(self.h1[:, 2]), np.abs(self.h2[:, 2]))
        return np.asarray((np.abs(dot) < SKEW * h1 * h2) & (perspective < PERSPECTIVE))

    def from_above(self, x: Array, y: Array) -> Cameras:
        """Cameras with a usual focal length if each is the rectangle between two x (N, 2) and two y (N, 2)."""
        h1, h2, h3 = self.homographies(x, y)
        of_x, of_y = (h * (1.0 / FOCAL_LENGTH_ABOVE, 1.0 / FOCAL_LENGTH_ABOVE, 1.0) for h in (h1, h2))
        squares = np.sum(np.square(of_x), axis=1), np.sum(np.square(of_y), axis=1)
        misfit = np.hypot(2.0 * np.sum(of_x * of_y, axis=1), squares[0] - squares[1]) / np.sum(squares, axis=0)
        good = misfit < MISSHAPEN
        f = np.full(np.count_nonzero(good), FOCAL_LENGTH_ABOVE)
        return self._with_focal_lengths(f, np.zeros_like(f), h1[good], h2[good], h3[good])

    def homographies(self, x: Array, y: Array) -> tuple[Array, Array, Array]:
        """Columns of the homographies from metres if each is the rectangle between two x (N, 2) and two y (N, 2)."""
        h1, h2 = self.h1 / np.diff(x), self.h2 / np.diff(y)
        return h1, h2, self.h3 - h1 * x[:, :1] - h2 * y[:, :1]

    def cut_out(self, x: Array, y: Array) -> Cameras:
        """Solve as `cameras` does, but also for the column of the principal point, anywhere near the picture."""
        h1, h2, h3 = self.homographies(x, y)
        # with a free column c of the principal point, Zhang's two equations are linear in c and s = c^2 + f^2:
        # a c + b s = d
        a1, a2 = h1[:, 0] * h2[:, 2] + h1[:, 2] * h2[:, 0], 2.0 * (h1[:, 0] * h1[:, 2] - h2[:, 0] * h2[:, 2])
        b1, b2 = -h1[:, 2] * h2[:, 2], np.square(h2[:, 2]) - np.square(h1[:, 2])
        d1 = np.sum(h1[:, :2] * h2[:, :2], axis=1)
        d2 = np.sum(np.square(h1[:, :2]) - np.square(h2[:, :2]), axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            c, s = (d1 * b2 - d2 * b1) / (a1 * b2 - a2 * b1), (a1 * d2 - a2 * d1) / (a1 * b2 - a2 * b1)
            good = np.flatnonzero((s > np.square(c)) & (np.abs(c) < FARTHEST_CUT))
        c, f = c[good], np.sqrt(s[good] - np.square(c[good]))
        return self._with_focal_lengths(f, c, h1[good], h2[good], h3[good])

    def cameras(self, x: Array, y: Array) -> Cameras:
        """Solve for the cameras if each is the rectangle between two x (N, 2) and two y (N, 2)."""
        h1, h2, h3 = self.homographies(x, y)
        # Zhang's equations A + B f^2 = 0 and D + E f^2 = 0, in least squares; what remains of both must be small
        A, B = 2.0 * np.sum(h1[:, :2] * h2[:, :2], axis=1), 2.0 * h1[:, 2] * h2[:, 2]
        D = np.sum(np.square(h1[:, :2]) - np.square(h2[:, :2]), axis=1)
        E = np.square(h1[:, 2]) - np.square(h2[:, 2])
        with np.errstate(divide="ignore", invalid="ignore"):
            squared = -(A * B + D * E) / (B * B + E * E)
            size = np.sum(np.square(h1[:, :2]) + np.square(h2[:, :2]), axis=1)
            size += squared * (np.square(h1[:, 2]) + np.square(h2[:, 2]))
            misfit = np.hypot(A + squared * B, D + squared * E) / size
            good = np.flatnonzero((squared > 0.0) & (misfit < LARGEST_MISFIT))
        f = np.sqrt(squared[good])
        return self._with_focal_lengths(f, np.zeros_like(f), h1[good], h2[good], h3[good])

    def _with_focal_lengths(self, f: Array, column: Array, h1: Array, h2: Array, h3: Array) -> Cameras:
        """Decompose homographies, given by columns (N, 3), into cameras; keep those above the ground.

        `column` (N,) is that of the principal point relative to `c`, in widths of the picture.
        """
        # noise makes the columns h1 and h2 neither equally long nor perpendicular: the nearest perpendicular unit
        # vectors share the error between both directions of the field
        h1, h2, h3 = (np.column_stack([(h[:, 0] - column * h[:, 2]) / f, h[:, 1] / f, h[:, 2]]) for h in (h1, h2, h3))
        scale = 0.5 * (np.linalg.norm(h1, axis=1) + np.linalg.norm(h2, axis=1))[:, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            t = h3 / scale
        r1, r2 = unit(h1), unit(h2)
        half, rest = np.sqrt(0.5) * unit(r1 + r2), np.sqrt(0.5) * unit(r1 - r2)
        r1, r2 = half + rest, half - rest
        R = np.stack([r1, r2, np.cross(r1, r2)], axis=2)
        C = -np.einsum("nij,ni->nj", R, t)
        c = self.c + np.column_stack([self.size[0] * column, np.zeros_like(column)])
        above = np.all(np.isfinite(C), axis=1) & (C[:, 2] < 0.0)
        return Cameras(f * self.size[0], c, R, C, self.size).take(above)


def _places(start: Array, along: Array, ends: Array) -> Array:
    """Parameters (N, 2) of pixels (N, 2, 2) on lines of homogeneous points ``start + place * along``, (N, 3) each."""
    from_start = start[:, None, :2] - ends * start[:, None, 2:]
    step = along[:, None, :2] - ends * along[:, None, 2:]
    with np.errstate(divide="ignore", invalid="ignore"):
        place = -np.sum(from_start * step, axis=2) / np.sum(step * step, axis=2)
    return np.where(start[:, 2:] + place * along[:, 2:] > 0.0, place, np.nan)


def are_within(ends: Array, reach: Array) -> BoolArray:
    """Whether both ends (..., 2) of lines, in ascending order, lie between the ends `reach` (..., 2) of their markings.

    Lines may be a little longer than the markings.
    """
    over = OVER + OVER_SHARE * (reach[..., 1] - reach[..., 0])
    return np.asarray((ends[..., 0] > reach[..., 0] - over) & (ends[..., 1] < reach[..., 1] + over))


def parallel_pairs(lines: Array, ends: Array) -> IntArray:
    """Pairs of lines (N, 2) that do not cross between their ends: lines that are parallel on the ground do not."""
    first, second = np.triu_indices(len(lines), 1)
    crossing = np.cross(lines[first], lines[second])
    inside = np.zeros(len(first), dtype=bool)
    for index in (first, second):
        start, end = ends[index, 0], ends[index, 1]
        along = end - start
        with np.errstate(divide="ignore", invalid="ignore"):
            place = np.sum((crossing[:, :2] / crossing[:, 2:] - start) * along, axis=1) / np.sum(along * along, axis=1)
        inside |= (place > 0.0) & (place < 1.0)
    return np.column_stack([first, second])[~inside]


def _det(a: Array, b: Array, c: Array) -> Array:
    return np.asarray(np.sum(a * np.cross(b, c), axis=1))


def unit(v: Array) -> Array:
    """Vectors (N, 3) scaled to length 1; NaN for those without a length."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(v / np.linalg.norm(v, axis=1, keepdims=True))
