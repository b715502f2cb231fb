"""Boxes as YOLO's tools write them: a text file for each frame, a line for each box, in shares of the image."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from fieldcalib.io.boxes.rows import AROUND_CENTRE, BoxRow, BoxTable, box_of
from fieldcalib.io.files import BrokenFileError, named_in_errors, read_regular_file

SUFFIX = ".txt"
COLUMNS = ("frame", "class", "confidence", "track_id", "x_center", "y_center", "width", "height")
EXPECTED = "class, x_center, y_center, width, height in shares of the image, and confidence or the number of a track"
VIDEO_FRAME = re.compile(r".*_[1-9]\d*")  # as ultralytics names the frames of a video, from 1 on
LARGEST = 1.5  # of a share: the box of somebody at the border may reach beyond the image


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
                yield from _rows(file.stem, read_regular_file(file, most_bytes))

    of_video = all(VIDEO_FRAME.fullmatch(file.stem) for file in files)
    return BoxTable(COLUMNS, rows(), "ultralytics" if of_video else "", is_relative=True)


def _rows(frame: str, content: bytes) -> Iterator[BoxRow]:
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
