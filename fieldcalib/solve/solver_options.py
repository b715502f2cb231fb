"""Flags and priors that users choose from, and the options of the solver, which `fieldcalib.solve.request` derives.

`CalibrationFlags` have the names and values of cv2's flags where these exist; `criteria` is cv2's (type, max_count,
eps).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from enum import IntFlag
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np

from fieldcalib._types import Array, BoolArray
from fieldcalib.fields.field import Field
from fieldcalib.fields.segments import ObjectSegments
from fieldcalib.fields.sides import Side
from fieldcalib.fields.stands import DISTRIBUTIONS, SOCCER_SCALE, CameraDistribution, stand_above
from fieldcalib.fields.traits import LineLook
from fieldcalib.problem.evaluation import Problem
from fieldcalib.problem.layout import CENTER, POSE_AND_ZOOM, Layout
from fieldcalib.problem.losses import RobustLoss
from fieldcalib.problem.observations import Observations
from fieldcalib.problem.prior import GaussianPrior, gaussian_priors

Prior: TypeAlias = str | CameraDistribution | Iterable[str | CameraDistribution] | None
Criteria: TypeAlias = tuple[int, int, float]

ALL = "all"
CERTAIN = float(np.log(20.0))  # log odds from which on evidence counts as certain: right in 19 of 20 cases
PAINT = 0.25  # of the width of a painted line: standard deviation of its position
APPROACH_TOLERANCE = 3e-2  # relative decrease of the cost at which the stages before the last end
COUNT, EPS = 1, 2  # cv2.TERM_CRITERIA_COUNT and _EPS
DEFAULT_CRITERIA: Criteria = (COUNT + EPS, 50, 1e-6)

# Lengths in pixels are for an image of this size and scale with the image's diagonal, so that a frame and its enlarged
# copy have the same camera.
REFERENCE_SIZE = (960, 540)
NOISE = 1.0  # px: standard deviation of pixels that annotators and networks label
WIDE_SCALE = 20.0  # px: far from the solution a narrow loss has no gradient
# AC@5 / @10 on SoccerNet's annotations are 84.9 / 94.2 with 3 px, 85.6 / 94.5 with 6, 85.6 / 94.3 with 12.
NARROW_SCALE = 6.0


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


F = CalibrationFlags

# Blocks of the layout that each flag keeps at their known values.
BLOCKS_OF_FLAGS: Mapping[CalibrationFlags, tuple[str, ...]] = {
    F.CALIB_FIX_ASPECT_RATIO: ("aspect",),
    F.CALIB_FIX_PRINCIPAL_POINT: ("principal point",),
    F.CALIB_FIX_FOCAL_LENGTH: ("focal length",),
    F.CALIB_FIX_K1: ("k1",),
    F.CALIB_FIX_K2: ("k2",),
    F.CALIB_FIX_K3: ("k3", "k4"),
    F.CALIB_FIX_TANGENT_DIST: ("p1", "p2"),
    F.CALIB_FIX_POSITION: ("centre",),
    F.CALIB_FIX_ROLL: ("roll",),
    F.CALIB_FIX_ROTATION: ("angles",),
}
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


@dataclass(frozen=True, eq=False)
class Options:
    """Options of the solver for frames of one size."""

    object_segments: ObjectSegments
    """The calibration object."""
    flags: CalibrationFlags
    known: Array
    """Parameters (n,) that the user gave or that have a default; NaN for unknown ones."""
    layout: Layout
    """Blocks of theta, and which of its parameters are estimated."""
    distributions: tuple[CameraDistribution, ...]
    use_prior: bool
    loss: RobustLoss
    max_iterations: int
    tolerance: float
    """Relative decrease of the cost at which the last stage ends."""
    tau: float | None = None
    paint: float = 0.0
    """Standard deviation, in metres, of the position of a painted line as a whole."""
    trust_labels: bool = False
    """Whether every label is taken as right."""
    considered: Array | None = None
    """Covariance of the parameters that the layout considers; None for that of the prior of the field's size."""
    side: Side | None = None
    """As `Task.side`."""

    @property
    def field(self) -> Field | None:
        """The calibration object if it is a `Field`."""
        return self.object_segments if isinstance(self.object_segments, Field) else None

    @property
    def image_size(self) -> tuple[int, int]:
        """Width and height in pixels."""
        return self.layout.image_size

    @property
    def auto_lens(self) -> bool:
        """Whether further lens coefficients are freed where the labels require them."""
        return bool(self.flags & F.CALIB_AUTO_LENS)

    @property
    def motion(self) -> Array | None:
        """Motion of the segments with the size of the field (`Field.motion`); None if the size is known."""
        return self.field.motion if self.field is not None and self.layout.is_sized else None

    @cached_property
    def stands(self) -> GaussianPrior:
        """Means and sigmas (K, n) of the distributions."""
        return gaussian_priors(self.distributions, self.layout)

    @property
    def left_to_labels(self) -> BoolArray:
        """Mask (P,) of the free parameters that the labels must determine, since no prior is narrow enough."""
        free = np.flatnonzero(self.layout.free)
        known_enough = self.use_prior & (free >= POSE_AND_ZOOM.stop)  # principal point, aspect and lens
        return np.asarray(~known_enough)

    @property
    def unknowns(self) -> int:
        """Number of parameters that the labels must determine."""
        return int(np.sum(self.left_to_labels))

    @property
    def from_above(self) -> Options | None:
        """The options for cameras that look down on the field; None unless they may stand anywhere around it."""
        field, names = self.field, {stand.name for stand in self.distributions}
        if field is None or not field.stands or not names >= {stand.name for stand in field.stands}:
            return None
        above = stand_above(field.length, field.width, max(one.principal_point for one in self.distributions))
        return replace(self, distributions=(above,), max_iterations=4 * self.max_iterations)

    @property
    def may_be_inside(self) -> bool:
        """Whether the camera may stand on the field: by the user's position or stands, or if only points are known."""
        if self.field is None or not self.field.markings or not np.isnan(self.known[CENTER]).any():
            return True
        half = self.field.length / 2.0, self.field.width / 2.0
        return any(abs(np.mean(d.x)) < half[0] and abs(np.mean(d.y)) < half[1] for d in self.distributions)

    @property
    def scale(self) -> float:
        """Size of the part of the object that is usually in view, metres."""
        return SOCCER_SCALE if self.field is None else self.field.scale

    @property
    def wide_loss(self) -> RobustLoss:
        """The loss of the first stage."""
        return RobustLoss("cauchy", WIDE_SCALE * pixel_unit(self.image_size))

    @property
    def approach_tolerance(self) -> float:
        """Tolerance of the stages before the last."""
        return max(self.tolerance, APPROACH_TOLERANCE)

    @property
    def noise(self) -> float:
        """Standard deviation of the observed pixels."""
        return NOISE * pixel_unit(self.image_size)

    def problem(self, observations: Observations, prior: GaussianPrior | None) -> Problem:
        """The problem of frames with these observations, each under a prior (B, n) if it is not None."""
        problem = Problem(observations, self.layout, self.loss, self.noise, prior, scale=self.scale)
        return replace(problem, paint=self.paint, considered=self.considered)


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
            if field is None or not field.stands:
                why = "the object is not a Field" if field is None else "the field has no stands"
                raise ValueError(
                    f"{why}: say where its camera may stand by prior, a CameraDistribution or the name of one, or None "
                    f"with rvec and tvec as a start"
                )
            found.extend(field.stands)
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
