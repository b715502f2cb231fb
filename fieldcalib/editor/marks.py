"""Marks that a person sets in an image, and their history."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib.fields.field import Field
from fieldcalib.problem.labelled_pixels import Pixels

State = TypeVar("State")

FARTHEST = 100_000.0  # px: no mark is farther from the picture's corner


class Mark(NamedTuple):
    """A labelled pixel."""

    label: str
    x: float
    y: float
    by_hand: bool = True
    """Whether a person set it, not a network."""


@dataclass(frozen=True)
class Marks:
    """The marks of an image, in the order in which they were set. Each change gives new marks.

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
        """Marks at labelled pixels."""
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
        """Pixels (N, 2) by label, in their order along the marking; those that the field does not know as they are."""
        return {label: xy[field[label].order(xy)] if label in field else xy for label, xy in self.pixels.items()}

    def of_field(self, field: Field) -> Marks:
        """Those whose labels a field knows."""
        return Marks(tuple(one for one in self.all if one.label in field))

    def unknown_to(self, field: Field) -> list[str]:
        """Labels that a field does not know."""
        return list(dict.fromkeys(one.label for one in self.all if one.label not in field))

    @property
    def only_by_hand(self) -> Marks:
        """Those that a person set."""
        return Marks(tuple(one for one in self.all if one.by_hand))

    def added(self, label: str, xy: Iterable[Iterable[float]], *, by_hand: bool = True) -> Marks:
        """With marks of a label at some pixels."""
        return Marks((*self.all, *(Mark(label, float(x), float(y), by_hand) for x, y in xy)))

    def moved(self, to: Mapping[int, Iterable[float]]) -> Marks:
        """With marks at other pixels, by their numbers."""
        self._check(to)
        places = {number: (float(x), float(y)) for number, (x, y) in to.items()}
        return Marks(
            tuple(Mark(one.label, *places[number]) if number in places else one for number, one in enumerate(self.all))
        )

    def scaled(self, scale: ArrayLike) -> Marks:
        """In the pixels of a resized picture; `scale` (2,) is that of x and y."""
        sx, sy = np.asarray(scale, dtype=float).tolist()
        return Marks(tuple(one._replace(x=sx * one.x, y=sy * one.y) for one in self.all))

    def relabelled(self, numbers: Collection[int], label: str) -> Marks:
        """With another label for some marks, which are then set by hand."""
        self._check(numbers)
        return Marks(
            tuple(Mark(label, one.x, one.y) if number in numbers else one for number, one in enumerate(self.all))
        )

    def without(self, numbers: Collection[int]) -> Marks:
        """Without some marks."""
        self._check(numbers)
        return Marks(tuple(one for number, one in enumerate(self.all) if number not in numbers))

    def _check(self, numbers: Iterable[int]) -> None:
        for number in numbers:
            if not 0 <= number < len(self.all):
                raise ValueError(f"expected numbers of marks from 0 to {len(self.all) - 1}, got {number}")


@dataclass(frozen=True)
class History(Generic[State]):
    """States, of which one is the present: undo goes back without end, and redo forth until something else is done.

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
        """Another history as one change of this one: an undo, a redo, or a new state."""
        if (self.can_undo and other == self.undone) or (self.can_redo and other == self.redone):
            return other
        return self.then(other.present)

    def then(self, state: State) -> History[State]:
        """With a new state; the same one as before changes nothing."""
        return self if state == self.present else History(state, (*self.past, self.present))

    @property
    def undone(self) -> History[State]:
        """With the state before the present one; the first one stays."""
        if not self.past:
            return self
        return replace(self, present=self.past[-1], past=self.past[:-1], future=(self.present, *self.future))

    @property
    def redone(self) -> History[State]:
        """With the state that was undone last."""
        if not self.future:
            return self
        return History(self.future[0], (*self.past, self.present), self.future[1:])
