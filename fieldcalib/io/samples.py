"""Samples to try: a rendered clip and a picture of it, with their truth; `data_tools.synthetic` has made them."""

from __future__ import annotations

import csv
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

from fieldcalib.geometry.camera import Camera
from fieldcalib.io.soccernet import camera_from_record

FOLDER = Path(__file__).parents[1] / "samples"
PLAYERS, TRUTH = "players.csv", ".jsonl"

Sample = Literal["clip", "picture"]
FILES: dict[Sample, str] = {"clip": "clip.mp4", "picture": "picture.png"}


def sample(name: Sample) -> Path:
    """A clip or a picture to try, with its truth beside it.

    The clip has 60 frames of 960 x 540 pixels, 30 a second, of a soccer match from one camera that pans and zooms:
    players, boards, motion blur, grain, and a cut.

    Parameters
    ----------
    name : {"clip", "picture"}

    Returns
    -------
    Path
        ``clip.mp4``, with the true cameras in ``clip.jsonl`` (`fieldcalib.io.samples.read_cameras`) and the boxes of
        the players in ``players.csv``, which `fieldcalib project` reads; or ``picture.png``, with its true camera in
        ``picture.json`` (`fieldcalib.io.soccernet.parse_camera`).

    Raises
    ------
    ValueError
        If there is no such sample.

    Examples
    --------
    >>> import fieldcalib
    >>> fieldcalib.sample("picture").name
    'picture.png'
    """
    if name not in get_args(Sample):
        raise ValueError(f'expected "clip" or "picture", got {name!r}')
    return FOLDER / FILES[name]


@dataclass(frozen=True, eq=False)
class TrueFrame:
    """The camera of a frame of a clip."""

    camera: Camera
    shot: int
    tripod: int
    """0 is the main camera, 1 the one beside it."""


def read_cameras(path: Path) -> list[TrueFrame]:
    """The cameras of a rendered clip, from the ``.jsonl`` beside it."""
    records = [json.loads(line) for line in path.read_text().splitlines()]
    return [
        TrueFrame(camera_from_record(record, (*record["image_size"],)), record["shot"], record["tripod"])
        for record in records
    ]


def read_positions(path: Path) -> dict[tuple[int, int], tuple[float, float]]:
    """True places of the players of ``players.csv`` in metres, by frame and track."""
    with path.open(newline="") as file:
        return {
            (int(row["frame"]), int(row["track_id"])): (float(row["true_x"]), float(row["true_y"]))
            for row in csv.DictReader(file)
        }
