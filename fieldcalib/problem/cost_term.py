"""Terms of the cost of frames: labelled pixels, prior, static points of the background, smooth path.

The solver sums over them and uses nothing but this protocol.

The prior of cameras as a term of the cost: quadratic, with heavy tails for the lens.

The tails are for lenses that displace the corner by as much as a quarter of its distance from the middle.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np

from fieldcalib._types import Array, IntArray
from fieldcalib.problem.layout import GaussianPrior, Layout
from fieldcalib.problem.losses import RobustLoss

LENS_TAILS = RobustLoss("cauchy", 2.0)  # z-scores beyond two count ever less


class Coupling(NamedTuple):
    """Blocks of a Hessian that couple the own parameters of pairs of frames."""

    first: IntArray
    """Index of the first frame of each pair, (K,)."""
    second: IntArray
    """Index of the second frame of each pair, (K,)."""
    blocks: Array
    """Blocks of the Hessian, (K, o, o); rows are parameters of the first frame."""


class CostTerm(Protocol):
    """A term of the cost of B frames, each with P free parameters."""

    @property
    def cost(self) -> Array:
        """Cost of each frame, (B,)."""

    @property
    def gradient(self) -> Array:
        """Gradient of the cost by the free parameters, (B, P)."""

    @property
    def hessian(self) -> Array:
        """Gauss-Newton Hessian within each frame, (B, P, P)."""

    @property
    def coupling(self) -> Coupling | None:
        """Hessian between frames; None if they are independent, as by default."""
        return None


def prior_costs(squared: Array, layout: Layout) -> tuple[Array, Array]:
    """Twice the cost of squared z-scores (..., P) of the free parameters, and its derivative by them."""
    cost, slope = squared.copy(), np.ones(squared.shape)
    is_lens = layout.is_lens[layout.free]
    if is_lens.any():
        cost[..., is_lens], slope[..., is_lens] = LENS_TAILS.evaluate(squared[..., is_lens])
    return cost, slope


@dataclass(frozen=True, eq=False)
class PriorTerm(CostTerm):
    """The prior of B frames at their cameras theta (B, n)."""

    prior: GaussianPrior
    layout: Layout
    theta: Array

    @cached_property
    def sigma(self) -> Array:
        """Standard deviations of the free parameters, (B, P)."""
        return self.prior.sigma[:, self.layout.free]

    @property
    def effective_sigma(self) -> Array:
        """Effective standard deviations of the prior after robust weighting, (B, P)."""
        return np.asarray(self.sigma / np.sqrt(self._costs[1]))

    @cached_property
    def _z(self) -> Array:
        return self.prior.z_scores(self.theta)[:, self.layout.free]

    @cached_property
    def _costs(self) -> tuple[Array, Array]:
        return prior_costs(np.square(self._z), self.layout)

    @cached_property
    def cost(self) -> Array:
        """Cost of the prior of each frame, (B,)."""
        return np.asarray(0.5 * np.sum(self._costs[0], axis=1))

    @property
    def gradient(self) -> Array:
        """Gradient by the free parameters, (B, P)."""
        return np.asarray(self._costs[1] * self._z / self.sigma)

    @property
    def hessian(self) -> Array:
        """Hessian, (B, P, P)."""
        return np.asarray((self._costs[1] / np.square(self.sigma))[:, :, None] * np.eye(self.sigma.shape[1]))
