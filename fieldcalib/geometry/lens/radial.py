"""The lens of two radial coefficients: ``distorted = s (1 + a1 q + a2 q^2)``."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from fieldcalib._types import Array, BoolArray
from fieldcalib.geometry.lens.model import SymmetricLens, a2_of_a1, constant, da2_da1, dot

# Broadcast lenses displace the corner outwards: on annotated frames a1 has its median at 2.8 %, 95 % are below 5.5 %.
# Ten measured cameras have b2 of 0.5 to 1.9 %; 644 annotated frames together are likeliest with 0.4 %.
RADIAL_MEAN, RADIAL_SIGMA = (0.025, 0.0), (0.02, 0.01)  # a1, b2


class RadialLens(SymmetricLens):
    """Two radial coefficients (a1, b2), monotone where b2 >= 0; with b2 = 0 it has one parameter.

    For the methods see `Lens`.

    Examples
    --------
    >>> RadialLens(500.0).distort(np.array([300.0, 400.0]), np.array([0.03, 0.0]))  # 3 % at the corner
    array([309., 412.])
    """

    name: ClassVar[str] = "radial"
    names: ClassVar[tuple[str, ...]] = ("a1", "b2")
    opencv_names: ClassVar[tuple[str, ...]] = ("k1", "k2")
    estimable: ClassVar[int] = 2
    least: ClassVar[Array] = constant(-np.inf, 0.0)
    mean: ClassVar[Array] = constant(*RADIAL_MEAN)
    sigma: ClassVar[Array] = constant(*RADIAL_SIGMA)

    def distort(self, s: Array, b: Array) -> Array:
        """``gain s`` with ``gain = 1 + a1 q + a2 q^2``."""
        q, (a1, a2) = dot(s, s) / self.rho**2, _a1_a2(b)
        return np.asarray((1.0 + q * (a1 + q * a2)) * s)

    def follow(self, s: Array, b: Array, ds: Array, dds: Array) -> tuple[Array, Array, Array]:
        """``gain s``, and its derivatives, of which that of gain is ``slope (s . ds)``."""
        gain, slope, bend = self._gain(s, b)
        along = dot(s, ds)
        dgain = slope * along
        ddgain = slope * (dot(ds, ds) + dot(s, dds)) + bend * along * along
        return gain * s, gain * ds + dgain * s, gain * dds + ddgain * s + 2.0 * dgain * ds

    def pull_coefficients(self, s: Array, b: Array, n: Array) -> Array:
        """``n . s dgain/db``; a2 depends on a1."""
        q = dot(s, s) / self.rho**2
        by_a1 = q * dot(n, s)
        by_a2 = q * by_a1
        return np.array([by_a1 + da2_da1(b) * by_a2, by_a2])

    def undistort(self, d: Array, b: Array) -> Array:
        """Newton's method on the radius."""
        a1, a2 = _a1_a2(b)
        return np.asarray(d * _inverse_gain(np.sqrt(dot(d, d)) / self.rho, a1, a2))

    def is_monotone(self, s: Array, b: Array) -> BoolArray:
        """``1 + 3 a1 q + 5 a2 q^2 > 0`` up to the q of s."""
        return _is_monotone(dot(s, s) / self.rho**2, *_a1_a2(b))

    def gain(self, s: Array, b: Array) -> tuple[Array, Array]:
        """``1 + a1 q + a2 q^2``, and ``2 / rho^2`` times its derivative by q."""
        return self._gain(s, b)[:2]

    def _gain(self, s: Array, b: Array) -> tuple[Array, Array, Array]:
        """`gain`, and ``2 / rho^2`` times the derivative of the slope by q."""
        q, (a1, a2) = dot(s, s) / self.rho**2, _a1_a2(b)
        of_a2 = q * a2
        c = 2.0 / self.rho**2
        return 1.0 + q * (a1 + of_a2), c * (a1 + 2.0 * of_a2), 2.0 * c * c * a2


def _a1_a2(b: Array) -> tuple[Array, Array]:
    """`Lens.corner` as a pair, without a copy: lenses are evaluated several times for a step of the solver."""
    return b[0], b[1] + a2_of_a1(b)


def _is_monotone(q: Array, a1: Array, a2: Array) -> BoolArray:
    """Whether a radial lens is monotone up to relative squared radius q: ``1 + 3 a1 q + 5 a2 q^2 > 0``.

    Beyond the first radius where the slope is not positive, different points of the scene share a pixel: the result is
    False there, even where the slope is positive again.
    """
    at_q = 1.0 + q * (3.0 * a1 + 5.0 * a2 * q) > 0.0
    # the slope may be negative before q and positive again at q: test its minimum, at -0.3 a1 / a2
    on_the_way = (a1 < 0.0) & (a2 > 0.0) & (-0.3 * a1 < a2 * q) & (a2 <= 0.45 * np.square(a1))
    return np.asarray(at_q & ~on_the_way)


def _inverse_gain(target: Array, a1: Array, a2: Array) -> Array:
    """Ratio of the ideal radius to the distorted radius `target`, in units of rho; NaN if there is none.

    Newton's method on the radius, which stays on the monotone part of the lens.
    """
    radius = np.broadcast_to(target, np.broadcast_shapes(target.shape, a1.shape)).copy()
    for _ in range(40):
        q = np.square(radius)
        value = radius * (1.0 + q * (a1 + q * a2)) - target
        slope = 1.0 + q * (3.0 * a1 + 5.0 * a2 * q)
        # beyond the monotone part of a barrel, halving the radius returns to it
        newton = np.clip(value / np.where(slope > 0.0, slope, 1.0), -0.5 * radius, 0.5 * radius)
        step = np.where(slope > 0.0, newton, 0.5 * radius)
        radius -= step
        if np.max(np.abs(step), initial=0.0) < 1e-15:
            break
    q = np.square(radius)
    gain = 1.0 + q * (a1 + q * a2)
    found = (np.abs(radius * gain - target) <= 1e-9 * (1.0 + target)) & _is_monotone(q, a1, a2)
    return np.asarray(np.where(found, 1.0 / np.where(found, gain, 1.0), np.nan))
