"""The files of the samples: a rendered clip, or one picture of it, with its true cameras and players."""

from __future__ import annotations

import csv
import io
import os
import shutil
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from fieldcalib._progress import Progress, progress_bar
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.io.files import write_text
from fieldcalib.io.image_files import write_image
from fieldcalib.io.soccernet import format_camera
from fieldcalib.io.videos import VideoWriter
from fieldcalib.processes.jobs import in_order
from fieldcalib.run_folder.work_units import executor_of
from fieldcalib.synthetic.film import LEAST_PATH, PAINTED, Scene, TrueFrame, cameras_as_text, clip_frames, filmed
from fieldcalib.synthetic.paths import with_displaced_lines

PLAYERS, TRUTH = "players.csv", ".jsonl"
SEED = 26
STRETCHES = ((0, 30), (60, 90))  # of the frames of the camera's path, that the clip has before and after its cut
PICTURE = 10  # the frame of the path that the picture is
MOST_JOBS = 4


def make(folder: Path, name: str, progress: Progress) -> None:
    """Make the folder of a sample, a picture or a clip by its name, under another name until all is in it."""
    frames = clip_frames(SEED, LEAST_PATH)
    field = with_displaced_lines(soccer(), np.random.default_rng((SEED, PAINTED)))
    scene = Scene.random(field, SEED, [frame.camera for frame in frames])
    unfinished = Path(tempfile.mkdtemp(prefix=f".{folder.name}-", dir=folder.parent))
    try:
        path = unfinished / name
        if path.suffix == ".png":
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
