"""Pictures squashed from 16:9: calibrated with and without that assumption; the likelihoods are compared.

A picture of another shape than 16:9 is a whole frame or a part of one with square pixels, or a whole frame that was
squashed. In the first case the principal point may lie anywhere (`fieldcalib.problem.prior`), in the second pixels are
not square. The log evidence for each, by Laplace's approximation, is ``-cost - 1/2 log det A``, with A the information
of labels and prior in units of the prior's: freedom that does not improve the fit is penalised.

Labels that all end at one column: the border of the annotated picture, which may be smaller than the given size.

Annotators follow a marking to the border of the picture. Labels of a picture of 960 x 540 pixels for which 1280 x 720
is given end at column 959, although their segments continue in the picture.
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
from fieldcalib.assess.result import Calibration, found_of, with_findings
from fieldcalib.fields.segments import ObjectSegments, Segment
from fieldcalib.geometry.camera import Camera
from fieldcalib.problem.labelled_pixels import ImageSegments, Pixels
from fieldcalib.problem.prior import frame_around, is_whole_shape
from fieldcalib.solve.solver_options import CERTAIN

NEAR = 0.004  # of a side: labels whose ends differ by less end at one border,
APART = 0.03  # if they are this far from one another: labels that meet in a corner of the field are nearer
AWAY = 0.02  # of a side: least distance of that border from the picture's own, and least extent of labels towards it
# Usual widths of pictures; in one of a few hundred frames a single label ends by chance within half a pixel of the last
# column of one.
WIDTHS = (480, 512, 640, 720, 854, 960, 1024, 1280, 1366, 1600, 1920, 2560, 3840)
ROUNDED = 0.6  # px
SPACING = 1.0  # m, of points on a segment

SQUASHED_RATIOS = 0.5, 3.2  # of width and height
LEAST_RATIO = 0.2  # of width and height: no picture is shown narrower
# Prior log odds that a square picture was squashed: networks are trained with squares, cameras do not film them.
SQUARE_LOG_ODDS = 1.5
WAS_SQUASHED = Finding(What.WAS_SQUASHED)


def with_border_complaint(object_segments: ObjectSegments, frame: Pixels, calibration: Calibration) -> Calibration:
    """The calibration with the finding of `other_border` replaced; only for labels that were set by hand."""
    others = tuple(one for one in found_of(calibration) if one.what is not What.BORDER)
    if calibration.camera is not None and calibration.are_annotated:
        said = other_border(object_segments, frame, calibration.camera.image_size, calibration.camera)
        others = others if said is None else (*others, said)
    return calibration if others == found_of(calibration) else replace(calibration, _found=others)


def other_border(
    object_segments: ObjectSegments, frame: Pixels, image_size: tuple[int, int], camera: Camera | None
) -> Finding | None:
    """Evidence that the labels of a frame end at a border other than that of its picture; None if they do not.

    There is none for any of 756 annotated frames of SoccerNet and WC14, but for 96 % of them if their given width
    is a third too large or too small. Only labels count whose segments continue in the picture of the `camera` found.

    Examples
    --------
    >>> from fieldcalib import soccer
    >>> camera = Camera.from_angles(0.0, 1.35, 0.0, 1400.0, (0.0, 65.0, -16.0), (1280, 720))
    >>> pixels = {label: camera.project(soccer()[label].sample(0.1)) for label in ("Side line top", "Circle central")}
    >>> labels = {label: xy[np.all((xy > 0.0) & (xy < 960.0), axis=1)] for label, xy in pixels.items()}
    >>> str(other_border(soccer(), labels, (1280, 720), camera))
    'the labels end at column 959 of 1280: are they of a picture that is 960 pixels wide?'
    >>> labels = {label: xy[np.all((xy > 0.0) & (xy < (1280.0, 720.0)), axis=1)] for label, xy in pixels.items()}
    >>> other_border(soccer(), labels, (1280, 720), camera) is None
    True
    """
    width, height = image_size
    ends = {
        label: xy[np.argmax(xy[:, 0])]
        for label, xy in frame.items()
        if len(xy) and not object_segments[label].is_point and np.ptp(xy[:, 0]) > AWAY * width  # no posts
    }
    if camera is None or not ends:
        return None
    end = float(max(xy[0] for xy in ends.values()))
    if abs(end + 1.0 - width) <= AWAY * width:
        return None
    last = {label: xy for label, xy in ends.items() if xy[0] > end - NEAR * width}
    rows = np.sort([xy[1] for label, xy in last.items() if _goes_on(object_segments[label], camera, end)])
    if not len(rows):
        return None
    together = np.any(np.diff(rows) > APART * height)
    if not (together or np.min(np.abs(end + 1.0 - np.array(WIDTHS))) < ROUNDED):
        return None
    column = round(end)
    return Finding(What.BORDER, numbers=(column, width, column + 1))


def _goes_on(segment: Segment, camera: Camera, column: float) -> bool:
    """Whether a segment continues to the right of a column, in the picture or beside it."""
    x = camera.project(segment.sample(SPACING))[:, 0]
    return bool(np.any(x > column + APART * camera.image_size[0]))  # false for NaN


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
