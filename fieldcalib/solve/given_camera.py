"""Values of the camera that the user gives, and results that keep known values to the last bit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib.assess.result import Calibration
from fieldcalib.geometry.camera import Camera
from fieldcalib.solve.options import WHOLE_LENS, CalibrationFlags, checked_flags

_F = CalibrationFlags


class GivenCamera(NamedTuple):
    """Values of a camera in OpenCV's terms; flags say which of them are known and which are initial."""

    camera_matrix: ArrayLike | None = None
    dist_coeffs: ArrayLike | None = None
    rvec: ArrayLike | None = None
    tvec: ArrayLike | None = None

    @property
    def is_empty(self) -> bool:
        """Whether nothing is given."""
        return all(value is None for value in self)

    def camera(self, image_size: tuple[int, int]) -> Camera:
        """A camera with the given values, and arbitrary ones for the others."""
        nothing = np.zeros(3)
        rvec, tvec = (nothing if vector is None else vector for vector in (self.rvec, self.tvec))
        K = np.eye(3) if self.camera_matrix is None else self.camera_matrix
        return Camera.from_opencv(rvec, tvec, K, self.dist_coeffs, image_size)


NOTHING_GIVEN = GivenCamera()


def check_of_clip(flags: int) -> None:
    """Raise a ValueError if the flags fix the rotation of a clip's camera, which differs from frame to frame."""
    if checked_flags(flags) & (_F.CALIB_FIX_ROTATION | _F.CALIB_USE_EXTRINSIC_GUESS):
        raise ValueError(
            "a rotation is of one frame, and the camera of a clip turns: CALIB_FIX_ROTATION and "
            "CALIB_USE_EXTRINSIC_GUESS are of single images (calibrate_from_images, fieldcalib run --independent)"
        )


def as_fixed(found: list[Calibration], given: GivenCamera | Sequence[Camera], flags: int) -> list[Calibration]:
    """Calibrations whose cameras have exactly the given values that the flags fix.

    The solver's parameters are logarithms and angles: conversion to them and back changes the last bits. `given` is for
    all calibrations, or a camera for each.
    """
    if not flags & (_F.CALIB_FIX_FOCAL_LENGTH | _F.CALIB_FIX_POSITION | _F.CALIB_FIX_ROTATION):
        return found
    fixed = []
    for t, one in enumerate(found):
        if one.camera is not None:
            like = given.camera(one.camera.image_size) if isinstance(given, GivenCamera) else given[t]
            camera, *others = (_as_fixed(camera, like, flags) for camera in (one.camera, *one.alternatives))
            one = replace(one, camera=camera, alternatives=tuple(others))
        fixed.append(one)
    return fixed


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
