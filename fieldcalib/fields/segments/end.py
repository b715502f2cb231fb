"""Ends of segments: pixels past an end have a second residual, their distance from it along the segment's image."""

from __future__ import annotations

import numpy as np

from fieldcalib._types import Array
from fieldcalib.fields.segments.closest import ClosestPoints, View, at_points
from fieldcalib.fields.segments.rows import Rows


class EndRows(Rows):
    """Pixels past the end of their segment (`fieldcalib.problem.segment_ends`).

    The vectors of a row: the end X; the direction in the image along which the distance is measured, in the first two
    components; and in the first component the position of X along the segment, 0 or 1.
    """

    name, vectors = "ends", 3
    measures_labels = shares_noise = False
    compiled = ("ENDS",)

    def closest_points(self, view: View) -> list[ClosestPoints]:
        """The ends, measured along the directions of the rows."""
        along = np.ascontiguousarray(np.moveaxis(self.geometry[:, :, 1, :2], -1, 0))
        x, y = at_points(view, self.xy, self.geometry[:, :, 0])
        return [ClosestPoints(along[0] * x.r + along[1] * y.r, x.s, x.inverse_depth, along)]

    def motion(self, of_ends: Array) -> Array:
        """Derivatives of the ends by the size of the field, (T, N, 3, 2)."""
        return self._between(of_ends, self.geometry[:, :, 2, :1, None])
