"""Likelihood ratio of cameras by the stripes of a picture: explained by projected markings, or by chance.

Each projected point of a marking is compared with the nearest stripe that runs in the direction of the projected
marking, at a distance d. If the camera is right, the paint is seen at a share s of the points, and there d is
half-normal with density N. If it is wrong, d is exponential, with the density rho of such stripes around that place, so
that a stripe in a crowd is no evidence. The sum of the logarithms of

    s N(d) / (2 rho exp(-2 rho d)) + 1 - s

over points in even steps in the picture ranks cameras. Stripes are sorted by direction into `BINS` maps, in which the
ratios are tabulated, so that thousands of cameras are ranked at once. Far lines are thinner than a pixel and seldom
found: s is ``SEEN w / (w + HALF_SEEN)`` where the paint is w pixels wide in the picture. Points lie on paint only, not
in the gaps of a dashed marking.

The same maps serve to improve cameras (`pulled`): for each point of a marking, the likeliest of several places across
its projection is looked up, and the cameras are moved towards these places by a Gauss-Newton step, for all cameras at
once. It is regularised by how far cameras from search are usually off, and repeated in a shrinking band. So hypotheses
from few lines, from lines that a lens has bent, or with a wrong focal length come near enough to be compared, and to be
refined on the picture.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TypeAlias

import numpy as np

from fieldcalib._types import Array, BoolArray, Float32
from fieldcalib.fields.field import Field
from fieldcalib.geometry.camera import Camera
from fieldcalib.geometry.rotation import rotation_from_vector
from fieldcalib.images.paint.line_profiles import Markings
from fieldcalib.images.search.court_hypotheses import Cameras, unit
from fieldcalib.images.search.stripes import Stripes
from fieldcalib.problem.projection import pinhole_derivatives

BINS = 12  # directions, 15 degrees apart
OVERLAP = np.radians(6.0)  # stripes whose direction is within this of a bin belong to it too
CELL = 2  # px: size of a cell of the maps
SIGMA = 4.0  # px: standard deviation of d for right cameras without a lens
# Share of the points of markings in view whose paint is found, by its width in the picture: measured at true cameras of
# 60 synthetic frames of five sports, 0.2 below 0.15 px, 0.57 at 0.4, 0.77 at 0.9, 0.87 at 1.7 and 0.97 from 4.5 px on.
SEEN, HALF_SEEN = 0.8, 0.25  # share found of wide paint, as players hide some; px: width with half of that share
AROUND = 80.0  # px: half the side of the square in which the density of stripes is measured
SPARSEST = 1.0 / 400.0  # stripes per square px, assumed where there are none
FARTHEST = 40.0  # px: upper limit of d
STEP = 12.0  # px along a marking that count as one independent point
MOST = 3.0  # independent points that a single point may count for, where it is near to the camera
AHEAD = 0.02  # m along and across a marking, for its direction and its width in the picture by differences
DOWN = np.array([0.0, 0.0, 1.0])
AT_ONCE = 1024  # cameras whose arrays still fit the processor's cache

Pixels: TypeAlias = Array | Float32

REACHES = (32.0, 20.0, 12.0, 8.0)  # px: half width of the band across each marking, in successive steps
PLACES = 13  # places across the band that are compared
FARTHER = 1.0  # log likelihood ratio by which a place at the border of the band is less likely than one in its middle
LEAST = 0.3  # least log likelihood ratio of a place towards which a camera is moved
OFF = 5.0  # px: standard deviation of these places
TURN, ZOOM = 30.0, 0.1  # prior standard deviations of the rotation, px in the picture, and of log f
UNKNOWNS = 9  # rotation 3, log f 1, position 3, principal point 2
MOST_ZOOM = 0.5  # largest step of log f, as derivatives hold only nearby


@dataclass(frozen=True, eq=False)
class StripeMaps:
    """Tables of the likelihood ratio of a point whose paint is seen, by direction and place."""

    table: Float32
    """Ratios N(d) / (2 rho exp(-2 rho d)), (BINS, h, w), one cell per `CELL` pixels."""
    size: tuple[int, int]
    """Width and height of the picture."""

    @classmethod
    def of(cls, stripes: Stripes, sigma: float = SIGMA) -> StripeMaps:
        """Tabulate the stripes of a picture, for cameras with `sigma` px standard deviation of projected markings."""
        import cv2

        width, height = stripes.size
        w, h = -(-width // CELL), -(-height // CELL)
        column, row = np.clip((stripes.xy / CELL).astype(np.intp), 0, (w - 1, h - 1)).T
        table = np.empty((BINS, h, w), np.float32)
        half = np.pi / BINS / 2.0 + OVERLAP
        around = 2 * round(AROUND / CELL) + 1
        for k in range(BINS):
            turn = stripes.angle - k * np.pi / BINS
            own = np.abs(turn - np.pi * np.round(turn / np.pi)) < half
            empty = np.full((h, w), 255, np.uint8)
            empty[row[own], column[own]] = 0
            count = np.zeros((h, w), np.float32)
            np.add.at(count, (row[own], column[own]), np.float32(1.0))
            distance = np.minimum(cv2.distanceTransform(empty, cv2.DIST_L2, 3), np.float32(FARTHEST / CELL))
            mean = cv2.boxFilter(count, -1, (around, around), borderType=cv2.BORDER_REFLECT)
            table[k] = _ratio(np.float32(CELL) * distance, mean / np.float32(CELL * CELL), sigma)
        return cls(table, stripes.size)

    def scores(self, cameras: Cameras, points: MarkingPoints) -> Array:
        """Log likelihood ratios (B,) of cameras."""
        score = np.zeros(len(cameras))
        P = cameras.projections.astype(np.float32)
        for begin in range(0, len(P), AT_ONCE):
            log, weight = self._looked_up(*projected(P[begin : begin + AT_ONCE], points))
            score[begin : begin + AT_ONCE] = np.sum(log * weight, axis=1)
        return score

    def score(self, camera: Camera, points: MarkingPoints) -> tuple[float, float, float]:
        """Score one camera with its lens.

        Returns its log likelihood ratio, the number of independent points in view, and how many of these are expected
        to be found.
        """
        across = unit(np.cross(points.along, np.where(points.X[:, 2:] == 0.0, DOWN, points.X - camera.C)))
        ways = np.stack([points.along, across])
        xy = camera.project(points.X)
        (dx, dy), (nx, ny) = np.moveaxis(camera.project(points.X + AHEAD * ways) - xy, -1, 1) / AHEAD
        direction, stretch = np.arctan2(dy, dx), np.hypot(dx, dy)
        with np.errstate(divide="ignore", invalid="ignore"):
            seen = np.asarray(np.nan_to_num(_seen(np.abs(dx * ny - dy * nx) / stretch * points.width)), dtype=float)
        x, y = xy.T
        log, weight = self._looked_up(x, y, np.nan_to_num(direction), stretch * points.spacing, seen)
        return float(np.sum(log * weight)), float(np.sum(weight)), float(np.sum(weight * seen))

    def logarithms(self, x: Pixels, y: Pixels, direction: Pixels, seen: Pixels) -> Float32:
        """Log likelihood ratios of points that are seen with probabilities `seen`; 0 outside the picture."""
        inside, (_, height, width) = self._is_inside(x, y), self.table.shape
        column, row = ((np.where(inside, v, 0.0) / CELL).astype(np.int32) for v in (x, y))
        k = np.mod(np.round(direction * (BINS / np.pi)).astype(np.int32), BINS)
        ratio = np.where(inside, self.table.ravel().take((k * height + row) * width + column), np.float32(1.0))
        return np.asarray(np.log1p(seen * (ratio - np.float32(1.0))), np.float32)

    def _is_inside(self, x: Pixels, y: Pixels) -> BoolArray:
        width, height = self.size
        return np.asarray((x >= 0.0) & (y >= 0.0) & (x < width) & (y < height))  # false behind the camera

    def _looked_up(
        self, x: Pixels, y: Pixels, direction: Pixels, step: Pixels, seen: Pixels
    ) -> tuple[Float32, Float32]:
        """Log likelihood ratio of points, and how many independent points each counts for; 0 outside the picture."""
        weight = np.where(self._is_inside(x, y), np.minimum(step / np.float32(STEP), np.float32(MOST)), np.float32(0.0))
        return self.logarithms(x, y, direction, seen), np.asarray(weight, np.float32)


def _seen(width: Pixels) -> Pixels:
    """Share s of points whose paint is found, by its width in the picture, px."""
    return np.asarray(SEEN * width / (width + HALF_SEEN))


def _ratio(distance: Float32, density: Float32, sigma: float) -> Float32:
    """Likelihood ratio of a point that is seen, ``N(d) / (2 rho exp(-2 rho d))`` (see the module)."""
    rate = 2.0 * np.maximum(density, np.float32(SPARSEST))
    exponent = distance * (rate - np.float32(0.5 / sigma**2) * distance)  # 2 rho d - d^2 / (2 sigma^2)
    return np.asarray(np.float32(np.sqrt(2.0 / np.pi) / sigma) * np.exp(exponent) / rate, np.float32)


@dataclass(frozen=True, eq=False)
class MarkingPoints:
    """N points of painted markings on the ground, or of what is above it."""

    X: Array
    """Points, metres, (N, 3)."""
    along: Array
    """Unit vectors along the markings, (N, 3)."""
    spacing: Array
    """Length of paint that each point represents, metres, (N,)."""
    width: Array
    """Width of the paint, metres, (N,)."""

    @staticmethod
    @lru_cache(maxsize=16)
    def of(field: Field, count: int, *, are_above: bool = False) -> MarkingPoints:
        """Sample about `count` points in even steps on the paint of all markings on the ground together.

        `are_above`: on those above the ground, such as posts, nets and backboards.
        """
        markings = Markings.of(field)
        step = _steps(markings)
        own = np.flatnonzero((markings.on_ground != are_above) & ~_is_gap(field, markings, step))
        every = max(np.sum(step[own]) / count, 1e-9)
        cell = np.floor((np.cumsum(step[own]) - 0.5 * step[own]) / every).astype(np.intp)
        chosen, first = np.unique(cell, return_index=True)
        last = np.append(first[1:], len(cell)) - 1
        taken = own[(first + last) // 2]
        spacing = np.asarray(np.bincount(np.searchsorted(chosen, cell), step[own], len(chosen)), dtype=float)
        return MarkingPoints(markings.X[taken], markings.along[taken], spacing, markings.width[taken])


def _is_gap(field: Field, markings: Markings, step: Array) -> BoolArray:
    """Whether each point (N,) lies in a gap of a dashed marking, whose middle is the middle of a dash."""
    is_gap = np.zeros(len(markings.X), dtype=bool)
    for k, label in enumerate(markings.labels):
        dashes, own = field.paint_of(label).dashes, np.flatnonzero(markings.member == k)
        if dashes is not None:
            place = np.cumsum(step[own]) - 0.5 * (np.sum(step[own]) + step[own])
            off = place - sum(dashes) * np.round(place / sum(dashes))
            is_gap[own] = np.abs(off) > 0.5 * dashes[0]
    return is_gap


def _steps(markings: Markings) -> Array:
    """Length of the marking (N,) that each of its points represents."""
    joined = markings.member[1:] == markings.member[:-1]
    gap = np.where(joined, np.linalg.norm(np.diff(markings.X, axis=0), axis=1), 0.0)
    return np.asarray(0.5 * (np.append(gap, 0.0) + np.append(0.0, gap)))


def projected(P: Float32, points: MarkingPoints) -> tuple[Float32, Float32, Float32, Float32, Float32]:
    """Project points of markings by B cameras: pixels x and y, direction and length in the picture, and share seen.

    Each is (B, N); pixels are NaN behind the camera. With H the homography of the ground, areas are scaled by
    ``|det H| / depth^3`` in the picture. Divided by the scale of lengths along the marking, this is the scale of its
    width.
    """
    X = np.vstack([points.X.T, np.ones(len(points.X))]).astype(np.float32)
    u, v, depth = np.moveaxis(P @ X, 1, 0)
    du, dv, ddepth = np.moveaxis(P[:, :, :3] @ points.along.T.astype(np.float32), 1, 0)
    area = np.abs(np.linalg.det(P[:, :, [0, 1, 3]]))[:, None]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        inverse = np.where(depth > 0.0, 1.0 / depth, np.float32(np.nan))
        x, y = u * inverse, v * inverse
        dx, dy = (du - x * ddepth) * inverse, (dv - y * ddepth) * inverse
        stretch = np.hypot(dx, dy)
        seen = _seen(area * (inverse * inverse * inverse) / stretch * points.width.astype(np.float32))
    direction = np.arctan2(dy, dx)
    length = stretch * points.spacing.astype(np.float32)
    direction, seen = (np.asarray(np.where(np.isfinite(one), one, 0.0), np.float32) for one in (direction, seen))
    return x, y, direction, length, seen


@dataclass(frozen=True)
class Freedom:
    """Prior standard deviations of cameras that are pulled onto stripes."""

    principal_point: float
    """Principal point, in widths of the picture."""
    place: float = 0.1
    """Position, in heights of the camera."""


def pulled(cameras: Cameras, maps: StripeMaps, points: MarkingPoints, freedom: Freedom) -> Cameras:
    """Move cameras onto the stripes near their projected markings, in several Gauss-Newton steps."""
    for reach in REACHES if len(cameras) else ():
        cameras = moved(cameras, _step(cameras, maps, points, reach, freedom))
    return cameras


def _step(cameras: Cameras, maps: StripeMaps, points: MarkingPoints, reach: float, freedom: Freedom) -> Array:
    """Gauss-Newton step (B, 9) in the unknowns of `derivatives`, regularised by their prior."""
    x, y, direction, _, seen = (one.astype(float) for one in projected(cameras.projections.astype(np.float32), points))
    nx, ny = -np.sin(direction), np.cos(direction)
    # a marking on its stripe looks the same when shifted along it, so points are compared and moved across it only
    off = np.linspace(-reach, reach, PLACES)
    at = x[..., None] + off * nx[..., None], y[..., None] + off * ny[..., None]
    likely = maps.logarithms(*at, direction[..., None], seen[..., None]) - FARTHER * np.abs(off) / reach
    best = np.argmax(likely, axis=2)
    pulls = np.isfinite(x) & (np.take_along_axis(likely, best[..., None], axis=2)[..., 0] > LEAST)
    weight = np.where(pulls, 1.0 / OFF**2, 0.0)
    J = derivatives(cameras, points.X, np.array([x, y]), np.array([nx, ny]))
    units = _units(cameras, freedom)[..., None]
    J = np.where(pulls[:, None], units * J, 0.0)
    normal = (J * weight[:, None]) @ np.swapaxes(J, 1, 2) + np.eye(UNKNOWNS)
    right = J @ (weight * np.where(pulls, off[best], 0.0))[..., None]
    return np.asarray((units * np.linalg.solve(normal, right))[..., 0])


def derivatives(cameras: Cameras, X: Array, xy: Array, n: Array) -> Array:
    """Derivatives (B, 9, N) of the pixels xy (2, B, N) of points X (N, 3) along directions n (2, B, N) of the picture.

    The unknowns are the rotation of the scene about the axes of each camera, log f, its position and principal point.
    """
    with np.errstate(divide="ignore"):
        inverse_depth = 1.0 / ((X - cameras.C[:, None]) @ cameras.R[:, 2, :, None])[..., 0]
    s, f = xy - cameras.c.T[..., None], cameras.f[:, None]
    turned, placed, zoomed = pinhole_derivatives(s, inverse_depth, n, f, cameras.R)
    return np.concatenate([turned, zoomed[:, None], placed, np.swapaxes(n, 0, 1)], axis=1)


def moved(cameras: Cameras, step: Array) -> Cameras:
    """Apply steps (B, 9) of the unknowns of `derivatives` to cameras."""
    f = cameras.f * np.exp(np.clip(step[:, 3], -MOST_ZOOM, MOST_ZOOM))
    R, C = rotation_from_vector(step[:, :3]) @ cameras.R, cameras.C + step[:, 4:7]
    return replace(cameras, f=f, c=cameras.c + step[:, 7:], R=R, C=C)


def _units(cameras: Cameras, freedom: Freedom) -> Array:
    """Prior standard deviations (B, 9) of the unknowns of cameras from search."""
    turn, place = TURN / cameras.f, freedom.place * np.abs(cameras.C[:, 2])
    zoom, c = np.full_like(turn, ZOOM), np.full_like(turn, freedom.principal_point * cameras.size[0])
    return np.column_stack([turn, turn, turn, zoom, place, place, place, c, c])
