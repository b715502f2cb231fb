"""An image that a person labels: marks, what is known of the camera, and the camera that follows from both."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace
from dataclasses import field as attribute
from functools import cached_property
from html import escape
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib._types import Array
from fieldcalib.assess.findings import Status
from fieldcalib.assess.result import Calibration
from fieldcalib.draw.overlays import draw_calibration
from fieldcalib.draw.scene import image_curves
from fieldcalib.editor.advice import NextMark, click_errors, likely_labels, nearest_on, next_mark
from fieldcalib.editor.known import Known
from fieldcalib.editor.marks import FARTHEST, History, Marks
from fieldcalib.editor.picture_shape import fitted_in_shape
from fieldcalib.editor.snapping import snapped
from fieldcalib.fields.catalogue import field as field_by_name
from fieldcalib.fields.field import Field
from fieldcalib.fields.segments import Segment
from fieldcalib.io.image import Image, checked_image, size_of
from fieldcalib.io.images import at_most_wide, encode_image
from fieldcalib.problem.labelled_pixels import nearest_label
from fieldcalib.solve.options import pixel_unit

NOTEBOOK_WIDTH = 960  # px of a picture in a notebook
NEAR = 30.0  # px of a 960 x 540 image: projected markings that near are those clicked on; other marks are farther away


@dataclass(frozen=True)
class Edit:
    """What is said about an image."""

    marks: Marks = attribute(default_factory=Marks)
    known: Known = attribute(default_factory=Known)
    automatic: bool = False
    """Whether it was found without a person: marks of a network, and a camera that does not follow from them alone."""


@dataclass(frozen=True, eq=False)
class FrameEditor:
    """An image with marks, and the camera that follows from them. Each change gives a new editor.

    Parameters
    ----------
    image : (height, width, 3) uint8 array
        Blue, green, red.
    field : Field
    history : History of Edit
        Marks and known values, now and before.
    base : Calibration, optional
        The camera that was found without a person.
    found : Calibration, optional
        The camera that follows from the marks, where it is known already.

    Examples
    --------
    >>> from fieldcalib import Camera, soccer
    >>> from fieldcalib.draw.scene import render_field
    >>> truth = Camera.from_angles(-0.3, 1.35, 0.0, 1600.0, (0.0, 68.0, -17.0), (960, 540))
    >>> editor = FrameEditor.of(render_field(truth, soccer()))
    >>> for label in ("Side line left", "Side line top", "Big rect. left main", "Big rect. left top"):
    ...     ends = truth.project(soccer()[label].sample(3.0))
    ...     inside = ends[((ends > 5.0) & (ends < (955.0, 535.0))).all(axis=1)]
    ...     editor = editor.mark(label, inside[[0, -1]] + (1.5, -1.5))
    >>> editor
    FrameEditor(960x540 pixels, 8 marks of 4 markings)
    >>> str(editor.calibration.status), round(float(np.linalg.norm(editor.calibration.camera.C - truth.C))) < 5
    ('accepted', True)
    >>> editor.undo().undo().calibration.camera is None, editor.undo().redo().marks == editor.marks
    (False, True)
    """

    image: Image
    field: Field
    history: History[Edit]
    base: Calibration | None = None
    """The camera that was found without a person."""
    found: Calibration | None = None
    """The camera that follows from the marks, where it is known already."""

    def __repr__(self) -> str:
        width, height = size_of(self.image)
        return f"FrameEditor({width}x{height} pixels, {len(self.marks)} marks of {len(self.marks.pixels)} markings)"

    @classmethod
    def of(
        cls,
        image: ArrayLike,
        field: Field | str = "soccer",
        pixels: Mapping[str, Iterable[Iterable[float]]] | None = None,
        known: Known | None = None,
    ) -> FrameEditor:
        """Begin with an image, the name of a sport or a field, and pixels that are labelled already.

        Raises
        ------
        ValueError
            If the image is not uint8 with three channels, or a label is not one of the field.
        """
        of_field = field_by_name(field) if isinstance(field, str) else field
        marks = Marks.of(pixels or {})
        for label in marks.pixels:
            _check_label(label, of_field)
        return cls(checked_image(image), of_field, History(Edit(marks, known or Known())))

    @property
    def marks(self) -> Marks:
        """The marks."""
        return self.history.present.marks

    @property
    def known(self) -> Known:
        """Known values of camera and field."""
        return self.history.present.known

    @cached_property
    def calibration(self) -> Calibration:
        """The camera that follows from the marks, refined on the image where that agrees with them.

        Until a person changes something, the one that was found without.
        """
        if self.is_automatic and self.base is not None:
            return self.base
        if self.found is not None:
            return self.found
        try:
            field = self.known.of(self.field)
            return fitted_in_shape(field, self.image, self.marks.of_field(self.field), self.known)
        except ValueError as error:  # what is known of another field than this one, and the like
            return Calibration.without_camera(Status.TOO_FEW_SEGMENTS, str(error))

    @property
    def is_automatic(self) -> bool:
        """Whether a person has changed nothing, or has taken all back."""
        return self.history.present.automatic

    def mark(self, label: str, xy: ArrayLike, *, snap: bool = True) -> FrameEditor:
        """Set marks of a label at pixels (2,) or (N, 2), snapped to paint."""
        _check_label(label, self.field)
        clicks = np.reshape(np.asarray(xy, dtype=float), (-1, 2))
        return self._then(marks=self.marks.added(label, [self.place(label, one, snap=snap) for one in clicks]))

    def move(self, to: Mapping[int, ArrayLike], *, snap: bool = True) -> FrameEditor:
        """Drag marks, by their numbers, to other pixels."""
        labels = [one.label for one in self.marks.all]
        places = {
            number: self.place(labels[number] if 0 <= number < len(labels) else "", xy, snap=snap)
            for number, xy in to.items()
        }
        return self._then(marks=self.marks.moved(places))

    def relabel(self, numbers: Collection[int], label: str) -> FrameEditor:
        """Give marks another label."""
        _check_label(label, self.field)
        return self._then(marks=self.marks.relabelled(numbers, label))

    def remove(self, numbers: Collection[int]) -> FrameEditor:
        """Remove marks."""
        return self._then(marks=self.marks.without(numbers))

    def clear(self) -> FrameEditor:
        """Remove all marks, to label the image from nothing."""
        return self._then(marks=Marks())

    def know(self, **values: Any) -> FrameEditor:
        """Set known values, see `Known`; None lets them be estimated.

        Raises
        ------
        ValueError
            If a value cannot be, or the field cannot have that size.
        """
        known = replace(self.known, **values)
        known.of(self.field)
        return self._then(known=known)

    def with_marks(self, marks: Marks) -> FrameEditor:
        """Replace all marks."""
        for label in marks.pixels:
            _check_label(label, self.field)
        return self._then(marks=marks)

    def automatic(self, marks: Marks) -> FrameEditor:
        """Go back to the camera that was found without a person, and to the marks of the network."""
        edit = replace(self.history.present, marks=marks, known=Known(), automatic=True)
        return replace(self, history=self.history.then(edit), found=None)

    def undo(self) -> FrameEditor:
        """Take the last change back."""
        return replace(self, history=self.history.undone, found=None)

    def redo(self) -> FrameEditor:
        """Make the change again that was taken back last."""
        return replace(self, history=self.history.redone, found=None)

    def place(self, label: str, xy: ArrayLike, *, snap: bool = True) -> Array:
        """The pixel that a click means: on the paint of a line or an arc near by, as it is for other labels."""
        segment = self.field.get(label)
        click = np.asarray(xy, dtype=float)
        if not snap or segment is None or not (segment.is_straight or segment.is_arc):
            return click
        return snapped(self.image, click, self._direction(segment, label, click))

    def _direction(self, segment: Segment, label: str, xy: Array) -> Array | None:
        """Direction of a marking in the image near a pixel: by the camera or, of a straight one, by its other marks."""
        if self.calibration:
            near = nearest_on(image_curves(self.calibration.required_camera, segment), xy)
            if near is not None and near.distance < NEAR * pixel_unit(size_of(self.image)):
                return near.direction
        others = self.marks.pixels.get(label)
        if others is None or not segment.is_straight:
            return None
        way = others[np.argmax(np.linalg.norm(others - xy, axis=1))] - xy
        return way if np.linalg.norm(way) > NEAR * pixel_unit(size_of(self.image)) else None

    def likely_labels(self, xy: ArrayLike) -> list[str]:
        """Labels for a pixel, the likely ones first."""
        return likely_labels(self.field, self.calibration.camera, xy)

    @property
    def next_mark(self) -> NextMark | None:
        """The mark that would help most; None without a camera."""
        return next_mark(self.calibration, self.marks.of_field(self.field).only_by_hand.pixels)

    def click_errors(self, X: ArrayLike) -> Array:
        """Shift, metres, of ground points (..., 3) if all clicks are 2 px off."""
        return click_errors(self.calibration, X)

    def _repr_html_(self) -> str:
        """The picture with its markings, and what is to be said of the camera, for notebooks."""
        calibration = self.calibration
        drawn = draw_calibration(self.image, calibration, calibration.field or self.field)
        content = encode_image(at_most_wide(drawn, NOTEBOOK_WIDTH), ".jpg")
        picture = f'<img src="data:image/jpeg;base64,{b64encode(content).decode()}">'
        return f"<div>{picture}<p>{escape(f'{calibration.verdict}: {calibration.reason}')}</p></div>"

    def _then(self, **changes: Any) -> FrameEditor:
        edit = replace(self.history.present, automatic=False, **changes)
        return replace(self, history=self.history.then(edit), found=None)


def check_edit(edit: Edit, field: Field) -> None:
    """Raise a ValueError for an edit that cannot be; labels and sizes of another field are kept, without effect."""
    for one in edit.marks.all:
        if not (abs(one.x) < FARTHEST and abs(one.y) < FARTHEST):
            raise ValueError(f"expected pixels below {FARTHEST:g}, got {one.x, one.y} of {one.label!r}")
    if field.size_model is not None:
        edit.known.of(field)


def _check_label(label: str, field: Field) -> None:
    if label not in field:
        raise ValueError(f"unknown label {label!r}; {nearest_label(label, field)}")
