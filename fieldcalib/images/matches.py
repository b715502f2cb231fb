"""Matches of the static background between two frames of a camera on a tripod.

Such a camera pans, tilts and zooms: whatever the depth of the scene, a static point moves by the homography
``K2 R2 R1^T K1^-1``, but for the lens. Corners are followed by pyramidal Lucas-Kanade optical flow (Bouguet 2000), and
what moves by one such homography is the background. Players, scrolling boards and graphics do not.

Frames are halved until they are at most `WORKING_WIDTH` wide. Followed over 12 frames of clips of 1080 lines, corners
were 0.22 to 0.66 px of 1280 off the best homography at 960 px, 0.25 to 0.67 at 640 and 0.42 to 0.79 at 480. Clips of
720 lines gain more: the scatter about a turn and zoom with lens is 0.15 px at 1280, 0.23 at 640.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib._types import Array, BoolArray, Float32
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
STILL = 0.3  # px: what moves less stands still in the picture; flow of static graphics scatters by 0.05 to 0.1
MOVING_SHARE = 0.3  # of the corners must move for the camera to be thought moving, and what stands still a graphic
WARPED_FROM = 0.03  # change of scale, or rotation in radians, from which a frame is warped before flow: windows differ

RANSAC_TOLERANCE = 3.0  # px: lens and perspective make a similarity wrong by that much
RANSAC_ITERATIONS = 1000  # at most; two points make a similarity: with a third of them right, 60 find it in 99.9 %
TOLERANCE = (0.3, 2.0)  # px: what is nearer to the motion of the background always belongs to it, what is farther never
TOLERANCE_IN_SCALES = 4.0  # in between: in robust standard deviations
ITERATIONS = 6  # of the fit, at most,
PLAIN_ITERATIONS = 3  # of the fit without lens, from that with it
PLAIN_POINTS = 100  # about so many points are enough for that
CONVERGED = 0.02  # relative change of the scale of the residuals that ends the fit
FIXED_ITERATIONS = 2  # the first of them on the inliers of MAGSAC: the motion begins as that in the middle only
PRIOR_NOISE = 1.0  # px of a coordinate, against the priors: errors of flow are correlated over the picture
FOCAL_PRIOR = (1.25, 0.6)  # log of focal length over half the diagonal: twice the width; and deviation
FOCAL_GUESSES = (1.25, 0.7, 1.8)  # of the same, with which a motion is sought
ENOUGH = 0.6  # of the points: more need not agree for the next guess to be spared
LARGEST_STEP = 0.4  # of the logs of focal length and zoom in one iteration; below 0.5, where the formula ends
LARGEST_LENS = 0.4  # relative displacement of the corner: beyond, U folds back
LENS_PRIOR = (
    0.03,
    0.05,
)  # displacement of the corner by the lens (relative): broadcast cameras have 0.028 in the median

LEAST_MATCHES = 25
LEAST_SHARE = 0.35  # of the corners that were followed forth and back: the rest are players, boards and errors of flow
LEAST_FOUND = 0.1  # of the corners that should be in view: across a cut hardly any can be followed
LEAST_FOUND_STILL = 0.5  # if they stand still in the picture: of a camera at rest all can be, in a pan graphics only
LEAST_SPREAD = (0.08, 0.015)  # of the width: standard deviation along and across; a scoreboard has 0.05, 0.01
LARGEST_SCALE = (0.5, 0.02)  # px of residuals at rest, and more per px of motion: in a dissolve two motions are mixed
GRID = (8, 6)  # larger cells across and down the picture,
LEAST_CELLS = 6  # so many of which must have matches
LARGEST_ZOOM = 6.0  # between two frames
LARGEST_ROLL = 0.35  # radians between two frames: a camera on a tripod stays upright
LARGEST_STRETCH = 1.5  # ratio of the scales in two directions, in the middle of the picture

SAME_BLOCK = 32  # px: two pictures are the same if no block of that size differs
SAME_PICTURE = 1.0  # by so many grey levels in the mean; neighbouring frames of six clips differ by 4 or more somewhere

SMALLEST_FOR_ORB = 64  # px: of smaller pictures it cannot make a pyramid
ORB_WIDTH = 960  # px: wider frames are halved; far pairs agree in the large, and flow makes them exact
ORB_FEATURES = 1000  # of a frame
ORB_THRESHOLD = 8  # grey levels: the corners of lines on grass are faint
RATIO = 0.8  # of the distances of the best and the second best descriptor
LEAST_DESCRIPTORS = 12  # that agree on a homography


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
    first: Image | Frame, second: Image | Frame, *, start: ArrayLike | None = None, corners: int = MOST_CORNERS
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
    on graphics and left out. RANSAC finds the turn and zoom that most of them follow (`_consensus`), and Gauss-Newton
    refines them with focal length and lens (`_refined`). The background is what is nearer to that motion than a
    tolerance, which is measured on the matches themselves.

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
    if H is not None and not _plausible(H, (one.grey.shape[1], one.grey.shape[0])):
        return None
    return _matched(one, two, H, corners)


def match_far(first: Image | Frame, second: Image | Frame) -> Matches | None:
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
    if min(len(a), len(b)) < LEAST_DESCRIPTORS:
        return None
    pairs = cv2.BFMatcher(cv2.NORM_HAMMING).knnMatch(a, b, k=2)
    good = [m for m, other in pairs if m.distance < RATIO * other.distance]
    size = (one.grey.shape[1], one.grey.shape[0])
    x = p[[m.queryIdx for m in good]].reshape(-1, 2).astype(float)
    y = q[[m.trainIdx for m in good]].reshape(-1, 2).astype(float)
    moving = np.linalg.norm(y - x, axis=1) > RANSAC_TOLERANCE
    for keep in (moving, np.ones(len(x), bool)):  # graphics match best of all: first without what stands still
        motion = _background(x[keep], y[keep], np.ones(int(np.sum(keep)), bool), size)
        matches = (
            None if motion is None or not _plausible(motion[0], size) else _matched(one, two, motion[0], MOST_CORNERS)
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


def _mapped(H: Array, xy: Array | Float32) -> Array:
    """Points (n, 2) mapped by a homography; NaN on and behind its vanishing line."""
    h = xy @ H[:, :2].T + H[:, 2]
    w = h[:, 2:]
    return np.asarray(h[:, :2] / np.where(w * np.sign(H[2, 2]) > 0.0, w, np.nan), dtype=np.float64)


def _matched(one: Frame, two: Frame, H: Array | None, corners: int) -> Matches | None:
    """Matches by flow from where H takes the corners; None if they do not look like those of a static scene."""
    x, y, attempts = _followed(one, two, H, corners)
    if len(x) < LEAST_MATCHES:
        return None
    size = (one.grey.shape[1], one.grey.shape[0])
    still = np.linalg.norm(y - x, axis=1) < STILL
    starts = [~still, np.ones(len(x), bool)] if np.mean(~still) > MOVING_SHARE else [np.ones(len(x), bool)]
    for candidates in starts:
        motion = _background(x, y, candidates, size)
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
        if fits and share >= LEAST_SHARE and found >= least and _spread(x[agree], size) and _plausible(H, size):
            T = _to_full(one)
            full = T @ H @ np.linalg.inv(T)
            first, second = (_mapped(T, points[agree]) for points in (x, y))
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
        place = _mapped(H, x)
        with np.errstate(invalid="ignore"):
            inside = np.all((place >= BORDER) & (place < np.subtract((width, height), BORDER)), axis=1)
        x, predicted = x[inside], place[inside].astype(np.float32)
        origin = x
        zoom, roll, _ = _shape_change(H, (width, height))
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


def _background(
    x: Array, y: Array, candidates: BoolArray, size: tuple[int, int]
) -> tuple[Array, BoolArray, BoolArray, float] | None:
    """The homography that most candidates follow, who follows it, who is a graphic, and the scale of the residuals."""
    N = _normalisation(size)
    p, q = _mapped(N, x), _mapped(N, y)
    found = _consensus(p[candidates], q[candidates], RANSAC_TOLERANCE * N[0, 0])
    if found is None:
        return None
    rough, agree = found
    inlier = candidates.copy()
    inlier[candidates] = agree
    refined = _refined(rough, p, q, inlier, 1.0 / N[0, 0])
    if refined is None:
        return None
    plain, distance, scale = refined
    H = np.linalg.inv(N) @ plain.H @ N
    tolerance = _tolerance(scale)
    graphic = (np.linalg.norm(y - x, axis=1) < STILL) & (np.linalg.norm(_mapped(H, x) - x, axis=1) > tolerance)
    return H, (distance < tolerance) & ~graphic, graphic, float(scale)


def _normalisation(size: tuple[int, int]) -> Array:
    """(3, 3), takes the middle of the picture to the origin and its corners to distance 1."""
    x, y = 0.5 * np.subtract(size, 1.0)
    unit = np.hypot(x, y)
    return np.array([[1.0 / unit, 0.0, -x / unit], [0.0, 1.0 / unit, -y / unit], [0.0, 0.0, 1.0]])


def _consensus(p: Array, q: Array, tolerance: float) -> tuple[_Motion, BoolArray] | None:
    """A turn and a zoom by RANSAC, and which points follow it; the same for the same points.

    Lines of sight are projected stereographically, for a few focal lengths in turn. That is conformal, and small
    turns and zooms are similarities but for terms of second order, a quarter of those of the picture itself. Four
    parameters: the eight of a homography also fit players who run the way that the camera pans.
    """
    import cv2

    if len(p) < LEAST_DESCRIPTORS:
        return None
    best: tuple[_Motion, BoolArray] | None = None
    most = LEAST_DESCRIPTORS - 1
    for log_f in FOCAL_GUESSES:
        f = float(np.exp(log_f))
        a, b = (2.0 * z / (1.0 + np.sqrt(1.0 + np.sum(z * z, axis=1, keepdims=True) / f**2)) for z in (p, q))
        S, agree = cv2.estimateAffinePartial2D(
            a, b, method=cv2.RANSAC, ransacReprojThreshold=tolerance, maxIters=RANSAC_ITERATIONS, confidence=0.999
        )
        if S is None or np.sum(agree) <= most:
            continue
        zoom, roll = float(np.hypot(S[0, 0], S[1, 0])), float(np.arctan2(S[1, 0], S[0, 0]))
        far = np.sum(np.square(S[:, 2])) / (2.0 * f) ** 2  # 1 is a turn by 90 degrees
        if 1.0 / LARGEST_ZOOM < zoom < LARGEST_ZOOM and abs(roll) < LARGEST_ROLL and far < 0.5:
            best, most = (_Motion.of(S[:, 2] / (1.0 - far), zoom, roll, log_f), agree[:, 0] > 0), int(np.sum(agree))
            if most > ENOUGH * len(p):
                break
    return best


@dataclass(frozen=True, eq=False)
class _Motion:
    """A camera that turns and zooms: ``U(y) = K2 R K1^-1 U(x)``, ``U(x) = x / (1 + lens |x|^2)``.

    Lengths are relative to half the diagonal, and pixels to the middle of the picture, where the optical axis is.
    """

    turn: Array
    """(3,) rotation vector R = exp([turn]x) of camera coordinates."""
    log_f: float
    log_zoom: float
    lens: float

    @property
    def H(self) -> Array:
        """``K2 R K1^-1``."""
        f = np.exp(self.log_f)
        R, f2 = _rotation(self.turn), f * np.exp(self.log_zoom)
        return np.asarray(np.diag([f2, f2, 1.0]) @ R @ np.diag([1.0 / f, 1.0 / f, 1.0]))

    @classmethod
    def of(cls, middle: Array, zoom: float, roll: float, log_f: float) -> _Motion:
        """By where the middle of the first picture goes, zoom, roll and focal length; the lens is that of the prior."""
        f2 = zoom * np.exp(log_f)
        tilt_pan = np.array([-middle[1], middle[0], 0.0])  # the axis about which (0, 0, 1) turns to (middle, f2)
        sine = float(np.linalg.norm(tilt_pan))
        tilt_pan *= np.arctan2(sine, f2) / max(sine, 1e-12)
        turn = _turn(_rotation(tilt_pan) @ _rotation(np.array([0.0, 0.0, roll])))
        return cls(turn, log_f, float(np.log(zoom)), LENS_PRIOR[0])

    def residuals(self, p: Array, q: Array) -> tuple[Array, Array]:
        """``U(q) - K2 R K1^-1 U(p)``, (n, 2), and its negative derivative (n, 2, 6) by rotation, log f, log zoom, lens.

        Pan and tilt times focal length, the shift in the picture, is what pixels determine: pan and tilt are divided by
        what the focal length is multiplied by, so that it can be found from far away.
        """
        pp, qq = (np.sum(z * z, axis=1, keepdims=True) for z in (p, q))
        R = _rotation(self.turn)
        u, v = p / (1.0 + self.lens * pp), q / (1.0 + self.lens * qq)
        f1, f2 = np.exp(self.log_f), np.exp(self.log_f + self.log_zoom)
        Y = u @ R[:, :2].T + f1 * R[:, 2]
        m = f2 * Y[:, :2] / Y[:, 2:]
        s, t = m[:, 0] / f2, m[:, 1] / f2  # Y = Y3 (s, t, 1)
        J = np.empty((len(p), 2, 6))
        J[:, 0, 0], J[:, 0, 1], J[:, 0, 2] = -f2 * s * t, f2 * (1.0 + s * s), -f2 * t  # dY = d_omega x Y
        J[:, 1, 0], J[:, 1, 1], J[:, 1, 2] = -f2 * (1.0 + t * t), f2 * s * t, f2 * s
        x, y, z = self.turn
        # (I + W / 2 + W^2 / 6) (x, y, 0), W = [turn]x: left Jacobian of the rotation to second order
        scaling = np.array(
            [x - z * y / 2.0 - z * z * x / 6.0, y + z * x / 2.0 - z * z * y / 6.0, z * (x * x + y * y) / 6.0]
        )
        dY_dlog_f = f1 * R[:, 2]
        dY_dlens = (-u * pp / (1.0 + self.lens * pp)) @ R[:, :2].T
        scale = f2 / Y[:, 2:]  # dm = scale (dY12 - (s, t) dY3)
        J[:, :, 3] = m + scale * (dY_dlog_f[:2] - m / f2 * dY_dlog_f[2]) - J[:, :, :3] @ scaling
        J[:, :, 4] = m
        J[:, :, 5] = scale * (dY_dlens[:, :2] - m / f2 * dY_dlens[:, 2:]) + v * qq / (1.0 + self.lens * qq)
        return v - m, J

    def fitted(self, r: Array, J: Array, noise: float, free_lens: bool) -> _Motion:
        """The motion after a Gauss-Newton step under the priors, for that noise of a coordinate."""
        J = J.reshape(-1, 6)[:, : 6 if free_lens else 5]
        A, g = J.T @ J, J.T @ r.reshape(-1)
        for i, value, (mean, deviation) in ((3, self.log_f, FOCAL_PRIOR), (5, self.lens, LENS_PRIOR)):
            if i < len(g):
                A[i, i] += (noise / deviation) ** 2
                g[i] += (noise / deviation) ** 2 * (mean - value)
        step = np.zeros(6)
        step[: len(g)] = np.linalg.solve(A, g)
        step_f = -0.5 * float(np.log1p(-2.0 * np.clip(step[3], -LARGEST_STEP, LARGEST_STEP)))  # linear in 1 / f^2
        lens = float(np.clip(self.lens + step[5], -LARGEST_LENS, LARGEST_LENS))
        turn = self.turn * (np.exp(-step_f), np.exp(-step_f), 1.0)
        turn = _turn(_rotation(step[:3]) @ _rotation(turn))
        step_zoom = float(np.clip(step[4], -LARGEST_STEP, LARGEST_STEP))
        return _Motion(turn, self.log_f + step_f, self.log_zoom + step_zoom, lens)


def _refined(
    motion: _Motion, p: Array, q: Array, inlier: BoolArray, unit: float
) -> tuple[_Motion, Array, float] | None:
    """Least squares motion of a camera that turns and zooms, by Gauss-Newton with hard rejection.

    Six parameters instead of the nine of a homography with a lens: where all matches lie in a strip of boards, a
    homography says anything about the rest of the picture. Focal length and lens have priors, since small motions say
    nothing about them. The lens halves the residuals of far pairs, so that the tolerance tells players better.

    Returns
    -------
    plain : _Motion
        The best without lens, which is a homography.
    distance : (n,) array
        Of each point from the motion with lens, px; `unit` of them are 1.
    scale : float
        Robust standard deviation of a coordinate over the inliers, px.
    """
    keep, scale = inlier, np.inf
    for i in range(ITERATIONS + 1):
        r, J = motion.residuals(p, q)
        distance = np.linalg.norm(r, axis=1) * unit
        if i >= FIXED_ITERATIONS:
            keep = distance < _tolerance(scale)
            if np.sum(keep) < LEAST_DESCRIPTORS:
                return None
        before, scale = scale, 1.4826 * float(np.median(np.abs(r[keep]))) * unit
        if i == ITERATIONS or (i > FIXED_ITERATIONS and abs(scale - before) < CONVERGED * scale):
            break
        motion = motion.fitted(r[keep], J[keep], PRIOR_NOISE / unit, True)
    plain = replace(motion, lens=0.0)
    some = np.flatnonzero(keep)[:: 1 + np.sum(keep) // PLAIN_POINTS]
    p, q = p[some], q[some]
    for _ in range(PLAIN_ITERATIONS):
        plain = plain.fitted(*plain.residuals(p, q), PRIOR_NOISE / unit, False)
    return plain, distance, scale


def _rotation(turn: Array) -> Array:
    """exp([turn]x), (3, 3)."""
    import cv2

    return np.asarray(cv2.Rodrigues(turn)[0])


def _turn(R: Array) -> Array:
    """The inverse of `_rotation`, for less than 180 degrees; cv2.Rodrigues gives 0 for less than 1e-5, 0.02 px."""
    axis = 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    sine = float(np.linalg.norm(axis))
    angle = float(np.arctan2(sine, 0.5 * (R[0, 0] + R[1, 1] + R[2, 2] - 1.0)))
    return axis * (angle / sine if sine > 0.0 else 1.0)


def _tolerance(scale: float) -> float:
    """Largest distance, px, of the background from its motion."""
    return float(np.clip(TOLERANCE_IN_SCALES * scale, *TOLERANCE))


def _shape_change(H: Array, size: tuple[int, int]) -> tuple[float, float, float]:
    """Zoom, roll (radians) and stretch of a homography in the middle of the picture; zoom 0 where it mirrors."""
    x = np.array([0.5 * size[0], 0.5 * size[1], 1.0])
    m = H @ x
    if m[2] * np.sign(H[2, 2]) <= 0.0:
        return 0.0, 0.0, np.inf
    A = (H[:2, :2] - np.outer(m[:2] / m[2], H[2, :2])) / m[2]
    determinant = float(np.linalg.det(A))
    if determinant <= 0.0:
        return 0.0, 0.0, np.inf
    large, small = np.linalg.svd(A, compute_uv=False)
    return float(np.sqrt(determinant)), float(np.arctan2(A[1, 0] - A[0, 1], A[0, 0] + A[1, 1])), float(large / small)


def _plausible(H: Array, size: tuple[int, int]) -> bool:
    """Whether a homography may be that of a camera on a tripod; false if it is NaN."""
    zoom, roll, stretch = _shape_change(H, size)
    return 1.0 / LARGEST_ZOOM < zoom < LARGEST_ZOOM and abs(roll) < LARGEST_ROLL and stretch < LARGEST_STRETCH


def _spread(xy: Array, size: tuple[int, int]) -> bool:
    """Whether points cover enough of the picture to tell its motion from that of one object."""
    deviation = np.sqrt(np.maximum(np.linalg.eigvalsh(np.cov(xy.T)), 0.0)) / size[0]
    cells = np.unique(np.floor(xy / size * GRID).astype(int), axis=0)
    return bool(deviation[1] > LEAST_SPREAD[0] and deviation[0] > LEAST_SPREAD[1] and len(cells) >= LEAST_CELLS)
