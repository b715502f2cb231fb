"""Robust losses, as in `scipy.optimize.least_squares`: ``cost = 1/2 sum C^2 rho(r^2 / C^2)`` with scale C in pixels.

Near zero every loss is r^2; far out "soft_l1" and "huber" grow like |r| and "cauchy" like log |r|.
"""

from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

import numpy as np

from fieldcalib._types import Array, is_number, one_of, real_array

LossName: TypeAlias = Literal["linear", "soft_l1", "huber", "cauchy"]

SCALES = (1e-6, 1e9)  # px: squares of others, times numbers of pixels, are no longer exact


@dataclass(frozen=True)
class RobustLoss:
    """A robust loss by name, and its scale in pixels: the residual beyond which it grows more slowly than r^2.

    Examples
    --------
    >>> _, slope = RobustLoss("cauchy", scale=3.0).evaluate(np.array([0.0, 9.0]))
    >>> slope  # a residual as large as the scale weighs half
    array([1. , 0.5])
    """

    name: LossName
    scale: float

    def __post_init__(self) -> None:
        one_of(self.name, get_args(LossName), "loss")
        low, high = SCALES
        if not (is_number(self.scale) and low <= self.scale <= high):
            raise ValueError(
                f"the scale of a loss must be a number of pixels from {low:g} to {high:g}, got {self.scale}"
            )

    def evaluate(self, squared: Array) -> tuple[Array, Array]:
        """``C^2 rho(r^2 / C^2)`` of squared residuals, and its derivative by r^2, the weight of a residual."""
        C2 = self.scale**2
        squared = real_array(squared)
        if (squared < 0.0).any():
            raise ValueError(f"squared residuals must not be negative, got {np.min(squared)}")
        z = squared / C2
        match self.name:
            case "linear":
                return squared, np.ones_like(z)
            case "cauchy":
                return C2 * np.log1p(z), 1.0 / (1.0 + z)
            case "soft_l1":
                root = np.sqrt(1.0 + z)
                return C2 * 2.0 * (root - 1.0), 1.0 / root
            case "huber":
                root = np.sqrt(np.maximum(z, 1.0))
                return C2 * np.where(z <= 1.0, z, 2.0 * root - 1.0), 1.0 / root
