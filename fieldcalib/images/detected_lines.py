"""Lines detected in images near projected markings, as labelled pixels with weights, and cameras fitted to them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fieldcalib.assess.result import Calibration
from fieldcalib.geometry.camera import Camera
from fieldcalib.images.field_markings import Markings
from fieldcalib.images.line_profiles import find_lines, pixels_of_lines, profiles_along
from fieldcalib.io.image import Image
from fieldcalib.problem.losses import RobustLoss
from fieldcalib.problem.pixel_table import PixelTable
from fieldcalib.solve.batch import calibrate_pixels
from fieldcalib.solve.options import paint_sigma, pixel_unit
from fieldcalib.solve.task import Task

# Lengths are in pixels of a 960 x 540 image and grow with the image.
SEARCH_RANGES = (12.0, 4.0)  # px from the projected markings, in the first and the second pass
LOSS_SCALE = 2.0  # px: detected lines are more accurate than that, others are outliers
SIGMAS = 3.0  # half width of the search for a line, in standard deviations of its projected marking


def line_loss(image_size: tuple[int, int], scale: float = LOSS_SCALE) -> RobustLoss:
    """The loss of lines that are detected in images of a size."""
    return RobustLoss("cauchy", scale * pixel_unit(image_size))


def detected_lines(image: Image, camera: Camera, markings: Markings, sigma: float = 0.0) -> tuple[PixelTable, int]:
    """The lines near the markings that a camera projects, and the number of profiles in which they were searched.

    Parameters
    ----------
    image : (height, width, 3) uint8 array
        Blue, green, red.
    camera : Camera
    markings : Markings
    sigma : float
        Standard deviation of the projected markings, pixels: the worse the camera is known, the wider is the search.
    """
    search_range = np.clip(SIGMAS * sigma / pixel_unit(camera.image_size), SEARCH_RANGES[1], SEARCH_RANGES[0])
    profiles = profiles_along(camera, markings)
    return pixels_of_lines(markings, profiles, find_lines(image, profiles, float(search_range))), len(profiles)


def with_replaced(labels: PixelTable, others: PixelTable) -> PixelTable:
    """The labelled pixels of one image, with those of some labels replaced by `others` or added."""
    names = tuple(dict.fromkeys((*labels.labels, *others.labels)))
    labels, others = labels.numbered(names), others.numbered(names)
    both = PixelTable.joined(names, [labels.take(~np.isin(labels.label, others.label)), others])
    return replace(both, count=1, frame=np.zeros_like(both.frame))


def calibrate_on_lines(
    task: Task,
    lines: Sequence[PixelTable],
    image_size: tuple[int, int],
    cameras: Sequence[Camera] | None = None,
    scale: float = LOSS_SCALE,
) -> list[Calibration]:
    """Calibrations from the lines of each image, from cameras near them or from anywhere."""
    paint = paint_sigma(task.object_segments)
    task = replace(task, loss=line_loss(image_size, scale), trust_labels=True, paint=paint)
    return calibrate_pixels(task, PixelTable.joined(task.object_segments, lines), image_size, cameras)
