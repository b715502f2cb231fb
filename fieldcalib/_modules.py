"""Packages whose modules are imported when they are first used."""

from __future__ import annotations

import pkgutil
from collections.abc import Callable, Iterable
from importlib import import_module
from types import ModuleType


def lazy_modules(
    package: str, path: Iterable[str]
) -> tuple[Callable[[str], ModuleType], Callable[[], list[str]], list[str]]:
    """``__getattr__``, ``__dir__`` and ``__all__`` of a package: all modules in its folders.

    Examples
    --------
    >>> import fieldcalib.geometry
    >>> take, names, _ = lazy_modules("fieldcalib.geometry", fieldcalib.geometry.__path__)
    >>> names()[:2], take("camera").__name__
    (['camera', 'homography'], 'fieldcalib.geometry.camera')
    """
    names = sorted(module.name for module in pkgutil.iter_modules(path))

    def take(name: str) -> ModuleType:
        if name not in names:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return import_module(f"{package}.{name}")

    return take, lambda: names, names
