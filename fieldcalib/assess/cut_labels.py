"""Labels that end before the border of their picture: evidence that it was cut out of a larger one with its labels.

Annotators follow a marking to the border of the picture. On average an annotated frame has 5.5 places where a marking
leaves the picture; at 98 % of them labels end within 1.2 % of the width, but only at 5 % where a picture was cut out of
a larger one with its labels. The likelihoods are applied to the places of several straight markings at one side of the
picture, if labels reach the border at the other sides: sparse labels of a hasty annotator reach no border.
"""

from __future__ import annotations

import numpy as np

from fieldcalib._types import Array
from fieldcalib.fields.field import Field
from fieldcalib.geometry.camera import Camera
from fieldcalib.problem.labelled_pixels import Pixels

REACHED, SHORT = 0.012, 0.02  # of the width: labels with a smaller gap reach the border, with a larger one do not
# Log likelihood ratios of a part of a larger picture, for labels that reach the border, nearly do, and do not: 98.2,
# 1.0 and 0.9 % of 3657 places in 651 annotated frames; 4.9, 3.1 and 92 % of 4187 at the cut sides of their corners.
LOG_RATIOS = (-3.0, 1.2, 4.6)
MOST_LOG_RATIO = 8.0  # one picture in some thousands is unusual for another reason
LEAST_PLACES = 2  # at one side: a single marking may have been followed less far than the others
LEAST_REACHED = 0.5  # share of the other places at which labels must reach the border
WITH_LABELS = 0.5  # share of the cut pictures that were cut with their labels; the others were labelled afterwards
SPACING = 0.5  # m, of points on a segment
SIDES = 4


def log_ratio_of_cut(field: Field, pixels: Pixels, camera: Camera) -> float:
    """Log likelihood ratio, from the ends of labels, that a picture was cut out of a larger one.

    It is 0 if the ends are no evidence, and only slightly negative if the labels reach every side, as the picture may
    have been labelled after the cut.

    Parameters
    ----------
    field : Field
    pixels : dict of str to (N, 2) array
        Pixels labelled by a person.
    camera : Camera

    Examples
    --------
    >>> from fieldcalib import soccer
    >>> whole = Camera.from_angles(0.0, 1.3, 0.0, 1000.0, (0.0, 65.0, -16.0), (1280, 720))
    >>> lines = ("Side line top", "Side line bottom", "Big rect. right main", "Big rect. right top")
    >>> xy = {label: whole.project(soccer()[label].sample(0.1)) for label in lines}
    >>> labels = {label: some[np.all((some > 0.0) & (some < (1279.0, 719.0)), axis=1)] for label, some in xy.items()}
    >>> log_ratio_of_cut(soccer(), labels, whole) < 0.0
    True
    >>> left = {label: some[some[:, 0] < 900.0] for label, some in labels.items()}  # sparse ones, cut at column 960
    >>> log_ratio_of_cut(soccer(), left, whole.cropped((0, 0), (960, 720))) > 3.0
    True
    """
    places = [place for label, xy in pixels.items() for place in _ends(field, label, xy, camera)]
    best = -np.inf
    for side in range(SIDES):
        own = [gap for where, gap in places if where == side]
        others = [gap for where, gap in places if where != side]
        reached = sum(gap < REACHED for gap in others)
        if len(own) >= LEAST_PLACES and reached >= max(LEAST_REACHED * len(others), 1):
            best = max(best, sum(LOG_RATIOS[int(np.searchsorted((REACHED, SHORT), gap, side="right"))] for gap in own))
    if not np.isfinite(best):
        return 0.0
    return float(np.log(1.0 - WITH_LABELS + WITH_LABELS * np.exp(min(best, MOST_LOG_RATIO))))


def _ends(field: Field, label: str, xy: Array, camera: Camera) -> list[tuple[int, float]]:
    """Places where a marking on the ground leaves the picture: the side, and the gap to its label (of the width)."""
    segment = field.segments.get(label)
    X = np.zeros((0, 3)) if segment is None or segment.is_arc else segment.sample(SPACING)
    if not len(X) or np.any(X[:, 2]) or not len(xy):  # circles need not be followed to the border
        return []
    points = camera.project(X)
    last = np.array(camera.image_size) - 1.0
    beyond = np.concatenate([-points, points - last], axis=1)[:, [0, 2, 1, 3]]  # px, beyond left, right, top, bottom
    outside = np.max(beyond, axis=1)
    known, out = np.isfinite(outside), outside > 0.0
    found = []
    for b in np.flatnonzero(known[:-1] & known[1:] & (out[:-1] != out[1:])) + 1:
        a, b = (b, b - 1) if out[b - 1] else (b - 1, b)  # a is inside
        side = int(np.argmax(beyond[b]))
        share = -beyond[a, side] / (beyond[b, side] - beyond[a, side])
        place = points[a] + share * (points[b] - points[a])
        found.append((side, float(np.min(np.linalg.norm(xy - place, axis=1)) / camera.image_size[0])))
    return found
