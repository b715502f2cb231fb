"""SoccerNet's files: line annotations, normalised, cameras, and which camera filmed which image.

An annotation maps labels to points ``{"x": ..., "y": ...}`` in 0..1; SoccerNet's evaluation multiplies them by
(width - 1) and (height - 1), and so does this module. Its cameras have the package's own axes and angles, in degrees.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path, PurePosixPath
from types import MappingProxyType
from typing import Any

import numpy as np

from fieldcalib._types import Array
from fieldcalib.fields.traits import BEHIND_LEFT_GOAL, BEHIND_RIGHT_GOAL, MAIN_CENTER, MAIN_LEFT, MAIN_RIGHT
from fieldcalib.geometry.camera import Camera, checked_image_size
from fieldcalib.geometry.rotation import angles_from_rotation, rotation_from_angles
from fieldcalib.io.files import BrokenFileError as BrokenFileError  # re-exported: every reader here raises it
from fieldcalib.io.files import FrameFile, find_files, named_in_errors, parse_json_object
from fieldcalib.problem.labelled_pixels import Pixels

# Labels of annotators for segments that they could not identify.
UNKNOWN_LABELS = frozenset({"Line unknown", "Goal unknown"})
TRAILING_BLANK = frozenset({"Goal left post left"})  # written "Goal left post left " in SoccerNet

CAMERA_TYPES = "match_info_cam_gt.json"
# SoccerNet's camera types -> the camera distributions that describe them, by name. The types do not say behind which
# goal a camera stands. Types that are not here (close-ups, "Spider camera", ...) have no distribution.
DISTRIBUTIONS_OF_TYPE: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "Main camera center": (MAIN_CENTER.name,),
        "Main camera left": (MAIN_LEFT.name,),
        "Main camera right": (MAIN_RIGHT.name,),
        "Main behind the goal": (BEHIND_LEFT_GOAL.name, BEHIND_RIGHT_GOAL.name),
    }
)

LENS = (("radial_distortion", 6), ("tangential_distortion", 2), ("thin_prism_distortion", 4))  # keys and lengths
# Positions of these twelve coefficients in OpenCV's order: k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4.
OPENCV_ORDER = [0, 1, 6, 7, 2, 3, 4, 5, 8, 9, 10, 11]


def parse_annotation(content: bytes | str, image_size: tuple[int, int], *, unknown: bool = False) -> Pixels:
    """Labelled pixels of an annotation.

    Parameters
    ----------
    content : bytes or str
        The file's JSON.
    image_size : (int, int)
        Width and height in pixels.
    unknown : bool
        Whether to keep "Line unknown" and "Goal unknown": nothing can be calibrated from them, but SoccerNet's
        evaluation counts them as segments that a camera misses.

    Returns
    -------
    dict of str to (N, 2) array
        Labels without trailing blanks; labels without points are left out.

    Raises
    ------
    BrokenFileError
        If it is no JSON, no mapping of labels to points, gives a label twice, or holds numbers that cannot be
        normalised coordinates.

    Examples
    --------
    >>> parse_annotation('{"Middle line": [{"x": 0.5, "y": 0.0}, {"x": 0.5, "y": 1.0}]}', (961, 541))
    {'Middle line': array([[480.,   0.],
           [480., 540.]])}
    """
    record = parse_json_object(content, "labels")
    pixels: Pixels = {}
    scale = np.array(checked_image_size(image_size)) - 1.0
    for label, points in record.items():
        name = label.strip()
        if not points or (name in UNKNOWN_LABELS and not unknown):
            continue
        if name in pixels:
            raise BrokenFileError(f"{name!r} is given twice, with and without surrounding blanks")
        try:
            xy = np.array([(float(point["x"]), float(point["y"])) for point in points])
        except (TypeError, KeyError, ValueError, OverflowError):
            raise BrokenFileError(f'{label!r}: expected a list of points {{"x": ..., "y": ...}}') from None
        if not np.all(np.isfinite(xy)):
            raise BrokenFileError(f"{label!r}: a coordinate is not finite")
        if np.max(np.abs(xy)) > 10.0:
            raise BrokenFileError(f"{label!r}: coordinates up to {np.max(np.abs(xy)):.6g} are not normalised to 0..1")
        pixels[name] = xy * scale
    return pixels


def format_annotation(pixels: Mapping[str, Array], image_size: tuple[int, int]) -> str:
    """The JSON of an annotation: the inverse of `parse_annotation`, with SoccerNet's spelling of the labels.

    Raises
    ------
    ValueError
        If a pixel is not finite, or the image is one pixel wide or high: its coordinates cannot be normalised.
    """
    width, height = checked_image_size(image_size)
    if pixels and min(width, height) < 2:
        raise ValueError(f"pixels of an image of {width} x {height} cannot be normalised by (width - 1, height - 1)")
    scale = np.array(image_size) - 1.0
    record = {
        label + " " if label in TRAILING_BLANK else label: [
            {"x": x, "y": y} for x, y in (np.asarray(xy) / scale).tolist()
        ]
        for label, xy in pixels.items()
    }
    return json.dumps(record, allow_nan=False)


def camera_to_record(camera: Camera) -> dict[str, Any]:
    """A camera as SoccerNet writes it: angles in degrees, position in metres, focal lengths in pixels.

    It belongs to images of the camera's size: SoccerNet's evaluation does not rescale.

    Examples
    --------
    >>> camera = Camera.from_angles(0.0, np.radians(80.0), 0.0, 1500.0, (0.0, 60.0, -15.0), (960, 540))
    >>> record = camera_to_record(camera)
    >>> round(record["tilt_degrees"], 9), record["position_meters"]
    (80.0, [0.0, 60.0, -15.0])
    """
    pan, tilt, roll = np.degrees(angles_from_rotation(camera.R)).tolist()
    coefficients = np.empty(len(OPENCV_ORDER))
    coefficients[OPENCV_ORDER] = camera.opencv_coefficients
    ends = np.cumsum([count for _, count in LENS])
    return {
        "pan_degrees": pan,
        "tilt_degrees": tilt,
        "roll_degrees": roll,
        "position_meters": camera.C.tolist(),
        "x_focal_length": float(camera.K[0, 0]),
        "y_focal_length": float(camera.K[1, 1]),
        "principal_point": camera.K[:2, 2].tolist(),
        **{key: coefficients[end - count : end].tolist() for (key, count), end in zip(LENS, ends, strict=True)},
    }


def format_camera(camera: Camera) -> str:
    """The JSON of a camera file, see `camera_to_record`."""
    return json.dumps(camera_to_record(camera), indent=2)


def camera_from_record(
    record: Mapping[str, Any], image_size: tuple[int, int] | None = None, *, checked: bool = True
) -> Camera:
    """A camera from SoccerNet's record.

    Parameters
    ----------
    record : mapping
        As `camera_to_record` makes it.
    image_size : (int, int), optional
        Width and height; by default twice the principal point, as SoccerNet has it.
    checked : bool
        As in `Camera`: False for a camera that is to be evaluated as it is.

    Raises
    ------
    BrokenFileError
        If a key is missing or the values are no camera's.

    Examples
    --------
    >>> camera = Camera.from_angles(0.0, np.radians(80.0), 0.0, 1500.0, (0.0, 60.0, -15.0), (960, 540))
    >>> record = camera_to_record(camera) | {"x_focal_length": -3.0, "tangential_distortion": [0.1, 0.2]}
    >>> camera_from_record(record, checked=False).dist
    array([[0. , 0. , 0.1, 0.2, 0. ]])
    """
    try:
        angles = np.radians([float(record[f"{name}_degrees"]) for name in ("pan", "tilt", "roll")])
        cx, cy = (float(v) for v in record["principal_point"])
        fx, fy = float(record["x_focal_length"]), float(record["y_focal_length"])
        coefficients = [float(v) for key, count in LENS for v in _numbers(record, key, count)]
        size = (round(2.0 * cx), round(2.0 * cy)) if image_size is None else image_size
        K = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
        with np.errstate(invalid="ignore"):  # infinite angles
            R = rotation_from_angles(angles)
        return Camera(K, R, record["position_meters"], size, np.take(coefficients, OPENCV_ORDER), checked)
    except KeyError as error:
        raise BrokenFileError(f"a camera needs the key {error}") from None
    except (TypeError, ValueError, OverflowError) as error:
        raise BrokenFileError(f"is no camera: {error}") from None


def _numbers(record: Mapping[str, Any], key: str, count: int) -> Any:
    values = record[key]
    if len(values) != count:
        raise ValueError(f"{key} must have {count} coefficients, got {len(values)}")
    return values


def parse_camera(content: bytes | str, image_size: tuple[int, int] | None = None) -> Camera:
    """The camera of a camera file, see `camera_from_record`; to be evaluated as it is, it is not `checked`.

    Raises
    ------
    BrokenFileError
        If it is no JSON object or no camera.
    """
    return camera_from_record(parse_json_object(content, "camera parameters"), image_size, checked=False)


def camera_types(content: bytes | str) -> dict[str, str]:
    """Camera types of a ``match_info_cam_gt.json``: which camera filmed which image.

    `DISTRIBUTIONS_OF_TYPE` has the camera distributions of a type.

    Returns
    -------
    dict of str to str
        Id of the frame -> type, as "Main camera center".

    Raises
    ------
    BrokenFileError
        If it is no JSON object of images with their camera.

    Examples
    --------
    >>> types = camera_types('{"00001.jpg": {"camera": "Main behind the goal", "league": "a league"}}')
    >>> types, DISTRIBUTIONS_OF_TYPE.get(types["00001"])
    ({'00001': 'Main behind the goal'}, ('behind left goal', 'behind right goal'))
    """
    types = {}
    for image, info in parse_json_object(content, "images").items():
        if not (isinstance(info, dict) and isinstance(info.get("camera"), str)):
            raise BrokenFileError(f'{image!r}: expected an object with "camera": "<type>"')
        types[PurePosixPath(image).stem] = info["camera"]
    return types


def read_camera_types(inputs: Iterable[Path]) -> dict[str, str]:
    """Camera types of the ``match_info_cam_gt.json`` that lie in folders and zips, see `camera_types`.

    Raises
    ------
    FileNotFoundError
        If there is none.
    BrokenFileError
        If one is broken; the message begins with its path.
    """
    paths = list(inputs)
    files: list[FrameFile] = []
    for path in paths:
        with suppress(FileNotFoundError):
            files += find_files([path], "camera types", suffix=CAMERA_TYPES)
    files = [file for file in files if file.path not in paths]  # not a single annotation
    if not files:
        names = ", ".join(map(str, paths))
        raise FileNotFoundError(f"{names} has no {CAMERA_TYPES}, which would say the type of each frame's camera")
    types: dict[str, str] = {}
    for file in files:
        with named_in_errors(file.path):
            types |= camera_types(file.read())
    return types
