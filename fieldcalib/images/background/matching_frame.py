"""Preparation of a frame for matching, with corners and descriptors, and the similarity of two frames.

Frames are grey, and halved until they are at most `WORKING_WIDTH` wide. Followed over 12 frames of clips of 1080 lines,
corners were 0.22 to 0.66 px of 1280 off the best homography at 960 px, 0.25 to 0.67 at 640 and 0.42 to 0.79 at 480.
Clips of 720 lines gain more: the scatter about a rotation and zoom with lens is 0.15 px at 1280, 0.23 at 640.

Corners on players are left out. Players, officials, balls and their shadows are found as compact blobs on the ground
(`blobs_on_ground`). In a fast pan the ground is blurred, most corners that are left lie on players, and players who run
the same way look like a background. In three rendered clips the motion between neighbouring frames was off by up to 0.4
to 1.0 px in 90 % of the pairs with corners on players, and by up to 0.2 px without.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from fieldcalib._types import Array, BoolArray, Float32, IntArray
from fieldcalib.images.background.background_motion import mapped
from fieldcalib.io.image_files import Image

# Lengths are in pixels of a picture of this width.
WIDTH = 320
COLOUR_BINS = 64  # of each chroma axis
GROUND_BELOW = 1.0 / 3.0  # of the height, below which the colour of the ground is measured
CHROMA, LIGHTNESS = 12.0, 35.0  # of 255 (a, b and L of CIE Lab): pixels that differ by more are not ground
AROUND = 30  # px: size of the neighbourhood that gives the lightness of the ground, which has stripes and shadows
THIN = 3  # px: thinner things are lines or nets
SMALLEST_AREA = 20  # square px: smaller blobs may be remains of a slanting line
LARGEST_AREA = 0.02  # of the picture
LARGEST_SIDE = (0.15, 0.4)  # of width and height
LONGEST = 5.0  # ratio of standard deviations along and across: longer blobs are lines
RING = 4  # px: width of the ring around the bounding box of a blob
LEAST_GROUND = 0.7  # share of ground in this ring: blobs before boards and crowd cannot be told from them
MARGIN = 5  # px of the dilation

# Lengths are in pixels of the reduced frames.
WORKING_WIDTH = 1280  # px: 1920 are halved, 1280 are kept; at 640 their residuals are 1.6 times as large
CELLS_ACROSS = 54  # at most one corner in each cell, so that boards, crowd and players do not outnumber the rest
ENOUGH_CORNERS = 100  # corners off players; with fewer, those on players are used too
MOST_CORNERS = 400  # of a frame: 800 take twice the time and reduce the error of the homography to 0.7 times at best
LEAST_CORNER = 3e-5  # smaller eigenvalue (cv2.cornerMinEigenVal, block of 3): less is grass and noise of compression
BORDER = 8  # px from the border of the picture, within which the window of a corner is cut off
SAME_BLOCK = 32  # px: two pictures are the same if no block of that size differs
SAME_PICTURE = 1.0  # grey levels of mean difference; neighbouring frames of six clips differ by 4 or more somewhere
SMALLEST_FOR_ORB = 64  # px: ORB cannot make a pyramid of smaller pictures
ORB_WIDTH = 960  # px: wider frames are halved; flow makes the matches exact afterwards
ORB_FEATURES = 1000  # of a frame
ORB_THRESHOLD = 8  # grey levels: the corners of lines on grass are faint
IN_PICTURE = (np.mgrid[:20, :20].reshape(2, -1).T + 0.5) / 20.0  # grid of points (400, 2), shares of width and height
SMALL_WIDTH = 160  # px of the small pictures that are compared
LOCAL = 41  # px of a small picture over which the mean is subtracted, as slow shading is alike in any two shots
BLOCK = 5  # px of a small picture
WHOLE = 0.7  # share of a block that must be in view
NOISE = 2.0  # grey levels: contrast below is noise
GRAPHIC = (4.0, 12.0, 5)  # grey levels: largest difference in place, least once moved; px around it


def thumbnail(image: Image) -> Image:
    """Reduce a picture to `WIDTH`, if it is wider."""
    import cv2

    height, width = image.shape[:2]
    ratio = max(width / WIDTH, 1.0)
    size = (round(width / ratio), max(round(height / ratio), 1))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_LINEAR))


def blobs_on_ground(image: Image) -> Image:
    """Mask of compact blobs on the ground of a thumbnail (height, width, 3) in blue, green, red: 1 there, else 0.

    Examples
    --------
    >>> image = np.full((180, 320, 3), (60, 140, 60), np.uint8)
    >>> image[90:110, 100:108] = (30, 30, 200)  # a player
    >>> image[:, 200:203] = 255  # a line
    >>> blobs = blobs_on_ground(image)
    >>> int(blobs[100, 104]), int(blobs[100, 201])
    (1, 0)
    """
    import cv2

    ground = _is_ground(cv2.cvtColor(image, cv2.COLOR_BGR2LAB))
    thick: Any = cv2.morphologyEx(1 - ground, cv2.MORPH_OPEN, np.ones((THIN, THIN), np.uint8))
    _, label, boxes, _ = cv2.connectedComponentsWithStats(thick, connectivity=8)
    stands = _are_small(boxes, ground.shape) & (_ground_around(boxes, ground) > LEAST_GROUND)
    stands[0] = False  # the ground
    is_blob = _are_compact(label, stands).astype(np.uint8)
    return np.asarray(cv2.dilate(is_blob[label], np.ones((MARGIN, MARGIN), np.uint8)))


def _is_ground(lab: Any) -> Any:
    """Mask of the ground in a CIE Lab picture: 1 for the commonest colour of the lower part at the local lightness."""
    import cv2

    lower = lab[int(GROUND_BELOW * len(lab)) :]
    counts = cv2.calcHist([lower], [1, 2], None, [COLOUR_BINS, COLOUR_BINS], [0, 256, 0, 256])
    common = np.unravel_index(np.argmax(cv2.GaussianBlur(counts, (5, 5), 0.0)), counts.shape)
    colour = (np.array(common) + 0.5) * (256 / COLOUR_BINS)
    has_colour = cv2.inRange(lab, (0.0, *(colour - CHROMA)), (255.0, *(colour + CHROMA)))
    lightness = np.ascontiguousarray(lab[..., 0])
    half = cv2.resize(lightness, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    around = cv2.resize(cv2.medianBlur(half, AROUND // 2), lightness.shape[::-1], interpolation=cv2.INTER_LINEAR)
    return np.minimum(has_colour, cv2.absdiff(lightness, around) < LIGHTNESS).astype(np.uint8)


def _are_small(boxes: IntArray, shape: tuple[int, ...]) -> BoolArray:
    height, width = shape
    sides = np.multiply(LARGEST_SIDE, (width, height))
    area = boxes[:, 4]
    fits = (area >= SMALLEST_AREA) & (area < LARGEST_AREA * height * width)
    return np.asarray(fits & np.all(boxes[:, 2:4] < sides, axis=1))


def _are_compact(label: Array, some: BoolArray) -> BoolArray:
    """Whether the pixels of some labels have similar standard deviations along and across: blobs, not lines."""
    y, x = np.nonzero(some[label])
    one, count = label[y, x], len(some)
    n = np.maximum(np.bincount(one, minlength=count), 1)
    mx, my, xx, yy, xy = (np.bincount(one, z, count) / n for z in (x, y, x * x, y * y, x * y))
    a, b, c = xx - mx * mx + 1.0 / 12.0, yy - my * my + 1.0 / 12.0, xy - mx * my  # a pixel is a square
    spread = np.hypot(0.5 * (a - b), c)
    is_seen = np.bincount(one, minlength=count) > 0
    return np.asarray(is_seen & (0.5 * (a + b) + spread < LONGEST**2 * (0.5 * (a + b) - spread)))


def _ground_around(boxes: IntArray, ground: Any) -> Array:
    """Share of the ground in a ring around each bounding box."""
    import cv2

    height, width = ground.shape
    total = cv2.integral(ground)

    def inside(margin: int) -> tuple[Array, Array]:
        x0, y0 = np.maximum(boxes[:, 0] - margin, 0), np.maximum(boxes[:, 1] - margin, 0)
        x1 = np.minimum(boxes[:, 0] + boxes[:, 2] + margin, width)
        y1 = np.minimum(boxes[:, 1] + boxes[:, 3] + margin, height)
        return total[y1, x1] - total[y0, x1] - total[y1, x0] + total[y0, x0], (x1 - x0) * (y1 - y0)

    (outer, outer_area), (inner, inner_area) = inside(RING), inside(0)
    return np.asarray((outer - inner) / np.maximum(outer_area - inner_area, 1))


@dataclass(frozen=True, eq=False)
class Frame:
    """A frame prepared for matching: reduced, grey; its corners and descriptors are found once, when they are needed.

    Pyramids are built again for each pair, which takes 0.2 ms: OpenCV's Python functions take no prepared ones.

    Examples
    --------
    >>> frame = Frame.of(np.zeros((1080, 1920, 3), np.uint8))
    >>> frame.grey.shape, frame.corners.shape
    ((540, 960), (0, 2))
    """

    grey: Image
    """The reduced grey picture, (height, width), at most `WORKING_WIDTH` wide."""
    image_size: tuple[int, int]
    """Size of the picture in full size."""
    colours: Image | None = None
    """The picture in colour, `fieldcalib.images.background.matching_frame.WIDTH` wide; None if it is grey."""

    @classmethod
    def of(cls, image: Image) -> Frame:
        """Prepare a uint8 picture, grey (height, width) or (height, width, 3) in blue, green, red.

        Raises
        ------
        ValueError
            If `image` is not such an array.
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
        if image.ndim == 2:
            return cls(np.asarray(small, dtype=np.uint8), (width, height))
        grey = cv2.cvtColor(small, cv2.COLOR_BGR2GRAY)
        return cls(np.asarray(grey, dtype=np.uint8), (width, height), thumbnail(small))

    @property
    def scale(self) -> Array:
        """Pixels of the full size per pixel of `grey`, across and down, (2,)."""
        return np.divide(self.image_size, self.grey.shape[::-1])

    @cached_property
    def corners(self) -> Float32:
        """Corners in pixels of `grey`, (n, 2): the best one of each cell, and the strongest `MOST_CORNERS` of these.

        Corners on players are left out, unless hardly any others are found. Corners are looked for at half the size,
        which takes a fifth of the time: flow needs a window with texture, not an exact peak.
        """
        import cv2

        height, width = self.grey.shape
        half = cv2.resize(self.grey, (max(width // 2, 1), max(height // 2, 1)), interpolation=cv2.INTER_AREA)
        strength = cv2.cornerMinEigenVal(half, 3)
        border = BORDER // 2
        strength[:border] = strength[-border:] = strength[:, :border] = strength[:, -border:] = 0.0
        if self.colours is not None:
            others = _best_corners(np.where(self.players(strength.shape), 0.0, strength))
            if len(others) >= ENOUGH_CORNERS:
                return others
        return _best_corners(strength)

    def players(self, shape: tuple[int, ...]) -> BoolArray:
        """Mask of the players, scaled to another size (height, width); empty for a grey picture."""
        import cv2

        if self.colours is None:
            return np.zeros(shape, dtype=bool)
        return np.asarray(cv2.resize(self._players, shape[::-1], interpolation=cv2.INTER_NEAREST) > 0)

    @cached_property
    def _players(self) -> Image:
        assert self.colours is not None
        return blobs_on_ground(self.colours)

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


def _best_corners(strength: Any) -> Float32:
    """Best corner of each cell, in pixels (n, 2) of a picture twice as large as `strength`, the strongest first."""
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


def to_full(scale: Array) -> Array:
    """Affine map (3, 3) from pixels of a picture that was reduced by a scale (2,) to pixels of the full size.

    Centres of pixels are at integer coordinates.
    """
    x, y = scale
    return np.array([[x, 0.0, 0.5 * (x - 1.0)], [0.0, y, 0.5 * (y - 1.0)], [0.0, 0.0, 1.0]])


def same_picture(first: Image | Frame, second: Image | Frame) -> bool:
    """Whether two pictures are the same apart from compression: no block of one differs from the other's.

    Examples
    --------
    >>> image = np.zeros((540, 960), np.uint8)
    >>> moved = image.copy()
    >>> moved[200:240, 300:340] = 60  # a player
    >>> same_picture(image, image), same_picture(image, moved)
    (True, False)
    """
    import cv2

    one, two = pair(first, second)
    height, width = one.grey.shape
    if cv2.norm(one.grey, two.grey, cv2.NORM_L1) > SAME_PICTURE * one.grey.size:
        return False
    difference = cv2.absdiff(one.grey, two.grey)
    size = (max(width // SAME_BLOCK, 1), max(height // SAME_BLOCK, 1))
    blocks = cv2.resize(difference.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    return bool(np.max(blocks) < SAME_PICTURE)


def pair(first: Image | Frame, second: Image | Frame) -> tuple[Frame, Frame]:
    """Prepare two pictures as frames; a ValueError if they are not of one size."""
    one = first if isinstance(first, Frame) else Frame.of(first)
    two = second if isinstance(second, Frame) else Frame.of(second)
    if one.image_size != two.image_size:
        raise ValueError(f"frames must be of one size, got {one.image_size} and {two.image_size}")
    return one, two


@dataclass(frozen=True, eq=False)
class VideoFrame:
    """A frame of a video, with a small picture that serves to measure its likeness with others."""

    index: int
    frame: Frame
    duplicate: bool

    @cached_property
    def detail(self) -> Float32:
        """Small picture minus its local mean."""
        import cv2

        height, width = self.frame.grey.shape
        small_width = min(SMALL_WIDTH, width)
        size = (small_width, max(round(height * small_width / width), 1))
        small: Any = cv2.resize(self.frame.grey, size, interpolation=cv2.INTER_AREA).astype(np.float32)
        return np.asarray(small - cv2.blur(small, (LOCAL, LOCAL)), dtype=np.float32)


def likeness(first: VideoFrame, second: VideoFrame, H: Array) -> float:
    """Share of the contrast that two pictures have in common, once the first is moved by H (in full size).

    In each block it is the covariance divided by the larger variance. The result is the median over the half of the
    blocks with more contrast, since boards change in some blocks only. Players are left out, and so are static
    graphics, which are the same in place but not once moved. A mixture ``(1 - a) A + a B`` of two shots has a likeness
    of about 1 - a with A and a with B.
    """
    import cv2

    # pixels that are out of view, on players or on static graphics get weight 0 in the means over blocks
    a: Any = first.detail
    b: Any = second.detail
    height, width = b.shape
    T = to_full(np.divide(first.frame.image_size, (width, height)))
    small = np.linalg.inv(T) @ H @ T
    of_first, of_second = (1.0 - one.frame.players(b.shape).astype(np.float32) for one in (first, second))
    inside: Any = cv2.warpPerspective(of_first, small, (width, height), flags=cv2.INTER_NEAREST)
    moved = cv2.warpPerspective(a, small, (width, height), flags=cv2.INTER_LINEAR)
    same, unlike, around = GRAPHIC
    graphic = ((np.abs(a - b) < same) & (np.abs(moved - b) > unlike)).astype(np.uint8)
    inside[cv2.dilate(graphic, np.ones((around, around), np.uint8)) > 0] = 0.0
    inside *= of_second
    a, b = moved * inside, b * inside
    blocks = (max(width // BLOCK, 1), max(height // BLOCK, 1))
    means = (cv2.resize(z, blocks, interpolation=cv2.INTER_AREA) for z in (inside, a * a, b * b, a * b))
    seen, aa, bb, ab = (mean.ravel() for mean in means)
    whole = seen > WHOLE
    if not np.any(whole):
        return 0.0
    variance = np.maximum(aa, bb)[whole] / seen[whole]
    share = ab[whole] / seen[whole] / (variance + NOISE**2)
    return float(np.median(share[variance >= np.median(variance)]))


def shared_view(H: Array, size: tuple[int, int]) -> float:
    """Share of each picture that is in view in the other; the smaller of the two."""
    xy = IN_PICTURE * np.asarray(size, dtype=np.float64)
    back: Array = np.asarray(np.linalg.inv(H), dtype=np.float64)
    with np.errstate(invalid="ignore"):
        inside = [np.all((z >= 0.0) & (z < size), axis=1) for z in (mapped(H, xy), mapped(back, xy))]
    return float(min(np.mean(part) for part in inside))
