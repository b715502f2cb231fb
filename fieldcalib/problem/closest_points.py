"""Closest points on the images of the segments to the observed pixels, for all kinds of segments."""

from __future__ import annotations

from fieldcalib.fields.segments.closest import ClosestPoints
from fieldcalib.problem.observations import Observations
from fieldcalib.problem.projection import Projection


def closest_points(projection: Projection, observations: Observations) -> ClosestPoints:
    """The closest points of all residuals, in the order of `Observations.weight`."""
    found = [part for rows in observations.rows if rows for part in rows.closest_points(projection)]
    return ClosestPoints.joined(found or observations.rows[0].closest_points(projection))
