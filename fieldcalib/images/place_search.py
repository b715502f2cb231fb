"""Cameras of a court from a picture, where the place of the camera is known: of a tripod, from its other pictures.

Views through the lines and ellipses of the picture (`fieldcalib.images.view_hypotheses`) are compared with its stripes
by the likelihood ratio of `fieldcalib.images.stripe_likelihood`, with larger deviations than are expected of cameras
as place and bend are only known roughly. The best different ones are pulled onto the stripes; the best of these is
refined on the picture, with the place as a prior.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import islice

import numpy as np

from fieldcalib.assess.result import Calibration
from fieldcalib.assess.words import Status
from fieldcalib.fields.field import Field
from fieldcalib.images.court_hypotheses import Cameras
from fieldcalib.images.court_ranking import Ranked, in_order, principal_point
from fieldcalib.images.court_refinement import refine_courts, with_errors
from fieldcalib.images.court_rivals import distances, first_apart, grid_of
from fieldcalib.images.hidden_markings import with_hidden_markings
from fieldcalib.images.picture_stripes import PictureStripes
from fieldcalib.images.pulled_cameras import Freedom, pulled
from fieldcalib.images.stripe_likelihood import MarkingPoints, StripeMaps
from fieldcalib.images.view_hypotheses import views_through
from fieldcalib.images.views import Place, Views
from fieldcalib.io.image import Image, size_of
from fieldcalib.localize.straightened import Bend
from fieldcalib.localize.stripes import at_working_size
from fieldcalib.solve.task import Task

COARSE = 8.0  # px: deviation of stripes from views
POINTS, PULLING = 300, 60  # of the field, by which views are compared and pulled
KEPT, PULLED = 2000, 40  # the likeliest views, of which different ones are pulled
APART = 40.0  # px: views that are further from each other than this are different
OTHER = 100.0  # px: cameras that are further from the best one than this in the median are others
LEAST_SCORE = 60.0  # of an accepted camera: views of pictures without the field had 50 at most
SURE_SCORE = 250.0  # of one that tells which markings are hidden
REFINED = 3  # cameras that are refined on the picture
RIVAL = 0.7  # share of the score that another camera must not reach
NOTHING = "no view from the place of the camera shows the field's lines"


def rank_from(place: Place, stripes: PictureStripes, field: Field) -> Ranked:
    """The cameras about at a place that explain the stripes of a picture best."""
    views = views_through(stripes.curves(field), place, field, stripes.bend.size)
    points, maps = MarkingPoints.of(field, POINTS), stripes.straight_maps
    score = StripeMaps.of(stripes.straight, COARSE).scores(views.cameras, points)
    few = _different(views.take(np.argsort(-score, kind="stable")[:KEPT])).cameras
    freedom = Freedom(principal_point(field), float(np.max(place.sigma) / -place.C[2]))
    near = pulled(few, maps, MarkingPoints.of(field, PULLING), freedom)
    return Ranked(*in_order(maps, Cameras.joined([few, near]), points, KEPT), stripes.bend)


def _different(views: Views) -> Views:
    """The first views that are different from those before them."""
    left = np.ones(len(views), dtype=bool)
    chosen: list[int] = []
    while len(chosen) < PULLED and left.any():
        chosen.append(int(np.argmax(left)))
        left &= views.apart(chosen[-1]) > APART
    return views.take(np.array(chosen, dtype=np.intp))


def search_from(task: Task, field: Field, image: Image, place: Place) -> Calibration:
    """Search a picture for the view of a field from a known place.

    A camera that is not accepted is "probably wrong", with the reason in its message.
    """
    small = at_working_size(image)
    stripes = PictureStripes.of(small, lighter=field.lines.lighter, bend=Bend(place.bend, size_of(small)))
    ranked = rank_from(place, stripes, field)
    if not len(ranked.cameras):
        return Calibration.without_camera(Status.TOO_FEW_SEGMENTS, NOTHING)
    known = replace(task, prior=(place.stand(field),))
    cameras = [ranked.camera(k) for k in _to_refine(ranked, field)]
    refined = with_errors(known, field, image, refine_courts(known, field, image, cameras))
    found = [one.judged for one in refined]
    accepted = [one for one in found if one.accepted]
    at_place = [one for one in accepted if place.is_near(one.required_camera)]
    return _best(at_place or accepted, stripes.maps, field) if accepted else found[0]


def _to_refine(ranked: Ranked, field: Field) -> list[int]:
    """The first camera, and others that explain the picture nearly as well."""
    xy, near = ranked.projected(grid_of(field)), np.flatnonzero(ranked.score > RIVAL * ranked.score[0]).tolist()
    return list(islice(first_apart(xy, [0, *near], ranked.bend.size, OTHER, median=True), REFINED))


def _best(found: Sequence[Calibration], maps: StripeMaps, field: Field) -> Calibration:
    """The best of accepted cameras, "probably wrong" if little speaks for it, or as much for another one."""
    cameras = [one.required_camera.scaled(maps.size) for one in found]
    score = np.array([maps.score(camera, MarkingPoints.of(field, POINTS))[0] for camera in cameras])
    first = int(np.argmax(score))
    best = found[first]
    xy = np.array([camera.project(grid_of(field)) for camera in cameras])
    others = distances(xy, xy[first], maps.size, median=True) > OTHER
    doubts = []
    if best.solved is None:
        doubts.append("its lines do not determine it")
    if score[first] < LEAST_SCORE:
        doubts.append("few of the field's lines show where the camera at the known place would see them")
    if np.max(score[others], initial=0.0) > RIVAL * score[first]:
        doubts.append("another view from that place explains the picture nearly as well")
    if doubts:
        return replace(best, status=Status.IMPROBABLE, message=f"{'; '.join(doubts)}; {best.message}")
    return with_hidden_markings(best) if score[first] >= SURE_SCORE else best
