"""Camera distributions: the stands from which cameras look at a field, as ranges of their parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from fieldcalib._checks import is_number
from fieldcalib._types import Array


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
DISTRIBUTIONS: Mapping[str, CameraDistribution] = MappingProxyType({stand.name: stand for stand in _STANDS})

SOCCER_LENGTH = 105.0  # metres: length of the field that the stands above surround
SOCCER_SCALE = 40.0  # metres: size of the part of a soccer field that is usually in view

# Stands of broadcast cameras, for calibrations without a prior: each is tried, the best one is kept.
# The main tribune is left out: three narrower stands cover it.
ALL_STANDS = tuple(stand for stand in _STANDS if stand is not MAIN_TRIBUNE)


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
