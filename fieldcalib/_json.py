"""Numbers and versions of records in JSON.

JSON has neither infinity nor NaN: NaN is null, infinities are "inf" and "-inf". Whole numbers of an array are integers:
many are 0, and an integer is a quarter as long in a pickle.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib._types import Array, expect


def to_json(values: ArrayLike) -> Any:
    """A number, or an array as nested lists.

    Examples
    --------
    >>> to_json(2.5), to_json([[1.0, np.nan], [-np.inf, 0.0]])
    (2.5, [[1, None], ['-inf', 0]])
    """
    nested = values if type(values) is float else np.asarray(values, dtype=float).tolist()
    return _of_list(nested) if isinstance(nested, list) else _of_number(nested)


def _of_list(values: list[Any]) -> list[Any]:
    return [_of_list(one) if type(one) is list else int(one) if _is_whole(one) else _of_number(one) for one in values]


def _of_number(value: float) -> float | str | None:
    if math.isfinite(value):
        return value
    return None if math.isnan(value) else str(value)


def _is_whole(value: float) -> bool:
    """Whether a number equals an integer; false for -0.0."""
    return value.is_integer() and (value != 0.0 or math.copysign(1.0, value) > 0.0)


def from_json(values: Any) -> Array:
    """The inverse of `to_json`, as an array.

    Examples
    --------
    >>> from_json([1.0, None, "-inf"])
    array([  1.,  nan, -inf])
    """
    return np.array(values, dtype=float)


def texts_from_json(values: Any) -> tuple[str, ...]:
    """The texts of a list in JSON.

    Examples
    --------
    >>> texts_from_json(["a", 1])
    Traceback (most recent call last):
        ...
    ValueError: expected a str, as "text", got an int
    """
    return tuple(expect(one, str, '"text"') for one in expect(values, list, '["text"]'))


@contextmanager
def reading(record: Mapping[str, Any], what: str, version: int) -> Iterator[None]:
    """Read a record in the block: its faults become a ValueError that names `what` was expected.

    So does a result beyond the range of floats, of which NumPy would warn.

    Examples
    --------
    >>> with reading({"version": 1}, "calibration", 1):
    ...     {"version": 1}["K"]
    Traceback (most recent call last):
        ...
    ValueError: is no calibration: the key 'K' is missing
    """
    if not isinstance(record, Mapping):
        raise ValueError(f"is no {what}: expected a JSON object, got a {type(record).__name__}")
    if record.get("version") != version:
        raise ValueError(
            f"expected a {what} of version {version}, got {record.get('version')!r}: another fieldcalib wrote it, "
            f"use that or calibrate again"
        )
    try:
        with np.errstate(over="raise", divide="raise", invalid="raise"):
            yield
    except KeyError as error:
        raise ValueError(f"is no {what}: the key {error} is missing") from None
    except (TypeError, AttributeError, ValueError, IndexError, ArithmeticError) as error:
        raise ValueError(f"is no {what}: {error}") from error
