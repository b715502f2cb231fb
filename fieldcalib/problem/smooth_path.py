"""The smooth path of the centre of a camera that moves: a drone, a camera on wires, a hand.

For three consecutive frames i, j, k at the times t, in frames, the mean acceleration of the centre,

    a = 2 ((C_k - C_j) / (t_k - t_j) - (C_j - C_i) / (t_j - t_i)) / (t_k - t_i)

is normal around zero, with the standard deviation sigma. It is linear in the centres: a = sum_m c_m C_m. Tails are
heavy, since a camera that flies evenly may brake hard.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fieldcalib._types import Array, IntArray
from fieldcalib.problem.cost_term import Coupling
from fieldcalib.problem.layout import CENTER, Layout, Role
from fieldcalib.problem.losses import RobustLoss

TAILS = RobustLoss("cauchy", 2.0)  # accelerations beyond two standard deviations count ever less


@dataclass(frozen=True, eq=False)
class SmoothPath:
    """Centres of B frames of one camera, in the order of time.

    Examples
    --------
    >>> path = SmoothPath(np.array([0, 1, 3]), 0.1)
    >>> np.allclose(path.coefficients @ np.array([0.0, 1.0, 3.0]), 0.0)  # at constant speed
    True
    """

    time: IntArray
    """Numbers of the frames, (B,) ascending."""
    sigma: float
    """Standard deviation of a coordinate of the acceleration, metres per frame squared."""

    @cached_property
    def coefficients(self) -> Array:
        """c / sigma of each three consecutive frames, (B - 2, 3)."""
        before, after = np.diff(self.time)[:-1], np.diff(self.time)[1:]
        c = np.stack([1.0 / before, -1.0 / before - 1.0 / after, 1.0 / after], axis=-1)
        return np.asarray(2.0 / self.sigma * c / (before + after)[:, None])

    @cached_property
    def threes(self) -> IntArray:
        """Indices of each three consecutive frames, (B - 2, 3)."""
        return np.asarray(np.arange(max(len(self.time) - 2, 0))[:, None] + np.arange(3))


@dataclass(frozen=True, eq=False)
class PathTerm:
    """The path of B frames as a term of the cost, at cameras theta (B, n), each with a free centre of its own."""

    path: SmoothPath
    layout: Layout
    theta: Array

    @cached_property
    def _z(self) -> Array:
        """Accelerations in units of their standard deviation, (B - 2, 3)."""
        return np.asarray(np.einsum("km,kmi->ki", self.path.coefficients, self.theta[self.path.threes][..., CENTER]))

    @cached_property
    def _losses(self) -> tuple[Array, Array]:
        return TAILS.evaluate(np.sum(np.square(self._z), axis=1))

    @cached_property
    def cost(self) -> Array:
        """Share of each frame, (B,): the cost of an acceleration counts for the last of its frames."""
        cost = np.zeros(len(self.theta))
        cost[2:] = 0.5 * self._losses[0]
        return cost

    @cached_property
    def gradient(self) -> Array:
        """Gradient by the free parameters, (B, P)."""
        gradient = np.zeros((len(self.theta), int(np.count_nonzero(self.layout.free))))
        centre = np.flatnonzero(self.layout.is_centre[self.layout.free])
        of_centres = self.path.coefficients[..., None] * (self._losses[1][:, None] * self._z)[:, None]
        np.add.at(gradient, (self.path.threes[..., None], centre), of_centres)
        return gradient

    @cached_property
    def hessian(self) -> Array:
        """Gauss-Newton Hessian within each frame, (B, P, P)."""
        P, centre = int(np.count_nonzero(self.layout.free)), np.flatnonzero(self.layout.is_centre[self.layout.free])
        squares = np.zeros(len(self.theta))
        np.add.at(squares, self.path.threes, self._losses[1][:, None] * np.square(self.path.coefficients))
        hessian = np.zeros((len(self.theta), P, P))
        hessian[:, centre, centre] = squares[:, None]
        return hessian

    @cached_property
    def coupling(self) -> Coupling:
        """Hessian between the own parameters of frames, of which the centre is a part."""
        own = self.layout.roles == Role.FRAME
        o, centre, c = int(np.count_nonzero(own)), np.flatnonzero(self.layout.is_centre[own]), self.path.coefficients
        pairs = ((0, 1), (1, 2), (0, 2))
        first, second = (np.concatenate([self.path.threes[:, pair[side]] for pair in pairs]) for side in (0, 1))
        blocks = np.zeros((len(first), o, o))
        products = np.concatenate([self._losses[1] * c[:, a] * c[:, b] for a, b in pairs])
        blocks[:, centre, centre] = products[:, None]
        return Coupling(first, second, blocks)
