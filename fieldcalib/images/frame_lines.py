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
    """Lines of a frame, those of some markings replaced by the paint (N, 2) that lies beside them."""
    pixels, weights = lines
    return {**pixels, **beside}, {**weights, **_weights(beside)}


def _weights(pixels: Pixels) -> PixelWeights:
    return {label: np.full(len(xy), 1.0 / PROFILES_PER_SEGMENT) for label, xy in pixels.items()}
