"""Intrinsics in files: those of OpenCV's calibration sample, and this package's cameras."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from pathlib import Path

from fieldcalib._types import Array
from fieldcalib.io.files import named_in_errors, parse_json_object, read_regular_file
from fieldcalib.io.soccernet import camera_from_record

CAMERA_FILE_KEY = "x_focal_length"  # in this package's own camera files


@dataclass(frozen=True, eq=False)
class Intrinsics:
    """Focal length, principal point and lens of a camera in a file."""

    camera_matrix: Array
    """(3, 3)"""
    dist_coeffs: Array
    """(n,), in OpenCV's order; of a fisheye lens the four of cv2.fisheye."""
    image_size: tuple[int, int] | None
    """Width and height of the images that they are for; None where the file does not say."""
    fisheye: bool = False
    """Whether the lens is that of cv2.fisheye."""

    def __str__(self) -> str:
        """All of it, to the last digit."""
        return json.dumps(
            [self.camera_matrix.tolist(), self.dist_coeffs.tolist(), self.image_size, *["fisheye"] * self.fisheye]
        )


def read_intrinsics(path: str | os.PathLike[str]) -> Intrinsics:
    """The intrinsics of a file of OpenCV's (`fieldcalib.io.exports.opencv`) or of a camera file of this package.

    A camera file, ``camera_<id>.json``, does not say the size of its images.

    Raises
    ------
    BrokenFileError
        If it is neither; the message begins with its path.
    """
    with named_in_errors(path):
        content = read_regular_file(Path(path))
        if not content.lstrip().startswith(b"{"):
            return _of_opencv(content)
        record = parse_json_object(content, "a camera")
        if CAMERA_FILE_KEY not in record:
            return _of_opencv(content)
        camera = camera_from_record(record)
        return Intrinsics(camera.K, camera.dist[0], None)


def _of_opencv(content: bytes) -> Intrinsics:
    from fieldcalib.io.exports.opencv import parse_opencv  # imports OpenCV

    found = parse_opencv(content)
    return Intrinsics(found.camera_matrix, found.dist_coeffs, found.image_size, found.fisheye)
