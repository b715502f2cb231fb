"""Rows of boxes, whatever file they are from, and where the players in them stand.

Boxes count from the corner of the first pixel: one of width 1 at x = 0 covers just that pixel, whose centre is x = 0 of
this package's pixels.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib._types import Array
from fieldcalib.io.files import BrokenFileError

Box: TypeAlias = tuple[float, float, float, float]

NOTHING = ("", "nan", "none")  # in a cell: there is no box


@dataclass(frozen=True)
class BoxRow:
    """A row of a file of boxes."""

    frame: str
    """The frame as written: an id, the name of an image, or a number."""
    box: Box | None
    """Left, top, right, bottom edge, in the unit of the file, from the corner of the image; None where there is none.

    A point, as a ball or a foot, is a box without size."""
    values: Sequence[str]
    """All cells as written."""


@dataclass(frozen=True)
class BoxTable:
    """Boxes of a file, row by row."""

    columns: Sequence[str]
    rows: Iterator[BoxRow]
    """Reading on raises a BrokenFileError that names the line, where one is malformed."""
    counts_from_1: str = ""
    """The tool, if its frames count from 1; else empty."""
    is_relative: bool = False
    """Whether boxes are shares of the width and height of the image, as YOLO writes them; else they are pixels."""


def foot_points(boxes: ArrayLike) -> Array:
    """Pixels where players stand: the middle of the lower edge of their boxes.

    ``((x1 + x2) / 2 - 1/2, y2 - 1/2)``: boxes count from the corner of the first pixel, pixels from its centre.

    Parameters
    ----------
    boxes : (..., 4) array_like
        Left, top, right and bottom edges, as ``supervision.Detections.xyxy`` and ultralytics' ``boxes.xyxy``.

    Returns
    -------
    (..., 2) array

    Raises
    ------
    ValueError
        If they have another shape.

    Examples
    --------
    >>> foot_points([[100, 200, 140, 300]])
    array([[119.5, 299.5]])
    """
    edges = np.asarray(boxes, dtype=float)
    if edges.ndim == 0 or edges.shape[-1] != 4:
        raise ValueError(f"expected boxes of shape (..., 4), left, top, right, bottom, got shape {edges.shape}")
    left, _, right, bottom = np.moveaxis(edges, -1, 0)
    return np.stack([(left + right) / 2.0, bottom], axis=-1) - 0.5


@dataclass(frozen=True)
class Layout:
    """What the numbers of a box are."""

    numbers: str
    """For messages."""
    edges: Callable[..., Box]
    """Left, top, right and bottom edge of the numbers."""


WITH_SIZE = Layout("left, top, width, height", lambda x, y, w, h: (x, y, x + w, y + h))
WITH_CORNERS = Layout("left, top, right, bottom", lambda x1, y1, x2, y2: (x1, y1, x2, y2))
AROUND_CENTRE = Layout(
    "centre x, centre y, width, height", lambda x, y, w, h: (x - w / 2, y - h / 2, x + w / 2, y + h / 2)
)
AS_POINT = Layout("x, y", lambda x, y: (x + 0.5, y + 0.5, x + 0.5, y + 0.5))


def box_of(texts: Sequence[Any], layout: Layout) -> Box | None:
    """The box that numbers make; None if they are empty or NaN.

    Raises
    ------
    BrokenFileError
        If they make no box.

    Examples
    --------
    >>> box_of(["10", "20", "5", "8"], WITH_SIZE)
    (10.0, 20.0, 15.0, 28.0)
    >>> foot_points(box_of(["120", "300"], AS_POINT))
    array([120., 300.])
    """
    if all(str(text).strip().lower() in NOTHING for text in texts):
        return None
    said = ", ".join(map(str, texts))
    try:
        box = layout.edges(*(float(text) for text in texts))
    except (TypeError, ValueError):
        raise BrokenFileError(f"expected numbers ({layout.numbers}), got {said}") from None
    if not np.isfinite(box).all() or box[2] < box[0] or box[3] < box[1]:
        raise BrokenFileError(f"expected a box ({layout.numbers}) of positive size, got {said}")
    return box
