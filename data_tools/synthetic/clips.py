"""Labelled pixels and background matches along paths of cameras (`data_tools.synthetic.paths`), without pictures."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from data_tools.random_frames import RandomFrame, mislabelled
from data_tools.simulated import observe
from fieldcalib._types import Array, BoolArray
from fieldcalib.fields.field import Field
from fieldcalib.geometry.camera import Camera
from fieldcalib.geometry.homography import homogenize

PIXELS_PER_LINE = (3, 3)  # least and most
MATCH_NOISE = 0.3  # px at 1920 x 1080: residual of optical flow between frames of a measured sequence
OUTLIER_REACH = 40.0  # px: largest error of an outlier in x and y: flow that follows a player or a scrolling board
DISTANCES = (60.0, 200.0)  # m: of static points from the camera


@dataclass(frozen=True, eq=False)
class Match:
    """Pixels of the same static points in two frames of a clip."""

    first: int
    second: int
    xy_first: Array
    """(N, 2)."""
    xy_second: Array
    """(N, 2)."""
    right: BoolArray
    """(N,): False for outliers."""


def labelled(
    cameras: Iterable[Camera],
    field: Field,
    rng: np.random.Generator,
    noise: float = 1.0,
    *,
    wrong_share: float = 0.0,
    empty_share: float = 0.0,
) -> list[RandomFrame]:
    """Labelled pixels of the markings in view, frame by frame.

    Parameters
    ----------
    cameras, field, rng, noise
        As in `data_tools.simulated.observe`.
    wrong_share : float
        Share of the frames with a mislabelled segment (`data_tools.random_frames.mislabelled`).
    empty_share : float
        Share of the frames without labels.

    Examples
    --------
    >>> from fieldcalib.fields.sports.soccer import soccer
    >>> from data_tools.synthetic.paths import camera_path
    >>> rng = np.random.default_rng(0)
    >>> frames = labelled(camera_path(rng, 20), soccer(), rng, empty_share=0.5)
    >>> sum(not frame.pixels for frame in frames)
    10
    """
    made = []
    for camera in cameras:
        pixels = observe(camera, field, rng, noise, PIXELS_PER_LINE)
        wrong, empty = rng.random(2) < (wrong_share, empty_share)
        made.append(RandomFrame(camera, *mislabelled({} if empty else pixels, field, int(wrong), rng)))
    return made


def background_points(cameras: Sequence[Camera], count: int, rng: np.random.Generator) -> Array:
    """Static points (count, 3) that the cameras of one tripod see: on stands and boards, and on the ground before them.

    They are spread evenly over the pan. Distances from the camera are log-uniform within `DISTANCES`; a ray that meets
    the ground earlier ends there.
    """
    pans = np.array([camera.angles[0] for camera in cameras])
    nearest = np.abs(pans - rng.uniform(pans.min(), pans.max(), size=(count, 1))).argmin(axis=1)
    X = np.empty((count, 3))
    for index, frame in enumerate(nearest):
        camera = cameras[frame]
        ray = homogenize(camera.normalized(rng.uniform(0.0, np.array(camera.image_size) - 1.0))) @ camera.R
        ray /= np.linalg.norm(ray)
        to_ground = -camera.C[2] / ray[2] if ray[2] > 0.0 else np.inf
        X[index] = camera.C + min(np.exp(rng.uniform(*np.log(DISTANCES))), to_ground) * ray
    return X


def background_matches(
    cameras: Sequence[Camera],
    pairs: Iterable[tuple[int, int]],
    points: Array,
    rng: np.random.Generator,
    noise: float = MATCH_NOISE,
    outlier_share: float = 0.0,
) -> list[Match]:
    """Matches between pairs of frames, of the static points in view of both.

    Parameters
    ----------
    cameras : sequence of Camera
    pairs : iterable of (int, int)
        Indices of frames.
    points : (N, 3) array
        As `background_points` makes them.
    rng : numpy.random.Generator
    noise : float
        Standard deviation in pixels of x and of y in the second frame. Pixels of the first frame are exact: they define
        the feature that is tracked.
    outlier_share : float
        Share of the matches that are outliers: uniform within `OUTLIER_REACH` of the point, in x and y.

    Returns
    -------
    list of Match
        One for each pair, in their order; without points if none is in view of both.
    """
    made = []
    for first, second in pairs:
        xy = np.stack([cameras[index].project(points) for index in (first, second)])
        largest = [[np.subtract(cameras[index].image_size, 1.0)] for index in (first, second)]
        a, b = xy[:, np.all((xy >= 0.0) & (xy <= largest), axis=(0, 2))]  # false for NaN
        right = rng.random(len(a)) >= outlier_share
        off = np.where(right[:, None], rng.normal(0.0, noise, a.shape), rng.uniform(-1.0, 1.0, a.shape) * OUTLIER_REACH)
        made.append(Match(first, second, a, b + off, right))
    return made
