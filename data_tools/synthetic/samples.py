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
from scipy.ndimage import gaussian_filter1d

from data_tools.synthetic.film import LEAST_PATH, PAINTED, Scene, cameras_as_text, clip_frames, filmed
from data_tools.synthetic.paths import with_displaced_lines
from fieldcalib._whole_files import write_text
from fieldcalib.draw.ground import COLOURS
from fieldcalib.fields.sports.soccer import soccer, with_painted_lines
from fieldcalib.io.image_files import write_image
from fieldcalib.io.samples import FILES, PLAYERS, TRUTH, TrueFrame
from fieldcalib.io.soccernet import format_camera
from fieldcalib.io.videos import VideoWriter

SEED = 133  # a bright stadium without captions, whose goal is in view
STRETCHES = ((0, 30), (75, 105))  # of the frames of the camera's path, that the clip has before and after its cut
PICTURE = 10  # the frame of the path that the picture is
# Shirts of the players: teams that are called as a colour have it on maps (`fieldcalib.cli.players`).
SHIRTS = ("blue",) * 10 + ("red",) * 10 + ("yellow", "orange")
SHORTS = {"blue": "white", "red": "red", "yellow": "black", "orange": "black"}
BOXES = 10  # draws the errors of boxes, beside what `Scene` draws
OFF, DRIFT = 2.0, 6.0  # px by which boxes are off, the default of `fieldcalib project`; frames over which that changes
IN_FRONT, FOLLOWS = 3.0, 0.15  # m: keepers stand before the middle of their goals; share of the play that they follow


def sample_scene() -> tuple[Scene, list[TrueFrame]]:
    """The stadium of the samples with two teams and their keepers, and the path of its camera."""
    frames = clip_frames(SEED, LEAST_PATH)
    field = with_displaced_lines(with_painted_lines(soccer()), np.random.default_rng((SEED, PAINTED)))
    scene = Scene.random(field, SEED, [frame.camera for frame in frames])
    positions = scene.positions.copy()
    positions[:, -2:, 0] = np.array([-1.0, 1.0]) * (field.length / 2.0 - IN_FRONT)
    positions[:, -2:, 1] = FOLLOWS * np.mean(positions[:, :-2, 1], axis=1, keepdims=True)
    colours = COLOURS["players"]
    kits = [(colours[shirt], colours[SHORTS[shirt]], colours[shirt]) for shirt in SHIRTS]
    people = [(person, kit, phase) for (person, _, phase), kit in zip(scene.people, kits, strict=True)]
    return replace(scene, positions=positions, people=people, teams=SHIRTS), frames


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
    """The boxes of the players in view as a table, a line for each frame that is shown and each player.

    They are off as a detector's are, by `OFF` in x and in y (standard deviation); those of a player drift slowly.
    """
    noise = np.random.default_rng((SEED, BOXES)).standard_normal((*scene.positions.shape[:2], 2))
    drift = gaussian_filter1d(noise, DRIFT, axis=0, mode="wrap")
    drift *= OFF * np.sqrt(2.0 * np.sqrt(np.pi) * DRIFT)
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(("frame", "track_id", "team", "x1", "y1", "x2", "y2", "true_x", "true_y"))
    for number, index in enumerate(shown):
        for who, box in scene.boxes(index, frames[index].camera).items():
            X, found = scene.positions[index, who], box + np.tile(drift[index, who], 2)
            table.writerow((number, who, scene.teams[who], *np.round(found, 2).tolist(), *np.round(X, 3).tolist()))
    return text.getvalue()
