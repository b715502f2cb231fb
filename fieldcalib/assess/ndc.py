"""The paper's two losses, in normalised device coordinates: both axes of the image run from -1 to 1.

"tvcalib" is what the paper's public code computes: the mean distance over all line pixels plus the mean distance over
all circle pixels, an absent kind counting 0; points and clouds count with the circles. The self-verification threshold
tau belongs to this one. "eq3" is the printed equation 3: the mean over segments of the mean distance of their pixels.

Distances are Euclidean in these coordinates, so that horizontal and vertical pixels weigh differently. Circles are
point clouds of 128 samples (paper, section "Hyperparameters"), the centre circle is split into its halves
(`fieldcalib.problem.labelled_pixels.split_centre_circle`), and a known lens is taken out of the observed pixels. The
paper has the main stand in mind: from the opposite one the halves change sides, and from behind a goal the circle stays
whole.
"""

from __future__ import annotations

from typing import Literal, TypeAlias, get_args

import numpy as np

from fieldcalib._types import Array, BoolArray
from fieldcalib.fields.segments import Arc, Line, ObjectSegments, PointCloud, Segment
from fieldcalib.problem.labelled_pixels import Pixels, padded_chunks, split_centre_circle
from fieldcalib.problem.observations import Rows, pack
from fieldcalib.problem.parameters import PAN
from fieldcalib.problem.residuals import View

NdcLoss: TypeAlias = Literal["tvcalib", "eq3"]
CLOUD_SAMPLES = 128
CHUNK_PIXELS = 8192  # of the frames of an array, padding included: with the samples of their circles they take 70 MB


def ndc_loss(
    theta: Array,
    object_segments: ObjectSegments,
    frames: list[Pixels],
    image_size: tuple[int, int],
    kind: NdcLoss = "tvcalib",
) -> Array:
    """One of the paper's losses for T frames.

    Parameters
    ----------
    theta : (T, 12) array
        A camera for each frame.
    object_segments : mapping of str to segment
        The calibration object.
    frames : list of T dicts of str to (N, 2) array
        Pixels by label, as `check_segments` returns them. The centre circle is split here.
    image_size : (int, int)
        Width and height in pixels.
    kind : {"tvcalib", "eq3"}
        Which loss.

    Returns
    -------
    (T,) array
        0 for a frame without pixels.

    Examples
    --------
    >>> from fieldcalib import Camera, soccer
    >>> from fieldcalib.problem.parameters import theta_from_camera
    >>> camera = Camera.from_angles(0.0, 1.3, 0.0, 1500.0, (0.0, 60.0, -15.0), (960, 540))
    >>> line = soccer()["Side line top"].sample(spacing=30.0)
    >>> moved = camera.project(line) + (0.0, 2.7)  # 2.7 of 540 pixels are 0.01 in NDC
    >>> ndc_loss(theta_from_camera(camera)[None], soccer(), [{"Side line top": moved}], (960, 540)).round(3)
    array([0.01])
    """
    if kind not in get_args(NdcLoss):
        raise ValueError(f"kind must be one of {', '.join(get_args(NdcLoss))}, got {kind!r}")
    losses = np.zeros(len(frames))
    for chunk in padded_chunks([sum(map(len, frame.values())) for frame in frames], CHUNK_PIXELS):
        losses[chunk] = _ndc_loss(theta[chunk], object_segments, [frames[t] for t in chunk], image_size, kind)
    return losses


def _ndc_loss(
    theta: Array, object_segments: ObjectSegments, frames: list[Pixels], image_size: tuple[int, int], kind: NdcLoss
) -> Array:
    """`ndc_loss` of frames whose padded arrays fit into memory together."""
    split = [_halves(frame, image_size, pan) for frame, pan in zip(frames, theta[:, PAN], strict=True)]
    seen = {label: object_segments[label] for frame in split for label in frame}
    samples = {label: s if isinstance(s, Line) else cloud(s) for label, s in seen.items()}
    observations = pack(samples, split, image_size)

    view = View(theta, image_size)
    half_size = np.array(image_size) / 2.0
    lines = _line_distances(view, observations.lines, half_size)
    circles = _cloud_distances(view, observations.clouds, half_size)
    weights = observations.lines.weight, observations.clouds.weight
    if kind == "eq3":  # the pixels of a segment share a weight of 1
        segments = np.sum(weights[0], axis=1) + np.sum(weights[1], axis=1)
        total = np.sum(lines * weights[0], axis=1) + np.sum(circles * weights[1], axis=1)
        return np.asarray(total / np.maximum(segments, 1.0))
    return _mean(lines, weights[0] > 0.0) + _mean(circles, weights[1] > 0.0)


def _halves(frame: Pixels, image_size: tuple[int, int], pan: float) -> Pixels:
    """The frame with its centre circle split as a camera of this pan sees it."""
    if "Circle central" not in frame or np.abs(np.cos(pan)) < 0.5:
        return frame
    split = split_centre_circle(frame, image_size)
    if np.cos(pan) > 0.0:
        return split
    swapped = {"Circle central left": "Circle central right", "Circle central right": "Circle central left"}
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


def _line_distances(view: View, rows: Rows, half_size: Array) -> Array:
    """NDC distance (T, N) of undistorted pixels to infinite lines."""
    (ax, ay, az), (dx, dy, dz) = view.points(rows.geometry[:, :, 0]), view.directions(rows.geometry[:, :, 1])
    lx, ly, lz = ay * dz - az * dy, az * dx - ax * dz, ax * dy - ay * dx
    px, py = view.ideal_offset(view.observed_offset(rows.xy))
    return np.asarray(np.abs(lx * px + ly * py + lz) / (np.hypot(lx * half_size[0], ly * half_size[1]) + 1e-300))


def _cloud_distances(view: View, rows: Rows, half_size: Array) -> Array:
    """NDC distance (T, N) of undistorted pixels to the nearest sample of their clouds."""
    T, N, S, _ = rows.geometry.shape
    if N == 0:
        return np.zeros((T, 0))
    hx, hy, hz = (h.reshape(T, N, S) for h in view.points(rows.geometry.reshape(T, N * S, 3)))
    px, py = view.ideal_offset(view.observed_offset(rows.xy))
    hz = np.where(np.abs(hz) < 1e-9, 1e-9, hz)  # a sample in the camera's plane
    x, y = (hx / hz - px[..., None]) / half_size[0], (hy / hz - py[..., None]) / half_size[1]
    return np.asarray(np.sqrt(np.min(np.square(x) + np.square(y), axis=-1)))


def _mean(distance: Array, seen: BoolArray) -> Array:
    """Mean over the pixels that are not padding, (T,)."""
    return np.asarray(np.sum(distance * seen, axis=1) / np.maximum(np.sum(seen, axis=1), 1))
