"""Sub-pixel points on the ridges of class probabilities.

In a probability map a segment is a band, wider where the network is less certain. The middle of the band is found
slice by slice: the pixels of a class get coordinates along and across a reference curve near them, the ruler (a
straight line, or an ellipse for an arc); they are cut into slices along it, and each slice gives one point, the
centroid of its probability. The ruler need not fit exactly: the curvature of a distorted line is preserved.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fieldcalib._types import Array, BoolArray, Float32, IntArray
from fieldcalib.fields.segments import Arc, ObjectSegments, Segment
from fieldcalib.localize.grid import BACKGROUND, Localization, check_classes, image_from_grid
from fieldcalib.localize.rulers import EllipseRuler, Ruler, StraightRuler

# Chosen by eye on broadcast frames; results hardly depend on them within a factor of two: on 31 images of WC14 IoU_part
# is 95.9 % (mean) and one camera is not accepted; with any one constant halved or doubled, 95.8 to 96.0 % and 1 to 4.
# Lengths are in pixels of the grid.
LEAST_PIXEL_PROBABILITY = 0.2  # pixels below are ignored
LEAST_PEAK = 0.5  # blobs whose largest probability is below are discarded
LEAST_MASS = 3.0  # sum of the probabilities of a segment's pixels: less is noise
LEAST_BLOB_SHARE = 0.2  # of the mass of the heaviest blob of a class: lighter blobs are noise
LARGEST_GAP = 0.5  # between pieces of a segment, as a share of the length found so far
RULER_FITS = 2  # the second one is reweighted by the distances from the first
HALF_WEIGHT_DISTANCE = 3.0  # px from the ruler at which the weight is halved: a band is a few px wide
# px from the ruler, and of the length of the segment (sag of a distorted line): pixels beyond belong to other objects
LARGEST_DISTANCE, LARGEST_SAG = 4.0, 0.03
END_MARGIN = 1.5  # px cut off at either end of a segment: there the band is round or merges with another segment
SHORTEST_SLICE = 2.5  # px: the errors of neighbouring pixels of a network are correlated
LEAST_SLICES = 2  # points that determine a line
MOST_SLICES, MOST_ARC_SLICES = 12, 20  # more cost time in the solver
LEAST_SLICE_SHARE = 0.3  # of the mean mass of the slices: lighter ones are mostly hidden
POINTS_PER_SEGMENT = 20.0  # number of points of probability 1 that carries the weight of one segment without a weight


def ridge_points(
    probability: Float32, classes: Sequence[str], object_segments: ObjectSegments, image_size: tuple[int, int]
) -> Localization:
    """Points along the middle of every detected segment, with sub-pixel resolution.

    Up to 12 points of a line and 20 of an arc. The weight of a point is proportional to its probability and to the
    number of points of its segment. Slices at the image's border, which would be cut obliquely, are left out.

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
        If there is not one map per class, or a class is not a segment.

    Examples
    --------
    >>> from fieldcalib import soccer
    >>> middle_line = np.zeros((90, 160), np.float32)
    >>> middle_line[5:80, 70:73] = 0.25, 1.0, 0.75
    >>> maps = np.stack([1.0 - middle_line, middle_line])
    >>> found = ridge_points(maps, ("background", "Middle line"), soccer(), (1600, 900))
    >>> found.pixels["Middle line"][:, 0].round(2)[:4]  # a pixel of the grid is 10 pixels of the image
    array([717., 717., 717., 717.])
    """
    check_classes(probability, classes, object_segments)
    height, width = probability.shape[1:]
    seen = probability > LEAST_PIXEL_PROBABILITY
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
        points, mean_probability = _middle(x[here], y[here], p[here], (width, height), object_segments[label])
        if len(points) >= LEAST_SLICES:
            found.pixels[label] = image_from_grid(points, (width, height), image_size)
            found.weights[label] = mean_probability * len(points) / POINTS_PER_SEGMENT
    return found


def _middle(x: IntArray, y: IntArray, p: Array, grid_size: tuple[int, int], segment: Segment) -> tuple[Array, Array]:
    """Points (n, 2) along the middle of a segment from the pixels (m,) of its class, and their probabilities (n,)."""
    chain = _chain(x, y, p)
    xy, p = np.column_stack([x[chain], y[chain]]).astype(float), p[chain]
    if not len(p):
        return xy, p
    is_arc = isinstance(segment, Arc)
    ruler = _ruler(xy, p, is_arc=is_arc)
    cut = np.any((xy == 0.0) | (xy == np.subtract(grid_size, 1)), axis=1)
    return _slices(ruler, xy, p, cut, MOST_ARC_SLICES if is_arc else MOST_SLICES)


def _chain(x: IntArray, y: IntArray, p: Array) -> BoolArray:
    """Which pixels (m,) belong to the heaviest blob, or to blobs near enough to be parts of the same segment."""
    import cv2

    mask = np.zeros((np.ptp(y) + 1, np.ptp(x) + 1), np.uint8)
    mask[y - y.min(), x - x.min()] = 1
    count, blobs = cv2.connectedComponents(mask)
    if count == 2:  # the background and a single blob
        return np.full(len(p), p.max() >= LEAST_PEAK)
    blob = blobs[y - y.min(), x - x.min()]
    mass, peak = np.bincount(blob, p, count), np.zeros(count)
    np.maximum.at(peak, blob, p)
    mass[peak < LEAST_PEAK] = 0.0
    low, high = np.full((count, 2), np.inf), np.full((count, 2), -np.inf)
    np.minimum.at(low, blob, np.column_stack([x, y]))
    np.maximum.at(high, blob, np.column_stack([x, y]))
    heavy = mass > LEAST_BLOB_SHARE * mass.max()
    chain = heavy & (mass == mass.max())
    while np.any(heavy & ~chain):
        start, end = low[chain].min(axis=0), high[chain].max(axis=0)
        gap = np.linalg.norm(np.maximum(np.maximum(low - end, start - high), 0.0), axis=1)
        more = heavy & ~chain & (gap < LARGEST_GAP * np.linalg.norm(end - start))
        if not np.any(more):
            break
        chain |= more
    return np.asarray(chain[blob])


def _ruler(xy: Array, p: Array, *, is_arc: bool) -> Ruler:
    """A curve near the pixels (m, 2), fitted robustly."""
    weight = p
    for _ in range(RULER_FITS):
        try:
            ruler: Ruler = EllipseRuler.fit(xy, weight) if is_arc else StraightRuler.fit(xy, weight)
        except np.linalg.LinAlgError:  # an arc too short to show its curvature
            ruler = StraightRuler.fit(xy, weight)
        weight = p / (1.0 + np.square(ruler.measure(xy)[1] / HALF_WEIGHT_DISTANCE))
    return ruler


def _slices(ruler: Ruler, xy: Array, p: Array, cut: BoolArray, most: int) -> tuple[Array, Array]:
    """Centroids (n, 2) of slices, and the mean probability in each, (n,)."""
    s, d = ruler.measure(xy)
    inner = np.abs(d) < LARGEST_DISTANCE + LARGEST_SAG * np.ptp(s)
    low, high = s[inner].min(initial=np.inf) + END_MARGIN, s[inner].max(initial=-np.inf) - END_MARGIN
    inner &= (s > low) & (s < high)
    if not np.any(inner):
        return np.zeros((0, 2)), np.zeros(0)
    s, d, p, cut = s[inner], d[inner], p[inner], cut[inner]
    count = int(np.clip((high - low) / SHORTEST_SLICE, 1, most))
    slot = np.minimum((s - low) * (count / (high - low)), count - 1).astype(np.intp)
    mass = np.bincount(slot, p, count)
    usable = (mass > LEAST_SLICE_SHARE * np.mean(mass)) & (np.bincount(slot, cut, count) == 0)
    mean_s, mean_d, mean_p = (np.bincount(slot, p * v, count)[usable] / mass[usable] for v in (s, d, p))
    return ruler.place(mean_s, mean_d), mean_p
