"""Cameras of frames for export, and checks of what a format cannot hold.

The camera in the axes of computer graphics: world x right, y away from the main camera, z up; it looks along -z.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from typing import TypeAlias

import numpy as np

from fieldcalib._types import Array
from fieldcalib.geometry.camera import Camera
from fieldcalib.geometry.homography import dehomogenize, homogenize
from fieldcalib.geometry.lens.model import nonzero_coefficients

# World to world and camera to camera: half a turn about x, its own inverse.
TURN = np.diag([1.0, -1.0, -1.0])

FrameCameras: TypeAlias = Mapping[str, Camera | None]  # by id, in the order of the frames; None: without camera

IMAGE_NAMES = "<id>.jpg"
PIXELS_PER_AXIS = 17  # of the grid on which two cameras are compared


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


def with_cameras(frames: FrameCameras) -> dict[str, Camera]:
    """The frames that have a camera.

    Raises
    ------
    ValueError
        If there is none.
    """
    found = {id: camera for id, camera in frames.items() if camera is not None}
    if not found:
        raise ValueError(f"there is no camera to export: none of {len(frames)} frames has one")
    return found


def image_name(pattern: str, id: str) -> str:
    """The name of a frame's image: the pattern with the id in place of ``<id>``.

    Raises
    ------
    ValueError
        If the pattern has no ``<id>``.

    Examples
    --------
    >>> image_name("images/<id>.png", "00001")
    'images/00001.png'
    """
    if "<id>" not in pattern:
        raise ValueError(f"expected a name with <id> in it, as images/<id>.png, got {pattern!r}")
    return pattern.replace("<id>", id)


def csv_table(titles: Sequence[str], rows: Iterable[Sequence[object]]) -> bytes:
    """A table of CSV."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([titles, *rows])
    return text.getvalue().encode()


def lens_coefficients(id: str, camera: Camera, names: Sequence[str], tool: str) -> list[float]:
    """The coefficients of a lens that a format can hold, in the order of their OpenCV names.

    Raises
    ------
    ValueError
        If the lens has others that are not 0.

    Examples
    --------
    >>> camera = Camera.from_angles(0.0, 1.3, 0.0, 1500.0, (0, 56, -15), (960, 540), k=(0.1, 0, 0, 0, 0.2))
    >>> lens_coefficients("00001", camera, ("k1", "k2"), "the format")
    Traceback (most recent call last):
        ...
    ValueError: frame 00001: the format has k1, k2 of a lens, this one has k3 = 0.2 too: undistort the images, or ...
    """
    if camera.fisheye:
        raise ValueError(
            f"frame {id}: {tool} has no fisheye lens: undistort the images, or calibrate with another lens"
        )
    values = nonzero_coefficients(camera.dist)
    others = [f"{name} = {value:.4g}" for name, value in values.items() if name not in names]
    if others:
        raise ValueError(
            f"frame {id}: {tool} has {', '.join(names)} of a lens, this one has {', '.join(others)} too: undistort the "
            f"images, or calibrate with a simpler lens"
        )
    return [values.get(name, 0.0) for name in names]


def farthest_shift(camera: Camera, K: Array) -> float:
    """Largest displacement of a point of the image, pixels, if intrinsics K without a lens replace the camera's.

    Examples
    --------
    >>> camera = Camera.from_angles(0.0, 1.3, 0.0, 1500.0, (0, 56, -15), (960, 540))
    >>> farthest_shift(camera, camera.K + [[0.0, 0.0, 3.0], [0.0, 0.0, 4.0], [0.0, 0.0, 0.0]])
    5.0
    """
    axes = (np.linspace(0.0, size - 1.0, PIXELS_PER_AXIS) for size in camera.image_size)
    xy = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    moved = dehomogenize(homogenize(camera.normalized(xy)) @ K.T)
    return float(np.nanmax(np.linalg.norm(moved - xy, axis=-1)))  # NaN: no ray through the lens meets the pixel
