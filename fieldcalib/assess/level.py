"""The errors of a camera if the field were known to be level."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fieldcalib._types import Array, BoolArray
from fieldcalib.problem.layout import Layout


def if_level(covariance: Array, of_crown: BoolArray) -> Array:
    """Covariance (n, n) of parameters if the field were known to be level; `of_crown` (n,) marks its crown, if any.

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


@dataclass(frozen=True, eq=False)
class Considered:
    """The parameters that a layout considers, with their joint covariance."""

    layout: Layout
    covariance: Array
    """Covariance of these parameters, (S, S)."""

    @cached_property
    def if_level(self) -> Array:
        """The covariance if the field were known to be level, (S, S)."""
        return if_level(self.covariance, self.layout.is_crown[self.layout.considered])
