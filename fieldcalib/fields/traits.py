"""What may be known of a field beyond its segments: the look of its lines, its sizes, how probable a camera is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from fieldcalib._types import Array

if TYPE_CHECKING:
    from fieldcalib.fields.field import Field

DEVIATIONS = 1.96  # to either side: what holds 95 % of a normal distribution


class Halves(NamedTuple):
    """Labels of the two halves of a circle and of the line between them.

    Left and right are as the main camera sees them.
    """

    left: str
    right: str
    line: str


@dataclass(frozen=True)
class LineLook:
    """How the lines of a field look in an image; by default white paint on one kind of ground, as grass.

    Brightness is that of 8 bit images, from 0 to 255, on the scale of luma (Rec. 601).

    Raises
    ------
    ValueError
        If a number is not positive.

    Examples
    --------
    >>> LineLook(width=0.05, lighter=False)  # dark lines of 5 cm
    LineLook(width=0.05, lighter=False, contrast=3.0, contrast_raised=12.0, ground_difference=0.05)
    """

    width: float = 0.12
    """Metres."""
    lighter: bool = True
    """Whether they are lighter than the ground on both sides, else they are darker."""
    contrast: float = 3.0
    """Least difference in brightness to what is on both sides, on the ground."""
    contrast_raised: float = 12.0
    """The same above the ground, as of posts and crossbars, behind which there may be anything."""
    ground_difference: float = 0.05
    """Largest difference in colour between both sides of a line on the ground, in shares of the channels; infinite
    where a line may be the border of a painted area."""

    def __post_init__(self) -> None:
        for name in ("width", "contrast", "contrast_raised", "ground_difference"):
            _check_positive(getattr(self, name), f"the {name} of a LineLook")


@dataclass(frozen=True)
class SizePrior:
    """Which sizes fields of a kind have, and how their segments move with the size. Pairs are (length, width).

    Raises
    ------
    ValueError
        If a range is not (low, high) with 0 < low < high.

    Examples
    --------
    >>> from fieldcalib import soccer
    >>> soccer().size_model.sigma.round(2)
    array([2.55, 2.81])
    """

    legal: tuple[tuple[float, float], tuple[float, float]]
    """Ranges (low, high) that the rules allow, metres."""
    usual: tuple[tuple[float, float], tuple[float, float]]
    """Ranges that hold length and width with a probability of 95 %, metres."""
    build: Callable[[float, float], Field]
    """The field of a length and a width."""
    exact: float = 0.7
    """Probability that a field of which nobody measured the size has the one that it is taken for. Of the others half
    are normal with the usual ranges, half with the legal ones: that has heavy tails."""
    rules: str = "the rules"
    """What the legal sizes are from, for messages."""

    def __post_init__(self) -> None:
        for what in ("legal", "usual"):
            for low, high in getattr(self, what):
                if not (0.0 < low < high < np.inf):
                    raise ValueError(f"the {what} sizes must be (low, high) with 0 < low < high, got {(low, high)}")

    @property
    def limits(self) -> Array:
        """The legal sizes from and to, (2, 2): rows are (length, width)."""
        return np.array(self.legal).T

    @property
    def possibilities(self) -> tuple[Array, Array]:
        """Probabilities (3,) of the given size, a usual one and a legal one, and the standard deviations, (3, 2)."""
        legal = np.diff(self.legal, axis=1)[:, 0] / np.sqrt(12.0)  # of a uniform distribution
        rest = 0.5 * (1.0 - self.exact)
        return np.array([self.exact, rest, rest]), np.array([np.zeros(2), self.sigma, legal])

    @property
    def sigma(self) -> Array:
        """Standard deviations of length and width, (2,) metres: the usual range is a 95 % interval."""
        return np.asarray(np.diff(self.usual, axis=1)[:, 0] / (2.0 * DEVIATIONS))


@dataclass(frozen=True)
class ProbabilityModel:
    """Coefficients b0 to b4 of the log odds that a camera is right (`fieldcalib.assess.probability`).

    They are fitted to frames of one kind of field, seen by its cameras, and hold for no other.
    """

    coefficients: tuple[float, float, float, float, float]

    def __post_init__(self) -> None:
        if np.shape(self.coefficients) != (5,) or not np.all(np.isfinite(self.coefficients)):
            raise ValueError(f"a ProbabilityModel needs five finite coefficients, got {self.coefficients!r}")


def _check_positive(value: float, what: str) -> None:
    if not value > 0.0:
        raise ValueError(f"{what} must be positive, got {value}")
