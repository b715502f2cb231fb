"""A report of a run: one HTML file with pictures, a table of all frames, plots and a map, which needs no network.

The file has at most `MOST_BYTES`, whatever the number of frames: pictures are made smaller and then fewer, and rows of
good frames are left out last. The file says what was left out. To follow its advice it names the commands to type, with
the folder and the input of the run (`Commands`).

The page's JavaScript modules are bundled into one script (`bundled`). They use only these forms: ``import { a, b as c }
from "./other.js";``, and ``export`` before a function, a class or a constant. Each module becomes a function that is
called once and returns its exports.
"""

from __future__ import annotations

import base64
import json
import os
import re
import shlex
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from dataclasses import replace as changed
from hashlib import sha256
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

import fieldcalib
from fieldcalib._progress import Progress, progress_bar
from fieldcalib._types import IntArray, expect, file_path
from fieldcalib._whole_files import write_text
from fieldcalib.assess.advice import IF_ON_PAINT, Advice, Remedy, Tool, advice_from_json, how
from fieldcalib.assess.findings import Finding, Verdict, first_reason
from fieldcalib.assess.result import Calibration
from fieldcalib.editor.frame_states import Row
from fieldcalib.fields.field import Field
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.geometry.camera import ANGLE_NAMES, Camera
from fieldcalib.io.files import BrokenFileError, escaped
from fieldcalib.io.image_files import Image, stored_size
from fieldcalib.io.results import BROKEN
from fieldcalib.results.collection import Results
from fieldcalib.results.frames import Pictures
from fieldcalib.run_folder.record import RunRecord, kind_of
from fieldcalib.run_folder.results import is_finished, read_summary
from fieldcalib.web.pictures import Thumbnails, frames_to_show
from fieldcalib.web.records import camera_record, curves_of, field_record, view_of

STATIC = Path(__file__).with_name("static")
IMPORT = re.compile(r'^import\s*\{([^}]*)\}\s*from\s*"\./([\w-]+)\.js";', re.MULTILINE)
EXPORT = re.compile(r"^export (?=(?:async )?(?:function\*?|class|const|let) +(\w+))", re.MULTILINE)
PICTURE = re.compile(r'url\("([\w-]+\.svg)"\)')
OTHER = re.compile(r"^(?:import|export)\b.*|\bimport\(.*", re.MULTILINE)

PAGE = (STATIC / "report.html").read_text(encoding="utf-8")
UNREADABLE = Remedy("the file cannot be read: get it again, or leave it out")
MOST_BYTES = 20_000_000  # of the file
PICTURE_BYTES = 7_500_000  # of JPEGs; as base64 in the file they take 4/3 of this
TABLE_BYTES, STATE_BYTES = 7_000_000, 2_500_000  # of the table, and of what is drawn on pictures
MOST_VIEWS = 20_000  # frames: a table of more gets no views of the ground, which would not fit anyway
STYLES = ("style", "report")
VIEW_POINTS = 12  # points of the polygon of the ground in view
MOST_LETTERS = 240  # of a reason
NOTHING: Mapping[str, Any] = {"id": "", "status": BROKEN, "message": ""}


def bundled(entry: str) -> str:
    """Bundle a module of the page, and the modules that it imports, into one script.

    Raises
    ------
    ValueError
        If a module imports or exports in another form, or modules import each other in a circle.
    """
    parts: dict[str, str] = {}
    _add(entry, parts, ())
    return '"use strict";\n' + "\n".join(parts.values())


def _add(name: str, parts: dict[str, str], importers: tuple[str, ...]) -> None:
    """Add a module after the modules that it imports."""
    if name in importers:
        raise ValueError(f"modules import each other: {' -> '.join((*importers, name))}")
    if name in parts:
        return
    source = (STATIC / f"{name}.js").read_text(encoding="utf-8")
    for found in IMPORT.finditer(source):
        _add(found[2], parts, (*importers, name))
    exported = ", ".join(found[1] for found in EXPORT.finditer(source))
    body = EXPORT.sub("", IMPORT.sub(_taken, source))
    if other := OTHER.search(body):
        raise ValueError(f"{name}.js: expected import {{ }} from and export of declarations, got {other[0]!r}")
    parts[name] = f"const {_variable(name)} = (() => {{\n{body}\nreturn {{ {exported} }};\n}})();"


def _taken(found: re.Match[str]) -> str:
    names = re.sub(r"(\w+)\s+as\s+(\w+)", r"\1: \2", found[1].strip())
    return f"const {{ {names} }} = {_variable(found[2])};"


def styles(*names: str) -> str:
    """Join style sheets of the page, with their pictures inlined."""
    text = "\n".join((STATIC / f"{name}.css").read_text(encoding="utf-8") for name in names)
    return PICTURE.sub(lambda found: f'url("{_inlined(found[1])}")', text)


def _inlined(svg: str) -> str:
    return f"data:image/svg+xml;base64,{base64.b64encode((STATIC / svg).read_bytes()).decode()}"


def _variable(module: str) -> str:
    return f"module_{module.replace('-', '_')}"


def one_file(title: str, style: str, script: str, data: Mapping[str, Any]) -> str:
    """Make an HTML file that contains its style, script and data, and may fetch nothing.

    Parameters
    ----------
    title : str
    style, script : str
        CSS and JavaScript.
    data : mapping of str to JSON
        Values by the ids of the HTML elements from which the script reads them.

    Examples
    --------
    >>> '<script type="application/json" id="data">["\\\\u003c/b>"]' in one_file("Title", "", "", {"data": ["</b>"]})
    True
    """
    script = "\n" + script.strip("\n").replace("</script", "<\\/script").replace("<!--", "<\\!--") + "\n"
    digest = base64.b64encode(sha256(script.encode()).digest()).decode()
    policy = (
        f"default-src 'none'; script-src 'sha256-{digest}'; style-src 'unsafe-inline'; img-src data: blob:; "
        f"base-uri 'none'; form-action 'none'"
    )
    elements = [f'<script type="application/json" id="{id}">{as_json(value)}</script>' for id, value in data.items()]
    return PAGE.format(
        policy=policy,
        title=escape(escaped(title)),
        icon=_inlined("icon.svg"),
        style=style.replace("</", "<\\/"),
        data="\n".join(elements),
        script=script,
    )


def as_json(value: Any) -> str:
    """Format JSON so that it may stand in HTML: no tag and no comment can begin in it."""
    return json.dumps(value, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")


def remedy_of(line: Mapping[str, Any]) -> Remedy:
    """Remedy for a frame, from its line of ``cameras.jsonl``."""
    if line["status"] == BROKEN:
        return UNREADABLE
    said = line.get("remedy")
    return Remedy(said, advice_from_json(line.get("advice"))) if said else IF_ON_PAINT


@dataclass(frozen=True)
class Commands:
    """Commands on the results of a run.

    Examples
    --------
    >>> commands = Commands("out", "match.mp4")
    >>> commands.how(Remedy("more markings in view, or labelled by hand", (Advice.BY_HAND,)))
    'fieldcalib open out (choose this frame, a marking on the map, and click along it; then Save)'
    >>> commands.how(IF_ON_PAINT).split(" (")[0]
    'fieldcalib open out'
    """

    folder: str = "FOLDER"
    """Folder of the results, as it is typed."""
    source: str = "INPUT"
    """Pictures or the video, as typed."""
    given: Collection[str] = ()
    """Options that were given, which are not advised again."""

    @classmethod
    def of(cls, results: Results) -> Commands:
        """Commands for some results; placeholders where the folder or the input is not known."""
        if results.folder is None:
            return cls()
        record = RunRecord.read(Path(results.folder))
        folder = shlex.quote(str(results.folder))
        return cls(folder) if record is None else cls(folder, shlex.join(record.source) or cls.source, record.given)

    def how(self, remedy: Remedy) -> str:
        """Command to type for a remedy, and what to do on the page."""
        if remedy is UNREADABLE:
            return f"put the file in its place, then {self._run}"
        said = f"fieldcalib open {self.folder} (choose this frame, a marking on the map, and click along it; then Save)"
        asked = [one for one in remedy.advice if one not in (Advice.LOOK, Advice.BY_HAND)]
        known = how(asked, Tool.COMMAND, self.given)
        return f"{said}; or {self._run} with {known}" if known else said

    @property
    def _run(self) -> str:
        return f"fieldcalib run {self.source} --out NEW-FOLDER"


OF_ANY = Commands()
"""Commands with placeholders, for results whose folder is not known."""


def write_report(results: Results, path: str | os.PathLike[str], title: str = "", *, progress: Progress = True) -> None:
    """Write the report of results as one HTML file, which opens in any browser without a network.

    Pictures are read again from the input, as far as it is still where it was.

    Parameters
    ----------
    results : Results
        Results, as from `fieldcalib.calibrate` or `fieldcalib.read`.
    path : path
        The file, e.g. ``report.html``.
    title : str
        Heading; by default the name of the folder of the results.
    progress : bool or function
        Whether progress is shown while pictures are read, or a function that gets it, see `fieldcalib.calibrate`.

    Raises
    ------
    ValueError
        If `results`, the path or the title is not what is expected.
    OSError
        If it cannot be written.
    """
    expect(results, Results, "those of fieldcalib.calibrate")
    path, title = file_path(path, "a report"), expect(title, str, "'Final'")
    if path.is_dir():
        raise ValueError(f"expected the path of a report, got a folder, {path}")
    field = next((one.field for one in results.values() if one.field is not None), soccer())
    commands = Commands.of(results)
    whole = ReportTable.of(results.frames.mains(), field, commands, with_views=len(results.frames.ids) <= MOST_VIEWS)
    pictures = thumbnails(results, frames_to_show(whole.count, whole.worst), progress)
    numbers = {id: number for number, id in enumerate(results.frames.ids)}
    states = _states(results, pictures, numbers, commands)
    table = whole.within(TABLE_BYTES, [numbers[id] for id in states])
    kept = np.array([numbers[id] for id in table.columns["id"]], dtype=int)
    title = title or ("fieldcalib" if results.folder is None else results.folder.resolve().name)
    report = {
        "title": title,
        **_clip(results, kept),
        "about": _about(results),
        "field": field_record(field),
        **table.to_record(),
        "states": states,
    }
    jpegs = {id: base64.b64encode(pictures[id]).decode() for id in states}
    data = {"report": report, "pictures": jpegs}
    write_text(path, one_file(title, styles(*STYLES), bundled("report"), data))


def _clip(results: Results, kept: IntArray) -> dict[str, Any]:
    """Whether there are plots over time, the frame rate, and the first frames of shots, for the `kept` frames."""
    video, rate, frames = results.video, results.frames_per_second, len(results.frames.ids)
    if video is None or rate is None:
        return {"plots": results.pictures.is_video, "rate": None, "cuts": []}
    readable = np.flatnonzero([id in results for id in results.frames.ids])
    starts = readable[np.array([shot.start for shot in video.shots], dtype=int)]
    return {"plots": True, "rate": rate * len(kept) / max(frames, 1), "cuts": np.searchsorted(kept, starts).tolist()}


def _about(results: Results) -> dict[str, Any]:
    """Facts about the run that the report shows."""
    if results.folder is not None and is_finished(results.folder):
        return read_summary(results.folder)
    notes = {"notes": list(results.notes)} if results.notes else {}
    return {
        "frames": len(results.frames.ids),
        **notes,
        "options": dict(results.options),
        "version": fieldcalib.__version__,
    }


def thumbnails(results: Results, numbers: Sequence[int], progress: Progress = False) -> dict[str, bytes]:
    """Make pictures of frames as JPEG, by id; `numbers` has the most important frames first.

    The frames of a video are read one after the other, and the pictures in memory stay within their budget of bytes.
    """
    ids, pictures = results.frames.ids, results.pictures
    found = Thumbnails([ids[number] for number in numbers if ids[number] in results], PICTURE_BYTES)
    with progress_bar(unit="frame", total=len(ids), desc="report", progress=progress) as counter:
        for id, image in _images(pictures, found.wanted):
            found.add(id, image)
            counter.update()
    return found.jpegs


def _images(pictures: Pictures, ids: Sequence[str]) -> Iterator[tuple[str, Image]]:
    """Yield all frames of a video, or the pictures of some frames, as far as they can be read."""
    if pictures.is_video:
        some = pictures.frames() if ids and pictures.has(ids[0]) else ()
        yield from ((frame.id, frame.image) for frame in some if frame.image is not None)
        return
    for id in ids:
        if pictures.has(id):
            with suppress(BrokenFileError):  # replaced since
                yield id, pictures.image(id)


def _states(
    results: Results, pictures: Mapping[str, bytes], numbers: Mapping[str, int], commands: Commands
) -> dict[str, Any]:
    """Data that is drawn on the pictures of frames, for as many frames as fit into `STATE_BYTES`."""
    states: dict[str, Any] = {}
    size = 0
    for id, jpeg in pictures.items():
        line = results.frames.main(numbers[id])
        said = {"remedy": line["remedy"], "here": commands.how(remedy_of(line))} if line.get("remedy") else {}
        state = {**said, **_drawn(results[id], stored_size(jpeg))}
        size += len(as_json(state))
        if size > STATE_BYTES:
            break
        states[id] = state
    return states


def _drawn(calibration: Calibration, shape: tuple[int, int] | None) -> dict[str, Any]:
    """Data that is drawn of a calibration; `shape` is the size of its picture."""
    camera = calibration.camera
    width, height = (shape or (1, 1)) if camera is None else camera.image_size
    size = {"width": width, "height": height}
    if camera is None:
        return size
    field = calibration.field or soccer()
    curves, view = curves_of(camera, field, calibration.markings), view_of(camera, field)
    return size | {"camera": camera_record(calibration), "curves": curves, "view": view}


@dataclass(frozen=True)
class Reason:
    """A reason for verdicts that are not good, and what to do about it."""

    verdict: str
    words: str
    """The reason: what the frames say of their cameras, with the span of its numbers, or the words of the first."""
    remedy: str
    how: str
    """Command to type, and what to do on the page."""
    count: int
    """Number of frames."""


@dataclass(frozen=True)
class ReportTable:
    """The table of frames of a report, as columns, and the reasons for verdicts."""

    columns: Mapping[str, Sequence[Any]]
    reasons: Sequence[Reason]
    count: int
    """Number of frames of the run; the table may have fewer."""

    @classmethod
    def of(
        cls, lines: Iterable[Mapping[str, Any]], field: Field, commands: Commands = OF_ANY, *, with_views: bool = True
    ) -> ReportTable:
        """Make the table from the lines of ``cameras.jsonl``, optionally with the ground that each frame shows."""
        seen = field if with_views else None
        rows, keys, found = [], list[tuple[str, str]](), dict[tuple[str, str], Finding]()
        remedies: dict[tuple[str, str], Counter[Remedy]] = {}
        for line in lines:
            row = _row(line, seen)
            key = row["verdict"], kind_of(line)[0]
            if key[0] != Verdict.GOOD:
                reason = first_reason(line)
                found[key] = found[key].joined(reason) if key in found else reason
                remedies.setdefault(key, Counter())[remedy_of(line)] += 1
            rows.append(row)
            keys.append(key)
        counts = {key: each.total() for key, each in remedies.items()}
        ordered = sorted(counts, key=lambda key: (key[0] == Verdict.CHECK, -counts[key]))
        numbers = {key: number for number, key in enumerate(ordered)}
        columns = {name: [row[name] for row in rows] for name in (rows[0] if rows else _row(NOTHING, seen))}
        columns["group"] = [numbers.get(key, -1) for key in keys]
        reasons = []
        for key in ordered:
            ((remedy, _),) = remedies[key].most_common(1)
            reasons.append(Reason(key[0], str(found[key]), remedy.text, commands.how(remedy), counts[key]))
        return cls(columns, reasons, len(rows))

    @property
    def worst(self) -> list[int]:
        """Numbers of the frames, worst first."""
        concern = self.columns["concern"]
        return sorted(range(len(concern)), key=lambda number: (-concern[number], number))

    def within(self, most_bytes: float, needed: Collection[int]) -> ReportTable:
        """Reduce the table to a number of bytes; the rows of all `needed` frames stay.

        Views are dropped first, then the reasons of good frames, then frames that are neither needed nor among the
        worst.
        """
        if self._size() <= most_bytes:
            return self
        verdicts, reasons = self.columns["verdict"], self.columns["reason"]
        short = self._with(view=[None] * len(verdicts))
        if short._size() > most_bytes:
            pairs = zip(verdicts, reasons, strict=True)
            short = short._with(reason=["" if verdict == Verdict.GOOD else reason for verdict, reason in pairs])
        order, most, all_rows = frames_to_show(len(verdicts), self.worst, len(verdicts)), len(verdicts), short
        while short._size() > most_bytes and most > 1:
            most = most * 4 // 5
            some = sorted({*order[:most], *needed})
            short = all_rows._with(
                **{name: [values[number] for number in some] for name, values in all_rows.columns.items()}
            )
        return short

    def _with(self, **columns: Sequence[Any]) -> ReportTable:
        return changed(self, columns={**self.columns, **columns})

    def _size(self) -> int:
        return len(as_json(self._coded()))

    def _coded(self) -> dict[str, Any]:
        return {name: coded(values) for name, values in self.columns.items()}

    def to_record(self) -> dict[str, Any]:
        """The table for JSON."""
        return {"frames": self._coded(), "reasons": [asdict(one) for one in self.reasons], "count": self.count}


def coded(values: Sequence[Any]) -> Sequence[Any] | dict[str, Any]:
    """Encode a column for JSON: unchanged, or as its few different texts and the number of the text in each row.

    Examples
    --------
    >>> coded(["good", "good", "check"] * 4), coded([1.5, 2.5])
    ({'texts': ['good', 'check'], 'rows': [0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1]}, [1.5, 2.5])
    """
    if not all(one is None or isinstance(one, str) for one in values):
        return values
    numbers = {text: number for number, text in enumerate(dict.fromkeys(values))}
    if 4 * len(numbers) > len(values):
        return values
    return {"texts": list(numbers), "rows": [numbers[text] for text in values]}


def _row(line: Mapping[str, Any], field: Field | None) -> dict[str, Any]:
    """Values of a frame; without a field there is no view."""
    row, has_camera = Row.of_line(line), line.get("K") is not None
    return {
        "id": line["id"],
        "verdict": row.verdict,
        "reason": row.reason[:MOST_LETTERS],
        "concern": row.concern if has_camera else 1.0,
        **{name: _rounded(getattr(row, name), 2) for name in ANGLE_NAMES},
        "focal_length": _rounded(row.focal_length, 1),
        "probability": _rounded(line.get("probability_right_1m"), 3),
        "basis": row.basis,
        "view": _view(line, field) if has_camera and field is not None else None,
    }


def _rounded(value: float | None, digits: int) -> float | None:
    return None if value is None else round(value, digits)


def _view(line: Mapping[str, Any], field: Field) -> list[float]:
    """Coordinates x, y, x, y, ... of the ground in view, metres."""
    return [round(value, 1) for X in view_of(Camera.from_dict(line), field, VIEW_POINTS // 4) for value in X]
