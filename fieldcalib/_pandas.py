"""pandas, which only tables need."""

from __future__ import annotations

from types import ModuleType
from typing import cast


def imported_pandas() -> ModuleType:
    """The module.

    Raises
    ------
    ImportError
        If it is not installed, with how to install it.
    """
    try:
        import pandas
    except ImportError as error:
        raise ImportError("to_pandas needs pandas: pip install 'fieldcalib[pandas]'") from error
    return cast(ModuleType, pandas)
