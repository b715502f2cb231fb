"""Which cameras see a field alike, by a grid of points on it, and which of those that were searched are others."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fieldcalib._types import Array, BoolArray
from fieldcalib.fields.field import Field
from fieldcalib.geometry.camera import Camera
from fieldcalib.images.court_ranking import Ranked
from fieldcalib.images.yard_steps import moved_by_steps

GRID = 7  # points of the field along and across at which cameras are compared
BEYOND = 0.1  # share of the picture beyond its border within which the field is compared
OTHER = 20.0  # px: cameras that are further from one than this in the median are others


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
