"""Where the camera of several pictures stands, which show a court from one tripod.

Frames that were found by themselves vote for the place. Where none was found, every camera that a search of a picture
proposes stands at a place that may be the right one; places are compared by how well views from them explain some of
the pictures together. From there all pictures are searched again, and those that are found vote for the place anew.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fieldcalib._types import Array
from fieldcalib.assess.result import Calibration
from fieldcalib.fields.field import Field
from fieldcalib.fields.sides import MAIN, TURN, Side, side_of
from fieldcalib.geometry.camera import Camera
from fieldcalib.images.court_search import find_courts
from fieldcalib.images.picture_stripes import PictureStripes
from fieldcalib.images.place_search import rank_from, search_from
from fieldcalib.images.twins import CameraSide
from fieldcalib.images.views import Place
from fieldcalib.io.image import Image
from fieldcalib.localize.straightened import Bend
from fieldcalib.localize.stripes import at_working_size
from fieldcalib.solve.centres import voted_centres
from fieldcalib.solve.given_camera import NOTHING_GIVEN
from fieldcalib.solve.options import ALL, DEFAULT_FLAGS, Prior
from fieldcalib.solve.task import Task

MOST = 24  # pictures from which the place is found
SAMPLE = 6  # pictures by which places are compared
PLACES = 12  # places that are compared
NEAR = 0.1  # of the distance from the middle of the field: places that are nearer to each other support each other
FIRST, LAST = 0.06, 0.015  # of that distance: standard deviations of a place before and after the pictures agree on it
ROUNDS = 2  # of searching all pictures and voting for the place
ZOOM = 1.6  # factor by which a picture may be zoomed more or less than those that were found
AGREE = 3  # pictures that were found and agree on a place make it known


def place_of(found: Sequence[Calibration], share: float | None = None) -> Place | None:
    """The place on which most accepted cameras agree; None without any.

    `share` of its distance is its standard deviation; by default less if several cameras agree.
    """
    accepted = [one for one in found if one.accepted and one.knows_errors]
    if not accepted:
        return None
    share = share or (LAST if len(accepted) >= AGREE else FIRST)
    return _place(voted_centres(accepted, 1)[0], share, [one.required_camera for one in accepted])


def _place(C: Array, share: float, cameras: Sequence[Camera]) -> Place:
    zoom = [camera.focal_length / camera.image_size[0] for camera in cameras]
    bend = float(np.median([Bend.of(camera).a for camera in cameras]))
    sigma = np.full(3, share * float(np.linalg.norm(C)))
    return Place(C, sigma, (min(zoom) / ZOOM, max(zoom) * ZOOM), bend)


def pooled_place(
    field: Field, images: Sequence[Image], *, flags: int = DEFAULT_FLAGS, prior: Prior = ALL, side: Side | None = None
) -> Place | None:
    """The place of the one camera that took some pictures; None if too few of them are found from any.

    Parameters
    ----------
    field : Field
        The field that the pictures show.
    images : sequence of (height, width, 3) uint8 arrays
        Blue, green, red; a few of all are enough (`MOST`).
    flags, prior, side
        As in `calibrate_from_images`.

    Raises
    ------
    ValueError
        As `find_courts`.
    """
    on = CameraSide.of(field, NOTHING_GIVEN, flags, prior, side)
    task = Task(field, flags=flags, prior=prior, side=on.side and MAIN)
    images = [images[k] for k in _spread(len(images), MOST)]
    searched = [find_courts(image, field, flags=flags, prior=prior) for image in images]
    found = [one[0].calibration for one in searched if one]
    place = place_of(found, FIRST)
    if place is None:
        proposed = [court.calibration.camera for one in searched for court in one]
        place = _voted(field, images, [camera for camera in proposed if camera is not None])
    for share in np.geomspace(FIRST, LAST, ROUNDS + 1)[1:].tolist():
        if place is None:
            return None
        found = [search_from(task, field, image, place) for image in images]
        place = place_of(found, share)
    agreeing = sum(one.accepted for one in found)
    if place is None or agreeing < min(AGREE, len(images)):
        return None
    is_there = on.side is None or side_of(place.C, field) == on.side
    return place if is_there else replace(place, C=place.C * TURN)


def _voted(field: Field, images: Sequence[Image], cameras: Sequence[Camera]) -> Place | None:
    """The place of one of some proposed cameras from which views explain some pictures best; None if there is none."""
    if not cameras:
        return None
    C = np.array([camera.C for camera in cameras])
    distance = np.linalg.norm(C, axis=1)
    apart = np.linalg.norm(C[:, None] - C, axis=2) / distance[:, None]
    chosen: list[int] = []
    for index in np.argsort(-np.sum(apart < NEAR, axis=1), kind="stable").tolist():
        if not chosen or np.min(apart[index, chosen]) > 0.5 * NEAR:
            chosen.append(index)
    sample = [at_working_size(images[k]) for k in _spread(len(images), SAMPLE)]
    stripes = [PictureStripes.of(image, lighter=field.lines.lighter) for image in sample]
    places = [_place(C[k], FIRST, [cameras[k]]) for k in chosen[:PLACES]]
    scores = [sum(_best_score(one, field, place) for one in stripes) for place in places]
    return places[int(np.argmax(scores))]


def _best_score(stripes: PictureStripes, field: Field, place: Place) -> float:
    return float(np.max(rank_from(place, stripes.with_bend(place.bend), field).score, initial=0.0))


def _spread(count: int, most: int) -> list[int]:
    """Up to so many of the first `count` numbers, evenly spread."""
    return sorted({round(k) for k in np.linspace(0, count - 1, min(count, most)).tolist()})
