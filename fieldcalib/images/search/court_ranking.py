"""The likeliest cameras of a field in the long lines of a picture, before they are refined on it.

Which cameras see a field alike, by a grid of points on it, and which of those that were searched are others.

Cameras that take the same picture of a field that looks the same some steps further along.

Yard lines look alike every 5 yards (`Field.repeats`): where neither an end nor anything else in view tells which ones
they are, the camera moved along the field by some steps takes the same picture.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from fieldcalib._types import Array, BoolArray
from fieldcalib.fields.field import Field
from fieldcalib.geometry.camera import Camera
from fieldcalib.images.search.cameras_from_ellipses import circle_hypotheses
from fieldcalib.images.search.cameras_from_lines import few_line_hypotheses
from fieldcalib.images.search.court_hypotheses import Cameras, hypotheses, stands
from fieldcalib.images.search.ellipses import Ellipse
from fieldcalib.images.search.long_lines import LongLines
from fieldcalib.images.search.straightened import Bend
from fieldcalib.images.search.stripe_likelihood import Freedom, MarkingPoints, StripeMaps, pulled

ROUNDS = ((24, 4000), (60, 800), (300, 800))  # points of the field, and cameras that go on to the next round
PULLED = 100  # of these are pulled onto stripes, at the points of the second round
ROWS = (-0.25, 0.0, 0.25)  # of the principal point, in widths of the picture, where it may be anywhere
CUT_OUT = 0.1  # standard deviation of the principal point of stands, in widths of the picture
SURE = 400.0  # score: of 23 rendered views of measured cameras right ones have 394 and more, wrong ones at most 214

Curves: TypeAlias = tuple[LongLines, Sequence[Ellipse]]  # of a picture

GRID = 7  # points of the field along and across at which cameras are compared
BEYOND = 0.1  # share of the picture beyond its border within which the field is compared
OTHER = 20.0  # px: cameras that are further from one than this in the median are others

MOST_STEPS = 10  # by which a camera is moved along the field: half of one of American football


@dataclass(frozen=True, eq=False)
class Ranked:
    """Cameras that were searched, the most likely ones first."""

    cameras: Cameras
    """Of the picture without distortion."""
    score: Array
    """(B,)."""
    bend: Bend
    """The distortion of the picture."""

    @property
    def turned(self) -> Ranked:
        """The same on the other side of the field, turned by 180 degrees about the centre mark."""
        every = np.ones(len(self.score), dtype=bool)
        return replace(self, cameras=self.cameras.turned(every))

    def camera(self, index: int) -> Camera:
        """One of them, with its lens."""
        return self.bend.with_lens(self.cameras.camera(index))

    def projected(self, X: Array) -> Array:
        """Pixels (B, N, 2) of points X (N, 3) in the picture; NaN behind a camera."""
        with np.errstate(divide="ignore", invalid="ignore"):
            u, v, depth = np.moveaxis(self.cameras.projections @ np.column_stack([X, np.ones(len(X))]).T, 1, 0)
            xy = np.where((depth > 0.0)[..., None], np.stack([u, v], axis=-1) / depth[..., None], np.nan)
        return self.bend.bent(xy)


def rank_cameras(curves: Curves, maps: StripeMaps, field: Field, bend: Bend, *, are_cut_out: bool) -> Ranked:
    """Search the cameras that explain the long lines and ellipses of a picture, and rank them by all its stripes.

    Curves and maps are those of the picture without distortion. Where no camera is likely, and pictures `are_cut_out`
    of larger ones, the principal point is looked for elsewhere too.
    """
    lines, ellipses = curves
    widened = 1.0 + bend.a
    found = [hypotheses(lines, field, maps.size), few_line_hypotheses(lines, field, maps.size, widened)]
    found.append(circle_hypotheses(ellipses, lines, field, maps.size, widened))
    cameras, score = _pulled(maps, _likeliest(maps, Cameras.joined(found, maps.size), field), field)
    if are_cut_out and bend.a == 0.0 and np.max(score, initial=0.0) < SURE:
        others = [_likeliest(maps, hypotheses(lines, field, maps.size, row), field) for row in ROWS]
        cameras, score = _pulled(maps, _likeliest(maps, Cameras.joined([cameras, *others], maps.size), field), field)
    return Ranked(cameras, score, bend)


def is_often_cut_out(field: Field) -> bool:
    """Whether pictures of the field are views cut out of larger ones, so that their principal points are anywhere."""
    return principal_point(field) > CUT_OUT


def principal_point(field: Field) -> float:
    """Standard deviation of the principal point from the middle, in widths of the picture."""
    return max(stand.principal_point for stand in field.stands or field.named_stands.values())


def _likeliest(maps: StripeMaps, cameras: Cameras, field: Field) -> Cameras:
    """The most likely cameras, the best one first."""
    for points, kept in ROUNDS:
        cameras, _ = in_order(maps, cameras, MarkingPoints.of(field, points), kept)
    return cameras


def _pulled(maps: StripeMaps, cameras: Cameras, field: Field) -> tuple[Cameras, Array]:
    """The cameras and the best of them pulled onto stripes, in the order of their scores; and these."""
    few = cameras.take(np.arange(min(PULLED, len(cameras))))
    near = pulled(few, maps, MarkingPoints.of(field, ROUNDS[1][0]), Freedom(principal_point(field)))
    near = near.take(stands(near, field))
    points, kept = ROUNDS[-1]
    return in_order(maps, Cameras.joined([cameras, near], maps.size), MarkingPoints.of(field, points), kept)


def in_order(maps: StripeMaps, cameras: Cameras, points: MarkingPoints, kept: int) -> tuple[Cameras, Array]:
    """The most likely cameras, so many, the best one first, and their scores."""
    score = maps.scores(cameras, points)
    best = np.argsort(-score, kind="stable")[:kept]
    return cameras.take(best), score[best]


def grid_of(field: Field) -> Array:
    """Points (N, 3) on the ground, all over the field."""
    x, y = (np.linspace(-half, half, GRID) for half in field.half_extent)
    return np.array([(a, b, 0.0) for a in x for b in y])


def seen_grids(camera: Camera, field: Field) -> list[Array]:
    """The grid (N, 2) as a camera sees it, and as those do that are further along a field whose markings repeat."""
    return [one.project(grid_of(field)) for one in (camera, *moved_by_steps(camera, field))]


def distances(xy: Array, other: Array, size: tuple[int, int], *, median: bool = False) -> Array:
    """Largest or median distances (B,) between points that cameras (B, N, 2) and another one (N, 2) see in the picture.

    They are infinite where no point is in the picture, or one of both cameras has it behind itself.
    """
    half = (0.5 + BEYOND) * np.array(size)
    inside = np.all(np.abs(xy - 0.5 * np.array(size)) < half, axis=2)
    inside |= np.all(np.abs(other - 0.5 * np.array(size)) < half, axis=1)
    off = np.linalg.norm(xy - other, axis=2)
    off = np.where(np.isfinite(off), off, np.inf)
    if median:
        some = np.sort(np.where(inside, off, np.inf), axis=1)
        return np.asarray(some[np.arange(len(some)), np.count_nonzero(inside, axis=1) // 2])
    return np.asarray(np.where(np.any(inside, axis=1), np.max(np.where(inside, off, 0.0), axis=1), np.inf))


def first_apart(xy: Array, among: Sequence[int], size: tuple[int, int], apart: float, *, median: bool) -> Iterator[int]:
    """Those among some cameras (B, N, 2) that are further than `apart` pixels from all before them (`distances`)."""
    chosen: list[int] = []
    for k in among:
        if not chosen or np.min(distances(xy[chosen], xy[k], size, median=median)) > apart:
            chosen.append(k)
            yield k


def are_apart(xy: Array, others: Sequence[Array], size: tuple[int, int]) -> BoolArray:
    """Which cameras (B, N, 2) project the field elsewhere than all others (N, 2)."""
    apart = [distances(xy, other, size, median=True) > OTHER for other in others]
    return np.asarray(np.all(apart, axis=0))


@dataclass(frozen=True, eq=False)
class Rivals:
    """The B cameras of a search, and where refinement took some of them."""

    xy: Array
    """Where they see a grid on the field, pixels (B, N, 2)."""
    score: Array
    """(B,)."""
    near: Array
    """Which of them are near to each of those that were refined, (M, B)."""
    ends: list[Array | None]
    """Where these see the grid (N, 2) after refinement; None where no camera can be that."""
    size: tuple[int, int]

    @classmethod
    def of(cls, ranked: Ranked, field: Field, refined: Mapping[int, Camera | None]) -> Rivals:
        """Those of a search, and what some of them by their indices became by refinement, None if that is no camera."""
        size = ranked.bend.size
        xy = ranked.projected(grid_of(field))
        near = [distances(xy, xy[k], size, median=True) <= OTHER for k in refined]
        ends = [None if one is None else one.scaled(size).project(grid_of(field)) for one in refined.values()]
        return cls(xy, ranked.score, np.array(near, dtype=bool).reshape(len(ends), len(xy)), ends, size)

    def best_score(self, grids: Sequence[Array]) -> float:
        """The highest score of those that see the grid elsewhere than a camera does, in any of some ways (N, 2).

        Those are no rivals that refinement takes to that camera, or to none.
        """
        are_rivals = are_apart(self.xy, grids, self.size)
        for near, end in zip(self.near, self.ends, strict=True):
            if end is None or not are_apart(end[None], grids, self.size)[0]:
                are_rivals &= ~near
        return float(np.max(self.score[are_rivals], initial=0.0))


def moved_by_steps(camera: Camera, field: Field) -> list[Camera]:
    """The camera moved along the field by up to `MOST_STEPS` steps after which its markings look alike; [] without any.

    Examples
    --------
    >>> from fieldcalib.fields import american_football
    >>> camera = Camera.from_angles(0.1, 1.3, 0.0, 1400.0, (5.0, 70.0, -20.0), (960, 540))
    >>> [round(float(one.C[0]), 1) for one in moved_by_steps(camera, american_football("nfl"))][:4]
    [0.4, 9.6, -4.1, 14.1]
    """
    if field.repeats is None:
        return []
    steps = [sign * k * field.repeats for k in range(1, MOST_STEPS + 1) for sign in (-1.0, 1.0)]
    return [Camera(camera.K, camera.R, camera.C + (x, 0.0, 0.0), camera.image_size, camera.dist) for x in steps]
