"""Names that go on working, with a warning that says what to use."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


def deprecated(message: str) -> Callable[[Callable[Arguments, Result]], Callable[Arguments, Result]]:
    """Let a function warn its caller when it is called.

    Examples
    --------
    >>> @deprecated("old is new now")
    ... def old():
    ...     return 3
    >>> with warnings.catch_warnings(record=True) as seen:
    ...     warnings.simplefilter("always")
    ...     old(), str(seen[0].message)
    (3, 'old is new now')
    """

    def decorated(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
        @wraps(function)
        def warned(*arguments: Arguments.args, **options: Arguments.kwargs) -> Result:
            warnings.warn(message, DeprecationWarning, stacklevel=2)
            return function(*arguments, **options)

        return warned

    return decorated
