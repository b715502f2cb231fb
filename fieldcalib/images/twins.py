"""Other cameras that take the same picture: of a field that looks the same from both sides, or a step further on.

A court turned by 180 degrees about its centre mark is the same court, and so is its picture from a camera that is
turned with it. Labels name the ends; what is found by search does not. Of both cameras that one is taken that stands
in front of the near touchline (y > 0) or, where it stands farther beyond an end than beyond a touchline, behind the
left end (x < 0); the other one is its alternative.

Yard lines look alike every 5 yards (`Field.repeats`): where neither an end nor anything else in view tells which ones
they are, the camera moved along the field by some steps takes the same picture.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fieldcalib.assess.result import Calibration
from fieldcalib.fields.field import Field
from fieldcalib.geometry.camera import Camera

TURN = np.array([-1.0, -1.0, 1.0])
MOST_STEPS = 10  # by which a camera is moved along a field that repeats: half of it


def twin_of(camera: Camera, field: Field) -> Camera | None:
    """The camera turned by 180 degrees about the centre mark; None where the field looks different from there.

    Examples
    --------
    >>> from fieldcalib.fields import tennis
    >>> camera = Camera.from_angles(1.5, 1.3, 0.0, 1400.0, (-32.0, 1.0, -9.0), (960, 540))
    >>> twin_of(camera, tennis()).C.tolist()
    [32.0, -1.0, -9.0]
    """
    if len(field.symmetric) < len(field):
        return None
    return Camera(camera.K, camera.R * TURN, camera.C * TURN, camera.image_size, camera.dist)


def moved_by_steps(camera: Camera, field: Field) -> list[Camera]:
    """The camera moved along the field by up to `MOST_STEPS` steps after which its markings look alike; [] without any.

    Examples
    --------
    >>> from fieldcalib.fields import american_football
    >>> camera = Camera.from_angles(0.1, 1.3, 0.0, 1400.0, (5.0, 70.0, -20.0), (960, 540))
    >>> [round(float(one.C[0]), 1) for one in moved_by_steps(camera, american_football("nfl"))][:4]
    [0.4, 9.6, -4.1, 14.1]
    """
    if field.repeats is None:
        return []
    steps = [sign * k * field.repeats for k in range(1, MOST_STEPS + 1) for sign in (-1.0, 1.0)]
    return [Camera(camera.K, camera.R, camera.C + (x, 0.0, 0.0), camera.image_size, camera.dist) for x in steps]


def with_twin(calibration: Calibration, field: Field) -> Calibration:
    """The calibration of a camera that was found by search, on the usual side, the other one its first alternative."""
    if calibration.camera is None:
        return calibration
    twin = twin_of(calibration.camera, field)
    return calibration if twin is None else replace(calibration, alternatives=(twin, *calibration.alternatives))
