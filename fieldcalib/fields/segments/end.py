"""Ends of segments: pixels past an end are measured once more, against that end and along the segment's image."""

from __future__ import annotations

import numpy as np

from fieldcalib._types import Array
from fieldcalib.fields.segments.closest import ClosestPoints, View, at_points
from fieldcalib.fields.segments.rows import Rows


class EndRows(Rows):
    """Pixels past the end of their segment (`fieldcalib.problem.segment_ends`).

    The first vector of a row is the end X; the first two components of the second one are the direction in the image
    that is measured, and the first component of the third one is where X is along the segment, from 0 to 1.
    """

    name, vectors = "ends", 3
    shares_noise = False
    compiled = ("ENDS",)

    def closest_points(self, view: View) -> list[ClosestPoints]:
        """The ends, measured along the directions of the rows."""
        along = np.ascontiguousarray(np.moveaxis(self.geometry[:, :, 1, :2], -1, 0))
        x, y = at_points(view, self.xy, self.geometry[:, :, 0])
        return [ClosestPoints(along[0] * x.r + along[1] * y.r, x.s, x.inverse_depth, along)]

    def motion(self, of_ends: Array) -> Array:
        """How the ends move with the size of the field, (T, N, 3, 2)."""
        return self._between(of_ends, self.geometry[:, :, 2, :1, None])
