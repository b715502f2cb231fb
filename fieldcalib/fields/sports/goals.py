"""Goals, and the areas in front of them whose border has a constant distance from the goal."""

from __future__ import annotations

import numpy as np

from fieldcalib.fields.segments import Arc, Segment
from fieldcalib.fields.sports.lines import across, upright


def right_goal(x: float, width: float, height: float, thickness: float) -> dict[str, Segment]:
    """Crossbar and near post of the right goal, whose middles stand on the line x.

    Width is measured between the posts, height under the crossbar; `thickness` is theirs; all in metres.

    Examples
    --------
    >>> right_goal(20.0, 3.0, 2.0, 0.08)["Goal right post bottom"]
    Line(start=(20.0, 1.54, -2.04), end=(20.0, 1.54, 0.0))
    """
    y, top = 0.5 * (width + thickness), height + 0.5 * thickness
    return {"Goal right crossbar": across(x, y, -top), "Goal right post bottom": upright(x, y, top)}


def right_area(name: str, x: float, y: float, distance: float, reach: float = np.inf) -> dict[str, Segment]:
    """The line at one distance from a goal between (x, -y) and (x, y): its straight piece and the near arc.

    The arc ends at the line x, or at a distance of `reach` from the middle of the field; all in metres.

    Examples
    --------
    >>> list(right_area("Goal area", 20.0, 1.5, 6.0))
    ['Goal area right line', 'Goal area right arc bottom']
    """
    start = np.pi - np.arcsin(min((reach - y) / distance, 1.0))
    return {
        f"{name} right line": across(x - distance, y),
        f"{name} right arc bottom": Arc((x, y, 0.0), distance, float(start), np.pi),
    }
