"""From images to cameras: labelled pixels by a network, a calibration, and its refinement on the image."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

from fieldcalib.calibrate import calibrate_batch
from fieldcalib.field import ObjectSegments
from fieldcalib.hypotheses import calibrate_from_consensus
from fieldcalib.image import Image
from fieldcalib.localize import Localization, Network, localize
from fieldcalib.options import ALL, DEFAULT_FLAGS, Prior
from fieldcalib.profiles import Markings
from fieldcalib.refine import agreement, refine_on_image
from fieldcalib.result import Calibration, Status

LEAST_PROBABILITY = 0.5  # that the camera is right everywhere in view, else it is more probably wrong,
METRES, METRES_REFINED = 3.0, 1.0  # to this much
LEAST_AGREEMENT = 0.2  # of an image with a camera; right cameras had 0.34 and more, even on frames 256 pixels wide


def calibrate_from_images(
    object_segments: ObjectSegments,
    images: Sequence[Image],
    network: Network,
    *,
    flags: int = DEFAULT_FLAGS,
    prior: Prior = ALL,
    refine: bool = True,
) -> list[Calibration]:
    """Calibrate a camera for each of several images.

    Parameters
    ----------
    object_segments : mapping of str to segment
        The calibration object that the network was trained for, e.g. `soccer()`.
    images : sequence of (height, width, 3) uint8 arrays
        Blue, green, red; of any sizes. All are in memory at once: give a long video in parts.
    network : Network
        Finds the markings, e.g. `SegmentationNetwork.load()`.
    flags, prior
        As in `calibrate_from_segments`, for all images alike.
    refine : bool
        Whether white lines are looked for in the images (`refine_on_image`): nearer to the truth, at twice the time.

    Returns
    -------
    list of Calibration
        One an image. An image that cannot be calibrated is no error: see `status` and `message`. A camera is "probably
        wrong" if the image shows no lines where it has the markings.

    Raises
    ------
    ValueError
        As `localize` and `calibrate_from_segments`.

    Examples
    --------
    >>> import numpy as np
    >>> from fieldcalib import soccer
    >>> class Blind:
    ...     classes = ("background", "Middle line")
    ...     def __call__(self, images):
    ...         return np.zeros((len(images), 2, 90, 160), np.float32)
    >>> (calibration,) = calibrate_from_images(soccer(), [np.zeros((540, 960, 3), np.uint8)], Blind())
    >>> str(calibration.status), calibration.message
    ('too few segments', 'no labelled pixels: nothing to calibrate from')
    """
    found = localize(object_segments, images, network)
    by_size: dict[tuple[int, int], list[int]] = {}
    for index, image in enumerate(images):
        by_size.setdefault((image.shape[1], image.shape[0]), []).append(index)
    calibrations: dict[int, Calibration] = {}
    for size, members in by_size.items():
        parts = [found[index] for index in members]
        from_labels = calibrate_batch(
            object_segments,
            [part.pixels for part in parts],
            size,
            flags=flags,
            prior=prior,
            weights=[part.weights for part in parts],
            trust_labels=True,
        )
        for index, part, first in zip(members, parts, from_labels, strict=True):
            look = partial(_looked_at, object_segments, images[index], part, flags=flags, prior=prior, refine=refine)
            calibration = look(first)
            if not calibration.accepted:
                others = calibrate_from_consensus(object_segments, images[index], part, flags=flags, prior=prior)
                calibration = next((other for other in map(look, others) if other.accepted), calibration)
            calibrations[index] = calibration
    return [calibrations[index] for index in range(len(images))]


def _looked_at(
    object_segments: ObjectSegments,
    image: Image,
    found: Localization,
    calibration: Calibration,
    *,
    flags: int,
    prior: Prior,
    refine: bool,
) -> Calibration:
    """The calibration refined, and probably wrong where its image or its probability says so."""
    refined = calibration
    if refine:
        refined = refine_on_image(
            object_segments, image, calibration, found.pixels, weights=found.weights, flags=flags, prior=prior
        )
    if refined.camera is None or not refined.accepted:
        return refined
    if refined is calibration:  # otherwise the image agrees with it
        share = agreement(image, refined.camera, Markings.of(object_segments))
        if share < LEAST_AGREEMENT:
            doubt = f"the image shows lines at {100.0 * share:.0f} % of the markings in view"
            return replace(refined, status=Status.IMPROBABLE, message=f"{doubt}; {refined.message}")
    if refined.field is None:
        return refined
    return refined.doubted(LEAST_PROBABILITY, METRES if refined is calibration else METRES_REFINED)
