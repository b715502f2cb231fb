"""Matches of the static background between two frames of a camera.

One on a tripod pans, tilts and zooms: whatever the depth of the scene, a static point moves by the homography
``K2 R2 R1^T K1^-1``, but for the lens. Corners are followed by pyramidal Lucas-Kanade optical flow (Bouguet 2000), and
what moves by one such homography is the background. Players, scrolling boards and graphics do not. For a camera that
moves, the background is the ground alone.

Frames are halved until they are at most `WORKING_WIDTH` wide. Followed over 12 frames of clips of 1080 lines, corners
were 0.22 to 0.66 px of 1280 off the best homography at 960 px, 0.25 to 0.67 at 640 and 0.42 to 0.79 at 480. Clips of
720 lines gain more: the scatter about a turn and zoom with lens is 0.15 px at 1280, 0.23 at 640.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib._types import Array, Float32
from fieldcalib.images.background_motion import (
    LEAST_POINTS,
    RANSAC_TOLERANCE,
    STILL,
    background_motion,
    is_plausible,
    mapped,
    shape_change,
)
from fieldcalib.images.plane_motion import plane_motion
from fieldcalib.io.image import Image

# Lengths are in pixels of the reduced frames, in which everything is done.
WORKING_WIDTH = 1280  # px: 1920 are halved, 1280 are kept; at 640 their residuals are 1.6 times as large
CELLS_ACROSS = 54  # at most one corner in each cell, so that boards, crowd and players do not outnumber the rest
MOST_CORNERS = 400  # of a frame: 800 take twice the time and determine the homography no better than 0.7 times as well
LEAST_CORNER = 3e-5  # smaller eigenvalue (cv2.cornerMinEigenVal, block of 3): less is grass and noise of compression
BORDER = 8  # px: nearer to the border of the picture the window of a corner is cut off
WINDOW = 11  # px of the optical flow; 15 and 21 take 2 and 3 times as long, and their residuals are 0 to 0.1 px smaller
LEVELS = 5  # of the pyramid, where nothing is known of the motion: about 200 px are bridged
LEVELS_PREDICTED = 3  # where it is known to a few pixels
ROUND_TRIP = 0.5  # px: forward and backward, flow must come back
RESTING_SHARE = 0.5  # of the corners must stand still for a camera that is expected to be at rest to be so:
RESTING = 1.0  # px by which the corners of the picture are expected to move
MOVING_SHARE = 0.3  # of the corners must move for the camera to be thought moving, and what stands still a graphic
WARPED_FROM = 0.03  # change of scale, or rotation in radians, from which a frame is warped before flow: windows differ


LEAST_MATCHES = 25
LEAST_SHARE = 0.35  # of the corners that were followed forth and back: the rest are players, boards and errors of flow
LEAST_FOUND = 0.1  # of the corners that should be in view: across a cut hardly any can be followed
LEAST_FOUND_STILL = 0.5  # if they stand still in the picture: of a camera at rest all can be, in a pan graphics only
LEAST_SPREAD = (0.08, 0.015)  # of the width: standard deviation along and across; a scoreboard has 0.05, 0.01
LARGEST_SCALE = (0.5, 0.02)  # px of residuals at rest, and more per px of motion: in a dissolve two motions are mixed
GRID = (8, 6)  # larger cells across and down the picture,
LEAST_CELLS = 6  # so many of which must have matches

SAME_BLOCK = 32  # px: two pictures are the same if no block of that size differs
SAME_PICTURE = 1.0  # by so many grey levels in the mean; neighbouring frames of six clips differ by 4 or more somewhere

SMALLEST_FOR_ORB = 64  # px: of smaller pictures it cannot make a pyramid
ORB_WIDTH = 960  # px: wider frames are halved; far pairs agree in the large, and flow makes them exact
ORB_FEATURES = 1000  # of a frame
ORB_THRESHOLD = 8  # grey levels: the corners of lines on grass are faint
RATIO = 0.8  # of the distances of the best and the second best descriptor


@dataclass(frozen=True, eq=False)
class Matches:
    """Pixels of static points of the scene in two frames."""

    first: Array
    """(n, 2) pixels of the first frame, full size."""
    second: Array
    """(n, 2) pixels of the second."""
    homography: Array
    """(3, 3), from first to second: of the turn and zoom that fit best without a lens, so that pixels are nearly there.

    It is the `start` of the next pair, or a link of a chain. Where there is no match it is about right, not exact.
    """
    share: float
    """Share of the followed corners that are matches; those on graphics do not count."""
    scale: float
    """Robust standard deviation, px of the full size, of a coordinate of `second` about a homography with a lens."""
    duplicate: bool = False
    """Whether the two pictures are the same: the stream repeats a frame, or is frozen."""

    def __len__(self) -> int:
        return len(self.first)

    def reversed(self) -> Matches:
        """From the second frame to the first."""
        back = np.linalg.inv(self.homography)
        return Matches(self.second, self.first, back / back[2, 2], self.share, self.scale, self.duplicate)


@dataclass(frozen=True, eq=False)
class Frame:
    """A frame prepared for matching: reduced, grey; its corners and descriptors are found once, when they are needed.

    Pyramids are built anew for each pair, which takes 0.2 ms: OpenCV's Python functions do not take built ones.

    Examples
    --------
    >>> frame = Frame.of(np.zeros((1080, 1920, 3), np.uint8))
    >>> frame.grey.shape, frame.corners.shape
    ((540, 960), (0, 2))
    """

    grey: Image
    """(height, width), at most `WORKING_WIDTH` wide."""
    image_size: tuple[int, int]
    """Of the picture in full size."""

    @classmethod
    def of(cls, image: Image) -> Frame:
        """Of a uint8 picture, grey (height, width) or (height, width, 3) in blue, green, red.

        Raises
        ------
        ValueError
            If it is no such picture.
        """
        import cv2

        if not isinstance(image, np.ndarray) or image.dtype != np.uint8 or not image.size:
            raise ValueError(f"image must be a uint8 array, got {getattr(image, 'dtype', type(image).__name__)}")
        if image.ndim != 2 and (image.ndim != 3 or image.shape[2] != 3):
            raise ValueError(f"image must be (height, width) or (height, width, 3), got shape {image.shape}")
        height, width = image.shape[:2]
        halvings = max(int(np.ceil(np.log2(width / WORKING_WIDTH))), 0)
        small: Any = image
        if halvings:
            size = (max(width >> halvings, 1), max(height >> halvings, 1))
            small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
        grey = cv2.cvtColor(small, cv2.COLOR_BGR2GRAY) if image.ndim == 3 else small
        return cls(np.asarray(grey, dtype=np.uint8), (width, height))

    @property
    def scale(self) -> Array:
        """(2,) pixels of the full size per pixel of `grey`, across and down."""
        return np.divide(self.image_size, self.grey.shape[::-1])

    @cached_property
    def corners(self) -> Float32:
        """(n, 2) pixels of `grey`: the best corner of each cell, the strongest of them.

        They are sought at half the size, which takes a fifth of the time: flow needs a window with texture, not a peak.
        """
        import cv2

        height, width = self.grey.shape
        half = cv2.resize(self.grey, (max(width // 2, 1), max(height // 2, 1)), interpolation=cv2.INTER_AREA)
        strength = cv2.cornerMinEigenVal(half, 3)
        border = BORDER // 2
        strength[:border] = strength[-border:] = strength[:, :border] = strength[:, -border:] = 0.0
        cell = max(round(strength.shape[1] / CELLS_ACROSS), 1)
        down, across = (side // cell for side in strength.shape)
        cells: Any = strength[: down * cell, : across * cell].reshape(down, cell, across, cell).swapaxes(1, 2)
        cells = cells.reshape(down * across, cell * cell)
        if not len(cells):
            return np.zeros((0, 2), np.float32)
        best = np.argmax(cells, axis=1)
        peak = cells[np.arange(len(cells)), best]
        order = np.argsort(-peak, kind="stable")[:MOST_CORNERS]
        order = order[peak[order] > LEAST_CORNER]
        y, x = np.divmod(order, across) * np.array([[cell]]) + np.divmod(best[order], cell)
        return (2.0 * np.column_stack([x, y]) + 0.5).astype(np.float32)

    @cached_property
    def descriptors(self) -> tuple[Float32, Image]:
        """ORB features: (n, 2) pixels of `grey` and (n, 32) bytes.

        SIFT takes 20 times as long at this size, and AKAZE is in the main modules of OpenCV 4 only.
        """
        import cv2

        if min(self.grey.shape) < SMALLEST_FOR_ORB:
            return np.zeros((0, 2), np.float32), np.zeros((0, 32), np.uint8)
        grey: Any = self.grey
        if grey.shape[1] > ORB_WIDTH:
            grey = cv2.resize(grey, (grey.shape[1] // 2, grey.shape[0] // 2), interpolation=cv2.INTER_AREA)
        found, bits = cv2.ORB.create(ORB_FEATURES, fastThreshold=ORB_THRESHOLD).detectAndCompute(grey, None)
        xy = np.array([feature.pt for feature in found], np.float32).reshape(-1, 2)
        xy = (xy + np.float32(0.5)) * np.float32(self.grey.shape[1] / grey.shape[1]) - np.float32(0.5)
        return xy, np.zeros((0, 32), np.uint8) if bits is None else np.asarray(bits, dtype=np.uint8)


def same_picture(first: Image | Frame, second: Image | Frame) -> bool:
    """Whether two pictures are the same but for compression: no block of either differs.

    Examples
    --------
    >>> image = np.zeros((540, 960), np.uint8)
    >>> moved = image.copy()
    >>> moved[200:240, 300:340] = 60  # a player
    >>> same_picture(image, image), same_picture(image, moved)
    (True, False)
    """
    import cv2

    one, two = _pair(first, second)
    height, width = one.grey.shape
    if cv2.norm(one.grey, two.grey, cv2.NORM_L1) > SAME_PICTURE * one.grey.size:
        return False
    difference = cv2.absdiff(one.grey, two.grey)
    size = (max(width // SAME_BLOCK, 1), max(height // SAME_BLOCK, 1))
    blocks = cv2.resize(difference.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    return bool(np.max(blocks) < SAME_PICTURE)


def match_background(
    first: Image | Frame,
    second: Image | Frame,
    *,
    start: ArrayLike | None = None,
    corners: int = MOST_CORNERS,
    moving: bool = False,
) -> Matches | None:
    """Static points of the scene in two frames of a camera that pans, tilts and zooms.

    Parameters
    ----------
    first, second : (height, width) or (height, width, 3) uint8 arrays, or Frame
        Of one size. A `Frame` keeps what was found in it for its next partner.
    start : (3, 3) array_like, optional
        Homography from first to second, to a few pixels: of the same motion in the pair before, or chained over the
        frames in between. Without it up to about a tenth of the width is bridged.
    corners : int
        How many corners of the first frame are followed, strong and weak ones: the strongest are on players. Time is
        proportional; from one frame of a video to the next, 200 are enough.
    moving : bool
        Whether the camera stands on no tripod: then only what moves as the ground does is static.

    Returns
    -------
    Matches or None
        None if `start` is no turn and zoom of a camera on a tripod, if too few corners could be followed, or if too few
        of them, or on too small a part of the picture, move as a static scene does: a cut, a wipe, blank grass, motion
        blur. `match_far` may then help.

    Raises
    ------
    ValueError
        If the pictures are not of one size or no uint8 pictures.

    Notes
    -----
    Corners are followed forward and backward. If a good part of them moves, those that stand still in the picture are
    on graphics and left out. RANSAC finds the turn and zoom that most of them follow, and Gauss-Newton refines them
    with focal length and lens (`fieldcalib.images.background_motion`). The background is what is nearer to that motion
    than a tolerance, which is measured on the matches themselves.

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
    one, two = _pair(first, second)
    H = None if start is None else _reduced(np.asarray(start, dtype=float), one)
    if H is not None and not is_plausible(H, (one.grey.shape[1], one.grey.shape[0])):
        return None
    return _matched(one, two, H, corners, moving)


def match_far(first: Image | Frame, second: Image | Frame, *, moving: bool = False) -> Matches | None:
    """As `match_background`, for frames with any motion in between: after a fast pan, across a cut, at a zoom.

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

    one, two = _pair(first, second)
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
    for keep in (moved, np.ones(len(x), bool)):  # graphics match best of all: first without what stands still
        motion = motion_of(x[keep], y[keep], np.ones(int(np.sum(keep)), bool), size)
        matches = (
            None
            if motion is None or not is_plausible(motion[0], size)
            else _matched(one, two, motion[0], MOST_CORNERS, moving)
        )
        if matches is not None:
            return matches
    return None


def _pair(first: Image | Frame, second: Image | Frame) -> tuple[Frame, Frame]:
    one = first if isinstance(first, Frame) else Frame.of(first)
    two = second if isinstance(second, Frame) else Frame.of(second)
    if one.image_size != two.image_size:
        raise ValueError(f"frames must be of one size, got {one.image_size} and {two.image_size}")
    return one, two


def _to_full(frame: Frame) -> Array:
    """The affine map (3, 3) from pixels of the reduced frame to the full size; centres of pixels are at integers."""
    (sx, sy), T = frame.scale, np.eye(3)
    T[0, 0], T[1, 1] = sx, sy
    T[:2, 2] = 0.5 * (frame.scale - 1.0)
    return T


def _reduced(H: Array, frame: Frame) -> Array:
    """A homography of pictures in full size as one of reduced pictures."""
    if H.shape != (3, 3) or not np.all(np.isfinite(H)):
        raise ValueError(f"start must be a finite homography, (3, 3), got shape {H.shape}")
    T = _to_full(frame)
    return np.asarray(np.linalg.inv(T) @ H @ T, dtype=np.float64)


def _matched(one: Frame, two: Frame, H: Array | None, corners: int, moving: bool) -> Matches | None:
    """Matches by flow from where H takes the corners; None if they do not look like those of a static scene."""
    x, y, attempts = _followed(one, two, H, corners)
    if len(x) < LEAST_MATCHES:
        return None
    size = (one.grey.shape[1], one.grey.shape[0])
    still = np.linalg.norm(y - x, axis=1) < STILL
    every = np.ones(len(x), bool)
    starts = [~still, every] if np.mean(~still) > MOVING_SHARE else [every]
    if H is not None and np.mean(still) > RESTING_SHARE and _rests(H, size):
        starts.reverse()
    for candidates in starts:
        motion = (plane_motion if moving else background_motion)(x, y, candidates, size)
        if motion is None:
            continue
        H, agree, graphic, scale = motion
        count = int(np.sum(agree))
        if count < LEAST_MATCHES:
            continue
        share = count / max(int(np.sum(~graphic)), 1)
        found = count / max(attempts - int(np.sum(graphic)), 1)
        shift = float(np.median(np.linalg.norm(y[agree] - x[agree], axis=1)))
        least = LEAST_FOUND_STILL if np.mean(still[agree]) > 0.5 else LEAST_FOUND
        fits = scale < LARGEST_SCALE[0] + LARGEST_SCALE[1] * shift
        if fits and share >= LEAST_SHARE and found >= least and _spread(x[agree], size) and is_plausible(H, size):
            T = _to_full(one)
            full = T @ H @ np.linalg.inv(T)
            first, second = (mapped(T, points[agree]) for points in (x, y))
            return Matches(first, second, full / full[2, 2], share, scale * float(one.scale[0]), same_picture(one, two))
    return None


def _followed(one: Frame, two: Frame, H: Array | None, corners: int) -> tuple[Array, Array, int]:
    """Corners of one (n, 2), where they are in two (n, 2), and how many were looked for.

    With a homography that changes scale or direction, the first frame is warped by it, so that windows look alike.
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
    good = inside & (forward[:, 0] > 0) & (backward[:, 0] > 0) & (np.linalg.norm(back - origin, axis=1) < ROUND_TRIP)
    return x[good].astype(float), y[good].astype(float), len(x)


def _spread(xy: Array, size: tuple[int, int]) -> bool:
    """Whether points cover enough of the picture to tell its motion from that of one object."""
    deviation = np.sqrt(np.maximum(np.linalg.eigvalsh(np.cov(xy.T)), 0.0)) / size[0]
    cells = np.unique(np.floor(xy / size * GRID).astype(int), axis=0)
    return bool(deviation[1] > LEAST_SPREAD[0] and deviation[0] > LEAST_SPREAD[1] and len(cells) >= LEAST_CELLS)


def _rests(H: Array, size: tuple[int, int]) -> bool:
    """Whether a motion leaves the corners of the picture where they are."""
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]) * size
    return bool(np.max(np.abs(mapped(H, corners) - corners)) < RESTING)
