"""Recognition of the field that pictures show: likely fields are tried, and the best one must win by a margin."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np

from fieldcalib.assess.findings import Verdict
from fieldcalib.fields.catalogue import COMPARED
from fieldcalib.fields.catalogue import field as field_named
from fieldcalib.fields.field import Field
from fieldcalib.images.from_images import How, calibrate_alone, calibrate_from_images
from fieldcalib.images.search.court_ranking import POINTS, PictureToSearch
from fieldcalib.images.search.court_search import searches_for
from fieldcalib.images.search.stripe_likelihood import MarkingPoints
from fieldcalib.io.image_files import Image
from fieldcalib.localize import Network
from fieldcalib.localize.point_selection import classes_without_segment
from fieldcalib.solve.request import Task

MARGIN = 0.8  # of the best score: a field that reaches it explains the pictures about as well
LIKELY = 0.4  # of the best score before refinement: fields below are not searched for
# The same of the score of an accepted camera: in 20 pictures refinement on all stripes raises a score by 6 % at most
LIKELY_BESIDE = 0.7
PROMISING = 0.5  # of the best score in the first picture: fields below are not searched for in further pictures
NOTHING = "no field was found: name it"


@dataclass(frozen=True)
class WhichField:
    """The field that pictures show, or the fields that explain them about equally well."""

    scores: Mapping[str, float]
    """Log likelihood ratios of the accepted cameras by name of each field that was compared, best first; 0 without an
    accepted camera."""

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
    """Compare how well the accepted cameras of fields explain pictures.

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
    scores, promising = dict[str, float](), tuple(names)
    for image in images:
        found = _compared(PictureToSearch(image), promising, network)
        for name, one in found.items():
            scores[name] = scores.get(name, 0.0) + one.score * one.is_accepted
        best = max((one.score for one in found.values()), default=0.0)
        promising = tuple(name for name, one in found.items() if one.score >= PROMISING * best)
    return WhichField(dict(sorted(scores.items(), key=lambda item: -item[1])))


@dataclass(frozen=True)
class _Found:
    """The best camera of a field in a picture; by default there is none."""

    score: float = 0.0
    """Log likelihood ratio of the camera, at least 0."""
    verdict: Verdict = Verdict.REJECT

    @property
    def is_accepted(self) -> bool:
        """Whether the camera is accepted."""
        return self.verdict is not Verdict.REJECT


def _compared(picture: PictureToSearch, names: Sequence[str], network: Network | None) -> dict[str, _Found]:
    """Find the best camera of each field in a picture.

    First the network looks at the whole picture, and likely fields are searched for among all stripes; where it finds a
    good camera, no other field is tried. Only if nothing is found, all that finds a camera of a field is tried.
    """
    fields = {name: field_named(name) for name in names}
    searches = {name: searches_for(picture, field) for name, field in fields.items() if not _knows(network, field)}
    known, found = fields.keys() - searches.keys(), dict.fromkeys(names, _Found())
    for is_thorough in (False, True):
        found |= {name: _by_network(picture, fields[name], network, is_thorough=is_thorough) for name in known}
        if any(found[name].verdict is Verdict.GOOD for name in known):
            return {name: found[name] for name in known}
        likely = _unrefined(picture, {name: fields[name] for name in searches}, is_thorough=is_thorough)
        for name in sorted(likely, key=lambda name: -likely[name]):
            accepted = max((one.score for one in found.values() if one.is_accepted), default=0.0)
            if likely[name] >= max(LIKELY * max(likely.values()), LIKELY_BESIDE * accepted):
                for searched in islice(searches[name], None if is_thorough else 1):
                    for best in searched.courts[:1]:
                        found[name] = _Found(max(best.evidence.score, 0.0), best.calibration.verdict)
        if any(one.is_accepted for one in found.values()):
            break
    return found


def _unrefined(picture: PictureToSearch, fields: Mapping[str, Field], *, is_thorough: bool) -> dict[str, float]:
    """Log likelihood ratios of the best cameras of fields before refinement, 0 without any.

    Courts of one sport look alike: where the first is unlikely, the others are left out. What three lines of a picture
    show is asked only of a thorough search, as it takes most of the time.
    """
    likely = dict[str, float]()
    for name, field in fields.items():
        first = next(one for one in fields if _sport(one) == _sport(name))
        if name == first or likely[first] >= LIKELY * max(likely.values()):
            stripes = picture.stripes(lighter=field.lines.lighter)
            ranked = stripes.ranked(field, may_be_cut_out=False) if is_thorough else stripes.ranked_clear(field)
            likely[name] = float(np.max(ranked.score, initial=0.0))
    return likely


def _sport(name: str) -> tuple[str, ...]:
    """The first words of a field's name, which those of one sport have in common.

    Examples
    --------
    >>> _sport("ice-hockey-nhl-2013") == _sport("ice-hockey-iihf")
    True
    """
    return tuple(name.split("-")[:2])


def _knows(network: Network | None, field: Field) -> bool:
    """Whether all classes of a network are labels of a field."""
    return network is not None and not classes_without_segment(network.classes, field)


def _by_network(picture: PictureToSearch, field: Field, network: Network | None, *, is_thorough: bool) -> _Found:
    _, how = How(Task(field), network).on_side()
    images = [picture.image]
    (found,) = calibrate_from_images(field, images, network) if is_thorough else calibrate_alone(how, images)
    if found.camera is None:
        return _Found()
    maps = picture.stripes(lighter=field.lines.lighter).maps
    score, *_ = maps.score(found.camera.scaled(maps.size), MarkingPoints.of(field, POINTS))
    return _Found(max(score, 0.0), found.verdict)
