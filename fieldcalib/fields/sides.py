"""The sides of a field that looks the same once it is turned by 180 degrees about its centre mark.

No marking tells such a field from the turned one, and no picture of its markings tells on which side of it the camera
is. By convention a camera is on the main side: in front of the near touchline (y > 0, where the main stand is) or, if
it is behind an end, behind the left one (x < 0). Left and right in labels of pictures are as seen from there. Turned by
180 degrees, that is the opposite side: beyond the far touchline, or behind the right end.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib._types import Array
from fieldcalib.fields.field import Field
from fieldcalib.fields.stands import CameraDistribution
from fieldcalib.geometry.camera import Camera

Side = Literal["main", "opposite"]
MAIN: Side = "main"
OPPOSITE: Side = "opposite"
SIDES: tuple[Side, ...] = get_args(Side)
BEHIND_MARGIN = 5.0  # m beyond the corners, between whose lines a camera is behind an end
TURN: Array = np.array([-1.0, -1.0, 1.0])


def looks_the_same_turned(field: Field) -> bool:
    """Whether all segments of a field have a counterpart once it is turned by 180 degrees.

    Examples
    --------
    >>> from fieldcalib.fields import soccer
    >>> looks_the_same_turned(soccer())
    True
    """
    return len(field.symmetric) == len(field)


def is_behind_end(C: ArrayLike, field: Field) -> bool:
    """Whether a place (3,), metres, is behind the left or the right end of a field, not beside it."""
    x, y, _ = np.abs(np.asarray(C, dtype=float))
    return bool(x > field.length / 2.0 and y <= field.width / 2.0 + BEHIND_MARGIN)


def side_of(C: ArrayLike, field: Field) -> Side:
    """The side of a field on which a place (3,), metres, is.

    Examples
    --------
    >>> from fieldcalib.fields import soccer
    >>> [side_of(C, soccer()) for C in ((10, 60, -15), (10, -60, -15), (-70, -3, -9), (70, 3, -9))]
    ['main', 'opposite', 'main', 'opposite']
    """
    x, y, _ = np.asarray(C, dtype=float)
    is_turned = x > 0.0 if is_behind_end(C, field) else y < 0.0
    return OPPOSITE if is_turned else MAIN


def turned_camera(camera: Camera) -> Camera:
    """The camera turned by 180 degrees about the centre mark: it takes the same picture of the turned field."""
    return camera.moved(camera.R * TURN, camera.C * TURN)


def side_of_stand(stand: CameraDistribution, field: Field) -> Side:
    """The side of a field on which the middle of a stand is."""
    return side_of([np.mean(stand.x), np.mean(stand.y), np.mean(stand.z)], field)


def turned_stand(stand: CameraDistribution) -> CameraDistribution:
    """The stand turned by 180 degrees about the centre mark.

    Examples
    --------
    >>> from fieldcalib.fields.stands import BEHIND_LEFT_GOAL, BEHIND_RIGHT_GOAL
    >>> turned_stand(BEHIND_LEFT_GOAL).x == BEHIND_RIGHT_GOAL.x
    True
    """
    pan = np.array(stand.pan)
    pan = pan + (180.0 if np.mean(pan) < 0.0 else -180.0)
    x, y = ((-high, -low) for low, high in (stand.x, stand.y))
    return replace(stand, name=f"{stand.name}, turned", pan=tuple(pan.tolist()), x=x, y=y)
