"""The array types of the signatures, and checks of arguments at the public edge: what was expected, and what came.

Arrays are of float64 unless said otherwise; the last axis is the vector. A dict that cannot be written to.
"""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from reprlib import repr as short
from typing import Any, NoReturn, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]
Float32: TypeAlias = NDArray[np.float32]
BoolArray: TypeAlias = NDArray[np.bool_]
IntArray: TypeAlias = NDArray[np.intp]


Key = TypeVar("Key")
Value = TypeVar("Value")

LARGEST = 1e50  # of finite numbers: products of several of them are still floats
FIELD, CAMERA = "fieldcalib.soccer()", "calibration.camera"  # examples for messages


class ReadOnlyDict(dict[Key, Value]):
    """A dict of a frozen dataclass. As a dict it equals others, is JSON, and is taken by `dataclasses.asdict`.

    Examples
    --------
    >>> import json
    >>> numbers = ReadOnlyDict({"Middle line": 1.5})
    >>> json.dumps(numbers), numbers == {"Middle line": 1.5}
    ('{"Middle line": 1.5}', True)
    >>> numbers["Middle line"] = 0.0
    Traceback (most recent call last):
        ...
    TypeError: this dict is read-only: change a copy, dict(...)
    """

    def _refuse(self, *args: Any, **kwargs: Any) -> NoReturn:
        raise TypeError("this dict is read-only: change a copy, dict(...)")

    __setitem__ = __delitem__ = __ior__ = clear = pop = popitem = setdefault = update = _refuse

    def __reduce__(self) -> tuple[type[ReadOnlyDict[Key, Value]], tuple[dict[Key, Value]]]:
        return type(self), (dict(self),)


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


def are_finite(values: Array) -> bool:
    """Whether all numbers are finite, and none is beyond `LARGEST`.

    Examples
    --------
    >>> are_finite(np.array([1.0, -2.0])), are_finite(np.array([np.nan])), are_finite(np.array([1e300]))
    (True, False, False)
    """
    return bool(np.all(np.abs(values) <= LARGEST))


def is_number(value: object) -> bool:
    """Whether a value is a real number, of the range of floats.

    Examples
    --------
    >>> is_number(1.5), is_number(np.float32(1.0)), is_number("1"), is_number(True)
    (True, True, False, False)
    """
    if isinstance(value, int) and not -sys.float_info.max <= value <= sys.float_info.max:
        return False
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


def positive(value: Any, name: str) -> Any:
    """The value if it is a positive, finite number; a ValueError that begins with its name if it is none.

    Examples
    --------
    >>> positive(-1.0, "radius")
    Traceback (most recent call last):
        ...
    ValueError: radius must be a positive number, got -1.0
    """
    if not (is_number(value) and 0.0 < value < np.inf):
        raise ValueError(f"{name} must be a positive number, got {short(value)}")
    return value


def whole_number(value: Any, name: str, least: int = 0) -> int:
    """The value as an int if it is a whole number from `least`; a ValueError that begins with its name if it is none.

    Examples
    --------
    >>> whole_number(2.0, "count"), whole_number(np.int64(3), "count")
    (2, 3)
    >>> whole_number(1.5, "count")
    Traceback (most recent call last):
        ...
    ValueError: count must be a whole number from 0, got 1.5
    """
    if type(value) is int and value >= least:
        return value
    if not (is_number(value) and least <= value < np.inf and value == int(value)):
        raise ValueError(f"{name} must be a whole number from {least}, got {short(value)}")
    return int(value)


def one_of(value: Any, choices: Iterable[str], name: str) -> Any:
    """The value if it is one of some texts; a ValueError that begins with its name and lists them if it is none.

    Examples
    --------
    >>> one_of("nearest", ("linear", "cubic"), "interpolation")
    Traceback (most recent call last):
        ...
    ValueError: interpolation must be one of linear, cubic, got 'nearest'
    """
    if not isinstance(value, str) or value not in choices:
        raise ValueError(f"{name} must be one of {', '.join(choices)}, got {short(value)}")
    return value


def truth(value: Any, name: str) -> bool:
    """The value if it is True or False; a ValueError that begins with its name if it is neither.

    Examples
    --------
    >>> truth([], "ordered")
    Traceback (most recent call last):
        ...
    ValueError: ordered must be True or False, got a list
    """
    if not isinstance(value, bool | np.bool_):
        raise ValueError(f"{name} must be True or False, got {named(value)}")
    return bool(value)


def file_path(value: Any, what: str) -> Path:
    """A path if the value is one, or the text of one; a ValueError that says what it should lead to if not.

    So is a text that can be no path: with a null character, of bytes that no file's name has, or too long.

    Examples
    --------
    >>> file_path(3, "a folder of results")
    Traceback (most recent call last):
        ...
    ValueError: expected the path of a folder of results, got an int
    """
    if not isinstance(value, str | os.PathLike):
        raise ValueError(f"expected the path of {what}, got {named(value)}")
    path = Path(value)
    if "\0" in str(path):
        raise ValueError(f"expected the path of {what}, got one with a null character, {str(path)!r}")
    try:
        path.lstat()
    except UnicodeEncodeError:
        raise ValueError(f"expected the path of {what}, got one that no file can have, {short(str(path))}") from None
    except OSError as error:
        if error.errno == errno.ENAMETOOLONG:
            raise ValueError(f"expected the path of {what}, got one that is too long, {short(str(path))}") from None
    return path


def listed(values: Any, what: str) -> Any:
    """The values if they can be counted and gone through in order; a ValueError that says what they should be if not.

    Examples
    --------
    >>> listed(3, "pictures")
    Traceback (most recent call last):
        ...
    ValueError: expected pictures, a list, got an int
    """
    is_array = isinstance(values, np.ndarray) and values.ndim > 0
    is_list = isinstance(values, Iterable) and hasattr(values, "__len__") and not isinstance(values, np.ndarray)
    if not (is_array or is_list) or isinstance(values, str | bytes | Mapping | set | frozenset):
        raise ValueError(f"expected {what}, a list, got {named(values)}")
    return values


def iterable(values: Any, what: str) -> Iterable[Any]:
    """The values themselves; a ValueError that says what they should be if they cannot be iterated over."""
    is_scalar = isinstance(values, np.ndarray) and not values.ndim
    if is_scalar or isinstance(values, str | bytes | Mapping) or not isinstance(values, Iterable):
        raise ValueError(f"expected {what}, a list or an iterator, got {named(values)}")
    return values


def several(values: Any, what: str) -> list[Any]:
    """The values of an iterable; a ValueError that says what they should be if they are none.

    Examples
    --------
    >>> several("ab", "frames")
    Traceback (most recent call last):
        ...
    ValueError: expected frames, a list or an iterator, got a str
    """
    return list(iterable(values, what))


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
