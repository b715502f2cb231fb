"""Simulated labels: a camera that pans over a field, and the pixels that an annotator would label."""

from __future__ import annotations

import numpy as np

from fieldcalib._types import Array, BoolArray
from fieldcalib.fields.field import Field
from fieldcalib.geometry.camera import Camera
from fieldcalib.geometry.lens import RadialLens
from fieldcalib.problem.labelled_pixels import Pixels

IMAGE_SIZE = (960, 540)
PIXELS_PER_CIRCLE = 9
SHORTEST_SEGMENT = 15.0  # px: shorter visible parts of a marking are not labelled


def pan_over_field(count: int) -> list[Camera]:
    """Cameras on the main stand, with the usual lens, that follow the play from goal to goal.

    Examples
    --------
    >>> [round(float(np.degrees(camera.angles[0]))) for camera in pan_over_field(3)]
    [-27, 1, 28]
    """
    C, lens = np.array([-1.0, 68.0, -17.0]), RadialLens(float(np.hypot(*IMAGE_SIZE) / 2.0))
    cameras = []
    for s in np.linspace(-1.0, 1.0, count):
        x, y, z = np.array([38.0 * s, -2.0 + 2.0 * np.cos(3.0 * s), 0.0]) - C  # from the camera to where it looks
        pan, tilt = np.arctan2(x, -y), np.arctan2(np.hypot(x, y), z)
        roll, f = np.radians(0.4) * np.sin(4.0 * s), 1000.0 + 420.0 * s * s + 60.0 * np.sin(5.0 * s)
        cameras.append(Camera.from_angles(pan, tilt, roll, f, C, IMAGE_SIZE, k=lens.to_opencv(lens.mean, f)))
    return cameras


def observe(
    camera: Camera, field: Field, rng: np.random.Generator, noise: float, pixels_per_line: tuple[int, int] = (2, 3)
) -> Pixels:
    """Simulate the labels of an annotator: a few pixels on every visible marking, with normal noise, inside the image.

    Parameters
    ----------
    camera : Camera
    field : Field
    rng : numpy.random.Generator
    noise : float
        Standard deviation in pixels along x and along y.
    pixels_per_line : (int, int)
        Least and largest number of pixels; both ends of the visible part are among them.

    Returns
    -------
    dict of str to (N, 2) array
        Labelled pixels, nine for each circle. Halves of a circle are not labelled, the whole is.

    Examples
    --------
    >>> from fieldcalib.fields.sports.soccer import soccer
    >>> camera = Camera.from_angles(0.0, np.radians(75), 0.0, 1500.0, C=(0, 56, -15), image_size=(960, 540))
    >>> pixels = observe(camera, soccer(), np.random.default_rng(0), noise=1.0)
    >>> sorted(pixels), len(pixels["Circle central"])
    (['Circle central', 'Middle line', 'Side line top'], 9)
    """
    margin = 3.0 * noise  # so that noise hardly ever moves a pixel out of the image
    pixels = {}
    for label, segment in field.markings.items():
        xy = camera.project(segment.sample(spacing=0.1))
        xy = xy[_inside(xy, margin, camera.image_size)]
        if label in field.half_labels or not len(xy) or np.max(np.ptp(xy, axis=0)) < SHORTEST_SEGMENT:
            continue
        if segment.is_arc:
            share = (np.arange(PIXELS_PER_CIRCLE) + 0.5) / PIXELS_PER_CIRCLE  # a circle has no ends
        else:
            share = np.linspace(0.0, 1.0, rng.integers(*pixels_per_line, endpoint=True))
        chosen = xy[np.rint(share * (len(xy) - 1)).astype(int)]
        labelled = chosen + rng.normal(0.0, noise, size=chosen.shape)
        pixels[label] = labelled[_inside(labelled, 0.0, camera.image_size)]
    return pixels


def _inside(xy: Array, margin: float, image_size: tuple[int, int]) -> BoolArray:
    return np.asarray(np.all((xy >= margin) & (xy <= np.array(image_size) - 1.0 - margin), axis=-1))
