"""Matches of the static background between two frames of a camera.

A camera on a tripod pans, tilts and zooms: apart from lens distortion, a static point moves by the homography
``K2 R2 R1^T K1^-1``, whatever its depth. Corners are followed by pyramidal Lucas-Kanade optical flow (Bouguet 2000),
and the corners that move by one such homography are the background; players, scrolling boards and graphics do not. For
a camera that moves, the background is the ground alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib._types import Array, truth, whole_number
from fieldcalib.geometry.homography import finite_homography
from fieldcalib.images.background.background_motion import (
    LEAST_POINTS,
    RANSAC_TOLERANCE,
    STILL,
    background_motion,
    graphics,
    is_plausible,
    mapped,
    plane_motion,
    shape_change,
)
from fieldcalib.images.background.matching_frame import BORDER, MOST_CORNERS, Frame, pair, same_picture, to_full
from fieldcalib.io.image_files import Image

# Lengths are in pixels of the reduced frames.
WINDOW = 11  # px of the optical flow; 15 and 21 take 2 and 3 times as long, and their residuals are 0 to 0.1 px smaller
LEVELS = 5  # of the pyramid without a predicted motion: displacements up to about 200 px are found
LEVELS_PREDICTED = 3  # of the pyramid with a motion that is predicted to a few pixels
ROUND_TRIP = 0.5  # px: distance to which flow, forward and backward, must come back
RESTING_SHARE = 0.5  # share of corners that stand still above which a camera that is predicted to rest does rest
RESTING = 1.0  # px: a camera is predicted to rest if the corners of the picture are predicted to move less
MOVING_SHARE = 0.3  # if more than this share of the corners move, those that stand still are first taken as graphics
WARPED_FROM = 0.03  # change of log scale, or roll in radians, from which a frame is warped, so that windows are alike

LEAST_MATCHES = 25
LEAST_SHARE = 0.35  # of the corners that were followed forth and back: the rest are players, boards and errors of flow
LEAST_FOUND = 0.1  # share of matches among the corners that should be in view: across a cut there are hardly any
LEAST_FOUND_STILL = 0.5  # the same if matches stand still: a camera at rest finds all corners, a pan only graphics
LEAST_SPREAD = (0.08, 0.015)  # of the width: standard deviation along and across; a scoreboard has 0.05, 0.01
LARGEST_SCALE = (0.5, 0.02)  # scale of residuals: px at rest, and px per px of motion; a dissolve mixes two motions
GRID = (8, 6)  # cells across and down the picture
LEAST_CELLS = 6  # of this grid that must have matches

RATIO = 0.8  # largest ratio of the distances of the best and the second best descriptor


@dataclass(frozen=True, eq=False)
class Matches:
    """Pixels of static points of the scene in two frames."""

    first: Array
    """Pixels of the first frame, full size, (n, 2)."""
    second: Array
    """Pixels of the second frame, full size, (n, 2)."""
    homography: Array
    """Homography (3, 3) from first to second of the best rotation and zoom without lens distortion.

    It serves as the `start` of the next pair, or as a link of a chain. Far from the matches it is only about right.
    """
    share: float
    """Share of the followed corners that are matches; corners on graphics do not count."""
    scale: float
    """Robust standard deviation, px of the full size, of a coordinate of `second` from the motion with a lens."""
    duplicate: bool = False
    """Whether the two pictures are the same: the stream repeats a frame, or is frozen."""

    def __len__(self) -> int:
        return len(self.first)

    def reversed(self) -> Matches:
        """Matches from the second frame to the first."""
        back = np.linalg.inv(self.homography)
        return Matches(self.second, self.first, back / back[2, 2], self.share, self.scale, self.duplicate)


def match_background(
    first: Image | Frame,
    second: Image | Frame,
    *,
    start: ArrayLike | None = None,
    corners: int = MOST_CORNERS,
    moving: bool = False,
) -> Matches | None:
    """Match static points of the scene in two frames of a camera that pans, tilts and zooms.

    Parameters
    ----------
    first, second : (height, width) or (height, width, 3) uint8 arrays, or Frame
        Of one size. A `Frame` keeps its corners and descriptors for the next call.
    start : (3, 3) array_like, optional
        Homography from first to second, to a few pixels: that of the pair before if the motion continues, or chained
        over the frames in between. Without it displacements up to about a tenth of the width are found.
    corners : int
        How many corners of the first frame are followed, strong and weak ones, as the strongest are on players. Time is
        proportional; from one frame of a video to the next, 200 are enough.
    moving : bool
        Whether the camera changes its position: then only points that move as the ground does count as static.

    Returns
    -------
    Matches or None
        None if `start` is not the motion of a camera on a tripod, if too few corners could be followed, or if too few
        of them, or only in a small part of the picture, move as a static scene does. Reasons are a cut, a wipe, blank
        grass or motion blur. `match_far` may then help.

    Raises
    ------
    ValueError
        If the pictures are not of one size or no uint8 pictures.

    Notes
    -----
    Corners are followed forward and backward. If many of them move, those that stand still in the picture are on
    graphics and left out. RANSAC finds the rotation and zoom that most corners follow, and Gauss-Newton refines them
    with focal length and lens (`fieldcalib.images.background.background_motion`). Corners whose distance from this
    motion is below a tolerance, which is measured on the matches themselves, are the background.

    Examples
    --------
    >>> import cv2
    >>> noise = np.random.default_rng(0).integers(0, 255, (68, 120), np.uint8)
    >>> scene = cv2.resize(noise, (960, 540), interpolation=cv2.INTER_CUBIC)
    >>> moved = cv2.warpAffine(scene, np.array([[1.0, 0.0, 9.0], [0.0, 1.0, -4.0]]), (960, 540))
    >>> matches = match_background(scene, moved)
    >>> np.median(matches.second - matches.first, axis=0).round(1)
    array([ 9., -4.])
    >>> match_background(scene, scene[::-1]) is None
    True
    """
    one, two = pair(first, second)
    corners, moving = whole_number(corners, "corners", 1), truth(moving, "moving")
    H = None if start is None else _reduced(finite_homography(start, name="start"), one)
    if H is not None and not is_plausible(H, (one.grey.shape[1], one.grey.shape[0])):
        return None
    return _matched(one, two, H, corners, moving)


def match_far(first: Image | Frame, second: Image | Frame, *, moving: bool = False) -> Matches | None:
    """Match as `match_background` does, but with any motion in between: after a fast pan, across a cut, at a zoom.

    ORB descriptors (Rublee et al., ICCV 2011) with Lowe's ratio test give a homography from which corners are followed.

    Examples
    --------
    >>> import cv2
    >>> noise = np.random.default_rng(0).integers(0, 255, (68, 120), np.uint8)
    >>> scene = cv2.resize(noise, (960, 540), interpolation=cv2.INTER_CUBIC)
    >>> zoomed = cv2.warpAffine(scene, np.array([[1.5, 0.0, -240.0], [0.0, 1.5, -135.0]]), (960, 540))
    >>> match_background(scene, zoomed) is None
    True
    >>> match_far(scene, zoomed).homography.round(1)
    array([[   1.5,    0. , -240. ],
           [   0. ,    1.5, -135. ],
           [   0. ,    0. ,    1. ]])
    """
    import cv2

    one, two, moving = *pair(first, second), truth(moving, "moving")
    (p, a), (q, b) = one.descriptors, two.descriptors
    if min(len(a), len(b)) < LEAST_POINTS:
        return None
    pairs = cv2.BFMatcher(cv2.NORM_HAMMING).knnMatch(a, b, k=2)
    good = [m for m, other in pairs if m.distance < RATIO * other.distance]
    size = (one.grey.shape[1], one.grey.shape[0])
    x = p[[m.queryIdx for m in good]].reshape(-1, 2).astype(float)
    y = q[[m.trainIdx for m in good]].reshape(-1, 2).astype(float)
    moved = np.linalg.norm(y - x, axis=1) > RANSAC_TOLERANCE
    motion_of = plane_motion if moving else background_motion
    for keep in (moved, np.ones(len(x), bool)):  # graphics match best: try first without points that stand still
        motion = motion_of(x[keep], y[keep], np.ones(int(np.sum(keep)), bool), size)
        if motion is not None and is_plausible(motion[0], size):
            matches = _matched(one, two, motion[0], MOST_CORNERS, moving)
            if matches is not None:
                return matches
    return None


def _reduced(H: Array, frame: Frame) -> Array:
    """Convert a homography between pictures of full size to one between reduced pictures."""
    T = to_full(frame.scale)
    return np.asarray(np.linalg.inv(T) @ H @ T, dtype=np.float64)


def _matched(one: Frame, two: Frame, H: Array | None, corners: int, moving: bool) -> Matches | None:
    """Match by optical flow, started at corners mapped by H; None if the result does not look like a static scene."""
    x, y, attempts = _followed(one, two, H, corners)
    if len(x) < LEAST_MATCHES:
        return None
    size = (one.grey.shape[1], one.grey.shape[0])
    still = np.linalg.norm(y - x, axis=1) < STILL
    every = np.ones(len(x), bool)
    starts = [~still, every] if np.mean(~still) > MOVING_SHARE else [every]
    if H is not None and np.mean(still) > RESTING_SHARE and _rests(H, size):
        starts.reverse()
    # static graphics and the background may each look like a motion: the likelier kind of corners is tried first
    for candidates in starts:
        motion = (plane_motion if moving else background_motion)(x, y, candidates, size)
        if motion is None:
            continue
        H, near, scale = motion
        graphic = graphics(H, x, y, scale)
        agree = near & ~graphic
        count = int(np.sum(agree))
        if count < LEAST_MATCHES:
            continue
        share = count / max(int(np.sum(~graphic)), 1)
        found = count / max(attempts - int(np.sum(graphic)), 1)
        shift = float(np.median(np.linalg.norm(y[agree] - x[agree], axis=1)))
        least = LEAST_FOUND_STILL if np.mean(still[agree]) > 0.5 else LEAST_FOUND
        fits = scale < LARGEST_SCALE[0] + LARGEST_SCALE[1] * shift
        if fits and share >= LEAST_SHARE and found >= least and _spread(x[agree], size) and is_plausible(H, size):
            T = to_full(one.scale)
            full = T @ H @ np.linalg.inv(T)
            first, second = (mapped(T, points[agree]) for points in (x, y))
            return Matches(first, second, full / full[2, 2], share, scale * float(one.scale[0]), same_picture(one, two))
    return None


def _followed(one: Frame, two: Frame, H: Array | None, corners: int) -> tuple[Array, Array, int]:
    """Follow corners: pixels (n, 2) in one frame, pixels (n, 2) in the other, and how many were looked for.

    If the predicted homography changes scale or roll, the first frame is warped by it, so that flow windows look alike.
    """
    import cv2

    x = one.corners
    a: Any = one.grey
    x = x[np.linspace(0, len(x), min(corners, len(x)), endpoint=False, dtype=int)]
    height, width = a.shape
    levels = LEVELS if H is None else LEVELS_PREDICTED
    origin = predicted = x
    if H is not None:
        place = mapped(H, x)
        with np.errstate(invalid="ignore"):
            inside = np.all((place >= BORDER) & (place < np.subtract((width, height), BORDER)), axis=1)
        x, predicted = x[inside], place[inside].astype(np.float32)
        origin = x
        zoom, roll, _ = shape_change(H, (width, height))
        if max(abs(np.log(zoom)), abs(roll)) > WARPED_FROM:
            a = cv2.warpPerspective(a, H, (width, height), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            origin = predicted
    if not len(x):
        return np.zeros((0, 2)), np.zeros((0, 2)), 0
    how: dict[str, Any] = {"winSize": (WINDOW, WINDOW), "maxLevel": levels, "flags": cv2.OPTFLOW_USE_INITIAL_FLOW}
    y, forward, _ = cv2.calcOpticalFlowPyrLK(a, two.grey, origin, predicted.copy(), **how)
    back, backward, _ = cv2.calcOpticalFlowPyrLK(two.grey, a, y, y - (predicted - origin), **how)
    inside = np.all((y >= 0) & (y < (width, height)), axis=1)
    # a corner is followed only if the flow back from its place in the other frame returns to it
    good = inside & (forward[:, 0] > 0) & (backward[:, 0] > 0) & (np.linalg.norm(back - origin, axis=1) < ROUND_TRIP)
    return x[good].astype(float), y[good].astype(float), len(x)


def _spread(xy: Array, size: tuple[int, int]) -> bool:
    """Whether points cover enough of the picture to tell its motion from that of one object."""
    x, y = (xy - np.mean(xy, axis=0)).T
    deviation = np.sqrt(np.linalg.eigvalsh([[x @ x, x @ y], [x @ y, y @ y]]).clip(0.0) / (len(xy) - 1)) / size[0]
    column, row = np.floor(xy / size * GRID).T
    cells = np.unique(row * GRID[0] + column)
    return bool(deviation[1] > LEAST_SPREAD[0] and deviation[0] > LEAST_SPREAD[1] and len(cells) >= LEAST_CELLS)


def _rests(H: Array, size: tuple[int, int]) -> bool:
    """Whether a motion leaves the corners of the picture where they are."""
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]) * size
    return bool(np.max(np.abs(mapped(H, corners) - corners)) < RESTING)
