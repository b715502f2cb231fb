"""Edits of a frame as the page sends them: checked, and applied to the editor."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from fieldcalib.editor.edit import FARTHEST
from fieldcalib.editor.editor import Editor, StaleEdit
from fieldcalib.editor.frame import FrameEditor

MOST_MARKS = 2000  # of a frame
KNOWN = ("focal_length", "position", "principal_point", "lens", "field_size", "aspect")


def apply(editor: Editor, number: int, body: Mapping[str, Any]) -> None:
    """Apply an edit to a frame.

    Raises
    ------
    ValueError
        If it is no edit, or cannot be applied.
    StaleEdit
        If the frame was changed since the revision that it is of.
    """
    revision = body.get("revision")
    if not isinstance(revision, int) or isinstance(revision, bool):
        raise ValueError("expected the revision of the frame, a whole number: load the frame first")
    what = body.get("do")
    do = EDITS.get(what) if isinstance(what, str) else None
    if do is None:
        raise ValueError(f"expected an edit, one of {', '.join(EDITS)}, got {str(what)[:40]!r}")
    if revision != editor.revision(number):
        raise StaleEdit(f"the frame was changed meanwhile (revision {editor.revision(number)}, not {revision})")
    changed = do(editor, number, body)
    if len(changed.marks) > MOST_MARKS:
        raise ValueError(f"expected at most {MOST_MARKS} marks in a frame")
    editor.put(number, changed, revision)


def _mark(editor: Editor, number: int, body: Mapping[str, Any]) -> FrameEditor:
    return editor.begun(number).mark(_label(body), _points(body.get("xy")), snap=_snap(body))


def _move(editor: Editor, number: int, body: Mapping[str, Any]) -> FrameEditor:
    to = body.get("to")
    if not isinstance(to, dict) or not all(isinstance(key, str) and key.isdecimal() and len(key) < 8 for key in to):
        raise ValueError('expected places by numbers of marks, as {"0": [480, 100]}')
    return editor.begun(number).move({int(key): _points([xy])[0] for key, xy in to.items()}, snap=_snap(body))


def _relabel(editor: Editor, number: int, body: Mapping[str, Any]) -> FrameEditor:
    return editor.begun(number).relabel(_numbers(body), _label(body))


def _remove(editor: Editor, number: int, body: Mapping[str, Any]) -> FrameEditor:
    return editor.begun(number).remove(_numbers(body))


def _know(editor: Editor, number: int, body: Mapping[str, Any]) -> FrameEditor:
    values = body.get("values")
    if not isinstance(values, dict) or not values.keys() <= set(KNOWN):
        raise ValueError(f"expected values of {', '.join(KNOWN)}")
    return editor.begun(number).know(**{name: tuple(v) if isinstance(v, list) else v for name, v in values.items()})


def _automatic(editor: Editor, number: int, body: Mapping[str, Any]) -> FrameEditor:
    return editor.automatic(number)


def _copy(editor: Editor, number: int, body: Mapping[str, Any]) -> FrameEditor:
    other = body.get("from")
    if not isinstance(other, int) or isinstance(other, bool) or not 0 <= other < len(editor) or other == number:
        raise ValueError(f"expected the number of another frame, from 0 to {len(editor) - 1}")
    return editor.with_marks_of(number, other)


EDITS: Mapping[str, Callable[[Editor, int, Mapping[str, Any]], FrameEditor]] = {
    "mark": _mark,
    "move": _move,
    "relabel": _relabel,
    "remove": _remove,
    "know": _know,
    "undo": lambda editor, number, body: editor[number].undo(),
    "redo": lambda editor, number, body: editor[number].redo(),
    "clear": lambda editor, number, body: editor.begun(number).clear(),
    "automatic": _automatic,
    "copy": _copy,
}


def _label(body: Mapping[str, Any]) -> str:
    label = body.get("label")
    if not isinstance(label, str) or len(label) > 200:
        raise ValueError("expected the label of a marking, a text of at most 200 characters")
    return label


def _points(value: Any) -> Any:
    """Checked pixels (N, 2)."""
    try:
        xy = np.array(value, dtype=float)
    except (TypeError, ValueError):
        xy = np.zeros(0)
    if xy.ndim != 2 or xy.shape[1] != 2 or not len(xy) or len(xy) > MOST_MARKS or not np.all(np.abs(xy) < FARTHEST):
        raise ValueError("expected pixels as [[x, y], ...], finite numbers")
    return xy


def _numbers(body: Mapping[str, Any]) -> list[int]:
    value = body.get("numbers")
    if not isinstance(value, list) or not all(isinstance(one, int) and not isinstance(one, bool) for one in value):
        raise ValueError("expected the numbers of marks, as [0, 3]")
    return value


def _snap(body: Mapping[str, Any]) -> bool:
    value = body.get("snap", True)
    if not isinstance(value, bool):
        raise ValueError("expected true or false for snap")
    return value
