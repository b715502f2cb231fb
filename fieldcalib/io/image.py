"""What an image is: OpenCV's uint8 array (height, width, 3) in blue, green, red."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Image: TypeAlias = NDArray[np.uint8]


def checked_image(image: Any, image_size: tuple[int, int] | None = None) -> Image:
    """The image as an array, or a ValueError that says what is wrong with it.

    Parameters
    ----------
    image : (height, width, 3) uint8 array
        In OpenCV's order: blue, green, red.
    image_size : (int, int), optional
        Width and height of the camera that goes with it.

    Examples
    --------
    >>> checked_image(np.zeros((540, 960), np.uint8))
    Traceback (most recent call last):
        ...
    ValueError: image must be (height, width, 3) in blue, green, red, got shape (540, 960); \
cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) or cv2.COLOR_BGRA2BGR makes it so
    """
    if image is None:
        raise ValueError("image is None: cv2.imread returns it for a file that is not there or cannot be read")
    array = np.asarray(image)
    if array.dtype != np.uint8:
        raise ValueError(
            f"image must be uint8, got {array.dtype}; for values in 0..1 pass (255 * image).round().astype(np.uint8)"
        )
    if array.ndim != 3 or array.shape[2] != 3 or not array.size:
        raise ValueError(
            f"image must be (height, width, 3) in blue, green, red, got shape {array.shape}; "
            f"cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) or cv2.COLOR_BGRA2BGR makes it so"
        )
    if image_size is not None and array.shape[1::-1] != image_size:
        width, height = array.shape[1::-1]
        raise ValueError(
            f"image must have the camera's size, {image_size[0]} x {image_size[1]}, got {width} x {height}; "
            f"pass camera.scaled(({width}, {height})) or resize the image"
        )
    return array
