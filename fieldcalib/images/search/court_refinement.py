"""Refinement of the cameras that a search proposes for a court, and the evidence of its hidden markings.

Proposed cameras are refined on the picture; a camera that refinement could not improve is at least fitted to the lines
at its markings, so that its errors are known (`with_errors`).

Markings may be hidden while other lines lie beside them (`with_hidden_markings`): the far side line of a hall is often
hidden by boards, or too thin, and the upper edge of the boards lies beside it. If the size of the court is fixed, a
camera fitted to the other markings determines where the hidden one is, to a few centimetres: a line further away than
that is not its paint. Of 39 cameras that were found by search with markings off their paint and a probability of 0.8 or
more, all were right (evidence of `data_tools.score_courts`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fieldcalib.assess.findings import Finding, Status, What
from fieldcalib.assess.paint_in_view import MarkingInView
from fieldcalib.assess.result import Calibration
from fieldcalib.fields.field import Field
from fieldcalib.geometry.camera import Camera
from fieldcalib.images.paint.detected_lines import calibrate_on_lines, detected_lines
from fieldcalib.images.paint.field_markings import Markings
from fieldcalib.images.refinement import Refined, ToRefine, refine_all
from fieldcalib.io.image import Image, size_of
from fieldcalib.solve.request import Task
from fieldcalib.solve.solver_options import pixel_unit

FARTHER = 5.0  # standard deviations of the projected marking, beyond which a line is not its paint
LEAST_OFF = 6.0  # px of a 960 x 540 image: nearer lines may be its paint, as lenses and courts differ from their models
STEP = 0.1  # m across a marking, to measure its scale in the picture

FOUND = Finding(What.SEARCHED)


def with_hidden_markings(calibration: Calibration) -> Calibration:
    """Remove hidden markings from the evidence against a camera that is sure.

    The calibration is returned unchanged if the court may have another size, or the camera's errors are not known.
    """
    field = calibration.field
    if not calibration.accepted or field is None or calibration.solved is None:
        return calibration
    if field.moves_with_size and not field.size_known:
        return calibration
    on_ground = [one for one in calibration.markings if one.label not in Markings.of(field).net]
    hidden = [one for one in on_ground if one.is_unseen or (one.is_beside and _is_other(calibration, one))]
    if not hidden or (len(hidden) > 1 and any(one.is_unseen for one in hidden)):  # bare ground in several places
        return calibration
    names = ", ".join(repr(one.label) for one in hidden)
    return replace(
        calibration,
        markings=tuple(
            replace(one, offset=0.0, is_bent=False, is_expected=False) if one in hidden else one
            for one in calibration.markings
        ),
        message=f"{calibration.message}; hidden or worn: {names}",
    )


def _is_other(calibration: Calibration, marking: MarkingInView) -> bool:
    """Whether the line beside a marking is further from it than the camera's errors allow."""
    assert calibration.field is not None
    camera, markings = calibration.required_camera, Markings.of(calibration.field)
    own = np.flatnonzero(markings.member == markings.labels.index(marking.label))
    X, across = markings.X[own], np.cross(markings.along[own], (0.0, 0.0, 1.0))
    xy = camera.project(X)
    seen = np.all((xy > 0.0) & (xy < camera.image_size), axis=1)  # false behind the camera
    if not np.any(seen):
        return False
    scale = np.linalg.norm(camera.project(X + STEP * across) - xy, axis=1)[seen] / STEP  # px per metre
    error = calibration.uncertainty.at_field(X[seen]).rms
    return bool(marking.offset - FARTHER * np.median(error * scale) > LEAST_OFF * pixel_unit(camera.image_size))


def refine_courts(task: Task, field: Field, image: Image, cameras: Sequence[Camera]) -> list[Refined]:
    """Refine the cameras that a search proposes on the picture; they may be of any size of it."""
    at_size = [camera.scaled(size_of(image)) for camera in cameras]
    nothing = Calibration(None, Status.ACCEPTED, str(FOUND), np.nan, np.nan, {}, field=field, _found=(FOUND,))
    started = [replace(nothing, camera=one) for one in at_size]
    return refine_all(task, Markings.of(field), [ToRefine(image, one) for one in started])


def with_errors(task: Task, field: Field, image: Image, refined: Sequence[Refined]) -> list[Refined]:
    """Fit the cameras that refinement could not improve to the detected lines, so that their errors are known.

    The lines may support a camera without a lens so well that no refined camera does better; its errors are then not
    known from refinement.
    """
    found, markings = list(refined), Markings.of(field)
    left = [k for k, one in enumerate(found) if one.calibration.solved is None and one.calibration.camera is not None]
    if left:
        cameras = [found[k].calibration.required_camera for k in left]
        lines = [detected_lines(image, camera, markings)[0] for camera in cameras]
        fitted = calibrate_on_lines(task, lines, size_of(image), cameras)
        for k, calibration in zip(left, fitted, strict=True):
            if calibration.accepted:
                found[k] = replace(found[k], calibration=calibration)
    return found
