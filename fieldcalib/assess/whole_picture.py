"""Is a picture a whole frame, or a part of one? What the labels say of the principal point, and when that is a doubt.

A whole frame has its principal point near the middle, a part of one anywhere. The labels of a frame put it, to first
order, at an offset delta from the middle with a covariance V, with everything else free as it is. With S the covariance
of a whole frame's and 100 S that of a part's (ten times as far from the middle), the log likelihood ratio of a part is
that of delta under normal distributions of covariance V + 100 S and V + S.

Few labels tell the principal point. That a picture is a part of a frame also shows in a camera that seems rolled, as
heads of tripods are level, and it matters where the camera is wrong then: a camera that hardly depends on the principal
point is right wherever it is. The score of `seems_part` is linear in these, and in the log odds that the camera of a
whole frame is right.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from fieldcalib._types import Array, BoolArray
from fieldcalib.assess.probability import ground_in_view
from fieldcalib.assess.uncertainty import Uncertainty
from fieldcalib.fields.field import Field
from fieldcalib.geometry.camera import Camera
from fieldcalib.problem.layout import PRINCIPAL_POINT, ROLL
from fieldcalib.problem.prior import BROADCAST_SHAPE, frame_around, is_whole_shape

FAINT = 1e-6  # information, in units of the prior's, that keeps what no label tells in the system
PART_SCALE = 10.0  # times as far from the middle as in whole frames: a fifth of the width
LEVEL = np.radians(0.5)  # of annotated broadcast frames 95 % are rolled by less than 0.7 degrees
LARGEST_ROLL_SCORE = 4.0  # squared z-score: more says no more,
LARGEST_ROLL = np.radians(2.5)  # and a larger roll comes from no part of a frame, but from a head that was not level
LARGEST_LOG_RATIO = 8.0
ERRORS_OF_PART = 0.05, 2.0  # of the field's tolerance: less is right in any case, more is wrong in any case
# A picture that has not the shape of a frame needs this probability of being right. Of halves and upright parts of
# annotated frames 1 to 2 % are good and wrong then, 6 to 7 % with the 0.5 of whole pictures.
SURE = 0.92
# Fitted to 667 annotated frames as they are and to corners of them that would be good and wrong: 2 % of the former and
# 59 % of the latter have a positive score. To find 90 % of these without the ends of their labels would cost 16 % of
# the frames: where the labels fit a wrong camera as well as the right one, nothing else tells it.
SCORE = (-0.5, -0.5, 0.55, 1.2, 1.95)
SQUASHED_LOG_ODDS = -2.0  # of a part: what was squashed from 16:9 was a whole frame, few pictures are changed twice
LARGEST_SPREAD = 0.05  # share of the width: cameras of which more is expected show no whole frames
SQUASH_SIGMAS = 3.0  # that the pixels of a squashed picture are off, by what the labels tell
CUT = "the picture may be a part of a frame, whose middle the labels do not tell: say which part (--crop-of)"
SHAPE = "the picture is not 16:9, and the labels do not tell whether it was squashed (--aspect) or cut out (--crop-of)"


class Declared(StrEnum):
    """What a user has said of a picture, so that it is not asked."""

    NOTHING = "nothing"
    PIXELS = "pixels"
    """How its pixels are shown."""
    FRAME = "frame"
    """Which part of a frame it is, if not all of it, and how its pixels are shown."""


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


@dataclass(frozen=True, eq=False)
class PrincipalPointEvidence:
    """What the labels of a frame say about its principal point, in standard deviations of that of whole frames."""

    offset: Array
    """(2,) from the middle of the picture."""
    covariance: Array
    """Covariance of the offset, (2, 2)."""

    @property
    def log_ratio_of_part(self) -> float:
        """Log likelihood of a part of a frame less that of a whole one."""
        log = []
        for scale in (PART_SCALE, 1.0):
            total = self.covariance + scale**2 * np.eye(2)
            log.append(-0.5 * (self.offset @ np.linalg.solve(total, self.offset) + np.linalg.slogdet(total)[1]))
        return float(log[0] - log[1])

    @classmethod
    def of(cls, uncertainty: Uncertainty) -> PrincipalPointEvidence | None:
        """The evidence of a frame whose principal point was free under its prior; None of others.

        Examples
        --------
        >>> from fieldcalib import Camera, calibrate_from_segments, soccer
        >>> truth = Camera.from_angles(0.2, 1.35, 0.0, 1400.0, (1.0, 65.0, -16.0), (960, 540))
        >>> labels = ("Side line top", "Side line right", "Big rect. right main", "Big rect. right top", "Circle right")
        >>> pixels = {label: truth.project(soccer()[label].sample(4.0)) for label in labels}
        >>> evidence = PrincipalPointEvidence.of(calibrate_from_segments(soccer(), pixels, (960, 540)).uncertainty)
        >>> evidence.log_ratio_of_part < 0.0
        True
        """
        freed = _freed(uncertainty, FAINT)
        if freed is None:
            return None
        own, z, shift, covariance = freed
        return cls((z + shift)[own], covariance[np.ix_(own, own)])


def largest_error_of_part(uncertainty: Uncertainty) -> float:
    """Expected (root mean square) error of the worst ground point in view if the picture is a part of a frame, metres.

    The camera is then off by what the labels say of it without the narrow prior of whole frames, to first order.

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
    """What changes if the prior of the principal point has another precision, in units of its own; None if it is fixed.

    It is a mask of the principal point among the free parameters and, in units of their prior, their z-scores, the
    shift of the estimate, and its covariance.
    """
    problem = uncertainty.problem
    free = np.flatnonzero(problem.free)
    own = np.isin(free, np.arange(PRINCIPAL_POINT.start, PRINCIPAL_POINT.stop))
    if problem.prior is None or np.count_nonzero(own) != 2:
        return None
    unit = uncertainty.unit[free]
    determined = uncertainty.determined[np.ix_(free, free)] / (unit[:, None] * unit)
    A = uncertainty.curvature * uncertainty.information.matrix[0] + np.eye(len(free))
    z = problem.prior_residuals(uncertainty.evaluation.theta)[0]
    less = own * (1.0 - precision)
    inverse = np.linalg.inv(A - np.diag(less))
    return own, z, inverse @ (less * z), inverse @ (A @ determined @ A - np.diag(less)) @ inverse.T


def seems_part(
    uncertainty: Uncertainty,
    probability: float,
    log_ratio_of_cut: float = 0.0,
    declared: Declared = Declared.NOTHING,
) -> tuple[str, ...]:
    """In words, that a picture may be a part of a frame, if its camera would be wrong then; nothing of others.

    Parameters
    ----------
    uncertainty : Uncertainty
    probability : float
        That the camera is right to the field's tolerance, for a field of the given size.
    log_ratio_of_cut : float
        What the ends of labels say (`fieldcalib.assess.cut_labels`).
    declared : Declared
        What the user has said.
    """
    if declared == Declared.FRAME:
        return ()
    width, height = uncertainty.layout.image_size
    frame = frame_around((width, height))
    evidence = PrincipalPointEvidence.of(uncertainty)
    own_spread = uncertainty.unit[PRINCIPAL_POINT.start : PRINCIPAL_POINT.stop]
    if evidence is None or np.min(own_spread) > LARGEST_SPREAD * frame[0]:
        return ()
    if not is_whole_shape((width, height)):
        is_square = declared == Declared.PIXELS
        if probability >= SURE and (is_square or _tells_aspect(uncertainty)):
            return ()
        return (CUT if is_square else SHAPE,)
    return (CUT,) if score(uncertainty, evidence, probability) + log_ratio_of_cut > 0.0 else ()


def _tells_aspect(uncertainty: Uncertainty) -> bool:
    """Whether the labels say that pixels are square, and not as they are if a frame of 16:9 was squashed to this shape.

    What was estimated or given is known.
    """
    if "log aspect" not in uncertainty.offsets:
        return True
    width, height = uncertainty.layout.image_size
    squash = np.log(BROADCAST_SHAPE * height / width)  # log aspect of the picture if it was
    offset, sigma = uncertainty.offsets["log aspect"]
    return bool(abs(offset) < abs(offset - squash) and SQUASH_SIGMAS * sigma < abs(squash))


def features(uncertainty: Uncertainty, evidence: PrincipalPointEvidence, probability: float) -> Array:
    """What the score is linear in.

    It is 1, the log odds of being right, the log ratio of a part, the square of the roll's z-score, and the log of the
    error that is expected of a part, in units of the field's tolerance.
    """
    p = np.clip(probability, 1e-3, 1.0 - 1e-3)
    roll = np.square(uncertainty.theta[ROLL]) / (LEVEL**2 + uncertainty.covariance[ROLL, ROLL])
    roll *= abs(uncertainty.theta[ROLL]) <= LARGEST_ROLL
    ratio = np.clip(evidence.log_ratio_of_part, -LARGEST_LOG_RATIO, LARGEST_LOG_RATIO)
    error = 1.0 if uncertainty.field is None else largest_error_of_part(uncertainty) / uncertainty.field.tolerance
    error = np.clip(np.nan_to_num(error, nan=1.0), *ERRORS_OF_PART)
    return np.array([1.0, np.log(p / (1.0 - p)), ratio, min(roll, LARGEST_ROLL_SCORE), np.log(error)])


def score(uncertainty: Uncertainty, evidence: PrincipalPointEvidence, probability: float) -> float:
    """Positive where a picture is doubted to be a whole frame."""
    return float(np.array(SCORE) @ features(uncertainty, evidence, probability))
