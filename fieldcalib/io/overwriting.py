"""Which files a command may write over: none that it reads, and those of others only if it is told to."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

ELSEWHERE = "give another --out"
INTERRUPTED = "remove the folder, if a run of this command was interrupted there, or give another --out"


def check_targets(
    targets: Iterable[Path], reads: Iterable[Path], *, replaces: bool = False, remedy: str = ELSEWHERE
) -> None:
    """Check the files that a command is going to write or to remove, before it does.

    Parameters
    ----------
    targets : iterable of Path
        These files; most of them do not exist yet.
    reads : iterable of Path
        Files that the command reads. Whatever links lead to them, they are not written over.
    replaces : bool
        Whether other files that are there may be replaced: an earlier run of the command wrote them, or the user named
        them.
    remedy : str
        What to do about files that may not be replaced, for the message.

    Raises
    ------
    FileExistsError
        If a target may not be written; the message names it.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     picture = Path(folder) / "a.jpg"
    ...     picture.touch()
    ...     check_targets([picture, Path(folder) / "b.jpg"], [], replaces=True)
    ...     try:
    ...         check_targets([picture], [picture], replaces=True)
    ...     except FileExistsError as error:
    ...         print(str(error).replace(folder, "folder"))
    folder/a.jpg is read by this command, which would write over it: give another --out
    """
    there = [path for path in targets if os.path.lexists(path)]
    if not there:
        return
    read = {identity for path in reads if (identity := _identity(path)) is not None}
    for path in there:
        if _identity(path) in read:
            raise FileExistsError(f"{path} is read by this command, which would write over it: {ELSEWHERE}")
    if not replaces:
        raise FileExistsError(f"{there[0]} is there already: {remedy}")


def _identity(path: Path) -> tuple[int, int] | None:
    """Device and number of a file; None if there is none."""
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_dev, status.st_ino
