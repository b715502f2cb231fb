"""Terms of the cost of frames: labelled pixels, the prior, static points of the background, a smooth path.

The solver knows of each only what stands here, and sums over them.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

from fieldcalib._types import Array, IntArray


class Coupling(NamedTuple):
    """Blocks of a Hessian that couple the own parameters of pairs of frames."""

    first: IntArray
    """(K,)"""
    second: IntArray
    """(K,)"""
    blocks: Array
    """(K, o, o), a row for each parameter of the first frame."""


class CostTerm(Protocol):
    """A term of the cost of B frames, each with P free parameters."""

    @property
    def cost(self) -> Array:
        """Share of each frame, (B,)."""

    @property
    def gradient(self) -> Array:
        """Its derivative by the free parameters, (B, P)."""

    @property
    def hessian(self) -> Array:
        """Gauss-Newton approximation of its Hessian within each frame, (B, P, P)."""

    @property
    def coupling(self) -> Coupling | None:
        """Its Hessian between frames; None if they are independent."""
