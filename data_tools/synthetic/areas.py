"""Areas of the ground that are painted as a whole: keys, goal areas, end zones, creases."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from data_tools.synthetic.colours import Hsv
from fieldcalib._types import Float32
from fieldcalib.draw.ground import Ground

Corner = tuple[float, float]


@dataclass(frozen=True)
class Area:
    """All points that are no farther than `reach` from a box, and within `limits`; metres.

    It is evaluated at |x| and |y|: an area at one end of a field is at both ends, and one that begins at 0 has its
    mirror image beside it.

    Examples
    --------
    >>> disc = Area((0.0, 0.0), (0.0, 0.0), 1.8)
    >>> x = np.array([[0.0, 1.7, -1.9]], np.float32)
    >>> disc.distance(x, np.zeros_like(x)).round(1)
    array([[-1.8, -0.1,  0.1]], dtype=float32)
    """

    low: Corner
    high: Corner
    reach: float = 0.0
    limits: Corner = (np.inf, np.inf)
    """Largest |x| and |y|."""

    def distance(self, x: Float32, y: Float32) -> Float32:
        """Signed distances of points from its border, negative inside."""
        x, y = np.abs(x), np.abs(y)
        low = [start if start > 0.0 else -end for start, end in zip(self.low, self.high, strict=True)]
        out_x = np.maximum(np.float32(low[0]) - x, x - np.float32(self.high[0]))
        out_y = np.maximum(np.float32(low[1]) - y, y - np.float32(self.high[1]))
        outside = np.hypot(np.maximum(out_x, 0.0), np.maximum(out_y, 0.0))
        distance = outside + np.minimum(np.maximum(out_x, out_y), 0.0) - np.float32(self.reach)
        beyond = np.maximum(x - np.float32(self.limits[0]), y - np.float32(self.limits[1]))
        return np.asarray(np.maximum(distance, beyond), np.float32)

    def share(self, ground: Ground) -> Float32:
        """Share of every pixel that the area covers; 0 above the horizon."""
        inside = 0.5 - self.distance(*ground.xy) / ground.largest_pixel_size
        return np.asarray(np.nan_to_num(np.clip(inside, 0.0, 1.0), nan=0.0), np.float32)


@dataclass(frozen=True)
class Fill:
    """An area that is painted on a share of the fields, in one of several colours."""

    area: Area
    colours: Sequence[Hsv]
    share: float = 1.0
    opacity: float = 1.0
