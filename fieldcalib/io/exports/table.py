"""Cameras as a table: ``cameras.csv``, a row for every frame."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from fieldcalib.geometry.camera import Camera
from fieldcalib.geometry.lens.model import COEFFICIENTS
from fieldcalib.io.exports.frames import FrameCameras, csv_table, with_cameras
from fieldcalib.io.files import escaped

CAMERA_COLUMNS = (
    *("width", "height", "fx", "fy", "cx", "cy"),  # pixels
    *("pan_degrees", "tilt_degrees", "roll_degrees"),
    *("x", "y", "z"),  # metres
    *COEFFICIENTS,
)
ABOUT = ("status", "verdict", "basis", "rms_px", "probability_right_1m")  # of the lines of a run


def table_files(frames: FrameCameras, about: Mapping[str, Mapping[str, Any]] | None = None) -> dict[str, bytes]:
    """``cameras.csv``: id, results of the frame (`ABOUT`), and the camera (`CAMERA_COLUMNS`).

    Axes are those of this package. Missing values are empty cells.

    Parameters
    ----------
    frames : mapping of str to Camera or None
    about : mapping of str to mapping, optional
        The line of every frame's result, by id.

    Raises
    ------
    ValueError
        If no frame has a camera.

    Examples
    --------
    >>> camera = Camera.from_angles(0.0, 1.3, 0.0, 1500.0, C=(0, 60, -15), image_size=(960, 540))
    >>> rows = table_files({"1": camera, "2": None})["cameras.csv"].decode().splitlines()
    >>> rows[1][:40], rows[2][:40]
    ('1,,,,,,960,540,1500.0,1500.0,480.0,270.0', '2,,,,,,,,,,,,,,,,,,,,,,,,,,,,,')
    """
    with_cameras(frames)
    lines = about or {}
    none = [""] * len(CAMERA_COLUMNS)
    about_frames = ([escaped(id), *(lines.get(id, {}).get(name) for name in ABOUT)] for id in frames)
    of_cameras = (none if camera is None else _camera_cells(camera) for camera in frames.values())
    rows = ([*said, *cells] for said, cells in zip(about_frames, of_cameras, strict=True))
    return {"cameras.csv": csv_table(["id", *ABOUT, *CAMERA_COLUMNS], rows)}


def _camera_cells(camera: Camera) -> list[float]:
    (fx, _, cx), (_, fy, cy), _ = camera.K.tolist()
    angles = np.degrees(camera.angles).tolist()
    return [*camera.image_size, fx, fy, cx, cy, *angles, *camera.C.tolist(), *camera.opencv_coefficients.tolist()]
