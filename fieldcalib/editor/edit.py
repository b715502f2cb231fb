"""Edits of a frame by a person: marks, known values of camera, field and picture, and the undo history of both."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace
from dataclasses import field as attribute
from reprlib import repr as short
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib._types import is_number, one_of, truth
from fieldcalib.fields.field import Field
from fieldcalib.problem.labelled_pixels import Pixels
from fieldcalib.problem.picture_shape import LEAST_RATIO, Placement
from fieldcalib.solve.request import NOTHING_GIVEN, GivenCamera, Task
from fieldcalib.solve.solver_options import LENS_FLAGS, CalibrationFlags

State = TypeVar("State")

FARTHEST = 100_000.0  # px: largest coordinate of a mark
# Least and largest focal length, px: a picture of 100 columns that is 157 degrees wide, and one of 8000 that shows 1 m
# at 100 m.
SHORTEST, LONGEST = 10.0, 1e6
FARTHEST_CAMERA = 1e4  # m: largest distance of the camera from the centre mark


class Mark(NamedTuple):
    """A labelled pixel."""

    label: str
    x: float
    y: float
    by_hand: bool = True
    """Whether a person set it; otherwise a network did."""


@dataclass(frozen=True)
class Marks:
    """The marks of an image, in the order in which they were set. Methods return changed copies.

    Examples
    --------
    >>> marks = Marks().added("Middle line", [(480, 100), (478, 300)]).added("Side line top", [(20, 90)])
    >>> marks.moved({0: (481, 101)}).pixels["Middle line"]
    array([[481., 101.],
           [478., 300.]])
    >>> marks.without([0, 2]).all
    (Mark(label='Middle line', x=478.0, y=300.0, by_hand=True),)
    """

    all: tuple[Mark, ...] = ()

    @classmethod
    def of(cls, pixels: Mapping[str, Iterable[Iterable[float]]], *, by_hand: bool = True) -> Marks:
        """Set marks at labelled pixels."""
        marks = cls()
        for label, xy in pixels.items():
            marks = marks.added(label, xy, by_hand=by_hand)
        return marks

    def __len__(self) -> int:
        return len(self.all)

    @property
    def pixels(self) -> Pixels:
        """Pixels (N, 2) by label."""
        found: dict[str, list[tuple[float, float]]] = {}
        for label, x, y, _ in self.all:
            found.setdefault(label, []).append((x, y))
        return {label: np.array(xy) for label, xy in found.items()}

    def ordered(self, field: Field) -> Pixels:
        """Pixels (N, 2) by label, sorted along the marking; as they are if the field does not have the label."""
        return {label: xy[field[label].order(xy)] if label in field else xy for label, xy in self.pixels.items()}

    def of_field(self, field: Field) -> Marks:
        """Keep the marks whose labels a field has."""
        return Marks(tuple(one for one in self.all if one.label in field))

    @property
    def only_by_hand(self) -> Marks:
        """The marks that a person set."""
        return Marks(tuple(one for one in self.all if one.by_hand))

    def added(self, label: str, xy: Iterable[Iterable[float]], *, by_hand: bool = True) -> Marks:
        """Add marks of a label at some pixels."""
        return Marks((*self.all, *(Mark(label, float(x), float(y), by_hand) for x, y in xy)))

    def moved(self, to: Mapping[int, Iterable[float]]) -> Marks:
        """Move marks, given by their numbers, to other pixels."""
        self._check(to)
        places = {number: (float(x), float(y)) for number, (x, y) in to.items()}
        return Marks(
            tuple(Mark(one.label, *places[number]) if number in places else one for number, one in enumerate(self.all))
        )

    def scaled(self, scale: ArrayLike) -> Marks:
        """Convert to the pixels of a resized picture; `scale` (2,) are the factors of x and y."""
        sx, sy = np.asarray(scale, dtype=float).tolist()
        return Marks(tuple(one._replace(x=sx * one.x, y=sy * one.y) for one in self.all))

    def relabelled(self, numbers: Collection[int], label: str) -> Marks:
        """Give some marks another label; they then count as set by hand."""
        self._check(numbers)
        return Marks(
            tuple(Mark(label, one.x, one.y) if number in numbers else one for number, one in enumerate(self.all))
        )

    def without(self, numbers: Collection[int]) -> Marks:
        """Remove some marks."""
        self._check(numbers)
        return Marks(tuple(one for number, one in enumerate(self.all) if number not in numbers))

    def _check(self, numbers: Iterable[int]) -> None:
        for number in numbers:
            if not 0 <= number < len(self.all):
                raise ValueError(f"expected numbers of marks from 0 to {len(self.all) - 1}, got {number}")


@dataclass(frozen=True)
class Known:
    """Values of camera and field that a person knows; those that are None are estimated."""

    focal_length: float | None = None
    """Pixels of the picture, along rows."""
    position: tuple[float, float, float] | None = None
    """Metres from the centre mark, y towards the main stand, z down."""
    principal_point: bool = False
    """Whether the principal point is in the middle of the image."""
    lens: str = "k1"
    """A name of `LENS_FLAGS`."""
    field_size: tuple[float, float] | None = None
    """Length and width, metres."""
    aspect: float | None = None
    """Width / height at which the picture has square pixels: 16 / 9 if it was squashed from that."""

    def __post_init__(self) -> None:
        one_of(self.lens, LENS_FLAGS, "lens")
        values = {
            "focal_length": _number(self.focal_length),
            "position": _above_ground(_numbers(self.position, 3, "position", "x, y, z in metres")),
            "principal_point": bool(truth(self.principal_point, "principal_point")),
            "field_size": _numbers(self.field_size, 2, "field_size", "length and width in metres"),
        }
        for name, value in values.items():  # as plain numbers, which JSON has
            object.__setattr__(self, name, value)
        if self.aspect is not None and not (is_number(self.aspect) and LEAST_RATIO <= self.aspect <= 1.0 / LEAST_RATIO):
            raise ValueError(
                f"aspect must be the width / height at which the picture is shown, from {LEAST_RATIO:g} to "
                f"{1.0 / LEAST_RATIO:g} as 16 / 9, or None, got {short(self.aspect)}"
            )

    def of(self, field: Field) -> Field:
        """Resize a field to its known size; a ValueError if it cannot have that."""
        return field if self.field_size is None else replace(field.resized(*self.field_size), size_known=True)

    def placement(self, image_size: tuple[int, int]) -> Placement:
        """Placement of a picture in a frame with square pixels: the picture itself unless the aspect is known."""
        return Placement.whole(image_size) if self.aspect is None else Placement.shown_as(image_size, self.aspect)

    def task(self, field: Field, placement: Placement) -> Task:
        """Describe what is to be solved, in pixels of the frame in which a picture lies."""
        F = CalibrationFlags
        flags, given = LENS_FLAGS[self.lens], NOTHING_GIVEN
        if self.focal_length is not None:
            cx, cy = np.divide(placement.frame_size, 2.0)
            f = self.focal_length * float(placement.scale[0])  # along rows, as `Camera.focal_length`
            given = GivenCamera(np.array([[f, 0.0, cx], [0.0, f, cy], [0.0, 0.0, 1.0]]))
            flags |= F.CALIB_FIX_FOCAL_LENGTH
        if self.position is not None:
            given = given._replace(rvec=np.zeros(3), tvec=-np.array(self.position))
            flags |= F.CALIB_FIX_POSITION
        if self.principal_point:
            flags |= F.CALIB_FIX_PRINCIPAL_POINT
        return Task(field, given, flags)


@dataclass(frozen=True)
class Edit:
    """State of the edits of an image: marks and known values."""

    marks: Marks = attribute(default_factory=Marks)
    known: Known = attribute(default_factory=Known)
    automatic: bool = False
    """Whether the state was found without a person: marks of a network, and a camera not from these marks alone."""


@dataclass(frozen=True)
class History(Generic[State]):
    """Undo history: the present state, all states before it, and those that were undone since the last new state.

    Examples
    --------
    >>> history = History("a").then("b").then("c").undone.undone
    >>> history.present, history.redone.present, history.then("d").can_redo
    ('a', 'b', False)
    """

    present: State
    past: tuple[State, ...] = ()
    future: tuple[State, ...] = ()

    @property
    def can_undo(self) -> bool:
        """Whether there is a state before."""
        return bool(self.past)

    @property
    def can_redo(self) -> bool:
        """Whether a state was undone."""
        return bool(self.future)

    def changed_to(self, other: History[State]) -> History[State]:
        """Express another history as one change of this one: an undo, a redo, or a new state."""
        if (self.can_undo and other == self.undone) or (self.can_redo and other == self.redone):
            return other
        return self.then(other.present)

    def then(self, state: State) -> History[State]:
        """Go to a new state; if it equals the present one, nothing changes."""
        return self if state == self.present else History(state, (*self.past, self.present))

    @property
    def undone(self) -> History[State]:
        """The history after an undo; nothing changes at the first state."""
        if not self.past:
            return self
        return replace(self, present=self.past[-1], past=self.past[:-1], future=(self.present, *self.future))

    @property
    def redone(self) -> History[State]:
        """The history after a redo of the state that was undone last."""
        if not self.future:
            return self
        return History(self.future[0], (*self.past, self.present), self.future[1:])


def check_edit(edit: Edit, field: Field) -> None:
    """Raise a ValueError for an impossible edit; labels and sizes of another field are kept, without effect."""
    for one in edit.marks.all:
        if not (abs(one.x) < FARTHEST and abs(one.y) < FARTHEST):
            raise ValueError(f"expected pixels below {FARTHEST:g}, got {one.x, one.y} of {one.label!r}")
    if field.size_model is not None:
        edit.known.of(field)


def _number(focal_length: Any) -> float | None:
    """Check a focal length."""
    if focal_length is None:
        return None
    if not (is_number(focal_length) and SHORTEST <= focal_length <= LONGEST):
        got = short(focal_length)
        raise ValueError(f"focal_length must be {SHORTEST:g} to {LONGEST:g} pixels, or None, got {got}")
    return float(focal_length)


def _numbers(values: Any, count: int, name: str, what: str) -> Any:
    """Check a list of `count` numbers, or None."""
    if values is None:
        return None
    is_list = isinstance(values, tuple | list) or (isinstance(values, np.ndarray) and values.ndim == 1)
    is_list = is_list and len(values) == count and all(map(is_number, values))
    if not is_list or not all(abs(value) <= FARTHEST_CAMERA for value in values):
        raise ValueError(f"{name} must be {what}, at most {FARTHEST_CAMERA:g} each, or None, got {short(values)}")
    return tuple(float(value) for value in values)


def _above_ground(position: Any) -> Any:
    """Check that a position is above the ground: z is negative upwards."""
    if position is not None and not position[2] < 0.0:
        raise ValueError(f"position must be above the ground, where z is negative: x, y, z in metres, got {position}")
    return position
