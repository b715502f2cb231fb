"""Import of optional packages, with an error that says which extra has them."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType


def imported(name: str, extra: str, user: str) -> ModuleType:
    """Import a module of an optional package; `user` names what needs it.

    Raises
    ------
    ImportError
        If it is not installed, with how to install it.

    Examples
    --------
    >>> imported("no_package", "tables", "a table")
    Traceback (most recent call last):
        ...
    ImportError: a table needs no_package: pip install 'fieldcalib[tables]'
    """
    try:
        return import_module(name)
    except ImportError as error:
        package = name.partition(".")[0]
        raise ImportError(f"{user} needs {package}: pip install 'fieldcalib[{extra}]'") from error
