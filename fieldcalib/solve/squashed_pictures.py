"""Pictures squashed from 16:9: calibrated with and without that assumption; the likelihoods are compared.

A picture of another shape than 16:9 is a whole frame or a part of one with square pixels, or a whole frame that was
squashed. In the first case the principal point may lie anywhere (`fieldcalib.problem.prior`), in the second pixels are
not square. The log evidence for each, by Laplace's approximation, is ``-cost - 1/2 log det A``, with A the information
of labels and prior in units of the prior's: freedom that does not improve the fit is penalised.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib._types import Array
from fieldcalib.assess.cropping_evidence import SHAPE
from fieldcalib.assess.findings import Finding, What
from fieldcalib.assess.placement import Placement
from fieldcalib.assess.result import Calibration, with_findings
from fieldcalib.fields.segments import ObjectSegments
from fieldcalib.problem.labelled_pixels import ImageSegments
from fieldcalib.problem.prior import frame_around, is_whole_shape
from fieldcalib.solve.annotation_border import with_border_complaint
from fieldcalib.solve.solver_options import CERTAIN

SQUASHED_RATIOS = 0.5, 3.2  # of width and height
LEAST_RATIO = 0.2  # of width and height: no picture is shown narrower
# Prior log odds that a square picture was squashed: networks are trained with squares, cameras do not film them.
SQUARE_LOG_ODDS = 1.5
WAS_SQUASHED = Finding(What.WAS_SQUASHED)


def may_be_squashed(image_size: tuple[int, int]) -> bool:
    """Whether a picture has another shape than 16:9, to which frames may be squashed.

    Examples
    --------
    >>> may_be_squashed((640, 640)), may_be_squashed((1280, 720)), may_be_squashed((2000, 3))
    (True, False, False)
    """
    ratio = image_size[0] / image_size[1]
    return SQUASHED_RATIOS[0] <= ratio <= SQUASHED_RATIOS[1] and not is_whole_shape(image_size)


def shown_size(image_size: tuple[int, int]) -> tuple[int, int]:
    """Size at which a picture that was squashed from 16:9 has square pixels.

    Examples
    --------
    >>> shown_size((640, 640)), shown_size((1920, 800))
    ((1138, 640), (1920, 1080))
    """
    width, height = frame_around(image_size)
    return round(width), round(height)


def shown_as(image_size: tuple[int, int], aspect: float) -> tuple[int, int]:
    """Size at which a picture is shown with an aspect (width / height), no side being shortened.

    Examples
    --------
    >>> shown_as((640, 640), 16 / 9), shown_as((640, 480), 1.0)
    ((1138, 640), (640, 640))
    """
    width, height = image_size
    if aspect * height >= width:
        return round(aspect * height), height
    return width, round(width / aspect)


def log_evidence(calibration: Calibration) -> float:
    """Log marginal likelihood of the labels over all cameras, up to a constant; minus infinity without a camera."""
    if calibration.solved is None:
        return -np.inf
    uncertainty = calibration.solved.uncertainty
    evaluation = uncertainty.evaluation
    information = uncertainty.information.matrix[0]
    return float(-evaluation.cost[0] - 0.5 * np.linalg.slogdet(information + np.eye(len(information)))[1])


def likelier(as_it_is: Calibration, shown: Calibration, log_ratio: float, image_size: tuple[int, int]) -> Calibration:
    """The more likely of two calibrations of a picture: as it is, and stretched as if it had been squashed.

    Parameters
    ----------
    as_it_is, shown : Calibration
        Calibrations in pixels of the picture, and in those of `shown_size`.
    log_ratio : float
        Log evidence for `shown` minus that for `as_it_is`.
    image_size : (int, int)
        Width and height of the picture.
    """
    log_ratio += SQUARE_LOG_ODDS * (image_size[0] == image_size[1])
    only_one = abs(log_ratio) <= CERTAIN and shown.accepted != as_it_is.accepted
    if shown.camera is not None and (shown.accepted if only_one else log_ratio > 0.0):
        found = Placement(image_size, shown_size(image_size), None).from_frame(shown)
        found = with_findings(replace(found, message=f"{found.message}; {WAS_SQUASHED}"), WAS_SQUASHED)
    else:
        found = as_it_is
    if abs(log_ratio) > CERTAIN or not found.accepted or found.has_finding(What.SHAPE):
        return found
    return with_findings(found, SHAPE)


def with_likely_aspect(
    object_segments: ObjectSegments,
    calibrate: Callable[[Sequence[ImageSegments], tuple[int, int]], list[Calibration]],
    frames: Sequence[ImageSegments],
    image_size: tuple[int, int],
    *,
    estimated: bool,
) -> list[Calibration]:
    """Calibrate frames of one size, each as it is or stretched to 16:9, whichever its labels make more likely.

    Unless the aspect ratio is `estimated`, all are calibrated as they are.
    """
    found = calibrate(frames, image_size)
    if not (estimated and may_be_squashed(image_size)):
        return found
    size = shown_size(image_size)
    shown = calibrate([stretched(frame, np.divide(size, image_size)) for frame in frames], size)
    chosen = [
        likelier(one, other, log_evidence(other) - log_evidence(one), image_size) if one.solved or other.solved else one
        for one, other in zip(found, shown, strict=True)
    ]
    in_picture = [stretched(frame, np.ones(2)) for frame in frames]  # in pixels of the picture
    return [with_border_complaint(object_segments, *pair) for pair in zip(in_picture, chosen, strict=True)]


def stretched(frame: Mapping[str, ArrayLike], scale: Array) -> dict[str, Array]:
    """The pixels of a frame, scaled along x and y."""
    return {label: np.reshape(np.asarray(xy, dtype=float), (-1, 2)) * scale for label, xy in frame.items()}
