"""Where segments end: pixels that lie past the end of their line or arc are drawn back to that end.

The residual of a pixel is its distance to the infinite line or the whole circle: smooth, and right behind the camera,
but blind to a goal line that goes on beyond its corner. Once a camera is known, so are the pixels that it sees past an
end X. Each of them gets one more residual, along the unit tangent t of the segment's image there,

    r = t . (p - pi(X)),

and the camera is solved again. Pixels, ends and tangents are chosen once, so this residual is as smooth as the others.
A pixel before the end says nothing: annotators stop early, and players stand in the way.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fieldcalib._types import Array, BoolArray
from fieldcalib.fields.segments import Arc, ObjectSegments
from fieldcalib.problem.observations import Observations, Rows
from fieldcalib.problem.residuals import end_points, foot_points, world_points
from fieldcalib.problem.solver import Problem

WEIGHT = 0.5  # of a pixel past an end, in units of what it weighs across: annotators place ends with less care


def with_ends(object_segments: ObjectSegments, problem: Problem, theta: Array, far: float) -> Problem:
    """The problems with what the ends of the segments say, as cameras (B, 12) near their solutions see it.

    What lies more than `far` pixels past an end has another fault than a careless end, and is left alone.
    """
    ends = pixels_past_ends(object_segments, problem.observations, theta, far)
    return replace(problem, observations=replace(problem.observations, ends=ends))


def pixels_past_ends(object_segments: ObjectSegments, observations: Observations, theta: Array, far: float) -> Rows:
    """Pixels that cameras (B, 12) see past an end, by `far` pixels at most, as rows of `Observations.ends`."""
    feet = foot_points(theta, observations)
    X = world_points(theta, feet)
    lines, arcs = observations.lines, observations.arcs
    first, count = lines.xy.shape[1], lines.xy.shape[1] + arcs.xy.shape[1]
    past_line, end_of_line = _past_lines(lines, X[:, :first])
    past_arc, end_of_arc = _past_arcs(object_segments, observations, X[:, first:count])
    past = np.concatenate([past_line, past_arc], axis=1) & (feet.inverse_depth[:, :count] > 0.0)
    x, y = feet.normal[:, :, :count]
    tangent = np.stack([-y, x, np.zeros_like(x)], axis=-1)
    rows = Rows(
        np.concatenate([lines.xy, arcs.xy], axis=1),
        WEIGHT * observations.weight[:, :count] * past,
        np.concatenate([lines.label, arcs.label], axis=1),
        np.stack([np.concatenate([end_of_line, end_of_arc], axis=1), tangent], axis=2),
    )
    end = end_points(theta, rows, observations.image_size)
    rows.weight[(end.inverse_depth <= 0.0) | (np.abs(end.r) > far)] = 0.0
    seen = rows.weight > 0.0
    rows.label[~seen], rows.geometry[~seen] = -1, 1.0  # padding is finite
    return rows.choose(np.argsort(~seen, axis=1, kind="stable")[:, : int(np.max(np.sum(seen, axis=1)))])


def _past_lines(rows: Rows, X: Array) -> tuple[BoolArray, Array]:
    """Which points X (T, N, 3) of lines lie past an end, (T, N), and the nearest point of the segment, (T, N, 3)."""
    start, direction = rows.geometry[:, :, 0], rows.geometry[:, :, 1]
    share = np.sum((X - start) * direction, axis=-1) / np.sum(np.square(direction), axis=-1)
    inside = np.clip(share, 0.0, 1.0)
    return share != inside, start + inside[..., None] * direction


def _past_arcs(object_segments: ObjectSegments, observations: Observations, X: Array) -> tuple[BoolArray, Array]:
    """The same for points of the arcs' whole circles."""
    rows = observations.arcs
    middle, half = np.zeros((2, len(observations.labels)))
    for index, label in enumerate(observations.labels):
        segment = object_segments[label]
        if isinstance(segment, Arc):
            middle[index], half[index] = (segment.stop + segment.start) / 2.0, abs(segment.stop - segment.start) / 2.0
    middle, half = middle[rows.label], half[rows.label]
    centre, u, v = np.moveaxis(rows.geometry[:, :, :3], 2, 0)
    angle = np.arctan2(np.sum((X - centre) * v, axis=-1), np.sum((X - centre) * u, axis=-1))
    turn = (angle - middle + np.pi) % (2.0 * np.pi) - np.pi  # from the middle of the arc
    inside = np.clip(turn, -half, half)
    phi = (middle + inside)[..., None]
    return turn != inside, centre + np.cos(phi) * u + np.sin(phi) * v
