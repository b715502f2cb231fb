"""The ground of a field as a surface: level, crowned, or falling to all four sides, so that rain runs off.

At (x, y) metres from the centre mark of a field of length L and width W the ground is higher than its corners by

    h(x, y) = crown p(2 y / W) + fall p(2 x / L),        p(v) = 1 - (sqrt(v^2 + e^2) - e) / (sqrt(1 + e^2) - e)

for |v| < 1, and 0 beyond the touchlines or goal lines, where the ground goes on level. The profile p is a roof whose
ridge is rounded over a share e of half the width: between a roof (e = 0) and a parabola (large e). Everything on the
field stands on it: markings, points, goals and posts are raised by the height of the ground below them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from fieldcalib._types import Array, number

# Share of half the width over which the ridge is rounded. Real grounds are nearly roofs: of 91 frames of soccer whose
# labels tell a crown the least costs are 849, 821, 809, 803 and 797 with 1.5, 0.5, 0.3, 0.2 and 0.1 (1323 on level
# ground), of a clip of one pitch 758, 626 and 562 with 1.5, 0.5 and 0.2. Drawn roofs and parabolas both come back to
# 0.02 m (median) with 0.3.
RIDGE = 0.3
STEEPEST = 0.05  # of the mean slope from the middle to a side: pitches fall by 0.01 at most, and hills are no pitches
LEAST_MET = 1e-6  # m: a ray that stays farther from the ground meets none
RAY_STEPS, RAY_STEP = 20, 1e-9  # Newton's steps of a ray to the ground, metres; three or four are the rule


class Lift(NamedTuple):
    """World coordinate z that the ground adds along a curve, with its first and second derivative; z points down."""

    z: Array
    dz: Array
    ddz: Array


class Profile(NamedTuple):
    """A section across the field: the height as a share of that of the ridge, with its derivatives by the place v."""

    share: Array
    d: Array
    dd: Array

    @classmethod
    def at(cls, v: Any) -> Profile:
        """The profile at places v, which are -1 and 1 at the sides."""
        r = np.sqrt(np.square(v) + RIDGE**2)
        inside, n = np.abs(v) < 1.0, np.sqrt(1.0 + RIDGE**2) - RIDGE
        return cls(
            np.where(inside, 1.0 - (r - RIDGE) / n, 0.0),
            np.where(inside, -v / (r * n), 0.0),
            np.where(inside, -(RIDGE**2) / (r**3 * n), 0.0),
        )


class Terrain(NamedTuple):
    """The ground of one field, or of B fields with heights and sizes (B, 1)."""

    crown: Any
    """Height of the line along the middle of the field above the touchlines, metres."""
    fall: Any
    """Height of the line across the middle above the goal lines, metres."""
    length: Any
    width: Any

    @property
    def is_level(self) -> bool:
        """Whether all heights are 0."""
        return not (np.any(self.crown) or np.any(self.fall))

    def shares(self, x: Any, y: Any) -> tuple[Array, Array]:
        """Heights at (x, y) as shares of the crown and of the fall.

        Examples
        --------
        >>> Terrain(0.3, 0.0, 105.0, 68.0).shares(0.0, np.array([0.0, 17.0, -34.0, 40.0]))[0].round(2)
        array([1.  , 0.62, 0.  , 0.  ])
        """
        return Profile.at(2.0 * y / self.width).share, Profile.at(2.0 * x / self.length).share

    def height(self, X: Array) -> Array:
        """Height (...,) of the ground above the corners at points (..., 2 or 3), metres; at infinity it is 0."""
        heights = (self.crown, self.width, X[..., 1]), (self.fall, self.length, X[..., 0])
        parts = (one * Profile.at(2.0 * p / side).share for one, side, p in heights if np.any(one))
        return sum(parts, start=np.zeros(X.shape[:-1])[()])

    def raised(self, X: Array) -> Array:
        """Points (..., 3) of the level field, moved up with the ground.

        Examples
        --------
        >>> Terrain(0.3, 0.0, 105.0, 68.0).raised(np.array([[3.0, 0.0, 0.0], [3.0, 34.0, 0.0]]))  # z points down
        array([[ 3. ,  0. , -0.3],
               [ 3. , 34. ,  0. ]])
        """
        if self.is_level:
            return X
        return np.concatenate([X[..., :2], X[..., 2:] - self.height(X)[..., None] + 0.0], axis=-1)

    def lowered(self, X: Array) -> Array:
        """Points (..., 3) moved down with the ground: the inverse of `raised`."""
        return X if self.is_level else np.concatenate([X[..., :2], X[..., 2:] + self.height(X)[..., None]], axis=-1)

    def slopes(self, x: Any, y: Any) -> tuple[Array, Array]:
        """Derivatives of the height by x and by y."""
        return _slope(self.fall, self.length, x), _slope(self.crown, self.width, y)

    def by_size(self, x: Any, y: Any) -> tuple[Array, Array]:
        """Derivatives of the height by the length and by the width of the field, at a place that stays."""
        hx, hy = self.slopes(x, y)
        return np.asarray(-hx * x / self.length), np.asarray(-hy * y / self.width)

    def lift(self, X: Array, dX: Array, ddX: Array) -> Lift:
        """The lift along a curve, from x and y of its point and of its first two derivatives, (2, ...) each."""
        z, dz, ddz = (np.asarray(0.0) for _ in range(3))
        sections = (self.fall, 2.0 / self.length), (self.crown, 2.0 / self.width)
        for (height, scale), p, dp, ddp in zip(sections, X, dX, ddX, strict=True):
            if not np.any(height):
                continue
            profile = Profile.at(scale * p)
            z = z - height * profile.share
            dz = dz - height * profile.d * scale * dp
            ddz = ddz - height * (profile.dd * np.square(scale * dp) + profile.d * scale * ddp)
        return Lift(z, dz, ddz)

    def met_by_rays(self, C: Array, direction: Array, above: float = 0.0) -> Array:
        """Points (..., 3) that rays from C (..., 3) along directions (..., 3) meet `above` metres over the ground.

        Newton's method along each ray, from where it is as low as the highest ground: heights are concave, so it comes
        to the first point that the ray meets. NaN for a ray that meets none.

        Examples
        --------
        >>> terrain = Terrain(0.3, 0.0, 105.0, 68.0)
        >>> X = terrain.met_by_rays(np.array([0.0, 60.0, -15.0]), np.array([0.0, -40.0, 15.0]))
        >>> X.round(3), bool(np.isclose(-X[2], terrain.height(X)))
        (array([ 0.   , 20.401, -0.15 ]), True)
        """
        C, direction = np.broadcast_arrays(C, direction)
        with np.errstate(divide="ignore", invalid="ignore"):
            scale = np.maximum((-above - self.crown - self.fall - C[..., 2]) / direction[..., 2], 0.0)
            for _ in range(RAY_STEPS):
                X = C + scale[..., None] * direction
                hx, hy = self.slopes(X[..., 0], X[..., 1])
                falls = direction[..., 2] + hx * direction[..., 0] + hy * direction[..., 1]
                step = (X[..., 2] + self.height(X) + above) / falls
                scale = scale - step
                if not np.nanmax(np.abs(step * falls), initial=0.0) > RAY_STEP:
                    break
            meets = (scale > 0.0) & (falls > 0.0) & (np.abs(step * falls) <= LEAST_MET)
            return np.asarray(C + np.where(meets, scale, np.nan)[..., None] * direction)


def _slope(height: Any, side: Any, p: Any) -> Array:
    """Derivative of a section of some height by its place p along a side of the field."""
    if not np.any(height):
        return np.zeros(np.shape(p))
    return np.asarray(2.0 * height / side * Profile.at(2.0 * p / side).d)


@dataclass(frozen=True)
class Ground:
    """The ground of a field, by the heights of its middle.

    Parameters
    ----------
    crown : float
        Height of the line along the middle of the field above the touchlines, metres. Natural grass has up to 0.5 m.
    fall : float
        Height of the line across the middle above the goal lines, metres, of ground that falls to all four sides.

    Raises
    ------
    ValueError
        If a height is not a finite number of metres from 0 on.

    Examples
    --------
    >>> Ground(crown=0.3).on(105.0, 68.0).height(np.array([[0.0, 0.0], [52.5, 34.0]]))
    array([0.3, 0. ])
    """

    crown: float = 0.0
    fall: float = 0.0

    def __post_init__(self) -> None:
        for name in ("crown", "fall"):
            height = number(getattr(self, name), name)
            if not (math.isfinite(height) and height >= 0.0):
                raise ValueError(f"expected {name} as a height in metres, 0 or more, got {height}")
            object.__setattr__(self, name, height)

    def on(self, length: float, width: float) -> Terrain:
        """The ground of a field of this size.

        Raises
        ------
        ValueError
            If the ground is steeper than any field.
        """
        for name, height, across in (("crown", self.crown, width), ("fall", self.fall, length)):
            if height > STEEPEST * across / 2.0:
                raise ValueError(f"expected {name} of at most {STEEPEST * across / 2.0:.2f} m, got {height:g} m")
        return Terrain(self.crown, self.fall, length, width)


LEVEL = Ground()
