"""The other camera that takes the same picture of a field that looks the same from both sides.

A court turned by 180 degrees about its centre mark is the same court, and so is its picture from a camera that is
turned with it. Labels name the ends; what is found by search does not. Of both cameras that one is taken that stands
in front of the near touchline (y > 0) or, where it stands farther beyond an end than beyond a touchline, behind the
left end (x < 0); the other one is its alternative.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fieldcalib.assess.result import Calibration
from fieldcalib.fields.field import Field
from fieldcalib.geometry.camera import Camera

TURN = np.array([-1.0, -1.0, 1.0])


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


def with_twin(calibration: Calibration, field: Field) -> Calibration:
    """The calibration of a camera that was found by search, on the usual side, with the other one as alternative."""
    if calibration.camera is None:
        return calibration
    twin = twin_of(calibration.camera, field)
    return calibration if twin is None else replace(calibration, alternatives=(twin,))
