"""How frames that are linked with one another enter the normal equations."""

from __future__ import annotations

from typing import NamedTuple

from fieldcalib._types import Array, IntArray


class Coupling(NamedTuple):
    """Blocks of a Hessian that couple the own parameters of pairs of frames."""

    first: IntArray
    """(K,)"""
    second: IntArray
    """(K,)"""
    blocks: Array
    """(K, o, o), a row for each parameter of the first frame."""
