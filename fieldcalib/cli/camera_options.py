"""Known parameters of the camera: --intrinsics, in files of OpenCV or of this package, --position, --rotation.

Options for pictures that are not whole frames with square pixels (`fieldcalib.problem.picture_shape`).
"""

from __future__ import annotations

import argparse
import json
import os
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fieldcalib._types import Array
from fieldcalib.console.arguments import Default, image_size, told_by
from fieldcalib.console.options import did_you_mean, option
from fieldcalib.geometry.camera import Camera
from fieldcalib.geometry.rotation import rotation_from_angles
from fieldcalib.io.clips import placed
from fieldcalib.io.files import BrokenFileError, named_in_errors, parse_json_object, read_regular_file
from fieldcalib.io.soccernet import camera_from_record
from fieldcalib.problem.picture_shape import LEAST_RATIO, Crop, Declared, Placement
from fieldcalib.run_folder.record import ESTIMATED
from fieldcalib.solve.request import GivenCamera
from fieldcalib.solve.solver_options import KNOWN_INTRINSICS_FLAGS, LENS_FLAGS, CalibrationFlags, Prior

CAMERA_FILE_KEY = "x_focal_length"  # in this package's own camera files
SQUARE = "square"
SAME_SHAPE = 0.005  # relative difference of two aspect ratios: sizes are whole numbers
OFF_MIDDLE = 0.25  # share of width and height: a principal point farther off is of images of another size


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


def aspect(text: str) -> str | float:
    """Parse "estimated", "square" or "16:9", for argparse.

    Examples
    --------
    >>> aspect("square"), aspect("3:2"), aspect("1.5")
    ('square', 1.5, 1.5)
    """
    if text in (ESTIMATED, SQUARE):
        return text
    found = re.fullmatch(r"([0-9]+(?:\.[0-9]+)?)(?::([0-9]+(?:\.[0-9]+)?))?", text)
    ratio = float(found[1]) / (float(found[2] or 1.0) or np.inf) if found else 0.0
    if not LEAST_RATIO <= ratio <= 1.0 / LEAST_RATIO:
        hint = did_you_mean(text, (ESTIMATED, SQUARE))
        raise argparse.ArgumentTypeError(f"expected {ESTIMATED}, {SQUARE} or width:height as 16:9, got {text!r}{hint}")
    return ratio


def _intrinsics(text: str) -> Intrinsics:
    found = read_intrinsics(text)
    try:
        pose, size = (np.eye(3), np.zeros(3)), found.image_size or (1, 1)
        Camera(found.camera_matrix, *pose, size, found.dist_coeffs, fisheye=found.fisheye)
    except ValueError as error:
        raise ValueError(f"{text}: {error}") from None
    return found


def _position(text: str) -> tuple[float, float, float]:
    x, y, z = _three(text, "X,Y,Z in metres, as 0,62,-17")
    if z >= 0.0:
        raise argparse.ArgumentTypeError(f"z points down, so a camera that is 17 m up has z = -17; got {text!r}")
    return x, y, z


def _rotation(text: str) -> tuple[float, float, float]:
    return _three(text, "PAN,TILT,ROLL in degrees, as 12,78,0")


def _three(text: str, what: str) -> tuple[float, float, float]:
    try:
        first, second, third = (float(part) for part in text.split(","))
        if np.all(np.isfinite((first, second, third))):
            return first, second, third
    except ValueError:
        pass
    raise argparse.ArgumentTypeError(f"expected {what}, got {text!r}")


@dataclass(frozen=True)
class KnownCamera:
    """What the user knows of the camera, and of how the pictures lie in its whole frames with square pixels."""

    lens: str
    """Name of what is estimated of the lens, see `LENS_FLAGS`."""
    display_size: tuple[int, int] | None = option(
        "at which the pictures are shown, if their pixels are not square: 1920x1080 for a broadcast that was squashed "
        "to 640x640 (that of the pictures)",
        exclusive="pixels",
        type=image_size,
        metavar="WxH",
    )
    aspect: str | float = option(
        "estimated: pictures of another shape than 16:9 were squashed from it where their lines say so (default); "
        "square: their pixels are square; 16:9: they are shown like that",
        default=ESTIMATED,
        exclusive="pixels",
        type=aspect,
        metavar="estimated|square|W:H",
    )
    """`ESTIMATED`, `SQUARE`, or width / height as shown."""
    crop_of: Crop | None = option(
        "the pictures are parts of frames of this size, where their upper left corners are at X, Y; in pixels as "
        "shown; their own size with +0+0 says that nothing is cut off (where their lines do not tell, that is asked)",
        type=told_by(Crop.parse),
        metavar="WxH+X+Y",
    )
    intrinsics: Intrinsics | None = option(
        "known focal length, principal point and lens: YAML, XML or JSON of OpenCV's calibration sample, or a "
        "camera_<id>.json; of whole frames as shown, scaled to their size",
        type=told_by(_intrinsics),
        metavar="FILE",
    )
    position: tuple[float, float, float] | None = option(
        "known position of the camera in metres: from the centre mark, y towards the main stand, z down",
        type=_position,
        metavar="X,Y,Z",
    )
    rotation: tuple[float, float, float] | None = option(
        "known rotation of the camera, degrees, as in camera_<id>.json", type=_rotation, metavar="PAN,TILT,ROLL"
    )

    def __post_init__(self) -> None:
        """Raise a ValueError if the options contradict each other, or leave nothing to estimate."""
        if self.intrinsics is not None and not isinstance(self.lens, Default):
            raise ValueError("--intrinsics says what the lens is: leave --lens out")
        if None not in (self.intrinsics, self.position, self.rotation):
            raise ValueError(
                "--intrinsics, --position and --rotation together leave nothing to estimate: leave one out"
            )

    def flags(self, prior: Prior) -> CalibrationFlags:
        """Flags of what is known and what is estimated under a prior."""
        F = CalibrationFlags
        flags = KNOWN_INTRINSICS_FLAGS if self.intrinsics is not None else LENS_FLAGS[self.lens]
        if prior is None:
            flags |= F.CALIB_FIX_PRINCIPAL_POINT
        if self.intrinsics is not None and self.intrinsics.fisheye:
            flags |= F.CALIB_FISHEYE
        if self.position is not None:
            flags |= F.CALIB_FIX_POSITION
        if self.rotation is not None:
            flags |= F.CALIB_FIX_ROTATION
        return flags

    @property
    def given(self) -> GivenCamera:
        """The known values."""
        known = GivenCamera()
        if self.intrinsics is not None:
            K, dist = self.intrinsics.camera_matrix, self.intrinsics.dist_coeffs
            known = GivenCamera(K, dist, image_size=self.intrinsics.image_size)
        if self.rotation is None and self.position is None:
            return known
        R = np.eye(3) if self.rotation is None else rotation_from_angles(np.radians(self.rotation))
        rvec, tvec, *_ = Camera(np.eye(3), R, self.position or np.zeros(3), (1, 1)).to_opencv()
        return known._replace(rvec=rvec.ravel(), tvec=None if self.position is None else tvec.ravel())

    def check(self, frame_size: tuple[int, int]) -> None:
        """Raise a BrokenFileError if the intrinsics cannot be those of frames of a size."""
        if self.intrinsics is None:
            return
        (width, height), own = frame_size, self.intrinsics.image_size
        if own is None:
            cx, cy = self.intrinsics.camera_matrix[:2, 2]
            if abs(cx / width - 0.5) > OFF_MIDDLE or abs(cy / height - 0.5) > OFF_MIDDLE:
                raise BrokenFileError(
                    f"has {width} x {height} pixels, but the principal point of --intrinsics is ({cx:.0f}, {cy:.0f}): "
                    "they are of images of another size; write image_width and image_height into that file"
                )
        elif abs(width * own[1] / (height * own[0]) - 1.0) > SAME_SHAPE:
            raise BrokenFileError(
                f"has {width} x {height} pixels, and --intrinsics is of images of {own[0]} x {own[1]}: of another "
                "shape, so they are no scaled copies; see --display-size and --crop-of"
            )

    @property
    def is_aspect_estimated(self) -> bool:
        """Whether nothing is declared that says how pixels are shown."""
        return self.aspect == ESTIMATED and not self._are_placed

    @property
    def may_be_enlarged(self) -> bool:
        """Whether pictures may be enlarged parts of frames: not if they are placed in one, or resized."""
        return isinstance(self.aspect, str) and not self._are_placed

    @property
    def _are_placed(self) -> bool:
        """Whether it is declared where they lie in frames, how large they are shown, or what their camera is."""
        return self.display_size is not None or self.crop_of is not None or self.intrinsics is not None

    @property
    def declared(self) -> Declared:
        """Whether the frame, its pixels or nothing is declared."""
        if self.crop_of is not None:
            return Declared.FRAME
        return Declared.NOTHING if self.is_aspect_estimated else Declared.PIXELS

    def placement(self, size: tuple[int, int]) -> Placement:
        """Placement of pictures of a size in their frames.

        Raises
        ------
        BrokenFileError
            If they cannot be a part of the frame, or are wide and said to be shown upright.
        """
        shown = Placement.whole(size) if isinstance(self.aspect, str) else Placement.shown_as(size, self.aspect)
        display_size, part = self.display_size or shown.display_size, self.crop_of
        if self.display_size is not None and size[0] > size[1] and display_size[0] < display_size[1]:
            raise BrokenFileError(
                f"is wide, {size[0]}x{size[1]}, and --display-size upright, {display_size[0]}x{display_size[1]}: "
                f"it is width x height (--aspect says that upright pictures were stretched)"
            )
        return placed(size, display_size, part)
