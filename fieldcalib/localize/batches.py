"""Labelled pixels of images: the network is run, then points are selected."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from functools import partial
from typing import Protocol, TypeAlias

from fieldcalib._checks import named
from fieldcalib._types import Float32
from fieldcalib.fields.segments import ObjectSegments
from fieldcalib.io.image import Image, each_checked, size_of
from fieldcalib.io.image_files import IMAGES_AT_ONCE, in_parts
from fieldcalib.localize.network_grid import Localization
from fieldcalib.localize.point_selection import ridge_points
from fieldcalib.problem.labelled_pixels import check_object
from fieldcalib.processes.jobs import in_order

PointSelection: TypeAlias = Callable[[Float32, Sequence[str], ObjectSegments, tuple[int, int]], Localization]


class Network(Protocol):
    """`SegmentationNetwork`, or anything else that gives class probabilities of images."""

    @property
    def classes(self) -> Sequence[str]:
        """Class of each probability map: a segment of the object or "background"."""

    def __call__(self, images: Sequence[Image]) -> Float32:
        """Probabilities (N, K, h, w) of the K classes, on a grid that covers each of N images."""


def check_network(network: object) -> None:
    """Raise a ValueError if an object is no `Network`."""
    if isinstance(network, type) or not callable(network) or not hasattr(network, "classes"):
        raise ValueError(f"expected a network, as SegmentationNetwork.load(path) returns it, got {network!r}")


def localize(
    object_segments: ObjectSegments,
    images: Iterable[Image],
    network: Network,
    *,
    select: PointSelection = ridge_points,
    executor: Executor | None = None,
) -> list[Localization]:
    """Labelled pixels of images.

    Parameters
    ----------
    object_segments : mapping of str to segment
        The calibration object that the network was trained for, e.g. `soccer()`.
    images : iterable of (height, width, 3) uint8 arrays
        Blue, green, red; of any sizes. The network gets `IMAGES_AT_ONCE` of them in one call.
    network : Network
        A `SegmentationNetwork`, or any other source of class probabilities.
    select : callable
        `ridge_points`, or `skeleton_points` as in the paper.
    executor : concurrent.futures.Executor, optional
        Runs the work on the images, as in `calibrate_from_images`.

    Returns
    -------
    list of Localization
        One per image; empty where nothing is detected.

    Raises
    ------
    ValueError
        If an image is not such an array, the images are not in a list, a class is not a segment of the object, or
        `object_segments` or `network` has a wrong type.

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
    check_object(object_segments)
    check_network(network)
    if not callable(select):
        raise ValueError(f"select must be a function, as fieldcalib.localize.ridge_points, got {named(select)}")
    of_part = partial(_localized, object_segments, network=network, select=select)
    parts = in_parts(each_checked(images), IMAGES_AT_ONCE, lambda image: image.shape[0] * image.shape[1])
    return [found for part in in_order(executor, of_part, parts) for found in part]


def _localized(
    object_segments: ObjectSegments, images: Sequence[Image], *, network: Network, select: PointSelection
) -> list[Localization]:
    """Labelled pixels of the images that the network gets in one call."""
    return [
        select(probability, network.classes, object_segments, size_of(image))
        for image, probability in zip(images, network(images), strict=True)
    ]
