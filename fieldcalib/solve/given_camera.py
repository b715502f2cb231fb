"""What is known of a camera before it is calibrated, and a result that keeps it to the last bit."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib.assess.result import Calibration
from fieldcalib.geometry.camera import Camera
from fieldcalib.solve.options import WHOLE_LENS, CalibrationFlags

_F = CalibrationFlags


class GivenCamera(NamedTuple):
    """What the user says of a camera, in OpenCV's terms; the flags say what of it is known and what is a start."""

    camera_matrix: ArrayLike | None = None
    dist_coeffs: ArrayLike | None = None
    rvec: ArrayLike | None = None
    tvec: ArrayLike | None = None

    def camera(self, image_size: tuple[int, int]) -> Camera:
        """A camera with the values that are given, and some others."""
        nothing = np.zeros(3)
        rvec, tvec = (nothing if vector is None else vector for vector in (self.rvec, self.tvec))
        K = np.eye(3) if self.camera_matrix is None else self.camera_matrix
        return Camera.from_opencv(rvec, tvec, K, self.dist_coeffs, image_size)


NOTHING_GIVEN = GivenCamera()


def check_of_clip(flags: int) -> None:
    """A ValueError if the flags say of all frames of a clip what is true of one only."""
    if flags & (_F.CALIB_FIX_ROTATION | _F.CALIB_USE_EXTRINSIC_GUESS):
        raise ValueError(
            "a rotation is of one frame, and the camera of a clip turns: CALIB_FIX_ROTATION and "
            "CALIB_USE_EXTRINSIC_GUESS are of single images (calibrate_from_images, fieldcalib run --independent)"
        )


def as_fixed(calibration: Calibration, given: Camera, flags: int) -> Calibration:
    """A calibration whose camera has the values that the flags fix exactly as in a given camera.

    A solver's parameters are logarithms and angles: the way there and back changes the last bits.
    """
    if calibration.camera is None or not flags & (
        _F.CALIB_FIX_FOCAL_LENGTH | _F.CALIB_FIX_POSITION | _F.CALIB_FIX_ROTATION
    ):
        return calibration
    others = tuple(_as_fixed(camera, given, flags) for camera in calibration.alternatives)
    return replace(calibration, camera=_as_fixed(calibration.camera, given, flags), alternatives=others)


def _as_fixed(camera: Camera, given: Camera, flags: int) -> Camera:
    K, dist = camera.K.copy(), camera.dist
    if flags & _F.CALIB_FIX_FOCAL_LENGTH:
        K[0, 0] = given.K[0, 0]
        if flags & _F.CALIB_FIX_ASPECT_RATIO:
            K[1, 1] = given.K[1, 1]
        if flags & WHOLE_LENS == WHOLE_LENS:
            dist = given.dist
    R = given.R if flags & _F.CALIB_FIX_ROTATION else camera.R
    C = given.C if flags & _F.CALIB_FIX_POSITION else camera.C
    return Camera(K, R, C, camera.image_size, dist)
