"""Points: named places of the object, measured along both axes of the image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fieldcalib._types import Array
from fieldcalib.fields.segments.closest import ClosestPoints, View, at_points
from fieldcalib.fields.segments.rows import Rows
from fieldcalib.fields.segments.segment import Ring, Segment, Vector, mirrored_point, vector

MARK = 1e-3  # m: radius of the circle that is painted for a point


class PointRows(Rows):
    """Pixels of points: the one vector of a row is X."""

    name, vectors, components = "points", 1, 2
    shares_noise = False  # the noise of the two axes is independent
    compiled = ("ALONG_X", "ALONG_Y")

    def closest_points(self, view: View) -> list[ClosestPoints]:
        """The points themselves."""
        return at_points(view, self.xy, self.geometry[..., 0, :])


@dataclass(frozen=True)
class Point(Segment):
    """A labelled point of the object; its residual has two components.

    Examples
    --------
    >>> Point((0.0, 0.0, 0.0)).sample()
    array([[0., 0., 0.]])
    """

    X: Vector

    is_point = True
    rows = PointRows

    def __post_init__(self) -> None:
        object.__setattr__(self, "X", vector(self.X, "a Point"))

    def sample(self, spacing: float = 1.0) -> Array:
        """The point itself, as a (1, 3) array."""
        return np.array([self.X])

    @property
    def vectors(self) -> Array:
        """X, (1, 3)."""
        return np.array([self.X])

    @property
    def anchors(self) -> Array:
        """X twice, (2, 3)."""
        return np.array([self.X, self.X])

    @property
    def ring(self) -> Ring:
        """A small circle around it."""
        return Ring(self.X, MARK)

    def equations(self, pixels: int) -> int:
        """Two equations, one for each axis of the image."""
        return 2

    def mirrored(self, signs: Vector) -> Point:
        """The point with its coordinates multiplied by signs."""
        return Point(mirrored_point(self.X, signs))
