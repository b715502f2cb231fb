"""The likeliest cameras of a field in the long lines of a picture, before they are refined on it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from fieldcalib._types import Array
from fieldcalib.fields.field import Field
from fieldcalib.geometry.camera import Camera
from fieldcalib.images.circle_hypotheses import circle_hypotheses
from fieldcalib.images.court_hypotheses import Cameras, hypotheses, stands
from fieldcalib.images.few_lines import few_line_hypotheses
from fieldcalib.images.pulled_cameras import Freedom, pulled
from fieldcalib.images.stripe_likelihood import MarkingPoints, StripeMaps
from fieldcalib.localize.ellipses import Ellipse
from fieldcalib.localize.long_lines import LongLines
from fieldcalib.localize.straightened import Bend

ROUNDS = ((24, 4000), (60, 800), (300, 800))  # points of the field, and cameras that go on to the next round
PULLED = 100  # of these are pulled onto stripes, at the points of the second round
ROWS = (-0.25, 0.0, 0.25)  # of the principal point, in widths of the picture, where it may be anywhere
CUT_OUT = 0.1  # standard deviation of the principal point of stands, in widths of the picture
SURE = 400.0  # score: of 23 rendered views of measured cameras right ones have 394 and more, wrong ones at most 214

Curves: TypeAlias = tuple[LongLines, Sequence[Ellipse]]  # of a picture


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
    cameras, score = _pulled(maps, _likeliest(maps, Cameras.joined(found), field), field)
    if are_cut_out and bend.a == 0.0 and np.max(score, initial=0.0) < SURE:
        others = [_likeliest(maps, hypotheses(lines, field, maps.size, row), field) for row in ROWS]
        cameras, score = _pulled(maps, _likeliest(maps, Cameras.joined([cameras, *others]), field), field)
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
    return in_order(maps, Cameras.joined([cameras, near]), MarkingPoints.of(field, points), kept)


def in_order(maps: StripeMaps, cameras: Cameras, points: MarkingPoints, kept: int) -> tuple[Cameras, Array]:
    """The most likely cameras, so many, the best one first, and their scores."""
    score = maps.scores(cameras, points)
    best = np.argsort(-score, kind="stable")[:kept]
    return cameras.take(best), score[best]
