"""What would be known of a camera if the field were known to be level."""

from __future__ import annotations

import numpy as np

from fieldcalib._types import Array, BoolArray


def if_level(covariance: Array, of_crown: BoolArray) -> Array:
    """Covariance (n, n) of parameters if the field were known to be level, of which one at most is its crown (n,).

    Examples
    --------
    >>> if_level(np.array([[2.0, 0.1], [0.1, 0.04]]), np.array([False, True])).round(2)
    array([[1.75, 0.  ],
           [0.  , 0.  ]])
    """
    (index,) = np.flatnonzero(of_crown) if np.any(of_crown) else (0,)
    if not np.any(of_crown) or not covariance[index, index] > 0.0:
        return covariance
    by_crown = covariance[:, index]
    return np.asarray(covariance - np.outer(by_crown, by_crown) / covariance[index, index])
