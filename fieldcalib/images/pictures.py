"""Pictures that are not whole frames with square pixels, without anybody saying so.

Black borders are taken off. A picture of another shape than 16:9 is calibrated as it is and as it would be shown if it
had been squashed, and what the lines in it make more likely is given (`fieldcalib.solve.aspect`). A picture that is
doubted to be a whole frame is calibrated again as a part of one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np

from fieldcalib._json import from_json
from fieldcalib._types import Array
from fieldcalib.assess.result import Calibration
from fieldcalib.fields.segments import ObjectSegments
from fieldcalib.images.borders import shown_part
from fieldcalib.images.refinement import LOSS_SCALE
from fieldcalib.io.image import Image
from fieldcalib.problem.labelled_pixels import Pixels
from fieldcalib.problem.losses import RobustLoss
from fieldcalib.problem.records import problem_to_record
from fieldcalib.solve.aspect import log_evidence, may_be_squashed, shown_size, stretched, told
from fieldcalib.solve.batch import calibrate_batch
from fieldcalib.solve.options import PAINT, Prior, pixel_unit

Method = Callable[[Sequence[Image]], list[Calibration]]


def without_borders(calibrate: Method, images: Sequence[Image]) -> list[Calibration]:
    """What a method makes of the shown parts of pictures, with cameras in pixels of the whole pictures."""
    shown = [shown_part(image) for image in images]
    found = calibrate([one.part(image) for one, image in zip(shown, images, strict=True)])
    return [one.in_picture(calibration) for one, calibration in zip(shown, found, strict=True)]


def with_aspect_told(
    calibrate: Method, images: Sequence[Image], object_segments: ObjectSegments, *, flags: int, prior: Prior
) -> list[Calibration]:
    """What a method makes of pictures, of those of another shape than 16:9 as they are or as they would be shown."""
    found = calibrate(images)
    odd = [i for i, image in enumerate(images) if found[i].camera is not None and may_be_squashed(_size(image))]
    if not odd:
        return found
    others = calibrate([as_shown(images[index]) for index in odd])
    for index, shown in zip(odd, others, strict=True):
        size = _size(images[index])
        log_ratio = log_ratio_of_squash(object_segments, found[index], shown, flags=flags, prior=prior)
        found[index] = told(found[index], shown, log_ratio, size)
    return found


def log_ratio_of_squash(
    object_segments: ObjectSegments, as_it_is: Calibration, shown: Calibration, *, flags: int, prior: Prior
) -> float:
    """Log evidence that a picture was squashed, from the lines that were found in it as it is and as shown.

    Each way finds lines of its own, near those of its camera; both cameras are fitted to both.
    """
    if as_it_is.camera is None or shown.camera is None or as_it_is.solved is None or shown.solved is None:
        return 0.0
    calibrate = partial(_calibrated, object_segments, flags=flags, prior=prior)
    size, other = as_it_is.camera.image_size, shown.camera.image_size
    ratios = []
    for own in (as_it_is, shown):
        if not own.accepted or own.camera is None:
            continue
        pixels, weights = _fitted_to(own)
        one, two = (
            calibrate(stretched(pixels, np.divide(to, own.camera.image_size)), weights, to) for to in (size, other)
        )
        ratios.append(log_evidence(two) - log_evidence(one))
    return float(np.mean(ratios)) if ratios else 0.0


def _fitted_to(calibration: Calibration) -> tuple[Pixels, dict[str, Array]]:
    """The pixels of each label that a camera was fitted to, and the weight of each."""
    assert calibration.solved is not None
    solved = calibration.solved
    labels = problem_to_record(solved.evaluation.problem, solved.frame)["observations"]["labels"]
    pixels = {label: from_json(part["xy"]) for label, part in labels.items()}
    weights = {label: len(pixels[label]) * from_json(part["weight"]) for label, part in labels.items()}
    return pixels, weights


def _calibrated(
    object_segments: ObjectSegments,
    pixels: Pixels,
    weights: Mapping[str, Array],
    size: tuple[int, int],
    *,
    flags: int,
    prior: Prior,
) -> Calibration:
    (found,) = calibrate_batch(
        object_segments,
        [pixels],
        size,
        flags=flags,
        prior=prior,
        loss=RobustLoss("cauchy", LOSS_SCALE * pixel_unit(size)),
        weights=[weights],
        trust_labels=True,
        paint=PAINT,
    )
    return found


def _size(image: Image) -> tuple[int, int]:
    return image.shape[1], image.shape[0]


def as_shown(image: Image) -> Image:
    """A picture as it would be shown if it had been squashed."""
    import cv2

    size = shown_size(_size(image))
    # not cv2.resize, which maps corners of pixels: (0, 0) is the middle of the first one
    M = np.column_stack([np.diag(np.divide(size, _size(image))), (0.0, 0.0)])
    return np.asarray(cv2.warpAffine(image, M, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), np.uint8)
