"""The camera in the axes of computer graphics: world x right, y away from the main camera, z up; it looks along -z."""

from __future__ import annotations

import numpy as np

from fieldcalib._types import Array
from fieldcalib.geometry.camera import Camera

# World to world and camera to camera: half a turn about x, its own inverse.
TURN = np.diag([1.0, -1.0, -1.0])


def camera_to_world(camera: Camera) -> Array:
    """4 x 4 pose ``[[S R^T S, S C], [0, 1]]`` in metres, ``S = diag(1, -1, -1)``; its columns are right, up, backwards.

    Examples
    --------
    >>> camera = Camera.from_angles(0.0, np.radians(90), 0.0, 1500.0, C=(5, 60, -15), image_size=(960, 540))
    >>> camera_to_world(camera)[:3].round(9) + 0.0  # backwards is -y, towards the camera's own stand
    array([[  1.,   0.,   0.,   5.],
           [  0.,   0.,  -1., -60.],
           [  0.,   1.,   0.,  15.]])
    """
    pose = np.eye(4)
    pose[:3, :3] = TURN @ camera.R.T @ TURN
    pose[:3, 3] = TURN @ camera.C
    return pose
