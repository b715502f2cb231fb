"""The field as SoccerNet's evaluation draws it: one polyline for each segment that comes into the image.

A segment is sampled, samples outside the image are dropped, and the crossing with the border is added where it leaves
or enters the image. The points before an exit and after the next entry are joined by a straight piece.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fieldcalib._types import Array, BoolArray, IntArray
from fieldcalib.fields.ground import Terrain
from fieldcalib.fields.segments import Segment
from fieldcalib.metrics.views import Prediction, project_as_soccernet

LINE_SPACING, CIRCLE_SPACING = 0.9, 0.2  # m, as in SoccerNet's evaluation


class Samples(NamedTuple):
    """Points of several segments, one after the other."""

    X: Array
    """(M, 3), metres."""
    label: IntArray
    """Index of each point's segment, (M,), ascending."""


def sample_segments(segments: Mapping[str, Segment], terrain: Terrain | None = None) -> Samples:
    """Points of segments as SoccerNet's evaluation samples them.

    Lines every 0.9 m from their start, with a longer last piece; arcs every 0.2 m, without closing whole circles. They
    are moved up with ground that is not level.

    Examples
    --------
    >>> from fieldcalib import Line
    >>> sample_segments({"post": Line((0, 0, -2.44), (0, 0, 0))}).X[:, 2].round(2) + 0.0
    array([-2.44, -1.54,  0.  ])
    """
    X = [segment.evaluated(LINE_SPACING, CIRCLE_SPACING) for segment in segments.values()]
    points, label = np.concatenate(X), np.repeat(np.arange(len(X)), [len(part) for part in X])
    return Samples(points if terrain is None else terrain.raised(points), label)


@dataclass(frozen=True)
class Polylines:
    """The polylines of F frames and L labels, their points one after the other."""

    xy: Array
    """(P, 2), pixels."""
    count: IntArray
    """Points of each polyline, (F, L); 0 where the segment is not in the image."""

    @property
    def begin(self) -> IntArray:
        """Index of the first point of each polyline, (F, L)."""
        return (np.cumsum(self.count) - self.count.ravel()).reshape(self.count.shape)


def project_segments(predictions: Sequence[Prediction], samples: Samples, image_size: tuple[int, int]) -> Polylines:
    """The sampled segments in the images of F predictions, as SoccerNet's evaluation draws them."""
    xy, visible = project_as_soccernet(predictions, samples.X)
    frame, sample = np.nonzero(visible)
    xy = xy[frame, sample]
    label = samples.label[sample]
    inside = np.all((xy >= 0.0) & (xy < image_size), axis=1)

    follows = np.zeros(len(xy), dtype=bool)  # whether the previous point belongs to the same polyline
    follows[1:] = (frame[1:] == frame[:-1]) & (label[1:] == label[:-1])
    was_inside = np.roll(inside, 1) & follows
    # an entry without a previous visible point has no crossing with the border
    entry = np.flatnonzero(inside & ~was_inside & follows)
    leave = np.flatnonzero(~inside & was_inside)

    # two points for each sample: the entry, and the sample itself or the exit
    points, kept = np.empty((len(xy), 2, 2)), np.zeros((len(xy), 2), dtype=bool)
    points[:, 1], kept[:, 1] = xy, inside
    for place, index in ((0, entry), (1, leave)):
        points[index, place], kept[index, place] = _border_crossings(xy[index], xy[index - 1], image_size)
    labels = int(samples.label[-1]) + 1
    polyline = np.repeat(frame * labels + label, 2)[kept.ravel()]
    count = np.bincount(polyline, minlength=len(predictions) * labels)
    return Polylines(points[kept], count.reshape(len(predictions), labels))


def _border_crossings(xy: Array, before: Array, image_size: tuple[int, int]) -> tuple[Array, BoolArray]:
    """Crossings of lines through two points (N, 2) with the image's border nearest to the first, and which exist."""
    width, height = image_size
    (x, y), (x0, y0) = xy.T, before.T
    a, b, c = y - y0, x0 - x, x * y0 - y * x0  # the line a x + b y + c = 0
    with np.errstate(all="ignore"):
        crossings = np.stack(
            [np.stack([np.full_like(x, side), -(a * side + c) / b], axis=-1) for side in (0.0, width - 1.0)]
            + [np.stack([-(b * side + c) / a, np.full_like(y, side)], axis=-1) for side in (0.0, height - 1.0)],
            axis=1,
        )
        distance = np.linalg.norm(crossings - xy[:, None], axis=-1)
        inside = np.all((crossings >= 0.0) & (crossings < image_size), axis=-1)
    nearest = np.argmin(np.where(inside, distance, np.inf), axis=1)
    return crossings[np.arange(len(xy)), nearest], inside.any(axis=1)


def distances_to_polylines(xy: Array, polylines: Polylines, index: IntArray) -> Array:
    """Distance of each pixel (N, 2) to one of the polylines.

    Parameters
    ----------
    xy : (N, 2) array
    polylines : Polylines
    index : (N,) int array
        Flat index of each pixel's polyline, frame * L + label; it must not be empty.

    Returns
    -------
    (N,) array
        Pixels.
    """
    if not len(xy):
        return np.zeros(0)
    count = polylines.count.ravel()[index]
    pieces = np.maximum(count - 1, 1)  # a single point is a piece of length zero
    first = np.cumsum(pieces) - pieces
    start = np.repeat(polylines.begin.ravel()[index] - first, pieces) + np.arange(pieces.sum())
    origin, end = polylines.xy[start], polylines.xy[start + np.repeat(count > 1, pieces)]
    offset, along = np.repeat(xy, pieces, axis=0) - origin, end - origin
    share = np.einsum("ij,ij->i", offset, along) / np.maximum(np.einsum("ij,ij->i", along, along), 1e-300)
    offset -= np.clip(share, 0.0, 1.0)[:, None] * along
    return np.sqrt(np.minimum.reduceat(np.einsum("ij,ij->i", offset, offset), first))
