"""SoccerNet's files: line annotations, normalised, and cameras.

An annotation maps labels to points ``{"x": ..., "y": ...}`` in 0..1; SoccerNet's evaluation multiplies them by
(width - 1) and (height - 1), and so does this module. Its cameras have the package's own axes and angles, in degrees.
"""

from __future__ import annotations

import json
import zipfile
import zlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fieldcalib._types import Array
from fieldcalib.camera import Camera
from fieldcalib.rotation import rotation_from_angles
from fieldcalib.segments import Pixels

# Labels by which annotators say that they do not know.
UNKNOWN_LABELS = frozenset({"Line unknown", "Goal unknown"})
TRAILING_BLANK = frozenset({"Goal left post left"})  # written "Goal left post left " in SoccerNet
NOT_FRAMES = ("match_info", "per_match_info", "camera_", "summary", ".")

RADIAL, TANGENTIAL, THIN_PRISM = "radial_distortion", "tangential_distortion", "thin_prism_distortion"


class BrokenFileError(ValueError):
    """A file that does not hold what its format promises; the message says what is wrong with it."""


@dataclass(frozen=True)
class AnnotationFile:
    """One frame's annotation, in a folder or in a zip."""

    path: Path | zipfile.Path

    @property
    def id(self) -> str:
        """File name without ending: the frame's."""
        return self.path.stem

    def read(self) -> bytes:
        """The content.

        Raises
        ------
        BrokenFileError
            If it cannot be read.
        """
        try:
            return self.path.read_bytes()
        except (OSError, EOFError, RuntimeError, zipfile.BadZipFile, zlib.error) as error:  # encrypted: RuntimeError
            raise BrokenFileError(f"cannot be read: {error}") from error


def find_annotations(inputs: Iterable[Path]) -> list[AnnotationFile]:
    """Annotation files of folders, zips and single files, in the order of their names.

    Every ``<id>.json`` is a frame, except for match_info files, cameras and summaries.

    Raises
    ------
    FileNotFoundError
        If an input does not exist or holds no annotation.
    BrokenFileError
        If a zip is none, or two files would be the same frame.
    """
    found: list[AnnotationFile] = []
    for path in inputs:
        members = list(_annotations_in(path))
        if not members:
            raise FileNotFoundError(f"{path} holds no annotation: expected files named <id>.json")
        found.extend(members)
    seen: dict[str, AnnotationFile] = {}
    for file in found:
        if file.id in seen:
            raise BrokenFileError(
                f"{file.path} and {seen[file.id].path} are the same frame {file.id}: rename one of them"
            )
        seen[file.id] = file
    return found


def _annotations_in(path: Path) -> Iterator[AnnotationFile]:
    if path.is_dir():
        for file in sorted(path.iterdir()):
            if _is_frame(file.name):
                yield AnnotationFile(file)
    elif not path.is_file():
        raise FileNotFoundError(f"{path} does not exist: expected a folder, a zip or a .json file")
    elif path.suffix.lower() == ".zip":
        try:
            archive = zipfile.ZipFile(path)  # left open, to be read from
        except (OSError, zipfile.BadZipFile) as error:
            raise BrokenFileError(f"{path}: {error}") from error
        for name in sorted(archive.namelist()):
            member = zipfile.Path(archive, name)
            if _is_frame(member.name) and "__MACOSX/" not in name:
                yield AnnotationFile(member)
    else:
        yield AnnotationFile(path)


def _is_frame(name: str) -> bool:
    return name.endswith(".json") and not name.startswith(NOT_FRAMES)


def parse_annotation(content: bytes | str, image_size: tuple[int, int]) -> Pixels:
    """Labelled pixels of an annotation.

    Parameters
    ----------
    content : bytes or str
        The file's JSON.
    image_size : (int, int)
        Width and height in pixels.

    Returns
    -------
    dict of str to (N, 2) array
        Labels without trailing blanks; "Line unknown", "Goal unknown" and labels without points are left out.

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
    try:
        record = json.loads(content)
    except (ValueError, RecursionError) as error:
        raise BrokenFileError(f"is no JSON: {error}") from error
    if not isinstance(record, dict):
        raise BrokenFileError(f"expected a JSON object of labels, got {type(record).__name__}")
    pixels: Pixels = {}
    scale = np.array(image_size) - 1.0
    for label, points in record.items():
        name = label.strip()
        if name in UNKNOWN_LABELS or not points:
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
    """The JSON of an annotation: the inverse of `parse_annotation`, with SoccerNet's spelling of the labels."""
    scale = np.array(image_size) - 1.0
    record = {
        label + " " if label in TRAILING_BLANK else label: [
            {"x": x, "y": y} for x, y in (np.asarray(xy) / scale).tolist()
        ]
        for label, xy in pixels.items()
    }
    return json.dumps(record)


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
    pan, tilt, roll = np.degrees(camera.angles).tolist()
    return {
        "pan_degrees": pan,
        "tilt_degrees": tilt,
        "roll_degrees": roll,
        "position_meters": camera.C.tolist(),
        "x_focal_length": float(camera.K[0, 0]),
        "y_focal_length": float(camera.K[1, 1]),
        "principal_point": camera.principal_point.tolist(),
        RADIAL: [*camera.k.tolist(), 0.0, 0.0, 0.0, 0.0],
        TANGENTIAL: [0.0, 0.0],
        THIN_PRISM: [0.0, 0.0, 0.0, 0.0],
    }


def camera_from_record(record: Mapping[str, Any], image_size: tuple[int, int] | None = None) -> Camera:
    """A camera from SoccerNet's record.

    Parameters
    ----------
    record : mapping
        As `camera_to_record` makes it.
    image_size : (int, int), optional
        Width and height; by default twice the principal point, as SoccerNet has it.

    Raises
    ------
    BrokenFileError
        If a key is missing, the values are no camera's, or a lens coefficient other than the first two radial ones is
        not 0.
    """
    try:
        angles = np.radians([float(record[f"{name}_degrees"]) for name in ("pan", "tilt", "roll")])
        cx, cy = (float(v) for v in record["principal_point"])
        fx, fy = float(record["x_focal_length"]), float(record["y_focal_length"])
        k1, k2, *others = (float(v) for v in record[RADIAL])
        others += [float(v) for name in (TANGENTIAL, THIN_PRISM) for v in record[name]]
        size = (round(2.0 * cx), round(2.0 * cy)) if image_size is None else image_size
        K = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
        camera = Camera(K, rotation_from_angles(angles), record["position_meters"], size, (k1, k2))
    except KeyError as error:
        raise BrokenFileError(f"a camera needs the key {error}") from None
    except (TypeError, ValueError, OverflowError) as error:
        raise BrokenFileError(f"is no camera: {error}") from None
    if any(others):
        raise BrokenFileError("only the radial coefficients k1 and k2 are modelled; this camera has others")
    return camera
