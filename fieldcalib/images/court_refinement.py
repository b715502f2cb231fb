"""Refinement of the cameras that a search of a court proposes, and the errors of those that it leaves as they were."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fieldcalib.assess.result import Calibration
from fieldcalib.assess.words import Finding, Status, What
from fieldcalib.fields.field import Field
from fieldcalib.geometry.camera import Camera
from fieldcalib.images.detected_lines import calibrate_on_lines, detected_lines
from fieldcalib.images.field_markings import Markings
from fieldcalib.images.refinement import Refined, ToRefine, refine_all
from fieldcalib.io.image import Image, size_of
from fieldcalib.solve.task import Task

FOUND = Finding(What.SEARCHED)


def refine_courts(task: Task, field: Field, image: Image, cameras: Sequence[Camera]) -> list[Refined]:
    """Searched cameras of a picture, of any size of it, refined on it."""
    at_size = [camera.scaled(size_of(image)) for camera in cameras]
    nothing = Calibration(None, Status.ACCEPTED, str(FOUND), np.nan, np.nan, {}, field=field, _found=(FOUND,))
    started = [replace(nothing, camera=one) for one in at_size]
    return refine_all(task, Markings.of(field), [ToRefine(image, one) for one in started])


def with_errors(task: Task, field: Field, image: Image, refined: Sequence[Refined]) -> list[Refined]:
    """The cameras, those that refinement left as they were fitted to the lines at their markings.

    A camera without a lens may support the lines so well that no refined one does better, but its errors are not known.
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
