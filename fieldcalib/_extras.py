"""Import of optional packages, with an error that says which extra has them."""

from __future__ import annotations

import sys
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
    ImportError: a table needs no_package: pip install 'fieldcalib[tables]', in a checkout pip install '.[tables]'
    """
    try:
        return import_module(name)
    except ImportError as error:
        package = name.partition(".")[0]
        raise ImportError(f"{user} needs {package}: {how_to_install(extra)}") from error


def how_to_install(extra: str) -> str:
    """The command that installs an extra, from a release or in a checkout.

    Examples
    --------
    >>> how_to_install("web")
    "pip install 'fieldcalib[web]', in a checkout pip install '.[web]'"
    """
    return f"pip install 'fieldcalib[{extra}]', in a checkout pip install '.[{extra}]'"


def missing(error: ModuleNotFoundError, extra: str) -> BaseException:
    """What to raise where a module that is imported at the top needs an optional package, which is not installed.

    Where Python runs a program by ``-m`` that imports the module, its end, with one line on stderr: which package is
    missing and how to install it. Elsewhere the error itself.

    Examples
    --------
    >>> missing(ModuleNotFoundError("no torch", name="torch"), "train")
    ModuleNotFoundError('no torch')
    """
    program = _program()
    if not program:
        return error
    return SystemExit(f"{program} needs {error.name}, which is not installed: {how_to_install(extra)}")


def _program() -> str:
    """Name of the program of this project that Python was asked to run by -m; empty if it is another."""
    arguments = sys.orig_argv[1:]
    name = arguments[arguments.index("-m") + 1] if "-m" in arguments[:-1] else ""
    return name if name.partition(".")[0] in ("baselines", "data_tools") else ""
