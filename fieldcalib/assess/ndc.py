"""The paper's two losses in normalised device coordinates (NDC), in which both axes of the image run from -1 to 1.

"tvcalib" is the loss of the paper's public code: the mean distance over all line pixels plus the mean distance over
all circle pixels, 0 for an absent kind; points and clouds count with the circles. The self-verification threshold tau
belongs to this loss. "eq3" is the printed equation 3: the mean over segments of the mean distance of their pixels.

Distances are Euclidean in these coordinates, so that horizontal and vertical pixels weigh differently. Circles are
point clouds of 128 samples (paper, section "Hyperparameters"), a circle is split into its halves where the field
has them (`fieldcalib.problem.labelled_pixels.split_circles`), and the pixels are undistorted by the lens of the camera.
The paper assumes a camera in the main stand: from the opposite stand the halves are swapped, and from behind a goal the
circle is not split.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Literal, NamedTuple, TypeAlias, get_args

import numpy as np

from fieldcalib._types import Array, IntArray, one_of
from fieldcalib.fields.field import Field, ObjectSegments
from fieldcalib.fields.segments import Segment
from fieldcalib.geometry.camera import Camera
from fieldcalib.problem.evaluation import Evaluation, evaluate_cameras
from fieldcalib.problem.labelled_pixels import Pixels, PixelTable, in_left_half
from fieldcalib.problem.layout import PAN, Layout
from fieldcalib.problem.observations import Observations
from fieldcalib.problem.projection import Projection

NdcLoss: TypeAlias = Literal["tvcalib", "eq3"]
CLOUD_SAMPLES = 128
PIXELS_AT_ONCE = 8192  # with the samples of their circles these take some 10 MB
TINY = 1e-300  # added to the length of a normal: no division by zero
DEPTH_IN_PLANE = 1e-9  # m: the depth at which samples in the plane of the camera are projected


def ndc_loss(
    cameras: Sequence[Camera], object_segments: ObjectSegments, frames: Sequence[Pixels], kind: NdcLoss = "tvcalib"
) -> Array:
    """One of the paper's losses for T frames.

    Parameters
    ----------
    cameras : sequence of T Camera
        One for each frame, of images of one size.
    object_segments : mapping of str to segment
        The calibration object.
    frames : sequence of T dicts of str to (N, 2) array
        Pixels by label, as `check_segments` returns them. Circles are split here.
    kind : {"tvcalib", "eq3"}
        Which loss.

    Returns
    -------
    (T,) array
        The loss of each frame; 0 without pixels.

    Examples
    --------
    >>> from fieldcalib import Camera, soccer
    >>> camera = Camera.from_angles(0.0, 1.3, 0.0, 1500.0, (0.0, 60.0, -15.0), (960, 540))
    >>> line = soccer()["Side line top"].sample(spacing=30.0)
    >>> moved = camera.project(line) + (0.0, 2.7)  # 2.7 of 540 pixels are 0.01 in NDC
    >>> ndc_loss([camera], soccer(), [{"Side line top": moved}]).round(3)
    array([0.01])
    """
    one_of(kind, get_args(NdcLoss), "kind")
    if not cameras:
        return np.zeros(0)
    pixels = PixelTable.of(object_segments, frames)
    return ndc_losses(evaluate_cameras(cameras, object_segments, pixels), object_segments, kind)


def ndc_losses(evaluation: Evaluation, object_segments: ObjectSegments, kind: NdcLoss = "tvcalib") -> Array:
    """`ndc_loss` of T frames at their cameras; the frames have the labels of the object."""
    theta, layout, T = evaluation.theta, evaluation.problem.layout, len(evaluation.theta)
    segments = list(object_segments.values())
    table = _with_halves(object_segments, evaluation.problem.observations, theta[:, PAN])
    is_straight = np.array([segment.is_straight for segment in segments])
    total, count = np.zeros(T), np.zeros(T)
    by_pixel = Projection(theta[table.frame], layout)
    xy = by_pixel.ideal_offset(by_pixel.observed_offset(table.xy[:, None]))[..., 0]
    for is_line, distances in ((True, _line_distances), (False, _cloud_distances)):
        is_own = is_straight[table.label] == is_line
        if not np.any(is_own):
            continue
        seen = _Labels.of(table.take(is_own), xy[:, is_own], segments, theta, layout)
        distance, frame = distances(seen), seen.frame[seen.pair]
        if kind == "eq3":  # the pixels of a segment share a weight of 1
            total += np.bincount(frame, distance / seen.size[seen.pair], minlength=T)
            count += np.bincount(seen.frame, minlength=T)
        else:
            pixels = np.bincount(frame, minlength=T)
            total += np.bincount(frame, distance, minlength=T) / np.maximum(pixels, 1)
    return np.asarray(total / np.maximum(count, 1.0))


class _Labels(NamedTuple):
    """L labels of several frames, with their undistorted pixels one after the other."""

    segments: Sequence[Segment]
    """The segment of each label."""
    frame: IntArray
    """The frame of each label, (L,)."""
    size: IntArray
    """Number of pixels of each label, (L,)."""
    pair: IntArray
    """Index of the label of each pixel, (P,)."""
    xy: Array
    """Ideal offsets of the pixels, (2, P)."""
    cameras: Projection
    """The camera of each label."""
    half_size: Array
    """Pixels for one unit of NDC, (2,)."""

    @classmethod
    def of(cls, table: PixelTable, xy: Array, segments: Sequence[Segment], theta: Array, layout: Layout) -> _Labels:
        """Compute from a table of pixels and their ideal offsets `xy`; `segments` are those of its labels."""
        key, pair, size = np.unique(table.frame * len(segments) + table.label, return_inverse=True, return_counts=True)
        frame, label = np.divmod(key, len(segments))
        cameras, half_size = Projection(theta[frame], layout), np.divide(layout.image_size, 2.0)
        return cls([segments[index] for index in label], frame, size, pair.ravel(), xy, cameras, half_size)


def _with_halves(object_segments: ObjectSegments, observations: Observations, pan: Array) -> PixelTable:
    """Labelled pixels with circles split into the halves of the paper's model, as seen at the pans (T,)."""
    table, number = observations.pixels, {name: index for index, name in enumerate(object_segments)}
    halves = object_segments.halves if isinstance(object_segments, Field) else {}
    label = table.label.copy()
    for circle, names in halves.items():
        left, right, line = (number[name] for name in names)
        own = table.label == number[circle]
        for t in np.unique(table.frame[own]).tolist():
            if np.abs(np.cos(pan[t])) < 0.5:
                continue
            of_frame = table.frame == t
            its = own & of_frame
            is_left = in_left_half(table.xy[its], table.xy[of_frame & (table.label == line)], observations.image_size)
            label[its] = np.where(is_left == (np.cos(pan[t]) > 0.0), left, right)
    return replace(table, label=label)


@lru_cache(maxsize=64)
def cloud_samples(segment: Segment) -> Array:
    """The samples (S, 3) that represent a segment other than a line; an arc has 128, both ends included.

    Examples
    --------
    >>> from fieldcalib import soccer
    >>> cloud_samples(soccer()["Circle left"])[[0, -1]].round(2)  # on the edge of the penalty area
    array([[-36.  ,  -7.31,   0.  ],
           [-36.  ,   7.31,   0.  ]])
    """
    return segment.samples(CLOUD_SAMPLES)


def _line_distances(seen: _Labels) -> Array:
    """NDC distance (P,) of pixels to infinite lines."""
    lines = np.array([line.vectors for line in seen.segments])
    ax, ay, az = seen.cameras.points(lines[:, :1])[..., 0]
    dx, dy, dz = seen.cameras.directions(lines[:, 1:])[..., 0]
    image_lines = np.array([ay * dz - az * dy, az * dx - ax * dz, ax * dy - ay * dx])
    image_lines /= np.hypot(*(image_lines[:2] * seen.half_size[:, None])) + TINY
    lx, ly, lz = image_lines[:, seen.pair]
    return np.asarray(np.abs(lx * seen.xy[0] + ly * seen.xy[1] + lz))


def _cloud_distances(seen: _Labels) -> Array:
    """NDC distance (P,) of pixels to the nearest samples of their segments."""
    samples = [cloud_samples(segment) for segment in seen.segments]
    numbers = np.arange(max(map(len, samples)))  # the last sample is repeated
    hx, hy, hz = seen.cameras.points(np.array([X[np.minimum(numbers, len(X) - 1)] for X in samples]))
    hz = np.where(np.abs(hz) < DEPTH_IN_PLANE, DEPTH_IN_PLANE, hz)
    x, y = hx / hz, hy / hz
    distance = np.empty(len(seen.pair))
    for begin in range(0, len(distance), PIXELS_AT_ONCE):
        some = slice(begin, begin + PIXELS_AT_ONCE)
        pair, xy = seen.pair[some], seen.xy[:, some, None]
        off = (x[pair] - xy[0]) / seen.half_size[0], (y[pair] - xy[1]) / seen.half_size[1]
        distance[some] = np.sqrt(np.min(np.square(off[0]) + np.square(off[1]), axis=-1))
    return distance
