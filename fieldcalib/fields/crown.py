"""Crowned fields: built higher in the middle than at the touchlines, so that rain runs off.

The ground is at height ``h (1 - (2 y / W)^2)`` above the touchlines, which are W apart; outside them it is level.
"""

from __future__ import annotations

import numpy as np

from fieldcalib._types import Array, Float32


def share_of_crown(y: Array | Float32, width: float) -> Array:
    """Height of the ground at y metres from the middle, as a share of the crown.

    Examples
    --------
    >>> share_of_crown(np.array([0.0, 17.0, -34.0, 40.0]), 68.0)
    array([1.  , 0.75, 0.  , 0.  ])
    """
    return np.asarray(np.maximum(1.0 - np.square(2.0 * y / width), 0.0))
