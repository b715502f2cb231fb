"""Terms of the cost that tie frames of one camera: static background, or the smooth path of a camera that moves.

Two frames of a camera on a tripod both see static points of the background. However the camera turns and zooms, the ray
of such a point, at pixel p in the first frame, predicts its pixel q in the second. With x its camera coordinates in the
first frame and w its inverse depth there,

    r = q - pi_2(R_2 R_1^T x + w R_2 (C_1 - C_2)),        x = (s_1 / f_1, 1),

where s_1 is the ideal offset of p. Points are assumed to lie on the ground, or on a wall around it. On a tripod the
depth need not be known well: the centres differ by some decimetres at most, as the camera does not turn about its pupil
(`fieldcalib.problem.layout`). With A = ds_2/ds_1 the derivative of the second offset by the first, along ground or wall
and through both lenses,

    dr/dtheta_1 = A dpi_1/dtheta_1,        dr/dtheta_2 = -dpi_2/dtheta_2.

The centre of a drone, of a camera on wires, or of a hand moves on a smooth path. For three consecutive frames i, j, k
at the times t, in frames, the mean acceleration of the centre,

    a = 2 ((C_k - C_j) / (t_k - t_j) - (C_j - C_i) / (t_j - t_i)) / (t_k - t_i)

is normal around zero, with the standard deviation sigma. It is linear in the centres: a = sum_m c_m C_m. Tails are
heavy, since a camera that flies evenly may brake hard.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from fieldcalib._types import Array, BoolArray, IntArray
from fieldcalib.problem.cost_term import Coupling
from fieldcalib.problem.layout import CENTER, Layout, Role
from fieldcalib.problem.losses import RobustLoss
from fieldcalib.problem.projection import Projection

LEAST_DEPTH = 1e-9  # least depth in the second camera, as a share of the depth in the first
TAILS = RobustLoss("cauchy", 2.0)  # accelerations beyond two standard deviations count ever less


@dataclass(frozen=True, eq=False)
class BackgroundPairs:
    """Static points that K pairs of frames see, padded to N points each."""

    first: IntArray
    """First frame of each pair, (K,); not an index into the problem's frames where these cameras are `known`."""
    second: IntArray
    """Second frame of each pair, (K,)."""
    p: Array
    """Pixels in the first frame, (K, N, 2)."""
    q: Array
    """Pixels in the second frame, (K, N, 2)."""
    weight: Array
    """One over the variance of a coordinate in pixels, (K, N); 0 where there is only padding."""
    loss: RobustLoss
    """Loss of the distance in the second frame."""
    walls: Array | None = None
    """Half the length and width, metres, of the walls around the ground; None if all points are at infinity."""
    known: Array | None = None
    """Cameras (K, n) of the first frames, if these are not frames of the problem; None if `first` are their indices.

    With known cameras, the parameters that frames share are known too."""

    def __len__(self) -> int:
        return len(self.first)

    def take(self, index: IntArray) -> BackgroundPairs:
        """The pairs whose second frame is in `index`, with second frames renumbered; first cameras must be known.

        Raises
        ------
        ValueError
            If the cameras of the first frames are estimated too.
        """
        if self.known is None:
            raise ValueError("frames that are tied to one another cannot be taken apart")
        parts = [np.flatnonzero(self.second == frame) for frame in index]
        pairs = np.concatenate([np.zeros(0, dtype=np.intp), *parts])
        return replace(self.at(pairs), second=np.repeat(np.arange(len(parts)), [len(part) for part in parts]))

    def at(self, index: IntArray | BoolArray) -> BackgroundPairs:
        """Some of the pairs, in that order."""
        return replace(self, **{name: one[index] for name, one in self._columns.items()})

    @property
    def swapped(self) -> BackgroundPairs:
        """The pairs with first and second frame swapped."""
        return replace(self, first=self.second, second=self.first, p=self.q, q=self.p)

    @staticmethod
    def joined(one: BackgroundPairs, other: BackgroundPairs) -> BackgroundPairs:
        """The pairs of `one` followed by those of `other`."""
        more = other._columns
        both: dict[str, Any] = {name: np.concatenate([some, more[name]]) for name, some in one._columns.items()}
        return replace(one, **both)

    @property
    def _columns(self) -> dict[str, Any]:
        columns = {name: getattr(self, name) for name in ("first", "second", "p", "q", "weight", "known")}
        return {name: column for name, column in columns.items() if column is not None}


@dataclass(frozen=True, eq=False)
class BackgroundTerm:
    """Static points of pairs of B frames as a term of the cost, at their cameras theta (B, n)."""

    pairs: BackgroundPairs
    layout: Layout
    theta: Array

    @cached_property
    def _projections(self) -> tuple[Projection, Projection]:
        first = self.theta[self.pairs.first] if self.pairs.known is None else self.pairs.known
        return Projection(first, self.layout), Projection(self.theta[self.pairs.second], self.layout)

    @cached_property
    def _rays(self) -> tuple[Array, Array]:
        """Ideal offsets and camera coordinates of p at depth 1 in the first frame, (2, K, N) and (3, K, N)."""
        one = self._projections[0]
        s = one.ideal_offset(one.observed_offset(self.pairs.p))
        return s, np.array([s[0] / one.f, s[1] / one.f, np.ones_like(s[0])])

    @cached_property
    def _seen(self) -> tuple[Array, Array, Array, Array, Array]:
        """Ideal offsets and inverse depths in both frames, and camera coordinates of the second (3, K, N)."""
        one, two = self._projections
        s, x = self._rays
        w = np.maximum(np.sum(self._surface * x, axis=0), 0.0)
        M = two.R @ np.swapaxes(one.R, 1, 2)
        y = np.moveaxis(M @ np.moveaxis(x, 0, 1), 1, 0) + self._shift * w
        y[2] = np.where(np.abs(y[2]) < LEAST_DEPTH, LEAST_DEPTH, y[2])
        return s, w, two.f * y[:2] / y[2], w / y[2], y

    @cached_property
    def _shift(self) -> Array:
        """Vector from the second centre to the first, in camera coordinates of the second, (3, K, 1)."""
        one, two = self._projections
        return np.moveaxis(two.R @ np.swapaxes(one.C - two.C, 1, 2), 1, 0)

    @cached_property
    def _surface(self) -> Array:
        """Plane g (3, K, N) of ground or wall that each ray x meets: the inverse depth is g . x, or 0."""
        camera, (_, x) = self._projections[0], self._rays
        if self.pairs.walls is None:
            return np.zeros_like(x)
        d = np.swapaxes(camera.R, 1, 2) @ np.moveaxis(x, 0, 1)  # (K, 3, N)
        beyond = np.sign(d) * np.append(self.pairs.walls, 0.0)[:, None] - np.swapaxes(camera.C, 1, 2)
        with np.errstate(divide="ignore", invalid="ignore"):
            inverse = d / beyond
        inverse[~np.isfinite(inverse)] = 0.0
        nearest = np.argmax(inverse, axis=1)[:, None]
        met = np.take_along_axis(inverse, nearest, axis=1) > 0.0
        distance = np.where(met, np.take_along_axis(beyond, nearest, axis=1), np.inf)
        return np.moveaxis(np.take_along_axis(camera.R, nearest, axis=2) / distance, 1, 0)

    @cached_property
    def r(self) -> Array:
        """Distances in the second frame, pixels, (2, K, N)."""
        two = self._projections[1]
        return np.asarray(two.observed_offset(self.pairs.q) - two.real_offset(self._seen[2]))

    @cached_property
    def _losses(self) -> tuple[Array, Array]:
        return self.pairs.loss.evaluate(np.sum(np.square(self.r), axis=0))

    @cached_property
    def irls_weight(self) -> Array:
        """Weights of the components of r in the normal equations, (K, 2 N), x before y."""
        return np.tile(self.pairs.weight * self._losses[1], 2)

    @cached_property
    def cost(self) -> Array:
        """Share of each frame, (B,): the cost of a pair counts for its second frame."""
        of_pair = 0.5 * np.sum(self.pairs.weight * self._losses[0], axis=1)
        return np.asarray(np.bincount(self.pairs.second, of_pair, minlength=len(self.theta)), dtype=float)

    def jacobians(self, free: BoolArray) -> tuple[Array, Array]:
        """Derivatives of r by the parameters of the first and of the second camera, (K, P, 2 N) each, x before y."""
        return self._by_first(free), self._by_second(free)

    def _by_first(self, free: BoolArray) -> Array:
        one, two = self._projections
        s1, w1, s2, _, y = self._seen
        zero, unit = np.zeros_like(s1[0]), np.ones_like(s1[0])
        axes = np.array([unit, zero]), np.array([zero, unit])
        M = np.moveaxis(two.R @ np.swapaxes(one.R, 1, 2), 0, 2)[..., None]  # (3, 3, K, 1)
        zoom = two.f / one.f / y[2]
        by_x = [M[:, b] + self._shift * self._surface[b] for b in (0, 1)]  # dy/dx_b, (3, K, N) each
        # columns of ds_2/ds_1, pushed through the second lens
        columns = [np.array([zoom * (by[a] - s2[a] / two.f * by[2]) for a in (0, 1)]) for by in by_x]
        _, *through = two.push(s2, *columns)
        _, *first = one.push(s1, *axes)
        determinant = first[0][0] * first[1][1] - first[0][1] * first[1][0]
        inverse = np.array([[first[1][1], -first[1][0]], [-first[0][1], first[0][0]]]) / determinant
        A = np.einsum("bakn,bckn->ackn", np.array(through), inverse)
        in_x, in_y = np.split(_image_derivatives(one, s1, w1, free), 2, axis=-1)
        return np.concatenate([A[a, 0, :, None] * in_x + A[a, 1, :, None] * in_y for a in (0, 1)], axis=-1)

    @cached_property
    def by_second(self) -> Array:
        """Derivatives of r by the free parameters of the second camera, (K, P, 2 N), x before y."""
        return self._by_second(self.layout.free)

    def _by_second(self, free: BoolArray) -> Array:
        _, _, s2, w2, _ = self._seen
        return -_image_derivatives(self._projections[1], s2, w2, free)

    @property
    def gradient(self) -> Array:
        """Gradient by the free parameters, (B, P)."""
        return self._normal_equations[0]

    @property
    def hessian(self) -> Array:
        """Gauss-Newton Hessian within each frame, (B, P, P)."""
        return self._normal_equations[1]

    @property
    def coupling(self) -> Coupling | None:
        """Hessian between the own parameters of paired frames; None if the first cameras are known."""
        return self._normal_equations[2]

    @cached_property
    def _normal_equations(self) -> tuple[Array, Array, Coupling | None]:
        """Gradient, Hessian and coupling; derivatives by shared parameters count for the second frame of a pair."""
        shared, second, P = self.layout.shared, self.pairs.second, len(self.layout.shared)
        own, r = ~shared[:, None], np.concatenate(self.r, axis=-1)
        gradient, hessian = np.zeros((len(self.theta), P)), np.zeros((len(self.theta), P, P))

        def add(frame: IntArray, J: Array) -> None:
            """Add residuals to some frames, with their derivatives J (K, P, 2 N)."""
            weighted = J * self.irls_weight[:, None]
            np.add.at(gradient, frame, (weighted @ r[..., None])[..., 0])
            np.add.at(hessian, frame, weighted @ np.swapaxes(J, 1, 2))

        if self.pairs.known is not None:  # and the shared parameters too
            add(second, np.where(own, self.by_second, 0.0))
            return gradient, hessian, None
        first, by_first = self.pairs.first, self._by_first(self.layout.free)
        by_own, by_second = np.where(own, by_first, 0.0), self.by_second + np.where(own, 0.0, by_first)
        add(first, by_own)
        add(second, by_second)
        between = (by_own * self.irls_weight[:, None]) @ np.swapaxes(by_second, 1, 2)
        border = np.where(shared, between, 0.0)
        np.add.at(hessian, first, border + np.swapaxes(border, 1, 2))
        return gradient, hessian, Coupling(first, second, between[:, ~shared][:, :, ~shared])


def _image_derivatives(projection: Projection, s: Array, inverse_depth: Array, free: BoolArray) -> Array:
    """Derivatives of pixels, (B, P, 2 N), x before y."""
    zero, one = np.zeros_like(s[0]), np.ones_like(s[0])
    axes = np.array([np.concatenate([one, zero], axis=-1), np.concatenate([zero, one], axis=-1)])
    return projection.derivatives(np.tile(s, 2), np.tile(inverse_depth, 2), axes, free)


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
