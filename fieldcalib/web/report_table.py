"""The table of all frames of a report, as columns, with the reasons that frames share and what to do about them."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from dataclasses import replace as changed
from typing import Any

from fieldcalib.assess.remedies import Remedy
from fieldcalib.assess.result_record import ANGLE_NAMES
from fieldcalib.assess.words import Verdict
from fieldcalib.editor.table import Row
from fieldcalib.fields.field import Field
from fieldcalib.geometry.camera import Camera
from fieldcalib.io.results import BROKEN
from fieldcalib.run_folder.outcome import kind_of
from fieldcalib.web.bundle import as_json
from fieldcalib.web.records import view_of
from fieldcalib.web.report_advice import OF_ANY, Commands, remedy_of
from fieldcalib.web.thumbnails import frames_to_show

VALUES = re.compile(r"'[^']*'|[0-9]+(?:\.[0-9]+)?")  # names and numbers: they differ among frames of one reason
VIEW_POINTS = 12  # of the polygon of the ground in view
MOST_LETTERS = 240  # of a reason
NOTHING: Mapping[str, Any] = {"id": "", "status": BROKEN, "message": ""}


@dataclass(frozen=True)
class Reason:
    """A reason for verdicts that are not good, and what to do about it."""

    verdict: str
    words: str
    """With an ellipsis for names and numbers where there are several frames."""
    remedy: str
    how: str
    """What to type, and what to do there."""
    count: int
    """Number of frames."""


@dataclass(frozen=True)
class ReportTable:
    """Columns with a value for each frame of a run."""

    columns: Mapping[str, Sequence[Any]]
    reasons: Sequence[Reason]
    count: int
    """Number of frames of the run, of which the table may have fewer."""

    @classmethod
    def of(
        cls,
        lines: Iterable[Mapping[str, Any]],
        field: Field,
        commands: Commands = OF_ANY,
        *,
        with_views: bool = True,
    ) -> ReportTable:
        """The table of the lines of frames in ``cameras.jsonl``, perhaps with the ground that each frame shows."""
        seen = field if with_views else None
        rows, keys, examples = [], list[tuple[str, str]](), dict[tuple[str, str], str]()
        remedies: dict[tuple[str, str], Counter[Remedy]] = {}
        for line in lines:
            row = _row(line, seen)
            key = row["verdict"], kind_of(line)[0]
            examples.setdefault(key, row["reason"].partition("; ")[0])
            if key[0] != Verdict.GOOD:
                remedies.setdefault(key, Counter())[remedy_of(line)] += 1
            rows.append(row)
            keys.append(key)
        counts = {key: found.total() for key, found in remedies.items()}
        ordered = sorted(counts, key=lambda key: (key[0] == Verdict.CHECK, -counts[key]))
        numbers = {key: number for number, key in enumerate(ordered)}
        columns = {name: [row[name] for row in rows] for name in (rows[0] if rows else _row(NOTHING, seen))}
        columns["group"] = [numbers.get(key, -1) for key in keys]
        reasons = []
        for key in ordered:
            words = examples[key] if counts[key] == 1 else VALUES.sub("…", examples[key])
            ((remedy, _),) = remedies[key].most_common(1)
            reasons.append(Reason(key[0], words, remedy.text, commands.how(remedy), counts[key]))
        return cls(columns, reasons, len(rows))

    @property
    def worst(self) -> list[int]:
        """Numbers of the frames, worst first."""
        concern = self.columns["concern"]
        return sorted(range(len(concern)), key=lambda number: (-concern[number], number))

    def within(self, most_bytes: float, needed: Collection[int]) -> ReportTable:
        """As much of the table as fits a number of bytes, with the rows of all `needed` frames.

        Views go first, then the reasons of good frames, then frames that are neither among the worst nor needed.
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
    """A column for JSON: as it is, or its few different texts and, for each row, the number of its text.

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
    """The values of a frame; without a field no view."""
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
    width, height = line["image_size"]
    camera = Camera(line["K"], line["R"], line["C"], (width, height), line["dist"])
    return [round(value, 1) for X in view_of(camera, field, VIEW_POINTS // 4) for value in X]
