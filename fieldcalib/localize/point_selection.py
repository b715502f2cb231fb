"""Labelled pixels of an image (`Localization`), selected from the class probabilities on the grid of a network.

The paper's point selection: a few pixels of the skeleton of every class mask. By default: sub-pixel points on ridges.

In a probability map a segment is a band, wider where the network is less certain. The middle of the band is found
slice by slice: the pixels of a class get coordinates along and across a reference curve near them, the ruler (a
straight line, or an ellipse for an arc); they are cut into slices along it, and each slice gives one point, the
centroid of its probability. The ruler need not fit exactly: the curvature of a distorted line is preserved.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np

from fieldcalib._types import Array, BoolArray, Float32, IntArray, expect, listed, several
from fieldcalib.fields.field import ObjectSegments
from fieldcalib.problem.labelled_pixels import Pixels, check_object, split_circles

BACKGROUND = "background"  # class of pixels that show no marking; several classes may have this name
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
# px from the ruler, plus a share of the segment's length (sag of a distorted line): pixels beyond are of other objects
LARGEST_DISTANCE, LARGEST_SAG = 4.0, 0.03
END_MARGIN = 1.5  # px cut off at either end of a segment: there the band is round or merges with another segment
SHORTEST_SLICE = 2.5  # px: the errors of neighbouring pixels of a network are correlated
LEAST_SLICES = 2  # points that determine a line
MOST_SLICES, MOST_ARC_SLICES = 12, 20  # more cost time in the solver
LEAST_SLICE_SHARE = 0.3  # of the mean mass of the slices: lighter ones are mostly hidden
POINTS_PER_SEGMENT = 20.0  # number of points of probability 1 that carries the weight of one segment without a weight
LEAST_RADIUS = 1e-9  # of an ellipse mapped to the unit circle: avoids a division by zero at its centre
LEAST_WEIGHT = 1e-9  # of the pixels of a line: avoids a division by zero where there are none
POINTS_PER_LINE, POINTS_PER_CIRCLE = 4, 8
LEAST_PIXELS = 4  # of a mask: smaller ones are noise


@dataclass(frozen=True)
class Localization:
    """Labelled pixels of one image, as `calibrate_from_segments` takes them.

    Examples
    --------
    >>> from fieldcalib import calibrate_from_segments, soccer
    >>> found = Localization({"Middle line": np.array([[480.0, 100.0]])}, {"Middle line": np.array([0.9])})
    >>> str(calibrate_from_segments(soccer(), found.pixels, (960, 540), weights=found.weights).status)
    'too few segments'
    """

    pixels: Pixels
    """Label -> (N, 2) pixels."""
    weights: dict[str, Array]
    """Label -> (N,) weight of each pixel."""

    @property
    def weight(self) -> dict[str, float]:
        """Label -> sum of the weights of its pixels."""
        return {label: float(np.sum(values)) for label, values in self.weights.items()}

    def only(self, labels: Iterable[str]) -> Localization:
        """The localization restricted to some of its labels."""
        kept = several(labels, "labels")
        unknown = [label for label in kept if not isinstance(label, str) or label not in self.pixels]
        if unknown:
            raise ValueError(f"expected labels among {', '.join(self.pixels)}, got {unknown[0]!r}")
        return Localization({k: self.pixels[k] for k in kept}, {k: self.weights[k] for k in kept})


def image_from_grid(xy: Array, grid_size: tuple[int, int], image_size: tuple[int, int]) -> Array:
    """Pixels of an image at points (..., 2) of a grid that covers it.

    Pixel centres have integer coordinates in both, so both begin at (-1/2, -1/2), as in cv2.resize.

    Examples
    --------
    >>> image_from_grid(np.array([[0.0, 0.0], [319.0, 179.0]]), (320, 180), (1920, 1080))
    array([[   2.5,    2.5],
           [1916.5, 1076.5]])
    """
    return np.asarray((xy + 0.5) * np.divide(image_size, grid_size) - 0.5)


def check_classes(probability: Float32, classes: Sequence[str], object_segments: ObjectSegments) -> None:
    """Raise a ValueError unless there is one map per class and each class is a segment or the background."""
    check_object(object_segments)
    expect(probability, np.ndarray, "what a network returns")
    for name in listed(classes, "names of classes"):
        expect(name, str, '"Middle line"')
    if probability.ndim != 3 or len(probability) != len(classes):
        raise ValueError(
            f"expected probabilities of shape ({len(classes)}, height, width), one per class, got {probability.shape}"
        )
    unknown = classes_without_segment(classes, object_segments)
    if unknown:
        raise ValueError(
            f"the network's class {unknown[0]!r} is not a segment of the object: give a network= that was trained for "
            f"it (that of the package knows soccer alone), or name the class {BACKGROUND!r} to ignore it"
        )


def classes_without_segment(classes: Sequence[str], object_segments: ObjectSegments) -> list[str]:
    """Classes of a network that are neither a segment of the object nor the background."""
    return [name for name in classes if name != BACKGROUND and name not in object_segments]


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
    grid_size = probability.shape[2], probability.shape[1]
    bands = _chains(_bands(probability, classes))
    is_arc = [object_segments[classes[k]].is_arc for k in bands.classes]
    lines = _lines(bands)
    seen = np.unique(bands.member).tolist()
    arcs = {k: _arc(bands.xy[bands.of(k)], bands.p[bands.of(k)]) for k in seen if is_arc[k]}
    s, d = lines.of(bands.member).measure(bands.xy)
    for k, ruler in arcs.items():
        s[bands.of(k)], d[bands.of(k)] = ruler.measure(bands.xy[bands.of(k)])
    cut = np.any((bands.xy == 0.0) | (bands.xy == np.subtract(grid_size, 1)), axis=1)
    member, s, d, p = _slices(bands, s, d, cut, np.where(is_arc, MOST_ARC_SLICES, MOST_SLICES))
    points = lines.of(member).place(s, d)
    found = Localization({}, {})
    for k, number in enumerate(bands.classes):
        here = slice(*np.searchsorted(member, (k, k + 1)).tolist())
        count = here.stop - here.start
        if count < LEAST_SLICES:
            continue
        if k in arcs:
            points[here] = arcs[k].place(s[here], d[here])
        found.pixels[classes[number]] = image_from_grid(points[here], grid_size, image_size)
        found.weights[classes[number]] = p[here] * count / POINTS_PER_SEGMENT
    return found


@dataclass(frozen=True, eq=False)
class _Bands:
    """The pixels of all detected classes, class after class, so that one call serves all of them."""

    classes: list[int]
    """Number of the class of each of S bands."""
    member: IntArray
    """Index of the band of each pixel, (m,), ascending."""
    xy: Array
    """Pixels of the grid, (m, 2)."""
    p: Array
    """Probability, (m,)."""

    def of(self, k: int) -> slice:
        """The pixels of one band."""
        return slice(*np.searchsorted(self.member, (k, k + 1)).tolist())

    def where(self, mask: BoolArray) -> _Bands:
        """The pixels in a mask (m,); bands may be left without any."""
        return _Bands(self.classes, self.member[mask], self.xy[mask], self.p[mask])


def _bands(probability: Float32, classes: Sequence[str]) -> _Bands:
    """The classes with enough pixels."""
    _, height, width = probability.shape
    seen = probability > LEAST_PIXEL_PROBABILITY
    seen[[name == BACKGROUND for name in classes]] = False
    index = np.flatnonzero(seen)
    member, pixel = np.divmod(index, height * width)
    p = probability.ravel()[index].astype(float)
    enough = np.bincount(member, p, len(classes)) > LEAST_MASS
    kept = enough[member]
    y, x = np.divmod(pixel[kept], width)
    number = np.cumsum(enough) - 1
    return _Bands(np.flatnonzero(enough).tolist(), number[member[kept]], np.column_stack([x, y]).astype(float), p[kept])


def _chains(bands: _Bands) -> _Bands:
    """Keep the heaviest blob of each band, and the blobs near enough to be parts of the same segment."""
    import cv2

    if not len(bands.p):
        return bands
    x, y = bands.xy.T.astype(np.intp)
    # the bands on top of each other, each in as many rows as it needs and an empty one
    top, bottom = _range(bands.xy[:, 1], bands.member, len(bands.classes))
    rows = bottom - top + 2.0
    row = y + (np.cumsum(rows) - rows - top).astype(np.intp)[bands.member]
    mask = np.zeros((int(np.sum(rows)), np.max(x) + 1), np.uint8)
    mask[row, x] = 1
    count, blobs = cv2.connectedComponents(mask)
    blob = blobs[row, x]
    mass, peak, owner = np.bincount(blob, bands.p, count), np.zeros(count), np.zeros(count, dtype=np.intp)
    np.maximum.at(peak, blob, bands.p)
    owner[blob] = bands.member
    mass[peak < LEAST_PEAK] = 0.0
    heaviest = np.zeros(len(bands.classes))
    np.maximum.at(heaviest, owner, mass)
    heavy = mass > LEAST_BLOB_SHARE * heaviest[owner]
    chain = heavy & (mass == heaviest[owner])
    for k in np.unique(owner[heavy & ~chain]):
        here = bands.of(k)
        pieces = np.flatnonzero(heavy & (owner == k))
        boxes = np.array([(xy.min(axis=0), xy.max(axis=0)) for xy in (bands.xy[here][blob[here] == i] for i in pieces)])
        chain[pieces] = _joined(boxes[:, 0], boxes[:, 1], chain[pieces])
    return bands.where(chain[blob])


def _joined(low: Array, high: Array, chain: BoolArray) -> BoolArray:
    """The `chain` (n,) with all pieces that join it one after the other; their boxes are `low` to `high`, (n, 2)."""
    while not np.all(chain):
        start, end = low[chain].min(axis=0), high[chain].max(axis=0)
        gap = np.linalg.norm(np.maximum(np.maximum(low - end, start - high), 0.0), axis=1)
        more = ~chain & (gap < LARGEST_GAP * np.linalg.norm(end - start))
        if not np.any(more):
            break
        chain = chain | more
    return chain


def _lines(bands: _Bands) -> StraightRuler:
    """A line near the pixels of each band, fitted robustly."""
    weight = bands.p
    for _ in range(RULER_FITS):
        lines = StraightRuler.fit_each(bands.xy, weight, bands.member, len(bands.classes))
        weight = _reweighted(bands.p, lines.of(bands.member).measure(bands.xy)[1])
    return lines


def _arc(xy: Array, p: Array) -> Ruler:
    """An ellipse near pixels (m, 2), fitted robustly; a line if they are too few or do not show its curvature."""
    weight = p
    for _ in range(RULER_FITS):
        try:
            ruler: Ruler = EllipseRuler.fit(xy, weight)
        except np.linalg.LinAlgError:
            ruler = StraightRuler.fit(xy, weight)
        weight = _reweighted(p, ruler.measure(xy)[1])
    return ruler


def _reweighted(p: Array, d: Array) -> Array:
    """Weights in the next fit of pixels with probability p at distance d from their ruler."""
    return np.asarray(p / (1.0 + np.square(d / HALF_WEIGHT_DISTANCE)))


def _slices(bands: _Bands, s: Array, d: Array, cut: BoolArray, most: IntArray) -> tuple[IntArray, Array, Array, Array]:
    """Band, coordinates of the centroid along and across, and mean probability of n slices, each (n,)."""
    count = len(bands.classes)
    least, largest = _range(s, bands.member, count)
    sag = LARGEST_SAG * np.maximum(largest - least, 0.0)
    inner = np.abs(d) < LARGEST_DISTANCE + sag[bands.member]
    least, largest = _range(s[inner], bands.member[inner], count)
    low, high = least + END_MARGIN, largest - END_MARGIN
    inner &= (s > low[bands.member]) & (s < high[bands.member])
    bands, s, d, cut = bands.where(inner), s[inner], d[inner], cut[inner]
    member, p = bands.member, bands.p
    length = np.where(high > low, high - low, 1.0)  # where it is 0 there is nothing to cut
    slots = np.clip(length / SHORTEST_SLICE, 1, most).astype(np.intp)
    slot = np.minimum((s - low[member]) * (slots / length)[member], slots[member] - 1).astype(np.intp)
    slot += (np.cumsum(slots) - slots)[member]
    band, total = np.repeat(np.arange(count), slots), int(np.sum(slots))
    mass = np.bincount(slot, p, total)
    mean = np.bincount(member, p, count) / slots
    usable = (mass > LEAST_SLICE_SHARE * mean[band]) & (np.bincount(slot, cut, total) == 0)
    mean_s, mean_d, mean_p = (np.bincount(slot, p * v, total)[usable] / mass[usable] for v in (s, d, p))
    return band[usable], mean_s, mean_d, mean_p


def _range(s: Array, member: IntArray, count: int) -> tuple[Array, Array]:
    """Least and largest value of each of `count` bands; infinite and minus infinite without any."""
    least, largest = np.full(count, np.inf), np.full(count, -np.inf)
    np.minimum.at(least, member, s)
    np.maximum.at(largest, member, s)
    return least, largest


class Ruler(Protocol):
    """Coordinates along and across a curve."""

    def measure(self, xy: Array) -> tuple[Array, Array]:
        """Coordinates of pixels (n, 2): along the curve, (n,), and across it, (n,); px."""

    def place(self, s: Array, d: Array) -> Array:
        """Pixels (n, 2) of coordinates: the inverse of `measure`."""


@dataclass(frozen=True)
class StraightRuler:
    """A straight line, or several.

    Examples
    --------
    >>> xy = np.array([[0.0, 2.0], [4.0, 2.1], [8.0, 2.0]])
    >>> s, d = StraightRuler.fit(xy, np.ones(3)).measure(xy)
    >>> np.abs(d).round(3)
    array([0.033, 0.067, 0.033])
    """

    origin: Array
    """A point on the line, (2,), or on each of several lines, (..., 2)."""
    direction: Array
    """Unit vector, (2,), or one of each of several lines, (..., 2)."""

    @classmethod
    def fit(cls, xy: Array, weight: Array) -> Self:
        """The total least squares line through weighted pixels (n, 2)."""
        each = cls.fit_each(xy, weight, np.zeros(len(xy), dtype=np.intp), 1)
        return cls(each.origin[0], each.direction[0])

    @classmethod
    def fit_each(cls, xy: Array, weight: Array, member: IntArray, count: int) -> Self:
        """Fit `count` lines, each to the pixels with its number in `member` (n,); arbitrary without pixels."""

        def summed(values: Array) -> Array:
            return np.asarray(np.bincount(member, weight * values, count), dtype=float)

        mass = np.maximum(np.bincount(member, weight, count), LEAST_WEIGHT)
        origin = np.stack([summed(xy[:, 0]), summed(xy[:, 1])], axis=1) / mass[:, None]
        x, y = (xy - origin[member]).T
        moment = np.moveaxis(np.array([[summed(x * x), summed(x * y)], [summed(x * y), summed(y * y)]]), -1, 0)
        return cls(origin, np.linalg.eigh(moment)[1][..., 1])

    def of(self, member: IntArray) -> Self:
        """The line of each pixel, by its index (n,) among several lines."""
        return type(self)(self.origin[member], self.direction[member])

    def measure(self, xy: Array) -> tuple[Array, Array]:
        """See `Ruler`."""
        x, y = np.moveaxis(self.direction, -1, 0)
        offset_x, offset_y = (xy - self.origin).T
        return offset_x * x + offset_y * y, offset_y * x - offset_x * y

    def place(self, s: Array, d: Array) -> Array:
        """See `Ruler`."""
        x, y = np.moveaxis(self.direction, -1, 0)
        return np.asarray(self.origin + np.stack([s * x - d * y, s * y + d * x], axis=-1))


@dataclass(frozen=True)
class EllipseRuler:
    """An ellipse: the points x with ``|A (x - centre)| = 1``. The coordinate across it grows away from the centre.

    Examples
    --------
    >>> phi = np.linspace(0.0, 3.0, 9)
    >>> xy = np.column_stack([7.0 + 20.0 * np.cos(phi), 5.0 + 10.0 * np.sin(phi)])
    >>> ruler = EllipseRuler.fit(xy, np.ones(9))
    >>> ruler.centre.round(6)
    array([7., 5.])
    >>> bool(np.allclose(ruler.place(*ruler.measure(xy + 1.0)), xy + 1.0))
    True
    """

    centre: Array
    """Pixels, (2,)."""
    A: Array
    """Linear map of the ellipse to the unit circle, (2, 2)."""
    start: float
    """Angle of the origin of lengths, on the unit circle to which A maps the ellipse."""

    @classmethod
    def fit(cls, xy: Array, weight: Array) -> Self:
        """The ellipse with the least squared algebraic distances to weighted pixels (n, 2).

        Raises
        ------
        numpy.linalg.LinAlgError
            If the pixels are collinear or coincide, or are fewer than five.

        References
        ----------
        Halir, Flusser: Numerically stable direct least squares fitting of ellipses, WSCG 1998.
        """
        mean = weight @ xy / np.sum(weight)
        scale = np.sqrt(weight @ np.sum(np.square(xy - mean), axis=1) / np.sum(weight))
        if not scale > 0.0:
            raise np.linalg.LinAlgError("all pixels coincide")
        x, y = (xy - mean).T / scale
        D1, D2 = np.stack([x * x, x * y, y * y]), np.stack([x, y, np.ones_like(x)])
        S1, S2, S3 = (weight * D1) @ D1.T, (weight * D1) @ D2.T, (weight * D2) @ D2.T
        T = -np.linalg.solve(S3, S2.T)
        M = (S1 + S2 @ T)[[2, 1, 0]] * [[0.5], [-1.0], [0.5]]
        conics = np.real(np.linalg.eig(M)[1])
        a, b, c = conics[:, np.argmax(4.0 * conics[0] * conics[2] - np.square(conics[1]))]  # one is an ellipse
        d, e, f = T @ (a, b, c)
        Q = np.array([[a, b / 2.0], [b / 2.0, c]])
        centre = -0.5 * np.linalg.solve(Q, (d, e))
        A = np.linalg.cholesky(Q / -(f + 0.5 * centre @ (d, e))).T / scale
        centre = mean + scale * centre
        x, y = A @ (weight @ (xy - centre))
        return cls(centre, A, float(np.arctan2(y, x)))  # opposite to the unseen part

    @property
    def radius(self) -> float:
        """Geometric mean of the half axes, px."""
        return float(1.0 / np.sqrt(np.linalg.det(self.A)))

    def measure(self, xy: Array) -> tuple[Array, Array]:
        """See `Ruler`."""
        offset = xy - self.centre
        x, y = self.A @ offset.T
        phi = np.mod(np.arctan2(y, x) - self.start + np.pi, 2.0 * np.pi) - np.pi
        stretch = np.maximum(np.hypot(x, y), LEAST_RADIUS)
        return self.radius * phi, np.linalg.norm(offset, axis=1) * (1.0 - 1.0 / stretch)

    def place(self, s: Array, d: Array) -> Array:
        """See `Ruler`."""
        phi = s / self.radius + self.start
        spoke = np.linalg.solve(self.A, np.stack([np.cos(phi), np.sin(phi)])).T
        return np.asarray(self.centre + spoke * (1.0 + d / np.linalg.norm(spoke, axis=1))[:, None])


def skeleton_points(
    probability: Float32, classes: Sequence[str], object_segments: ObjectSegments, image_size: tuple[int, int]
) -> Localization:
    """Four pixels of every detected line and eight of every detected circle, whole pixels of the network's grid.

    Every pixel is assigned to its most probable class, and the mask of each class is thinned. Of a line the two ends
    and the pixels nearest to even steps between them are taken; of a circle, pixels far from each other (farthest point
    sampling). The centre circle is split by the middle line. All weights are 1. `ridge_points` takes the same arguments
    and is more accurate.

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

    References
    ----------
    Theiner, Ewerth: TVCalib, WACV 2023, section "Segment Localization & Point Selection".

    Examples
    --------
    >>> from fieldcalib import soccer
    >>> middle_line = np.zeros((90, 160), np.float32)
    >>> middle_line[5:80, 70:73] = 1.0
    >>> maps = np.stack([1.0 - middle_line, middle_line])
    >>> skeleton_points(maps, ("background", "Middle line"), soccer(), (1600, 900)).pixels["Middle line"][:, 0]
    array([714.5, 714.5, 714.5, 714.5])
    """
    from skimage.morphology import skeletonize

    check_classes(probability, classes, object_segments)
    height, width = probability.shape[1:]
    likeliest = np.argmax(probability, axis=0)
    pixels: dict[str, Array] = {}
    for k in np.unique(likeliest):
        label, mask = classes[k], likeliest == k
        if label == BACKGROUND or np.sum(mask) < LEAST_PIXELS:
            continue
        xy = np.argwhere(skeletonize(mask))[:, ::-1].astype(float)  # type: ignore[no-untyped-call]
        chosen = _spread(xy) if object_segments[label].is_arc else _from_end_to_end(xy)
        pixels[label] = image_from_grid(xy[chosen], (width, height), image_size)
    pixels = split_circles(object_segments, pixels, image_size)
    return Localization(pixels, {label: np.ones(len(xy)) for label, xy in pixels.items()})


def _from_end_to_end(xy: Array) -> IntArray:
    """Pixels of a line at even steps along its main direction, both ends included."""
    offset = xy - xy.mean(axis=0)
    _, axes = np.linalg.eigh(offset.T @ offset)
    along = offset @ axes[:, 1]
    steps = np.linspace(along.min(), along.max(), POINTS_PER_LINE)
    return np.unique(np.argmin(np.abs(along - steps[:, None]), axis=1))


def _spread(xy: Array) -> IntArray:
    """Farthest point sampling, beginning with the pixel farthest from the mean."""
    distance = np.linalg.norm(xy - xy.mean(axis=0), axis=1)
    chosen = [int(np.argmax(distance))]
    distance = np.linalg.norm(xy - xy[chosen[0]], axis=1)
    while len(chosen) < min(POINTS_PER_CIRCLE, len(xy)):
        chosen.append(int(np.argmax(distance)))
        distance = np.minimum(distance, np.linalg.norm(xy - xy[chosen[-1]], axis=1))
    return np.array(chosen)
