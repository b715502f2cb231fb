"""Files of detectors and trackers with boxes of players, of whatever kind.

Rows of boxes, whatever file they are from, and where the players in them stand.

Boxes count from the corner of the first pixel: one of width 1 at x = 0 covers just that pixel, whose centre is x = 0 of
this package's pixels.

Boxes in JSON: SoccerNet's game state, and COCO's datasets and lists of detections.

Tables of boxes: CSV with a header, and MOTChallenge's, which have none.

Boxes as YOLO's tools write them: a text file for each frame, a line for each box, in shares of the image.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib._types import Array
from fieldcalib.io.files import MOST_BYTES, BrokenFileError, named_in_errors, parse_json, read_regular_file

Box: TypeAlias = tuple[float, float, float, float]

NOTHING = ("", "nan", "none")  # in a cell: there is no box

EDGES = ("bb_left", "bb_top", "bb_width", "bb_height")
GAME_STATE = ("id", "image_id", "track_id", "role", "jersey", "team", *EDGES)
COCO = ("id", "image_id", "track_id", "category", "score", *EDGES)

FRAME_COLUMNS = ("frame", "frame_id", "frame_index", "frame_number", "frame_idx", "image_id", "image")

NO_PIXELS = {"width", "height", "w", "h", "z"}  # beside x, y these are no pixels of points
ONE_CELL = "bbox_ltwh"  # tracklab's tables: left, top, width and height in brackets
MOT = ("frame", "id", "bb_left", "bb_top", "bb_width", "bb_height", "conf", "x", "y", "z")
MOT_TRUTH = (*MOT[:7], "class", "visibility")
NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"

ReadBox: TypeAlias = Callable[[Sequence[str]], Box | None]  # the box of the cells of a row

SUFFIX = ".txt"
YOLO_COLUMNS = ("frame", "class", "confidence", "track_id", "x_center", "y_center", "width", "height")
EXPECTED = "class, x_center, y_center, width, height in shares of the image, and confidence or the number of a track"
VIDEO_FRAME = re.compile(r".*_[1-9]\d*")  # as ultralytics names the frames of a video, from 1 on
LARGEST = 1.5  # of a share: the box of somebody at the border may reach beyond the image

KINDS = (
    "a table (CSV), MOTChallenge's or ByteTrack's text, JSON of COCO or SoccerNet's game state, or YOLO's text files"
)


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
        If they have another shape, or a right or lower edge lies before the other one, as of x, y, width and height.

    Examples
    --------
    >>> foot_points([[100, 200, 140, 300]])
    array([[119.5, 299.5]])
    """
    edges = np.asarray(boxes, dtype=float)
    if edges.ndim == 0 or edges.shape[-1] != 4:
        raise ValueError(f"expected boxes of shape (..., 4), left, top, right, bottom, got shape {edges.shape}")
    left, top, right, bottom = np.moveaxis(edges, -1, 0)
    reversed_edges = edges[(right < left) | (bottom < top)].tolist()
    if reversed_edges:
        raise ValueError(
            f"expected boxes (left, top, right, bottom), got {reversed_edges[0]}: is it x, y, width and height?"
        )
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


def json_boxes(path: Path, content: bytes) -> BoxTable:
    """The boxes of JSON of one of these kinds.

    Raises
    ------
    BrokenFileError
        If it is none.
    """
    record = parse_json(content)
    if isinstance(record, list):  # COCO's detections
        return BoxTable(COCO, _rows_of_list(path, record, lambda one: _coco_row(one, {}, {})))
    if not isinstance(record, dict):
        raise BrokenFileError(f"expected a JSON object or a list of boxes, got {type(record).__name__}")
    found = record.get("predictions", record.get("annotations"))
    if not isinstance(found, list):
        raise BrokenFileError(
            "expected the key 'predictions' or 'annotations' with a list, as in a game state of SoccerNet and in COCO, "
            "or a list of COCO's detections"
        )
    if any(isinstance(one, dict) and "bbox" in one for one in found):
        images, categories = _names(record, "images", "id", "file_name"), _names(record, "categories", "id", "name")
        return BoxTable(COCO, _rows_of_list(path, found, lambda one: _coco_row(one, images, categories)))
    images = _names(record, "images", "image_id", "file_name")
    return BoxTable(GAME_STATE, _rows_of_list(path, found, lambda one: _game_state_row(one, images)))


def _names(record: Mapping[str, Any], key: str, id: str, name: str) -> dict[str, str]:
    listed = record.get(key) or []
    if not isinstance(listed, list):
        raise BrokenFileError(f"expected a list for the key {key!r}, got {type(listed).__name__}")
    return {str(one[id]): str(one[name]) for one in listed if isinstance(one, dict) and id in one and name in one}


def _rows_of_list(
    path: Path, found: list[Any], row_of: Callable[[Mapping[str, Any]], BoxRow | None]
) -> Iterator[BoxRow]:
    for number, one in enumerate(found):
        if not isinstance(one, dict):
            raise BrokenFileError(f"{path}, entry {number}: expected an object, got {type(one).__name__}")
        try:
            row = row_of(one)
        except (KeyError, TypeError, AttributeError) as error:
            raise BrokenFileError(f"{path}, entry {number}: is no box with an image: {error}") from None
        except BrokenFileError as error:
            raise BrokenFileError(f"{path}, entry {number}: {error}") from None
        if row is not None:
            yield row


def _game_state_row(one: Mapping[str, Any], images: Mapping[str, str]) -> BoxRow | None:
    if "bbox_image" not in one:  # lines and cameras
        return None
    numbers = [one["bbox_image"][key] for key in ("x", "y", "w", "h")]
    image, attributes = str(one["image_id"]), one.get("attributes") or {}
    said = [one.get("id"), image, one.get("track_id"), *(attributes.get(k) for k in ("role", "jersey", "team"))]
    # "3021000012": part and number of the video, then the frame
    frame = images.get(image) or (image[-6:] if re.fullmatch(r"\d{10}", image) else image)
    return BoxRow(frame, box_of(numbers, WITH_SIZE), [*_cells(said), *map(str, numbers)])


def _coco_row(one: Mapping[str, Any], images: Mapping[str, str], categories: Mapping[str, str]) -> BoxRow | None:
    if "bbox" not in one:  # masks and key points alone
        return None
    numbers, image, category = list(one["bbox"]), str(one["image_id"]), one.get("category_id")
    if len(numbers) != 4:
        raise BrokenFileError(f"expected four numbers in bbox ({WITH_SIZE.numbers}), got {len(numbers)}")
    said = [one.get("id"), image, one.get("track_id"), categories.get(str(category), category), one.get("score")]
    return BoxRow(images.get(image, image), box_of(numbers, WITH_SIZE), [*_cells(said), *map(str, numbers)])


def _cells(values: list[Any]) -> list[str]:
    return ["" if value is None else str(value) for value in values]


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
        return BoxTable(
            names, _rows_of_table(path, chain([header], reader), reader, names), counts_from_1="MOTChallenge"
        )
    return BoxTable(header, _rows_of_table(path, reader, reader, header))


def _first_line(path: Path, file: Any) -> str:
    try:
        for line in file:
            if line.strip():
                return str(line)
    except UnicodeDecodeError:
        raise BrokenFileError(f"{path}: is no text in UTF-8") from None
    raise BrokenFileError(f"{path}: is empty: expected boxes")


def _rows_of_table(path: Path, cells: Iterator[list[str]], reader: Any, columns: Sequence[str]) -> Iterator[BoxRow]:
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


def is_yolo(path: Path) -> bool:
    """Whether a path is a folder of such files, or one of them: numbers with blanks between them, none with commas."""
    if path.is_dir():
        return any(path.glob(f"*{SUFFIX}"))
    if path.suffix.lower() != SUFFIX:
        return False
    with path.open("rb") as file:
        first = next((line for line in file if line.strip()), b"")
    return re.fullmatch(rb"\s*\d+(\s+[-+.\deE]+){4,6}\s*", first) is not None


def yolo_table(path: Path, most_bytes: float) -> BoxTable:
    """The boxes of a folder of such files, or of one file; a frame is named as its file.

    Sources: ultralytics' ``save_txt`` (with ``save_conf``, and the numbers of tracks), and labels for training.
    """
    files = sorted(path.glob(f"*{SUFFIX}")) if path.is_dir() else [path]

    def rows() -> Iterator[BoxRow]:
        for file in files:
            with named_in_errors(file):
                yield from _rows_of_yolo(file.stem, read_regular_file(file, most_bytes))

    of_video = all(VIDEO_FRAME.fullmatch(file.stem) for file in files)
    return BoxTable(YOLO_COLUMNS, rows(), "ultralytics" if of_video else "", is_relative=True)


def _rows_of_yolo(frame: str, content: bytes) -> Iterator[BoxRow]:
    for number, line in enumerate(content.decode("ascii", "replace").splitlines(), 1):
        cells = line.split()
        if not cells:
            continue
        if not 5 <= len(cells) <= 7:
            raise BrokenFileError(f"line {number}: expected {EXPECTED}, got {len(cells)} numbers")
        try:
            box = box_of(cells[1:5], AROUND_CENTRE)
        except BrokenFileError as error:
            raise BrokenFileError(f"line {number}: {error}") from None
        if box is None or not all(1.0 - LARGEST <= edge <= LARGEST for edge in box):
            raise BrokenFileError(f"line {number}: expected {EXPECTED}, got {line.strip()}")
        yield BoxRow(frame, box, [frame, cells[0], *_confidence_and_track(cells[5:]), *cells[1:5]])


def _confidence_and_track(cells: list[str]) -> tuple[str, str]:
    """The two cells that may follow a box: a confidence, and the number of a track, which is an integer.

    Examples
    --------
    >>> _confidence_and_track(["0.91", "7"]), _confidence_and_track(["7"]), _confidence_and_track(["0.91"])
    (('0.91', '7'), ('', '7'), ('0.91', ''))
    """
    if len(cells) == 2:
        return cells[0], cells[1]
    if not cells:
        return "", ""
    return ("", cells[0]) if cells[0].isdecimal() else (cells[0], "")


@contextmanager
def open_boxes(path: Path, most_bytes: float = MOST_BYTES) -> Iterator[BoxTable]:
    """Open a file of boxes while the context lasts.

    Parameters
    ----------
    path : Path
        A table with a header, separated by commas, semicolons or tabs, of boxes or points; one of MOTChallenge or
        ByteTrack, which has none; the JSON of SoccerNet's game state, as sn-gamestate and tracklab write it; COCO's
        JSON, a dataset or a list of detections; a folder of YOLO's text files, or one of them.
    most_bytes : float
        Limit for JSON and for each text file; tables are read line by line and may be of any length.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    BrokenFileError
        If it is no such file; the message begins with the path, and with the line where there is one.
    """
    if not path.exists():
        raise FileNotFoundError(f"{path} does not exist: expected {KINDS}")
    if is_yolo(path):
        yield yolo_table(path, most_bytes)
    elif path.is_dir():
        raise BrokenFileError(f"{path}: is a folder without text files of YOLO: expected {KINDS}")
    elif path.suffix.lower() == ".json":
        with named_in_errors(path):
            table = json_boxes(path, read_regular_file(path, most_bytes))
        yield table
    else:
        with path.open(encoding="utf-8-sig", newline="") as file:
            yield box_table(path, file)
