"""Lines found in images, as labelled pixels with weights, and cameras fitted to them."""

from __future__ import annotations

from fieldcalib.assess.result import Calibration
from fieldcalib.geometry.camera import Camera
from fieldcalib.images.refinement import LOSS_SCALE, line_task
from fieldcalib.problem.losses import RobustLoss
from fieldcalib.solve.batch import calibrate_labels
from fieldcalib.solve.options import pixel_unit
from fieldcalib.solve.task import Task
from fieldcalib.solve.together import labels_of
from fieldcalib.solve.tripod import Labels


def line_loss(image_size: tuple[int, int]) -> RobustLoss:
    """The loss of lines that are detected in images of a size."""
    return RobustLoss("cauchy", LOSS_SCALE * pixel_unit(image_size))


def fitted_lines(calibration: Calibration) -> Labels:
    """The labelled pixels that the camera of a single image was fitted to, and the weight of each pixel."""
    assert calibration.solved is not None
    return labels_of(calibration.solved.alone.evaluation)


def per_label(labels: Labels) -> Labels:
    """Labels whose weights are those of the label, as arguments have them, instead of each pixel's."""
    pixels, weights = labels
    return pixels, {label: len(weight) * weight for label, weight in weights.items()}


def fitted_to_lines(
    task: Task, labels: Labels, image_size: tuple[int, int], camera: Camera | None = None
) -> Calibration:
    """A calibration from the lines of one image, from a camera near them or from anywhere."""
    pixels, weights = per_label(labels)
    cameras = None if camera is None else [camera]
    (found,) = calibrate_labels(line_task(task, image_size), [pixels], image_size, [weights], cameras=cameras)
    return found
