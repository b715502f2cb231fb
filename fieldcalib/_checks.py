"""Checks of arguments at the public edge: what was expected, and what came."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from reprlib import repr as short
from typing import Any

import numpy as np

from fieldcalib._types import Array

FIELD, CAMERA = "fieldcalib.soccer()", "calibration.camera"  # examples for messages


def real_array(values: Any) -> Array:
    """Values as a float array, not copied if they are one.

    Raises
    ------
    ValueError
        If they are no numbers, or complex ones, whose imaginary part NumPy would drop.

    Examples
    --------
    >>> real_array([1, 2])
    array([1., 2.])
    >>> real_array(np.array([1j]))
    Traceback (most recent call last):
        ...
    ValueError: expected real numbers, got complex ones
    """
    if isinstance(values, complex | np.complexfloating) or getattr(getattr(values, "dtype", None), "kind", "") == "c":
        raise ValueError("expected real numbers, got complex ones")
    try:
        return np.asarray(values, dtype=float)
    except (TypeError, ValueError, OverflowError) as error:
        raise ValueError(f"expected numbers: {error}") from None


def is_number(value: object) -> bool:
    """Whether a value is a real number.

    Examples
    --------
    >>> is_number(1.5), is_number(np.float32(1.0)), is_number("1"), is_number(True)
    (True, True, False, False)
    """
    return isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)


def number(value: Any, name: str) -> Any:
    """The value if it is a real number, which may be NaN; a ValueError that begins with its name if it is none.

    Examples
    --------
    >>> number("1", "cell")
    Traceback (most recent call last):
        ...
    ValueError: cell must be a number, got '1'
    """
    if not is_number(value):
        raise ValueError(f"{name} must be a number, got {short(value)}")
    return value


def listed(values: Any, what: str) -> Any:
    """The values if they can be counted and gone through in order; a ValueError that says what they should be if not.

    Examples
    --------
    >>> listed(3, "pictures")
    Traceback (most recent call last):
        ...
    ValueError: expected pictures, a list, got an int
    """
    if not (isinstance(values, Iterable) and hasattr(values, "__len__")) or isinstance(values, str | bytes | Mapping):
        raise ValueError(f"expected {what}, a list, got {named(values)}")
    return values


def named(value: object) -> str:
    """The class of a value with its article, for messages."""
    name = type(value).__name__
    return f"{'an' if name[0].lower() in 'aeio' else 'a'} {name}"


def expect(value: Any, kinds: type | tuple[type, ...], example: str) -> Any:
    """The value if it is of one of some classes; a ValueError that says what was expected if it is not.

    Examples
    --------
    >>> expect("soccer", dict, "{}")
    Traceback (most recent call last):
        ...
    ValueError: expected a dict, as {}, got a str
    """
    if not isinstance(value, kinds):
        first = kinds[0] if isinstance(kinds, tuple) else kinds
        raise ValueError(f"expected a {first.__name__}, as {example}, got {named(value)}")
    return value
