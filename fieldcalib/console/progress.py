"""A bar of progress on stderr, where that is a terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tqdm import tqdm


def progress_bar(*, unit: str, total: int | None = None, desc: str = "") -> tqdm:
    """A bar that is closed without a word also if its making was interrupted: tqdm's own says that it has no `disable`.

    Examples
    --------
    >>> with progress_bar(unit="frame", total=2) as progress:
    ...     progress.update()
    """
    from tqdm import tqdm

    class Bar(tqdm):  # type: ignore[misc]
        disable = True
        monitor_interval = 0  # no thread that looks whether it moves: each bar would have one

    return Bar(unit=unit, total=total, desc=desc, disable=None)  # None: only on a terminal
