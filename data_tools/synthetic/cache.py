"""Synthetic frames kept in a folder: ``<seed>_main.jpg`` or ``<seed>_goal.jpg``, with the mask in a PNG beside it.

The name says where the camera stands, which mirroring needs to know (`mirrored_values`). ``summary.json`` names the
field, and the classes of the masks from 1 on. With `truth`, there are also ``camera_<name>.json`` with the true camera
and ``<name>.json`` with the visible markings, both in SoccerNet's formats.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import cv2
import numpy as np

from data_tools.synthetic.frames import SyntheticFrame, frame
from data_tools.synthetic.games import game_named
from data_tools.synthetic.masks import CLASSES, Mask
from fieldcalib._whole_files import write_bytes, write_text
from fieldcalib.console.arguments import SOCCER
from fieldcalib.io.files import parse_json_object
from fieldcalib.io.formats import ANNOTATIONS, CAMERAS
from fieldcalib.io.image_files import Image
from fieldcalib.io.soccernet import format_annotation, format_camera
from fieldcalib.problem.labelled_pixels import Pixels

QUALITY = 95  # of the JPEG: high, since the image is degraded already
SUMMARY = "summary.json"
MOST_POINTS = 20  # of a marking in an annotation


def write_cache(folder: Path, seeds: Iterable[int], processes: int, name: str = SOCCER, *, truth: bool = False) -> None:
    """Make the frames of these seeds; existing ones are kept, so an interrupted run can be resumed.

    Parameters
    ----------
    folder : Path
    seeds : iterable of int
    processes : int
    name : str
        Name of the field, see `frame`.
    truth : bool
        Whether cameras and annotations are written too.

    Raises
    ------
    ValueError
        If the folder has frames with other classes.
    """
    folder.mkdir(parents=True, exist_ok=True)
    present = {int(path.stem.split("_")[0]) for path in folder.glob("*.jpg")}
    classes = game_named(name).classes
    if present:
        check_cached_classes(folder, classes)
    if not (folder / SUMMARY).exists():
        about = {"field": name, "classes": classes}
        write_text(folder / SUMMARY, json.dumps(about, indent=1, ensure_ascii=False) + "\n")
    missing = [seed for seed in seeds if seed not in present]
    make = partial(_write_frame, folder, name, truth)
    with get_context("spawn").Pool(processes, initializer=cv2.setNumThreads, initargs=(1,)) as pool:
        for _ in pool.imap_unordered(make, missing, chunksize=8):
            pass


def check_cached_classes(folder: Path, classes: Sequence[str]) -> None:
    """Raise a ValueError unless the masks in a folder have these classes; without a summary they are soccer's."""
    path = folder / SUMMARY
    about = parse_json_object(path.read_bytes(), "field and classes") if path.is_file() else {}
    found = about.get("classes", list(CLASSES))
    if found != list(classes):
        raise ValueError(
            f"{folder} has frames of the field {about.get('field', SOCCER)} with {len(found)} classes, expected "
            f"{len(classes)} others: give that --field, or another folder"
        )


def read_frame(path: Path) -> tuple[Image, Mask, bool]:
    """Image, mask, and whether the camera stands behind a goal, of a cached ``.jpg``."""
    image = cv2.imread(str(path), cv2.IMREAD_COLOR)
    mask = cv2.imread(str(path.with_suffix(".png")), cv2.IMREAD_GRAYSCALE)
    return np.asarray(image, np.uint8), np.asarray(mask, np.uint8), path.stem.endswith("_goal")


def in_view(made: SyntheticFrame, classes: Iterable[str]) -> Pixels:
    """Points along the visible markings, label -> (N, 2) pixels; people and nets hide nothing.

    Examples
    --------
    >>> made = frame(1)
    >>> found = in_view(made, CLASSES)
    >>> all(len(xy) <= MOST_POINTS for xy in found.values())
    True
    """
    if made.camera is None:
        return {}
    found: Pixels = {}
    size = np.array(made.camera.image_size)
    for label in classes:
        xy = made.camera.project(made.field[label].sample(spacing=made.field.scale / 400.0))
        xy = xy[np.all((xy >= 0.0) & (xy <= size - 1.0), axis=1)]  # false for NaN
        x, y = np.rint(xy).astype(int).T
        xy = xy[made.mask[y, x] > 0]
        if len(xy) > 1:
            chosen = np.linspace(0.0, len(xy) - 1.0, min(len(xy), MOST_POINTS))
            found[label] = xy[np.rint(chosen).astype(int)]
    return found


def _write_frame(folder: Path, name: str, truth: bool, seed: int) -> None:
    made = frame(seed, name=name)
    path = folder / f"{seed:07d}_{'goal' if made.behind_goal else 'main'}.jpg"
    if truth and made.camera is not None:
        pixels = in_view(made, game_named(name).classes)
        write_text(folder / ANNOTATIONS.file_name(path.stem), format_annotation(pixels, made.camera.image_size))
        write_text(folder / CAMERAS.file_name(path.stem), format_camera(made.camera))
    write_bytes(path.with_suffix(".png"), cv2.imencode(".png", made.mask)[1].tobytes())
    write_bytes(path, cv2.imencode(".jpg", made.image, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1].tobytes())
