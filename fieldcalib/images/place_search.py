"""Cameras of a court from a picture, where the place of the camera is known: of a tripod, from its other pictures.

Pan, tilt and focal length are all that is left, and few enough to be tried on a grid; no line has to be found, and arcs
tell as much as lines. The views of the grid are compared with the stripes of the picture by the likelihood ratio of
`fieldcalib.images.stripe_likelihood`, with deviations as large as the grid is coarse; the best different ones are
looked at more closely on two finer grids around them, and the best of these is refined on the picture, with the place
as a prior.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from fieldcalib._types import Array, IntArray
from fieldcalib.assess.result import Calibration
from fieldcalib.assess.words import Status
from fieldcalib.fields.field import Field
from fieldcalib.fields.stands import CameraDistribution
from fieldcalib.images.court_hypotheses import Cameras
from fieldcalib.images.field_markings import Markings
from fieldcalib.images.hidden_markings import with_hidden_markings
from fieldcalib.images.refinement import ToRefine, refine_all
from fieldcalib.images.stripe_likelihood import MarkingPoints, StripeMaps
from fieldcalib.io.image import Image, size_of
from fieldcalib.localize.stripes import Stripes, at_working_size, find_stripes
from fieldcalib.solve.task import Task

# Of the grid: its step, px in a picture of 1280 columns, by which the focal length moves the border of the picture too;
# the deviation of stripes, px; and the points of the field. The finer grids have five steps each way.
STEP, COARSE, POINTS = 18.0, 8.0, (48, 300)
FINER = ((6.0, 6.0), (2.5, 4.0))  # steps and deviations
# Views that are compared at more points, as few of the first may be in view; that go on; that are looked at closely.
MANY, KEPT, CLOSER = 20_000, 2000, 24
APART = 40.0  # px: views that are further from each other than this are different
OTHER = 100.0  # px: views that are further from the best one than this are others
LEAST_SCORE = 100.0  # of an accepted view
SURE_SCORE = 250.0  # of one that tells which markings are hidden
RIVAL = 0.7  # share of the score that another view must not reach
BEYOND = 1.05  # half extents of the field within which the middle of a picture looks
WIDTHS = 1.96  # standard deviations between the mean and the end of a range of a stand
NOTHING = "no view from the place of the camera shows the field's lines"


@dataclass(frozen=True, eq=False)
class Place:
    """Where a camera stands, and how it may be zoomed."""

    C: Array
    """Metres, (3,)."""
    sigma: Array
    """Standard deviations, (3,)."""
    zoom: tuple[float, float]
    """Least and largest focal length, in widths of the picture."""

    def stand(self, field: Field) -> CameraDistribution:
        """The place as a prior: the nearest stand of the field, narrowed to the place."""
        middle = np.array([[sum(stand.x) / 2.0, sum(stand.y) / 2.0, sum(stand.z) / 2.0] for stand in field.stands])
        nearest = field.stands[int(np.argmin(np.linalg.norm(middle - self.C, axis=1)))]
        low, high = (self.C - WIDTHS * self.sigma).tolist(), (self.C + WIDTHS * self.sigma).tolist()
        x, y, z = zip(low, high, strict=True)
        return replace(nearest, name="known place", x=x, y=y, z=z)


@dataclass(frozen=True, eq=False)
class Views:
    """B views from one place: level cameras with square pixels, no lens and the principal point in the middle."""

    pan: Array
    tilt: Array
    f: Array
    """Pixels."""
    C: Array
    size: tuple[int, int]

    def __len__(self) -> int:
        return len(self.f)

    def take(self, index: IntArray) -> Views:
        """Some of them."""
        return Views(self.pan[index], self.tilt[index], self.f[index], self.C, self.size)

    @property
    def cameras(self) -> Cameras:
        """Their cameras."""
        right = np.column_stack([np.cos(self.pan), np.sin(self.pan), np.zeros(len(self))])
        out = np.column_stack([np.sin(self.pan), -np.cos(self.pan), np.zeros(len(self))])
        ahead = np.sin(self.tilt)[:, None] * out + np.cos(self.tilt)[:, None] * (0.0, 0.0, 1.0)
        R = np.stack([right, np.cross(ahead, right), ahead], axis=1)
        c = np.tile(0.5 * np.array(self.size, dtype=float), (len(self), 1))
        return Cameras(self.f, c, R, np.tile(self.C, (len(self), 1)), self.size)

    def apart(self, other: int) -> Array:
        """About how far the views move the picture of one of them, (B,) pixels."""
        f, tilt = self.f[other], self.tilt[other]
        turn = f * np.hypot((self.pan - self.pan[other]) * np.sin(tilt), self.tilt - tilt)
        return np.asarray(turn + 0.5 * self.size[0] * np.abs(np.log(self.f / f)))

    def around(self, step: float) -> Views:
        """Each of them and those around it, 125 together, in steps of so many pixels."""
        turns = np.array(list(product(range(-2, 3), repeat=3)), dtype=float)
        angle = step / self.f[:, None]
        pan = self.pan[:, None] + angle / np.sin(self.tilt[:, None]) * turns[:, 0]
        tilt = self.tilt[:, None] + angle * turns[:, 1]
        f = self.f[:, None] * np.exp(2.0 * step / self.size[0] * turns[:, 2])
        return Views(pan.ravel(), tilt.ravel(), f.ravel(), self.C, self.size)


def views_from(place: Place, field: Field, size: tuple[int, int], step: float = STEP) -> Views:
    """The views from a place of a picture whose middle shows the field, in steps of so many pixels."""
    half, C = BEYOND * field.half_extent, place.C
    across, along = np.meshgrid(np.linspace(-half[0], half[0], 9), np.linspace(-half[1], half[1], 9))
    x, y = across.ravel() - C[0], along.ravel() - C[1]
    middle = np.arctan2(-C[0], C[1])
    pans = np.angle(np.exp(1j * (np.arctan2(x, -y) - middle))) + middle
    tilts = np.arctan2(np.hypot(x, y), -C[2])
    low, high = np.log(np.array(place.zoom) * size[0])
    found = [(np.zeros(0), np.zeros(0), np.zeros(0))]
    for f in np.exp(np.arange(low, high + 1e-9, 2.0 * step / size[0])).tolist():
        for tilt in np.arange(tilts.min(), tilts.max() + step / f, step / f).tolist():
            row = np.arange(pans.min(), pans.max() + step / f, step / f / max(np.sin(tilt), 0.1))
            reach = -C[2] * np.tan(tilt)
            at = np.abs([C[0] + reach * np.sin(row), C[1] - reach * np.cos(row)]).T
            row = row[np.all(at < half, axis=1)]
            found.append((row, np.full(len(row), tilt), np.full(len(row), f)))
    pan, tilts, focal = (np.concatenate(part) for part in zip(*found, strict=True))
    return Views(pan, tilts, focal, C, size)


@dataclass(frozen=True, eq=False)
class Ranked:
    """Views and their scores, the best one first."""

    views: Views
    score: Array


def rank_views(stripes: Stripes, field: Field, views: Views) -> Ranked:
    """Views that explain the stripes of a picture best, by the coarse likelihood."""
    maps = StripeMaps.of(stripes, COARSE)
    for points, kept in zip(POINTS, (MANY, KEPT), strict=True):
        score = maps.scores(views.cameras, MarkingPoints.of(field, points))
        best = np.argsort(-score, kind="stable")[:kept]
        views, score = views.take(best), score[best]
    return Ranked(views, score)


def _looked_at_closely(stripes: Stripes, field: Field, ranked: Ranked) -> Ranked:
    """The best different views, each moved to the best one around it."""
    points, views, score = MarkingPoints.of(field, POINTS[-1]), ranked.views, ranked.score
    views = views.take(_different(views))
    for step, deviation in FINER:
        around = views.around(step)
        scores = StripeMaps.of(stripes, deviation).scores(around.cameras, points).reshape(len(views), -1)
        best = np.argmax(scores, axis=1)
        views, score = around.take(best + scores.shape[1] * np.arange(len(views))), np.max(scores, axis=1, initial=-1e9)
    order = np.argsort(-score[: len(views)], kind="stable")
    return Ranked(views.take(order), score[order])


def _different(views: Views) -> IntArray:
    """The first views that are different from those before them, up to `CLOSER`."""
    left = np.ones(len(views), dtype=bool)
    chosen: list[int] = []
    while len(chosen) < CLOSER and left.any():
        chosen.append(int(np.argmax(left)))
        left &= views.apart(chosen[-1]) > APART
    return np.array(chosen, dtype=np.intp)


def search_from(task: Task, field: Field, image: Image, place: Place) -> Calibration:
    """Search a picture for the view of a field from a known place.

    A camera that is not accepted is "probably wrong", with the reason in its message.
    """
    small = at_working_size(image)
    stripes = find_stripes(small, lighter=field.lines.lighter)
    ranked = rank_views(stripes, field, views_from(place, field, size_of(small)))
    best = _looked_at_closely(stripes, field, ranked)
    if not len(best.views):
        return Calibration.without_camera(Status.TOO_FEW_SEGMENTS, NOTHING)
    camera = best.views.cameras.camera(0).scaled(size_of(image))
    start = Calibration(camera, Status.ACCEPTED, "found by search from a known place", np.nan, np.nan, {}, field=field)
    known = replace(task, prior=(place.stand(field),))
    (refined,) = refine_all(known, Markings.of(field), [ToRefine(image, start)])
    found = refined.judged
    if found.camera is None or not found.accepted:
        return found
    points = MarkingPoints.of(field, POINTS[-1])
    score = StripeMaps.of(stripes).score(found.camera.scaled(size_of(small)), points)[0]
    others = best.score[best.views.apart(0) > OTHER]
    doubts = []
    if found.solved is None:
        doubts.append("its lines do not determine it")
    if score < LEAST_SCORE:
        doubts.append("few of the field's lines show where the camera at the known place would see them")
    if len(others) and others[0] > RIVAL * score:
        doubts.append("another view from that place explains the picture nearly as well")
    if doubts:
        return replace(found, status=Status.IMPROBABLE, message=f"{'; '.join(doubts)}; {found.message}")
    return with_hidden_markings(found) if score >= SURE_SCORE else found
