"""Where a camera stands, and how far the pictures of its views from there differ."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fieldcalib._types import Array
from fieldcalib.fields.field import Field
from fieldcalib.fields.stands import CameraDistribution
from fieldcalib.geometry.camera import Camera
from fieldcalib.geometry.rotation import angles_from_rotation
from fieldcalib.images.search.court_hypotheses import Cameras

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


def apart(cameras: Cameras, camera: Camera) -> Array:
    """About how far cameras move the picture of one at the same place, (B,) pixels; a roll moves its border."""
    f, half = camera.focal_length, 0.5 * cameras.size[0]
    pan, tilt, roll = (angles_from_rotation(cameras.R) - camera.angles).T
    turn = f * np.hypot(pan * np.sin(camera.angles[1]), tilt)
    return np.asarray(turn + half * (np.abs(roll) + np.abs(np.log(cameras.f / f))))
