"""Images to labelled pixels: the network, then the selection of points."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Protocol, TypeAlias

from fieldcalib._types import Float32
from fieldcalib.fields.segments import ObjectSegments
from fieldcalib.io.image import Image, checked_images
from fieldcalib.localize.grid import Localization
from fieldcalib.localize.ridges import ridge_points

PointSelection: TypeAlias = Callable[[Float32, Sequence[str], ObjectSegments, tuple[int, int]], Localization]


class Network(Protocol):
    """`SegmentationNetwork`, or anything that says of every pixel which segment it shows."""

    @property
    def classes(self) -> Sequence[str]:
        """What each map stands for: a segment of the object or "background"."""

    def __call__(self, images: Sequence[Image]) -> Float32:
        """Probabilities (N, K, h, w) of the K classes, on a grid over each of N images."""


def localize(
    object_segments: ObjectSegments,
    images: Iterable[Image],
    network: Network,
    *,
    select: PointSelection = ridge_points,
) -> list[Localization]:
    """Labelled pixels of images.

    Parameters
    ----------
    object_segments : mapping of str to segment
        The calibration object that the network was trained for, e.g. `soccer()`.
    images : iterable of (height, width, 3) uint8 arrays
        Blue, green, red; of any sizes. All go through the network at once.
    network : Network
        A `SegmentationNetwork`, or another source of class probabilities.
    select : callable
        `ridge_points`, or `skeleton_points` as in the paper.

    Returns
    -------
    list of Localization
        One an image. Where nothing is seen it is empty.

    Raises
    ------
    ValueError
        If an image is none, or is not in a list, or a class of the network is no segment of the object.

    Examples
    --------
    >>> import numpy as np
    >>> from fieldcalib import soccer
    >>> class Blind:
    ...     classes = ("background", "Middle line")
    ...     def __call__(self, images):
    ...         return np.zeros((len(images), 2, 90, 160), np.float32)
    >>> localize(soccer(), [np.zeros((540, 960, 3), np.uint8)], Blind())
    [Localization(pixels={}, weights={})]
    """
    images = checked_images(images)
    if not images:
        return []
    return [
        select(probability, network.classes, object_segments, (image.shape[1], image.shape[0]))
        for image, probability in zip(images, network(images), strict=True)
    ]
