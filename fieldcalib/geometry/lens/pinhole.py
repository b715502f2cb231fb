"""The pinhole: a lens that does not distort."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from fieldcalib._types import Array, BoolArray
from fieldcalib.geometry.lens.model import Lens, constant


class Pinhole(Lens):
    """No distortion: real offsets are ideal ones, and there are no coefficients. For the methods see `Lens`."""

    name: ClassVar[str] = "pinhole"
    names = opencv_names = ()
    estimable: ClassVar[int] = 0
    least = mean = sigma = constant()

    def distort(self, s: Array, b: Array) -> Array:
        """The offsets themselves."""
        return s

    def push(self, s: Array, b: Array, *steps: Array) -> tuple[Array, ...]:
        """The offsets and steps themselves."""
        return s, *steps

    def pull(self, s: Array, b: Array, n: Array) -> Array:
        """The normals themselves."""
        return n

    def pull_coefficients(self, s: Array, b: Array, n: Array) -> Array:
        """An empty array, (0, ...)."""
        return np.empty((0, *np.broadcast_shapes(s.shape[1:], n.shape[1:])))

    def undistort(self, d: Array, b: Array) -> Array:
        """The offsets themselves."""
        return d

    def is_monotone(self, s: Array, b: Array) -> BoolArray:
        """True everywhere."""
        return np.ones(s.shape[1:], dtype=bool)
