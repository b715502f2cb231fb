"""What a field is beyond its segments: its lines and paint, sizes, how probably a camera is right, where cameras stand.

Stands are camera distributions: ranges of the parameters of the cameras that look at a field.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from fieldcalib._types import Array, is_number, truth

WHITE = "#f4f8f2"  # of paint in daylight
LAWNS = ("grass", "turf")  # green, and seen from stands with level tripods
SURFACES = (*LAWNS, "ice", "wood", "floor", "hard court", "clay", "sand")
# Of the fields of another size: another width, another length, both in the usual range, both in the legal one.
OTHERS = (1 / 6, 1 / 6, 1 / 3, 1 / 3)
DEVIATIONS = 1.96  # standard deviations to either side of the mean that hold 95 % of a normal distribution
SOCCER_LENGTH = 105.0  # metres: length of the field that the stands of broadcast cameras surround
ANYWHERE = 10.0  # times the ranges of stands, where nothing is known of them
SOCCER_SCALE = 40.0  # metres: size of the part of a soccer field that is usually in view


class Halves(NamedTuple):
    """Labels of the two halves of a circle and of the line between them.

    Left and right are as the main camera sees them.
    """

    left: str
    right: str
    line: str


@dataclass(frozen=True)
class LineLook:
    """Look of the lines of a field in images; by default white paint on one kind of ground, such as grass.

    Brightness is that of 8 bit images, from 0 to 255, on the scale of luma (Rec. 601).

    Raises
    ------
    ValueError
        If a number is not positive.

    Examples
    --------
    >>> LineLook(width=0.05, lighter=False)  # dark lines of 5 cm
    LineLook(width=0.05, lighter=False, contrast=3.0, contrast_raised=12.0, ground_difference=0.05)
    """

    width: float = 0.12
    """Metres."""
    lighter: bool | None = True
    """Whether they are lighter than the ground on both sides, else they are darker; None if they may be either, or the
    edges of painted areas."""
    contrast: float = 3.0
    """Least difference in brightness to both sides of a line, on the ground."""
    contrast_raised: float = 12.0
    """Least difference above the ground, of posts and crossbars, whose background varies."""
    ground_difference: float = 0.05
    """Largest difference in colour between both sides of a line on the ground, in shares of the channels; infinite
    where a line may be the border of a painted area."""

    def __post_init__(self) -> None:
        for name in ("width", "contrast", "contrast_raised", "ground_difference"):
            if not getattr(self, name) > 0.0:
                raise ValueError(f"the {name} of a LineLook must be positive, got {getattr(self, name)}")


@dataclass(frozen=True)
class Paint:
    """The paint of a segment, where it is not a white line of the width of `LineLook`.

    A segment may have no paint of its own (width 0): a line through the ends of marks, the edge of a wide line. A row
    of marks painted across the segment is a wide line in short dashes.

    Raises
    ------
    ValueError
        If a number is negative or not finite, a dash has no length, the colour is not of the form "#rrggbb", or
        `is_optional` is neither true nor false.

    Examples
    --------
    >>> Paint(width=0.3, colour="#0033a0")  # a blue line of 30 cm
    Paint(width=0.3, colour='#0033a0', dashes=None, outwards=0.0, is_optional=False)
    >>> Paint(colour="blue")
    Traceback (most recent call last):
        ...
    ValueError: expected a colour as "#rrggbb", in hexadecimal digits, got 'blue'
    """

    width: float | None = None
    """Metres; of a point the diameter of its spot. None is the width of the field's lines, 0 nothing painted."""
    colour: str = WHITE
    """Red, green and blue, as in HTML."""
    dashes: tuple[float, float] | None = None
    """Lengths of dashes and of the gaps between them, metres; the middle of one dash is that of the segment."""
    outwards: float = 0.0
    """Distance of the middle of the paint from the segment, away from the centre mark, metres; of arcs, away from their
    own centre."""
    is_optional: bool = False
    """Whether some fields of the kind lack it: where it is not seen, that is no evidence against a camera."""

    @property
    def is_along(self) -> bool:
        """Whether there is paint along the segment: false without paint, and for a row of marks that begin there."""
        return self.width != 0.0 and not (self.dashes and self.outwards)

    @property
    def painted(self) -> float:
        """Share of the length of the segment that is painted: less than 1 for dashes.

        Examples
        --------
        >>> round(Paint(dashes=(0.3, 3.0)).painted, 2)
        0.09
        """
        return 1.0 if self.dashes is None else self.dashes[0] / sum(self.dashes)

    def __post_init__(self) -> None:
        truth(self.is_optional, "is_optional")
        if self.dashes is not None:
            object.__setattr__(self, "dashes", tuple(map(float, self.dashes)))
        numbers = (self.width or 0.0, *(self.dashes or ()))
        if not all(0.0 <= number < np.inf for number in numbers) or not np.isfinite(self.outwards):
            raise ValueError(f"expected finite numbers from 0 on for paint, in metres, got {self}")
        if self.dashes is not None and (len(self.dashes) != 2 or not self.dashes[0] > 0.0):
            raise ValueError(f"expected the length of dashes and that of gaps, in metres, got {self.dashes}")
        if not re.fullmatch("#[0-9a-f]{6}", self.colour):
            raise ValueError(f'expected a colour as "#rrggbb", in hexadecimal digits, got {self.colour!r}')


UNPAINTED = Paint(width=0.0)


@dataclass(frozen=True)
class Crown:
    """Distribution of the height of the middle above the touchlines.

    Raises
    ------
    ValueError
        If the share is no probability, or the height is not positive.
    """

    share: float
    """Share of the fields that are crowned; the others are level."""
    height: float
    """Root mean square height of these, metres."""

    def __post_init__(self) -> None:
        if not (0.0 <= self.share <= 1.0 and 0.0 < self.height < np.inf):
            raise ValueError(f"expected a share of 0 to 1 and a positive height in metres for a crown, got {self}")

    @property
    def possibilities(self) -> tuple[Array, Array]:
        """Probabilities (2,) of a level and of a crowned field, and standard deviations of its height, (2,)."""
        return np.array([1.0 - self.share, self.share]), np.array([0.0, self.height])


GRASS = Crown(share=1.0 / 3.0, height=0.2)  # most pitches are level, others fall by up to 1 %, which is 0.34 m


@dataclass(frozen=True)
class SizePrior:
    """Distribution of the sizes of a kind of field, and their builder. Pairs are (length, width).

    Raises
    ------
    ValueError
        If a range is not (low, high) with 0 < low < high.

    Examples
    --------
    >>> from fieldcalib import soccer
    >>> soccer().size_model.sigma.round(2)
    array([2.55, 2.81])
    """

    legal: tuple[tuple[float, float], tuple[float, float]]
    """Ranges (low, high) that the rules allow, metres."""
    usual: tuple[tuple[float, float], tuple[float, float]]
    """Ranges that hold length and width with a probability of 95 %, metres."""
    build: Callable[[float, float], Any]
    """The field of a length and a width."""
    exact: float = 0.7
    """Probability that a field whose size was not measured has the assumed size. Of the others a sixth has the assumed
    length and a sixth the assumed width; in a third, both are normal with the usual ranges, and in a third with the
    legal ranges: the tails are heavy."""
    rules: str = "the rules"
    """Source of the legal sizes, for messages."""

    def __post_init__(self) -> None:
        for what in ("legal", "usual"):
            for low, high in getattr(self, what):
                if not (0.0 < low < high < np.inf):
                    raise ValueError(f"the {what} sizes must be (low, high) with 0 < low < high, got {(low, high)}")

    @property
    def limits(self) -> Array:
        """The smallest and the largest legal size, (2, 2): rows are (length, width)."""
        return np.array(self.legal).T

    @property
    def possibilities(self) -> tuple[Array, Array]:
        """Probabilities (5,) of the components of the distribution: the given size, its length alone, its width alone,
        a usual size, a legal size; and their standard deviations of length and width, (5, 2)."""
        legal = np.diff(self.legal, axis=1)[:, 0] / np.sqrt(12.0)  # of a uniform distribution
        alone = np.diag(self.sigma)[::-1]
        rest = 1.0 - self.exact
        return np.array([self.exact, *(rest * np.array(OTHERS))]), np.array([np.zeros(2), *alone, self.sigma, legal])

    @property
    def sigma(self) -> Array:
        """Standard deviations of length and width, (2,) metres: the usual range is a 95 % interval."""
        return np.asarray(np.diff(self.usual, axis=1)[:, 0] / (2.0 * DEVIATIONS))


@dataclass(frozen=True)
class ProbabilityModel:
    """Coefficients b0 to b4 of the log odds that a camera is right (`fieldcalib.assess.probability`).

    They are fitted to frames of one kind of field, seen by its cameras, and hold for no other.
    """

    coefficients: tuple[float, float, float, float, float]
    least_in_picture: float | None = None
    """Least probability with which a camera that was found in a picture alone is good, a picture of any shape; None if
    pictures had no part in the fit: then it is that of labels, and more for pictures of odd shapes."""

    def __post_init__(self) -> None:
        if np.shape(self.coefficients) != (5,) or not np.all(np.isfinite(self.coefficients)):
            raise ValueError(f"a ProbabilityModel needs five finite coefficients, got {self.coefficients!r}")
        if self.least_in_picture is not None and not 0.0 <= self.least_in_picture <= 1.0:
            raise ValueError(f"least_in_picture must be a probability, got {self.least_in_picture!r}")


def focal_length_from_fov(fov: Array | float, width: float) -> Array:
    """Focal length in pixels of a horizontal field of view in radians: ``f = w / (2 tan(fov / 2))``."""
    return np.asarray(0.5 * width / np.tan(0.5 * np.asarray(fov)))


@dataclass(frozen=True)
class CameraDistribution:
    """Uniform ranges of a camera's parameters: where cameras of one kind stand and look.

    Angles and the horizontal field of view in degrees, positions in metres, each as (low, high). The paper (section
    "Initialization", appendix "Camera Distribution") turns a range (a, b) into a normal distribution whose 95 %
    interval is the range: mean (a + b) / 2 and sigma (b - a) / (2 x 1.96).

    Raises
    ------
    ValueError
        If a range is not (low, high) with low < high, or fields of view are not between 0 and 180 degrees.

    Examples
    --------
    >>> tower = CameraDistribution("tower", (-60, 60), (40, 80), (-2, 2), (20, 60), (-1, 1), (44, 46), (-9, -7))
    >>> tower.z
    (-9, -7)
    """

    name: str
    pan: tuple[float, float]
    tilt: tuple[float, float]
    roll: tuple[float, float]
    fov: tuple[float, float]
    x: tuple[float, float]
    y: tuple[float, float]
    z: tuple[float, float]
    principal_point: float = 0.02
    """Standard deviation of the principal point from the middle of a whole picture, in shares of its width: measured
    broadcast cameras are up to 0.035 off. More where pictures are views cut out of larger ones."""
    frame: tuple[tuple[int, int], tuple[int, int]] | None = None
    """Size of the frames that the pictures were cut out of, and the pixel there at the first one of a picture; None if
    they are whole or this is unknown."""

    def __post_init__(self) -> None:
        for name in ("pan", "tilt", "roll", "fov", "x", "y", "z"):
            limits = getattr(self, name)
            if not _is_range(limits):
                raise ValueError(
                    f"{self.name!r}: {name} must be (low, high) with low < high, got {limits!r}; flags fix a value"
                )
            object.__setattr__(self, name, tuple(limits))  # a tuple is hashable
        if not 0.0 < self.fov[0] < self.fov[1] < 180.0:
            raise ValueError(f"{self.name!r}: fov must lie between 0 and 180 degrees, got {self.fov}")
        if not (is_number(self.principal_point) and 0.0 < self.principal_point < np.inf):
            raise ValueError(f"{self.name!r}: principal_point must be a positive share, got {self.principal_point}")
        if self.frame is not None and not (_are_pairs(self.frame) and min(self.frame[0]) > 0):
            raise ValueError(f"{self.name!r}: frame must be ((width, height), (x, y)) in pixels, got {self.frame!r}")


def _are_pairs(values: Any) -> bool:
    """Whether these are two tuples of two numbers."""
    pairs = values if isinstance(values, tuple) and len(values) == 2 else [None]
    return all(isinstance(one, tuple) and len(one) == 2 and all(map(is_number, one)) for one in pairs)


def _is_range(limits: Any) -> bool:
    """Whether these are two finite numbers, the lower one first."""
    is_pair = isinstance(limits, tuple | list) or (isinstance(limits, np.ndarray) and limits.ndim == 1)
    if not is_pair or len(limits) != 2 or not all(map(is_number, limits)):
        return False
    return bool(-np.inf < limits[0] < limits[1] < np.inf)


def _main(name: str, x: tuple[float, float]) -> CameraDistribution:
    return CameraDistribution(name, (-45, 45), (45, 90), (-10, 10), (8.2, 90), x, (40, 110), (-40, -5))


def _behind(name: str, pan: tuple[float, float], x: tuple[float, float]) -> CameraDistribution:
    return CameraDistribution(name, pan, (11.25, 90), (-5.6, 5.6), (8.2, 90), x, (-20, 20), (-35, -1))


MAIN_CENTER = _main("main center", (-16.5, 16.5))
MAIN_LEFT = _main("main left", (-36 - 16.5, -36 + 16.5))
MAIN_RIGHT = _main("main right", (36 - 16.5, 36 + 16.5))
MAIN_TRIBUNE = _main("main tribune", (-36, 36))
OPPOSITE_TRIBUNE = CameraDistribution(
    "opposite tribune", (135, 225), (45, 90), (-10, 10), (8.2, 90), (-36, 36), (-110, -40), (-40, -5)
)
BEHIND_LEFT_GOAL = _behind("behind left goal", (45, 135), (-95, -52.5))
BEHIND_RIGHT_GOAL = _behind("behind right goal", (-135, -45), (52.5, 95))
_STANDS = (MAIN_CENTER, MAIN_LEFT, MAIN_RIGHT, MAIN_TRIBUNE, OPPOSITE_TRIBUNE, BEHIND_LEFT_GOAL, BEHIND_RIGHT_GOAL)
# Stands of broadcast cameras, for calibrations without a prior: each is tried, the best one is kept.
# The main tribune is left out: three narrower stands cover it.
ALL_STANDS = tuple(stand for stand in _STANDS if stand is not MAIN_TRIBUNE)

DISTRIBUTIONS: Mapping[str, CameraDistribution] = MappingProxyType({stand.name: stand for stand in _STANDS})


def stand_above(
    length: float, width: float, principal_point: float = MAIN_CENTER.principal_point
) -> CameraDistribution:
    """Where cameras look down on a field, straight or steeply: drones, roofs, satellites, which may as well be near.

    A camera that looks nearly straight down, and leans a little to its side, has a large roll.

    Examples
    --------
    >>> stand_above(105.0, 68.0, principal_point=0.02).z
    (-210.0, -10.5)
    """
    reach = max(length, width)
    along, up = (-1.5 * reach, 1.5 * reach), (-2.0 * reach, -0.1 * reach)
    return CameraDistribution("above", (-180, 180), (-50, 50), (-90, 90), (20, 90), along, along, up, principal_point)


def stands_around(scale: float) -> tuple[CameraDistribution, ...]:
    """Stands around an object of which only the size is known: those of a soccer field, scaled.

    They give initial cameras and units to a solve without a prior, which needs only the order of magnitude.

    Parameters
    ----------
    scale : float
        Size of the part in view, metres; 40 for a soccer field.
    """

    def scaled(range: tuple[float, float]) -> tuple[float, float]:
        return range[0] * (scale / SOCCER_SCALE), range[1] * (scale / SOCCER_SCALE)

    return tuple(replace(stand, x=scaled(stand.x), y=scaled(stand.y), z=scaled(stand.z)) for stand in ALL_STANDS)


def stands_anywhere(scale: float) -> tuple[CameraDistribution, ...]:
    """`stands_around` with ranges so wide that labels alone tell the place, rotation and zoom of a camera.

    What whole pictures have in common stays known: the principal point, the shape of pixels, and the lens.
    """

    def wider(range: tuple[float, float]) -> tuple[float, float]:
        middle, half = 0.5 * (range[0] + range[1]), 0.5 * ANYWHERE * (range[1] - range[0])
        return middle - half, middle + half

    def widened(stand: CameraDistribution) -> CameraDistribution:
        x, y, z, pan, tilt, roll = map(wider, (stand.x, stand.y, stand.z, stand.pan, stand.tilt, stand.roll))
        return replace(stand, x=x, y=y, z=z, pan=pan, tilt=tilt, roll=roll, fov=(2.0, 150.0))

    return tuple(map(widened, stands_around(scale)))


def stands_beside(
    length: float,
    width: float,
    away: tuple[float, float],
    up: tuple[float, float],
    principal_point: float = MAIN_CENTER.principal_point,
) -> tuple[CameraDistribution, ...]:
    """Stands around a court or a rink: those of a soccer field, moved to another size and distance.

    Parameters
    ----------
    length, width : float
        Size of the field, metres.
    away : (float, float)
        Least and largest distance of cameras from the lines around the field, metres.
    up : (float, float)
        Least and largest height of cameras above the ground, metres.
    principal_point : float
        Standard deviation of the principal point, see `CameraDistribution`.

    Examples
    --------
    >>> [stand.name for stand in stands_beside(28.0, 15.0, away=(4.0, 30.0), up=(1.5, 12.0))][:3]
    ['main center', 'main left', 'main right']
    >>> stands_beside(28.0, 15.0, away=(4.0, 30.0), up=(1.5, 12.0))[0].y
    (11.5, 37.5)
    """
    along, beside, behind = length / SOCCER_LENGTH, 0.5 * width + np.array(away), 0.5 * length + np.array(away)

    def moved(stand: CameraDistribution) -> CameraDistribution:
        stand, z = replace(stand, principal_point=principal_point), (-up[1], -up[0])
        if stand.y[0] * stand.y[1] > 0.0:  # beside the field, not behind it
            y = beside if stand.y[0] > 0.0 else -beside[::-1]
            return replace(stand, x=(along * stand.x[0], along * stand.x[1]), y=tuple(y.tolist()), z=z)
        x = behind if stand.x[0] > 0.0 else -behind[::-1]
        return replace(stand, x=tuple(x.tolist()), y=(-0.3 * width, 0.3 * width), z=z)

    return tuple(map(moved, ALL_STANDS))
