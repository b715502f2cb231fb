"""Numbers in JSON, which knows neither infinity nor NaN: NaN is null, infinities are "inf" and "-inf"."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib._types import Array


def to_json(values: ArrayLike) -> Any:
    """A number, or an array as nested lists.

    Examples
    --------
    >>> to_json(2.5), to_json([[1.0, np.nan], [-np.inf, 0.0]])
    (2.5, [[1.0, None], ['-inf', 0.0]])
    """
    array = np.asarray(values, dtype=float)
    if np.isfinite(array).all():
        return array.tolist()
    if array.ndim:
        return [to_json(one) for one in array]
    return None if np.isnan(array) else str(array)


def from_json(values: Any) -> Array:
    """The inverse of `to_json`, as an array.

    Examples
    --------
    >>> from_json([1.0, None, "-inf"])
    array([  1.,  nan, -inf])
    """
    return np.array(values, dtype=float)
