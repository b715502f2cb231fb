"""A bar of progress on stderr, where that is a terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tqdm import tqdm


def progress_bar(*, unit: str, total: int | None = None, desc: str = "") -> tqdm:
    """Make a progress bar that prints no error if an interrupt hits its construction, as tqdm's own does.

    Examples
    --------
    >>> with progress_bar(unit="frame", total=2) as progress:
    ...     progress.update()
    """
    from tqdm import tqdm

    class Bar(tqdm):  # type: ignore[misc]
        disable = True
        monitor_interval = 0  # no monitor thread for each bar

    return Bar(unit=unit, total=total, desc=desc, disable=None)  # None: only on a terminal
