"""The paper's point selection: a few pixels of the skeleton of every class mask."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fieldcalib._types import Array, Float32, IntArray
from fieldcalib.fields.segments import ObjectSegments
from fieldcalib.localize.network_grid import BACKGROUND, Localization, check_classes, image_from_grid
from fieldcalib.problem.labelled_pixels import split_circles

POINTS_PER_LINE, POINTS_PER_CIRCLE = 4, 8
LEAST_PIXELS = 4  # of a mask: smaller ones are noise


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
