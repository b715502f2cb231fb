"""What the labels of a solved frame say of its picture: whole, or a part of a frame whose camera would be wrong.

The hypotheses, their prior and their likelihood are those of `fieldcalib.problem.picture_shape`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fieldcalib._types import Array, BoolArray
from fieldcalib.assess.findings import CUT, SHAPE, Finding
from fieldcalib.assess.probability import ground_in_view
from fieldcalib.assess.uncertainty import Uncertainty
from fieldcalib.fields.field import Field
from fieldcalib.geometry.camera import Camera
from fieldcalib.problem.labelled_pixels import PixelTable
from fieldcalib.problem.layout import PRINCIPAL_POINT, ROLL
from fieldcalib.problem.picture_shape import (
    LARGEST_SPREAD,
    PART_SCALE,
    SQUASHED_LOG_ODDS,
    SURE,
    Declared,
    Placement,
    PrincipalPoint,
    frame_around,
    has_square_pixels,
    is_whole_shape,
    log_ratio_of_cut,
    score_of_part,
)

FAINT = 1e-6  # information, in units of the prior's, that keeps the system regular


@dataclass(frozen=True, eq=False)
class Picture:
    """A picture that may be a part of a frame."""

    camera: Camera
    """The camera in the pixels of the picture."""
    field: Field
    probability: float
    """Probability that the camera is right to the field's tolerance, if the field has the given size."""
    declared: Declared
    are_annotated: bool
    """Whether a person labelled it, following markings to its border."""
    sure: float = SURE
    """Probability from which on a camera of an odd shape needs no further evidence of that shape."""

    def log_ratio_of_part(self, solved: Camera, labels: PixelTable) -> float:
        """Log odds of a part from what was done to the picture, and from the ends of labels set by hand.

        `solved` is the camera in pixels of its frame, as the labels are.
        """
        log_ratio = SQUASHED_LOG_ODDS * Placement.of_cameras(self.camera, solved).is_squashed
        return log_ratio + (log_ratio_of_cut(self.field, labels.by_label(0), solved) if self.are_annotated else 0.0)


def principal_point_of(uncertainty: Uncertainty) -> PrincipalPoint | None:
    """The principal point of a frame as its labels determine it; None if it was not free under a prior of whole frames.

    Examples
    --------
    >>> from fieldcalib import Camera, calibrate_from_segments, soccer
    >>> truth = Camera.from_angles(0.2, 1.35, 0.0, 1400.0, (1.0, 65.0, -16.0), (960, 540))
    >>> labels = ("Side line top", "Side line right", "Big rect. right main", "Big rect. right top", "Circle right")
    >>> pixels = {label: truth.project(soccer()[label].sample(4.0)) for label in labels}
    >>> found = principal_point_of(calibrate_from_segments(soccer(), pixels, (960, 540)).uncertainty)
    >>> found.log_ratio_of_part < 0.0
    True
    """
    freed, frame = _freed(uncertainty, FAINT), frame_around(uncertainty.layout.image_size)
    if freed is None or np.min(uncertainty.unit[PRINCIPAL_POINT]) > LARGEST_SPREAD * frame[0]:
        return None
    own, z, shift, covariance = freed
    return PrincipalPoint((z + shift)[own], covariance[np.ix_(own, own)])


def largest_error_of_part(uncertainty: Uncertainty) -> float:
    """Largest root mean square error of the ground points in view if the picture is a part of a frame, metres.

    It is computed to first order from the camera of the labels without the narrow prior of whole frames.

    Examples
    --------
    >>> from fieldcalib import Camera, calibrate_from_segments, soccer
    >>> truth = Camera.from_angles(0.2, 1.35, 0.0, 1400.0, (1.0, 65.0, -16.0), (960, 540))
    >>> labels = ("Side line top", "Side line right", "Big rect. right main", "Big rect. right top", "Circle right")
    >>> pixels = {label: truth.project(soccer()[label].sample(4.0)) for label in labels}
    >>> uncertainty = calibrate_from_segments(soccer(), pixels, (960, 540)).uncertainty.on(soccer())
    >>> 0.5 < largest_error_of_part(uncertainty) < 5.0
    True
    """
    freed = _freed(uncertainty, 1.0 / PART_SCALE**2)
    if freed is None or uncertainty.field is None:
        return float("nan")
    _, _, shift, covariance = freed
    dX_dtheta, known = uncertainty.ground_jacobian(ground_in_view(uncertainty.camera, uncertainty.field))
    if not np.any(known):
        return float("nan")
    free = np.flatnonzero(uncertainty.problem.free)
    J = (dX_dtheta[known] - uncertainty.motion_of_markings)[..., free] * uncertainty.unit[free]
    squares = np.sum(np.square(J @ shift), axis=-1) + np.einsum("nij,jk,nik->n", J, covariance, J)
    return float(np.sqrt(np.max(squares)))


def _freed(uncertainty: Uncertainty, precision: float) -> tuple[BoolArray, Array, Array, Array] | None:
    """The estimate if the precision of the principal point's prior is multiplied by `precision`; None if it is fixed.

    Returned are a mask of the principal point among the free parameters and, in units of their prior, their z-scores,
    the shift of the estimate, and its covariance.
    """
    problem = uncertainty.problem
    free = np.flatnonzero(problem.free)
    own = (free >= PRINCIPAL_POINT.start) & (free < PRINCIPAL_POINT.stop)
    if problem.prior is None or np.count_nonzero(own) != 2:
        return None
    unit = uncertainty.unit[free]
    determined = uncertainty.determined[np.ix_(free, free)] / (unit[:, None] * unit)
    A = uncertainty.curvature * uncertainty.information.matrix[0] + np.eye(len(free))
    z = problem.prior_residuals(uncertainty.evaluation.theta)[0]
    less = own * (1.0 - precision)
    inverse = np.linalg.inv(A - np.diag(less))
    return own, z, inverse @ (less * z), inverse @ (A @ determined @ A - np.diag(less)) @ inverse.T


def score(uncertainty: Uncertainty, found: PrincipalPoint, probability: float) -> float:
    """Score of a picture with the shape of a frame (`score_of_part`), for a camera that is right with a probability."""
    roll = float(uncertainty.theta[ROLL]), float(uncertainty.covariance[ROLL, ROLL])
    error = 1.0 if uncertainty.field is None else largest_error_of_part(uncertainty) / uncertainty.field.tolerance
    return score_of_part(probability, found.log_ratio_of_part, roll, float(np.nan_to_num(error, nan=1.0)))


def seems_part(
    uncertainty: Uncertainty,
    probability: float,
    log_ratio_of_part: float = 0.0,
    declared: Declared = Declared.NOTHING,
    sure: float = SURE,
) -> tuple[Finding, ...]:
    """Evidence that a picture may be a part of a frame whose camera would then be wrong; empty without any.

    Parameters
    ----------
    uncertainty : Uncertainty
    probability : float
        Probability that the camera is right to the field's tolerance, for a field of the given size.
    log_ratio_of_part : float
        Further log odds of a part, from the ends of labels (`Picture.log_ratio_of_part`).
    declared : Declared
        Statement of the user about the picture.
    sure : float
        See `Picture`.
    """
    found = None if declared == Declared.FRAME else principal_point_of(uncertainty)
    if found is None:
        return ()
    size = uncertainty.layout.image_size
    if is_whole_shape(size):
        return (CUT,) if score(uncertainty, found, probability) + log_ratio_of_part > 0.0 else ()
    is_known = declared != Declared.NOTHING or "log aspect" not in uncertainty.offsets
    is_square = is_known or has_square_pixels(size, uncertainty.offsets["log aspect"])
    if is_square and probability >= sure:
        return ()
    return (SHAPE if declared == Declared.NOTHING else CUT,)
