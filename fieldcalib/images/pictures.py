"""Calibration of pictures that may have black borders or may have been squashed.

Black borders are taken off. A picture of another shape than 16:9 is calibrated as it is and as it would be shown if it
had been squashed, and the calibration that the lines in it make more likely is returned (`fieldcalib.solve.aspect`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from fieldcalib.assess.result import Calibration
from fieldcalib.images.borders import shape_within, shown_part
from fieldcalib.images.detected_lines import calibrate_on_lines
from fieldcalib.io.image import Image, size_of
from fieldcalib.solve.aspect import likelier, log_evidence, may_be_squashed, shown_size
from fieldcalib.solve.task import Task

Method = Callable[[Sequence[Image]], list[Calibration]]


def without_borders(calibrate: Method, images: Sequence[Image]) -> list[Calibration]:
    """Calibrate the parts of pictures between black borders, with cameras in pixels of the whole pictures."""
    shapes = [shape_within(shown_part(image)) for image in images]
    found = calibrate([shape.placement.image_in_frame(image) for shape, image in zip(shapes, images, strict=True)])
    return [
        one if shape.placement.is_whole else shape.in_picture(one) for shape, one in zip(shapes, found, strict=True)
    ]


def with_aspect_estimated(calibrate: Method, task: Task, images: Sequence[Image]) -> list[Calibration]:
    """Calibrate pictures; those of another shape than 16:9 as they are or as they would be shown if squashed."""
    found = calibrate(images)
    odd = [i for i, image in enumerate(images) if found[i].camera is not None and may_be_squashed(size_of(image))]
    if not odd:
        return found
    others = calibrate([as_shown(images[index]) for index in odd])
    for index, shown in zip(odd, others, strict=True):
        log_ratio = log_ratio_of_squash(task, found[index], shown)
        found[index] = likelier(found[index], shown, log_ratio, size_of(images[index]))
    return found


def log_ratio_of_squash(task: Task, as_it_is: Calibration, shown: Calibration) -> float:
    """Log evidence that a picture was squashed, from the lines that were found in it as it is and as shown.

    The camera of either shape has its own lines, found near its markings. Cameras of both shapes are fitted to both.
    """
    if as_it_is.camera is None or shown.camera is None or as_it_is.solved is None or shown.solved is None:
        return 0.0
    sizes = as_it_is.camera.image_size, shown.camera.image_size
    ratios = []
    for own in (as_it_is, shown):
        if not own.accepted or own.camera is None or own.solved is None:
            continue
        lines, own_size = own.solved.pixels, own.camera.image_size
        evidence, evidence_shown = (
            log_evidence(calibrate_on_lines(task, lines.scaled(np.divide(size, own_size)), size)[0]) for size in sizes
        )
        ratios.append(evidence_shown - evidence)
    return float(np.mean(ratios)) if ratios else 0.0


def as_shown(image: Image) -> Image:
    """A picture as it would be shown if it had been squashed."""
    import cv2

    size = shown_size(size_of(image))
    # not cv2.resize, which maps corners of pixels: (0, 0) is the middle of the first one
    M = np.column_stack([np.diag(np.divide(size, size_of(image))), (0.0, 0.0)])
    return np.asarray(cv2.warpAffine(image, M, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), np.uint8)
