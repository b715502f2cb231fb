"""The camera of an image on a field of the size that the image shows, where sizes vary."""

from __future__ import annotations

from dataclasses import replace

from fieldcalib.assess.result import Calibration
from fieldcalib.fields.field import Field
from fieldcalib.geometry.camera import Camera
from fieldcalib.images.paint.detected_lines import SEARCH_RANGES, calibrate_on_lines
from fieldcalib.images.paint.field_markings import Markings
from fieldcalib.images.refinement import Refined, ToRefine, refine_all
from fieldcalib.io.image import Image, size_of
from fieldcalib.problem.pixel_table import NO_PIXELS, PixelTable
from fieldcalib.solve.field_size import with_size_from_labels
from fieldcalib.solve.request import Task


def on_field_as_seen(
    task: Task, image: Image, calibration: Calibration, found: PixelTable = NO_PIXELS
) -> Refined | None:
    """The camera refined on a field of the size that its image determines; None if the given size is likely.

    Parameters
    ----------
    task : Task
    image : (height, width, 3) uint8 array
        Blue, green, red.
    calibration : Calibration
        Calibration of the image on the given field.
    found : PixelTable
        Pixels that a network labelled.
    """
    seen: list[Refined] = []

    def again(field: Field, camera: Camera) -> Calibration:
        start = replace(calibration, camera=camera, field=field)
        seen.append(_on_another_field(replace(task, object_segments=field), image, found, calibration, start))
        return seen[0].calibration

    sized = with_size_from_labels(calibration, again)
    return None if sized is calibration or sized.field is None else replace(seen[0], calibration=sized)


def _on_another_field(task: Task, image: Image, found: PixelTable, before: Calibration, start: Calibration) -> Refined:
    """Refine the camera of an image on a field of another size, starting from a camera that fits its lines."""
    given = ToRefine(image, start, found, are_detected=True)
    (again,) = refine_all(task, Markings.of(task.object_segments), [given], SEARCH_RANGES[-1:])
    if again.calibration is not start:
        return again
    # the lines found anew do not support a better camera: fit the lines found before
    assert before.solved is not None
    (fitted,) = calibrate_on_lines(task, [before.solved.pixels], size_of(image), [start.required_camera])
    return replace(again, calibration=fitted)
