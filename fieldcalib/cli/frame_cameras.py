"""The cameras of a run, found by the names or numbers that other files give its frames."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from functools import cached_property, lru_cache
from pathlib import Path

from fieldcalib._progress import say
from fieldcalib.assess.findings import Status
from fieldcalib.assess.result import Calibration
from fieldcalib.fields.field import Field
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.geometry.camera import Camera
from fieldcalib.io.files import unescaped
from fieldcalib.io.results import SOLVER, ResultFile, lines_file
from fieldcalib.run_folder.record import RunRecord

CACHED = 1024  # calibrations, 20 kB each: a table that is sorted by player has a frame many times
# Of frames that are drawn one after the other: each that is kept would lie between freed pictures, whose memory is then
# not used again.
IN_ORDER = 8


class Cameras:
    """Calibrations of a folder of results by frame, each read on demand.

    Parameters
    ----------
    path : Path
        The folder, or its ``cameras.jsonl`` or ``cameras.parquet``.
    kept : int
        Number of calibrations that are kept in memory.

    Raises
    ------
    FileNotFoundError
        If there are no results.
    BrokenFileError
        If a line is no result.
    """

    def __init__(self, path: Path, kept: int = CACHED) -> None:
        self.path = path
        """As it was given."""
        self._file = ResultFile(lines_file(path) if path.is_dir() else path)
        self._numbers = {id: number for number, id in enumerate(self._file.ids)}
        numbers = [number for number in map(_number, self._numbers) if number is not None]
        once = {number for number, count in Counter(numbers).items() if count == 1}
        self._by_number = {n: id for id in self._numbers if (n := _number(id)) in once}
        self._read = lru_cache(maxsize=kept)(self._calibration)

    @property
    def ids(self) -> list[str]:
        """Ids of all frames, in the order of the run."""
        return self._file.ids

    @property
    def files(self) -> list[Path]:
        """The files that are read."""
        return [self._file.path, self._file.path.with_name(SOLVER)]

    @cached_property
    def accepted(self) -> list[str]:
        """Ids of the frames whose camera is accepted, in the order of the run."""
        lines = self._file.mains()
        return [line["id"] for line in lines if line["status"] == Status.ACCEPTED and line.get("K") is not None]

    @property
    def first(self) -> int | None:
        """The least number of a frame."""
        return min(self._by_number, default=None)

    def of_video(self, inputs: Sequence[Path]) -> dict[int, str]:
        """Ids of the frames of a video by number; says if they are those of another one by its name.

        Raises
        ------
        ValueError
            If it is not one video, or none of its frames has an accepted camera.
        """
        if len(inputs) > 1:
            raise ValueError(f"expected one video, got {len(inputs)} inputs")
        numbers = {int(id): id for id in self.ids if id.isdecimal()}
        if numbers.keys().isdisjoint(map(int, filter(str.isdecimal, self.accepted))):
            raise ValueError(f"expected numbers as the ids of frames in {self.path}: are they of this video?")
        record = RunRecord.read(self._file.path.parent)
        sources = [] if record is None else [Path(one).name for one in record.source]
        if sources and inputs[0].name not in sources:
            say(f"{self.path} has cameras of {', '.join(sources)}: is {inputs[0]} the same video?")
        return numbers

    def of(self, frame: str, offset: int = 0) -> Calibration | None:
        """The calibration of a frame, by the name that boxes give it; None if it has no camera."""
        found = self.id_of(frame, offset)
        return None if found is None else self._read(found)

    def camera(self, id: str) -> Camera:
        """The camera of one of the `accepted` frames."""
        found = self._read(id)
        assert found is not None  # it is accepted
        return found.required_camera

    def id_of(self, frame: str, offset: int = 0) -> str | None:
        """The id of a frame, by the name that boxes give it; None if there is no such frame.

        The name is its id, with or without folder and ending, or its number: frame 12 is "000012", or "image-12".
        """
        frame = unescaped(frame)
        name = Path(frame).stem if re.search(r"\.[A-Za-z]", frame) else Path(frame).name
        number = _number(frame if re.fullmatch(r"[-+]?\d+(\.0*)?", frame) else name)
        if offset and number is not None:
            return self._by_number.get(number + offset)
        found = next((id for id in (frame, name) if id in self._numbers), None)
        return found if found is not None or number is None else self._by_number.get(number)

    def _calibration(self, id: str) -> Calibration | None:
        number = self._numbers[id]
        if number in self._file.unreadable:
            return None
        found = self._file.calibration(number)
        return found if found.camera is not None else None

    def naming_hint(self, frame: str) -> str:
        """Text for messages: how frames are named in the boxes and in the results."""
        ids = [*self._numbers, "none"]
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
