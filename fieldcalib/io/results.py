"""Files of results, read: ``cameras.jsonl`` with the camera of every frame, and ``solver.jsonl`` beside it.

Both have a line for each frame, in the order of the run. A line of ``cameras.jsonl`` has what people and programs use;
that of ``solver.jsonl`` what is left: from both together the calibration is read back, with its errors. In tables
(``cameras.parquet``) they are two columns. Frames are parsed when they are asked for.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeAlias, TypeGuard

import numpy as np

from fieldcalib._types import LARGEST, is_number
from fieldcalib.assess.findings import Status, Verdict
from fieldcalib.assess.result import Calibration
from fieldcalib.geometry.camera import Camera
from fieldcalib.io.files import BrokenFileError, open_regular_file, parse_json_object
from fieldcalib.io.output_folder import whole_lines
from fieldcalib.io.parquet import read_parquet

LINES, SOLVER, TABLE = "cameras.jsonl", "solver.jsonl", "cameras.parquet"
FORMAT = 3  # version of the files: the first one had all in cameras.jsonl, the second no findings
WITHOUT_SOLVER = 1
OLD_FORMATS = (WITHOUT_SOLVER, 2)  # that are read too
BROKEN = "broken file"  # status of a frame whose file could not be read
MAIN_KEYS = (  # of cameras.jsonl, in this order; all others are in solver.jsonl
    *("id", "status", "message", "verdict", "reason", "findings", "remedy", "advice", "basis", "time_s", "version"),
    *("field", "image_size"),
    *("K", "dist", "lens", "R", "C", "angles_degrees", "rms_px", "loss_ndc", "standard_deviations"),
    *("probability_right_0.5m", "probability_right_1m"),
)
NAMED_NUMBERS = {  # of cameras.jsonl, by the key of their object
    "field": ("length", "width"),
    "angles_degrees": ("pan", "tilt", "roll"),
    "standard_deviations": ("focal_length_px",),
}
NUMBERS = ("rms_px", "loss_ndc", "probability_right_0.5m", "probability_right_1m")
INFINITIES = ("inf", "-inf")
SIZE_KEYS = ("length", "width", "size_known")  # of a field that has no builder, in cameras.jsonl
BEGINNING = re.compile(rb'\{"id": ("(?:[^"\\]|\\.)*"), "status": ("(?:[^"\\]|\\.)*")')

Texts: TypeAlias = tuple[bytes, bytes]
"""The lines of a frame in both files, without their ends; the second is empty in older formats."""


def broken_line(id: str, problem: str) -> dict[str, Any]:
    """The line of a frame whose file cannot be read: whoever counts verdicts finds one in every line."""
    return {"id": id, "status": BROKEN, "message": problem, "verdict": str(Verdict.REJECT), "reason": problem}


def split_line(line: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """The keys of a frame's results that go to ``cameras.jsonl``, and those of ``solver.jsonl``.

    Examples
    --------
    >>> main, solver = split_line({"id": "1", "status": "accepted", "message": "", "version": 1, "solved": None})
    >>> main
    {'id': '1', 'status': 'accepted', 'message': '', 'version': 3}
    >>> solver, joined_line(main, solver) == {"status": "accepted", "message": "", **solver}
    ({'id': '1', 'version': 1, 'solved': None}, True)
    """
    main = {key: line[key] for key in MAIN_KEYS if key in line}
    solver = {key: line[key] for key in ("id", "version") if key in line}
    if "version" in main:
        main["version"] = FORMAT
    field = main.get("field")
    if field is not None and "builder" not in field:
        main["field"] = {key: field[key] for key in SIZE_KEYS}
        solver["field"] = field
    return main, solver | {key: value for key, value in line.items() if key not in MAIN_KEYS}


def joined_line(main: Mapping[str, Any], solver: Mapping[str, Any]) -> dict[str, Any]:
    """The results of a frame from both files, with the keys of `Calibration.to_dict`."""
    return {**main, **solver}


def lines_file(folder: Path) -> Path:
    """The file in the folder of a run that has the lines of its frames; ``cameras.jsonl`` if there is none."""
    return folder / (TABLE if (folder / TABLE).is_file() and not (folder / LINES).is_file() else LINES)


def whole_line_pairs(folder: Path) -> Iterator[Texts]:
    """The lines of all frames in a folder that is written to: without an incomplete last one."""
    solver = folder / SOLVER
    return zip(whole_lines(folder / LINES), whole_lines(solver) if solver.exists() else (), strict=False)


def parse_main(text: bytes) -> dict[str, Any]:
    """Parse and check the line of a frame in ``cameras.jsonl``.

    Raises
    ------
    BrokenFileError
        If it is none, or one of another version; the message names it.
    """
    try:
        line = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise BrokenFileError(f"is no JSON: expected the folder that a run wrote, or its {LINES} ({error})") from error
    if not isinstance(line, dict):
        raise BrokenFileError(f"expected a JSON object of a frame's result, got {type(line).__name__}")
    for key, default in (("id", None), ("status", None), ("message", None), ("verdict", ""), ("reason", "")):
        if not isinstance(line.get(key, default), str):
            raise BrokenFileError(f"a result needs the key {key!r} with a text")
    size = line.get("image_size")
    if size is not None and not (
        isinstance(size, list) and len(size) == 2 and all(type(one) is int and one > 0 for one in size)
    ):
        raise BrokenFileError(f"'image_size': expected two numbers of pixels, got {size!s:.100}")
    if line.get("K") is not None:
        _check_camera(line)
    _check_words(line)
    _check_numbers(line)
    version = line.get("version")
    if line["status"] != BROKEN and version not in (FORMAT, *OLD_FORMATS):
        raise BrokenFileError(
            f"expected results of version {FORMAT} (or {', '.join(map(str, OLD_FORMATS))}), got {version!r}: another "
            f"fieldcalib wrote them, use that or calibrate again"
        )
    return line


def _check_words(line: Mapping[str, Any]) -> None:
    """Raise a BrokenFileError if a status or a verdict is none."""
    for key, known in (("status", (BROKEN, *Status)), ("verdict", tuple(Verdict))):
        if key in line and line[key] not in known:
            raise BrokenFileError(f"{key!r}: expected one of {', '.join(known)}, got {line[key]!r:.100}")


def _check_numbers(line: Mapping[str, Any]) -> None:
    """Raise a BrokenFileError if one of the numbers with a name is none."""
    for key, names in NAMED_NUMBERS.items():
        values = line.get(key)
        whole = isinstance(values, dict) and all(one in values and _is_number(values[one]) for one in names)
        if values is not None and not whole:
            raise BrokenFileError(f"{key!r}: expected numbers of {', '.join(names)}, got {values!s:.100}")
    for key in NUMBERS:
        if not _is_number(line.get(key)):
            raise BrokenFileError(f"{key!r}: expected a number, got {line[key]!s:.100}")


def _is_number(value: object) -> bool:
    """Whether it is what stands for a number in JSON, see `fieldcalib._json`."""
    return value is None or value in INFINITIES or is_number(value)


def _check_camera(line: Mapping[str, Any]) -> None:
    """Raise a BrokenFileError if the camera of a line is not whole."""
    matrices = [line.get(name) for name in ("K", "R")]
    whole = isinstance(line.get("angles_degrees"), dict) and all(
        isinstance(rows, list) and len(rows) == 3 and all(map(_is_triple, rows)) for rows in matrices
    )
    if not (whole and _is_triple(line.get("C"))):
        raise BrokenFileError("a camera needs 'K' and 'R', each three rows of three numbers, and 'C', three numbers")
    if not (_are_numbers(line.get("dist")) and line["dist"]) or line.get("image_size") is None:
        raise BrokenFileError("a camera needs 'dist', a list of one number or more, and 'image_size'")


def _is_triple(values: object) -> bool:
    return _are_numbers(values) and len(values) == 3


def _are_numbers(values: object) -> TypeGuard[list[float]]:
    return isinstance(values, list) and all(is_number(value) and abs(value) <= LARGEST for value in values)


class ResultFile:
    """The lines of a ``cameras.jsonl`` or ``cameras.parquet``, and of the ``solver.jsonl`` beside it.

    Only the ids and statuses are read at once, the lines when they are asked for. An incomplete last line, of a run
    that goes on, is left out.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    BrokenFileError
        If it cannot be read, a line is no result, or of another version; the message begins with file and line.
    ImportError
        If it is a table and pyarrow is not installed.
    """

    def __init__(self, path: Path) -> None:
        if not path.exists():
            raise FileNotFoundError(f"{path} does not exist: expected the folder that a run wrote, with its {LINES}")
        self.path = path
        self._texts: list[Texts] | None = list(read_parquet(path)) if path.suffix == Path(TABLE).suffix else None
        self._solver = _Lines(path.with_name(SOLVER))
        self.ids: list[str] = []
        """Ids of all frames, in order."""
        self.unreadable: set[int] = set()
        """Numbers of the frames whose files could not be read."""
        self._numbers: dict[str, int] = {}
        begins = [0]
        for number, text in enumerate(self._main_texts()):
            self._add(number, text)
            begins.append(begins[-1] + len(text))
        self._begins = np.array(begins, dtype=np.int64)
        self.is_cut = self._texts is None and begins[-1] < path.stat().st_size
        """Whether the last line is incomplete, and left out."""
        if self.ids:
            self.main(0)

    def _main_texts(self) -> Iterator[bytes]:
        if self._texts is not None:
            yield from (main for main, _ in self._texts)
            return
        with open_regular_file(self.path) as file:
            for line in file:
                if line.endswith(b"\n") or _is_json(line):
                    yield line

    def _add(self, number: int, text: bytes) -> None:
        """Take the id and the status of a frame."""
        found = BEGINNING.match(text)
        with self._named(number):
            if found is not None and text.rstrip().endswith(b"}"):
                id, status = json.loads(found[1]), json.loads(found[2])
            else:
                line = parse_main(text)
                id, status = line["id"], line["status"]
            first = self._numbers.setdefault(id, number)
            if first != number:
                raise BrokenFileError(f"frame {id!r} is there already, in line {first + 1}")
        self.ids.append(id)
        if status == BROKEN:
            self.unreadable.add(number)

    def main(self, number: int) -> dict[str, Any]:
        """The line of a frame in ``cameras.jsonl``."""
        with self._named(number):
            return parse_main(self._main_text(number))

    def mains(self) -> Iterator[dict[str, Any]]:
        """The lines of all frames in ``cameras.jsonl``, quicker than one by one."""
        for number, text in zip(range(len(self.ids)), self._main_texts(), strict=False):
            with self._named(number):
                yield parse_main(text)

    def line(self, number: int) -> dict[str, Any]:
        """Everything that is kept of a frame."""
        main = self.main(number)
        with self._named(number):
            return joined_line(main, self._solver_line(number, main))

    def calibration(self, number: int) -> Calibration:
        """The calibration of a frame that is not broken."""
        line = self.line(number)
        with self._named(number):
            return Calibration.from_dict(line)

    def camera(self, number: int) -> Camera | None:
        """The camera of a frame; None where there is none."""
        line = self.main(number)
        if line.get("K") is None:
            return None
        with self._named(number):
            return Camera.from_dict(line)

    def texts(self, number: int) -> Texts:
        """The lines of a frame as they stand in both files."""
        if self._texts is not None:
            return self._texts[number]
        return self._main_text(number).rstrip(b"\n"), self._solver.text(number).rstrip(b"\n")

    def _main_text(self, number: int) -> bytes:
        if self._texts is not None:
            return self._texts[number][0]
        begin, end = self._begins[number : number + 2].tolist()
        with open_regular_file(self.path) as file:
            file.seek(begin)
            return file.read(end - begin)

    def _solver_line(self, number: int, main: Mapping[str, Any]) -> dict[str, Any]:
        if main.get("version") == WITHOUT_SOLVER:
            return {}
        text = self._texts[number][1] if self._texts is not None else self._solver.text(number)
        if not text and number in self.unreadable:
            return {}
        if not text:
            raise BrokenFileError(
                f"{SOLVER} lies not beside it, or has no line for this frame: keep both, they are read together"
            )
        line = parse_json_object(text, "the solution of a frame")
        if line.get("id") != main["id"]:
            raise BrokenFileError(
                f"{SOLVER} has frame {line.get('id')!r} here, not {main['id']!r}: they are of different runs"
            )
        return line

    @contextmanager
    def _named(self, number: int) -> Iterator[None]:
        """Let errors about a line begin with its file and its number."""
        try:
            yield
        except ValueError as error:
            raise BrokenFileError(f"{self.path}, line {number + 1}: {error}") from error


class _Lines:
    """The lines of a file by number, found as far as they are asked for."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._begins = [0]

    def text(self, number: int) -> bytes:
        """A line with its end; empty if there is none."""
        if not self._path.is_file():
            return b""
        with open_regular_file(self._path) as file:
            file.seek(self._begins[min(number, len(self._begins) - 1)])
            while len(self._begins) <= number:
                line = file.readline()
                if not line.endswith(b"\n"):
                    return b""
                self._begins.append(self._begins[-1] + len(line))
            line = file.readline()
            return line if line.endswith(b"\n") or _is_json(line) else b""


def _is_json(text: bytes) -> bool:
    try:
        json.loads(text)
    except (ValueError, RecursionError):
        return False
    return True
