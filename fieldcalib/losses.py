"""Robust losses, as in `scipy.optimize.least_squares`: ``cost = 1/2 sum C^2 rho(r^2 / C^2)`` with scale C in pixels.

Near zero every loss is r^2; far out linear losses grow like |r| and "cauchy" like log |r|.
"""

from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

import numpy as np

from fieldcalib._types import Array

LossName: TypeAlias = Literal["linear", "soft_l1", "huber", "cauchy"]


@dataclass(frozen=True)
class RobustLoss:
    """A robust loss by name, and its scale in pixels: the residual at which it begins to bend away from r^2.

    Examples
    --------
    >>> rho, slope, _ = RobustLoss("cauchy", scale=3.0).evaluate(np.array([0.0, 9.0]))
    >>> slope  # a residual of one scale weighs half
    array([1. , 0.5])
    """

    name: LossName
    scale: float

    def __post_init__(self) -> None:
        if self.name not in get_args(LossName):
            raise ValueError(f"loss must be one of {', '.join(get_args(LossName))}, got {self.name!r}")
        if not 0.0 < self.scale < np.inf:
            raise ValueError(f"the scale of a loss must be a positive number of pixels, got {self.scale}")

    def evaluate(self, squared: Array) -> tuple[Array, Array, Array]:
        """``C^2 rho(r^2 / C^2)`` of squared residuals, and its first two derivatives by r^2.

        The second is zero where the loss is linear in r^2.
        """
        C2 = self.scale**2
        z = squared / C2
        if self.name == "linear":
            return squared, np.ones_like(z), np.zeros_like(z)
        if self.name == "cauchy":
            slope = 1.0 / (1.0 + z)
            return C2 * np.log1p(z), slope, -np.square(slope) / C2
        if self.name == "soft_l1":
            root = np.sqrt(1.0 + z)
            return C2 * 2.0 * (root - 1.0), 1.0 / root, -0.5 / (root * (1.0 + z) * C2)
        inside = z <= 1.0
        root = np.sqrt(np.where(inside, 1.0, z))
        value = np.where(inside, z, 2.0 * root - 1.0)
        return C2 * value, 1.0 / root, np.where(inside, 0.0, -0.5 / (root**3 * C2))
