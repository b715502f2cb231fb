"""Boxes of players in files of detectors and trackers: tables with a header, MOTChallenge, SoccerNet's game state.

Boxes count from the corner of the first pixel: one of width 1 at x = 0 covers just that pixel, whose centre is x = 0 of
this package's pixels.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib._types import Array
from fieldcalib.io.files import MOST_BYTES, BrokenFileError, named_in_errors, parse_json_object, read_regular_file

Box: TypeAlias = tuple[float, float, float, float]

FRAME_COLUMNS = ("frame", "frame_id", "frame_index", "frame_number", "frame_idx", "image_id", "image")
WITH_SIZE = (
    ("x", "y", "width", "height"),
    ("x", "y", "w", "h"),
    ("left", "top", "width", "height"),
    ("bb_left", "bb_top", "bb_width", "bb_height"),
)
WITH_CORNERS = (("x1", "y1", "x2", "y2"), ("x_min", "y_min", "x_max", "y_max"), ("xmin", "ymin", "xmax", "ymax"))
ONE_CELL = "bbox_ltwh"  # tracklab's tables: left, top, width and height in brackets
MOT = ("frame", "id", "bb_left", "bb_top", "bb_width", "bb_height", "conf", "x", "y", "z")
MOT_TRUTH = (*MOT[:7], "class", "visibility")
GAME_STATE = ("id", "image_id", "track_id", "role", "jersey", "team", *WITH_SIZE[-1])
NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"


@dataclass(frozen=True)
class BoxRow:
    """A row of a table of boxes."""

    frame: str
    """The frame as written: an id, the name of an image, or a number."""
    box: Box | None
    """Left, top, right, bottom edge, pixels from the corner of the image; None where the cells are empty."""
    values: Sequence[str]
    """All cells as written."""


@dataclass(frozen=True)
class BoxTable:
    """Boxes of a file, row by row."""

    columns: Sequence[str]
    rows: Iterator[BoxRow]
    """Reading on raises a BrokenFileError that names the line, where one is malformed."""
    is_mot: bool = False
    """Whether it is a table of MOTChallenge, whose frames count from 1."""


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


@contextmanager
def open_boxes(path: Path, most_bytes: float = MOST_BYTES) -> Iterator[BoxTable]:
    """Open a file of boxes while the context lasts.

    Parameters
    ----------
    path : Path
        A table with a header, separated by commas, semicolons or tabs; one of MOTChallenge, which has none; or the
        JSON of SoccerNet's game state, as sn-gamestate and tracklab write it.
    most_bytes : float
        Limit for JSON; tables are read line by line and may be of any length.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    BrokenFileError
        If it is no such file; the message begins with the path, and with the line where there is one.
    """
    if not path.is_file():
        raise FileNotFoundError(f"{path} does not exist: expected a file of boxes")
    if path.suffix.lower() == ".json":
        with named_in_errors(path):
            table = _game_state(path, read_regular_file(path, most_bytes))
        yield table
        return
    with path.open(encoding="utf-8-sig", newline="") as file:
        yield _table(path, file)


def _table(path: Path, file: Any) -> BoxTable:
    first = _first_line(path, file)
    delimiter = max(",;\t", key=first.count)
    reader = csv.reader(chain([first], file), delimiter=delimiter, strict=True)
    header = [name.strip() for name in next(reader)]
    if all(re.fullmatch(NUMBER, name) for name in header):
        names: Sequence[str] = MOT_TRUTH if len(header) == len(MOT_TRUTH) else MOT[: len(header)]
        if not 6 <= len(header) == len(names):
            raise BrokenFileError(
                f"{path}, line 1: expected a header, or 6 to 10 numbers as of MOTChallenge, got {len(header)} numbers"
            )
        return BoxTable(names, _rows(path, chain([header], reader), reader, names), is_mot=True)
    return BoxTable(header, _rows(path, reader, reader, header))


def _first_line(path: Path, file: Any) -> str:
    try:
        for line in file:
            if line.strip():
                return str(line)
    except UnicodeDecodeError:
        raise BrokenFileError(f"{path}: is no text in UTF-8") from None
    raise BrokenFileError(f"{path}: is empty: expected boxes")


def _rows(path: Path, cells: Iterator[list[str]], reader: Any, columns: Sequence[str]) -> Iterator[BoxRow]:
    frame, box = _layout(path, columns)

    def rows() -> Iterator[BoxRow]:
        try:
            for values in cells:
                if not values:
                    continue
                if len(values) != len(columns):
                    raise BrokenFileError(f"expected {len(columns)} columns, got {len(values)}")
                if not values[frame].strip():
                    raise BrokenFileError(f"the column {columns[frame]!r} is empty: expected a frame")
                yield BoxRow(values[frame].strip(), box(values), values)
        except UnicodeDecodeError:
            raise BrokenFileError(f"{path}, after line {reader.line_num}: is no text in UTF-8") from None
        except (csv.Error, BrokenFileError) as error:
            raise BrokenFileError(f"{path}, line {reader.line_num}: {error}") from None

    return rows()


def _layout(path: Path, columns: Sequence[str]) -> tuple[int, Any]:
    """The column of the frame, and a function that makes a box of a row.

    Raises
    ------
    BrokenFileError
        If there is no such column.
    """
    names = [name.lower() for name in columns]
    twice = next((name for name in columns if columns.count(name) > 1), None)
    if twice is not None:
        raise BrokenFileError(f"{path}: the column {twice!r} is there twice")
    frame = next((names.index(name) for name in FRAME_COLUMNS if name in names), None)
    if frame is not None and ONE_CELL in names:
        cell = names.index(ONE_CELL)
        return frame, lambda values: _box_of(re.findall(NUMBER, values[cell]) or [""] * 4, corners=False)
    group = next((group for group in (*WITH_SIZE, *WITH_CORNERS) if set(group) <= set(names)), None)
    if frame is not None and group is not None:
        places = [names.index(name) for name in group]
        return frame, lambda values: _box_of([values[place] for place in places], corners=group in WITH_CORNERS)
    groups = ", or ".join(", ".join(group) for group in (*WITH_SIZE, *WITH_CORNERS))
    raise BrokenFileError(
        f"{path}: expected a column {' or '.join(FRAME_COLUMNS[:2])}, and {groups}, got {', '.join(columns)}"
    )


def _box_of(texts: Sequence[Any], *, corners: bool) -> Box | None:
    """A box from its four numbers, None if they are empty or NaN; a BrokenFileError if they make no box."""
    if all(str(text).strip().lower() in ("", "nan", "none") for text in texts):
        return None
    try:
        a, b, c, d = (float(text) for text in texts)
    except (TypeError, ValueError):
        raise BrokenFileError(f"expected four numbers for a box, got {', '.join(map(str, texts))}") from None
    box = (a, b, c, d) if corners else (a, b, a + c, b + d)
    if not np.isfinite(box).all() or box[2] < box[0] or box[3] < box[1]:
        kind = "left, top, right, bottom" if corners else "left, top, width, height"
        raise BrokenFileError(f"expected a box ({kind}) of positive size, got {', '.join(map(str, texts))}")
    return box


def _game_state(path: Path, content: bytes) -> BoxTable:
    """Boxes of SoccerNet's game state, predictions or truth."""
    record = parse_json_object(content, "predictions or annotations")
    found = record.get("predictions", record.get("annotations"))
    if not isinstance(found, list):
        raise BrokenFileError("expected the key 'predictions' or 'annotations' with a list")
    images = {
        str(one.get("image_id")): str(one.get("file_name")) for one in record.get("images", []) if "file_name" in one
    }

    def rows() -> Iterator[BoxRow]:
        for number, one in enumerate(found):
            if not isinstance(one, dict):
                raise BrokenFileError(f"{path}, entry {number}: expected an object, got {type(one).__name__}")
            if "bbox_image" not in one:  # lines and cameras
                continue
            try:
                edges = one["bbox_image"]
                box = _box_of([edges[key] for key in ("x", "y", "w", "h")], corners=False)
                image, attributes = str(one["image_id"]), one.get("attributes") or {}
            except (KeyError, TypeError) as error:
                raise BrokenFileError(f"{path}, entry {number}: is no box with an image: {error}") from None
            except BrokenFileError as error:
                raise BrokenFileError(f"{path}, entry {number}: {error}") from None
            said = [one.get("id"), image, one.get("track_id"), *(attributes.get(k) for k in ("role", "jersey", "team"))]
            values = ["" if value is None else str(value) for value in said]
            # "3021000012": part and number of the video, then the frame
            frame = images.get(image) or (image[-6:] if re.fullmatch(r"\d{10}", image) else image)
            yield BoxRow(frame, box, [*values, *(str(edges[key]) for key in ("x", "y", "w", "h"))])

    return BoxTable(GAME_STATE, rows())
