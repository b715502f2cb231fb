"""Lens distortion of a picture from its stripes: with the right distortion removed, they lie on long straight lines.

In units of half the diagonal from the middle of the picture, a stripe at d is moved to ``d (1 + a |d|^2)``; a > 0
undoes the barrel distortion of wide lenses. Several a are tried, and the one is taken for which the longest lines hold
the most stripes (the plumb-line method of Brown, Close-range camera calibration, 1971).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fieldcalib._types import Array
from fieldcalib.geometry.camera import Camera
from fieldcalib.images.search.long_lines import long_lines
from fieldcalib.images.search.stripes import Stripes

BENDS = (0.05, 0.09, 0.14, 0.2, 0.3, 0.45, 0.7)  # values of a that are tried
FEW_BENDS = 3  # if none of the first so many is better than no distortion, no more are tried
BETTER = 1.05  # factor by which the length of lines must grow (`_length`) for a distortion not to be chance
LINES = 12  # longest lines whose lengths count
MOST = 5000  # stripes that are used
NEWTON = 6  # Newton steps of the inverse
SAMPLES = np.linspace(0.05, 1.0, 20)  # radii at which the polynomial of a lens is fitted


@dataclass(frozen=True)
class Bend:
    """Map from the pixels of a picture to those of the picture without distortion; its corners stay in place."""

    a: float
    size: tuple[int, int]

    @classmethod
    def of(cls, camera: Camera) -> Bend:
        """Distortion of a camera's lens, as the mean over the corners of its picture.

        Examples
        --------
        >>> straight = Camera.from_angles(0.0, 1.2, 0.0, 1400.0, (0.0, 30.0, -10.0), (1280, 720))
        >>> round(Bend.of(Bend(0.2, (1280, 720)).with_lens(straight)).a, 2)
        0.2
        """
        width, height = camera.image_size
        corners = np.array([(0.0, 0.0), (width, 0.0), (0.0, height), (width, height)])
        seen = (corners - camera.principal_point) / camera.focal_length
        stretch = np.linalg.norm(camera.normalized(corners), axis=1) / np.linalg.norm(seen, axis=1)
        return cls(float(np.mean(np.nan_to_num(stretch, nan=1.0))) - 1.0, camera.image_size)

    @property
    def middle(self) -> Array:
        """Middle of the picture, pixels."""
        return 0.5 * np.array(self.size)

    @property
    def rho(self) -> float:
        """Half the diagonal, pixels."""
        return float(np.hypot(*self.middle))

    def straight(self, stripes: Stripes) -> Stripes:
        """Move stripes to where they are without distortion."""
        if self.a == 0.0:
            return stripes
        d = (stripes.xy - self.middle) / self.rho
        along = np.column_stack([np.cos(stripes.angle), np.sin(stripes.angle)])
        stretch = 1.0 + self.a * np.sum(d * d, axis=1)[:, None]
        along = stretch * along + 2.0 * self.a * d * np.sum(d * along, axis=1)[:, None]
        xy = self.middle + self.rho * d * stretch / (1.0 + self.a)
        angle = np.mod(np.arctan2(along[:, 1], along[:, 0]), np.pi)
        return Stripes(xy, angle, stripes.contrast, stripes.size)

    def bent(self, xy: Array) -> Array:
        """Convert pixels (..., 2) of the picture without distortion to pixels of the picture; inverse of `straight`.

        Examples
        --------
        >>> bend, xy = Bend(0.2, (1280, 720)), np.array([[100.0, 650.0]])
        >>> stripe = Stripes(bend.bent(xy), np.zeros(1), np.ones(1), (1280, 720))
        >>> bend.straight(stripe).xy.round(3)
        array([[100., 650.]])
        """
        if self.a == 0.0:
            return xy
        u = (xy - self.middle) * ((1.0 + self.a) / self.rho)
        radius = np.linalg.norm(u, axis=-1, keepdims=True)
        d = radius / (1.0 + self.a * np.minimum(radius, 1.0) ** 2)
        for _ in range(NEWTON):
            d = d - (d + self.a * d**3 - radius) / (1.0 + 3.0 * self.a * d**2)
        return np.asarray(self.middle + self.rho * u * d / np.maximum(radius, 1e-9))

    def with_lens(self, camera: Camera) -> Camera:
        """Add the lens of the picture to a camera of the picture without distortion."""
        if self.a == 0.0:
            return camera
        u = SAMPLES * (1.0 + self.a * SAMPLES**2)
        a1, a2 = np.linalg.lstsq(np.column_stack([u**2, u**4]), SAMPLES / u - 1.0, rcond=None)[0]
        K = (1.0 + self.a) * camera.K
        K[:2, 2] -= self.a * self.middle
        K[2, 2] = 1.0
        unit = (K[0, 0] / self.rho) ** 2
        return Camera(K, camera.R, camera.C, camera.image_size, (a1 * unit, a2 * unit**2))


def bend_of(stripes: Stripes) -> Bend:
    """Estimate the distortion of a picture from its stripes; none unless another value explains them clearly better."""
    few = stripes.take(np.arange(0, len(stripes.xy), max(len(stripes.xy) // MOST, 1)))
    none = best = Bend(0.0, stripes.size)
    straight = longest = _length(few)
    for count, a in enumerate(BENDS):
        if count == FEW_BENDS and longest == straight:
            break
        bend = Bend(a, stripes.size)
        length = _length(bend.straight(few))
        if length > longest:
            best, longest = bend, length
    return best if longest > BETTER * straight else none


def _length(stripes: Stripes) -> float:
    """Root of the sum of the squared lengths of the longest lines, pixels."""
    return float(np.linalg.norm(long_lines(stripes, LINES).length))
