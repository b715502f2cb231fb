"""Detection of pixels that belong to an image of another size, such as one resized for a network."""

from __future__ import annotations

import numpy as np

from fieldcalib._types import Array

LEAST_PIXELS = 6
# Shares of width and height to which the farthest pixels on markings reach. Labelled lines of all of 821 broadcast
# frames reach to 0.79 or more in one of the two, key points of 443 of 451 frames to 0.6; none lies past 1.03.
LEAST_REACH, FARTHEST_REACH = 0.6, 1.05


def hint_of_another_size(farthest: Array, count: int, image_size: tuple[int, int]) -> str:
    """Warning about pixels that fill only a part of their image, or lie beyond it; empty for other pixels.

    Parameters
    ----------
    farthest : (2,) array
        Largest x and largest y of the pixels.
    count : int
        Number of pixels; there is no warning about few.
    image_size : (int, int)
        Width and height of the image.

    Examples
    --------
    >>> hint_of_another_size(np.array([636.0, 588.0]), 12, (1920, 1080))
    'they reach to (636, 588) in an image of 1920 x 1080: were they found in one of another size, as 640 x 640?'
    >>> hint_of_another_size(np.array([1730.0, 588.0]), 12, (1920, 1080))
    ''
    """
    reach = np.divide(farthest, image_size)
    if count < LEAST_PIXELS or not (np.all(reach < LEAST_REACH) or np.any(reach > FARTHEST_REACH)):
        return ""
    (x, y), (width, height) = np.round(farthest).astype(int).tolist(), image_size
    return (
        f"they reach to ({x}, {y}) in an image of {width} x {height}: were they found in one of another size, as "
        f"640 x 640?"
    )
