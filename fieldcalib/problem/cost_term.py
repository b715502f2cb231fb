"""Terms of the cost of frames: labelled pixels, prior, static points of the background, smooth path.

The solver sums over them and uses nothing but this protocol.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

from fieldcalib._types import Array, IntArray


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
