"""Cameras that take the same picture of a field that looks the same some steps further along.

Yard lines look alike every 5 yards (`Field.repeats`): where neither an end nor anything else in view tells which ones
they are, the camera moved along the field by some steps takes the same picture.
"""

from __future__ import annotations

from fieldcalib.fields.field import Field
from fieldcalib.geometry.camera import Camera

MOST_STEPS = 10  # by which a camera is moved along the field: half of one of American football


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
