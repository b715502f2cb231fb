"""Sub-pixel points on the ridges of class probabilities.

A segment is as wide in a probability map as its network is unsure. Its middle is found slice by slice: the pixels of a
class get coordinates along and across a curve near to them, the ruler (a straight line, or an ellipse for an arc), are
cut into slices along it, and each slice gives one point, the centroid of its probability. The ruler need not fit: a
line that a lens has bent keeps its bend.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fieldcalib._types import Array, BoolArray, Float32, IntArray
from fieldcalib.fields.segments import Arc, ObjectSegments, Segment
from fieldcalib.localize.grid import BACKGROUND, Localization, check_classes, image_from_grid
from fieldcalib.localize.rulers import EllipseRuler, Ruler, StraightRuler

# Lengths are in pixels of the grid.
FLOOR = 0.2  # probability below which a pixel says nothing
SURE = 0.5  # of some pixel of every blob: what is pale all over is nothing either
LEAST_MASS = 3.0  # sum of the probabilities of a segment's pixels: less is noise
SPECK = 0.2  # of the heaviest blob's mass: lighter blobs of a class are noise
REACH = 0.5  # of the length of what is found of a segment: another piece of it is not further away
ROUNDS = 2  # of fitting a ruler, the second one with little weight on what is off the first
BLOB = 3.0  # px from the ruler at which a pixel counts half
FAR = 4.0  # px from the ruler, and what a lens may bend: pixels beyond belong to something else
BEND = 0.03  # of a line's length, by a strong lens
CAP = 1.5  # px at either end of a segment: the end of a band is round, or runs into another segment
SLICE = 2.5  # px: shortest slice; neighbouring pixels of a network err alike
LEAST_SLICES, MOST_SLICES, MOST_ARC_SLICES = 2, 12, 20
LEAST_SHARE = 0.3  # of a usual slice's mass
PIXELS_PER_SEGMENT = 20.0  # so many points, all of them sure, weigh as much as a segment without a weight


def ridge_points(
    probability: Float32, classes: Sequence[str], object_segments: ObjectSegments, image_size: tuple[int, int]
) -> Localization:
    """Points along the middle of every segment that a network sees, to fractions of the grid's pixels.

    Up to 12 points of a line and 20 of an arc. They weigh as much as the network is sure of them, and long segments,
    which have many, more than short ones. Slices at the image's border, which cuts them aslant, are left out.

    Parameters
    ----------
    probability : (K, h, w) float32 array
        Probability of each class on a grid over the image.
    classes : sequence of K str
        Segments of the object, or "background".
    object_segments : mapping of str to segment
        The calibration object; says which classes are arcs.
    image_size : (int, int)
        Width and height of the image in pixels.

    Raises
    ------
    ValueError
        If there is not one map a class, or a class is no segment.

    Examples
    --------
    >>> from fieldcalib import soccer
    >>> middle_line = np.zeros((90, 160), np.float32)
    >>> middle_line[5:80, 70:73] = 0.25, 1.0, 0.75
    >>> maps = np.stack([1.0 - middle_line, middle_line])
    >>> found = ridge_points(maps, ("background", "Middle line"), soccer(), (1600, 900))
    >>> found.pixels["Middle line"][:, 0].round(2)[:4]  # 10 pixels of the image for one of the grid
    array([717., 717., 717., 717.])
    """
    check_classes(probability, classes, object_segments)
    height, width = probability.shape[1:]
    seen = probability > FLOOR
    seen[[name == BACKGROUND for name in classes]] = False
    index = np.flatnonzero(seen)
    member, pixel = np.divmod(index, height * width)
    y, x = np.divmod(pixel, width)
    p = probability.ravel()[index].astype(float)
    mass = np.bincount(member, p, len(classes))
    found = Localization({}, {})
    for k in np.flatnonzero(mass > LEAST_MASS).tolist():
        here = slice(*np.searchsorted(member, (k, k + 1)))
        label = classes[k]
        points, confidence = _middle(x[here], y[here], p[here], (width, height), object_segments[label])
        if len(points) >= LEAST_SLICES:
            found.pixels[label] = image_from_grid(points, (width, height), image_size)
            found.weights[label] = confidence * len(points) / PIXELS_PER_SEGMENT
    return found


def _middle(x: IntArray, y: IntArray, p: Array, grid_size: tuple[int, int], segment: Segment) -> tuple[Array, Array]:
    """Points (n, 2) along the middle of a segment, from the pixels (m,) that its class claims, and confidences (n,)."""
    chain = _chain(x, y, p)
    xy, p = np.column_stack([x[chain], y[chain]]).astype(float), p[chain]
    if not len(p):
        return xy, p
    is_arc = isinstance(segment, Arc)
    ruler = _ruler(xy, p, is_arc=is_arc)
    cut = np.any((xy == 0.0) | (xy == np.subtract(grid_size, 1)), axis=1)
    return _slices(ruler, xy, p, cut, MOST_ARC_SLICES if is_arc else MOST_SLICES)


def _chain(x: IntArray, y: IntArray, p: Array) -> BoolArray:
    """Which pixels (m,) belong to the heaviest blob, or to others close enough to be more of the same segment."""
    import cv2

    mask = np.zeros((np.ptp(y) + 1, np.ptp(x) + 1), np.uint8)
    mask[y - y.min(), x - x.min()] = 1
    count, blobs = cv2.connectedComponents(mask)
    if count == 2:  # a single blob, and what is none
        return np.full(len(p), p.max() >= SURE)
    blob = blobs[y - y.min(), x - x.min()]
    mass, peak = np.bincount(blob, p, count), np.zeros(count)
    np.maximum.at(peak, blob, p)
    mass[peak < SURE] = 0.0
    low, high = np.full((count, 2), np.inf), np.full((count, 2), -np.inf)
    np.minimum.at(low, blob, np.column_stack([x, y]))
    np.maximum.at(high, blob, np.column_stack([x, y]))
    heavy = mass > SPECK * mass.max()
    chain = heavy & (mass == mass.max())
    while np.any(heavy & ~chain):
        start, end = low[chain].min(axis=0), high[chain].max(axis=0)
        gap = np.linalg.norm(np.maximum(np.maximum(low - end, start - high), 0.0), axis=1)
        more = heavy & ~chain & (gap < REACH * np.linalg.norm(end - start))
        if not np.any(more):
            break
        chain |= more
    return np.asarray(chain[blob])


def _ruler(xy: Array, p: Array, *, is_arc: bool) -> Ruler:
    """A curve close to pixels (m, 2)."""
    weight = p
    for _ in range(ROUNDS):
        try:
            ruler: Ruler = EllipseRuler.fit(xy, weight) if is_arc else StraightRuler.fit(xy, weight)
        except np.linalg.LinAlgError:  # an arc so short that it is straight
            ruler = StraightRuler.fit(xy, weight)
        weight = p / (1.0 + np.square(ruler.measure(xy)[1] / BLOB))
    return ruler


def _slices(ruler: Ruler, xy: Array, p: Array, cut: BoolArray, most: int) -> tuple[Array, Array]:
    """Centroids (n, 2) of slices, and the mean probability in each, (n,)."""
    s, d = ruler.measure(xy)
    inner = np.abs(d) < FAR + BEND * np.ptp(s)
    low, high = s[inner].min(initial=np.inf) + CAP, s[inner].max(initial=-np.inf) - CAP
    inner &= (s > low) & (s < high)
    if not np.any(inner):
        return np.zeros((0, 2)), np.zeros(0)
    s, d, p, cut = s[inner], d[inner], p[inner], cut[inner]
    count = int(np.clip((high - low) / SLICE, 1, most))
    slot = np.minimum((s - low) * (count / (high - low)), count - 1).astype(np.intp)
    mass = np.bincount(slot, p, count)
    usable = (mass > LEAST_SHARE * np.mean(mass)) & (np.bincount(slot, cut, count) == 0)
    mean_s, mean_d, mean_p = (np.bincount(slot, p * v, count)[usable] / mass[usable] for v in (s, d, p))
    return ruler.place(mean_s, mean_d), mean_p
