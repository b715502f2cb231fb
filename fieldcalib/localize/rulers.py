"""Reference curves that give pixels coordinates along and across a segment: a straight line and an ellipse."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np

from fieldcalib._types import Array, IntArray

LEAST_RADIUS = 1e-9  # of an ellipse mapped to the unit circle: avoids a division by zero at its centre
LEAST_WEIGHT = 1e-9  # of the pixels of a line: avoids a division by zero where there are none


class Ruler(Protocol):
    """Coordinates along and across a curve."""

    def measure(self, xy: Array) -> tuple[Array, Array]:
        """Coordinates of pixels (n, 2): along the curve, (n,), and across it, (n,); px."""

    def place(self, s: Array, d: Array) -> Array:
        """Pixels (n, 2) of coordinates: the inverse of `measure`."""


@dataclass(frozen=True)
class StraightRuler:
    """A straight line, or several.

    Examples
    --------
    >>> xy = np.array([[0.0, 2.0], [4.0, 2.1], [8.0, 2.0]])
    >>> s, d = StraightRuler.fit(xy, np.ones(3)).measure(xy)
    >>> np.abs(d).round(3)
    array([0.033, 0.067, 0.033])
    """

    origin: Array
    """A point on the line, (2,), or on each of several lines, (..., 2)."""
    direction: Array
    """Unit vector, (2,), or one of each of several lines, (..., 2)."""

    @classmethod
    def fit(cls, xy: Array, weight: Array) -> Self:
        """The total least squares line through weighted pixels (n, 2)."""
        each = cls.fit_each(xy, weight, np.zeros(len(xy), dtype=np.intp), 1)
        return cls(each.origin[0], each.direction[0])

    @classmethod
    def fit_each(cls, xy: Array, weight: Array, member: IntArray, count: int) -> Self:
        """Fit `count` lines, each to the pixels with its number in `member` (n,); arbitrary without pixels."""

        def summed(values: Array) -> Array:
            return np.asarray(np.bincount(member, weight * values, count), dtype=float)

        mass = np.maximum(np.bincount(member, weight, count), LEAST_WEIGHT)
        origin = np.stack([summed(xy[:, 0]), summed(xy[:, 1])], axis=1) / mass[:, None]
        x, y = (xy - origin[member]).T
        moment = np.moveaxis(np.array([[summed(x * x), summed(x * y)], [summed(x * y), summed(y * y)]]), -1, 0)
        return cls(origin, np.linalg.eigh(moment)[1][..., 1])

    def of(self, member: IntArray) -> Self:
        """The line of each pixel, by its index (n,) among several lines."""
        return type(self)(self.origin[member], self.direction[member])

    def measure(self, xy: Array) -> tuple[Array, Array]:
        """See `Ruler`."""
        x, y = np.moveaxis(self.direction, -1, 0)
        offset_x, offset_y = (xy - self.origin).T
        return offset_x * x + offset_y * y, offset_y * x - offset_x * y

    def place(self, s: Array, d: Array) -> Array:
        """See `Ruler`."""
        x, y = np.moveaxis(self.direction, -1, 0)
        return np.asarray(self.origin + np.stack([s * x - d * y, s * y + d * x], axis=-1))


@dataclass(frozen=True)
class EllipseRuler:
    """An ellipse: the points x with ``|A (x - centre)| = 1``. The coordinate across it grows away from the centre.

    Examples
    --------
    >>> phi = np.linspace(0.0, 3.0, 9)
    >>> xy = np.column_stack([7.0 + 20.0 * np.cos(phi), 5.0 + 10.0 * np.sin(phi)])
    >>> ruler = EllipseRuler.fit(xy, np.ones(9))
    >>> ruler.centre.round(6)
    array([7., 5.])
    >>> bool(np.allclose(ruler.place(*ruler.measure(xy + 1.0)), xy + 1.0))
    True
    """

    centre: Array
    """Pixels, (2,)."""
    A: Array
    """Linear map of the ellipse to the unit circle, (2, 2)."""
    start: float
    """Angle of the origin of lengths, on the unit circle to which A maps the ellipse."""

    @classmethod
    def fit(cls, xy: Array, weight: Array) -> Self:
        """The ellipse with the least squared algebraic distances to weighted pixels (n, 2).

        Raises
        ------
        numpy.linalg.LinAlgError
            If the pixels are collinear or coincide, or are fewer than five.

        References
        ----------
        Halir, Flusser: Numerically stable direct least squares fitting of ellipses, WSCG 1998.
        """
        mean = weight @ xy / np.sum(weight)
        scale = np.sqrt(weight @ np.sum(np.square(xy - mean), axis=1) / np.sum(weight))
        if not scale > 0.0:
            raise np.linalg.LinAlgError("all pixels coincide")
        x, y = (xy - mean).T / scale
        D1, D2 = np.stack([x * x, x * y, y * y]), np.stack([x, y, np.ones_like(x)])
        S1, S2, S3 = (weight * D1) @ D1.T, (weight * D1) @ D2.T, (weight * D2) @ D2.T
        T = -np.linalg.solve(S3, S2.T)
        M = (S1 + S2 @ T)[[2, 1, 0]] * [[0.5], [-1.0], [0.5]]
        conics = np.real(np.linalg.eig(M)[1])
        a, b, c = conics[:, np.argmax(4.0 * conics[0] * conics[2] - np.square(conics[1]))]  # one is an ellipse
        d, e, f = T @ (a, b, c)
        Q = np.array([[a, b / 2.0], [b / 2.0, c]])
        centre = -0.5 * np.linalg.solve(Q, (d, e))
        A = np.linalg.cholesky(Q / -(f + 0.5 * centre @ (d, e))).T / scale
        centre = mean + scale * centre
        x, y = A @ (weight @ (xy - centre))
        return cls(centre, A, float(np.arctan2(y, x)))  # opposite to the unseen part

    @property
    def radius(self) -> float:
        """Geometric mean of the half axes, px."""
        return float(1.0 / np.sqrt(np.linalg.det(self.A)))

    def measure(self, xy: Array) -> tuple[Array, Array]:
        """See `Ruler`."""
        offset = xy - self.centre
        x, y = self.A @ offset.T
        phi = np.mod(np.arctan2(y, x) - self.start + np.pi, 2.0 * np.pi) - np.pi
        stretch = np.maximum(np.hypot(x, y), LEAST_RADIUS)
        return self.radius * phi, np.linalg.norm(offset, axis=1) * (1.0 - 1.0 / stretch)

    def place(self, s: Array, d: Array) -> Array:
        """See `Ruler`."""
        phi = s / self.radius + self.start
        spoke = np.linalg.solve(self.A, np.stack([np.cos(phi), np.sin(phi)])).T
        return np.asarray(self.centre + spoke * (1.0 + d / np.linalg.norm(spoke, axis=1))[:, None])
