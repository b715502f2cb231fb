"""Tables for notebooks; whatever a file or a user named is escaped."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from html import escape

ROWS = 10  # of a long table


def table(rows: Mapping[str, str]) -> str:
    """A table with a name and a value in each row.

    Examples
    --------
    >>> table({"file": "<b>.png"})
    '<table><tr><th>file</th><td>&lt;b&gt;.png</td></tr></table>'
    """
    cells = (f"<tr><th>{escape(name)}</th><td>{escape(value)}</td></tr>" for name, value in rows.items())
    return f"<table>{''.join(cells)}</table>"


def long_table(titles: Sequence[str], rows: Iterable[Sequence[str]], count: int) -> str:
    """A table with a line of titles, and below it how many of `count` rows are shown, if not all are.

    Examples
    --------
    >>> long_table(["frame"], [["7"]], 2)
    '<table><tr><th>frame</th></tr><tr><td>7</td></tr></table><p>1 of 2 rows</p>'
    """
    lines = ["".join(f"<td>{escape(cell)}</td>" for cell in row) for row in rows]
    head = "".join(f"<th>{escape(title)}</th>" for title in titles)
    body = "".join(f"<tr>{line}</tr>" for line in (head, *lines))
    more = f"<p>{len(lines)} of {count} rows</p>" if len(lines) < count else ""
    return f"<table>{body}</table>{more}"


def spread(count: int) -> list[int]:
    """Indices of `ROWS` of some rows, spread evenly from the first to the last one; of all where there are fewer.

    Examples
    --------
    >>> spread(3), spread(100)
    ([0, 1, 2], [0, 11, 22, 33, 44, 55, 66, 77, 88, 99])
    """
    shown = min(count, ROWS)
    return [round(index * (count - 1) / max(shown - 1, 1)) for index in range(shown)]
