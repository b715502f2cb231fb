"""Samples to try: a clip and a picture of it, rendered when they are first asked for and kept in the user's cache.

A sample is a folder with the file that was asked for and its truth beside it (`fieldcalib.synthetic.samples`). Its
name has a digest of the code that renders, so that a changed one makes it anew.

The files of the samples: a rendered clip, or one picture of it, with its true cameras and players.
"""

from __future__ import annotations

import csv
import hashlib
import io
import os
import shutil
import sys
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Literal, get_args

import numpy as np

import fieldcalib
from fieldcalib._progress import Progress, progress_bar
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.io.files import write_text
from fieldcalib.io.images import write_image
from fieldcalib.io.soccernet import format_camera
from fieldcalib.io.videos import VideoWriter
from fieldcalib.processes.jobs import in_order
from fieldcalib.run_folder.units import executor_of
from fieldcalib.synthetic.film import LEAST_PATH, PAINTED, Scene, TrueFrame, cameras_as_text, clip_frames, filmed
from fieldcalib.synthetic.paths import with_displaced_lines

Sample = Literal["clip", "picture"]
FILES: dict[Sample, str] = {"clip": "clip.mp4", "picture": "picture.png"}
PLAYERS, TRUTH = "players.csv", ".jsonl"

SEED = 26
STRETCHES = ((0, 30), (60, 90))  # of the frames of the camera's path, that the clip has before and after its cut
PICTURE = 10  # the frame of the path that the picture is
MOST_JOBS = 4


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
        from fieldcalib.synthetic.samples import make  # OpenCV is slow to import

        make(folder, name, progress)
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


def make(folder: Path, name: Sample, progress: Progress) -> None:
    """Make the folder of a sample, under another name until all is in it."""
    frames = clip_frames(SEED, LEAST_PATH)
    field = with_displaced_lines(soccer(), np.random.default_rng((SEED, PAINTED)))
    scene = Scene.random(field, SEED, [frame.camera for frame in frames])
    unfinished = Path(tempfile.mkdtemp(prefix=f".{folder.name}-", dir=folder.parent))
    try:
        path = unfinished / FILES[name]
        if name == "picture":
            write_image(path, filmed(scene, frames, PICTURE))
            write_text(path.with_suffix(".json"), format_camera(frames[PICTURE].camera))
        else:
            shown = [index for stretch in STRETCHES for index in range(*stretch)]
            _film(path, scene, frames, shown, progress)
            shots = [shot for shot, stretch in enumerate(STRETCHES) for _ in range(*stretch)]
            truths = [replace(frames[index], shot=shot) for index, shot in zip(shown, shots, strict=True)]
            write_text(path.with_suffix(TRUTH), cameras_as_text(scene, truths))
            write_text(path.with_name(PLAYERS), _boxes_as_text(scene, frames, shown))
        with suppress(FileExistsError):
            os.replace(unfinished, folder)
    except OSError:
        if not folder.is_dir():  # another process may have made it in the meantime
            raise
    finally:
        shutil.rmtree(unfinished, ignore_errors=True)


def _film(path: Path, scene: Scene, frames: Sequence[TrueFrame], shown: Sequence[int], progress: Progress) -> None:
    """Render the frames that are shown, in several processes."""
    jobs = min(os.cpu_count() or 1, MOST_JOBS)
    with (
        executor_of(jobs) as executor,
        progress_bar(desc="rendering", total=len(shown), unit="frame", progress=progress) as bar,
        VideoWriter(path, scene.rate) as video,
    ):
        for image in in_order(executor, partial(filmed, scene, frames), shown, ahead=2 * jobs):
            video.write(image)
            bar.update()


def _boxes_as_text(scene: Scene, frames: Sequence[TrueFrame], shown: Sequence[int]) -> str:
    """The boxes of the players in view as a table, a line for each frame that is shown and each player."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(("frame", "track_id", "team", "x1", "y1", "x2", "y2", "true_x", "true_y"))
    for number, index in enumerate(shown):
        for who, box in scene.boxes(index, frames[index].camera).items():
            X = scene.positions[index, who]
            table.writerow((number, who, scene.teams[who], *np.round(box, 2).tolist(), *np.round(X, 3).tolist()))
    return text.getvalue()


def read_positions(path: Path) -> dict[tuple[int, int], tuple[float, float]]:
    """True places of the players of ``players.csv`` in metres, by frame and track."""
    with path.open(newline="") as file:
        return {
            (int(row["frame"]), int(row["track_id"])): (float(row["true_x"]), float(row["true_y"]))
            for row in csv.DictReader(file)
        }
