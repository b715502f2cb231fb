"""Samples to try: a clip and a picture of it, rendered when they are first asked for and kept in the user's cache.

A sample is a folder with the file that was asked for and its truth beside it (`fieldcalib.synthetic.sample_files`). Its
name has a digest of the code that renders, so that a changed one makes it anew.
"""

from __future__ import annotations

import hashlib
import os
import sys
import tempfile
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import Literal, get_args

import fieldcalib
from fieldcalib._progress import Progress

Sample = Literal["clip", "picture"]
FILES: dict[Sample, str] = {"clip": "clip.mp4", "picture": "picture.png"}


def sample(name: Sample, *, progress: Progress = True) -> Path:
    """A clip or a picture to try, with its truth beside it.

    The clip has 60 frames of 960 x 540 pixels, 30 a second, of a soccer match from one camera that pans and zooms:
    players, boards, motion blur, grain, and a cut from one end to the other. It is rendered when it is first asked for,
    by up to four processes, and kept in the user's folder for caches (``XDG_CACHE_HOME``, ``LOCALAPPDATA``); where
    nothing can be written there, in a temporary folder.

    Parameters
    ----------
    name : {"clip", "picture"}
    progress : bool or callable
        As of `fieldcalib.calibrate`.

    Returns
    -------
    Path
        ``clip.mp4``, with the true cameras in ``clip.jsonl`` (`fieldcalib.synthetic.film.read_cameras`) and the boxes
        of the players in ``players.csv``, which `fieldcalib project` reads; or ``picture.png``, with its true camera in
        ``picture.json`` (`fieldcalib.io.soccernet.parse_camera`).

    Raises
    ------
    ValueError
        If there is no such sample.

    Examples
    --------
    >>> fieldcalib.sample("picture", progress=False).name
    'picture.png'
    """
    if name not in get_args(Sample):
        raise ValueError(f'expected "clip" or "picture", got {name!r}')
    made = f"{name}-{_digest()}"
    folder = _cache() / made
    if not folder.is_dir():
        from fieldcalib.synthetic.sample_files import make  # OpenCV is slow to import

        make(folder, FILES[name], progress)
    return folder / FILES[name]


@lru_cache(maxsize=1)
def _cache() -> Path:
    """The folder of samples, which is made if need be; a temporary one where nothing can be written."""
    home = os.environ.get("XDG_CACHE_HOME") or (os.environ.get("LOCALAPPDATA") if sys.platform == "win32" else "")
    with suppress(OSError, RuntimeError):  # no home, or no right to write there
        folder = (Path(home) if home else Path.home() / ".cache") / "fieldcalib"
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return folder
    return Path(tempfile.mkdtemp(prefix="fieldcalib-"))


@lru_cache(maxsize=1)
def _digest() -> str:
    """What the pictures depend on, in few letters: the version, and the code of this package."""
    digest = hashlib.sha256(fieldcalib.__version__.encode())
    for file in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(file.read_bytes())
    return digest.hexdigest()[:12]
