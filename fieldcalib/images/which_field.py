"""Recognition of the field that pictures show: every field is tried, and the best one must win by a margin."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fieldcalib.fields.catalogue import COMPARED
from fieldcalib.fields.catalogue import field as field_named
from fieldcalib.fields.field import Field
from fieldcalib.geometry.camera import Camera
from fieldcalib.images.from_images import calibrate_from_images
from fieldcalib.images.search.court_ranking import PictureToSearch
from fieldcalib.images.search.court_search import courts_in
from fieldcalib.images.search.stripe_likelihood import MarkingPoints
from fieldcalib.io.image_files import Image
from fieldcalib.localize import Network
from fieldcalib.localize.point_selection import classes_without_segment

POINTS = 300  # of a field's markings, at which a camera from the network is compared with the stripes in the picture
MARGIN = 0.8  # of the best score: a field that reaches it explains the pictures about as well
LIKELY = 0.4  # of the best score before refinement: fields below are not searched for
PROMISING = 0.5  # of the best score in the first picture: fields below are not searched for in further pictures
NOTHING = "no field was found: name it"


@dataclass(frozen=True)
class WhichField:
    """The field that pictures show, or the fields that explain them about equally well."""

    scores: Mapping[str, float]
    """Log likelihood ratios of the accepted cameras by name of the field, best first; 0 without an accepted camera."""

    @property
    def alternatives(self) -> tuple[str, ...]:
        """Names of the best field and of those that explain the pictures about as well; () if no field was found."""
        best = max(self.scores.values(), default=0.0)
        return tuple(name for name, score in self.scores.items() if score > 0.0 and score >= MARGIN * best)

    @property
    def name(self) -> str | None:
        """Name of the field; None if none was found, or if several explain the pictures."""
        return self.alternatives[0] if len(self.alternatives) == 1 else None

    @property
    def reason(self) -> str:
        """Why there is no `name`; empty if there is one."""
        if not self.alternatives:
            return NOTHING
        return "" if self.name else f"{' and '.join(self.alternatives)} explain the pictures alike: name the field"


def which_field(images: Sequence[Image], names: Sequence[str] = COMPARED, network: Network | None = None) -> WhichField:
    """Search pictures for every field, and compare how well the accepted cameras explain them.

    A field that explains the first picture badly, before its cameras are refined or after, is dropped.

    Parameters
    ----------
    images : sequence of (height, width, 3) uint8 arrays
        Blue, green, red; pictures of one field.
    names : sequence of str
        Names of fields in the catalogue.
    network : Network, optional
        Finds the fields whose labels it knows; the other fields are searched for (`fieldcalib.images.find_courts`).

    Examples
    --------
    >>> from fieldcalib import Camera
    >>> from fieldcalib.draw.scene import render_field
    >>> truth = Camera.from_angles(1.5, 1.3, 0.0, 1400.0, (-32.0, 1.0, -9.0), (960, 540))
    >>> which_field([render_field(truth, field_named("tennis"))], ["badminton", "tennis"]).name
    'tennis'
    """
    scores = dict.fromkeys(names, 0.0)
    pictures = [PictureToSearch(image) for image in images]
    promising = _likely(pictures[0], names, network) if pictures else ()
    for picture in pictures:
        found = {name: _score(picture, field_named(name), network) for name in promising}
        for name, (score, is_accepted) in found.items():
            scores[name] += score * is_accepted
        best = max((score for score, _ in found.values()), default=0.0)
        promising = tuple(name for name, (score, _) in found.items() if score >= PROMISING * best)
    return WhichField(dict(sorted(scores.items(), key=lambda item: -item[1])))


def _likely(picture: PictureToSearch, names: Sequence[str], network: Network | None) -> tuple[str, ...]:
    """Fields whose best camera before refinement scores at least `LIKELY` times the best score of any field.

    Fields that the network knows are always kept.
    """
    score: dict[str, float] = {}
    for name in names:
        field = field_named(name)
        if network is not None and not classes_without_segment(network.classes, field):
            score[name] = np.inf
            continue
        ranked = picture.stripes(lighter=field.lines.lighter).ranked(field, are_cut_out=False)
        score[name] = float(np.max(ranked.score, initial=0.0))
    best = max((one for one in score.values() if np.isfinite(one)), default=0.0)
    return tuple(name for name in names if score[name] >= LIKELY * best)


def _score(picture: PictureToSearch, field: Field, network: Network | None) -> tuple[float, bool]:
    """Log likelihood ratio of the best camera of a field, and whether it is accepted."""
    if network is not None and not classes_without_segment(network.classes, field):
        (found,) = calibrate_from_images(field, [picture.image], network)
        return (_of_camera(picture, field, found.camera), found.accepted) if found.camera is not None else (0.0, False)
    best = next(iter(courts_in(picture, field)), None)
    return (0.0, False) if best is None else (max(best.evidence.score, 0.0), best.calibration.accepted)


def _of_camera(picture: PictureToSearch, field: Field, camera: Camera) -> float:
    maps = picture.stripes(lighter=field.lines.lighter).maps
    return max(maps.score(camera.scaled(maps.size), MarkingPoints.of(field, POINTS))[0], 0.0)
