"""Files of detectors and trackers with boxes of players, of whatever kind."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from fieldcalib.io.boxes.json_lists import json_boxes
from fieldcalib.io.boxes.rows import BoxTable
from fieldcalib.io.boxes.tables import box_table
from fieldcalib.io.boxes.yolo import is_yolo, yolo_table
from fieldcalib.io.files import MOST_BYTES, BrokenFileError, named_in_errors, read_regular_file

KINDS = (
    "a table (CSV), MOTChallenge's or ByteTrack's text, JSON of COCO or SoccerNet's game state, or YOLO's text files"
)


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
