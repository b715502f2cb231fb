"""The camera that follows from marks in a picture whose pixels may not be square.

A picture of another shape than 16:9 is a whole frame or a part of one with square pixels, or a frame that was squashed.
Where a person has not said at which aspect it is shown, its camera is fitted as it is and as shown at 16:9, and the one
is taken that marks and lines make more likely (`fieldcalib.solve.squashed_pictures`).
"""

from __future__ import annotations

from dataclasses import replace

from fieldcalib.assess.placement import Placement
from fieldcalib.assess.result import Calibration
from fieldcalib.assess.whole_picture import Declared
from fieldcalib.editor.fitting import fitted
from fieldcalib.editor.known import Known
from fieldcalib.editor.marks import Marks
from fieldcalib.fields.field import Field
from fieldcalib.images.shape.borders_and_squash import log_ratio_of_squash
from fieldcalib.io.image import Image, size_of
from fieldcalib.solve.squashed_pictures import likelier, may_be_squashed, shown_size
from fieldcalib.solve.task import GivenCamera, Task


def fitted_in_shape(field: Field, image: Image, marks: Marks, known: Known) -> Calibration:
    """The camera that follows from marks, in pixels of the picture, see `fitted`; its errors stay in the frame's."""
    size = size_of(image)
    placement = known.placement(size)
    found = _fitted_in_frame(field, image, marks, known, placement)
    if known.aspect is not None:
        return replace(placement.from_frame(found), declared=Declared.PIXELS)
    if not (field.stands and may_be_squashed(size)):  # without a prior the shapes cannot be compared
        return found
    as_shown = Placement(size, shown_size(size), None)
    shown = _fitted_in_frame(field, image, marks, known, as_shown)
    if found.solved is None and shown.solved is None:
        return found
    ratio = log_ratio_of_squash(_task(field, known, placement), found, shown, _task(field, known, as_shown))
    return likelier(found, shown, ratio, size)


def _fitted_in_frame(field: Field, image: Image, marks: Marks, known: Known, placement: Placement) -> Calibration:
    """The camera of the frame in which a picture lies."""
    if not placement.is_whole:
        image, marks = placement.image_in_frame(image), marks.scaled(placement.scale)
    return fitted(field, image, marks, known.arguments(placement))


def _task(field: Field, known: Known, placement: Placement) -> Task:
    arguments = known.arguments(placement)
    flags = arguments.pop("flags")
    return Task(field, GivenCamera(**arguments), flags)
