"""Cameras from a few segments each, for an image whose segments do not fit together.

Hypothesise and verify, with the image as the judge: a network that takes a mowing pattern for a penalty area does so
for several of its lines, and these agree with one another, though not with the white lines.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import combinations

import numpy as np

from fieldcalib.assess.result import Calibration
from fieldcalib.calibrate.from_homography import judged_camera
from fieldcalib.calibrate.from_segments import calibrate_batch
from fieldcalib.calibrate.options import Prior, pixel_unit
from fieldcalib.fields.segments import ObjectSegments
from fieldcalib.geometry.camera import Camera
from fieldcalib.images.line_profiles import Markings
from fieldcalib.images.refinement import REACHES, agreement
from fieldcalib.io.image import Image
from fieldcalib.localize import Localization

HEAVIEST = 5  # segments, by the weight of their pixels
OF_EACH = 3  # of them in a hypothesis: 10 hypotheses
LOOKED_AT = 2  # of these


def calibrate_from_consensus(
    object_segments: ObjectSegments,
    image: Image,
    found: Localization,
    *,
    flags: int,
    prior: Prior,
) -> list[Calibration]:
    """Calibrate from those labelled pixels that agree with the lines in the image; several answers, the best first.

    A camera is calibrated from every three of the heaviest segments. For each of the few that the image agrees with
    most, the segments within 12 px (in an image of 960x540) are kept and calibrated from.

    Parameters
    ----------
    object_segments : mapping of str to segment
        The calibration object.
    image : (height, width, 3) uint8 array
        Blue, green, red.
    found : Localization
        Labelled pixels of the image.
    flags, prior
        As in `calibrate_from_segments`.

    Returns
    -------
    list of Calibration
        Empty where there are too few segments to choose from.

    References
    ----------
    Fischler, Bolles: Random Sample Consensus, Communications of the ACM 24 (1981).
    """
    weight = found.weight
    heaviest = sorted(weight, key=lambda label: -weight[label])[:HEAVIEST]
    if len(heaviest) <= OF_EACH:
        return []
    size = image.shape[1], image.shape[0]
    markings = Markings.of(object_segments)

    def calibrated(chosen: Iterable[Iterable[str]]) -> list[Calibration]:
        parts = [found.only(labels) for labels in chosen]
        return calibrate_localized(object_segments, parts, size, flags=flags, prior=prior)

    hypotheses = [hypothesis.camera for hypothesis in calibrated(combinations(heaviest, OF_EACH))]
    cameras = [camera for camera in hypotheses if camera is not None]
    share = [agreement(image, camera, markings, max(REACHES)) for camera in cameras]
    best = [cameras[index] for index in np.argsort(share)[::-1][:LOOKED_AT]]
    return calibrated(dict.fromkeys(near_labels(object_segments, camera, found) for camera in best))


def calibrate_localized(
    object_segments: ObjectSegments, parts: Sequence[Localization], size: tuple[int, int], *, flags: int, prior: Prior
) -> list[Calibration]:
    """The cameras of the labelled pixels of several images of one size: `calibrate_batch`, which trusts the labels."""
    return calibrate_batch(
        object_segments,
        [part.pixels for part in parts],
        size,
        flags=flags,
        prior=prior,
        weights=[part.weights for part in parts],
        trust_labels=True,
    )


def near_labels(object_segments: ObjectSegments, camera: Camera, found: Localization) -> tuple[str, ...]:
    """Labels whose pixels lie within 12 px (in an image of 960x540) of their segments, root mean square."""
    errors = judged_camera(camera, object_segments, found.pixels, "").per_segment_errors
    return tuple(label for label, px in errors.items() if px < max(REACHES) * pixel_unit(camera.image_size))
