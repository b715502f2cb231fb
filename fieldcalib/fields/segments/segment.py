"""The protocol of all kinds of segments: geometry in metres, drawing, packing, number of equations."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Hashable, Iterable
from dataclasses import dataclass
from typing import ClassVar, NamedTuple, Self

import numpy as np

from fieldcalib._types import Array, IntArray, are_finite, is_number, real_array
from fieldcalib.fields.segments.rows import Rows

Vector = tuple[float, float, float]


class Parts(NamedTuple):
    """Equal parts of a segment, N of them."""

    X: Array
    """Middles of the parts, (N, 3)."""
    along: Array
    """Unit vectors along the segment there, (N, 3)."""
    share: Array
    """Position between the segment's anchors, (N,): when the field's size changes, a part moves as that place does."""
    length: float
    """Length of all parts together, metres."""


class Ring(NamedTuple):
    """Part of a circle, with the attributes of an `Arc`."""

    center: Vector
    radius: float
    start: float = 0.0
    stop: float = 2.0 * np.pi
    u: Vector = (1.0, 0.0, 0.0)
    v: Vector = (0.0, 1.0, 0.0)


@dataclass(frozen=True)
class Segment(ABC):
    """A piece of the calibration object: the protocol of all kinds.

    A kind is two classes in one file: a frozen dataclass that derives from this class, and the rows in which its
    labelled pixels are packed (`fieldcalib.fields.segments.rows`). `fieldcalib.fields.segments` registers it.
    """

    is_point: ClassVar[bool] = False
    """Whether it is a named point: nothing is painted for it, and its pixels are one place."""
    is_straight: ClassVar[bool] = False
    is_arc: ClassVar[bool] = False

    @property
    @abstractmethod
    def rows(self) -> type[Rows]:
        """The class of rows that its labelled pixels are packed in."""

    @property
    @abstractmethod
    def vectors(self) -> Array:
        """Vectors that describe it in these rows, (G, 3), see `Rows.geometry`."""

    @abstractmethod
    def sample(self, spacing: float = 1.0) -> Array:
        """Points along it, at most `spacing` metres apart, (N, 3)."""

    @abstractmethod
    def equations(self, pixels: int) -> int:
        """Largest number of independent equations that so many pixels give."""

    @abstractmethod
    def mirrored(self, signs: Vector) -> Self:
        """The segment with its coordinates multiplied by signs."""

    @property
    def anchors(self) -> Array:
        """The two places (2, 3) with which it moves as the size of the field changes; zeros if it does not."""
        return np.zeros((2, 3))

    @property
    def span(self) -> tuple[float, float]:
        """Angle of the middle of an arc, and half of the angle that it spans; zeros for other segments."""
        return 0.0, 0.0

    @property
    def is_curve(self) -> bool:
        """Whether it is a line or a curve, along which something may be painted."""
        return not self.is_point

    @property
    def whole(self) -> Hashable:
        """Key of the whole line or circle: equal for the parts of one circle."""
        return self

    @property
    def is_whole(self) -> bool:
        """Whether it is a closed circle."""
        return False

    @property
    def middle_of_curvature(self) -> Vector:
        """The point that its outer side faces away from: the middle of the field; for an arc its own centre."""
        return (0.0, 0.0, 0.0)

    def polyline(self, spacing: float) -> Array:
        """Points (N, 3) between which it is drawn straight, at most about `spacing` metres apart where it is bent."""
        return self.sample(spacing)

    @property
    def ring(self) -> Ring | None:
        """The part of a circle along which its paint runs; None where that is straight from corner to corner."""
        return None

    def corners(self) -> Array:
        """Points (N, 3) between which its paint is straight."""
        return self.polyline(1.0)

    def samples(self, count: int) -> Array:
        """Points (N, 3) that represent it in the NDC loss; an arc has `count` of them."""
        return self.sample()

    def evaluated(self, straight: float, bent: float) -> Array:
        """Points (N, 3) as SoccerNet's evaluation samples a segment: `straight` or `bent` metres from its start on."""
        return self.sample(bent)

    def parts(self, longest: float) -> Parts | None:
        """Equal parts no longer than `longest` metres; None where it has no length."""
        return None

    def order(self, xy: Array) -> IntArray:
        """Order of its pixels (N, 2) along it."""
        xy = some_pixels(xy)
        offset = xy - xy.mean(axis=0)
        return np.argsort(offset @ np.linalg.svd(offset, full_matrices=False)[2][0], kind="stable")


MOST_SAMPLES = 10_000_000  # of a segment: 240 MB


def steps(length: float, spacing: float) -> int:
    """Number of equal steps of at most `spacing` metres over a length; a ValueError if the spacing is none."""
    if not (is_number(spacing) and spacing > 0.0 and length / MOST_SAMPLES < spacing):
        raise ValueError(f"spacing must be positive metres, not too small for {length:g} m, got {spacing!r}")
    return int(np.ceil(length / spacing))


def middles(length: float, longest: float) -> Array:
    """Middles of equal parts no longer than `longest`, as shares of a length."""
    count = steps(length, longest)
    return (np.arange(count) + 0.5) / count


def some_pixels(xy: Array) -> Array:
    """Pixels (N, 2), N > 0, or a ValueError."""
    array = real_array(xy)
    if array.ndim != 2 or array.shape[1] != 2 or not array.size or not are_finite(array):
        raise ValueError(f"expected finite pixels (N, 2), at least one, got an array of shape {array.shape}")
    return array


def vector(values: Iterable[float], what: str) -> Vector:
    """Three finite numbers, or a ValueError that names what they are."""
    try:
        array = real_array(values)
    except ValueError as error:
        raise ValueError(f"{what}: {error}") from None
    if array.shape != (3,) or not are_finite(array):
        raise ValueError(f"{what} needs three finite coordinates in metres, got {values!r}")
    x, y, z = array.tolist()
    return x, y, z


def mirrored_point(X: Vector, signs: Vector) -> Vector:
    """A point with its coordinates multiplied by signs."""
    x, y, z = (sign * one + 0.0 for sign, one in zip(vector(signs, "signs"), X, strict=True))  # no negative zeros
    return x, y, z
