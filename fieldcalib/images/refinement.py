"""A camera refined on its image: white lines are found near the projected markings and calibrated from.

Lines are found to fractions of a pixel, and also where no network saw them and nobody labelled them.
"""

from __future__ import annotations

import numpy as np

from fieldcalib.assess.result import Calibration
from fieldcalib.calibrate.from_segments import calibrate_from_segments
from fieldcalib.calibrate.options import ALL, DEFAULT_FLAGS, CalibrationFlags, Prior, pixel_unit
from fieldcalib.fields.segments import ObjectSegments
from fieldcalib.geometry.camera import Camera
from fieldcalib.images.line_profiles import Markings, find_lines, profiles_along
from fieldcalib.io.image import Image, checked_image
from fieldcalib.problem.labelled_pixels import ImageSegments, Pixels, Weights, check_segments
from fieldcalib.problem.losses import RobustLoss

# Pixels are those of a 960 x 540 image; larger ones have more.
REACHES = (12.0, 4.0)  # px from the markings, the first and the second time
LOSS_SCALE = 2.0  # px: what was found is right to less, or is no line
PROFILES_PER_SEGMENT = 5.0  # so many weigh as much as a segment without a weight
LEAST_AGREEMENT = 0.35  # on broadcast frames 0.36 to 0.9 of cameras within 3 px, below 0.38 of 95 % of wrong ones

PAINT = 0.03  # m: by how much a line is painted elsewhere, a quarter of its width
GUESS = CalibrationFlags.CALIB_USE_INTRINSIC_GUESS | CalibrationFlags.CALIB_USE_EXTRINSIC_GUESS


def refine_on_image(
    object_segments: ObjectSegments,
    image: Image,
    calibration: Calibration,
    image_segments: ImageSegments | None = None,
    *,
    weights: Weights | None = None,
    flags: int = DEFAULT_FLAGS,
    prior: Prior = ALL,
) -> Calibration:
    """Refine a calibration on its image, or leave it as it is.

    Twice, white lines are looked for across the projected markings, and the camera is calibrated from where they are.
    It is kept if it is accepted, and if the image agrees with it, and no less than with the one before.

    Parameters
    ----------
    object_segments : mapping of str to segment
        The calibration object.
    image : (height, width, 3) uint8 array
        Blue, green, red.
    calibration : Calibration
        To be right within about 12 px in an image of 960x540, and 24 in one of 1920x1080.
    image_segments : mapping of str to (N, 2) array_like, optional
        Labelled pixels; used for segments of which the image shows no line.
    weights : mapping of str to float or (N,) array_like, optional
        What these count.
    flags, prior
        As in `calibrate_from_segments`.

    Returns
    -------
    Calibration
        The new one, whose errors are those of the lines found in the image, or `calibration` itself.

    Raises
    ------
    ValueError
        If the image is not uint8, has no three channels or is not of the camera's size, or from
        `calibrate_from_segments`.

    Examples
    --------
    >>> from fieldcalib import Camera, calibrate_from_segments, soccer
    >>> from fieldcalib.draw.scene import render_field
    >>> truth = Camera.from_angles(0.3, 1.36, 0.0, 1300.0, (0.0, 66.0, -16.0), (960, 540))
    >>> labels = ("Side line top", "Side line right", "Big rect. right main", "Circle right")
    >>> pixels = {label: truth.project(soccer()[label].sample(9.0)) + (5.0, 2.0) for label in labels}
    >>> found = calibrate_from_segments(soccer(), pixels, (960, 540))
    >>> refined = refine_on_image(soccer(), render_field(truth, soccer()), found)
    >>> mark = (41.5, 0.0, 0.0)
    >>> [round(float(np.linalg.norm(c.camera.project(mark) - truth.project(mark)))) for c in (found, refined)]
    [5, 0]
    """
    if calibration.camera is None:
        return calibration
    camera = calibration.camera
    image = checked_image(image, camera.image_size)
    labelled = check_segments(object_segments, image_segments or {}, camera.image_size)
    weights = {label.strip(): weight for label, weight in (weights or {}).items()}
    markings = Markings.of(object_segments)
    least = max(LEAST_AGREEMENT, agreement(image, camera, markings))
    refined = calibration
    for reach in REACHES:
        lines = _lines(image, camera, markings, reach)
        refined = _calibrated(object_segments, camera, lines, labelled, weights, flags, prior)
        if not refined.accepted or refined.camera is None:
            return calibration
        camera = refined.camera
    return refined if agreement(image, camera, markings) >= least else calibration


def agreement(image: Image, camera: Camera, markings: Markings, reach: float = REACHES[-1]) -> float:
    """How well an image agrees with a camera, from 0 to 1: how near to its lines the projected markings are.

    The mean over profiles across the markings in view; one that shows no line, or shows it half of `reach` away (2 px
    in an image of 960x540), counts 0.
    """
    offset = find_lines(image, profiles_along(camera, markings), reach)
    share = np.maximum(1.0 - np.abs(offset) / (0.5 * reach * pixel_unit(camera.image_size)), 0.0)
    return float(np.mean(np.nan_to_num(share))) if len(share) else 0.0


def _lines(image: Image, camera: Camera, markings: Markings, reach: float) -> Pixels:
    """Pixels (N, 2) of the lines near each marking, where there are any."""
    profiles = profiles_along(camera, markings)
    offset = find_lines(image, profiles, reach)
    seen = np.isfinite(offset)
    xy = profiles.xy[seen] + offset[seen, None] * profiles.normal[seen]
    member = profiles.member[seen]
    return {markings.labels[k]: xy[member == k] for k in np.unique(member)}


def _calibrated(
    object_segments: ObjectSegments,
    start: Camera,
    lines: Pixels,
    others: Pixels,
    weights: Weights,
    flags: int,
    prior: Prior,
) -> Calibration:
    """The camera that fits lines, and other labelled pixels where there is no line."""
    weight_of_lines = {label: len(xy) / PROFILES_PER_SEGMENT for label, xy in lines.items()}
    rvec, tvec, K, dist = start.to_opencv()
    return calibrate_from_segments(
        object_segments,
        {**others, **lines},
        start.image_size,
        K,
        dist,
        rvec,
        tvec,
        flags=flags | GUESS,
        prior=prior,
        loss=RobustLoss("cauchy", LOSS_SCALE * pixel_unit(start.image_size)),
        weights={**weights, **weight_of_lines},
        trust_labels=True,
        paint=PAINT,
    )
