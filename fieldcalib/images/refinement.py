"""Refinement of a camera on its image: it is fitted to lines that are detected near the projected markings.

Lines are located with sub-pixel accuracy, including those that neither a network nor an annotator has labelled.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fieldcalib.assess.result import Calibration
from fieldcalib.calibrate.batch import calibrate_batch
from fieldcalib.calibrate.options import ALL, DEFAULT_FLAGS, PAINT, CalibrationFlags, Prior, pixel_unit
from fieldcalib.fields.segments import ObjectSegments
from fieldcalib.geometry.camera import Camera
from fieldcalib.images.line_profiles import Markings, find_lines, lines_near, profiles_along
from fieldcalib.io.image import Image, checked_image
from fieldcalib.problem.labelled_pixels import ImageSegments, Pixels, Weights, check_segments
from fieldcalib.problem.losses import RobustLoss

# Lengths are in pixels of a 960 x 540 image and grow with the image.
SEARCH_RANGES = (12.0, 4.0)  # px from the projected markings, in the first and the second pass
LOSS_SCALE = 2.0  # px: detected lines are more accurate than that, others are outliers
PROFILES_PER_SEGMENT = 5.0  # number of profiles that carries the weight of one segment without a weight
LEAST_SUPPORT_REFINED = 0.35  # broadcast frames: 0.36 to 0.9 for cameras within 3 px, below 0.38 for 95 % of wrong ones


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
    """Refine a calibration on its image, or return it unchanged.

    In two passes, lines are searched across the projected markings and the camera is calibrated from their places. The
    result is returned if it is accepted, has enough line support (`line_support`) and not less than `calibration`.

    Parameters
    ----------
    object_segments : mapping of str to segment
        The calibration object.
    image : (height, width, 3) uint8 array
        Blue, green, red.
    calibration : Calibration
        Its markings must be within about 12 px of the lines in an image of 960x540, within 24 px in one of 1920x1080.
    image_segments : mapping of str to (N, 2) array_like, optional
        Labelled pixels; used for segments whose line is not found in the image.
    weights : mapping of str to float or (N,) array_like, optional
        Weights of these.
    flags, prior
        As in `calibrate_from_segments`.

    Returns
    -------
    Calibration
        The refined one, whose errors refer to the lines found in the image, or `calibration` itself.

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
    size = calibration.camera.image_size
    labelled = check_segments(object_segments, image_segments or {}, size)
    one = ToRefine(checked_image(image, size), calibration, labelled, weights or {})
    (refined,) = refine_all(object_segments, Markings.of(object_segments), [one], flags=flags, prior=prior)
    return refined.calibration


@dataclass(frozen=True, eq=False)
class ToRefine:
    """A calibration and what it is refined on."""

    image: Image
    calibration: Calibration
    labelled: Pixels
    weights: Weights


@dataclass(frozen=True)
class Refined:
    """A calibration, refined or as it was, and its line support."""

    calibration: Calibration
    support: float
    """NaN where there is no camera."""


def refine_all(
    object_segments: ObjectSegments,
    markings: Markings,
    given: Sequence[ToRefine],
    *,
    flags: int,
    prior: Prior,
) -> list[Refined]:
    """`refine_on_image` for images of one size, solved together."""
    best = unrefined(markings, given)
    found = {t: one.calibration for t, one in enumerate(given) if one.calibration.camera is not None}
    # lines that are found far away may be others: a principal point that is free would absorb them
    flags_of_passes = flags | CalibrationFlags.CALIB_FIX_PRINCIPAL_POINT, flags
    for search_range, kept in zip(SEARCH_RANGES, flags_of_passes, strict=True):
        lines = {
            t: lines_near(given[t].image, calibration.camera, markings, search_range)[0]
            for t, calibration in found.items()
            if calibration.camera is not None
        }
        again = _calibrated(object_segments, [(found[t], lines[t], given[t]) for t in lines], kept, prior)
        found = {t: calibration for t, calibration in zip(lines, again, strict=True) if calibration.accepted}
    for t, calibration in found.items():
        support = _support(given[t].image, calibration, markings)
        if support >= max(LEAST_SUPPORT_REFINED, best[t].support):
            best[t] = Refined(calibration, support)
    return best


def unrefined(markings: Markings, given: Sequence[ToRefine]) -> list[Refined]:
    """Calibrations as they are, with their line support."""
    return [Refined(one.calibration, _support(one.image, one.calibration, markings)) for one in given]


def _support(image: Image, calibration: Calibration, markings: Markings) -> float:
    return np.nan if calibration.camera is None else line_support(image, calibration.camera, markings)


def line_support(image: Image, camera: Camera, markings: Markings, search_range: float = SEARCH_RANGES[-1]) -> float:
    """How well the lines in an image support a camera, from 0 to 1.

    The mean over profiles across the projected markings of ``max(1 - 2 |offset| / search_range, 0)``, where the offset
    is the distance of the line from the marking; a profile without a line counts 0. Profiles in
    the middle of black, beside the part of a frame that is shown, do not count.

    Parameters
    ----------
    image : (height, width, 3) uint8 array
        Blue, green, red.
    camera : Camera
    markings : Markings
    search_range : float
        Pixels of a 960 x 540 image.
    """
    profiles = profiles_along(camera, markings)
    offset = find_lines(image, profiles, search_range)
    share = np.maximum(1.0 - np.abs(offset) / (0.5 * search_range * pixel_unit(camera.image_size)), 0.0)
    column, row = np.round(profiles.xy).astype(int).T
    share = share[np.any(image[row, column], axis=-1)]
    return float(np.mean(np.nan_to_num(share))) if len(share) else 0.0


def _calibrated(
    object_segments: ObjectSegments,
    given: Sequence[tuple[Calibration, Pixels, ToRefine]],
    flags: int,
    prior: Prior,
) -> list[Calibration]:
    """The cameras fitted to detected lines, and to labelled pixels of segments without one, from those of before."""
    cameras = [calibration.camera for calibration, _, _ in given if calibration.camera is not None]
    if not cameras:
        return []
    size = cameras[0].image_size
    weights = [
        {label.strip(): weight for label, weight in one.weights.items()}
        | {label: len(xy) / PROFILES_PER_SEGMENT for label, xy in lines.items()}
        for _, lines, one in given
    ]
    return calibrate_batch(
        object_segments,
        [{**one.labelled, **lines} for _, lines, one in given],
        size,
        cameras=cameras,
        flags=flags,
        prior=prior,
        loss=RobustLoss("cauchy", LOSS_SCALE * pixel_unit(size)),
        weights=weights,
        trust_labels=True,
        paint=PAINT,
    )
