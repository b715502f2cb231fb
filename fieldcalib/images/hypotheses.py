"""Cameras from subsets of the segments, for an image whose segments are inconsistent.

Hypothesise and verify, where a hypothesis is scored on the image (line support) instead of by its number of inliers: a
network that mistakes a mowing pattern for a penalty area does so for several of its lines, which are then consistent
with one another but have no line support.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from fieldcalib._types import Array
from fieldcalib.assess.result import Calibration
from fieldcalib.assess.words import Status, What
from fieldcalib.images.detected_lines import SEARCH_RANGES
from fieldcalib.images.field_markings import Markings
from fieldcalib.images.refinement import line_support, near_labels
from fieldcalib.io.image import Image, size_of
from fieldcalib.problem.pixel_table import PixelTable
from fieldcalib.solve.batch import calibrate_pixels
from fieldcalib.solve.options import CalibrationFlags
from fieldcalib.solve.task import Task

HEAVIEST = 5  # segments with the largest weights, from which hypotheses are made
PER_HYPOTHESIS = 3  # segments, the fewest that determine a camera: 10 hypotheses
VERIFIED = 2  # hypotheses that are calibrated again from all segments near them
NO_MARKING = "no marking was found in the image"
SHOW_MORE = "show more of the field, in a sharper or larger picture, or say what is known of the camera"


def calibrate_from_consensus(task: Task, image: Image, found: PixelTable) -> list[Calibration]:
    """Calibrate from subsets of the labelled pixels that are consistent with the lines in the image.

    A camera is calibrated from every three of the five heaviest segments. For each of the two cameras with the highest
    line support, a camera is calibrated from all segments within 12 px of it (in an image of 960x540).

    Parameters
    ----------
    task : Task
        Calibration object, flags, prior and what is known of the camera.
    image : (height, width, 3) uint8 array
        Blue, green, red.
    found : PixelTable
        Labelled pixels of the image.

    Returns
    -------
    list of Calibration
        The one of the best supported hypothesis first; empty if there are too few segments for subsets.

    References
    ----------
    Fischler, Bolles: Random Sample Consensus, Communications of the ACM 24 (1981).
    """
    weight = label_weights(found)
    heaviest = np.argsort(-weight, kind="stable")[: min(HEAVIEST, np.count_nonzero(weight))].tolist()
    if len(heaviest) <= PER_HYPOTHESIS:
        return []
    size, markings = size_of(image), Markings.of(task.object_segments)
    parts = [found.take(np.isin(found.label, labels)) for labels in combinations(heaviest, PER_HYPOTHESIS)]
    cameras = [one.camera for one in calibrate_localized(task, parts, size) if one.camera is not None]
    share = [line_support(image, camera, markings, max(SEARCH_RANGES)) for camera in cameras]
    best = [cameras[index] for index in np.argsort(share)[::-1][:VERIFIED]]
    near = near_labels(task.object_segments, best, len(best) * [found], max(SEARCH_RANGES))
    chosen = dict.fromkeys(map(tuple, near.tolist()))
    return calibrate_localized(task, [found.take(np.array(is_near)[found.label]) for is_near in chosen], size)


def label_weights(found: PixelTable) -> Array:
    """Weights (L,) of the labels that a network found in an image; longer segments have more pixels and weigh more."""
    count = len(found.labels)
    return np.asarray(np.bincount(found.label, found.weight, count) * np.bincount(found.label, minlength=count), float)


def calibrate_localized(task: Task, found: Sequence[PixelTable], size: tuple[int, int]) -> list[Calibration]:
    """Calibrate localized images of one size, without the search for mislabelled segments."""
    # a network's pixels are too coarse to determine the principal point
    task = replace(task, trust_labels=True).with_flags(CalibrationFlags.CALIB_FIX_PRINCIPAL_POINT)
    pixels = PixelTable.joined(task.object_segments, found)
    return [_with_advice(one) for one in calibrate_pixels(task, pixels, size)]


def _with_advice(calibration: Calibration) -> Calibration:
    """The calibration; where a network labelled too few pixels, its message says what would help."""
    if calibration.status is not Status.TOO_FEW_SEGMENTS:
        return calibration
    if not calibration.pixel_counts:
        return replace(calibration, message=f"{NO_MARKING}: {SHOW_MORE}")
    labels, equations, unknowns = next(one for one in calibration.findings if one.what is What.TOO_FEW_LABELS).numbers
    few = f"{labels:.0f} segment{'s' * (labels != 1)}: {equations:.0f} equations for {unknowns:.0f} unknowns"
    return replace(calibration, message=f"{few}; {SHOW_MORE}")
