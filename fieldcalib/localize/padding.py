"""Padding of narrow pictures for a network that was trained on broadcast frames.

A network takes pictures of any shape, squashed or stretched to its input. A 9:16 window of a broadcast, stretched to
three times its width, shows markings at angles that no broadcast has. So such a picture is continued on both sides.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fieldcalib._types import Float32
from fieldcalib.io.image import Image
from fieldcalib.localize.flow import Network

# Of 35 frames of a 9:16 window, stretched 1 has an accepted camera, continued to 4:5, 1:1, 4:3 and 16:9 it is 6 to 10.
SHAPE = 4.0 / 3.0  # width by height, to which narrower pictures are continued
EDGE = 8  # px at a side, whose mean continues it: single pixels of players and paint would make long stripes


@dataclass(frozen=True)
class Padded:
    """A network for pictures with square pixels that pads narrow ones on both sides.

    Examples
    --------
    >>> class Bright:
    ...     classes = ("background", "Middle line")
    ...     def __call__(self, images):
    ...         mean = np.array([image.reshape(90, 4, 160, -1, 3).mean(axis=(1, 3, 4)) for image in images]) / 255.0
    ...         return np.stack([1.0 - mean, mean], axis=1).astype(np.float32)
    >>> portrait = np.zeros((360, 240, 3), np.uint8)
    >>> portrait[:, :120] = 255  # the network sees 480 columns
    >>> Padded(Bright())([portrait])[0, 1, 0, [0, -1]].round(1)
    array([1., 0.], dtype=float32)
    """

    network: Network

    @property
    def classes(self) -> Sequence[str]:
        """Class of each probability map."""
        return self.network.classes

    def __call__(self, images: Sequence[Image]) -> Float32:
        """Class probabilities of images of one size, on a grid that covers each of them."""
        height, width = images[0].shape[:2]
        missing = max(round(SHAPE * height) - width, 0)
        if not missing:
            return self.network(images)
        left, whole = missing // 2, width + missing
        found = self.network([_continued(image, left, missing - left) for image in images])
        columns = found.shape[-1]
        kept = -(-columns * width // whole)
        x = columns / whole * (left + width * (np.arange(kept) + 0.5) / kept) - 0.5
        below = np.clip(np.floor(x).astype(np.intp), 0, columns - 2)
        share = (x - below).astype(np.float32)
        return np.asarray((1.0 - share) * found[..., below] + share * found[..., below + 1], dtype=np.float32)


def _continued(image: Image, left: int, right: int) -> Image:
    """A picture with columns added at both sides."""
    sides = (np.mean(image[:, part], axis=1, keepdims=True).round() for part in (slice(None, EDGE), slice(-EDGE, None)))
    first, last = (np.repeat(side, count, axis=1) for side, count in zip(sides, (left, right), strict=True))
    return np.concatenate([first, image, last], axis=1).astype(np.uint8)
