"""Snapping of clicks to paint: the nearest middle of a light line, with subpixel accuracy.

A line is a ridge of lightness. At the scale of its width the second derivative across it is strongly negative, and the
zero of the first derivative along that direction is the middle of the line (Steger: An Unbiased Detector of Curvilinear
Structures, 1998, section 2).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib._types import Array, Float32, IntArray
from fieldcalib.io.image import Image
from fieldcalib.solve.options import pixel_unit

REACH = 8.0  # px of a 960 x 540 image: clicks are nearer than that
WIDTHS = (1.0, 2.0, 4.0)  # standard deviations of the blur, px of such an image: thin lines far off, broad ones near by
LEAST_CONTRAST = 6.0  # grey values by which the strongest line stands out, in its blurred second derivative
NEAR_MIDDLE = 0.75  # px from the middle of a line to a pixel that belongs to it
MARGIN = 4  # px around these: `NEAR_MIDDLE`, and the neighbours of two differences
LEAST_BLUR = 0.7  # px, for derivatives by differences of pixels
LARGEST_TURN = np.sin(np.radians(25.0))  # between a line and the direction that it is expected to have
# px of such an image: standard deviation of clicks, by which near lines are preferred to strong ones. Of clicks 2 px
# off on 103 markings of right frames 97 % are then within 3 px of their marking; where strength counts more, 10 px.
CLICK = 2.0


def snapped(image: Image, xy: ArrayLike, along: ArrayLike | None = None) -> Array:
    """The middle of the line nearest to a click, or the click where no line is near.

    Parameters
    ----------
    image : (height, width, 3) uint8 array
        Blue, green, red.
    xy : (2,) array_like
        The click, pixels.
    along : (2,) array_like, optional
        Direction of the line in the image, if it is known: lines across it are left out, as near a corner.

    Returns
    -------
    (2,) array

    Examples
    --------
    >>> image = np.full((540, 960, 3), (60, 140, 60), np.uint8)
    >>> image[:, 500:503] = 230
    >>> snapped(image, (498.2, 300.0)).round(1), snapped(image, (700.0, 300.0))
    (array([501., 300.]), array([700., 300.]))
    """
    import cv2

    click = np.asarray(xy, dtype=float)
    height, width = image.shape[:2]
    unit = pixel_unit((width, height))
    reach = REACH * unit
    near, end = _box(click, reach + MARGIN, (width, height))
    if np.any(end - near < 3):
        return click
    low, high = _box(click, reach + 4.0 * max(WIDTHS) * unit, (width, height))  # what the blur needs
    grey = cv2.cvtColor(image[low[1] : high[1], low[0] : high[0]], cv2.COLOR_BGR2GRAY).astype(np.float32)
    pixels = np.stack(np.meshgrid(np.arange(near[0], end[0]), np.arange(near[1], end[1])), axis=-1)
    rows, columns = (slice(near[axis] - low[axis], end[axis] - low[axis]) for axis in (1, 0))
    best, place = 0.0, click
    for scale in WIDTHS:
        sigma = max(scale * unit, LEAST_BLUR)
        blurred = np.asarray(cv2.GaussianBlur(grey, (0, 0), sigma, borderType=cv2.BORDER_REPLICATE), np.float32)
        middle, normal, strength = _ridge(blurred[rows, columns], sigma)
        distance = np.linalg.norm(pixels + middle - click, axis=-1)
        is_line = (np.linalg.norm(middle, axis=-1) < NEAR_MIDDLE) & (strength > LEAST_CONTRAST) & (distance <= reach)
        if along is not None:
            is_line &= np.abs(normal @ np.asarray(along, dtype=float)) < LARGEST_TURN * np.linalg.norm(along)
        nearness = np.exp(-0.5 * np.square(distance / (CLICK * unit)))
        weight = np.where(is_line, np.sqrt(np.maximum(strength, 0.0)) * nearness, 0.0)
        at = np.unravel_index(np.argmax(weight), weight.shape)
        if weight[at] > best:
            best, across = float(weight[at]), normal[at]
            # along the line the click stays where it is
            place = click + across * float((pixels[at] + middle[at] - click) @ across)
    return place


def _box(xy: Array, reach: float, size: tuple[int, int]) -> tuple[IntArray, IntArray]:
    """First pixel, and the one after the last, (2,) each, of the part of an image around a place."""
    margin = int(np.ceil(reach))
    corner = np.floor(xy).astype(int) - margin
    return np.maximum(corner, 0), np.minimum(corner + 2 * margin + 2, size)


def _ridge(blurred: Float32, sigma: float) -> tuple[Array, Array, Array]:
    """The middle of a light line from each pixel (h, w, 2), its normal (h, w, 2), and its strength in grey values.

    `sigma` is the standard deviation of the blur.
    """
    gy, gx = np.gradient(blurred)
    gyy, gyx = np.gradient(gy)
    gxx = np.gradient(gx, axis=1)
    # the eigenvector of the smaller eigenvalue of the symmetric matrix [[gxx, gyx], [gyx, gyy]]
    half, mean = np.hypot(0.5 * (gxx - gyy), gyx), 0.5 * (gxx + gyy)
    angle = 0.5 * np.arctan2(2.0 * gyx, gxx - gyy) + 0.5 * np.pi
    normal = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    across, bend = normal[..., 0] * gx + normal[..., 1] * gy, np.maximum(half - mean, 1e-9)
    return (across / bend)[..., None] * normal, normal, sigma**2 * (half - mean)
