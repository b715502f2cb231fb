"""Tables of boxes: CSV with a header, and MOTChallenge's, which have none."""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Iterator, Sequence
from itertools import chain
from pathlib import Path
from typing import Any, TypeAlias

from fieldcalib.io.boxes.rows import AS_POINT, WITH_CORNERS, WITH_SIZE, Box, BoxRow, BoxTable, Layout, box_of
from fieldcalib.io.files import BrokenFileError

FRAME_COLUMNS = ("frame", "frame_id", "frame_index", "frame_number", "frame_idx", "image_id", "image")
COLUMNS: dict[tuple[str, ...], Layout] = {
    ("x", "y", "width", "height"): WITH_SIZE,
    ("x", "y", "w", "h"): WITH_SIZE,
    ("left", "top", "width", "height"): WITH_SIZE,
    ("bb_left", "bb_top", "bb_width", "bb_height"): WITH_SIZE,
    ("x1", "y1", "x2", "y2"): WITH_CORNERS,
    ("x_min", "y_min", "x_max", "y_max"): WITH_CORNERS,
    ("xmin", "ymin", "xmax", "ymax"): WITH_CORNERS,
    ("foot_x", "foot_y"): AS_POINT,
    ("pixel_x", "pixel_y"): AS_POINT,
    ("x", "y"): AS_POINT,
}
NO_PIXELS = {"width", "height", "w", "h", "z"}  # beside x, y these are no pixels of points
ONE_CELL = "bbox_ltwh"  # tracklab's tables: left, top, width and height in brackets
MOT = ("frame", "id", "bb_left", "bb_top", "bb_width", "bb_height", "conf", "x", "y", "z")
MOT_TRUTH = (*MOT[:7], "class", "visibility")
NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"

ReadBox: TypeAlias = Callable[[Sequence[str]], Box | None]  # the box of the cells of a row


def box_table(path: Path, file: Any) -> BoxTable:
    """A table of boxes in an open file.

    Raises
    ------
    BrokenFileError
        If it is no table of boxes; the message begins with the path.
    """
    first = _first_line(path, file)
    delimiter = max(",;\t", key=first.count)
    reader = csv.reader(chain([first], file), delimiter=delimiter, strict=True)
    try:
        header = [name.strip() for name in next(reader)]
    except (csv.Error, UnicodeDecodeError) as error:
        raise BrokenFileError(f"{path}, line 1: {error}") from None
    if all(re.fullmatch(NUMBER, name) for name in header):
        names: Sequence[str] = MOT_TRUTH if len(header) == len(MOT_TRUTH) else MOT[: len(header)]
        if not 6 <= len(header) == len(names):
            raise BrokenFileError(
                f"{path}, line 1: expected a header, or 6 to 10 numbers as of MOTChallenge, got {len(header)} numbers"
            )
        return BoxTable(names, _rows(path, chain([header], reader), reader, names), counts_from_1="MOTChallenge")
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


def _layout(path: Path, columns: Sequence[str]) -> tuple[int, ReadBox]:
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
        return frame, lambda values: box_of(re.findall(NUMBER, values[cell]) or [""] * 4, WITH_SIZE)
    group = next((group for group in COLUMNS if set(group) <= set(names)), None)
    if frame is None or group is None or (group == ("x", "y") and NO_PIXELS & set(names)):
        boxes, points = ([", ".join(group) for group in COLUMNS if len(group) == count] for count in (4, 2))
        raise BrokenFileError(
            f"{path}: expected a column with the frame ({', '.join(FRAME_COLUMNS)}), and boxes ({'; '.join(boxes)}; "
            f"{ONE_CELL}) or points such as feet and balls ({'; '.join(points)}), got {', '.join(columns)}"
        )
    places = [names.index(name) for name in group]
    return frame, lambda values: box_of([values[place] for place in places], COLUMNS[group])
