"""Where a camera stands, and its views from there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fieldcalib._types import Array, BoolArray, IntArray
from fieldcalib.fields.field import Field
from fieldcalib.fields.stands import CameraDistribution
from fieldcalib.geometry.camera import Camera
from fieldcalib.geometry.rotation import rotation_from_angles
from fieldcalib.images.search.court_hypotheses import Cameras

BEYOND = 1.05  # half extents of the field within which the middle of a picture looks
NEAR = 3.4  # standard deviations: 99 % of chi-squared with three degrees of freedom
WIDTHS = 1.96  # standard deviations between the mean and the end of a range of a stand


@dataclass(frozen=True, eq=False)
class Place:
    """Where a camera stands, and how it may be zoomed."""

    C: Array
    """Metres, (3,)."""
    sigma: Array
    """Standard deviations, (3,)."""
    zoom: tuple[float, float]
    """Least and largest focal length, in widths of the picture."""
    bend: float = 0.0
    """Distortion of its pictures (`fieldcalib.images.search.straightened.Bend`), about the same for all focal
    lengths."""

    def focal_lengths(self, width: int, step: float) -> Array:
        """Focal lengths, pixels, of a picture of a width; from one to the next, its border moves by a step, pixels."""
        low, high = np.log(np.array(self.zoom) * width)
        return np.asarray(np.exp(np.arange(low, high + 1e-9, 2.0 * step / width)))

    def is_near(self, camera: Camera) -> bool:
        """Whether a camera may stand there."""
        return float(np.linalg.norm((camera.C - self.C) / self.sigma)) < NEAR

    def stand(self, field: Field) -> CameraDistribution:
        """The place as a prior: the nearest stand of the field, narrowed to the place."""
        middle = np.array([[sum(stand.x) / 2.0, sum(stand.y) / 2.0, sum(stand.z) / 2.0] for stand in field.stands])
        nearest = field.stands[int(np.argmin(np.linalg.norm(middle - self.C, axis=1)))]
        low, high = (self.C - WIDTHS * self.sigma).tolist(), (self.C + WIDTHS * self.sigma).tolist()
        x, y, z = zip(low, high, strict=True)
        return replace(nearest, name="known place", x=x, y=y, z=z)


@dataclass(frozen=True, eq=False)
class Views:
    """B views from one place, with square pixels, no lens and the principal point in the middle."""

    angles: Array
    """Pan, tilt and roll, radians, (B, 3)."""
    f: Array
    """Pixels, (B,)."""
    C: Array
    size: tuple[int, int]

    def __len__(self) -> int:
        return len(self.f)

    @classmethod
    def none(cls, C: Array, size: tuple[int, int]) -> Views:
        """No views."""
        return cls(np.zeros((0, 3)), np.zeros(0), C, size)

    @classmethod
    def level(cls, pan: Array, tilt: Array, f: Array, C: Array, size: tuple[int, int]) -> Views:
        """Views without roll."""
        return cls(np.column_stack([pan, tilt, np.zeros(len(f))]), f, C, size)

    @classmethod
    def joined(cls, parts: Sequence[Views]) -> Views:
        """The views of several parts, one after the other."""
        angles, f = (np.concatenate([getattr(one, name) for one in parts]) for name in ("angles", "f"))
        return cls(angles, f, parts[0].C, parts[0].size)

    def take(self, index: BoolArray | IntArray) -> Views:
        """Some of them, by mask or by index."""
        return Views(self.angles[index], self.f[index], self.C, self.size)

    def looks_at(self, field: Field) -> BoolArray:
        """In which of them the middle of the picture shows the field, or a place just beside it, (B,)."""
        pan, tilt, _ = self.angles.T
        reach = -self.C[2] * np.tan(tilt)
        at = np.abs([self.C[0] + reach * np.sin(pan), self.C[1] - reach * np.cos(pan)]).T
        return np.asarray((tilt > 0.0) & (tilt < 0.5 * np.pi) & np.all(at < BEYOND * field.half_extent, axis=1))

    @property
    def cameras(self) -> Cameras:
        """Their cameras."""
        c = np.tile(0.5 * np.array(self.size, dtype=float), (len(self), 1))
        return Cameras(self.f, c, rotation_from_angles(self.angles), np.tile(self.C, (len(self), 1)), self.size)

    def apart(self, other: int) -> Array:
        """About how far the views move the picture of one of them, (B,) pixels; a roll moves its border."""
        f, half = self.f[other], 0.5 * self.size[0]
        pan, tilt, roll = (self.angles - self.angles[other]).T
        turn = f * np.hypot(pan * np.sin(self.angles[other, 1]), tilt)
        return np.asarray(turn + half * (np.abs(roll) + np.abs(np.log(self.f / f))))
