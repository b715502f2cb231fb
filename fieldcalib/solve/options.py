"""What the user may ask for, in OpenCV's terms, and its translation for the solver.

`CalibrationFlags` share name and value with cv2's where cv2 has them; `criteria` is cv2's (type, max_count, eps).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import IntFlag
from functools import cached_property
from numbers import Real
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib._types import Array, BoolArray
from fieldcalib.fields.field import Field
from fieldcalib.fields.stands import DISTRIBUTIONS, SOCCER_SCALE, CameraDistribution, stands_around
from fieldcalib.geometry.camera import Camera, checked_image_size
from fieldcalib.geometry.lens import lens_with
from fieldcalib.geometry.lens.opencv import COEFFICIENTS, nonzero_coefficients, opencv_vector
from fieldcalib.problem.layout import (
    ANGLES,
    CENTER,
    LOG_ASPECT,
    LOG_F,
    POSE_AND_ZOOM,
    PRINCIPAL_POINT,
    ROLL,
    Layout,
    Role,
    SizeBlock,
)
from fieldcalib.problem.losses import LossName, RobustLoss
from fieldcalib.problem.prior import GaussianPrior, gaussian_priors

Prior: TypeAlias = str | CameraDistribution | Iterable[str | CameraDistribution] | None
Criteria: TypeAlias = tuple[int, int, float]

ALL = "all"
CERTAIN = float(np.log(20.0))  # log odds of what is said of a frame: of 20 such statements 19 shall be right
PAINT = 0.03  # m: by how much a line is painted elsewhere, a quarter of its width
APPROACH_TOLERANCE = 3e-2  # share of the cost
COUNT, EPS = 1, 2  # cv2.TERM_CRITERIA_COUNT and _EPS
DEFAULT_CRITERIA: Criteria = (COUNT + EPS, 50, 1e-6)

# Pixels are those of an image of this size; other images scale them with the diagonal, so that a frame and its enlarged
# copy have the same camera.
REFERENCE_SIZE = (960, 540)
NOISE = 1.0  # px: what annotators and networks miss a line by
WIDE_SCALE = 20.0  # px: from a far start a narrow loss has no gradient
# AC@5 / @10 on SoccerNet's annotations are 84.9 / 94.2 with 3 px, 85.6 / 94.5 with 6, 85.6 / 94.3 with 12.
NARROW_SCALE = 6.0


class CalibrationFlags(IntFlag):
    """What is known and what is estimated.

    As in cv2, flags replace the default: without `CALIB_FIX_ASPECT_RATIO`, say, the aspect ratio is estimated, under
    its prior. By default the aspect ratio and all of the lens but k1 are fixed. (cv2 has one flag for every tangential
    coefficient, and none that fixes k1 of its rational model alone; of k4 and beyond nothing is estimated here.)
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
    """Keep what the first radial coefficient does to the image: nothing, or as `dist_coeffs` at `camera_matrix`."""
    CALIB_FIX_K2 = 64
    """Keep what the second radial coefficient does to the image: nothing, up to what keeps a barrel from folding back
    (`fieldcalib.geometry.lens`), or as `dist_coeffs` at `camera_matrix`."""
    CALIB_FIX_K3 = 128
    """Keep what the third radial coefficient does to the image: nothing, or as `dist_coeffs` at `camera_matrix`."""
    CALIB_FIX_TANGENT_DIST = 1 << 21
    """Keep what the tangential coefficients do to the image: nothing, or as `dist_coeffs` at `camera_matrix`."""
    CALIB_USE_EXTRINSIC_GUESS = 1 << 22
    """Start from `rvec` and `tvec`."""
    CALIB_FIX_POSITION = 1 << 28
    """Keep the camera centre ``-R^T t`` of `rvec` and `tvec`: a tripod that was measured. The rotation is found, from
    `rvec` only with CALIB_USE_EXTRINSIC_GUESS; where just the centre C is known, let `rvec` be 0 and `tvec` be -C."""
    CALIB_FIX_ROLL = 1 << 29
    """Keep the roll of `rvec`, or 0."""
    CALIB_AUTO_LENS = 1 << 30
    """Estimate as much of the lens as the labels call for: k2, then k3 and the tangential coefficients, are freed where
    that makes the labels much more likely; the message says so."""
    CALIB_FIX_ROTATION = 1 << 27
    """Keep the rotation of `rvec`: a head that says where it points."""


# What each flag keeps as it is known, as blocks of the layout.
BLOCKS_OF_FLAGS: Mapping[CalibrationFlags, tuple[str, ...]] = {
    CalibrationFlags.CALIB_FIX_ASPECT_RATIO: ("aspect",),
    CalibrationFlags.CALIB_FIX_PRINCIPAL_POINT: ("principal point",),
    CalibrationFlags.CALIB_FIX_FOCAL_LENGTH: ("focal length",),
    CalibrationFlags.CALIB_FIX_K1: ("k1",),
    CalibrationFlags.CALIB_FIX_K2: ("k2",),
    CalibrationFlags.CALIB_FIX_K3: ("k3",),
    CalibrationFlags.CALIB_FIX_TANGENT_DIST: ("p1", "p2"),
    CalibrationFlags.CALIB_FIX_POSITION: ("centre",),
    CalibrationFlags.CALIB_FIX_ROLL: ("roll",),
    CalibrationFlags.CALIB_FIX_ROTATION: ("angles",),
}
DEFAULT_FLAGS = (
    CalibrationFlags.CALIB_FIX_ASPECT_RATIO
    | CalibrationFlags.CALIB_FIX_K2
    | CalibrationFlags.CALIB_FIX_K3
    | CalibrationFlags.CALIB_FIX_TANGENT_DIST
)
PINHOLE_FLAGS = (
    DEFAULT_FLAGS | CalibrationFlags.CALIB_FIX_K1 | CalibrationFlags.CALIB_FIX_PRINCIPAL_POINT
)  # K has f alone
KNOWN_INTRINSICS_FLAGS = PINHOLE_FLAGS | CalibrationFlags.CALIB_FIX_FOCAL_LENGTH  # all that K and dist say
WHOLE_LENS = (
    CalibrationFlags.CALIB_FIX_K1
    | CalibrationFlags.CALIB_FIX_K2
    | CalibrationFlags.CALIB_FIX_K3
    | CalibrationFlags.CALIB_FIX_TANGENT_DIST
)


@dataclass(frozen=True)
class Options:
    """The arguments of `calibrate_from_segments`, checked and translated."""

    image_size: tuple[int, int]
    known: Array
    """(n,) parameters that the user gave or that have a default; NaN where nothing is known."""
    layout: Layout
    """Of theta, and which of its parameters are estimated."""
    distributions: tuple[CameraDistribution, ...]
    use_prior: bool
    loss: RobustLoss
    max_iterations: int
    tolerance: float
    tau: float | None
    field: Field | None = None
    """What is calibrated against; None if that is no `Field`."""
    paint: float = 0.0
    """Standard deviation, in metres, of where a line is painted as a whole."""
    considered: Array | None = None
    """Covariance of the parameters that the layout considers, where these are not the size of the field alone."""
    auto_lens: bool = False
    """Whether more of the lens is freed where the labels call for it."""

    @cached_property
    def stands(self) -> GaussianPrior:
        """Means and sigmas (K, n) of the distributions."""
        return gaussian_priors(self.distributions, self.layout)

    @property
    def is_camera(self) -> BoolArray:
        """Which free parameters (P,) the labels must determine: those that no prior is good enough for."""
        free = np.flatnonzero(self.layout.free)
        known_enough = self.use_prior & (free >= POSE_AND_ZOOM.stop)  # principal point, aspect and lens
        return np.asarray(~known_enough)

    @property
    def unknowns(self) -> int:
        """How many these are."""
        return int(np.sum(self.is_camera))

    @property
    def may_be_inside(self) -> bool:
        """Whether the camera may stand on the field: the user says so, or only points of the field are known.

        Users say so by the camera's position, or by where it may be.
        """
        if self.field is None or not self.field.markings or not np.isnan(self.known[CENTER]).any():
            return True
        half = self.field.length / 2.0, self.field.width / 2.0
        return any(abs(np.mean(d.x)) < half[0] and abs(np.mean(d.y)) < half[1] for d in self.distributions)

    @property
    def scale(self) -> float:
        """Size of what is usually in view, metres."""
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


def pixel_unit(image_size: tuple[int, int]) -> float:
    """Pixels of an image of this size for one pixel of the reference size."""
    return float(np.hypot(*image_size) / np.hypot(*REFERENCE_SIZE))


def checked_options(
    image_size: tuple[int, int],
    camera_matrix: ArrayLike | None,
    dist_coeffs: ArrayLike | None,
    rvec: ArrayLike | None,
    tvec: ArrayLike | None,
    *,
    flags: int | None,
    criteria: Criteria,
    prior: Prior,
    loss: LossName | RobustLoss,
    tau: float | None,
    field: Field | None = None,
    paint: float = 0.0,
) -> Options:
    """Check the arguments against each other and translate them; a ValueError says what does not fit.

    Without a prior, initial cameras come from the stands of the field, or from all sides where it knows none.
    """
    image_size = checked_image_size(image_size)
    flags = _checked_flags(default_flags(prior) if flags is None else flags)
    layout = _layout(image_size, dist_coeffs, flags, field, has_prior=prior is not None)
    if not np.any(layout.free[POSE_AND_ZOOM]):
        raise ValueError(
            "the flags leave nothing to estimate: focal length, position and rotation are all fixed; leave out one of "
            "CALIB_FIX_FOCAL_LENGTH, CALIB_FIX_POSITION and CALIB_FIX_ROTATION"
        )
    known = _known_parameters(layout, camera_matrix, dist_coeffs, rvec, tvec, flags)
    max_iterations, tolerance = _checked_criteria(criteria)
    if prior is not None:
        distributions = checked_prior(prior, field)
    elif field is None:
        distributions = stands_around(SOCCER_SCALE)
    else:
        distributions = field.stands or stands_around(field.scale)
    if tau is not None and not (isinstance(tau, Real) and tau > 0.0):
        raise ValueError(f"tau must be a positive loss in NDC (the paper's is 0.019) or None, got {tau}")
    if not (isinstance(paint, Real) and 0.0 <= paint < np.inf):
        raise ValueError(f"paint must be a standard deviation in metres, not negative, got {paint}")
    if not isinstance(loss, RobustLoss):
        loss = RobustLoss(loss, NARROW_SCALE * pixel_unit(image_size))
    return Options(
        image_size,
        known,
        layout,
        distributions,
        prior is not None,
        loss,
        max_iterations,
        tolerance,
        tau,
        field,
        paint=paint,
        auto_lens=bool(flags & CalibrationFlags.CALIB_AUTO_LENS),
    )


def default_flags(prior: Prior) -> CalibrationFlags:
    """The flags where the user says nothing: the principal point is free under its prior only."""
    return DEFAULT_FLAGS if prior is not None else DEFAULT_FLAGS | CalibrationFlags.CALIB_FIX_PRINCIPAL_POINT


def checked_prior(
    prior: str | CameraDistribution | Iterable[str | CameraDistribution], field: Field | None = None
) -> tuple[CameraDistribution, ...]:
    """Camera distributions by name or by themselves, one or several; ValueError names the known ones.

    "all" are the stands of the field: for an object without any, those of another would be nonsense.
    """
    named = DISTRIBUTIONS if field is None else field.named_stands
    members = tuple(prior) if isinstance(prior, Iterable) and not isinstance(prior, str) else (prior,)
    found: list[CameraDistribution] = []
    for member in members:
        if isinstance(member, CameraDistribution):
            found.append(member)
        elif member == ALL:
            if field is None or not field.stands:
                why = "the object is not a Field" if field is None else "the field has no stands"
                raise ValueError(
                    f"{why}: say where its camera may stand by prior, a CameraDistribution or the name of one, or None "
                    f"with rvec and tvec as a start"
                )
            found.extend(field.stands)
        elif member in named:
            found.append(named[member])
        else:
            raise ValueError(
                f"unknown camera distribution {member!r}: expected 'all', {', '.join(map(repr, named))}, a "
                f"CameraDistribution of your own, or None for no prior"
            )
    if not found:
        raise ValueError("prior names no camera distribution; None solves without a prior")
    return tuple(found)


def _checked_flags(flags: int) -> CalibrationFlags:
    supported = sum(CalibrationFlags)
    if flags & ~supported:
        raise ValueError(
            f"flags {flags & ~supported:#x} are not supported: expected a combination of "
            f"{', '.join(str(flag.name) for flag in CalibrationFlags)}"
        )
    if flags & CalibrationFlags.CALIB_AUTO_LENS and flags & CalibrationFlags.CALIB_FIX_K1:
        raise ValueError("CALIB_FIX_K1 and CALIB_AUTO_LENS contradict each other: one keeps the lens, one estimates it")
    return CalibrationFlags(flags)


def _checked_criteria(criteria: Criteria) -> tuple[int, float]:
    try:
        kind, max_count, eps = criteria
    except (TypeError, ValueError):
        raise ValueError(f"criteria must be cv2's (type, max_count, eps), got {criteria!r}") from None
    if not (0 < kind <= COUNT + EPS) or (kind & COUNT and max_count < 1) or (kind & EPS and not eps > 0.0):
        raise ValueError(
            f"criteria must be (type, max_count, eps) with type TERM_CRITERIA_COUNT (1), _EPS (2) or their sum, "
            f"max_count >= 1 and eps > 0, got {criteria!r}"
        )
    # without a count the iterations are bounded all the same, without an eps only rounding ends them
    return (int(max_count) if kind & COUNT else 1000), (max(float(eps), 1e-15) if kind & EPS else 1e-15)


def _known_parameters(
    layout: Layout,
    camera_matrix: ArrayLike | None,
    dist_coeffs: ArrayLike | None,
    rvec: ArrayLike | None,
    tvec: ArrayLike | None,
    flags: CalibrationFlags,
) -> Array:
    F = CalibrationFlags
    wants_intrinsics = bool(flags & (F.CALIB_USE_INTRINSIC_GUESS | F.CALIB_FIX_FOCAL_LENGTH))
    wants_position = bool(flags & (F.CALIB_USE_EXTRINSIC_GUESS | F.CALIB_FIX_POSITION))
    wants_rotation = bool(flags & (F.CALIB_USE_EXTRINSIC_GUESS | F.CALIB_FIX_ROTATION))
    if wants_intrinsics != (camera_matrix is not None):
        raise ValueError(
            "camera_matrix and the flags CALIB_USE_INTRINSIC_GUESS or CALIB_FIX_FOCAL_LENGTH go together: "
            + ("camera_matrix is missing" if wants_intrinsics else "without one of them camera_matrix would be ignored")
        )
    if dist_coeffs is not None and camera_matrix is None:
        raise ValueError("dist_coeffs belong to a focal length: give camera_matrix with them")
    is_given = rvec is not None, tvec is not None
    if is_given != (wants_position or wants_rotation, wants_position):
        problem = {
            (False, False): "rvec and tvec are missing" if wants_position else "rvec is missing",
            (True, True): "without a flag they would be ignored" if not wants_rotation else "tvec would be ignored",
        }
        raise ValueError(
            "rvec, tvec and the flags CALIB_USE_EXTRINSIC_GUESS or CALIB_FIX_POSITION go together, as do rvec alone "
            f"and CALIB_FIX_ROTATION: {problem.get(is_given, 'give both rvec and tvec')}"
        )
    image_size = layout.image_size
    known = np.full(layout.size, np.nan)
    known[PRINCIPAL_POINT] = np.array(image_size) / 2.0
    known[layout.lens_block] = known[LOG_ASPECT] = 0.0
    if layout.field_size is not None:
        known[layout.field_size_block] = layout.field_size.given
        known[layout.crown_block] = 0.0
    if flags & F.CALIB_FIX_ROLL:
        known[ROLL] = 0.0
    if camera_matrix is not None:
        theta = layout.theta(Camera(camera_matrix, np.eye(3), np.zeros(3), image_size, opencv_vector(dist_coeffs)))
        for block in (slice(LOG_F, LOG_F + 1), PRINCIPAL_POINT, slice(LOG_ASPECT, LOG_ASPECT + 1), layout.lens_block):
            known[block] = theta[block]
    if rvec is not None:
        pose = Camera.from_opencv(rvec, np.zeros(3) if tvec is None else tvec, np.eye(3), None, image_size)
        theta = layout.theta(pose)
        if wants_rotation:
            known[ANGLES] = theta[ANGLES]
        elif flags & F.CALIB_FIX_ROLL:
            known[ROLL] = theta[ROLL]
        if wants_position:
            known[CENTER] = theta[CENTER]
    return known


def _layout(
    image_size: tuple[int, int],
    dist_coeffs: ArrayLike | None,
    flags: CalibrationFlags,
    field: Field | None,
    *,
    has_prior: bool,
) -> Layout:
    """The blocks of theta: the smallest lens that has what is known and what is estimated, and the roles by the flags.

    The size of a field that is not known is considered: kept, with its uncertainty in that of the camera.
    """
    rho = float(np.hypot(*image_size) / 2.0)
    freed = {block for flag, blocks in BLOCKS_OF_FLAGS.items() if not flags & flag for block in blocks}
    lens = lens_with({"k1", *(freed & {*COEFFICIENTS}), *nonzero_coefficients(dist_coeffs)}, rho)
    size = None
    model = None if field is None or not field.moves_with_size else field.size_model
    if field is not None and model is not None and has_prior and not field.size_known:
        size = SizeBlock(
            np.array([field.length, field.width]), model.sigma, model.limits, model.possibilities, model.crown
        )
    layout = Layout.of(image_size, lens, size).with_roles(Role.CONSIDERED, "field size")
    known = [block for flag, blocks in BLOCKS_OF_FLAGS.items() if flags & flag for block in blocks]
    return layout.fixed(*(block for block in known if block in layout.blocks))
