"""TVCalib's results, ``per_sample_output.json``: JSON lines, one record for each image.

A record holds a camera under SoccerNet's keys, the horizontal angle of view, the losses in NDC, or a homography, which
maps the image to the field. Values may lie one list deeper, one for each of T = 1 time steps. Records of homographies
alone, as the baselines and the aligned results of others have them, lack the camera.
"""

from __future__ import annotations

import json
import reprlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import Any

import numpy as np

from fieldcalib._types import Array
from fieldcalib.geometry.camera import Camera
from fieldcalib.io.files import BrokenFileError, parse_json_object
from fieldcalib.io.soccernet import LENS, camera_from_record, camera_to_record
from fieldcalib.io.wc14 import checked_homography

SCALARS = ("pan_degrees", "tilt_degrees", "roll_degrees", "x_focal_length", "y_focal_length")
VECTORS = ("position_meters", "principal_point", *(key for key, _ in LENS))
KINDS = ("a number", "a list of numbers", "a matrix")  # by the number of axes
NUMBERS = ("loss_ndc_total", "loss_ndc_lines", "loss_ndc_circles", "time_s")


@dataclass(frozen=True, eq=False)
class TVCalibRecord:
    """TVCalib's results for one image; missing ones are None.

    Parameters
    ----------
    id : str
        Id of the frame, whose image is called ``<id>.jpg``.
    camera : Camera, optional
    homography : (3, 3) array, optional
        Maps field points (x, y, 1) in metres to pixels; the file holds its inverse.
    loss_ndc_total, loss_ndc_lines, loss_ndc_circles : float, optional
        Loss in normalised device coordinates, which is compared with tau, and its parts.
    time_s : float, optional
        Seconds that the image took.
    image_size : (int, int), optional
        Width and height in pixels that the file gives.
    """

    id: str
    camera: Camera | None = None
    homography: Array | None = None
    loss_ndc_total: float | None = None
    loss_ndc_lines: float | None = None
    loss_ndc_circles: float | None = None
    time_s: float | None = None
    image_size: tuple[int, int] | None = None


def parse_per_sample_output(content: bytes | str, *, broken: list[str] | None = None) -> list[TVCalibRecord]:
    """The records of a ``per_sample_output.json``, in its order.

    The size of an image is ``image_width`` x ``image_height`` or, without these, twice the principal point. Cameras are
    not `checked`. Numbers and homographies that are null or not finite are None.

    Parameters
    ----------
    content : bytes or str
        The file's text.
    broken : list of str, optional
        Gets a message for each line that holds no record; without it the first one raises.

    Raises
    ------
    BrokenFileError
        If it is no text, or a line holds no record; the message begins with its number.

    Examples
    --------
    >>> line = '{"image_ids": "00001.jpg", "homography": [[0.1, 0, -48], [0, 0.1, -27], [0, 0, 1]], "time_s": null}'
    >>> (record,) = parse_per_sample_output(line)
    >>> record.id, record.homography @ [0.0, 0.0, 1.0], record.time_s
    ('00001', array([480., 270.,   1.]), None)
    """
    try:
        text = content if isinstance(content, str) else content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise BrokenFileError(f"is no text in UTF-8: {error}") from None
    records = []
    for number, line in enumerate(text.split("\n"), start=1):
        if not line.strip():
            continue
        try:
            records.append(_record_of(parse_json_object(line, "a record")))
        except BrokenFileError as error:
            message = f"line {number}: {error}"
            if broken is None:
                raise BrokenFileError(message) from None
            broken.append(message)
    return records


def format_per_sample_output(records: Iterable[TVCalibRecord]) -> str:
    """The JSON lines of records, the inverse of `parse_per_sample_output`, as TVCalib's evaluation reads them."""
    return "".join(json.dumps(_line_of(record)) + "\n" for record in records)


def _record_of(line: Mapping[str, Any]) -> TVCalibRecord:
    names = line.get("image_ids")
    name = names[0] if isinstance(names, list) and len(names) == 1 else names
    if not (isinstance(name, str) and name):
        raise BrokenFileError(f'expected "image_ids": "<id>.jpg", got {reprlib.repr(name)}')
    homography = _array(line, "homography", ndim=2)
    if homography is not None and not np.all(np.isfinite(homography)):
        homography = None
    width, height = _number(line, "image_width"), _number(line, "image_height")
    size = None if width is None or height is None else (round(width), round(height))
    return TVCalibRecord(
        PurePosixPath(name).stem,
        _camera(line, size),
        None if homography is None else np.asarray(np.linalg.inv(checked_homography(homography))),
        image_size=size,
        **{key: _number(line, key) for key in NUMBERS},
    )


def _camera(line: Mapping[str, Any], image_size: tuple[int, int] | None) -> Camera | None:
    """The camera of a record; None where its angles are null or not there: a failure, or a homography alone."""
    if _number(line, "pan_degrees") is None:
        return None
    values = {key: _array(line, key, ndim) for keys, ndim in ((SCALARS, 0), (VECTORS, 1)) for key in keys}
    present = {key: value for key, value in values.items() if value is not None}
    return camera_from_record(present, image_size, checked=False)


def _number(line: Mapping[str, Any], key: str) -> float | None:
    value = _array(line, key, ndim=0)
    return float(value) if value is not None and np.isfinite(value) else None


def _array(line: Mapping[str, Any], key: str, ndim: int) -> Array | None:
    """A value with `ndim` axes, without the axis of time steps; None where it is null or not there."""
    if line.get(key) is None:
        return None
    try:
        value = np.array(line[key], dtype=float)
    except (TypeError, ValueError, OverflowError):
        raise BrokenFileError(f"{key!r}: expected {KINDS[ndim]}, got {reprlib.repr(line[key])}") from None
    while value.ndim > ndim and len(value) == 1:
        value = value[0]
    if value.ndim != ndim:
        raise BrokenFileError(f"{key!r}: expected {KINDS[ndim]} of one time step, got shape {value.shape}")
    return value


def _line_of(record: TVCalibRecord) -> dict[str, Any]:
    line: dict[str, Any] = {"image_ids": f"{record.id}.jpg"}
    if record.camera is not None:
        width, _ = record.camera.image_size
        aov = 2.0 * np.arctan2(0.5 * width, record.camera.K[0, 0])  # f = w / (2 tan(aov / 2)), f < 0 included
        line |= camera_to_record(record.camera)
        line |= {"aov_radian": float(aov), "aov_degrees": float(np.degrees(aov))}
    size = record.image_size or (record.camera and record.camera.image_size)
    if size:
        line |= {"image_width": size[0], "image_height": size[1]}
    line["homography"] = None if record.homography is None else np.linalg.inv(record.homography).tolist()
    return line | {key: getattr(record, key) for key in NUMBERS}
