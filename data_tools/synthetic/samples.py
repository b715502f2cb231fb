"""The samples that the package brings: a rendered clip and one picture of it, with true cameras and players.

python -m data_tools.synthetic --samples DIR
"""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from data_tools.synthetic.film import LEAST_PATH, PAINTED, Scene, cameras_as_text, clip_frames, filmed
from data_tools.synthetic.paths import with_displaced_lines
from fieldcalib.fields.sports.soccer import soccer, with_painted_lines
from fieldcalib.io.files import write_text
from fieldcalib.io.image_files import write_image
from fieldcalib.io.samples import FILES, PLAYERS, TRUTH, TrueFrame
from fieldcalib.io.soccernet import format_camera
from fieldcalib.io.videos import VideoWriter

SEED = 26
STRETCHES = ((0, 30), (60, 90))  # of the frames of the camera's path, that the clip has before and after its cut
PICTURE = 10  # the frame of the path that the picture is
# Shirts in the scene of this seed: teams that are called as a colour have it on maps (`fieldcalib.cli.players`).
SHIRTS = {"home": "blue", "away": "pink", "home keeper": "white", "away keeper": "white", "referee": "black"}


def sample_scene() -> tuple[Scene, list[TrueFrame]]:
    """The stadium of the samples, and the path of its camera."""
    frames = clip_frames(SEED, LEAST_PATH)
    field = with_displaced_lines(with_painted_lines(soccer()), np.random.default_rng((SEED, PAINTED)))
    return Scene.random(field, SEED, [frame.camera for frame in frames]), frames


def write_samples(folder: Path) -> None:
    """Write the clip and the picture with their truths to a folder."""
    scene, frames = sample_scene()
    picture, clip = folder / FILES["picture"], folder / FILES["clip"]
    write_image(picture, filmed(scene, frames, PICTURE))
    write_text(picture.with_suffix(".json"), format_camera(frames[PICTURE].camera))
    shown = [index for stretch in STRETCHES for index in range(*stretch)]
    with VideoWriter(clip, scene.rate) as video:
        for index in shown:
            video.write(filmed(scene, frames, index))
    shots = [shot for shot, stretch in enumerate(STRETCHES) for _ in range(*stretch)]
    truths = [replace(frames[index], shot=shot) for index, shot in zip(shown, shots, strict=True)]
    write_text(clip.with_suffix(TRUTH), cameras_as_text(scene, truths))
    write_text(clip.with_name(PLAYERS), _boxes_as_text(scene, frames, shown))


def _boxes_as_text(scene: Scene, frames: Sequence[TrueFrame], shown: Sequence[int]) -> str:
    """The boxes of the players in view as a table, a line for each frame that is shown and each player."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(("frame", "track_id", "team", "x1", "y1", "x2", "y2", "true_x", "true_y"))
    for number, index in enumerate(shown):
        for who, box in scene.boxes(index, frames[index].camera).items():
            X = scene.positions[index, who]
            shirt = SHIRTS[scene.teams[who]]
            table.writerow((number, who, shirt, *np.round(box, 2).tolist(), *np.round(X, 3).tolist()))
    return text.getvalue()
