"""Lines of courts: from side to side, from end to end, on the ground and upright, and a net that sags."""

from __future__ import annotations

from fieldcalib.fields.segments import Line, Segment

CENTRE = (0.0, 0.0, 0.0)


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


def on_ground(start: tuple[float, float], end: tuple[float, float]) -> Line:
    """The line on the ground from one (x, y) to another, metres.

    Examples
    --------
    >>> on_ground((14.0, 7.5), (14.0, 9.0))
    Line(start=(14.0, 7.5, 0.0), end=(14.0, 9.0, 0.0))
    """
    return Line((*start, 0.0), (*end, 0.0))


def upright(x: float, y: float, top: float, bottom: float = 0.0) -> Line:
    """The vertical line at (x, y) between two heights, downwards, metres.

    Examples
    --------
    >>> upright(20.0, 1.5, 2.0)
    Line(start=(20.0, 1.5, -2.0), end=(20.0, 1.5, 0.0))
    """
    return Line((x, y, -top), (x, y, -bottom + 0.0))


def hanging_net(post: float, height: float, height_at_posts: float) -> dict[str, Segment]:
    """The near half of the upper edge of a net that sags, and the near post, `post` metres from the middle.

    Examples
    --------
    >>> hanging_net(5.0, 0.88, 0.92)["Net bottom"]
    Line(start=(0.0, 0.0, -0.88), end=(0.0, 5.0, -0.92))
    """
    return {
        "Net post bottom": upright(0.0, post, height_at_posts),
        "Net bottom": Line((0.0, 0.0, -height), (0.0, post, -height_at_posts)),
    }
