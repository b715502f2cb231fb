"""The long straight lines of a picture, and its lens distortion: with the right one removed, stripes lie on such lines.

Lines are found by a Hough transform in which stripes vote in their direction.

In units of half the diagonal from the middle of the picture, a stripe at d is moved to ``d (1 + a |d|^2)``; a > 0
undoes the barrel distortion of wide lenses. Several a are tried, and the one is taken for which the longest lines hold
the most stripes (the plumb-line method of Brown, Close-range camera calibration, 1971).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fieldcalib._types import Array, BoolArray, IntArray
from fieldcalib.geometry.camera import Camera
from fieldcalib.images.search.stripes import Stripes

DEGREES = 0.5  # step of direction in the transform
PIXELS = 2.0  # step of distance from the middle of the picture
SPREAD = 4  # steps to both sides of its direction for which a stripe votes: structure tensors are 1 to 2 degrees off
NEAR, ALIKE = 3.0, np.radians(6.0)  # px and angle within which stripes belong to a line, which is fitted to them
OWN, OWN_ALIKE = 5.0, np.radians(8.0)  # the same for stripes that then vote for no other line: lenses bend lines
PIECE = 4.0  # px: pieces of a line that count once for its length, however many stripes they hold
SHORTEST = 50.0  # px of stripes on a line
FITS = 2  # fits of a line to the stripes on it
ENDS = 0.04, 0.96  # quantiles of the stripes along a line that are its ends: a few far stripes belong to something else
BENDS = (0.05, 0.09, 0.14, 0.2, 0.3, 0.45, 0.7)  # values of a that are tried
FEW_BENDS = 3  # if none of the first so many is better than no distortion, no more are tried
BETTER = 1.05  # factor by which the length of lines must grow (`_length`) for a distortion not to be chance
LINES = 12  # longest lines whose lengths count
MOST = 5000  # stripes that are used
NEWTON = 6  # Newton steps of the inverse
SAMPLES = np.linspace(0.05, 1.0, 20)  # radii at which the polynomial of a lens is fitted


@dataclass(frozen=True, eq=False)
class LongLines:
    """Straight lines ``n . p = d`` on which long stripes lie, the best supported one first."""

    normal: Array
    """Unit vectors across the lines, (K, 2)."""
    offset: Array
    """Distances d from the pixel (0, 0), pixels, (K,)."""
    ends: Array
    """Pixels between which most of the stripes on each line lie, (K, 2, 2)."""
    length: Array
    """Total length of the stripes on each line, pixels, (K,)."""

    def __len__(self) -> int:
        return len(self.offset)

    def seen_from(self, origin: Array, unit: float) -> tuple[Array, Array]:
        """Lines (K, 3), ``l . (x, y, 1) = 0``, and their ends, relative to an origin (2,), in a unit of some pixels."""
        line = np.column_stack([self.normal, (self.normal @ origin - self.offset) / unit])
        return line, (self.ends - origin) / unit

    def holding(self, stripes: Stripes) -> list[BoolArray]:
        """Masks (N,) of the stripes that lie on each line and run along it."""
        lines, across = zip(self.normal, self.offset, strict=True), stripes.angle + 0.5 * np.pi
        return [_is_on(stripes.xy, across, *line, NEAR, OWN_ALIKE) for line in lines]


def long_lines(stripes: Stripes, most: int) -> LongLines:
    """Find the lines with the longest stripes on them, at most `most`, the longest first.

    Examples
    --------
    >>> from fieldcalib.images.search.stripes import find_stripes
    >>> picture = np.full((90, 160, 3), 90, np.uint8)
    >>> picture[:, 70:75] = 200
    >>> lines = long_lines(find_stripes(picture), 5)
    >>> np.abs(lines.normal).round(2), np.abs(lines.offset).round()
    (array([[1., 0.]]), array([72.]))
    """
    middle = 0.5 * np.array(stripes.size)
    xy, across = stripes.xy - middle, stripes.angle + 0.5 * np.pi
    votes = _Votes.of(xy, across, float(np.hypot(*middle)))
    left = np.ones(len(xy), dtype=bool)
    found: list[tuple[Array, float, Array, float]] = []
    while len(found) < most:
        normal, offset = votes.best()
        on = left & _is_on(xy, across, normal, offset, NEAR, ALIKE)
        # cells of the transform are too coarse for a homography, so the line is fitted to the stripes on it
        for _ in range(FITS):
            if np.count_nonzero(on) < SHORTEST / PIECE:
                break
            normal, offset = _fitted(xy[on])
            on = left & _is_on(xy, across, normal, offset, NEAR, ALIKE)
        along = xy[on] @ (-normal[1], normal[0])
        length = PIECE * len(np.unique(np.floor(along / PIECE)))
        if length < SHORTEST:
            break
        ends = np.quantile(along, ENDS)[:, None] * (-normal[1], normal[0]) + offset * normal + middle
        found.append((normal, offset + float(normal @ middle), ends, length))
        own = left & _is_on(xy, across, normal, offset, OWN, OWN_ALIKE)
        np.subtract.at(votes.count, votes.cells[own].ravel(), 1)
        left &= ~own
    found.sort(key=lambda line: -line[-1])
    parts = [np.array([line[k] for line in found], dtype=float) for k in range(4)]
    shapes = (-1, 2), (-1,), (-1, 2, 2), (-1,)
    return LongLines(*(part.reshape(shape) for part, shape in zip(parts, shapes, strict=True)))


@dataclass(eq=False)
class _Votes:
    """Accumulator of the Hough transform: stripes on the line of each direction and distance from the middle."""

    cells: IntArray
    """Cells for which each stripe votes, (N, 2 SPREAD + 1)."""
    count: IntArray
    """Votes of all cells (directions, distances), flattened."""
    shape: tuple[int, int]

    @classmethod
    def of(cls, xy: Array, across: Array, reach: float) -> _Votes:
        directions = round(180.0 / DEGREES)
        distances = 2 * int(np.ceil(reach / PIXELS)) + 3
        own = np.round(np.degrees(across) / DEGREES).astype(np.intp)
        row = np.mod(own[:, None] + np.arange(-SPREAD, SPREAD + 1), directions)
        angle = np.radians(row * DEGREES)
        distance = xy[:, :1] * np.cos(angle) + xy[:, 1:] * np.sin(angle)
        cells = row * distances + np.round(distance / PIXELS).astype(np.intp) + distances // 2
        shape = directions, distances
        return cls(cells, np.bincount(cells.ravel(), minlength=directions * distances).astype(np.int32), shape)

    def best(self) -> tuple[Array, float]:
        """Normal and offset of the line with the most votes; neighbouring cells in the flat order count by half."""
        smooth = 2 * self.count
        smooth[1:] += self.count[:-1]
        smooth[:-1] += self.count[1:]
        row, column = divmod(int(np.argmax(smooth)), self.shape[1])
        angle = np.radians(row * DEGREES)
        return np.array([np.cos(angle), np.sin(angle)]), PIXELS * (column - self.shape[1] // 2)


def _is_on(xy: Array, across: Array, normal: Array, offset: float, near: float, alike: float) -> BoolArray:
    """Whether each stripe lies on a line and runs along it."""
    on = np.abs(xy @ normal - offset) < near
    turn = across[on] - np.arctan2(normal[1], normal[0])
    on[on] = np.abs(turn - np.pi * np.round(turn / np.pi)) < alike
    return np.asarray(on)


def _fitted(xy: Array) -> tuple[Array, float]:
    """Normal and offset of the line through pixels (N, 2), by total least squares."""
    centre = xy.mean(axis=0)
    normal = np.linalg.eigh(np.cov((xy - centre).T))[1][:, 0]
    return normal, float(normal @ centre)


@dataclass(frozen=True)
class Bend:
    """Map from the pixels of a picture to those of the picture without distortion; its corners stay in place."""

    a: float
    size: tuple[int, int]

    @classmethod
    def of(cls, camera: Camera) -> Bend:
        """Distortion of a camera's lens, as the mean over the corners of its picture.

        Examples
        --------
        >>> straight = Camera.from_angles(0.0, 1.2, 0.0, 1400.0, (0.0, 30.0, -10.0), (1280, 720))
        >>> round(Bend.of(Bend(0.2, (1280, 720)).with_lens(straight)).a, 2)
        0.2
        """
        width, height = camera.image_size
        corners = np.array([(0.0, 0.0), (width, 0.0), (0.0, height), (width, height)])
        seen = (corners - camera.principal_point) / camera.focal_length
        stretch = np.linalg.norm(camera.normalized(corners), axis=1) / np.linalg.norm(seen, axis=1)
        return cls(float(np.mean(np.nan_to_num(stretch, nan=1.0))) - 1.0, camera.image_size)

    @property
    def middle(self) -> Array:
        """Middle of the picture, pixels."""
        return 0.5 * np.array(self.size)

    @property
    def rho(self) -> float:
        """Half the diagonal, pixels."""
        return float(np.hypot(*self.middle))

    def straight(self, stripes: Stripes) -> Stripes:
        """Move stripes to where they are without distortion."""
        if self.a == 0.0:
            return stripes
        d = (stripes.xy - self.middle) / self.rho
        along = np.column_stack([np.cos(stripes.angle), np.sin(stripes.angle)])
        stretch = 1.0 + self.a * np.sum(d * d, axis=1)[:, None]
        along = stretch * along + 2.0 * self.a * d * np.sum(d * along, axis=1)[:, None]
        xy = self.middle + self.rho * d * stretch / (1.0 + self.a)
        angle = np.mod(np.arctan2(along[:, 1], along[:, 0]), np.pi)
        return Stripes(xy, angle, stripes.contrast, stripes.size)

    def bent(self, xy: Array) -> Array:
        """Convert pixels (..., 2) of the picture without distortion to pixels of the picture; inverse of `straight`.

        Examples
        --------
        >>> bend, xy = Bend(0.2, (1280, 720)), np.array([[100.0, 650.0]])
        >>> stripe = Stripes(bend.bent(xy), np.zeros(1), np.ones(1), (1280, 720))
        >>> bend.straight(stripe).xy.round(3)
        array([[100., 650.]])
        """
        if self.a == 0.0:
            return xy
        u = (xy - self.middle) * ((1.0 + self.a) / self.rho)
        radius = np.linalg.norm(u, axis=-1, keepdims=True)
        d = radius / (1.0 + self.a * np.minimum(radius, 1.0) ** 2)
        for _ in range(NEWTON):
            d = d - (d + self.a * d**3 - radius) / (1.0 + 3.0 * self.a * d**2)
        return np.asarray(self.middle + self.rho * u * d / np.maximum(radius, 1e-9))

    def with_lens(self, camera: Camera) -> Camera:
        """Add the lens of the picture to a camera of the picture without distortion."""
        if self.a == 0.0:
            return camera
        u = SAMPLES * (1.0 + self.a * SAMPLES**2)
        a1, a2 = np.linalg.lstsq(np.column_stack([u**2, u**4]), SAMPLES / u - 1.0, rcond=None)[0]
        K = (1.0 + self.a) * camera.K
        K[:2, 2] -= self.a * self.middle
        K[2, 2] = 1.0
        unit = (K[0, 0] / self.rho) ** 2
        return Camera(K, camera.R, camera.C, camera.image_size, (a1 * unit, a2 * unit**2))


def bend_of(stripes: Stripes, among: Sequence[float] = BENDS) -> Bend:
    """Estimate the distortion of a picture from its stripes; none unless one `among` them is clearly better."""
    few = stripes.take(np.arange(0, len(stripes.xy), max(len(stripes.xy) // MOST, 1)))
    none = best = Bend(0.0, stripes.size)
    straight = longest = _length(few)
    for count, a in enumerate(among):
        if count == FEW_BENDS and longest == straight:
            break
        bend = Bend(a, stripes.size)
        length = _length(bend.straight(few))
        if length > longest:
            best, longest = bend, length
    return best if longest > BETTER * straight else none


def _length(stripes: Stripes) -> float:
    """Root of the sum of the squared lengths of the longest lines, pixels."""
    return float(np.linalg.norm(long_lines(stripes, LINES).length))
