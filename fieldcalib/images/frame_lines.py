"""The lines of a frame whose camera is known to some pixels."""

from __future__ import annotations

import numpy as np

from fieldcalib.geometry.camera import Camera
from fieldcalib.images.line_profiles import Markings, lines_near
from fieldcalib.images.refinement import PROFILES_PER_SEGMENT, SEARCH_RANGES
from fieldcalib.io.image import Image
from fieldcalib.problem.labelled_pixels import Pixels, PixelWeights
from fieldcalib.solve.options import pixel_unit
from fieldcalib.solve.tripod import Labels

SIGMAS = 3.0  # of the predicted error of a marking, within which its line is searched


def frame_lines(image: Image, camera: Camera, markings: Markings, sigma: float = 0.0) -> tuple[Labels, int]:
    """The lines near the projected markings, and the number of profiles in which they were searched.

    Their weights are as arguments have them.

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
    """Lines of a frame with the paint (N, 2) that lies beside some markings, in place of what is near these."""
    pixels, weights = lines
    return {**pixels, **beside}, {**weights, **_weights(beside)}


def _weights(pixels: Pixels) -> PixelWeights:
    return {label: np.full(len(xy), len(xy) / PROFILES_PER_SEGMENT) for label, xy in pixels.items()}


def as_given(labels: Labels) -> Labels:
    """Labels with weights as arguments have them: what a label counts, not what each of its pixels does."""
    pixels, weights = labels
    return pixels, {label: len(weight) * weight for label, weight in weights.items()}


def per_pixel(labels: Labels) -> Labels:
    """The inverse of `as_given`."""
    pixels, weights = labels
    return pixels, {label: weight / len(weight) for label, weight in weights.items()}
