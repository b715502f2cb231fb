"""Images: OpenCV's uint8 arrays (height, width, 3) in blue, green, red."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Image: TypeAlias = NDArray[np.uint8]


def size_of(image: Image) -> tuple[int, int]:
    """Width and height in pixels."""
    return image.shape[1], image.shape[0]


def checked_image(image: Any, image_size: tuple[int, int] | None = None) -> Image:
    """The image as an array, or a ValueError that says what is wrong with it.

    Parameters
    ----------
    image : (height, width, 3) uint8 array
        In OpenCV's order: blue, green, red. A picture of PIL will do.
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
    if isinstance(image, str | os.PathLike):
        path = os.fspath(image)
        raise ValueError(f"image must be an array (height, width, 3), got the path {path!r}; cv2.imread reads it")
    if hasattr(image, "getbands"):  # a picture of PIL, whose arrays are red, green, blue
        image = np.asarray(image.convert("RGB"))[..., ::-1]
    if isinstance(image, list | tuple):
        raise ValueError(f"image must be an array (height, width, 3) of uint8, got a {type(image).__name__}")
    array = np.asarray(image)
    if array.dtype == object or array.ndim < 2:
        raise ValueError(f"image must be an array (height, width, 3) of uint8, got {type(image).__name__}")
    if array.dtype != np.uint8:
        raise ValueError(
            f"image must be uint8, got {array.dtype}; for values in 0..1 pass (255 * image).round().astype(np.uint8)"
        )
    if array.ndim != 3 or array.shape[2] != 3 or not array.size:
        raise ValueError(
            f"image must be (height, width, 3) in blue, green, red, got shape {array.shape}; "
            f"{_remedy_for(array.shape)} makes it so"
        )
    if image_size is not None and array.shape[1::-1] != image_size:
        width, height = array.shape[1::-1]
        raise ValueError(
            f"image must have the camera's size, {image_size[0]} x {image_size[1]}, got {width} x {height}; "
            f"pass camera.scaled(({width}, {height})) or resize the image"
        )
    return array


def _remedy_for(shape: tuple[int, ...]) -> str:
    """What makes an image of an array of another shape."""
    if 0 in shape:
        return "a picture with pixels"
    if len(shape) == 3 and shape[0] == 3:
        return "image.transpose(1, 2, 0)"
    return "cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) or cv2.COLOR_BGRA2BGR"


def each_checked(images: Iterable[Any]) -> Iterator[Image]:
    """Check several images by `checked_image`, each when it is asked for.

    Examples
    --------
    >>> len(list(each_checked(np.zeros((540, 960, 3), np.uint8) for _ in range(2))))
    2
    """
    if isinstance(images, np.ndarray) and images.ndim < 4:
        raise ValueError(f"expected a list of images, got one array of shape {images.shape}: give [image]")
    if isinstance(images, str | os.PathLike) or not isinstance(images, Iterable):
        raise ValueError(f"expected a list of images, got {images!r}")
    return map(checked_image, images)
