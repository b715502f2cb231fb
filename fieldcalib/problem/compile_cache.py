"""Compiled functions that Numba keeps on the disk; where they cannot be read or written, they are compiled anew.

A log message says that Numba compiles, to explain why the first calibration after an installation takes long.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from contextlib import suppress
from functools import cache as once
from typing import Any, TypeVar, cast

from numba import njit

Function = TypeVar("Function", bound=Callable[..., Any])
LOG = logging.getLogger(__name__)
DAMAGED = "the compiled solver in {} cannot be read: it is compiled again"
NOT_KEPT = "the compiled solver cannot be kept in {}: NUMBA_CACHE_DIR names another folder for it"

COMPILING = (
    "compiling the solver with Numba, which may take half a minute: once after an installation, it is kept for later"
)


def cached(**options: Any) -> Callable[[Function], Function]:
    """Make a decorator that compiles a function when it is first called; `options` are those of `numba.njit`.

    Raises
    ------
    RuntimeError
        By the decorator, if there is no folder in which the compiled function may be kept.
    """

    def decorated(function: Function) -> Function:
        dispatcher: Any = njit(cache=True, **options)(function)
        _bear_faults(dispatcher._cache)
        return cast(Function, dispatcher)

    return decorated


def _bear_faults(cache: Any) -> None:
    """Let Numba's cache of a function treat a damaged file as missing, and a full disk as no error."""
    load, save = cache.load_overload, cache.save_overload

    def load_overload(signature: Any, target: Any) -> Any:
        found = None
        try:
            found = load(signature, target)
        except Exception:  # of a torn pickle, of any class
            LOG.info(DAMAGED.format(cache.cache_path))
            with suppress(OSError):
                cache.flush()
        if found is None:
            _say_compiling()
        return found

    def save_overload(signature: Any, data: Any) -> None:
        try:
            save(signature, data)
        except Exception:
            LOG.info(NOT_KEPT.format(cache.cache_path))

    cache.load_overload, cache.save_overload = load_overload, save_overload


@once
def _say_compiling() -> None:
    """Log once that functions are compiled, since that takes long."""
    LOG.info(COMPILING)
