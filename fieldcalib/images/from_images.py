"""From images to cameras: labelled pixels by a network, a calibration, and its refinement on the image."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from fieldcalib.assess.result import Calibration, Status
from fieldcalib.calibrate.options import ALL, DEFAULT_FLAGS, Prior
from fieldcalib.fields.segments import ObjectSegments
from fieldcalib.geometry.camera import Camera
from fieldcalib.images.hypotheses import calibrate_from_consensus, calibrate_localized, near_labels
from fieldcalib.images.line_profiles import Markings
from fieldcalib.images.refinement import REACHES, agreement, refine_on_image
from fieldcalib.io.image import Image, checked_images
from fieldcalib.localize import Localization, Network, localize

FAINT = 0.7  # of the weight of a segment that is labelled by hand
LEAST_SEGMENTS = 3  # are enough for a camera; where there are fewer, faint ones must do
# How far an image agrees with a camera (`agreement`), and what share of the labels' weight the camera explains. Of
# refined cameras on broadcast frames, 1 in 80 is wrong where the image agrees so far that it is sure, else 1 in 5.
SURE_AGREEMENT, LEAST_EXPLAINED_SURE = 0.45, 0.5
LEAST_AGREEMENT, LEAST_EXPLAINED = 0.2, 0.75
LEAST_AGREEMENT_CHOSEN = 0.35  # where of several cameras the image chose one, it is bound to agree somewhat
LEAST_PROBABILITY = 0.5  # that the camera is right everywhere in view, else it is more probably wrong,
METRES, METRES_REFINED = 3.0, 1.0  # to this much


def calibrate_from_images(
    object_segments: ObjectSegments,
    images: Iterable[Image],
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
    images : iterable of (height, width, 3) uint8 arrays
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
        wrong" if the image shows no lines where it has the markings. Before an image is given up, cameras are tried
        that come from some of its segments only (`calibrate_from_consensus`).

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
    images = checked_images(images)
    found = [_without_faint(part) for part in localize(object_segments, images, network)]
    by_size: dict[tuple[int, int], list[int]] = {}
    for index, image in enumerate(images):
        by_size.setdefault((image.shape[1], image.shape[0]), []).append(index)
    markings = Markings.of(object_segments)
    calibrations: dict[int, Calibration] = {}
    for size, members in by_size.items():
        parts = [found[index] for index in members]
        from_labels = calibrate_localized(object_segments, parts, size, flags=flags, prior=prior)
        for index, part, first in zip(members, parts, from_labels, strict=True):
            look = partial(
                _looked_at, object_segments, markings, images[index], part, flags=flags, prior=prior, refine=refine
            )
            calibrations[index], is_sure = look(first, least_agreement=LEAST_AGREEMENT)
            if not is_sure:
                others = calibrate_from_consensus(object_segments, images[index], part, flags=flags, prior=prior)
                least = LEAST_AGREEMENT_CHOSEN if refine else LEAST_AGREEMENT
                looks = [calibrations[index], *(look(other, least_agreement=least)[0] for other in others)]
                calibrations[index] = _most_agreeing(markings, images[index], looks)
    return [calibrations[index] for index in range(len(images))]


def _without_faint(found: Localization) -> Localization:
    """Without what the network hardly saw: mostly it is nothing, and refinement finds the rest."""
    labels = [label for label, weight in found.weight.items() if weight >= FAINT]
    return found.only(labels) if len(labels) >= LEAST_SEGMENTS else found


def _looked_at(
    object_segments: ObjectSegments,
    markings: Markings,
    image: Image,
    found: Localization,
    calibration: Calibration,
    *,
    flags: int,
    prior: Prior,
    refine: bool,
    least_agreement: float,
) -> tuple[Calibration, bool]:
    """The calibration refined, probably wrong where its image or its probability says so; and whether that is sure."""
    if refine:
        calibration = refine_on_image(
            object_segments, image, calibration, found.pixels, weights=found.weights, flags=flags, prior=prior
        )
    if calibration.camera is None or not calibration.accepted:
        return calibration, False
    share = agreement(image, calibration.camera, markings)
    explained = _explained(object_segments, calibration.camera, found)
    is_sure = refine and share >= SURE_AGREEMENT and explained >= LEAST_EXPLAINED_SURE
    doubt = ""
    if share < least_agreement:
        doubt = f"the image shows lines at {100.0 * share:.0f} % of the markings in view"
    elif explained < LEAST_EXPLAINED and not is_sure:
        doubt = f"{100.0 * explained:.0f} % of what the network found lies where the camera has it"
    if doubt:
        return replace(calibration, status=Status.IMPROBABLE, message=f"{doubt}; {calibration.message}"), False
    if calibration.has_probability:
        calibration = calibration.doubted(LEAST_PROBABILITY, METRES_REFINED if refine else METRES)
    return calibration, calibration.accepted and (is_sure or not refine)


def _explained(object_segments: ObjectSegments, camera: Camera, found: Localization) -> float:
    """Share of the weight of labelled pixels that segments near their image under the camera have."""
    weight = found.weight
    near = near_labels(object_segments, camera, found)
    return sum(weight[label] for label in near) / max(sum(weight.values()), 1e-9)


def _most_agreeing(markings: Markings, image: Image, calibrations: Sequence[Calibration]) -> Calibration:
    """That which the image agrees with most of those that are accepted; the first if none is."""
    share = [
        agreement(image, one.camera, markings, max(REACHES)) if one.accepted and one.camera is not None else 0.0
        for one in calibrations
    ]
    return calibrations[int(np.argmax(share))]
