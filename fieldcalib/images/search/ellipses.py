"""Detection of ellipses in a picture: stripes are chained to arcs, and ellipses are fitted to one or two of these.

An ellipse is fitted to the stripes of one or two of the longest arcs (Fitzgibbon, Pilu and Fisher, Direct least square
fitting of ellipses, 1999; `cv2.fitEllipseDirect`). If these stripes lie on it, it is fitted again to all stripes that
lie on it and run along it, and kept if they cover enough of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from fieldcalib._types import Array, BoolArray, IntArray
from fieldcalib.images.search.stripes import Stripes

# px: largest distance of linked stripes, and that below which the direction from one to the other is too noisy
LINKED, TOUCHING = 6.0, 1.5
SMOOTH = np.radians(14.0)  # largest angle between two linked stripes, and between each and the link
FEWEST, SHORTEST = 10, 40.0  # stripes of an arc; px from end to end
BENT = 0.01  # rms distance from a straight line, as a share of the length, below which a chain is no arc
ARCS = 20  # longest arcs that are used, alone and in pairs
NEAR, ALONG = 2.5, np.radians(10.0)  # px and angle within which a stripe belongs to an ellipse
OWN = 0.7  # least share of the stripes of an arc that lie on its ellipse
FITS = 2  # fits of an ellipse to all stripes that lie on it
PIECE = 4.0  # px: squares that count once for the length, however many stripes they hold
COVERED = 0.2  # least share of an ellipse on which stripes lie
FLATTEST, LARGEST = 0.06, 2500.0  # least ratio of the shorter axis to the longer one; largest half axis, px
SAME = 0.5  # ellipses that share at least this much of the stripes of one of them are the same


@dataclass(frozen=True)
class Ellipse:
    """An ellipse in a picture, and how much of it shows."""

    centre: tuple[float, float]
    """x and y, pixels."""
    axes: tuple[float, float]
    """Half lengths of the two axes, pixels."""
    turn: float
    """Direction of the first axis, from x towards y, radians."""
    length: float = 0.0
    """Approximate length of the stripes on it, pixels: 4 for each square of 4 x 4 pixels that holds a stripe."""

    def conic(self, origin: Array, unit: float) -> Array:
        """The matrix Q (3, 3) with ``p' Q p = 0`` on the ellipse, for ``p = ((xy - origin) / unit, 1)``.

        Examples
        --------
        >>> Ellipse((7.0, 3.0), (4.0, 2.0), 0.0).conic(np.array([7.0, 3.0]), 2.0).round(2).tolist()
        [[0.25, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]]
        """
        T = np.eye(3)
        T[:2, :2] = unit * self._to_unit_circle
        T[:2, 2] = self._to_unit_circle @ (origin - self.centre)
        return np.asarray(T.T @ np.diag([1.0, 1.0, -1.0]) @ T)

    @property
    def perimeter(self) -> float:
        """Perimeter by Ramanujan's approximation, pixels."""
        a, b = self.axes
        return float(np.pi * (3.0 * (a + b) - np.sqrt((3.0 * a + b) * (a + 3.0 * b))))

    def holds(self, stripes: Stripes) -> BoolArray:
        """Whether each stripe lies on the ellipse and runs along it, (N,)."""
        x, y = stripes.xy[:, 0] - self.centre[0], stripes.xy[:, 1] - self.centre[1]
        reach = max(self.axes) + 2.0 * NEAR
        around = np.flatnonzero((np.abs(x) < reach) & (np.abs(y) < reach))
        # distance to first order, |u^2 + v^2 - 1| / |gradient|, where (u, v) maps the ellipse to the unit circle
        u, v = self._to_unit_circle @ (x[around], y[around])
        across_x, across_y = 2.0 * self._to_unit_circle.T @ (u, v)
        near = np.abs(u * u + v * v - 1.0) < NEAR * np.hypot(across_x, across_y)
        near &= _turn(np.arctan2(across_y, across_x) + 0.5 * np.pi - stripes.angle[around]) < ALONG
        held = np.zeros(len(x), dtype=bool)
        held[around[near]] = True
        return held

    @property
    def _to_unit_circle(self) -> Array:
        """Matrix (2, 2) that takes the ellipse, moved to the origin, to the unit circle."""
        c, s = np.cos(self.turn), np.sin(self.turn)
        return np.asarray(np.array([[c, s], [-s, c]]) / np.array(self.axes)[:, None])


def find_ellipses(stripes: Stripes, most: int) -> tuple[Ellipse, ...]:
    """Find the ellipses with the longest stripes on them, at most `most`, the best supported one first.

    Examples
    --------
    >>> import cv2
    >>> from fieldcalib.images.search.stripes import find_stripes
    >>> picture = np.full((180, 320, 3), 90, np.uint8)
    >>> _ = cv2.ellipse(picture, (150, 90), (90, 40), 0.0, 0.0, 250.0, (200, 200, 200), 4)
    >>> (ellipse,) = find_ellipses(find_stripes(picture), 5)
    >>> np.round(ellipse.centre), np.sort(ellipse.axes).round()
    (array([150.,  90.]), array([40., 90.]))
    """
    arcs = _arcs(stripes)
    found: list[tuple[Ellipse, BoolArray]] = []
    explained: list[set[int]] = []  # indices of the arcs on each ellipse found
    for group in (*combinations(range(len(arcs)), 1), *combinations(range(len(arcs)), 2)):
        if not any(own.issuperset(group) for own in explained):
            for ellipse, on in _grown(stripes, [arcs[k] for k in group]):
                found.append((ellipse, on))
                explained.append({k for k, arc in enumerate(arcs) if np.mean(on[arc]) > OWN})
    found.sort(key=lambda one: -one[0].length)
    return tuple(one for one, _ in _different(found))[:most]


def _arcs(stripes: Stripes) -> list[IntArray]:
    """Stripes of the longest arcs, as indices, the longest arc first."""
    found = []
    for arc in _chains(stripes):
        xy = stripes.xy[arc] - stripes.xy[arc].mean(axis=0)
        across, along = (xy @ np.linalg.eigh(xy.T @ xy)[1]).T
        length = float(np.ptp(along))
        if length > SHORTEST and float(np.std(across)) > BENT * length:
            found.append((length, arc))
    found.sort(key=lambda one: -one[0])
    return [arc for _, arc in found[:ARCS]]


def _chains(stripes: Stripes) -> list[IntArray]:
    """Chains of stripes that follow each other smoothly, if they have enough stripes and length for an arc."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    pairs = cKDTree(stripes.xy).query_pairs(LINKED, output_type="ndarray").reshape(-1, 2)
    first, second = pairs.T
    dx, dy = (stripes.xy[second] - stripes.xy[first]).T
    way, touching = np.arctan2(dy, dx), np.hypot(dx, dy) < TOUCHING
    smooth = _turn(stripes.angle[first] - stripes.angle[second]) < SMOOTH
    # a link must run along both of its stripes, so that parallel lines stay apart; its direction is noise over a pixel
    for one in (first, second):
        smooth &= touching | (_turn(stripes.angle[one] - way) < SMOOTH)
    count = len(stripes.xy)
    links = coo_matrix((np.ones(np.count_nonzero(smooth)), (first[smooth], second[smooth])), shape=(count, count))
    _, member = connected_components(links, directed=False)
    order, size = np.argsort(member, kind="stable"), np.bincount(member)
    first = np.cumsum(size) - size
    xy = stripes.xy[order]
    extent = np.hypot(*(np.maximum.reduceat(xy, first) - np.minimum.reduceat(xy, first)).T)
    long = np.flatnonzero((size >= FEWEST) & (extent > SHORTEST))
    return [order[first[k] : first[k] + size[k]] for k in long]


def _grown(stripes: Stripes, arcs: Sequence[IntArray]) -> list[tuple[Ellipse, BoolArray]]:
    """Fit an ellipse to arcs, then to all stripes on it; returns it and their mask, [] if the arcs are not on one."""
    ellipse = _fitted(stripes.xy[np.concatenate(arcs)])
    if ellipse is None or any(np.mean(ellipse.holds(stripes.take(arc))) < OWN for arc in arcs):
        return []
    for _ in range(FITS):
        ellipse = _fitted(stripes.xy[ellipse.holds(stripes)])
        if ellipse is None:
            return []
    on = ellipse.holds(stripes)
    length = PIECE * len(np.unique(np.floor(stripes.xy[on] / PIECE), axis=0))
    is_seen = length > max(COVERED * ellipse.perimeter, SHORTEST)
    return [(Ellipse(ellipse.centre, ellipse.axes, ellipse.turn, length), on)] if is_seen else []


def _fitted(xy: Array) -> Ellipse | None:
    """Fit an ellipse to pixels (N, 2); None if it is as flat as a line or too large, or there are too few pixels."""
    import cv2

    if len(xy) < FEWEST:
        return None
    middle, scale = xy.mean(axis=0), float(np.ptp(xy))
    (x, y), (a, b), degrees = cv2.fitEllipseDirect(((xy - middle) / scale).astype(np.float32))
    short, long = 0.5 * scale * min(a, b), 0.5 * scale * max(a, b)
    if not np.isfinite(long) or short < FLATTEST * long or long > LARGEST:
        return None
    centre = middle + scale * np.array([x, y])
    return Ellipse(tuple(centre.tolist()), (0.5 * scale * a, 0.5 * scale * b), float(np.radians(degrees)))


def _different(found: Sequence[tuple[Ellipse, BoolArray]]) -> list[tuple[Ellipse, BoolArray]]:
    """Leave out ellipses that share most of their stripes with one before."""
    kept: list[tuple[Ellipse, BoolArray]] = []
    for ellipse, on in found:
        shared = (np.count_nonzero(on & other) / min(on.sum(), other.sum()) for _, other in kept)
        if all(share < SAME for share in shared):
            kept.append((ellipse, on))
    return kept


def _turn(angle: Array) -> Array:
    """Absolute angles between directions of lines, at most 90 degrees."""
    return np.abs(angle - np.pi * np.round(angle / np.pi))
