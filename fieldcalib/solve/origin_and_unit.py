"""Recognition of field points that are not in metres from the centre mark, by the markings that they should lie on.

On fields of any size the markings lie at fixed distances from the middle across the field, and at fixed distances from
the goal lines along it. Points with a corner as origin, or in yards, lie on none of them, but on all of them once they
are moved and scaled.

Detection of pixels that belong to an image of another size, such as one resized for a network.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from fieldcalib._types import Array, BoolArray
from fieldcalib.fields.field import Field
from fieldcalib.fields.sports.soccer import (
    ALL_MATCHES,
    CIRCLE_RADIUS,
    GOAL_AREA_DEPTH,
    GOAL_AREA_WIDTH,
    GOAL_WIDTH,
    LARGEST_FIELD,
    PENALTY_AREA_DEPTH,
    PENALTY_AREA_WIDTH,
    PENALTY_MARK_DISTANCE,
)
from fieldcalib.fields.traits import MAIN_CENTER
from fieldcalib.geometry.camera import Camera
from fieldcalib.geometry.homography import YARD

LEAST_PIXELS = 6
# Shares of width and height to which the farthest pixels on markings reach. Labelled lines of all of 821 broadcast
# frames reach to 0.79 or more in one of the two, key points of 443 of 451 frames to 0.6; none lies past 1.03.
LEAST_REACH, FARTHEST_REACH = 0.6, 1.05

UNITS = {
    "metres": 1.0,
    "yards": YARD,
    "feet": YARD / 3.0,
    "inches": YARD / 36.0,
    "centimetres": 0.01,
    "millimetres": 0.001,
}
# Metres from the axis through both goals, and from a goal line; the last of each is of roboflow/sports' template.
ACROSS = np.array([0.0, GOAL_WIDTH / 2.0, 7.31, CIRCLE_RADIUS, GOAL_AREA_WIDTH / 2.0, PENALTY_AREA_WIDTH / 2.0, 20.5])
ALONG = np.array([0.0, GOAL_AREA_DEPTH, PENALTY_MARK_DISTANCE, PENALTY_AREA_DEPTH, 20.15])
MIDDLE = np.array([0.0, CIRCLE_RADIUS])  # metres from the halfway line
ROBOFLOW_SIZE = (120.0, 70.0)
SIZES = ((105.0, 68.0), ROBOFLOW_SIZE, (115.0 * YARD, 74.0 * YARD))  # SoccerNet's, roboflow/sports', World Cup 2014's
NEAR = 0.07  # metres: allows for rounding to yards, and for edges instead of middles of lines
LARGEST_COURT = (61.0, 31.0)  # metres: an ice rink
LEAST_POINTS, MOST_POINTS = 4, 60  # different points; more add nothing
LEAST_EXTENT = 5.0  # metres: within less, all points are near markings
EXPLAINED, UNEXPLAINED = 0.9, 0.5  # shares of the points on markings: with the other origin and unit, and as given
LEAST_EVIDENCE = 4  # different coordinates on markings, minus two for each dimension of the field that was fitted

MAIN_STAND_X = 25.0  # metres from the halfway line: main cameras of the World Cup 2014
MUCH_LESS = 0.8  # ratio of the shares of field in the ground in view: as given, and with the origin at the corner
BEYOND_STANDS = 160.0  # metres from the axis through both goals: main stands reach 110, in yards from a corner 160


def hint_of_another_size(farthest: Array, count: int, image_size: tuple[int, int]) -> str:
    """Question about pixels that fill only a part of their image, or lie beyond it; empty for other pixels.

    Parameters
    ----------
    farthest : (2,) array
        Largest x and largest y of the pixels.
    count : int
        Number of pixels; there is no warning about few.
    image_size : (int, int)
        Width and height of the image.

    Examples
    --------
    >>> hint_of_another_size(np.array([636.0, 588.0]), 12, (1920, 1080))
    'reach to (636, 588) in an image of 1920 x 1080: were they found in one of another size?'
    >>> hint_of_another_size(np.array([0.9, 1.0]), 12, (1920, 1080))
    'lie between 0 and 1: are they shares of the width and height of the image?'
    >>> hint_of_another_size(np.array([588.0, 1730.0]), 12, (1920, 1080))
    'reach to (588, 1730) in an image of 1920 x 1080: were they found in one of another size, or are x and y exchanged?'
    >>> hint_of_another_size(np.array([1730.0, 588.0]), 12, (1920, 1080))
    ''
    """
    reach = np.divide(farthest, image_size)
    if count < LEAST_PIXELS or not (np.all(reach < LEAST_REACH) or np.any(reach > FARTHEST_REACH)):
        return ""
    if np.all(farthest <= 1.0):
        return "lie between 0 and 1: are they shares of the width and height of the image?"
    (x, y), (width, height) = np.round(farthest).astype(int).tolist(), image_size
    is_turned = np.any(reach > FARTHEST_REACH) and x <= height and y <= width
    other = "were they found in one of another size" + ", or are x and y exchanged" * bool(is_turned)
    return f"reach to ({x}, {y}) in an image of {width} x {height}: {other}?"


@dataclass(frozen=True)
class Reading:
    """A likely origin and unit of field points."""

    unit: str
    corner: bool
    """Whether the origin is a corner."""
    length: float
    width: float
    hits: int
    """Number of points that lie on markings if read so."""
    hits_as_given: int
    """Number of points that lie on markings in metres from the centre mark."""
    points: int

    def __str__(self) -> str:
        """Unit and origin in words."""
        return f"{self.unit} from {'a corner' if self.corner else 'the centre mark'}"

    @property
    def remedy(self) -> str:
        """Expression that converts points X to metres from the centre mark."""
        scaled = "X" if self.unit == "metres" else f"{UNITS[self.unit]:.6g} * X"
        return f"{scaled} - ({self.length / 2.0:g}, {self.width / 2.0:g}, 0)" if self.corner else scaled


def check_coordinates(X: Array, *, anywhere: bool) -> None:
    """Raise a ValueError, or warn, if field points (N, 3) seem not to be metres from the centre mark.

    Points beyond any field are allowed only if they may be `anywhere`.
    """
    reading = other_reading(X)
    if reading is not None:
        template = reading.corner and (reading.length, reading.width) == ROBOFLOW_SIZE
        hint = "; the pitch of roboflow/sports is no real one: `key_points` has its points where they are" * template
        raise ValueError(
            f"object_points look like {reading}: {reading.hits} of {reading.points} lie on markings then, and "
            f"{reading.hits_as_given} as metres from the centre mark, which are expected; give "
            f"{reading.remedy}, with y growing towards the main camera, or prior=None for what is no field{hint}"
        )
    outside = np.flatnonzero(~np.all(np.abs(X[:, :2]) <= np.divide(LARGEST_FIELD, 2.0), axis=1))
    if len(outside) and not anywhere:
        raise ValueError(
            f"point {outside[0]} at {X[outside[0]].tolist()} is on no soccer field: expected metres from the centre "
            f"mark; without a field, prior=None is for any object"
        )
    if looks_like_a_quadrant(X):
        warnings.warn(
            "all object_points lie on one side of both axes and reach farther than half a field: if their origin is a "
            "corner of the field, subtract half its length and width; expected are metres from the centre mark",
            stacklevel=3,
        )


def is_no_pitch(X: Array) -> bool:
    """Whether points (N, 3) are of another court: they reach no farther than one, and most are on no soccer marking.

    Examples
    --------
    >>> court = np.array([[-14, -7.5, 0], [14, -7.5, 0], [14, 7.5, 0], [-14, 7.5, 0], [5.8, 2.45, 0]])
    >>> is_no_pitch(court), is_no_pitch(court * (52.5 / 14.0, 34.0 / 7.5, 1.0))
    (True, False)
    """
    x = np.unique(X[:, :2], axis=0)
    if len(x) < LEAST_POINTS or np.any(np.ptp(x, axis=0) > LARGEST_COURT) or np.any(np.ptp(x, axis=0) == 0.0):
        return False
    return other_reading(X) is None and _best(x, corner=False)[0] < UNEXPLAINED * len(x)


def looks_like_a_quadrant(X: Array) -> bool:
    """Whether points are all positive, and some farther out than any field reaches from its centre mark."""
    (_, length), (_, width) = ALL_MATCHES
    return len(X) >= LEAST_POINTS and bool(np.all(X[:, :2] >= 0.0) and np.any(X[:, :2] > (length / 2.0, width / 2.0)))


def other_reading(X: Array) -> Reading | None:
    """Find origin and unit with which points (N, 3) lie on the markings of a field; None if they do so as they are.

    Examples
    --------
    >>> from fieldcalib import soccer
    >>> X = np.array([point.X for point in soccer().points.values() if point.X[2] == 0.0])
    >>> other_reading(X), str(other_reading((X + (52.5, 34.0, 0.0)) / 0.9144))
    (None, 'yards from a corner')
    """
    x = np.unique(X[:, :2], axis=0)
    if len(x) > MOST_POINTS:
        x = x[np.random.default_rng(0).choice(len(x), MOST_POINTS, replace=False)]
    if len(x) < LEAST_POINTS:
        return None
    hits_as_given = _best(x, corner=False)[0]
    if hits_as_given >= UNEXPLAINED * len(x):
        return None
    found: list[tuple[int, Reading]] = []
    for unit, metres in UNITS.items():
        if metres * np.max(np.ptp(x, axis=0)) < LEAST_EXTENT:
            continue
        for corner in (True, False):
            hits, evidence, (length, width) = _best(metres * x, corner=corner)
            if hits >= EXPLAINED * len(x) and evidence >= LEAST_EVIDENCE:
                found.append((evidence, Reading(unit, corner, length, width, hits, hits_as_given, len(x))))
    return max(found, key=lambda one: one[0])[1] if found else None


def may_be_from_a_corner(camera: Camera, field: Field) -> bool:
    """Whether, with the origin at the far left corner, a camera would be among the main ones and see more of the field.

    This is true of none of 666 cameras of the World Cup 2014 and of SoccerNet. With their origin moved to that corner,
    407 homographies are accepted, and it is true of 350 of them. It may be true of a camera at the right end of the
    main stand that looks past the field.
    """
    corner = np.array([field.length / 2.0, field.width / 2.0])
    x, y = camera.C[:2] - corner
    if not (abs(x) < MAIN_STAND_X and MAIN_CENTER.y[0] < y < MAIN_CENTER.y[1]):
        return False
    u, v = np.meshgrid(np.linspace(0.0, 1.0, 33), np.linspace(0.0, 1.0, 19))
    ground = camera.image_to_field(np.stack([u, v], axis=-1).reshape(-1, 2) * camera.image_size)[:, :2]
    ground = ground[np.linalg.norm(ground - camera.C[:2], axis=1) < field.farthest_camera]  # false for NaN
    as_given, moved = (np.mean(np.all(np.abs(ground - origin) <= corner, axis=1)) for origin in ((0.0, 0.0), corner))
    return bool(as_given < MUCH_LESS * moved)


def reading_of_camera(camera: Camera, field: Field) -> tuple[str, bool] | None:
    """Unit and origin (whether it is the far left corner) with which a camera beyond the stands is a main camera.

    None for a camera in a possible position: yards are too similar to metres to be recognised by the position.

    Examples
    --------
    >>> from fieldcalib import soccer
    >>> in_centimetres = Camera.from_angles(0.3, 1.3, 0.01, 1800.0, (200.0, 7000.0, -1800.0), (960, 540))
    >>> reading_of_camera(in_centimetres, soccer())
    ('centimetres', False)
    """
    if not camera.C[1] > BEYOND_STANDS:
        return None
    for unit, metres in UNITS.items():
        for corner in (False, True):
            x, y, z = metres * camera.C - corner * np.array([field.length / 2.0, field.width / 2.0, 0.0])
            at_height = MAIN_CENTER.z[0] < z < MAIN_CENTER.z[1]
            if abs(x) < MAIN_STAND_X and MAIN_CENTER.y[0] < y < MAIN_CENTER.y[1] and at_height:
                return unit, corner
    return None


def _best(x: Array, *, corner: bool) -> tuple[int, int, tuple[float, float]]:
    """Number of points (N, 2) in metres on markings, evidence, and size of the field, for the size that fits best."""
    lengths = _candidates(x[:, 0], corner, 0)
    widths = _candidates(x[:, 1], corner, 1)
    found = [_score(x, corner, size, free=0) for size in SIZES]
    # each dimension by itself
    length = max(lengths, key=lambda value: int(_along(x[:, 0], value, corner).sum()), default=SIZES[0][0])
    width = max(widths, key=lambda value: int(_across(x[:, 1], value, corner).sum()), default=SIZES[0][1])
    for free_length, free_width in ((length, SIZES[0][1]), (SIZES[0][0], width), (length, width)):
        free = (free_length == length) + (free_width == width)
        found.append(_score(x, corner, (free_length, free_width), free=free))
    return max(found)


def _score(x: Array, corner: bool, size: tuple[float, float], *, free: int) -> tuple[int, int, tuple[float, float]]:
    on = _along(x[:, 0], size[0], corner) & _across(x[:, 1], size[1], corner)
    different = sum(len(np.unique(np.round(values[on], 1))) for values in x.T)
    return int(on.sum()), different - 2 * free, size


def _candidates(values: Array, corner: bool, axis: int) -> list[float]:
    """Lengths (axis 0) or widths (axis 1) of fields for which one of the coordinates lies on a marking."""
    low, high = ALL_MATCHES[axis]
    marks = ALONG if axis == 0 else ACROSS
    if corner:
        far = [values + mark for mark in ALONG] if axis == 0 else [values]  # from the other goal line, or touchline
        middle = MIDDLE if axis == 0 else marks
        found = np.concatenate([*far, *(2.0 * (values + sign * mark) for mark in middle for sign in (-1.0, 1.0))])
    else:
        found = 2.0 * np.concatenate([np.abs(values) + mark for mark in (ALONG if axis == 0 else (0.0,))])
    return sorted(set(np.round(found[(found >= low) & (found <= high)], 3).tolist()))


def _along(values: Array, length: float, corner: bool) -> BoolArray:
    """Mask of the coordinates along the field that lie on a marking."""
    from_middle = np.abs(values - length / 2.0 if corner else values)
    return _near(from_middle, MIDDLE) | _near(length / 2.0 - from_middle, ALONG)


def _across(values: Array, width: float, corner: bool) -> BoolArray:
    """Mask of the coordinates across the field that lie on a marking."""
    from_middle = np.abs(values - width / 2.0 if corner else values)
    return _near(from_middle, [*ACROSS, width / 2.0])


def _near(values: Array, marks: Iterable[float]) -> BoolArray:
    return np.asarray(np.any([np.abs(values - mark) <= NEAR for mark in marks], axis=0))
