"""What a person has said about frames, as JSON, for the journal and the files of an editor."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from fieldcalib._checks import is_number
from fieldcalib.editor.frame import Edit
from fieldcalib.editor.known import Known
from fieldcalib.editor.marks import FARTHEST, Mark, Marks
from fieldcalib.io.files import WRONG_RECORD


def edit_to_record(edit: Edit) -> dict[str, Any]:
    """An edit as a dict for `json.dumps`; the inverse is `edit_from_record`."""
    return {
        "marks": [[one.label, one.x, one.y, one.by_hand] for one in edit.marks.all],
        "known": asdict(edit.known),
        "automatic": edit.automatic,
    }


def edit_from_record(record: dict[str, Any]) -> Edit:
    """The edit of a dict of `edit_to_record`.

    Raises
    ------
    ValueError
        If it is none.

    Examples
    --------
    >>> edit = Edit(Marks().added("Middle line", [(480, 100)]), Known(focal_length=1500.0))
    >>> edit_from_record(edit_to_record(edit)) == edit
    True
    """
    try:
        marks = [Mark(str(label), *_pixel(x, y), bool(by_hand)) for label, x, y, by_hand in record["marks"]]
        known = record["known"].items()
        values: dict[str, Any] = {name: tuple(one) if isinstance(one, list) else one for name, one in known}
        return Edit(Marks(tuple(marks)), Known(**values), bool(record["automatic"]))
    except WRONG_RECORD as error:
        raise ValueError(f"is no edit of a frame: {error}") from None


def _pixel(x: Any, y: Any) -> tuple[float, float]:
    """A pixel of numbers that are finite."""
    for value in (x, y):
        if not is_number(value) or not abs(value) < FARTHEST:
            raise ValueError(f"expected pixels below {FARTHEST:g}, got {value!s:.40}")
    return float(x), float(y)
