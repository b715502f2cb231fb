"""Random cameras on main stands, as arrays, for the database and for training."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import partial
from types import MappingProxyType
from typing import TypeAlias

import numpy as np

from fieldcalib._types import Array, BoolArray, IntArray
from fieldcalib.fields.traits import MAIN_CENTER, CameraDistribution, focal_length_from_fov
from fieldcalib.geometry.rotation import rotation_from_angles

IMAGE_SIZE = (1280, 720)
"""Width and height in pixels of the images that focal lengths and homographies are for."""

# Chen and Little's distribution, which they fitted to the cameras of WC14's training images. Their origin is the near
# left corner of a field of 105 x 68 m; y points away from the camera and z up.
CENTRE_MEAN, CENTRE_SIGMA = (52.366, -45.157, 16.822), (2.232, 9.383, 2.949)  # metres
FOCAL_LENGTH_MEAN, FOCAL_LENGTH_SIGMA = 3018.18, 716.07  # px
PAN, BELOW_HORIZON, ROLL_SIGMA = (-35.0, 35.0), (5.0, 15.0), 0.2  # degrees
CORNER = (52.5, 34.0)  # metres from the centre mark
LEAST_FOCAL_LENGTH, LEAST_HEIGHT = 500.0, 1.0  # px, m: smaller samples are raised to these

# Largest differences between the two cameras of a similar pair: degrees, degrees, px.
PAIR_PAN, PAIR_TILT, PAIR_FOCAL_LENGTH = 0.75, 0.375, 15.0


@dataclass(frozen=True)
class Cameras:
    """Parameters of N cameras with square pixels, whose principal point is the centre of the image."""

    angles: Array
    """Pan, tilt, roll in radians, (N, 3)."""
    focal_length: Array
    """Focal lengths in pixels of an image of IMAGE_SIZE, (N,)."""
    C: Array
    """Centres in metres, (N, 3)."""

    def __len__(self) -> int:
        return len(self.focal_length)

    def __getitem__(self, index: IntArray | BoolArray | slice) -> Cameras:
        return Cameras(self.angles[index], self.focal_length[index], self.C[index])

    @classmethod
    def joined(cls, parts: Sequence[Cameras]) -> Cameras:
        """The cameras of all parts, one after the other."""
        return cls(*(np.concatenate([getattr(part, one.name) for part in parts]) for one in fields(cls)))

    @property
    def homographies(self) -> Array:
        """Homographies ``K R [e1 e2 -C]``, (N, 3, 3), from field points (x, y, 1) in metres to pixels of IMAGE_SIZE."""
        K = np.zeros((len(self), 3, 3))
        K[:, 0, 0] = K[:, 1, 1] = self.focal_length
        K[:, :, 2] = (*np.divide(IMAGE_SIZE, 2.0), 1.0)
        view = np.broadcast_to(np.eye(3), K.shape).copy()
        view[:, :, 2] = -self.C
        return np.asarray(K @ rotation_from_angles(self.angles) @ view)


Draw: TypeAlias = Callable[[int, np.random.Generator], Cameras]
"""Draws a number of random cameras."""


def cameras_of_chen(count: int, rng: np.random.Generator) -> Cameras:
    """Draw cameras from Chen and Little's distribution.

    Examples
    --------
    >>> cameras = cameras_of_chen(10_000, np.random.default_rng(0))
    >>> cameras.C.mean(axis=0).round() + 0.0
    array([  0.,  79., -17.])
    """
    x, y, z = rng.normal(CENTRE_MEAN, CENTRE_SIGMA, (count, 3)).T
    C = np.stack([x - CORNER[0], CORNER[1] - y, -np.maximum(z, LEAST_HEIGHT)], axis=1)
    angles = _angles(count, rng)
    f = np.maximum(rng.normal(FOCAL_LENGTH_MEAN, FOCAL_LENGTH_SIGMA, count), LEAST_FOCAL_LENGTH)
    return Cameras(angles, f, C)


def cameras_of_stand(stand: CameraDistribution, count: int, rng: np.random.Generator) -> Cameras:
    """Draw cameras with field of view and position uniform in a stand's ranges, and Chen and Little's angles."""
    fov, *C = (rng.uniform(*limits, count) for limits in (stand.fov, stand.x, stand.y, stand.z))
    return Cameras(_angles(count, rng), focal_length_from_fov(np.radians(fov), IMAGE_SIZE[0]), np.stack(C, axis=1))


def _angles(count: int, rng: np.random.Generator) -> Array:
    """Draw pan, tilt and roll. In Chen and Little's code the axis of \"roll\" varies; here it is the optical axis."""
    tilt = 90.0 - rng.uniform(*BELOW_HORIZON, count)
    angles = np.stack([rng.uniform(*PAN, count), tilt, rng.normal(0.0, ROLL_SIGMA, count)], axis=1)
    return np.asarray(np.radians(angles))


CHEN, UNIFORM = "chen", "uniform"
DRAWS: Mapping[str, Draw] = MappingProxyType({CHEN: cameras_of_chen, UNIFORM: partial(cameras_of_stand, MAIN_CENTER)})
"""The distributions by name; "uniform" is the paper's U_FoV + U_xyz."""


def nearby(cameras: Cameras, rng: np.random.Generator) -> Cameras:
    """Draw for each camera another one at the same place with a similar view."""
    most = np.array([np.radians(PAIR_PAN), np.radians(PAIR_TILT), PAIR_FOCAL_LENGTH])
    pan, tilt, f = rng.uniform(-most, most, (len(cameras), 3)).T
    angles = cameras.angles + np.stack([pan, tilt, np.zeros_like(pan)], axis=1)
    return Cameras(angles, np.maximum(cameras.focal_length + f, 1.0), cameras.C)
