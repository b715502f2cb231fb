"""The common arguments of all methods of calibration (`Task`), checked and translated for the solver (`Options`).

Values of the camera that the user gives, and results that keep known values to the last bit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from numbers import Real
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib._types import Array, BoolArray, is_number, truth
from fieldcalib.assess.result import Calibration
from fieldcalib.fields.field import Field, ObjectSegments, Side
from fieldcalib.fields.traits import SOCCER_SCALE, CameraDistribution, stand_above, stands_around
from fieldcalib.geometry.camera import Camera, checked_image_size
from fieldcalib.geometry.lens import FisheyeLens, Lens, lens_with
from fieldcalib.geometry.lens.model import nonzero_coefficients
from fieldcalib.problem.evaluation import Problem
from fieldcalib.problem.labelled_pixels import check_object
from fieldcalib.problem.layout import (
    ANGLES,
    CENTER,
    LOG_ASPECT,
    LOG_F,
    POSE_AND_ZOOM,
    PRINCIPAL_POINT,
    ROLL,
    GaussianPrior,
    Layout,
    Role,
    SizeBlock,
    gaussian_priors,
)
from fieldcalib.problem.losses import LossName, RobustLoss
from fieldcalib.problem.observations import Observations
from fieldcalib.solve.solver_options import (
    ALL,
    COUNT,
    DEFAULT_CRITERIA,
    EPS,
    WHOLE_LENS,
    WIDE_SCALE,
    CalibrationFlags,
    Criteria,
    Prior,
    checked_flags,
    checked_prior,
    default_flags,
    pixel_unit,
)

F = CalibrationFlags
APPROACH_TOLERANCE = 3e-2  # relative decrease of the cost at which the stages before the last end
NOISE = 1.0  # px: standard deviation of pixels that annotators and networks label
# AC@5 / @10 on SoccerNet's annotations are 84.9 / 94.2 with 3 px, 85.6 / 94.5 with 6, 85.6 / 94.3 with 12.
NARROW_SCALE = 6.0
MOST_PAINT = 1000.0  # m

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


class GivenCamera(NamedTuple):
    """Values of a camera in OpenCV's terms; flags say which of them are known and which are initial."""

    camera_matrix: ArrayLike | None = None
    dist_coeffs: ArrayLike | None = None
    rvec: ArrayLike | None = None
    tvec: ArrayLike | None = None
    image_size: tuple[int, int] | None = None
    """Size of the images of `camera_matrix`, if it is given for scaled copies of the calibrated ones."""

    @property
    def is_empty(self) -> bool:
        """Whether nothing is given."""
        return all(value is None for value in self)

    def of_size(self, image_size: tuple[int, int]) -> GivenCamera:
        """Scale the camera matrix to images of a size."""
        if self.camera_matrix is None or self.image_size in (None, image_size):
            return self
        camera = GivenCamera(self.camera_matrix).camera(self.image_size or image_size).scaled(image_size)
        return self._replace(camera_matrix=camera.K, image_size=image_size)

    def camera(self, image_size: tuple[int, int], fisheye: bool = False) -> Camera:
        """A camera with the given values, and arbitrary ones for the others."""
        nothing = np.zeros(3)
        rvec, tvec = (nothing if vector is None else vector for vector in (self.rvec, self.tvec))
        K = np.eye(3) if self.camera_matrix is None else self.camera_matrix
        return Camera.from_opencv(rvec, tvec, K, self.dist_coeffs, image_size, fisheye)


NOTHING_GIVEN = GivenCamera()


def check_of_clip(flags: int) -> None:
    """Raise a ValueError if the flags fix the rotation of a clip's camera, which differs from frame to frame."""
    if checked_flags(flags) & (F.CALIB_FIX_ROTATION | F.CALIB_USE_EXTRINSIC_GUESS):
        raise ValueError(
            "a rotation is of one frame, and the camera of a clip turns: CALIB_FIX_ROTATION and "
            "CALIB_USE_EXTRINSIC_GUESS are of single images (calibrate_from_images, fieldcalib run --independent)"
        )


def as_fixed(found: list[Calibration], given: GivenCamera | Sequence[Camera], flags: int) -> list[Calibration]:
    """Calibrations whose cameras have exactly the given values that the flags fix.

    The solver's parameters are logarithms and angles: conversion to them and back changes the last bits. `given` is for
    all calibrations, or a camera for each.
    """
    if not flags & (F.CALIB_FIX_FOCAL_LENGTH | F.CALIB_FIX_POSITION | F.CALIB_FIX_ROTATION):
        return found
    fixed = []
    for t, one in enumerate(found):
        if one.camera is not None:
            size, fisheye = one.camera.image_size, bool(flags & F.CALIB_FISHEYE)
            like = given.of_size(size).camera(size, fisheye) if isinstance(given, GivenCamera) else given[t]
            camera, *others = (_as_fixed(camera, like, flags) for camera in (one.camera, *one.alternatives))
            one = replace(one, camera=camera, alternatives=tuple(others))
        fixed.append(one)
    return fixed


def _as_fixed(camera: Camera, given: Camera, flags: int) -> Camera:
    K, of_lens = camera.K.copy(), camera
    if flags & F.CALIB_FIX_FOCAL_LENGTH:
        K[0, 0] = given.K[0, 0]
        if flags & F.CALIB_FIX_ASPECT_RATIO:
            K[1, 1] = given.K[1, 1]
        if flags & WHOLE_LENS == WHOLE_LENS:
            of_lens = given
    R = given.R if flags & F.CALIB_FIX_ROTATION else camera.R
    C = given.C if flags & F.CALIB_FIX_POSITION else camera.C
    return Camera(K, R, C, camera.image_size, of_lens.dist, fisheye=of_lens.fisheye)


@dataclass(frozen=True, eq=False)
class Task:
    """The arguments of `calibrate_from_segments` that do not depend on the frame, as given by the user."""

    object_segments: ObjectSegments
    given: GivenCamera = NOTHING_GIVEN
    flags: int | None = None
    criteria: Criteria = DEFAULT_CRITERIA
    prior: Prior = ALL
    loss: LossName | RobustLoss = "cauchy"
    tau: float | None = None
    paint: float = 0.0
    trust_labels: bool = False
    finds_mislabels: bool = True
    """Whether mislabelled segments are searched for, unless labels are trusted."""
    side: Side | None = None
    """Side of the field on which cameras are whose labels do not tell it; None where a person names the ends."""

    def __post_init__(self) -> None:
        check_object(self.object_segments)
        truth(self.trust_labels, "trust_labels")
        if self.flags is not None:
            checked_flags(self.flags)

    @property
    def field(self) -> Field | None:
        """The calibration object if it is a `Field`."""
        return self.object_segments if isinstance(self.object_segments, Field) else None

    @property
    def chosen_flags(self) -> CalibrationFlags:
        """The flags, checked; the default ones if none are given."""
        return checked_flags(default_flags(self.prior) if self.flags is None else self.flags)

    def with_flags(self, flags: CalibrationFlags) -> Task:
        """Add flags to those of the task."""
        return replace(self, flags=self.chosen_flags | flags)

    def options(self, image_size: tuple[int, int], start: Camera | None = None) -> Options:
        """The options for frames of one size; a ValueError names arguments that do not fit together.

        Without a prior, initial cameras come from the stands of the field or, if it has none, from all sides. An
        initial camera `start` takes the place of given values.
        """
        image_size = checked_image_size(image_size)
        flags, given = self.chosen_flags, self.given.of_size(image_size)
        if start is not None and start.fisheye:
            flags = flags & ~F.CALIB_AUTO_LENS | F.CALIB_FISHEYE
        dist_coeffs = given.dist_coeffs if start is None else start.dist
        # size and crown of the field are parameters where they are unknown and have a prior
        sized = None if self.prior is None else self.field
        layout = _layout(image_size, _lens(image_size, dist_coeffs, flags), flags, sized)
        if not np.any(layout.free[POSE_AND_ZOOM]):
            raise ValueError(
                "the flags leave nothing to estimate: focal length, position and rotation are all fixed; leave out one "
                "of CALIB_FIX_FOCAL_LENGTH, CALIB_FIX_POSITION and CALIB_FIX_ROTATION"
            )
        if start is None:
            _check_given(given, flags)
        max_iterations, tolerance = _checked_criteria(self.criteria)
        distributions = self._distributions
        frame_size, corner = distributions[0].frame or (image_size, (0, 0))
        middle = np.divide(frame_size, 2.0) - corner
        known = _known_parameters(layout, given, flags, middle) if start is None else layout.theta(start)
        if self.tau is not None and not (isinstance(self.tau, Real) and self.tau > 0.0):
            raise ValueError(f"tau must be a positive loss in NDC (the paper's is 0.019) or None, got {self.tau}")
        if not (isinstance(self.paint, Real) and 0.0 <= self.paint <= MOST_PAINT):
            raise ValueError(f"paint must be a standard deviation in metres, 0 to {MOST_PAINT:g}, got {self.paint}")
        loss = self.loss
        return Options(
            self,
            flags,
            known,
            layout,
            distributions,
            loss if isinstance(loss, RobustLoss) else RobustLoss(loss, NARROW_SCALE * pixel_unit(image_size)),
            max_iterations,
            tolerance,
        )

    @property
    def _distributions(self) -> tuple[CameraDistribution, ...]:
        if self.prior is not None:
            return checked_prior(self.prior, self.field)
        if self.field is None:
            return stands_around(SOCCER_SCALE)
        return self.field.stands or stands_around(self.field.scale)


@dataclass(frozen=True, eq=False)
class Options:
    """A task, checked for frames of one size and translated into options of the solver."""

    task: Task
    flags: CalibrationFlags
    """Those of the task; a fisheye lens that was tried or given has its own."""
    known: Array
    """Parameters (n,) that the user gave or that have a default; NaN for unknown ones."""
    layout: Layout
    """Blocks of theta, and which of its parameters are estimated."""
    distributions: tuple[CameraDistribution, ...]
    loss: RobustLoss
    max_iterations: int
    tolerance: float
    """Relative decrease of the cost at which the last stage ends."""
    considered: Array | None = None
    """Covariance of the parameters that the layout considers; None for that of the prior of the field's size."""

    @property
    def object_segments(self) -> ObjectSegments:
        """The calibration object."""
        return self.task.object_segments

    @property
    def field(self) -> Field | None:
        """The calibration object if it is a `Field`."""
        return self.task.field

    @property
    def use_prior(self) -> bool:
        """Whether cameras have a prior beside their labels."""
        return self.task.prior is not None

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
        return _stands(self.distributions, self.layout)

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
        return replace(problem, paint=self.task.paint, considered=self.considered)


def _checked_criteria(criteria: Criteria) -> tuple[int, float]:
    """Number of iterations, and relative decrease of the cost at which they end."""
    try:
        kind, max_count, eps = criteria
        if not all(map(is_number, (kind, max_count, eps))) or kind != int(kind):
            raise ValueError
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"criteria must be cv2's (type, max_count, eps), got {criteria!r}") from None
    if not (0 < kind <= COUNT + EPS) or (kind & COUNT and max_count < 1) or (kind & EPS and not eps > 0.0):
        raise ValueError(
            f"criteria must be (type, max_count, eps) with type TERM_CRITERIA_COUNT (1), _EPS (2) or their sum, "
            f"max_count >= 1 and eps > 0, got {criteria!r}"
        )
    # without a count the number of iterations is bounded too, without an eps they end at rounding
    return (int(max_count) if kind & COUNT else 1000), (max(float(eps), 1e-15) if kind & EPS else 1e-15)


def _check_given(given: GivenCamera, flags: CalibrationFlags) -> None:
    """Raise a ValueError if flags and given values of the camera do not fit together."""
    wants_intrinsics = bool(flags & (F.CALIB_USE_INTRINSIC_GUESS | F.CALIB_FIX_FOCAL_LENGTH))
    if wants_intrinsics != (given.camera_matrix is not None):
        raise ValueError(
            "camera_matrix and the flags CALIB_USE_INTRINSIC_GUESS or CALIB_FIX_FOCAL_LENGTH go together: "
            + ("camera_matrix is missing" if wants_intrinsics else "without one of them camera_matrix would be ignored")
        )
    if given.dist_coeffs is not None and given.camera_matrix is None:
        raise ValueError("dist_coeffs belong to a focal length: give camera_matrix with them")
    wants_position = bool(flags & (F.CALIB_USE_EXTRINSIC_GUESS | F.CALIB_FIX_POSITION))
    wants_rotation = bool(flags & (F.CALIB_USE_EXTRINSIC_GUESS | F.CALIB_FIX_ROTATION))
    is_given = given.rvec is not None, given.tvec is not None
    if is_given != (wants_position or wants_rotation, wants_position):
        problem = {
            (False, False): "rvec and tvec are missing" if wants_position else "rvec is missing",
            (True, True): "without a flag they would be ignored" if not wants_rotation else "tvec would be ignored",
        }
        raise ValueError(
            "rvec, tvec and the flags CALIB_USE_EXTRINSIC_GUESS or CALIB_FIX_POSITION go together, as do rvec alone "
            f"and CALIB_FIX_ROTATION: {problem.get(is_given, 'give both rvec and tvec')}"
        )


def _known_parameters(layout: Layout, given: GivenCamera, flags: CalibrationFlags, middle: Array) -> Array:
    """Parameters (n,) that were given or that have a default; NaN for unknown ones."""
    known = np.full(layout.size, np.nan)
    known[PRINCIPAL_POINT] = middle
    known[layout.lens_block] = known[LOG_ASPECT] = 0.0
    if layout.field_size is not None:
        known[layout.field_size_block] = layout.field_size.given
        known[layout.crown_block] = layout.field_size.height
    if flags & F.CALIB_FIX_ROLL:
        known[ROLL] = 0.0
    if given.camera_matrix is None and given.rvec is None:
        return known
    theta = layout.theta(given.camera(layout.image_size, isinstance(layout.lens, FisheyeLens)))
    if given.camera_matrix is not None:
        known[LOG_F], known[LOG_ASPECT] = theta[LOG_F], theta[LOG_ASPECT]
        known[PRINCIPAL_POINT], known[layout.lens_block] = theta[PRINCIPAL_POINT], theta[layout.lens_block]
    if given.rvec is not None:
        if flags & (F.CALIB_USE_EXTRINSIC_GUESS | F.CALIB_FIX_ROTATION):
            known[ANGLES] = theta[ANGLES]
        elif flags & F.CALIB_FIX_ROLL:
            known[ROLL] = theta[ROLL]
        if given.tvec is not None:
            known[CENTER] = theta[CENTER]
    return known


_stands = lru_cache(maxsize=64)(gaussian_priors)


@lru_cache(maxsize=64)  # the same for all pictures of a size
def _layout(image_size: tuple[int, int], lens: Lens, flags: CalibrationFlags, field: Field | None) -> Layout:
    """The layout, with roles by the flags.

    An unknown size of the field is considered: it is kept, and its uncertainty enters that of the camera.
    """
    layout = Layout.of(image_size, lens, None if field is None else SizeBlock.of(field))
    if layout.is_sized:
        layout = layout.with_roles(Role.CONSIDERED, "field size")
    return layout.fixed(*(block for block in _known_blocks(flags) if block in layout.blocks))


def _lens(image_size: tuple[int, int], dist_coeffs: ArrayLike | None, flags: CalibrationFlags) -> Lens:
    """The smallest lens that has all known and estimated coefficients."""
    rho = float(np.hypot(*image_size) / 2.0)
    if flags & F.CALIB_FISHEYE:
        return FisheyeLens(rho)
    estimated = {"k1", "k2", "k3", "p1", "p2"} - _known_blocks(flags)
    return lens_with({"k1", *estimated, *nonzero_coefficients(dist_coeffs)}, rho)


@lru_cache(maxsize=64)
def _known_blocks(flags: CalibrationFlags) -> frozenset[str]:
    """Blocks that flags keep at their known values."""
    return frozenset(block for flag, blocks in BLOCKS_OF_FLAGS.items() if flags & flag for block in blocks)
