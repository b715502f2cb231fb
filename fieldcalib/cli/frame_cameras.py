"""The cameras of a run, found by the names or numbers that other files give its frames."""

from __future__ import annotations

import re
from collections import Counter
from functools import lru_cache
from pathlib import Path

from fieldcalib.assess.result import Calibration, Status
from fieldcalib.fields.field import Field
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.io.files import BrokenFileError, open_regular_file, parse_json_object
from fieldcalib.io.results import BROKEN, is_table, lines_file, result_lines

CACHED = 1024  # calibrations, 20 kB each: a table that is sorted by player has a frame many times


class Cameras:
    """Calibrations of a folder of results by frame, each read on demand.

    Parameters
    ----------
    path : Path
        The folder, or its ``cameras.jsonl`` or ``cameras.parquet``.

    Raises
    ------
    FileNotFoundError
        If there are no results.
    BrokenFileError
        If a line is no result.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._path = lines_file(path) if path.is_dir() else path
        if not self._path.is_file():
            raise FileNotFoundError(f"{self._path} does not exist: expected the folder that calibrate or run wrote")
        self.accepted: list[str] = []
        """Ids of the frames whose camera is accepted, in the order of the run."""
        self._lines: dict[str, tuple[int, int | bytes]] = {}  # number, and first byte; the line itself if of a table
        begin = 0  # byte
        for number, text in enumerate(result_lines(self._path), 1):
            try:
                line = parse_json_object(text, "a frame's result")
                self._lines[str(line["id"])] = number, text if is_table(self._path) else begin
                begin += len(text)
                if line.get("status") == Status.ACCEPTED and line.get("K") is not None:
                    self.accepted.append(str(line["id"]))
            except (KeyError, BrokenFileError) as error:
                raise BrokenFileError(f"{self._path}, line {number}: is no result of a frame: {error}") from None
        numbers = [number for number in map(_number, self._lines) if number is not None]
        once = {number for number, count in Counter(numbers).items() if count == 1}
        self._by_number = {n: id for id in self._lines if (n := _number(id)) in once}
        self._read = lru_cache(maxsize=CACHED)(self._calibration)

    @property
    def ids(self) -> list[str]:
        """Ids of all frames, in the order of the run."""
        return list(self._lines)

    @property
    def first(self) -> int | None:
        """The least number of a frame."""
        return min(self._by_number, default=None)

    def of(self, frame: str, offset: int = 0) -> Calibration | None:
        """The calibration of a frame, by the name that boxes give it; None if it has no camera."""
        found = self.id_of(frame, offset)
        return None if found is None else self._read(found)

    def id_of(self, frame: str, offset: int = 0) -> str | None:
        """The id of a frame, by the name that boxes give it; None if there is no such frame.

        The name is its id, with or without folder and ending, or its number: frame 12 is "000012", or "image-12".
        """
        name = Path(frame).stem if re.search(r"\.[A-Za-z]", frame) else Path(frame).name
        number = _number(frame if re.fullmatch(r"[-+]?\d+(\.0*)?", frame) else name)
        if offset and number is not None:
            return self._by_number.get(number + offset)
        found = next((id for id in (frame, name) if id in self._lines), None)
        return found if found is not None or number is None else self._by_number.get(number)

    def _calibration(self, id: str) -> Calibration | None:
        number, place = self._lines[id]
        if isinstance(place, bytes):
            text = place
        else:
            with open_regular_file(self._path) as file:
                file.seek(place)
                text = file.readline()
        line = parse_json_object(text, "a frame's result")
        if line.get("status") == BROKEN:
            return None
        try:
            found = Calibration.from_dict(line)
        except ValueError as error:
            raise BrokenFileError(f"{self._path}, line {number}: {error}") from None
        return found if found.camera is not None else None

    def naming_hint(self, frame: str) -> str:
        """Text for messages: how frames are named in the boxes and in the results."""
        ids = [*self._lines, "none"]
        return f"boxes are of frames as {frame!r}, cameras of frames as {ids[0]!r}"


def field_of(cameras: Cameras) -> Field:
    """The field of the first frame that has an accepted camera.

    Raises
    ------
    ValueError
        If there is none.
    """
    first = cameras.of(cameras.accepted[0]) if cameras.accepted else None
    if first is None:
        raise ValueError(f"no frame of {cameras.path} has an accepted camera")
    return first.field or soccer()


def _number(id: str) -> int | None:
    """The number of a frame: the last number in its id.

    Examples
    --------
    >>> _number("000012"), _number("clip2_frame_7"), _number("12.0"), _number("a")
    (12, 7, 12, None)
    """
    found = re.findall(r"\d+", re.sub(r"\.0*$", "", id))
    return int(found[-1]) if found else None
