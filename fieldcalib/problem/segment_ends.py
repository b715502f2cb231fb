"""Where segments end: pixels that lie past the end of their line or arc are drawn back to that end.

The residual of a pixel is its distance to the infinite line or the whole circle: smooth, and right behind the camera,
but blind to a goal line that goes on beyond its corner. Once a camera is known, so are the pixels that it sees past an
end X. Each of them gets one more residual, along the unit tangent t of the segment's image there,

    r = t . (p - pi(X)),

and the camera is solved again. Pixels, ends and tangents are chosen once, so this residual is as smooth as the others.
A pixel before the end says nothing: annotators stop early, and players stand in the way.
"""

from __future__ import annotations

import numpy as np

from fieldcalib._types import Array, BoolArray
from fieldcalib.fields.segments import Arc, ObjectSegments
from fieldcalib.problem.closest_points import end_points
from fieldcalib.problem.evaluation import Evaluation
from fieldcalib.problem.observations import Observations, Rows

WEIGHT = 0.5  # of a pixel past an end, in units of what it weighs across: annotators place ends with less care


def with_segment_ends(object_segments: ObjectSegments, evaluation: Evaluation, far: float) -> Evaluation:
    """The evaluation with what the ends of the segments say, as its cameras see it.

    What lies more than `far` pixels past an end has another fault than a careless end, and is left alone.
    """
    return evaluation.with_ends(pixels_past_ends(object_segments, evaluation, far))


def pixels_past_ends(object_segments: ObjectSegments, evaluation: Evaluation, far: float) -> Rows:
    """Pixels that the cameras see past an end, by `far` pixels at most, as rows of `Observations.ends`."""
    observations = evaluation.problem.observations
    lines, arcs = observations.lines, observations.arcs
    on_lines, on_arcs = observations.columns["lines"], observations.columns["arcs"]
    both = slice(on_lines.start, on_arcs.stop)
    X, points = evaluation.world_points, evaluation.points.columns(both)
    past_line, end_of_line, along_line = _past_lines(lines, X[:, on_lines])
    past_arc, end_of_arc = _past_arcs(object_segments, observations, X[:, on_arcs])
    past = np.concatenate([past_line, past_arc], axis=1) & (points.inverse_depth > 0.0)
    x, y = points.normal
    tangent = np.stack([-y, x, np.zeros_like(x)], axis=-1)
    along = np.zeros_like(tangent)
    along[:, : along_line.shape[1], 0] = along_line
    rows = Rows(
        np.concatenate([lines.xy, arcs.xy], axis=1),
        WEIGHT * observations.weight[:, both] * past,
        np.concatenate([lines.label, arcs.label], axis=1),
        np.stack([np.concatenate([end_of_line, end_of_arc], axis=1), tangent, along], axis=2),
    )
    end = end_points(evaluation.projection, rows)
    rows.weight[(end.inverse_depth <= 0.0) | (np.abs(end.r) > far)] = 0.0
    seen = rows.weight > 0.0
    rows.label[~seen], rows.geometry[~seen] = -1, 1.0  # padding is finite
    return rows.choose(np.argsort(~seen, axis=1, kind="stable")).trimmed


def _past_lines(rows: Rows, X: Array) -> tuple[BoolArray, Array, Array]:
    """Which points X (T, N, 3) of lines lie past an end, (T, N), and the nearest point of the segment.

    That is given in metres, (T, N, 3), and by where it is along the segment, from 0 to 1, (T, N).
    """
    start, direction = rows.geometry[:, :, 0], rows.geometry[:, :, 1]
    share = np.sum((X - start) * direction, axis=-1) / np.sum(np.square(direction), axis=-1)
    inside = np.clip(share, 0.0, 1.0)
    return share != inside, start + inside[..., None] * direction, inside


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
