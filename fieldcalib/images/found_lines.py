"""The lines that were found in an image, on a field of another size."""

from __future__ import annotations

from fieldcalib.assess.result import Calibration
from fieldcalib.fields.field import Field
from fieldcalib.geometry.camera import Camera
from fieldcalib.images.frame_lines import as_given
from fieldcalib.images.refinement import LOSS_SCALE
from fieldcalib.problem.losses import RobustLoss
from fieldcalib.solve.batch import calibrate_batch
from fieldcalib.solve.joint_problem import labels_of
from fieldcalib.solve.options import PAINT, Prior, pixel_unit


def on_found_lines(calibration: Calibration, field: Field, camera: Camera, *, flags: int, prior: Prior) -> Calibration:
    """A calibration from the same lines on a field of another size, from a camera that sees them there."""
    assert calibration.solved is not None
    pixels, weights = as_given(labels_of(calibration.solved.alone.evaluation))
    (found,) = calibrate_batch(
        field,
        [pixels],
        camera.image_size,
        cameras=[camera],
        flags=flags,
        prior=prior,
        loss=RobustLoss("cauchy", LOSS_SCALE * pixel_unit(camera.image_size)),
        weights=[weights],
        trust_labels=True,
        paint=PAINT,
    )
    return found
