"""Lines detected in images near projected markings, as labelled pixels with weights, and cameras fitted to them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from fieldcalib.assess.result import Calibration
from fieldcalib.geometry.camera import Camera
from fieldcalib.images.field_markings import Markings
from fieldcalib.images.line_profiles import lines_near
from fieldcalib.io.image import Image
from fieldcalib.problem.labelled_pixels import Pixels
from fieldcalib.problem.losses import RobustLoss
from fieldcalib.problem.pixel_table import PixelTable
from fieldcalib.solve.batch import calibrate_pixels
from fieldcalib.solve.options import PAINT, pixel_unit
from fieldcalib.solve.task import Task

# Lengths are in pixels of a 960 x 540 image and grow with the image.
SEARCH_RANGES = (12.0, 4.0)  # px from the projected markings, in the first and the second pass
LOSS_SCALE = 2.0  # px: detected lines are more accurate than that, others are outliers
PROFILES_PER_SEGMENT = 5.0  # number of profiles that carries the weight of one segment without a weight
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
    pixels, profiles = lines_near(image, camera, markings, float(search_range))
    return pixels_of_profiles(markings.labels, pixels), profiles


def with_paint(lines: PixelTable, beside: Pixels) -> PixelTable:
    """The lines of a frame, with those of some markings replaced by paint that lies beside the markings."""
    return pixels_of_profiles(lines.labels, {**lines.by_label(0), **beside})


def pixels_of_profiles(labels: Iterable[str], lines: Pixels) -> PixelTable:
    """Lines of one image, of which each pixel was found in a profile and weighs as much."""
    weights = {label: np.full(len(xy), 1.0 / PROFILES_PER_SEGMENT) for label, xy in lines.items()}
    return PixelTable.of(labels, [lines], [weights])


def calibrate_on_lines(
    task: Task,
    lines: PixelTable,
    image_size: tuple[int, int],
    cameras: Sequence[Camera] | None = None,
    scale: float = LOSS_SCALE,
) -> list[Calibration]:
    """Calibrations from the lines of images, from cameras near them or from anywhere."""
    task = replace(task, loss=line_loss(image_size, scale), trust_labels=True, paint=PAINT)
    return calibrate_pixels(task, lines, image_size, cameras)
