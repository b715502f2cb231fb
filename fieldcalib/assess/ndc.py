"""The paper's two losses, in normalised device coordinates: both axes of the image run from -1 to 1.

"tvcalib" is what the paper's public code computes: the mean distance over all line pixels plus the mean distance over
all circle pixels, an absent kind counting 0; points and clouds count with the circles. The self-verification threshold
tau belongs to this one. "eq3" is the printed equation 3: the mean over segments of the mean distance of their pixels.

Distances are Euclidean in these coordinates, so that horizontal and vertical pixels weigh differently. Circles are
point clouds of 128 samples (paper, section "Hyperparameters"), a circle is split into its halves where the field
has them (`fieldcalib.problem.labelled_pixels.split_circles`), and a known lens is taken out of the observed pixels. The
paper has the main stand in mind: from the opposite one the halves change sides, and from behind a goal the circle stays
whole.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, TypeAlias, get_args

import numpy as np

from fieldcalib._types import Array, BoolArray
from fieldcalib.fields.field import Field
from fieldcalib.fields.segments import Arc, Line, ObjectSegments, PointCloud, Segment
from fieldcalib.geometry.camera import Camera
from fieldcalib.problem.labelled_pixels import Pixels, padded_chunks, split_circles
from fieldcalib.problem.layout import PAN, Layout
from fieldcalib.problem.observations import Rows, pack
from fieldcalib.problem.projection import Projection

NdcLoss: TypeAlias = Literal["tvcalib", "eq3"]
CLOUD_SAMPLES = 128
CHUNK_PIXELS = 8192  # of the frames of an array, padding included: with the samples of their circles they take 70 MB


def ndc_loss(
    cameras: Sequence[Camera],
    object_segments: ObjectSegments,
    frames: Sequence[Pixels],
    kind: NdcLoss = "tvcalib",
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
        0 for a frame without pixels.

    Examples
    --------
    >>> from fieldcalib import Camera, soccer
    >>> camera = Camera.from_angles(0.0, 1.3, 0.0, 1500.0, (0.0, 60.0, -15.0), (960, 540))
    >>> line = soccer()["Side line top"].sample(spacing=30.0)
    >>> moved = camera.project(line) + (0.0, 2.7)  # 2.7 of 540 pixels are 0.01 in NDC
    >>> ndc_loss([camera], soccer(), [{"Side line top": moved}]).round(3)
    array([0.01])
    """
    if kind not in get_args(NdcLoss):
        raise ValueError(f"kind must be one of {', '.join(get_args(NdcLoss))}, got {kind!r}")
    losses = np.zeros(len(frames))
    for chunk in padded_chunks([sum(map(len, frame.values())) for frame in frames], CHUNK_PIXELS):
        some = [cameras[t] for t in chunk], [frames[t] for t in chunk]
        losses[chunk] = _ndc_loss(*some, object_segments, kind)
    return losses


def _ndc_loss(
    cameras: Sequence[Camera], frames: Sequence[Pixels], object_segments: ObjectSegments, kind: NdcLoss
) -> Array:
    """`ndc_loss` of frames whose padded arrays fit into memory together."""
    image_size = cameras[0].image_size
    layout = Layout.of(image_size, max((camera.lens for camera in cameras), key=lambda lens: len(lens.names)))
    theta = np.array([layout.theta(camera) for camera in cameras])
    split = [_halves(object_segments, frame, image_size, pan) for frame, pan in zip(frames, theta[:, PAN], strict=True)]
    seen = {label: object_segments[label] for frame in split for label in frame}
    samples = {label: s if isinstance(s, Line) else cloud(s) for label, s in seen.items()}
    observations = pack(samples, split, image_size)

    projection = Projection(theta, layout)
    half_size = np.array(image_size) / 2.0
    lines = _line_distances(projection, observations.lines, half_size)
    circles = _cloud_distances(projection, observations.clouds, half_size)
    weights = observations.lines.weight, observations.clouds.weight
    if kind == "eq3":  # the pixels of a segment share a weight of 1
        segments = np.sum(weights[0], axis=1) + np.sum(weights[1], axis=1)
        total = np.sum(lines * weights[0], axis=1) + np.sum(circles * weights[1], axis=1)
        return np.asarray(total / np.maximum(segments, 1.0))
    return _mean(lines, weights[0] > 0.0) + _mean(circles, weights[1] > 0.0)


def _halves(object_segments: ObjectSegments, frame: Pixels, image_size: tuple[int, int], pan: float) -> Pixels:
    """The frame with its circles split as a camera of this pan sees them."""
    halves = object_segments.halves if isinstance(object_segments, Field) else {}
    if not halves.keys() & frame.keys() or np.abs(np.cos(pan)) < 0.5:
        return frame
    split = split_circles(object_segments, frame, image_size)
    if np.cos(pan) > 0.0:
        return split
    swapped = {half: other for left, right, _ in halves.values() for half, other in ((left, right), (right, left))}
    return {swapped.get(label, label): xy for label, xy in split.items()}


def cloud(segment: Segment) -> PointCloud:
    """The samples that the paper compares a segment with if it is no line: of an arc 128, both ends included.

    Examples
    --------
    >>> from fieldcalib import soccer
    >>> cloud(soccer()["Circle left"]).X[[0, -1]].round(2)  # on the edge of the penalty area
    array([[-36.  ,  -7.31,   0.  ],
           [-36.  ,   7.31,   0.  ]])
    """
    if isinstance(segment, Arc):
        phi = np.linspace(segment.start, segment.stop, CLOUD_SAMPLES)[:, None]
        X = segment.center + segment.radius * (np.cos(phi) * segment.u + np.sin(phi) * segment.v)
    else:
        X = segment.sample()
    return PointCloud(tuple(map(tuple, X.tolist())))


def _line_distances(projection: Projection, rows: Rows, half_size: Array) -> Array:
    """NDC distance (T, N) of undistorted pixels to infinite lines."""
    (ax, ay, az), (dx, dy, dz) = (
        projection.points(rows.geometry[:, :, 0]),
        projection.directions(rows.geometry[:, :, 1]),
    )
    lx, ly, lz = ay * dz - az * dy, az * dx - ax * dz, ax * dy - ay * dx
    px, py = projection.ideal_offset(projection.observed_offset(rows.xy))
    return np.asarray(np.abs(lx * px + ly * py + lz) / (np.hypot(lx * half_size[0], ly * half_size[1]) + 1e-300))


def _cloud_distances(projection: Projection, rows: Rows, half_size: Array) -> Array:
    """NDC distance (T, N) of undistorted pixels to the nearest sample of their clouds."""
    T, N, S, _ = rows.geometry.shape
    if N == 0:
        return np.zeros((T, 0))
    hx, hy, hz = (h.reshape(T, N, S) for h in projection.points(rows.geometry.reshape(T, N * S, 3)))
    px, py = projection.ideal_offset(projection.observed_offset(rows.xy))
    hz = np.where(np.abs(hz) < 1e-9, 1e-9, hz)  # a sample in the camera's plane
    x, y = (hx / hz - px[..., None]) / half_size[0], (hy / hz - py[..., None]) / half_size[1]
    return np.asarray(np.sqrt(np.min(np.square(x) + np.square(y), axis=-1)))


def _mean(distance: Array, seen: BoolArray) -> Array:
    """Mean over the pixels that are not padding, (T,)."""
    return np.asarray(np.sum(distance * seen, axis=1) / np.maximum(np.sum(seen, axis=1), 1))
