"""Lines that most courts have: from side to side, from end to end, and a net that hangs through."""

from __future__ import annotations

from fieldcalib.fields.mirrored import with_top
from fieldcalib.fields.segments import Line, Segment


def across(x: float, y: float, z: float = 0.0) -> Line:
    """The line at x from -y to y, metres.

    Examples
    --------
    >>> across(14.0, 7.5)
    Line(start=(14.0, -7.5, 0.0), end=(14.0, 7.5, 0.0))
    """
    return Line((x, -y, z), (x, y, z))


def along(x: float, y: float) -> Line:
    """The line at y from -x to x, metres.

    Examples
    --------
    >>> along(14.0, 7.5)
    Line(start=(-14.0, 7.5, 0.0), end=(14.0, 7.5, 0.0))
    """
    return Line((-x, y, 0.0), (x, y, 0.0))


def hanging_net(post: float, height: float, height_at_posts: float) -> dict[str, Segment]:
    """The upper edge of a net in two halves, and its posts, at so many metres from the middle of the court.

    Examples
    --------
    >>> hanging_net(5.0, 0.88, 0.92)["Net bottom"]
    Line(start=(0.0, 0.0, -0.88), end=(0.0, 5.0, -0.92))
    """
    top = (0.0, post, -height_at_posts)
    return with_top(
        {"Net post bottom": Line(top, (0.0, post, 0.0)), "Net bottom": Line((0.0, 0.0, -height), top)},
    )
