"""Search for the camera of a court from a picture alone: no network, no labels.

picture, scaled to 1280 columns
  |  stripes; lens distortion, so that stripes lie on straight lines   stripes, long_lines
  |  the longest of these lines, and ellipses                          long_lines, ellipses
  v
hypotheses: cameras that project four lines of the field onto four     court_hypotheses
lines of the picture, or three onto three,                             cameras_from_curves
or a circle onto an ellipse and a line onto a line                     cameras_from_curves
  |  ranked by a likelihood ratio, in three rounds with more points    court_ranking, stripe_likelihood
  |  the best ones pulled onto stripes                                 stripe_likelihood
  v
the best camera, and others that differ if they are promising,         is_promising
refined on the picture, with lens                                      refine_courts
  |  equal ones merged; evidence of the picture for each               here
  |  in halls again for the stripes on the floor alone, for those of each paint, for darker ones, and for both with the
  |  edges of painted areas, until one camera is sure                floor
  |  elsewhere, if none is accepted, for those of a second look at the picture
  v
cameras with their probability of being right, accepted ones and those with the most evidence first

A camera that refinement could not improve is at least fitted to the lines at its markings, so that its errors are known
(`with_errors`).

Markings may be hidden while other lines lie beside them (`with_hidden_markings`): the far side line of a hall is often
hidden by boards, or too thin, and the upper edge of the boards lies beside it. If the size of the court is fixed, a
camera fitted to the other markings determines where the hidden one is, to a few centimetres: a line further away than
that is not its paint. Of 46 cameras that were found by search with markings off their paint and a probability of 0.75
or more, all were right (evidence of `data_tools.score_courts`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from fieldcalib._types import Array, BoolArray
from fieldcalib.assess.findings import Finding, Status, Verdict, What
from fieldcalib.assess.paint_in_view import MarkingInView
from fieldcalib.assess.result import Calibration, doubted, with_findings
from fieldcalib.fields.field import OPPOSITE, Field
from fieldcalib.fields.traits import LAWNS
from fieldcalib.geometry.camera import Camera
from fieldcalib.images.camera_side import twin_of
from fieldcalib.images.paint.detected_lines import calibrate_on_lines, detected_lines
from fieldcalib.images.paint.line_profiles import UPRIGHT, Markings, profiles_along
from fieldcalib.images.refinement import Refined, ToRefine, on_field_as_seen, refine_all
from fieldcalib.images.search.court_hypotheses import Cameras, are_above, stands
from fieldcalib.images.search.court_ranking import (
    GRID,
    MOST_FURNITURE,
    POINTS,
    PictureStripes,
    PictureToSearch,
    Ranked,
    Rivals,
    are_apart,
    counted,
    first_apart,
    grid_of,
    moved_by_steps,
    seen_grids,
)
from fieldcalib.images.search.stripe_likelihood import MarkingPoints, StripeMaps
from fieldcalib.io.image_files import Image, checked_image, size_of
from fieldcalib.solve.request import Task
from fieldcalib.solve.solver_options import ALL, DEFAULT_FLAGS, Prior, pixel_unit

FARTHER = 5.0  # standard deviations of the projected marking, beyond which a line is not its paint
LEAST_OFF = 6.0  # px of a 960 x 540 image: nearer lines may be its paint, as lenses and courts differ from their models
STEP = 0.1  # m across a marking, to measure its scale in the picture

FOUND = Finding(What.SEARCHED)
EXPLAINED = 6.0  # px from a projected marking within which a stripe lies on it
SPACING = 1.0 / 320.0  # distance of the points of markings, in units of the field's diagonal
MARGIN = 0.02  # of the half extent: markings at the border of the field belong to it
# Fitted by `python -m data_tools.score_courts fit` to the cameras found in 443 pictures, in 238 of which one is right:
# frames of clips, rinks, a hall, synthetic frames and rendered views of measured cameras under their own field; courts,
# rinks, a hall, soccer and no field under other fields.
COEFFICIENTS = np.array([-2.28, 2.91, 4.81, -8.63, 2.02, -1.25, -1.65, -4.86, 1.66, -1.02])
# Least probability of an accepted camera. Of 444 pictures, 160 of them under other fields, right cameras of 270 are
# accepted with this threshold and of 264 with 0.65, wrong ones of four with either; further wrong ones have 0.47 at
# most. Of cameras with 0.5 to 0.97 in frames rendered of fields that the fit did not know, 47 of 48 are right.
LEAST_PROBABILITY = 0.55
LEAST_GOOD = 0.65  # of a camera that is good: less probable ones are to be checked
# Seen from above, rectangles of one field look like those of another: in 117 pictures searched for other fields wrong
# cameras have up to 0.92, while right ones have 1.00 in nine drone pictures and 30 rendered ones.
LEAST_PROBABILITY_ABOVE = 0.95
LEAST_SCORE = 250.0  # with a lower score the markings in view must show their paint, as three lines fit many cameras
LEAST_MEAN, LEAST_MISFIT = 0.2, 0.3  # lower limits of the evidence: smaller values carry no more information
# Limits of `CourtEvidence.runner_up`. That there is hardly a rival says little where few cameras are proposed, as for a
# field of four lines; with this lower limit the probabilities of 444 pictures are less surprising by a tenth.
LEAST_RIVAL, MOST_RIVAL = 0.4, 1.3
MOST_OFF = 3  # upper limit of `CourtEvidence.off`
# limits of explained, runner_up, paint, mean and confirmed beyond which they are given as doubts
FEW_EXPLAINED, RIVAL, LITTLE_PAINT, LITTLE, FEW_CONFIRMED = 0.85, 0.9, 0.7, 1.2, 4
FLOORS = ("floor", "wood")  # surfaces of halls, with lines of several sports, some of them darker than the ground
PAINTS = 2  # paints whose stripes are searched alone, if the search among all stripes is not sure
ENOUGH = 0.99  # probability of a camera above which no other stripes are searched
# Logarithm of the odds that a camera leads to a right one if it is refined: constant, and coefficients of the logarithm
# of `CourtEvidence.mean`, of `explained` and of `runner_up`, fitted to 1,525 cameras in 179 pictures. Of each right
# and accepted camera at least one start has -2.5 or more; of those that lead to none, two thirds have less than -3.
PROMISE, LEAST_PROMISE = np.array([-0.13, 4.89, 3.37, -6.03]), -3.0
HOPELESS, REFINED = 60.0, 4  # score up to which cameras are not refined, and how many at most are
# px: of cameras whose projections of the field differ by less only the best is refined; refined ones are the same
APART, SAME = 15.0, 8.0
ABOVE = 0.95  # of the half extent, within which a camera is above the field; a backboard or a goal is further out
SURE = 0.75  # least probability of a camera that is sure enough to decide which markings are hidden
NOTHING = (
    Status.TOO_FEW_SEGMENTS,
    "no camera was found by search: two lines across the field and one along it must show, one across and two along, "
    "or a line and a circle",
    FOUND,
)
# Share of the places along what is above the ground at which lines must be found, if a camera rests on them: 0.25 and
# more for right cameras of rendered nets and goals.
LEAST_SHOWN = 0.2
ALIKE = 0.9  # share of a camera's score, with furniture, that one moved along the field must reach to be an alternative


def with_hidden_markings(calibration: Calibration) -> Calibration:
    """Remove hidden markings from the evidence against a camera that is sure.

    The calibration is returned unchanged if the court may have another size, or the camera's errors are not known.
    """
    field = calibration.field
    if not calibration.accepted or field is None or calibration.solved is None:
        return calibration
    if field.moves_with_size and not field.size_known:
        return calibration
    on_ground = [one for one in calibration.markings if one.label not in Markings.of(field).net]
    hidden = [one for one in on_ground if one.is_unseen or (one.is_beside and _is_other(calibration, one))]
    if not hidden or (len(hidden) > 1 and any(one.is_unseen for one in hidden)):  # bare ground in several places
        return calibration
    names = ", ".join(repr(one.label) for one in hidden)
    return replace(
        calibration,
        markings=tuple(
            replace(one, offset=0.0, is_bent=False, is_expected=False) if one in hidden else one
            for one in calibration.markings
        ),
        message=f"{calibration.message}; hidden or worn: {names}",
    )


def _is_other(calibration: Calibration, marking: MarkingInView) -> bool:
    """Whether the line beside a marking is further from it than the camera's errors allow."""
    assert calibration.field is not None
    camera, markings = calibration.required_camera, Markings.of(calibration.field)
    own = np.flatnonzero(markings.member == markings.labels.index(marking.label))
    X, across = markings.X[own], np.cross(markings.along[own], (0.0, 0.0, 1.0))
    xy = camera.project(X)
    seen = np.all((xy > 0.0) & (xy < camera.image_size), axis=1)  # false behind the camera
    if not np.any(seen):
        return False
    scale = np.linalg.norm(camera.project(X + STEP * across) - xy, axis=1)[seen] / STEP  # px per metre
    error = calibration.errors.on(calibration.field).at_field(X[seen]).rms  # by the lines: paint is what is asked
    return bool(marking.offset - FARTHER * np.median(error * scale) > LEAST_OFF * pixel_unit(camera.image_size))


def refine_courts(task: Task, field: Field, image: Image, cameras: Sequence[Camera]) -> list[Refined]:
    """Refine the cameras that a search proposes on the picture; they may be of any size of it."""
    nothing = Calibration(None, Status.ACCEPTED, str(FOUND), np.nan, np.nan, {}, field=field, _found=(FOUND,))
    started = [replace(nothing, camera=camera.scaled(size_of(image))) for camera in cameras]
    return refine_all(task, Markings.of(field), [ToRefine(image, one) for one in started])


def with_errors(task: Task, field: Field, image: Image, refined: Sequence[Refined]) -> list[Refined]:
    """Fit the cameras that refinement could not improve to the detected lines, so that their errors are known.

    The lines may support a camera without a lens so well that no refined camera does better; its errors are then not
    known from refinement.
    """
    found, markings = list(refined), Markings.of(field)
    left = [k for k, one in enumerate(found) if one.calibration.solved is None and one.calibration.camera is not None]
    if left:
        cameras = [found[k].calibration.required_camera for k in left]
        lines = [detected_lines(image, profiles_along(camera, markings), markings) for camera in cameras]
        fitted = calibrate_on_lines(task, lines, size_of(image), cameras)
        for k, calibration in zip(left, fitted, strict=True):
            if calibration.accepted:
                found[k] = replace(found[k], calibration=calibration)
    return found


@dataclass(frozen=True)
class CourtEvidence:
    """Evidence for a camera from the stripes and the paint in the picture."""

    score: float
    """Log likelihood ratio of the projected markings (`fieldcalib.images.search.stripe_likelihood`)."""
    mean: float
    """The score divided by the number of independent points in view whose paint should be found."""
    explained: float
    """Share of the long stripes on the field, of the colour of the markings, that lie on projected markings, also those
    above the ground. Stripes are weighted by their contrast, since the grain of wood is striped too."""
    runner_up: float
    """Score of the best camera of the search that projects the field elsewhere, divided by this camera's; both with
    their furniture's, but not in halls."""
    paint: float
    """Share of the places along the markings in view that show paint (`fieldcalib.assess.paint_in_view`)."""
    visible: float
    """Share of the points in view whose paint should be found; far lines are too thin."""
    confirmed: int
    """Number of markings that show paint nearly everywhere, at enough places."""
    off: int
    """Number of markings that lie beside their paint, or that show none."""
    misfit: float
    """Root mean square distance of the lines from their markings, pixels of a 960 x 540 image."""
    is_above: bool
    """Whether the camera stands above the field, as few do; false if it was searched for there."""
    furniture: float
    """Log likelihood ratio of what is projected above the ground, as posts, nets, rims and backboards."""
    has_edges: bool
    """Whether the camera was found among edges of areas too, of which pictures are full."""

    @property
    def features(self) -> Array:
        """Features of the logistic model, (10,): 1 and the evidence; mean, confirmed and misfit as logarithms."""
        mean, runner_up = np.log(max(self.mean, LEAST_MEAN)), min(max(self.runner_up, LEAST_RIVAL), MOST_RIVAL)
        confirmed, misfit = np.log1p(self.confirmed), np.log(max(self.misfit, LEAST_MISFIT))
        off, above, edges = min(self.off, MOST_OFF), float(self.is_above), float(self.has_edges)
        furniture = float(counted(self.furniture)) / MOST_FURNITURE
        return np.array([1.0, mean, self.explained, runner_up, confirmed, off, misfit, above, furniture, edges])

    @property
    def odds(self) -> float:
        """Odds that this camera is right, against the case that none of the refined cameras is right."""
        return float(np.exp(self.features @ COEFFICIENTS))

    @property
    def is_enough(self) -> bool:
        """Whether there is enough evidence to trust the probability."""
        return self.score >= LEAST_SCORE or self._paint_shown >= LITTLE_PAINT

    @property
    def doubts(self) -> tuple[str, ...]:
        """Evidence against the camera, in words."""
        found = {
            "few of the field's lines are in view": self.score < LEAST_SCORE or self.confirmed < FEW_CONFIRMED,
            f"only {100.0 * self.explained:.0f} % of the long lines on the field are markings of it": (
                self.explained < FEW_EXPLAINED
            ),
            "another camera explains the picture nearly as well": self.runner_up > RIVAL,
            f"only {100.0 * self.paint:.0f} % of the markings in view show paint": self._paint_shown < LITTLE_PAINT,
            "the picture has few lines where the markings are projected": self.mean < LITTLE,
        }
        return tuple(text for text, is_true in found.items() if is_true)

    @property
    def _paint_shown(self) -> float:
        """Share of the paint that should be found (`visible`) that is found (`paint`), at most 1."""
        return min(self.paint / max(self.visible, self.paint, 1e-9), 1.0)


def probabilities(odds: Array, are_alike: BoolArray) -> Array:
    """Probabilities (N,) of the N cameras found in a picture, if at most one view of the field is right.

    That of a camera is ``sum of the odds of all cameras like it / (1 + sum of all odds)``.

    Parameters
    ----------
    odds : (N,) array
        `CourtEvidence.odds`.
    are_alike : (N, N) array of bool
        Whether two cameras project the field about alike; true on the diagonal.

    Examples
    --------
    >>> probabilities(np.array([8.0, 1.0]), np.eye(2, dtype=bool)).tolist()
    [0.8, 0.1]
    """
    return np.asarray(are_alike @ odds / (1.0 + np.sum(odds)))


def explained(stripes: PictureStripes, field: Field, camera: Camera) -> float:
    """Compute `CourtEvidence.explained` for a camera."""
    from scipy.spatial import cKDTree

    is_long = np.flatnonzero(np.any(stripes.on_lines, axis=0))
    ground = camera.image_to_field(stripes.seen.xy[is_long])[:, :2]
    own = is_long[np.all(np.abs(ground) < field.half_extent * (1.0 + MARGIN), axis=1)]  # without those in the sky
    seen = camera.project(_sampled(field))
    seen = seen[np.all(np.isfinite(seen), axis=1)]
    if not len(own) or not len(seen):
        return 0.0
    # stripes on the projected markings show the colour of the paint; stripes of other colours do not count
    distance, _ = cKDTree(seen).query(stripes.seen.xy[own], distance_upper_bound=EXPLAINED)
    are_explained, colours = np.isfinite(distance), stripes.colours.take(own)
    is_paint = are_explained | (colours.are_like(are_explained) & ~colours.are_edges)
    contrast = np.where(is_paint, stripes.seen.contrast[own], 0.0)
    return float(np.sum(contrast[are_explained]) / np.sum(contrast))


@lru_cache(maxsize=16)
def _sampled(field: Field) -> Array:
    """Points (N, 3) on all markings of a field."""
    spacing = SPACING * float(np.hypot(field.length, field.width))
    return np.concatenate([segment.sample(spacing) for segment in field.markings.values()])


@dataclass(frozen=True, eq=False)
class FoundCourt:
    """A camera that was found by search, and the evidence for it."""

    calibration: Calibration
    """Calibration of the camera; its status says whether it is accepted."""
    evidence: CourtEvidence
    probability: float
    """Probability that the camera is right, given that it was chosen by a search; 0 if its errors are not known."""
    twin: Camera | None = None
    """The camera on the other side of the field that takes the same picture; None if the sides look different."""
    moved: tuple[Camera, ...] = ()
    """Cameras moved along a field whose markings repeat (`Field.repeats`) that explain the picture as well."""


def find_courts(image: Image, field: Field, *, flags: int = DEFAULT_FLAGS, prior: Prior = ALL) -> list[FoundCourt]:
    """Search a picture for a field, and rank the cameras that may have taken it.

    Parameters
    ----------
    image : (height, width, 3) uint8 array
        Blue, green, red.
    field : Field
        The picture must show at least two lines of one direction and one of the other, or a line and a circle. On the
        floor of a hall, lines darker than the floor and edges of painted areas are looked for too; the field of such a
        camera says so. If the size of the field varies (`size_model`) and is not known (`size_known`), it is estimated
        with each camera, where the picture determines it (`Calibration.field`).
    flags, prior
        As in `calibrate_from_segments`, for the refined cameras. The search itself is over cameras with square pixels
        and the principal point in the middle, or elsewhere if the field's stands say that pictures are cut out of
        larger ones.

    Returns
    -------
    list of FoundCourt
        The best one first; empty if no camera explains the lines of the picture. A camera that is not accepted is
        "probably wrong", with the reason in its message.

    Raises
    ------
    ValueError
        If the image is not uint8 or has no three channels, or the field has no lines, or no stands and no prior is
        given.

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
    return [*searches_for(PictureToSearch(checked_image(image)), field, flags=flags, prior=prior)][-1].courts


def searches_for(
    picture: PictureToSearch, field: Field, *, flags: int = DEFAULT_FLAGS, prior: Prior = ALL
) -> Iterator[Searched]:
    """Search a prepared picture for a field, whose stripes are found once for several fields.

    Yields what was found so far after each search, of which `find_courts` makes more until a camera is sure.
    """
    task = Task(field, flags=flags, prior=prior)
    task.options(size_of(picture.image))  # raises what the user did wrong before the search
    _check_searchable(task, field)
    return _searches(task, field, picture, estimate_size=True)


def search_courts(task: Task, images: Sequence[Image], *, estimate_size: bool = False) -> list[Calibration]:
    """Search each picture as `find_courts` does and take the first camera, accepted or not.

    A size that varies is not estimated by default, as pictures of one clip must show one field. A ValueError is raised
    if the object is no field, or anything of the camera is given.
    """
    field = task.field
    if field is None:
        raise ValueError("courts are searched for a Field, whose size is known: without one a network is needed")
    if not task.given.is_empty:
        raise ValueError("of a camera that is searched for nothing may be given: leave it out, or give a network")
    _check_searchable(task, field)
    found = ([*_searches(task, field, PictureToSearch(one), estimate_size=estimate_size)][-1].courts for one in images)
    return [one[0].calibration if one else Calibration.without_camera(*NOTHING) for one in found]


def _check_searchable(task: Task, field: Field) -> None:
    if not field.markings:
        raise ValueError("the field has no lines to search for: label its points")
    if not field.stands and task.prior == ALL:
        raise ValueError("the field has no `stands`, where cameras are searched for: add them, or label the pictures")


@dataclass(frozen=True, eq=False)
class _Candidate:
    """A refined camera with its evidence, and the stripes among which it was found."""

    refined: Refined
    evidence: CourtEvidence
    stripes: PictureStripes
    from_above: bool = False
    """Whether it was searched for among cameras that look down on the field."""


@dataclass(frozen=True, eq=False)
class Searched:
    """What the searches of a picture have found so far."""

    candidates: Sequence[_Candidate] = ()
    probability: Sequence[float] = ()
    """Of each candidate to be right."""

    @cached_property
    def courts(self) -> list[FoundCourt]:
        """All candidates judged, accepted ones and those with the most evidence first.

        Cameras that are alike share a probability, which says of none of them how well it lies on its paint.
        """
        each = [_court(*one, self.candidates) for one in zip(self.candidates, self.probability, strict=True)]
        return sorted(each, key=lambda one: (not one.calibration.accepted, -np.nan_to_num(one.evidence.odds)))


def _searches(task: Task, field: Field, picture: PictureToSearch, *, estimate_size: bool) -> Iterator[Searched]:
    """Search until a camera is sure."""
    sized = estimate_size and field.moves_with_size and not field.size_known
    searched = Searched()
    for views in (_candidates, _candidates_again, _candidates_from_above):
        if any(one.calibration.accepted for one in searched.courts):
            return
        for found in views(task, field, picture, sized=sized):
            every = [*searched.candidates, *found]
            odds = [0.0 if one.refined.calibration.solved is None else one.evidence.odds for one in every]
            probability = probabilities(np.array(odds), _are_alike(every)).tolist()
            searched = Searched(every, probability)
            yield searched
            if any(p >= ENOUGH and one.refined.judged.accepted for p, one in zip(probability, every, strict=True)):
                break


def _candidates(task: Task, field: Field, picture: PictureToSearch, *, sized: bool) -> Iterator[list[_Candidate]]:
    """Yield the candidates from all stripes; in halls then from the floor's, each paint's, darker ones, and edges."""
    before = list[Ranked]()

    def search(stripes: PictureStripes, court: Field = field) -> list[_Candidate]:
        own, is_own = replace(task, object_segments=court), court.lines.lighter == field.lines.lighter
        among_all = court.lines.lighter is None  # where what some of them propose is weighed again
        ranked = stripes.ranked_with(before, court) if among_all else stripes.ranked(court, may_be_cut_out=is_own)
        before.append(ranked)
        return _of_ranked(own, picture, stripes, ranked, sized=sized, from_above=False)

    stripes = picture.stripes(lighter=field.lines.lighter)
    yield search(stripes)
    if stripes.bend.a != 0.0:
        yield search(stripes.with_bend(0.0))  # what seems to be a line that a lens has bent may be an arc of a circle
    in_hall = (field.lines.lighter, not field.lines.lighter, None) if field.surface in FLOORS else ()
    for lighter in dict.fromkeys(in_hall):
        court = replace(field, lines=replace(field.lines, lighter=lighter))
        stripes = picture.stripes(lighter=lighter, on_floor=True)
        yield search(stripes, court)
        if lighter is not None:
            for paint in stripes.colours.paints(stripes.on_lines)[:PAINTS]:
                yield search(stripes.take(np.flatnonzero(paint)), court)


def _candidates_again(task: Task, field: Field, picture: PictureToSearch, *, sized: bool) -> Iterator[list[_Candidate]]:
    """Yield the candidates of a second look at the picture, where a camera explains some of its lines; not in halls.

    On grass it is at the darkest channel of each pixel, in which white paint has the most contrast. Elsewhere it is at
    another size: which lines and arcs are found changes with it, as with a row of the picture more or less.
    """
    lighter, seen = field.lines.lighter, picture.again(darkest=field.surface in LAWNS)
    ranked = picture.stripes(lighter=lighter).ranked(field, may_be_cut_out=True)
    if field.surface not in FLOORS and np.max(ranked.score, initial=0.0) > HOPELESS:
        stripes = seen.stripes(lighter=lighter)
        yield _of_ranked(task, seen, stripes, stripes.ranked(field, may_be_cut_out=True), sized=sized, from_above=False)


def _candidates_from_above(
    task: Task, field: Field, picture: PictureToSearch, *, sized: bool
) -> Iterator[list[_Candidate]]:
    """Yield the candidates that look down on the field, if cameras may stand anywhere."""
    if task.prior == ALL:
        stripes = picture.stripes(lighter=field.lines.lighter)
        yield _of_ranked(task, picture, stripes, stripes.ranked_from_above(field), sized=sized, from_above=True)


def _of_ranked(
    task: Task, picture: PictureToSearch, stripes: PictureStripes, ranked: Ranked, *, sized: bool, from_above: bool
) -> list[_Candidate]:
    """Refine the best different cameras of a ranked search, and weigh the evidence.

    `sized`: also estimate the size of the field.
    """
    field, image = task.field, picture.image
    assert field is not None
    if task.side == OPPOSITE:
        ranked = replace(ranked, cameras=ranked.cameras.turned(np.ones(len(ranked.score), dtype=bool)))
    above = picture.stripes(lighter=True)
    if field.surface not in FLOORS:
        ranked = ranked.with_furniture(above.with_bend(ranked.bend.a).straight_maps, field)
    rivals = Rivals.of(ranked, field, {})
    started = [
        k
        for place, k in enumerate(ranked.different(field, HOPELESS, APART, REFINED, median=False))
        if place == 0 or is_promising(stripes, rivals, field, ranked.camera(k), ranked.furniture_of(k))
    ]
    are_possible = are_above if from_above else stands
    refined = [
        _if_possible(one, field, are_possible)
        for one in refine_courts(task, field, image, [ranked.camera(k) for k in started])
    ]
    ends = [None if one is None else one.calibration.camera for one in refined]
    rivals = Rivals.of(ranked, field, dict(zip(started, ends, strict=True)))
    fitted = with_errors(task, field, image, _merged([one for one in refined if one is not None], field))
    checked = [_without_unseen(task, one) for one in fitted]
    found = [one for one in checked if _if_possible(one, field, are_possible)]  # the fit may have moved it elsewhere
    if sized:
        found = [on_field_as_seen(task, image, one.calibration) or one for one in found]
    evidence = [_evidence(stripes, above.maps, rivals, one, from_above) for one in found]
    return [_Candidate(*one, stripes, from_above) for one in zip(found, evidence, strict=True)]


def _without_unseen(task: Task, refined: Refined) -> Refined:
    """Leave out what is above the ground where a camera rests on it, but it hardly shows.

    The few lines near a net that shows nowhere else belong to something else. A lone post may be the goal's other one.
    """
    calibration, markings = refined.calibration, Markings.of(task.object_segments)
    is_upright = np.abs(markings.along[:, 2]) > UPRIGHT
    above, upright = ({markings.labels[k] for k in markings.member[some]} for some in (~markings.on_ground, is_upright))
    found = above & calibration.pixel_counts.keys()
    if calibration.solved is None or not found:
        return refined
    pixels, camera = calibration.solved.pixels, calibration.required_camera
    places = np.count_nonzero(~profiles_along(camera, markings).on_ground)
    is_shown = sum(calibration.pixel_counts[one] for one in found) >= LEAST_SHOWN * places
    if is_shown and (len(found) > 1 or not found <= upright):
        return refined
    (again,) = calibrate_on_lines(task, [pixels.of_labels(set(pixels.labels) - found)], camera.image_size, [camera])
    return replace(refined, calibration=again) if doubted(again, 0.5) is not again else refined


def _court(candidate: _Candidate, probability: float, every: Sequence[_Candidate]) -> FoundCourt:
    """Judge a candidate, and add the other cameras that take the same picture."""
    refined, evidence = candidate.refined, candidate.evidence
    least = LEAST_PROBABILITY_ABOVE if candidate.from_above else LEAST_PROBABILITY
    calibration = _judged(refined, evidence, probability, least)
    camera, field = refined.calibration.required_camera, _field_of(refined)
    cameras = [one.refined.calibration.required_camera for one in every if one.refined.calibration.solved is not None]
    moved = _further_along(camera, field, candidate.stripes.maps, cameras)
    if moved and field.repeats is not None:
        repeats = Finding(What.REPEATS, numbers=(field.repeats,))
        calibration = with_findings(replace(calibration, alternatives=moved), repeats)
    return FoundCourt(calibration, evidence, probability, twin_of(camera, field), moved)


def _further_along(camera: Camera, field: Field, maps: StripeMaps, every: Sequence[Camera]) -> tuple[Camera, ...]:
    """Cameras some steps further along a field whose markings repeat that explain the picture, goals too, as well.

    Where one of `every` camera was refined there, it is given too: the moved one has the lens and zoom of here.
    """
    points = [MarkingPoints.of(field, POINTS, are_above=are_above) for are_above in (False, True)]

    def likelihood(one: Camera) -> float:
        ground, furniture = (maps.score(one.scaled(maps.size), some)[0] for some in points)
        return ground + float(counted(furniture))

    likely, seen = list[Camera](), [one.scaled(maps.size).project(grid_of(field)) for one in every]
    for there in moved_by_steps(camera, field):
        apart = are_apart(
            np.reshape(seen, (len(seen), GRID * GRID, 2)), [there.scaled(maps.size).project(grid_of(field))], maps.size
        )
        near = [one for one, away in zip(every, apart, strict=True) if not away and one is not camera]
        likely += [one for one in (there, *near) if likelihood(one) >= ALIKE * likelihood(camera)]
    return tuple(likely)


def _field_of(refined: Refined) -> Field:
    """Field of a refined camera, in the size that was estimated with it."""
    assert refined.calibration.field is not None
    return refined.calibration.field


def is_promising(stripes: PictureStripes, rivals: Rivals, field: Field, camera: Camera, furniture: float = 0.0) -> bool:
    """Whether a camera before refinement may lead to a right one; `furniture` as in `Ranked`."""
    score, _, shown = stripes.maps.score(camera, MarkingPoints.of(field, POINTS))
    mean = np.log(max(score / max(shown, 1.0), LEAST_MEAN))
    runner_up = min(rivals.runner_up(seen_grids(camera, field), score, furniture), MOST_RIVAL)
    most = PROMISE @ (1.0, mean, 1.0, runner_up) - LEAST_PROMISE  # if all stripes are explained
    return bool(most >= 0.0 and most >= PROMISE[2] * (1.0 - explained(stripes, field, camera)))


def _evidence(stripes: PictureStripes, off: StripeMaps, rivals: Rivals, refined: Refined, above: bool) -> CourtEvidence:
    """Collect the evidence for a camera, and against it from its rivals; `off` has stripes off the floor too.

    `above`: whether it was searched for above the field.
    """
    field, size = _field_of(refined), stripes.maps.size
    camera = refined.calibration.required_camera.scaled(size)
    score, weight, shown = stripes.maps.score(camera, MarkingPoints.of(field, POINTS))
    markings = () if refined.paint is None else refined.paint.markings
    furniture = off.score(camera, MarkingPoints.of(field, POINTS, are_above=True))[0]
    return CourtEvidence(
        score=score,
        mean=score / max(shown, 1.0),
        explained=explained(stripes, field, camera),
        runner_up=rivals.runner_up(seen_grids(camera, field), score, float(counted(furniture))),
        paint=refined.paint_share,
        visible=shown / max(weight, 1.0),
        confirmed=sum(one.is_confirmed for one in markings),
        off=sum(one.is_off for one in markings),
        misfit=float(refined.calibration.rms / pixel_unit(refined.calibration.required_camera.image_size)),
        is_above=not above and bool(np.all(np.abs(camera.C[:2]) < ABOVE * np.array(field.half_extent))),
        furniture=furniture,
        has_edges=field.lines.lighter is None,
    )


def _are_alike(candidates: Sequence[_Candidate]) -> BoolArray:
    """Whether any two of N cameras project the field about alike, (N, N)."""
    size = candidates[0].stripes.maps.size if candidates else (0, 0)
    cameras = [one.refined.calibration.required_camera.scaled(size) for one in candidates]
    grids = [seen_grids(camera, _field_of(one.refined)) for camera, one in zip(cameras, candidates, strict=True)]
    seen = np.array([one[0] for one in grids]).reshape(len(grids), GRID * GRID, 2)
    alike = [~are_apart(seen, own, size) for own in grids]
    return np.array(alike, dtype=bool).reshape(len(grids), len(grids))


def _judged(refined: Refined, evidence: CourtEvidence, probability: float, least: float) -> Calibration:
    """Judge a refined camera: its calibration is "probably wrong" without enough evidence."""
    calibration = refined.judged
    if not calibration.accepted or (probability >= least and evidence.is_enough):
        if calibration.verdict is Verdict.GOOD and probability < LEAST_GOOD:
            unsure = Finding(What.IMPROBABLE, numbers=(_field_of(refined).tolerance, probability))
            return with_findings(calibration, unsure)
        return with_hidden_markings(calibration) if probability >= SURE else calibration
    doubts = evidence.doubts if calibration.solved is not None else ("the lines near its markings do not determine it",)
    doubt = "; ".join((f"{FOUND}, right with a probability of {probability:.2f}", *doubts))
    said = replace(calibration, status=Status.IMPROBABLE, message=f"{doubt}; {calibration.message}")
    return said if said.has_finding(What.SEARCHED) else with_findings(said, FOUND)


def _if_possible(refined: Refined, field: Field, are_possible: Callable[[Cameras, Field], BoolArray]) -> Refined | None:
    """Pass a refined camera on; None if it is not accepted, or stands where no camera of the field does.

    This excludes cameras at the height of the ground, which see the whole field in one line and so fit any line.
    """
    if (camera := refined.calibration.camera) is None or not refined.calibration.accepted:
        return None
    return refined if are_possible(Cameras.of([camera], camera.image_size), field)[0] else None


def _merged(refined: Sequence[Refined], field: Field) -> list[Refined]:
    """Merge refined cameras that are the same: the one with the highest line support is kept."""
    best = sorted(refined, key=lambda one: -one.support)
    cameras = [one.calibration.required_camera for one in best]
    xy = np.array([camera.project(grid_of(field)) for camera in cameras])
    size = cameras[0].image_size if cameras else (0, 0)
    return [best[k] for k in first_apart(xy, range(len(best)), size, SAME, median=False)]
