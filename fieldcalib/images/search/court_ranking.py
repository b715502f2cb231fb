"""Ranking of the cameras that a search proposes for a picture, before they are refined on it.

`PictureStripes.ranked` collects the hypotheses from lines and ellipses, scores them by all stripes of the picture, and
keeps the likeliest. Two cameras count as the same if they project a grid of points on the field to nearly the same
pixels; `Rivals` gives the score of the best camera that differs from a given one in this sense.

Some fields look the same some steps further along: yard lines repeat every 5 yards (`Field.repeats`). If neither an end
of the field nor anything else in view tells the yard lines apart, the camera moved along the field by some steps takes
the same picture (`moved_by_steps`), and is no rival.

What is found in a picture is kept (`PictureToSearch`): stripes, lines and ellipses once, ranked cameras once per field.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import islice
from typing import TypeAlias

import numpy as np

from fieldcalib._types import Array, BoolArray, IntArray
from fieldcalib.fields.field import Field
from fieldcalib.geometry.camera import Camera
from fieldcalib.images.search.cameras_from_curves import circle_hypotheses, circles_of, few_line_hypotheses
from fieldcalib.images.search.court_hypotheses import Cameras, are_above, hypotheses, stands
from fieldcalib.images.search.ellipses import Ellipse, find_ellipses
from fieldcalib.images.search.floor import floor_of
from fieldcalib.images.search.long_lines import Bend, LongLines, bend_of, long_lines
from fieldcalib.images.search.stripe_likelihood import Freedom, MarkingPoints, StripeMaps, pulled
from fieldcalib.images.search.stripes import AllStripes, StripeColours, Stripes, at_working_size
from fieldcalib.io.image_files import Image

POINTS = 300  # of the field, at which cameras are compared with stripes in the end
MOST_FURNITURE = 40.0  # upper limit of the log likelihood ratio of what is above the ground
ROUNDS = ((24, 4000), (60, 800), (POINTS, 800))  # points per camera, and number of cameras kept for the next round
PULLED = 100  # best cameras that are pulled onto stripes, with the points of the second round
ROWS = (-0.25, 0.0, 0.25)  # rows tried for a principal point anywhere, in widths of the picture from its middle
CUT_OUT = 0.1  # picture widths: a larger deviation of a stand's principal point means pictures cut out of larger ones
SURE = 400.0  # score: in 23 rendered views of measured cameras right ones have 394 and more, wrong ones at most 214

Curves: TypeAlias = tuple[LongLines, Sequence[Ellipse]]  # long lines and ellipses of a picture

GRID = 7  # points of the field along and across at which cameras are compared
BEYOND = 0.1  # share of the picture beyond its border within which the field is compared
OTHER = 30.0  # px: cameras whose grids differ by more than this in the median are different cameras

MOST_STEPS = 10  # of `Field.repeats` by which a camera is moved: half the length of an American football field
LINES = 16  # long lines used for hypotheses: 15 do as well as 26
ELLIPSES = 6  # ellipses used for hypotheses: on ice there are also ellipses of letters


@dataclass(frozen=True, eq=False)
class Ranked:
    """The B cameras that a search proposes for a picture, the most likely ones first."""

    cameras: Cameras
    """Cameras of the picture without its distortion."""
    score: Array
    """Log likelihood ratio of each camera, (B,)."""
    bend: Bend
    """The distortion of the picture."""
    furniture: Array | None = None
    """Log likelihood ratio of what each camera projects above the ground, (B,), within limits (`counted`); None where
    it does not rank cameras, as in halls with nets and baskets of other courts."""

    def with_furniture(self, maps: StripeMaps, court: Field) -> Ranked:
        """Weigh what is above the ground too, by the stripes of the picture without its distortion.

        Where few lines are in view, it alone tells a near camera from a far one with a longer lens.
        """
        furniture = counted(maps.scores(self.cameras, MarkingPoints.of(court, POINTS, are_above=True)))
        best = np.argsort(-self.score - furniture, kind="stable")
        return Ranked(self.cameras.take(best), self.score[best], self.bend, furniture[best])

    def furniture_of(self, index: int) -> float:
        """The log likelihood ratio of the furniture of the camera at an index; 0 if it does not rank."""
        return 0.0 if self.furniture is None else float(self.furniture[index])

    def camera(self, index: int) -> Camera:
        """The camera at an index, with the lens of the picture."""
        return self.bend.with_lens(self.cameras.camera(index))

    def different(self, court: Field, least: float, apart: float, most: int, *, median: bool) -> list[int]:
        """Indices of the best cameras above a score that project the field over `apart` pixels from all before."""
        xy, likely = self.projected(grid_of(court)), np.flatnonzero(self.score > least).tolist()
        return list(islice(first_apart(xy, likely, self.bend.size, apart, median=median), most))

    def projected(self, X: Array) -> Array:
        """Pixels (B, N, 2) of points X (N, 3) in the picture; NaN behind a camera."""
        with np.errstate(divide="ignore", invalid="ignore"):
            u, v, depth = np.moveaxis(self.cameras.projections @ np.column_stack([X, np.ones(len(X))]).T, 1, 0)
            xy = np.where((depth > 0.0)[..., None], np.stack([u, v], axis=-1) / depth[..., None], np.nan)
        return self.bend.bent(xy)


def counted(furniture: Array | float) -> Array:
    """Limit evidence from what is above the ground: that it is not found is none, as nets and boards may be away."""
    return np.asarray(np.clip(furniture, 0.0, MOST_FURNITURE))


def principal_point(field: Field) -> float:
    """Largest standard deviation of the principal point from the middle, in widths of the picture, of the stands."""
    return max(stand.principal_point for stand in field.stands or field.named_stands.values())


def _likeliest(maps: StripeMaps, cameras: Cameras, field: Field) -> tuple[Cameras, Array]:
    """Select the most likely cameras in rounds, with more points for fewer cameras; the best one first, with scores."""
    for points, kept in ROUNDS:
        cameras, score = in_order(maps, cameras, MarkingPoints.of(field, points), kept)
    return cameras, score


def _ranked(
    maps: StripeMaps, cameras: Cameras, field: Field, are_possible: Callable[[Cameras, Field], BoolArray] = stands
) -> tuple[Cameras, Array]:
    """Select the most likely cameras, and add copies of the best ones, pulled onto stripes.

    Returns all in the order of their scores, and the scores.
    """
    cameras, score = _likeliest(maps, cameras, field)
    few = cameras.take(np.arange(min(PULLED, len(cameras))))
    near = pulled(few, maps, MarkingPoints.of(field, ROUNDS[1][0]), Freedom(principal_point(field)))
    near = near.take(are_possible(near, field))
    points, kept = ROUNDS[-1]
    return in_order(maps, Cameras.joined([cameras, near], maps.size), MarkingPoints.of(field, points), kept, score)


def in_order(
    maps: StripeMaps, cameras: Cameras, points: MarkingPoints, kept: int, known: Sequence[float] | Array = ()
) -> tuple[Cameras, Array]:
    """Score cameras at some points, of the first of which the scores may be known.

    Returns the `kept` best ones, the best one first, and their scores.
    """
    left = cameras.take(np.arange(len(known), len(cameras)))
    score = np.concatenate([known, maps.scores(left, points)])
    best = np.argsort(-score, kind="stable")[:kept]
    return cameras.take(best), score[best]


def grid_of(field: Field) -> Array:
    """Grid of points (N, 3) on the ground, all over the field, at which cameras are compared."""
    x, y = (np.linspace(-half, half, GRID) for half in field.half_extent)
    return np.array([(a, b, 0.0) for a in x for b in y])


def seen_grids(camera: Camera, field: Field) -> list[Array]:
    """Project the field's grid by a camera, and by the cameras that take the same picture some steps further along."""
    return [one.project(grid_of(field)) for one in (camera, *moved_by_steps(camera, field))]


def distances(xy: Array, other: Array, size: tuple[int, int], *, median: bool = False) -> Array:
    """Largest or median distance, for each of B cameras, between its grid `xy` (B, N, 2) and another camera's (N, 2).

    Points count that are in the picture of either camera. The distance is infinite if there are none; so is that of a
    point that is behind one of both cameras.
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
    """Yield the cameras `among` B with grids (B, N, 2) that are over `apart` pixels from all yielded before."""
    chosen: list[int] = []
    for k in among:
        if not chosen or np.min(distances(xy[chosen], xy[k], size, median=median)) > apart:
            chosen.append(k)
            yield k


def are_apart(xy: Array, others: Sequence[Array], size: tuple[int, int]) -> BoolArray:
    """Whether cameras with grids `xy` (B, N, 2) project the field elsewhere than each of some other grids (N, 2)."""
    return np.asarray(np.all([distances(xy, other, size, median=True) > OTHER for other in others], axis=0))


@dataclass(frozen=True, eq=False)
class Rivals:
    """The B ranked cameras of a search, M of which were refined, to find the strongest rival of a camera."""

    xy: Array
    """Grid on the field as each camera projects it, pixels (B, N, 2)."""
    score: Array
    """Score of each camera, (B,)."""
    furniture: Array | None
    """As in `Ranked`."""
    near: Array
    """Whether each camera is near to each of the refined cameras before refinement, (M, B)."""
    ends: list[Array | None]
    """Grid (N, 2) as each of the M cameras projects it after refinement; None if refinement failed."""
    size: tuple[int, int]

    @classmethod
    def of(cls, ranked: Ranked, field: Field, refined: Mapping[int, Camera | None]) -> Rivals:
        """Collect the rivals from a ranked search.

        `refined` maps the index of a camera to its refined camera, or to None if refinement failed.
        """
        size = ranked.bend.size
        xy = ranked.projected(grid_of(field))
        near = np.reshape([distances(xy, xy[k], size, median=True) <= OTHER for k in refined], (len(refined), len(xy)))
        ends = [None if one is None else one.scaled(size).project(grid_of(field)) for one in refined.values()]
        return cls(xy, ranked.score, ranked.furniture, near, ends, size)

    def best_score(self, grids: Sequence[Array], furniture: float = 0.0) -> float:
        """Highest score among the cameras that project the field elsewhere than all `grids` (N, 2).

        Their furniture counts up to that of the camera whose rivals they are: among many, one meets a crowd by chance.

        Cameras near to one that refinement moves onto one of these grids, or for which it fails, do not count.
        """
        are_rivals = are_apart(self.xy, grids, self.size)
        for near, end in zip(self.near, self.ends, strict=True):
            if end is None or not are_apart(end[None], grids, self.size)[0]:
                are_rivals &= ~near
        score = self.score if self.furniture is None else self.score + np.minimum(self.furniture, furniture)
        return float(np.max(score[are_rivals], initial=0.0))

    def runner_up(self, grids: Sequence[Array], score: float, furniture: float) -> float:
        """Best score among the rivals of a camera divided by its own, both with furniture where that ranks cameras."""
        own = 0.0 if self.furniture is None else furniture
        return self.best_score(grids, own) / max(score + own, 1.0)


def moved_by_steps(camera: Camera, field: Field) -> list[Camera]:
    """Move a camera along a field whose markings repeat, by up to `MOST_STEPS` steps either way; [] on other fields.

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
    return [camera.moved(camera.R, camera.C + (x, 0.0, 0.0)) for x in steps]


@dataclass(frozen=True, eq=False)
class PictureToSearch:
    """A picture to be searched for one or more fields; its stripes are found once."""

    image: Image
    """(height, width, 3), blue, green, red."""
    is_smaller: bool = False
    """Whether stripes are found in it at the size of a second look."""
    is_darkest: bool = False
    """Whether stripes are found in the darkest of its channels at each pixel, else in its luma."""
    _again: dict[bool, PictureToSearch] = field(default_factory=dict, repr=False)
    _found: dict[bool | None, AllStripes] = field(default_factory=dict, repr=False)
    _used: dict[tuple[bool | None, bool], PictureStripes] = field(default_factory=dict, repr=False)

    def stripes(self, *, lighter: bool | None, on_floor: bool = False) -> PictureStripes:
        """Stripes of the picture that are lighter than the ground, or darker; None for both, and edges of areas.

        `on_floor`: only those on the floor (`floor_of`), of which more are then used.
        """
        if lighter not in self._found:
            self._found[lighter] = AllStripes.of(self._small, lighter=lighter, darkest=self.is_darkest)
        if (lighter, on_floor) not in self._used:
            bend = next((one.bend for one in self._used.values()), None)  # that of other stripes is the lens's too
            stripes = self._found[lighter].standing_out(self._floor if on_floor else None)
            if on_floor and bend is not None and bend.a != 0.0:
                # lines of a crowd are bent by chance: the many edges of the floor must show that distortion too
                bend = bend_of(stripes, [bend.a]) if lighter is None else self.stripes(lighter=None, on_floor=True).bend
            self._used[lighter, on_floor] = PictureStripes.of(self._small, stripes, bend)
        return self._used[lighter, on_floor]

    @cached_property
    def _small(self) -> Image:
        return at_working_size(self.image, smaller=self.is_smaller)

    def again(self, *, darkest: bool) -> PictureToSearch:
        """The same picture for a second look, in its darkest channels or at another size."""
        return self._again.setdefault(darkest, PictureToSearch(self.image, not darkest, darkest))

    @cached_property
    def _floor(self) -> BoolArray:
        return floor_of(self._small)


@dataclass(frozen=True, eq=False)
class PictureStripes:
    """Stripes of a picture, all or those of one paint, and what follows from them."""

    seen: Stripes
    """Stripes at their pixels in the picture."""
    straight: Stripes
    """Stripes at their pixels in the picture without its distortion."""
    colours: StripeColours
    bend: Bend
    """Distortion of the picture."""
    _ranked: dict[tuple[Field, bool], Ranked] = field(default_factory=dict, repr=False)

    @classmethod
    def of(cls, image: Image, stripes: Stripes, bend: Bend | None = None) -> PictureStripes:
        """Prepare the stripes of an image of the working size; its distortion follows from them unless it is given."""
        bend = bend or bend_of(stripes)
        return cls(stripes, bend.straight(stripes), StripeColours.of(image, stripes), bend)

    def take(self, index: IntArray) -> PictureStripes:
        """Select stripes by index."""
        return PictureStripes(self.seen.take(index), self.straight.take(index), self.colours.take(index), self.bend)

    def with_bend(self, a: float) -> PictureStripes:
        """Assume another distortion of the picture (`Bend.a`)."""
        bend = replace(self.bend, a=a)
        return self if bend == self.bend else replace(self, straight=bend.straight(self.seen), bend=bend, _ranked={})

    @cached_property
    def lines(self) -> LongLines:
        """Long lines of the picture without distortion."""
        return long_lines(self.straight, LINES)

    @cached_property
    def on_lines(self) -> list[BoolArray]:
        """Masks (N,) of the stripes that lie on each long line."""
        return self.lines.holding(self.straight)

    @cached_property
    def ellipses(self) -> tuple[Ellipse, ...]:
        """Ellipses of the picture without distortion."""
        return find_ellipses(self.straight, ELLIPSES)

    @cached_property
    def maps(self) -> StripeMaps:
        """Tables of likelihood ratios in the picture."""
        return StripeMaps.of(self.seen)

    @cached_property
    def straight_maps(self) -> StripeMaps:
        """Tables of likelihood ratios in the picture without distortion."""
        return self.maps if self.bend.a == 0.0 else StripeMaps.of(self.straight)

    def curves(self, court: Field) -> Curves:
        """Long lines, and ellipses if the field has circles; finding ellipses takes 0.1 s."""
        return self.lines, self.ellipses if len(circles_of(court)) else ()

    def _clear(self, court: Field) -> list[Cameras]:
        """Cameras from four lines, and from a circle and a line."""
        lines, ellipses = self.curves(court)
        circles = circle_hypotheses(ellipses, lines, court, self.bend.size, 1.0 + self.bend.a)
        return [hypotheses(lines, court, self.bend.size), circles]

    def ranked_clear(self, court: Field) -> Ranked:
        """Rank as `ranked` does, but without the many cameras that project three lines of the field onto three."""
        return Ranked(
            *_ranked(self.straight_maps, Cameras.joined(self._clear(court), self.maps.size), court), self.bend
        )

    def ranked_from_above(self, court: Field) -> Ranked:
        """Rank the cameras that look down on a field."""
        found = hypotheses(self.lines, court, self.maps.size, from_above=True)
        return Ranked(*_ranked(self.straight_maps, found, court, are_above), self.bend)

    def ranked(self, court: Field, *, may_be_cut_out: bool) -> Ranked:
        """Rank, once, the cameras that explain the long lines and ellipses by how they explain all stripes.

        If none is likely, and the picture `may_be_cut_out` of a larger one, as those of some fields often are,
        principal points outside the middle are tried too: by the field's stands they are anywhere.
        """
        maps, key = self.straight_maps, (court, may_be_cut_out)
        if key not in self._ranked:
            found = [*self._clear(court), few_line_hypotheses(self.lines, court, maps.size, 1.0 + self.bend.a)]
            cameras, score = _ranked(maps, Cameras.joined(found, maps.size), court)
            if may_be_cut_out and principal_point(court) > CUT_OUT and self.bend.a == 0.0 and np.all(score < SURE):
                others = [_likeliest(maps, hypotheses(self.lines, court, maps.size, row), court)[0] for row in ROWS]
                cameras, score = _ranked(maps, Cameras.joined([cameras, *others], maps.size), court)
            self._ranked[key] = Ranked(cameras, score, self.bend)
        return self._ranked[key]

    def ranked_with(self, others: Sequence[Ranked], court: Field) -> Ranked:
        """Rank the cameras for a field, and those that other stripes of the picture proposed.

        The others are first ranked by themselves, so that they do not take the places of these.
        """
        maps, own = self.straight_maps, self.ranked(court, may_be_cut_out=False)
        alike = Cameras.joined([one.cameras for one in others if one.bend == self.bend], maps.size)
        both = Cameras.joined([own.cameras, _ranked(maps, alike, court)[0]], maps.size)
        return Ranked(*_ranked(maps, both, court), self.bend)
