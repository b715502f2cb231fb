"""Pictures that may be parts of frames: the evidence for it, and whether their cameras would be wrong.

A whole frame has its principal point near the middle, a part of one anywhere. To first order the labels put it at an
offset delta from the middle with a covariance V. If its prior has the covariance S for whole frames and 100 S for parts
(ten times as far from the middle), the log likelihood ratio of a part compares delta under normal distributions of
covariance V + 100 S and V + S.

The labels of few frames determine the principal point. A roll of the camera is further evidence for a part, as heads of
tripods are level. And a part matters only if its camera is wrong: one that hardly depends on the principal point is
right in any case. The score of `seems_part` is linear in these terms, and in the log odds that the camera is right if
the picture is a whole frame.

Labels that end before the border of their picture are evidence that it was cut out of a larger one with its labels.
Annotators follow a marking to the border of the picture. On average an annotated frame has 5.5 places where a marking
leaves the picture; at 98 % of them labels end within 1.2 % of the width, but only at 5 % where a picture was cut out
of a larger one with its labels. The likelihoods are applied to the places of several straight markings at one side of
the picture, if labels reach the border at the other sides: sparse labels of a hasty annotator reach no border.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from fieldcalib._types import Array, BoolArray
from fieldcalib.assess.findings import Finding, What
from fieldcalib.assess.probability import LEAST_ASPECT, ground_in_view
from fieldcalib.assess.uncertainty import Uncertainty
from fieldcalib.fields.field import Field
from fieldcalib.geometry.camera import Camera
from fieldcalib.problem.labelled_pixels import Pixels
from fieldcalib.problem.layout import PRINCIPAL_POINT, ROLL
from fieldcalib.problem.prior import BROADCAST_SHAPE, frame_around, is_whole_shape

FAINT = 1e-6  # information, in units of the prior's, that keeps the system regular
PART_SCALE = 10.0  # offset from the middle in parts, relative to whole frames: a fifth of the width
LEVEL = np.radians(0.5)  # standard deviation of roll: 95 % of annotated broadcast frames have less than 0.7 degrees
LARGEST_ROLL_SCORE = 4.0  # squared z-score: larger ones count as this
LARGEST_ROLL = np.radians(2.5)  # a larger roll comes from a head that was not level
LARGEST_LOG_RATIO = 8.0
ERRORS_OF_PART = 0.05, 2.0  # in units of the field's tolerance: smaller errors are right, larger ones wrong in any case
# Required probability of being right if the shape of a picture is not that of a frame. Then 1 to 2 % of halves and
# upright parts of annotated frames are good and wrong; with the 0.5 of whole pictures 6 to 7 % would be.
SURE = 0.92
# Fitted to 667 annotated whole frames and to corners of them that would be good and wrong: 2 % of the frames and 59 %
# of the corners have a positive score. To detect 90 % of the corners without using the ends of labels would cost 16 %
# of the frames, as labels of corners fit a wrong camera as well as the right one.
SCORE = (-0.5, -0.5, 0.55, 1.2, 1.95)
SQUASHED_LOG_ODDS = -2.0  # of being a part, if the picture was squashed from 16:9: few pictures are changed twice
LARGEST_SPREAD = 0.05  # share of the width: wider priors of the principal point are not those of whole frames
SQUASH_SIGMAS = 3.0  # standard deviations by which the aspect of a squashed picture must be off
CUT, ENLARGED, SHAPE = (Finding(what) for what in (What.PART, What.ENLARGED, What.SHAPE))
SEVERAL_VIEWS, IN_WINDOW = Finding(What.SEVERAL_VIEWS), Finding(What.IN_WINDOW)

REACHED, SHORT = 0.012, 0.02  # of the width: labels with a smaller gap reach the border, with a larger one do not
# Log likelihood ratios of a part of a larger picture, for labels that reach the border, nearly do, and do not: 98.2,
# 1.0 and 0.9 % of 3657 places in 651 annotated frames; 4.9, 3.1 and 92 % of 4187 at the cut sides of their corners.
LOG_RATIOS = (-3.0, 1.2, 4.6)
MOST_LOG_RATIO = 8.0  # one picture in some thousands is unusual for another reason
LEAST_PLACES = 2  # at one side: a single marking may have been followed less far than the others
LEAST_REACHED = 0.5  # share of the other places at which labels must reach the border
WITH_LABELS = 0.5  # share of the cut pictures that were cut with their labels; the others were labelled afterwards
SPACING = 0.5  # m, of points on a segment
SIDES = 4


class Declared(StrEnum):
    """Statement of a user about a picture."""

    NOTHING = "nothing"
    PIXELS = "pixels"
    """The aspect ratio of its pixels."""
    FRAME = "frame"
    """Which part of a frame it is, and the aspect ratio of its pixels."""


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
    """The principal point as the labels determine it, in standard deviations of its prior for whole frames."""

    offset: Array
    """Offset (2,) from the middle of the picture."""
    covariance: Array
    """Covariance of the offset, (2, 2)."""

    @property
    def log_ratio_of_part(self) -> float:
        """Log likelihood ratio of a part of a frame to a whole one."""
        log = []
        for scale in (PART_SCALE, 1.0):
            total = self.covariance + scale**2 * np.eye(2)
            log.append(-0.5 * (self.offset @ np.linalg.solve(total, self.offset) + np.linalg.slogdet(total)[1]))
        return float(log[0] - log[1])

    @classmethod
    def of(cls, uncertainty: Uncertainty) -> PrincipalPointEvidence | None:
        """The evidence of a frame whose principal point was free under its prior; None for other frames.

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


def seems_part(
    uncertainty: Uncertainty,
    probability: float,
    log_ratio_of_cut: float = 0.0,
    declared: Declared = Declared.NOTHING,
) -> tuple[Finding, ...]:
    """Evidence that a picture may be a part of a frame whose camera would then be wrong; empty without any.

    Parameters
    ----------
    uncertainty : Uncertainty
    probability : float
        Probability that the camera is right to the field's tolerance, for a field of the given size.
    log_ratio_of_cut : float
        Log likelihood ratio of a part from the ends of labels.
    declared : Declared
        Statement of the user about the picture.
    """
    if declared == Declared.FRAME:
        return ()
    size, evidence = uncertainty.layout.image_size, PrincipalPointEvidence.of(uncertainty)
    if evidence is None or np.min(uncertainty.unit[PRINCIPAL_POINT]) > LARGEST_SPREAD * frame_around(size)[0]:
        return ()
    if not is_whole_shape(size):
        is_square = declared == Declared.PIXELS
        if probability >= SURE and (is_square or _has_square_pixels(uncertainty)):
            return ()
        return (CUT if is_square else SHAPE,)
    return (CUT,) if score(uncertainty, evidence, probability) + log_ratio_of_cut > 0.0 else ()


def differs_in_aspect(shown: Camera, solved: Camera) -> bool:
    """Whether the pixels of a picture are not square, unlike those of the solved frame, from the cameras in both."""
    (a, b), (c, d) = np.diagonal(shown.K)[:2], np.diagonal(solved.K)[:2]
    return bool(abs(np.log(a * d / (b * c))) > LEAST_ASPECT)


def _has_square_pixels(uncertainty: Uncertainty) -> bool:
    """Whether the aspect ratio was estimated or given, or the labels exclude that 16:9 was squashed to this shape."""
    if "log aspect" not in uncertainty.offsets:
        return True
    width, height = uncertainty.layout.image_size
    squash = np.log(BROADCAST_SHAPE * height / width)  # log aspect of a picture squashed from 16:9
    offset, sigma = uncertainty.offsets["log aspect"]
    return bool(abs(offset) < abs(offset - squash) and SQUASH_SIGMAS * sigma < abs(squash))


def features(uncertainty: Uncertainty, evidence: PrincipalPointEvidence, probability: float) -> Array:
    """Terms of the score, (5,).

    They are 1, the log odds of being right, the log ratio of a part, the square of the roll's z-score, and the log of
    `largest_error_of_part` in units of the field's tolerance.
    """
    p = np.clip(probability, 1e-3, 1.0 - 1e-3)
    roll = np.square(uncertainty.theta[ROLL]) / (LEVEL**2 + uncertainty.covariance[ROLL, ROLL])
    roll *= abs(uncertainty.theta[ROLL]) <= LARGEST_ROLL
    ratio = np.clip(evidence.log_ratio_of_part, -LARGEST_LOG_RATIO, LARGEST_LOG_RATIO)
    error = 1.0 if uncertainty.field is None else largest_error_of_part(uncertainty) / uncertainty.field.tolerance
    error = np.clip(np.nan_to_num(error, nan=1.0), *ERRORS_OF_PART)
    return np.array([1.0, np.log(p / (1.0 - p)), ratio, min(roll, LARGEST_ROLL_SCORE), np.log(error)])


def score(uncertainty: Uncertainty, evidence: PrincipalPointEvidence, probability: float) -> float:
    """Score of a picture: positive if it may be a part of a frame, and its camera wrong."""
    return float(np.array(SCORE) @ features(uncertainty, evidence, probability))


def log_ratio_of_cut(field: Field, pixels: Pixels, camera: Camera) -> float:
    """Log likelihood ratio, from the ends of labels, that a picture was cut out of a larger one.

    It is 0 if the ends are no evidence, and only slightly negative if the labels reach every side, as the picture may
    have been labelled after the cut.

    Parameters
    ----------
    field : Field
    pixels : dict of str to (N, 2) array
        Pixels labelled by a person.
    camera : Camera

    Examples
    --------
    >>> from fieldcalib import soccer
    >>> whole = Camera.from_angles(0.0, 1.3, 0.0, 1000.0, (0.0, 65.0, -16.0), (1280, 720))
    >>> lines = ("Side line top", "Side line bottom", "Big rect. right main", "Big rect. right top")
    >>> xy = {label: whole.project(soccer()[label].sample(0.1)) for label in lines}
    >>> labels = {label: some[np.all((some > 0.0) & (some < (1279.0, 719.0)), axis=1)] for label, some in xy.items()}
    >>> log_ratio_of_cut(soccer(), labels, whole) < 0.0
    True
    >>> left = {label: some[some[:, 0] < 900.0] for label, some in labels.items()}  # sparse ones, cut at column 960
    >>> log_ratio_of_cut(soccer(), left, whole.cropped((0, 0), (960, 720))) > 3.0
    True
    """
    places = [place for label, xy in pixels.items() for place in _ends(field, label, xy, camera)]
    best = -np.inf
    for side in range(SIDES):
        own = [gap for where, gap in places if where == side]
        others = [gap for where, gap in places if where != side]
        reached = sum(gap < REACHED for gap in others)
        if len(own) >= LEAST_PLACES and reached >= max(LEAST_REACHED * len(others), 1):
            best = max(best, sum(LOG_RATIOS[int(np.searchsorted((REACHED, SHORT), gap, side="right"))] for gap in own))
    if not np.isfinite(best):
        return 0.0
    return float(np.log(1.0 - WITH_LABELS + WITH_LABELS * np.exp(min(best, MOST_LOG_RATIO))))


def _ends(field: Field, label: str, xy: Array, camera: Camera) -> list[tuple[int, float]]:
    """Places where a marking on the ground leaves the picture: the side, and the gap to its label (of the width)."""
    segment = field.segments.get(label)
    X = np.zeros((0, 3)) if segment is None or segment.is_arc else segment.sample(SPACING)
    if not len(X) or np.any(X[:, 2]) or not len(xy):  # circles need not be followed to the border
        return []
    points = camera.project(X)
    last = np.array(camera.image_size) - 1.0
    beyond = np.concatenate([-points, points - last], axis=1)[:, [0, 2, 1, 3]]  # px, beyond left, right, top, bottom
    outside = np.max(beyond, axis=1)
    known, out = np.isfinite(outside), outside > 0.0
    found = []
    for b in np.flatnonzero(known[:-1] & known[1:] & (out[:-1] != out[1:])) + 1:
        a, b = (b, b - 1) if out[b - 1] else (b - 1, b)  # a is inside
        side = int(np.argmax(beyond[b]))
        share = -beyond[a, side] / (beyond[b, side] - beyond[a, side])
        place = points[a] + share * (points[b] - points[a])
        found.append((side, float(np.min(np.linalg.norm(xy - place, axis=1)) / camera.image_size[0])))
    return found
