"""Flags, criteria and priors that users choose from, and the scales of the solver.

`CalibrationFlags` have the names and values of cv2's flags where these exist; `criteria` is cv2's (type, max_count,
eps).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from enum import IntFlag
from typing import Any, TypeAlias

import numpy as np

from fieldcalib.fields.field import Field, ObjectSegments
from fieldcalib.fields.traits import DISTRIBUTIONS, CameraDistribution, LineLook, stands_anywhere

Prior: TypeAlias = str | CameraDistribution | Iterable[str | CameraDistribution] | None
Criteria: TypeAlias = tuple[int, int, float]

ALL = "all"
CERTAIN = float(np.log(20.0))  # log odds from which on evidence counts as certain: right in 19 of 20 cases
PAINT = 0.25  # of the width of a painted line: standard deviation of its position
COUNT, EPS = 1, 2  # cv2.TERM_CRITERIA_COUNT and _EPS
DEFAULT_CRITERIA: Criteria = (COUNT + EPS, 50, 1e-6)

# Lengths in pixels are for an image of this size and scale with the image's diagonal, so that a frame and its enlarged
# copy have the same camera.
REFERENCE_SIZE = (960, 540)
WIDE_SCALE = 20.0  # px: far from the solution a narrow loss has no gradient


def paint_sigma(object_segments: ObjectSegments) -> float:
    """Standard deviation of the position of a painted line, metres: a quarter of the width of the field's lines.

    Of an object that is no `Field` it is that of a soccer pitch.

    Examples
    --------
    >>> from fieldcalib import soccer
    >>> from fieldcalib.fields import badminton
    >>> paint_sigma(soccer()), paint_sigma(badminton())
    (0.03, 0.01)
    """
    return PAINT * (object_segments.lines if isinstance(object_segments, Field) else LineLook()).width


class CalibrationFlags(IntFlag):
    """Flags that say which parameters are known and which are estimated.

    As in cv2, flags replace the default: without `CALIB_FIX_ASPECT_RATIO`, for example, the aspect ratio is estimated,
    under its prior. By default the aspect ratio and all lens coefficients but k1 are fixed. (cv2 has one flag for both
    tangential coefficients; k4 and beyond are never estimated here.)
    """

    CALIB_USE_INTRINSIC_GUESS = 1
    """Start from the focal length of `camera_matrix`, and take principal point, aspect ratio and lens from there."""
    CALIB_FIX_ASPECT_RATIO = 2
    """Keep fy / fx: 1, or that of `camera_matrix`."""
    CALIB_FIX_PRINCIPAL_POINT = 4
    """Keep the principal point: the image's centre (w / 2, h / 2), or that of `camera_matrix`."""
    CALIB_FIX_FOCAL_LENGTH = 16
    """Keep the focal length of `camera_matrix`."""
    CALIB_FIX_K1 = 32
    """Keep k1: 0, or that of `dist_coeffs`, scaled with the focal length so that the distortion stays the same."""
    CALIB_FIX_K2 = 64
    """Keep k2 likewise; a barrel lens keeps the k2 that prevents folding (`fieldcalib.geometry.lens`)."""
    CALIB_FIX_K3 = 128
    """Keep k3 likewise; of a fisheye lens k4 too."""
    CALIB_FIX_TANGENT_DIST = 1 << 21
    """Keep the tangential coefficients likewise."""
    CALIB_USE_EXTRINSIC_GUESS = 1 << 22
    """Start from `rvec` and `tvec`."""
    CALIB_FIX_POSITION = 1 << 28
    """Keep the camera centre ``-R^T t`` of `rvec` and `tvec`, as of a tripod that was measured. The rotation is
    estimated; `rvec` is its initial value only with CALIB_USE_EXTRINSIC_GUESS. If only the centre C is known, give
    rvec = 0 and tvec = -C."""
    CALIB_FIX_ROLL = 1 << 29
    """Keep the roll of `rvec`, or 0."""
    CALIB_AUTO_LENS = 1 << 30
    """Estimate the lens coefficients that the labels require: k2, then k3 and the tangential coefficients, are freed if
    that makes the labels much more likely; where labels still lie beside their markings, a fisheye lens is tried. The
    message says so."""
    CALIB_FISHEYE = 1 << 26
    """The lens is that of cv2.fisheye, and `dist_coeffs` are its k1, k2, k3, k4."""
    CALIB_FIX_ROTATION = 1 << 27
    """Keep the rotation of `rvec`, as of a tripod head that measures it."""

    def __repr__(self) -> str:
        return " | ".join(str(flag.name) for flag in self) or "0"


F = CalibrationFlags

WHOLE_LENS = F.CALIB_FIX_K1 | F.CALIB_FIX_K2 | F.CALIB_FIX_K3 | F.CALIB_FIX_TANGENT_DIST
DEFAULT_FLAGS = (WHOLE_LENS & ~F.CALIB_FIX_K1) | F.CALIB_FIX_ASPECT_RATIO
# f is the only intrinsic parameter that is estimated
PINHOLE_FLAGS = DEFAULT_FLAGS | F.CALIB_FIX_K1 | F.CALIB_FIX_PRINCIPAL_POINT
KNOWN_INTRINSICS_FLAGS = PINHOLE_FLAGS | F.CALIB_FIX_FOCAL_LENGTH  # K and dist are known
GUESS = F.CALIB_USE_INTRINSIC_GUESS | F.CALIB_USE_EXTRINSIC_GUESS
FISHEYE_FLAGS = (DEFAULT_FLAGS & ~WHOLE_LENS) | F.CALIB_FISHEYE  # all of cv2.fisheye's lens is estimated

LENS_FLAGS: Mapping[str, CalibrationFlags] = {
    "none": DEFAULT_FLAGS | F.CALIB_FIX_K1,
    "k1": DEFAULT_FLAGS,
    "k1k2": DEFAULT_FLAGS & ~F.CALIB_FIX_K2,
    "opencv": DEFAULT_FLAGS & ~(WHOLE_LENS & ~F.CALIB_FIX_K1),
    "fisheye": FISHEYE_FLAGS,
    "auto": DEFAULT_FLAGS | F.CALIB_AUTO_LENS,
}
"""Flags by the name of what is estimated of the lens: nothing, k1, k1 and k2, OpenCV's five, cv2.fisheye's four, or as
much as is required."""


def pixel_unit(image_size: tuple[int, int]) -> float:
    """Pixels of an image of this size for one pixel of the reference size."""
    return float(np.hypot(*image_size) / np.hypot(*REFERENCE_SIZE))


def checked_flags(flags: int) -> CalibrationFlags:
    """Flags that are supported, or a ValueError that says which are."""
    if not isinstance(flags, int | np.integer) or isinstance(flags, bool):
        raise ValueError(
            f"flags must be a combination of CalibrationFlags, as CALIB_FIX_K1 | CALIB_FIX_K2, got {flags!r}"
        )
    flags, supported = int(flags), sum(CalibrationFlags)
    if flags & ~supported:
        raise ValueError(
            f"flags {flags & ~supported:#x} are not supported: expected a combination of "
            f"{', '.join(str(flag.name) for flag in CalibrationFlags)}"
        )
    if flags & F.CALIB_AUTO_LENS and flags & F.CALIB_FIX_K1:
        raise ValueError("CALIB_FIX_K1 and CALIB_AUTO_LENS contradict each other: one keeps the lens, one estimates it")
    if flags & F.CALIB_AUTO_LENS and flags & F.CALIB_FISHEYE:
        raise ValueError("CALIB_FISHEYE and CALIB_AUTO_LENS contradict each other: one says which lens it is")
    return CalibrationFlags(flags)


def default_flags(prior: Prior) -> CalibrationFlags:
    """The default flags: the principal point is estimated only under a prior."""
    return DEFAULT_FLAGS if prior is not None else DEFAULT_FLAGS | F.CALIB_FIX_PRINCIPAL_POINT


def checked_prior(
    prior: str | CameraDistribution | Iterable[str | CameraDistribution], field: Field | None = None
) -> tuple[CameraDistribution, ...]:
    """Camera distributions, given as one or several names or distributions; a ValueError lists the known names.

    "all" means all stands of the field; for an object without stands it raises the error.
    """
    named = DISTRIBUTIONS if field is None else field.named_stands
    is_one = isinstance(prior, str) or not isinstance(prior, Iterable) or getattr(prior, "ndim", 1) == 0
    members: tuple[Any, ...] = (prior,) if is_one else tuple(prior)  # type: ignore[arg-type]
    found: list[CameraDistribution] = []
    for member in members:
        if isinstance(member, CameraDistribution):
            found.append(member)
        elif isinstance(member, str) and member == ALL:
            if field is None:
                raise ValueError(
                    "the object is not a Field: make it one, Field(length, width, segments), or say where its camera "
                    "stands by prior, a CameraDistribution; None leaves it open, and may need rvec and tvec as a start"
                )
            found.extend(field.stands or stands_anywhere(field.scale))
        elif isinstance(member, str) and member in named:
            found.append(named[member])
        else:
            raise ValueError(
                f"unknown camera distribution {member!r}: expected 'all', {', '.join(map(repr, named))}, a "
                f"CameraDistribution of your own, or None for no prior"
            )
    if not found:
        raise ValueError("prior names no camera distribution; None solves without a prior")
    return tuple(found)
