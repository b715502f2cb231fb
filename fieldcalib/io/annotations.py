"""Annotations of other tools: the common parts of their formats."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import PureWindowsPath
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from fieldcalib._types import Array
from fieldcalib.io.files import LONGEST_ID, BrokenFileError, escaped, unescaped
from fieldcalib.problem.labelled_pixels import Pixels

# px: other tools count from the corner of the image, where the centre of the first pixel is at (0.5, 0.5); here that
# is at (0, 0). So pixels = theirs - CORNER.
CORNER = 0.5
LARGEST_SIZE = 100_000  # px, of an image

Labels: TypeAlias = Mapping[str, str | None]


class LeftOut(NamedTuple):
    """A shape that is neither points nor a line.

    Examples
    --------
    >>> print(LeftOut("box", "ball"))
    box of 'ball'
    """

    kind: str
    label: str

    def __str__(self) -> str:
        """Format for messages."""
        return f"{self.kind} of {self.label!r}"


@dataclass(frozen=True)
class Annotation:
    """Labelled pixels of one image, as a file of some tool has them.

    Examples
    --------
    >>> Annotation("00001", {"Middle line": np.array([[480.0, 0.0], [480.0, 539.0]])}, (960, 540)).image_size
    (960, 540)
    """

    id: str
    """Name of the image, without folder and ending."""
    pixels: Pixels
    """Label -> (N, 2) pixels, the first pixel's centre at (0, 0)."""
    image_size: tuple[int, int] | None = None
    """Width and height (px); None where the file does not say it."""
    image: str = ""
    """Name of the image in the file; for writing."""
    problem: str = ""
    """Reason why it cannot be read; then there are no pixels."""
    left_out: tuple[LeftOut, ...] = ()
    """Shapes that are neither points nor lines, each kind once per label."""


@dataclass
class Shapes:
    """Collects the shapes of an image: those with the same label are one segment."""

    image_size: tuple[int, int] | None
    points: dict[str, list[Array]]
    left_out: dict[LeftOut, None]

    @classmethod
    def of(cls, width: Any, height: Any) -> Shapes:
        """Begin with an image of a size, without shapes.

        Raises
        ------
        BrokenFileError
            If that is no size.
        """
        return cls(checked_size(width, height), {}, {})

    def add(self, label: Any, points: Any, shift: float = CORNER) -> None:
        """Add a shape with its points (N, 2), which exceed pixels by `shift`.

        Raises
        ------
        BrokenFileError
            If the label is no text, or the points are not pairs of finite numbers.
        """
        name = self._name(label)
        try:
            xy = np.array([(float(x), float(y)) for x, y in points])
        except (TypeError, ValueError, OverflowError):
            raise BrokenFileError(f"{name!r}: expected points (x, y), got {_short(points)}") from None
        if not np.all(np.isfinite(xy)):
            raise BrokenFileError(f"{name!r}: a coordinate is not finite")
        if len(xy):
            self.points.setdefault(name, []).append(xy - shift)

    def leave_out(self, kind: Any, label: Any) -> None:
        """Add a shape that is neither points nor lines."""
        self.left_out[LeftOut(str(kind), self._name(label))] = None

    @staticmethod
    def _name(label: Any) -> str:
        if not isinstance(label, str) or not label.strip():
            raise BrokenFileError(f"expected the label of a shape, got {_short(label)}")
        return label.strip()


def annotation_of(image: Any, shapes: Callable[[], Shapes], what: str) -> Annotation:
    """The annotation of an image from its shapes, or the reason why these cannot be read.

    Parameters
    ----------
    image : str
        Its name or path.
    shapes : callable
        Reads the shapes; may raise a BrokenFileError.
    what : str
        Which image it is, for messages.

    Raises
    ------
    BrokenFileError
        If the image has no name: nobody could tell which frame it is.

    Examples
    --------
    >>> def shapes():
    ...     found = Shapes.of(960, 540)
    ...     found.add("Middle line", [(480.5, 0.5), (480.5, 539.5)])
    ...     return found
    >>> annotation_of("frames/00001.jpg", shapes, "the first image").pixels
    {'Middle line': array([[480.,   0.],
           [480., 539.]])}
    """
    if not isinstance(image, str):
        raise BrokenFileError(f"{what}: expected the name of the image, got {_short(image)}")
    image = unescaped(image)
    id = PureWindowsPath(image).stem  # takes both kinds of slashes
    if not id or not escaped(id).isprintable() or len(os.fsencode(id)) > LONGEST_ID:
        raise BrokenFileError(f"{what}: no result could be named after the image {_short(image)}")
    try:
        found = shapes()
    except BrokenFileError as error:
        return Annotation(id, {}, image=image, problem=str(error))
    pixels = {label: np.concatenate(parts) for label, parts in found.points.items()}
    return Annotation(id, pixels, found.image_size, image, left_out=tuple(found.left_out))


def checked_size(width: Any, height: Any) -> tuple[int, int]:
    """Width and height as a file has them, numbers or text.

    Raises
    ------
    BrokenFileError
        If they are missing or no positive whole numbers.

    Examples
    --------
    >>> checked_size("960", 540.0)
    (960, 540)
    """
    try:
        size = float(width), float(height)
    except (TypeError, ValueError, OverflowError):
        size = np.nan, np.nan
    if not all(value.is_integer() and 1 <= value <= LARGEST_SIZE for value in size):
        came = f"{_short(width)} and {_short(height)}"
        raise BrokenFileError(f"expected the size of the image as width and height in pixels, got {came}")
    return int(size[0]), int(size[1])


def member(record: Any, key: str, kind: type, what: str) -> Any:
    """A value of a JSON object that must be a list or an object.

    Raises
    ------
    BrokenFileError
        If it is missing or of another kind; `what` names the record in the message.
    """
    value = record.get(key) if isinstance(record, dict) else None
    if not isinstance(value, kind):
        names: dict[type, str] = {list: "a list", dict: "an object"}
        raise BrokenFileError(f"{what}: expected {names[kind]} {key!r}, got {_short(value)}")
    return value


def renamed(pixels: Pixels, labels: Labels) -> Pixels:
    """Rename labels by a mapping; labels that it maps to None are left out.

    Examples
    --------
    >>> list(renamed({"halfway": np.zeros((2, 2)), "ball": np.zeros((1, 2))}, {"halfway": "Middle line", "ball": None}))
    ['Middle line']
    """
    parts: dict[str, list[Array]] = {}
    for label, xy in pixels.items():
        name = labels.get(label, label)
        if name is not None:
            parts.setdefault(name, []).append(xy)
    return {name: np.concatenate(members) for name, members in parts.items()}


def names_of(labels: Labels, known: Iterable[str]) -> dict[str, str]:
    """The inverse of a mapping of labels: the names of the field's labels in files of another tool.

    Parameters
    ----------
    labels : mapping of str to str or None
        The field's labels by those of the tool. Of several names for one label the first counts.
    known : iterable of str
        The field's labels.

    Raises
    ------
    ValueError
        If a label's name in the other tool would be read back as another label.

    Examples
    --------
    >>> names_of({"halfway": "Middle line", "half": "Middle line", "ball": None}, ["Middle line", "Side line top"])
    {'Middle line': 'halfway', 'Side line top': 'Side line top'}
    """
    names: dict[str, str] = {}
    for theirs, ours in labels.items():
        if ours is not None:
            names.setdefault(ours, theirs)
    names = {label: names.get(label, label) for label in known}
    for label, name in names.items():
        read = labels.get(name)
        if read not in (None, label):
            raise ValueError(f"the labels call {read!r} {name!r}, so {label!r} needs another name: map one to it too")
    return names


class ExportedImage(NamedTuple):
    """Content of a file of another tool for one image."""

    image: str
    """Name or path of the image."""
    size: tuple[int, int]
    """Width and height (px)."""
    shapes: list[tuple[str, list[list[float]]]]
    """Each label that has pixels, and its points (x, y) counted from the corner of the image."""


def exported(annotation: Annotation) -> ExportedImage:
    """Convert an annotation to the coordinates of other tools.

    Raises
    ------
    ValueError
        If the size of the image is not known, or a pixel is not finite.

    Examples
    --------
    >>> exported(Annotation("1", {"Middle line": [(10.0, 20.0), (10.5, 40.0)]}, (96, 54), "1.jpg")).shapes
    [('Middle line', [[10.5, 20.5], [11.0, 40.5]])]
    """
    if annotation.image_size is None:
        raise ValueError(f"{annotation.id}: the file needs the size of the image, which is not known")
    shapes = []
    for label, xy in annotation.pixels.items():
        if not np.all(np.isfinite(xy)):
            raise ValueError(f"{label!r}: a pixel is not finite")
        if len(xy):
            shapes.append((label, (np.asarray(xy, dtype=float) + CORNER).tolist()))
    return ExportedImage(escaped(annotation.image or annotation.id), annotation.image_size, shapes)


def _short(value: Any) -> str:
    text = "nothing" if value is None else repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
