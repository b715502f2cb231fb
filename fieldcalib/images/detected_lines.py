"""Lines detected in images near projected markings, as labelled pixels with weights, and cameras fitted to them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fieldcalib.assess.result import Calibration
from fieldcalib.geometry.camera import Camera
from fieldcalib.images.field_markings import Markings
from fieldcalib.images.line_profiles import lines_near
from fieldcalib.io.image import Image
from fieldcalib.problem.labelled_pixels import Pixels, PixelWeights, Weights
from fieldcalib.problem.losses import RobustLoss
from fieldcalib.solve.batch import calibrate_labels
from fieldcalib.solve.joint_problem import labels_of
from fieldcalib.solve.options import PAINT, pixel_unit
from fieldcalib.solve.task import Task
from fieldcalib.solve.tripod import Labels

# Lengths are in pixels of a 960 x 540 image and grow with the image.
SEARCH_RANGES = (12.0, 4.0)  # px from the projected markings, in the first and the second pass
LOSS_SCALE = 2.0  # px: detected lines are more accurate than that, others are outliers
PROFILES_PER_SEGMENT = 5.0  # number of profiles that carries the weight of one segment without a weight
SIGMAS = 3.0  # half width of the search for a line, in standard deviations of its projected marking


def line_loss(image_size: tuple[int, int], scale: float = LOSS_SCALE) -> RobustLoss:
    """The loss of lines that are detected in images of a size."""
    return RobustLoss("cauchy", scale * pixel_unit(image_size))


def detected_lines(image: Image, camera: Camera, markings: Markings, sigma: float = 0.0) -> tuple[Labels, int]:
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
    return (pixels, _weights(pixels)), profiles


def with_paint(lines: Labels, beside: Pixels) -> Labels:
    """The lines of a frame, with those of some markings replaced by paint that lies beside the markings."""
    pixels, weights = lines
    return {**pixels, **beside}, {**weights, **_weights(beside)}


def _weights(pixels: Pixels) -> PixelWeights:
    return {label: np.full(len(xy), 1.0 / PROFILES_PER_SEGMENT) for label, xy in pixels.items()}


def fitted_labels(calibration: Calibration) -> Labels:
    """The labelled pixels that the camera of a single image was fitted to, and the weight of each pixel."""
    assert calibration.solved is not None
    return labels_of(calibration.solved.alone.evaluation)


def per_label(labels: Labels) -> Labels:
    """Labels with weights per label, as arguments of calibrations have them, instead of weights per pixel."""
    pixels, weights = labels
    return pixels, {label: len(weight) * weight for label, weight in weights.items()}


def calibrate_on_lines(
    task: Task,
    images: Sequence[tuple[Pixels, Weights]],
    image_size: tuple[int, int],
    cameras: Sequence[Camera] | None = None,
    scale: float = LOSS_SCALE,
) -> list[Calibration]:
    """Calibrations from the lines of images, with weights per label, from cameras near them or from anywhere."""
    task = replace(task, loss=line_loss(image_size, scale), trust_labels=True, paint=PAINT)
    pixels, weights = [pixels for pixels, _ in images], [weights for _, weights in images]
    return calibrate_labels(task, pixels, image_size, weights, cameras=cameras)
