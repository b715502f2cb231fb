"""Hand-made cameras for the tests of pictures."""

import numpy as np
import pytest

from fieldcalib.geometry.camera import Camera

SIZE = (960, 540)


def camera(pan, tilt, f, C, roll=0.0, k=(0.0, 0.0)):
    """A camera from angles in degrees."""
    return Camera.from_angles(np.radians(pan), np.radians(tilt), np.radians(roll), f, C, SIZE, k=k)


BROADCAST = camera(-20, 78, 1800, (0, 70, -18))
CAMERAS = {
    "broadcast": BROADCAST,
    "wide, rolled": camera(10, 74, 800, (5, 60, -20), roll=5),
    "barrel lens": camera(25, 76, 900, (0, 66, -16), k=(-0.25, 0.03)),
    "cushion lens": camera(-25, 76, 900, (0, 66, -16), roll=-2, k=(0.3, 0.0)),
    "behind the goal": camera(90, 75, 700, (-80, 5, -15)),
    "on the field": camera(-60, 80, 500, (-30, 10, -1.7)),
    "on the centre mark, looking down": camera(30, 25, 300, (0, 0, -6)),
}
any_camera = pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)


def inside(xy):
    """Which of N pixels lie in the image."""
    return np.all((xy >= 0.0) & (xy <= np.array(SIZE) - 1.0), axis=1)
