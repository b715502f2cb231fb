"""Cameras of a court from a picture alone, by search: no network, no labels.

picture, scaled to 1280 columns
  |  stripes, and the long lines on which they lie                    localize/stripes, localize/long_lines
  v
cameras that see four lines of the field in four lines of the picture  images/court_hypotheses
  |  ranked by a likelihood ratio, in three rounds with more points     images/stripe_likelihood
  v
the best different cameras, refined on the picture, lens included      images/refinement
  |  equal ones merged; what each explains of the picture              images/court_evidence
  v
ranked cameras, the first one accepted or not
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fieldcalib._types import Array
from fieldcalib.assess.result import Calibration
from fieldcalib.assess.words import Status
from fieldcalib.fields.field import Field
from fieldcalib.geometry.camera import Camera
from fieldcalib.images.court_evidence import CourtEvidence, Picture
from fieldcalib.images.court_hypotheses import Cameras, hypotheses
from fieldcalib.images.detected_lines import calibrate_on_lines, detected_lines
from fieldcalib.images.field_markings import Markings
from fieldcalib.images.refinement import Refined, ToRefine, refine_all
from fieldcalib.images.stripe_likelihood import MarkingPoints
from fieldcalib.io.image import Image, checked_image, size_of
from fieldcalib.localize.long_lines import long_lines
from fieldcalib.localize.stripes import at_working_size, find_stripes
from fieldcalib.solve.options import ALL, DEFAULT_FLAGS, Prior
from fieldcalib.solve.task import Task

LINES = 16  # long lines from which pairs are taken: 15 do as well as 26
ROUNDS = ((24, 4000), (60, 800), (300, 800))  # points of the field, and cameras that go on to the next round
# Of the principal point, in widths of the picture, where it may be anywhere. Cameras are right within 0.2 widths of it.
OFFSETS = ((-0.3, 0.0), (0.3, 0.0), (0.0, -0.25), (0.0, 0.25), (-0.3, -0.25), (0.3, -0.25), (-0.3, 0.25), (0.3, 0.25))
CUT_OUT = 0.1  # standard deviation of the principal point of stands, in widths of the picture
SURE = 400.0  # score: of 23 rendered views of measured cameras right ones have 394 and more, wrong ones at most 214
REFINED = 4  # cameras that are refined on the picture
APART = 15.0  # px: cameras that project the field nearer than this to each other are refined once
OTHER = 30.0  # px: cameras that are further from one than this are others
SAME = 8.0  # px: refined cameras that are nearer to each other than this are one
BEYOND = 0.1  # share of the picture beyond its border within which the field is compared
NOTHING = (
    Status.TOO_FEW_SEGMENTS,
    "no camera was found by search: two lines across the field and two along it must show, on a lens that hardly bends "
    "them",
)
GRID = 7  # points of the field along and across at which cameras are compared


@dataclass(frozen=True, eq=False)
class FoundCourt:
    """A camera that was found by search, and the evidence for it."""

    calibration: Calibration
    """Its status says whether it is accepted."""
    evidence: CourtEvidence
    twin: Camera | None = None
    """The camera on the other side of the field whose picture is the same; None if the field tells its sides apart."""


def find_courts(image: Image, field: Field, *, flags: int = DEFAULT_FLAGS, prior: Prior = ALL) -> list[FoundCourt]:
    """Search a picture for a field, and rank the cameras that may have taken it.

    Parameters
    ----------
    image : (height, width, 3) uint8 array
        Blue, green, red.
    field : Field
        With markings along and across it: at least two lines of each must show.
    flags, prior
        As in `calibrate_from_segments`, for the refined cameras; the search itself is over cameras with square pixels,
        no lens, and the principal point in the middle.

    Returns
    -------
    list of FoundCourt
        The best one first; empty if no camera explains the lines of the picture. A camera that is not accepted is
        "probably wrong", with the reason in its message.

    Raises
    ------
    ValueError
        If the image is not uint8 or has no three channels, or the field has no stands and no prior is given.

    Examples
    --------
    >>> from fieldcalib import Camera
    >>> from fieldcalib.draw.scene import render_field
    >>> from fieldcalib.fields import tennis
    >>> truth = Camera.from_angles(1.5, 1.3, 0.0, 1400.0, (-32.0, 1.0, -9.0), (960, 540))
    >>> best, *others = find_courts(render_field(truth, tennis()), tennis())
    >>> best.calibration.accepted, round(best.calibration.camera.focal_length, -1)
    (True, 1400.0)
    """
    image = checked_image(image)
    task = Task(field, flags=flags, prior=prior)
    task.options(size_of(image))  # raises what the user did wrong before the search
    return _found(task, field, image)


def search_courts(task: Task, images: Sequence[Image]) -> list[Calibration]:
    """The first camera of each picture by `find_courts`, accepted or not; a ValueError if the object is no field."""
    field = task.field
    if field is None:
        raise ValueError("courts are searched for a Field, whose size is known: without one a network is needed")
    if not task.given.is_empty:
        raise ValueError("of a camera that is searched for nothing may be given: leave it out, or give a network")
    found = (_found(task, field, image) for image in images)
    return [one[0].calibration if one else Calibration.without_camera(*NOTHING) for one in found]


def _found(task: Task, field: Field, image: Image) -> list[FoundCourt]:
    """`find_courts` of a checked picture."""
    small = at_working_size(image)
    size = size_of(small)
    stripes = find_stripes(small, lighter=field.lines.lighter)
    lines = long_lines(stripes, LINES)
    picture = Picture.of(stripes, lines)
    ranked = _ranked(picture, hypotheses(lines, field, size), field)
    if _is_often_cut_out(field) and not _is_sure(ranked):
        others = [_ranked(picture, hypotheses(lines, field, size, offset), field).cameras for offset in OFFSETS]
        ranked = _ranked(picture, Cameras.joined([ranked.cameras, *others]), field)
    started = [ranked.cameras.camera(index).scaled(size_of(image)) for index in _different(ranked.cameras, field)]
    markings = Markings.of(field)
    refined = refine_all(task, markings, [ToRefine(image, _unjudged(camera, field)) for camera in started])
    found = _fitted(task, markings, image, _merged(refined, field))
    evidence = _evidence(picture, ranked, field, found)
    order = sorted(range(len(found)), key=lambda index: -evidence[index].score)
    twins = [_twin(one.calibration.required_camera, field) for one in found]
    return [FoundCourt(_judged(found[k], evidence[k]), evidence[k], twins[k]) for k in order]


@dataclass(frozen=True, eq=False)
class _Ranked:
    """Cameras that were searched, the most likely ones first."""

    cameras: Cameras
    score: Array
    """(B,)."""


def _is_often_cut_out(field: Field) -> bool:
    """Whether pictures of the field are views cut out of larger ones, so that their principal points are anywhere."""
    return max((stand.principal_point for stand in field.stands), default=0.0) > CUT_OUT


def _is_sure(ranked: _Ranked) -> bool:
    """Whether the best camera that was searched is so much likelier than by chance that no others are searched."""
    return bool(np.max(ranked.score, initial=0.0) > SURE)


def _ranked(picture: Picture, cameras: Cameras, field: Field) -> _Ranked:
    """The most likely cameras, the best one first."""
    score = np.zeros(len(cameras))
    for points, kept in ROUNDS:
        score = picture.maps.scores(cameras, MarkingPoints.of(field, points))
        best = np.argsort(-score, kind="stable")[:kept]
        cameras, score = cameras.take(best), score[best]
    return _Ranked(cameras, score)


def _evidence(picture: Picture, ranked: _Ranked, field: Field, refined: Sequence[Refined]) -> list[CourtEvidence]:
    """The evidence for each camera, against the refined ones and those that were searched."""
    points, X = MarkingPoints.of(field, ROUNDS[-1][0]), _grid(field)
    cameras = [one.calibration.required_camera.scaled(picture.stripes.size) for one in refined]
    scores = [picture.maps.score(camera, points) for camera in cameras]
    seen = [camera.project(X) for camera in cameras]
    searched = _projected(ranked.cameras, X)
    found = []
    for index, (camera, (score, weight)) in enumerate(zip(cameras, scores, strict=True)):
        apart = _distances(np.array(seen), seen[index], camera.image_size) > OTHER
        others = [other for (other, _), is_other in zip(scores, apart, strict=True) if is_other]
        others += ranked.score[_distances(searched, seen[index], camera.image_size) > OTHER][:1].tolist()
        explained, count = picture.explained(field, camera)
        runner_up = max(others, default=0.0) / score if score > 0.0 else np.inf
        paint, mean = refined[index].paint_share, score / max(weight, 1.0)
        found.append(CourtEvidence(score, mean, explained, count, max(runner_up, 0.0), paint))
    return found


def _different(cameras: Cameras, field: Field) -> list[int]:
    """The first cameras that project the field differently."""
    xy = _projected(cameras, _grid(field))
    chosen: list[int] = []
    for index in range(len(cameras)):
        if not chosen or np.min(_distances(xy[chosen], xy[index], cameras.size)) > APART:
            chosen.append(index)
            if len(chosen) == REFINED:
                break
    return chosen


def _projected(cameras: Cameras, X: Array) -> Array:
    """Pixels (B, N, 2) of points X (N, 3); NaN behind a camera."""
    with np.errstate(divide="ignore", invalid="ignore"):
        u, v, depth = np.moveaxis(cameras.projections @ np.column_stack([X, np.ones(len(X))]).T, 1, 0)
        return np.asarray(np.where((depth > 0.0)[..., None], np.stack([u, v], axis=-1) / depth[..., None], np.nan))


def _grid(field: Field) -> Array:
    """Points (N, 3) on the ground, all over the field."""
    x, y = (np.linspace(-half, half, GRID) for half in field.half_extent)
    return np.array([(a, b, 0.0) for a in x for b in y])


def _distances(xy: Array, other: Array, size: tuple[int, int]) -> Array:
    """Largest distances (B,) between points that cameras (B, N, 2) and another one (N, 2) project into the picture.

    They are infinite where no point is in the picture, or one of both cameras has it behind itself.
    """
    half = (0.5 + BEYOND) * np.array(size)
    inside = np.all(np.abs(xy - 0.5 * np.array(size)) < half, axis=2)
    inside |= np.all(np.abs(other - 0.5 * np.array(size)) < half, axis=1)
    off = np.linalg.norm(xy - other, axis=2)
    off = np.where(np.isfinite(off), off, np.inf)
    return np.asarray(np.where(np.any(inside, axis=1), np.max(np.where(inside, off, 0.0), axis=1), np.inf))


def _unjudged(camera: Camera, field: Field) -> Calibration:
    """A calibration of a camera that is to be refined."""
    return Calibration(camera, Status.ACCEPTED, "found by search", np.nan, np.nan, {}, field=field)


def _fitted(task: Task, markings: Markings, image: Image, refined: Sequence[Refined]) -> list[Refined]:
    """The cameras, those that refinement left as they were fitted to the lines at their markings.

    A camera without a lens may support the lines so well that no refined one does better, but its errors are not known.
    """
    found = list(refined)
    left = [index for index, one in enumerate(found) if one.calibration.solved is None]
    if left:
        cameras = [found[index].calibration.required_camera for index in left]
        lines = [detected_lines(image, camera, markings)[0] for camera in cameras]
        fitted = calibrate_on_lines(task, lines, size_of(image), cameras)
        for index, calibration in zip(left, fitted, strict=True):
            if calibration.accepted:
                found[index] = replace(found[index], calibration=calibration)
    return found


def _judged(refined: Refined, evidence: CourtEvidence) -> Calibration:
    """The calibration of a refined camera, "probably wrong" without enough evidence."""
    calibration = refined.judged
    if not calibration.accepted or evidence.is_enough:
        return calibration
    doubt = "; ".join((f"found by search, right with a probability of {evidence.probability:.2f}", *evidence.doubts))
    return replace(calibration, status=Status.IMPROBABLE, message=f"{doubt}; {calibration.message}")


def _twin(camera: Camera, field: Field) -> Camera | None:
    """The camera turned by 180 degrees about the centre mark, where the field looks the same from there."""
    if len(field.symmetric) < len(field):
        return None
    turn = np.array([-1.0, -1.0, 1.0])
    return Camera(camera.K, camera.R * turn, camera.C * turn, camera.image_size, camera.dist)


def _merged(refined: Sequence[Refined], field: Field) -> list[Refined]:
    """Of refined cameras that are the same, the best supported one; those that the solver refused are left out."""
    X = _grid(field)
    kept: list[Refined] = []
    seen: list[Array] = []
    for one in sorted(refined, key=lambda one: -one.support):
        if one.calibration.camera is None or not one.calibration.accepted:
            continue
        camera = one.calibration.required_camera
        xy = camera.project(X)
        if not seen or np.min(_distances(np.array(seen), xy, camera.image_size)) > SAME:
            kept.append(one)
            seen.append(xy)
    return kept
