"""Known parameters of the camera: --intrinsics, --position, --rotation."""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import numpy as np

from fieldcalib._types import Array
from fieldcalib.console.arguments import LENSES, Default, told_by
from fieldcalib.console.options import option
from fieldcalib.geometry.camera import Camera
from fieldcalib.geometry.rotation import rotation_from_angles
from fieldcalib.io.files import BrokenFileError
from fieldcalib.io.intrinsics import Intrinsics, read_intrinsics
from fieldcalib.solve.options import KNOWN_INTRINSICS_FLAGS, CalibrationFlags
from fieldcalib.solve.task import NOTHING_GIVEN, GivenCamera

SAME_SHAPE = 0.005  # relative difference of two aspect ratios: sizes are whole numbers
OFF_MIDDLE = 0.25  # share of width and height: a principal point farther off is of images of another size


def _intrinsics(text: str) -> Intrinsics:
    found = read_intrinsics(text)
    try:
        Camera(found.camera_matrix, np.eye(3), np.zeros(3), found.image_size or (1, 1), found.dist_coeffs)
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
    """Parameters of the camera that the user knows."""

    lens: str
    """Name of what is estimated of the lens, see `LENSES`."""
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

    @property
    def is_any(self) -> bool:
        """Whether any parameter is known."""
        return any(part is not None for part in (self.intrinsics, self.position, self.rotation))

    @property
    def flags(self) -> CalibrationFlags:
        """Flags of what is known and what is estimated."""
        F = CalibrationFlags
        flags = KNOWN_INTRINSICS_FLAGS if self.intrinsics is not None else LENSES[self.lens]
        if self.position is not None:
            flags |= F.CALIB_FIX_POSITION
        if self.rotation is not None:
            flags |= F.CALIB_FIX_ROTATION
        return flags

    def given(self, frame_size: tuple[int, int]) -> GivenCamera:
        """The known values, for frames of a size.

        Raises
        ------
        BrokenFileError
            If the intrinsics cannot be those of such frames.
        """
        if not self.is_any:
            return NOTHING_GIVEN
        K, dist = (None, None) if self.intrinsics is None else _of_size(self.intrinsics, frame_size)
        if self.rotation is None and self.position is None:
            return GivenCamera(K, dist, None, None)
        R = np.eye(3) if self.rotation is None else rotation_from_angles(np.radians(self.rotation))
        rvec, tvec, *_ = Camera(np.eye(3), R, self.position or np.zeros(3), (1, 1)).to_opencv()
        return GivenCamera(K, dist, rvec.ravel(), None if self.position is None else tvec.ravel())


def _of_size(intrinsics: Intrinsics, size: tuple[int, int]) -> tuple[Array, Array]:
    """Camera matrix and coefficients for frames of a size."""
    width, height = size
    if not width:  # there is no frame
        return intrinsics.camera_matrix, intrinsics.dist_coeffs
    own = intrinsics.image_size
    if own is None:
        cx, cy = intrinsics.camera_matrix[:2, 2]
        if abs(cx / width - 0.5) > OFF_MIDDLE or abs(cy / height - 0.5) > OFF_MIDDLE:
            raise BrokenFileError(
                f"has {width} x {height} pixels, but the principal point of --intrinsics is ({cx:.0f}, {cy:.0f}): "
                "they are of images of another size; write image_width and image_height into that file"
            )
        own = size
    if abs(width * own[1] / (height * own[0]) - 1.0) > SAME_SHAPE:
        raise BrokenFileError(
            f"has {width} x {height} pixels, and --intrinsics is of images of {own[0]} x {own[1]}: of another shape, "
            "so they are no scaled copies; see --display-size and --crop-of"
        )
    camera = Camera(intrinsics.camera_matrix, np.eye(3), np.zeros(3), own, intrinsics.dist_coeffs)
    return (camera if own == size else camera.scaled(size)).K, camera.dist[0]
