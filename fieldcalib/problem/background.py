"""Static points of the background that two frames of one camera on a tripod both see.

Wherever the camera turns and zooms, such a point p of one frame tells where it must be in the other: through the ray of
p. With x its camera coordinates in the first frame and w its inverse depth there,

    r = q - pi_2(R_2 R_1^T x + w R_2 (C_1 - C_2)),        x = (s_1 / f_1, 1),

s_1 the ideal offset of p. The centres differ by what the camera turns off its pupil (`fieldcalib.problem.layout`), some
decimetres at most, so that the depth need not be known well: points are taken to be on the ground, or on a wall around
it. What moves in the first image moves in the second by A = ds_2/ds_1, between the lenses; hence

    dr/dtheta_1 = A dpi_1/dtheta_1,        dr/dtheta_2 = -dpi_2/dtheta_2.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from fieldcalib._types import Array, BoolArray, IntArray
from fieldcalib.problem.layout import Layout
from fieldcalib.problem.losses import RobustLoss
from fieldcalib.problem.projection import Projection

LEAST_DEPTH = 1e-9  # of a point in the second camera's plane, in depths of the first


@dataclass(frozen=True, eq=False)
class BackgroundPairs:
    """Static points that K pairs of frames see, padded to N points each."""

    first: IntArray
    """Frame of each pair, (K,); of no meaning where the cameras are `known`."""
    second: IntArray
    """(K,)"""
    p: Array
    """Pixels in the first frame, (K, N, 2)."""
    q: Array
    """Pixels in the second frame, (K, N, 2)."""
    weight: Array
    """(K, N): one over the variance of a coordinate, in pixels; 0 where there is only padding."""
    loss: RobustLoss
    """Of the distance in the second frame."""
    walls: Array | None = None
    """Half the length and width, metres, of what stands around the ground; None: everything is at infinity."""
    known: Array | None = None
    """Cameras (K, n) of the first frames, if these are no frames of the problem; None: `first` says which they are.

    What frames share is then known too."""

    def __len__(self) -> int:
        return len(self.first)

    def take(self, index: IntArray) -> BackgroundPairs:
        """The pairs of the frames `index`, numbered anew; their first cameras must be known.

        Raises
        ------
        ValueError
            If the cameras of the first frames are estimated too.
        """
        if self.known is None:
            raise ValueError("frames that are tied to one another cannot be taken apart")
        parts = [np.flatnonzero(self.second == frame) for frame in index]
        pairs = np.concatenate([np.zeros(0, dtype=np.intp), *parts])
        second = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
        return replace(
            self,
            first=self.first[pairs],
            second=second,
            p=self.p[pairs],
            q=self.q[pairs],
            weight=self.weight[pairs],
            known=self.known[pairs],
        )


class NormalEquations(NamedTuple):
    """What the pairs add to the normal equations of B frames with P free parameters."""

    cost: Array
    """(B,)"""
    gradient: Array
    """(B, P)"""
    hessian: Array
    """(B, P, P)"""
    coupling: Array
    """Between the frames' own parameters of the first and of the second frame, (K, o, o)."""


@dataclass(frozen=True, eq=False)
class BackgroundEvaluation:
    """Pairs of B frames at their cameras theta (B, n)."""

    pairs: BackgroundPairs
    layout: Layout
    theta: Array

    @cached_property
    def _projections(self) -> tuple[Projection, Projection]:
        first = self.theta[self.pairs.first] if self.pairs.known is None else self.pairs.known
        return Projection(first, self.layout), Projection(self.theta[self.pairs.second], self.layout)

    @cached_property
    def _seen(self) -> tuple[Array, Array, Array, Array, Array]:
        """Ideal offsets and inverse depths in both frames, and camera coordinates of the second (3, K, N)."""
        one, two = self._projections
        s = one.ideal_offset(one.observed_offset(self.pairs.p))
        x = np.array([s[0] / one.f, s[1] / one.f, np.ones_like(s[0])])
        w = self._inverse_depth(one, x)
        M = two.R @ np.swapaxes(one.R, 1, 2)
        shift = (two.R @ np.swapaxes(one.C - two.C, 1, 2))[..., 0]
        y = np.moveaxis(M @ np.moveaxis(x, 0, 1), 1, 0) + np.moveaxis(shift, 1, 0)[..., None] * w
        y[2] = np.where(np.abs(y[2]) < LEAST_DEPTH, LEAST_DEPTH, y[2])
        return s, w, two.f * y[:2] / y[2], w / y[2], y

    def _inverse_depth(self, camera: Projection, x: Array) -> Array:
        """Of camera coordinates (3, K, N): where their rays reach the ground or a wall; 0 if they reach neither."""
        if self.pairs.walls is None:
            return np.zeros_like(x[0])
        d = np.moveaxis(np.swapaxes(camera.R, 1, 2) @ np.moveaxis(x, 0, 1), 1, 0)
        C = np.moveaxis(camera.C, -1, 0)
        beyond = np.array([np.sign(d[i]) * self.pairs.walls[i] - C[i] for i in (0, 1)])
        with np.errstate(divide="ignore", invalid="ignore"):
            inverse = np.array([*(d[:2] / beyond), -d[2] / C[2]])
        return np.asarray(np.max(np.where(np.isfinite(inverse), inverse, 0.0), axis=0, initial=0.0))

    @cached_property
    def r(self) -> Array:
        """Distances in the second frame, pixels, (2, K, N)."""
        two = self._projections[1]
        return np.asarray(two.observed_offset(self.pairs.q) - two.real_offset(self._seen[2]))

    @cached_property
    def _losses(self) -> tuple[Array, Array]:
        return self.pairs.loss.evaluate(np.sum(np.square(self.r), axis=0))

    @cached_property
    def pull(self) -> Array:
        """What each component of r weighs in the normal equations, (K, 2 N), x before y."""
        return np.tile(self.pairs.weight * self._losses[1], 2)

    @cached_property
    def cost(self) -> Array:
        """(B,), each pair's being that of its second frame."""
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
        M = two.R @ np.swapaxes(one.R, 1, 2)
        zoom = two.f / one.f / y[2]
        # columns of ds_2/ds_1, pushed through the second lens
        columns = [
            np.array([zoom * (M[:, a, b, None] - s2[a] / two.f * M[:, 2, b, None]) for a in (0, 1)]) for b in (0, 1)
        ]
        _, *through = two.push(s2, *columns)
        _, *first = one.push(s1, *axes)
        determinant = first[0][0] * first[1][1] - first[0][1] * first[1][0]
        inverse = np.array([[first[1][1], -first[1][0]], [-first[0][1], first[0][0]]]) / determinant
        A = np.einsum("bakn,bckn->ackn", np.array(through), inverse)
        by_x, by_y = np.split(_image_derivatives(one, s1, w1, free), 2, axis=-1)
        return np.concatenate([A[a, 0, :, None] * by_x + A[a, 1, :, None] * by_y for a in (0, 1)], axis=-1)

    def _by_second(self, free: BoolArray) -> Array:
        _, _, s2, w2, _ = self._seen
        return -_image_derivatives(self._projections[1], s2, w2, free)

    @cached_property
    def normal_equations(self) -> NormalEquations:
        """With the shared parameters' part of both frames in the rows of the second one."""
        free, shared = self.layout.free, self.layout.shared
        size, own = len(shared), np.flatnonzero(~shared)
        to_all = np.flatnonzero(shared)
        second, is_known = self.pairs.second, self.pairs.known is not None
        by_second = self._by_second(free)
        r = np.concatenate(self.r, axis=-1)
        gradient, hessian = np.zeros((len(self.theta), size)), np.zeros((len(self.theta), size, size))
        coupling = np.zeros((0, len(own), len(own)))

        def add(frame: IntArray, rows: IntArray, J: Array) -> None:
            """Of the parameters `rows` of frames, with derivatives J (K, ., 2 N)."""
            weighted = J * self.pull[:, None]
            np.add.at(gradient, (frame[:, None], rows), (weighted @ r[..., None])[..., 0])
            np.add.at(hessian, (frame[:, None, None], rows[:, None], rows), weighted @ np.swapaxes(J, 1, 2))

        add(second, own, by_second[:, own])
        if is_known:  # and all that frames share
            return NormalEquations(self.cost, gradient, hessian, coupling)
        first, by_first = self.pairs.first, self._by_first(free)
        by_shared = by_first[:, shared] + by_second[:, shared]
        weighted_shared = by_shared * self.pull[:, None]

        def add_border(frame: IntArray, J: Array) -> None:
            block = J @ np.swapaxes(weighted_shared, 1, 2)
            np.add.at(hessian, (frame[:, None, None], own[:, None], to_all), block)
            np.add.at(hessian, (frame[:, None, None], to_all[:, None], own), np.swapaxes(block, 1, 2))

        add(second, to_all, by_shared)
        add(first, own, by_first[:, own])
        add_border(second, by_second[:, own])
        add_border(first, by_first[:, own])
        coupling = by_first[:, own] @ np.swapaxes(by_second[:, own] * self.pull[:, None], 1, 2)
        return NormalEquations(self.cost, gradient, hessian, coupling)


def _image_derivatives(projection: Projection, s: Array, inverse_depth: Array, free: BoolArray) -> Array:
    """Derivatives of pixels, (B, P, 2 N), x before y."""
    zero, one = np.zeros_like(s[0]), np.ones_like(s[0])
    axes = np.array([np.concatenate([one, zero], axis=-1), np.concatenate([zero, one], axis=-1)])
    return projection.derivatives(np.tile(s, 2), np.tile(inverse_depth, 2), axes, free)
