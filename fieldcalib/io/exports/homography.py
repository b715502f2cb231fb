"""Homographies from pixels to metres on the ground, as a table and as arrays of NumPy."""

from __future__ import annotations

import io
from collections.abc import Mapping
from typing import Any

import numpy as np

from fieldcalib.fields.field import Field
from fieldcalib.fields.ground_homography import FieldHomography, field_homography
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.io.exports.frames import FrameCameras, csv_table, with_cameras
from fieldcalib.io.files import escaped

MATRICES = ("from_undistorted", "from_raw")
LEFT_BY_LENS = ("rms_px", "largest_px", "rms_m", "largest_m")


def homography_files(frames: FrameCameras, fields: Mapping[str, Field | None] | None = None) -> dict[str, bytes]:
    """``homographies.csv`` and ``homographies.npz`` with the homographies of every frame.

    Each maps a pixel (x, y, 1) to (u, v, w), and (u / w, v / w) are metres on the ground: ``from_undistorted`` exactly,
    from pixels of an image without the distortion of the lens (`fieldcalib undistort`); ``from_raw`` nearly, from
    those of the image as it is. ``rms_px``, ``largest_px``, ``rms_m`` and ``largest_m`` say by how much the latter
    misses over the part of the field in view.

    Parameters
    ----------
    frames : mapping of str to Camera or None
        Frames without a camera have empty cells in the table, and NaN in the arrays (N, 3, 3) and (N,), whose order
        is that of ``ids``.
    fields : mapping of str to Field or None, optional
        The field of every frame; of others it is soccer's.

    Raises
    ------
    ValueError
        If no frame has a camera.

    Examples
    --------
    >>> from fieldcalib import Camera, soccer
    >>> camera = Camera.from_angles(0.0, 1.3, 0.0, 1500.0, C=(0, 60, -15), image_size=(960, 540))
    >>> files = homography_files({"1": camera, "2": None}, {"1": soccer()})
    >>> arrays = np.load(io.BytesIO(files["homographies.npz"]))
    >>> u = arrays["from_raw"][0] @ [*camera.project([3.0, 4.0, 0.0]), 1.0]
    >>> (u[:2] / u[2]).round(6), arrays["largest_m"]
    (array([3., 4.]), array([ 0., nan]))
    """
    cameras, known = with_cameras(frames), fields or {}
    found = {id: field_homography(camera, known.get(id) or soccer()) for id, camera in cameras.items()}
    rows = [found.get(id) for id in frames]
    return {"homographies.csv": _table(list(frames), rows), "homographies.npz": _arrays(list(frames), rows)}


def _table(ids: list[str], rows: list[FieldHomography | None]) -> bytes:
    cells = [f"{name}_{row}{column}" for name in MATRICES for row in (1, 2, 3) for column in (1, 2, 3)]
    titles = ["id", *cells, *(f"from_raw_{name}" for name in LEFT_BY_LENS)]
    values = ([""] * (len(titles) - 1) if row is None else _cells(row) for row in rows)
    return csv_table(titles, ([escaped(id), *of_frame] for id, of_frame in zip(ids, values, strict=True)))


def _cells(row: FieldHomography) -> list[float | str]:
    numbers = [*row.from_undistorted.flat, *row.from_raw.flat, *(getattr(row, name) for name in LEFT_BY_LENS)]
    return ["" if np.isnan(number) else float(number) for number in numbers]


def _arrays(ids: list[str], rows: list[FieldHomography | None]) -> bytes:
    none = np.full((3, 3), np.nan)
    arrays: dict[str, Any] = {"ids": np.array(ids)}
    for names, missing in ((MATRICES, none), (LEFT_BY_LENS, np.nan)):
        arrays |= {name: np.array([missing if row is None else getattr(row, name) for row in rows]) for name in names}
    file = io.BytesIO()
    np.savez(file, **arrays)
    return file.getvalue()
