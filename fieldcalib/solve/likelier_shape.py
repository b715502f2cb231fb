"""The shape of pictures from their labels: calibrated as they are and as squashed from 16:9, the likelier one is kept.

The hypotheses, their prior and their likelihood are those of `fieldcalib.problem.picture_shape`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from fieldcalib.assess.findings import SHAPE, WAS_SQUASHED, Finding, Verdict, What
from fieldcalib.assess.probability import MOST_MOVED, largest_move
from fieldcalib.assess.result import Calibration, found_of, in_picture, with_findings
from fieldcalib.fields.field import ObjectSegments
from fieldcalib.problem.labelled_pixels import ImageSegments, Pixels
from fieldcalib.problem.picture_shape import (
    WIDTHS,
    Declared,
    Placement,
    lacks_little,
    log_evidence,
    may_be_squashed,
    other_border,
    squash_log_odds,
)
from fieldcalib.solve.solver_options import CERTAIN

OUTSIDE = 0.02  # of the width: in 821 frames of SoccerNet and WC14 no pixel lies more than 0.01 outside
NEAR_LAST = 4  # px: whoever clicks the ends of lines clicks so near to the last column of a picture of usual width
MOST_RAISED = 0.1  # share of a camera's height, from which on another one that fits as well leaves the height open


def with_border_complaint(object_segments: ObjectSegments, frame: Pixels, calibration: Calibration) -> Calibration:
    """The calibration with the findings of `other_border` and of labels that lie outside the picture replaced.

    Only for labels that were set by hand: a line may be continued past the picture, but what is outside as a whole was
    not seen there.
    """
    others = tuple(one for one in found_of(calibration) if one.what not in (What.BORDER, What.OUTSIDE))
    if calibration.camera is not None and calibration.are_annotated:
        size, column = calibration.camera.image_size, other_border(object_segments, frame, calibration.camera)
        lines = {label: xy for label, xy in frame.items() if len(xy) and not object_segments[label].is_point}
        others += tuple(Finding(What.OUTSIDE, label, (px,)) for label, px in _outside(lines, size).items())
        if column is not None:
            width = min((one for one in WIDTHS if column < one <= column + NEAR_LAST), default=column + 1)
            others = (*others, Finding(What.BORDER, numbers=(column, size[0], width)))
    return calibration if others == found_of(calibration) else replace(calibration, _found=others)


def _outside(lines: Pixels, size: tuple[int, int]) -> dict[str, float]:
    """Distances from the picture of labels that lie outside it, pixels."""
    last, margin = np.subtract(size, 1), OUTSIDE * size[0]
    if not lines or np.all(np.abs(np.concatenate(list(lines.values())) - last / 2.0) <= last / 2.0 + margin):
        return {}
    beyond = {label: float(np.max((xy.min(axis=0) - last, -xy.max(axis=0)))) for label, xy in lines.items()}
    return {label: px for label, px in beyond.items() if px > margin}


def evidence_of(calibration: Calibration) -> float:
    """Log evidence of a calibration's labels (`log_evidence`); minus infinity without a camera."""
    if calibration.solved is None:
        return -np.inf
    uncertainty = calibration.solved.uncertainty
    return log_evidence(float(uncertainty.evaluation.cost[0]), uncertainty.information.matrix[0])


def likelier(as_it_is: Calibration, shown: Calibration, log_ratio: float, image_size: tuple[int, int]) -> Calibration:
    """The more likely of two calibrations of a picture: as it is, and stretched as if it had been squashed.

    It is doubted if the other one is nearly as likely. A picture that lacks at most a quarter of a frame is then taken
    as it is, if it is good and both agree: the other camera moves no place in view by more than half the field's
    tolerance. If they differ in height, only the ground is known. Whether the picture is whole or a part is open there
    too: the prior of its principal point allows for both, and its camera must be as sure as that of any picture of
    another shape.

    Parameters
    ----------
    as_it_is, shown : Calibration
        Calibrations in pixels of the picture, and in those of its frame if it was squashed (`Placement.squashed`).
    log_ratio : float
        Log evidence for `shown` minus that for `as_it_is`.
    image_size : (int, int)
        Width and height of the picture.
    """
    log_odds = log_ratio + squash_log_odds(image_size)
    is_sure = abs(log_odds) > CERTAIN
    only_one = not is_sure and shown.accepted != as_it_is.accepted
    squashed = in_picture(shown, Placement.whole(image_size).squashed, WAS_SQUASHED)
    is_squashed = shown.camera is not None and (shown.accepted if only_one else log_odds > 0.0)
    found = squashed if is_squashed else as_it_is
    compared, is_near = replace(as_it_is, declared=Declared.COMPARED), lacks_little(image_size)
    if is_near and is_sure and not is_squashed:
        return compared
    both_agree = is_near and not is_sure and _move_little(as_it_is, squashed)
    if both_agree and compared.verdict is Verdict.GOOD:
        z, other_z = (one.required_camera.C[2] for one in (as_it_is, squashed))
        is_raised = abs(other_z - z) > MOST_RAISED * abs(z)
        return in_picture(compared, Placement.whole(image_size), Finding(What.GROUND_ONLY)) if is_raised else compared
    if is_sure or not found.accepted or found.has_finding(What.SHAPE):
        return found
    return with_findings(found, SHAPE)


def _move_little(found: Calibration, other: Calibration) -> bool:
    """Whether another camera of a picture moves no place in view by more than half the field's tolerance."""
    if not found.accepted or found.camera is None or other.camera is None or found.field is None:
        return False
    field, ground = found.field, None if other.field is None else other.field.terrain
    return largest_move(found.camera, other.camera, field, ground) <= MOST_MOVED * field.tolerance


def with_likely_aspect(
    object_segments: ObjectSegments,
    calibrate: Callable[[Sequence[ImageSegments], tuple[int, int]], list[Calibration]],
    frames: Sequence[ImageSegments],
    image_size: tuple[int, int],
    *,
    estimated: bool,
) -> list[Calibration]:
    """Calibrate frames of one size, each as it is or stretched to 16:9, whichever its labels make more likely.

    Unless the aspect ratio is `estimated`, all are calibrated as they are. Whoever types the size of normalised pixels
    may exchange its sides: an upright picture that seems squashed is doubted, as hardly any frame is shown so narrow.
    """
    found = calibrate(frames, image_size)
    if not (estimated and may_be_squashed(image_size)):
        return found
    squashed = Placement.whole(image_size).squashed
    pixels = [{label: np.reshape(np.asarray(xy, float), (-1, 2)) for label, xy in frame.items()} for frame in frames]
    in_frame = [{label: squashed.to_frame(xy) for label, xy in one.items()} for one in pixels]
    chosen = [
        likelier(one, other, evidence_of(other) - evidence_of(one), image_size) if one.solved or other.solved else one
        for one, other in zip(found, calibrate(in_frame, squashed.frame_size), strict=True)
    ]
    if image_size[0] < image_size[1] and lacks_little(image_size[::-1]):
        exchanged = Finding(What.EXCHANGED_SIZE, numbers=image_size)
        chosen = [with_findings(one, exchanged) if WAS_SQUASHED in found_of(one) else one for one in chosen]
    return [with_border_complaint(object_segments, *pair) for pair in zip(pixels, chosen, strict=True)]
