"""Ends of segments: pixels that lie past the end of their line or arc are pulled back to that end.

The residual of a pixel is its distance to the infinite line or the whole circle: smooth, and valid behind the camera,
but insensitive to a goal line that goes on beyond its corner. Once a camera is known, so are the pixels that it sees
past an end X. Each of them gets one more residual, along the unit tangent t of the segment's image at X,

    r = t . (p - pi(X)),

and the camera is solved again. Pixels, ends and tangents are chosen once, so this residual is as smooth as the others.
Pixels before the end get none: annotators stop early, and players hide ends.
"""

from __future__ import annotations

import numpy as np

from fieldcalib.fields.segments import EndRows
from fieldcalib.problem.evaluation import Evaluation

WEIGHT = 0.5  # of a pixel along its segment, relative to its weight across: annotators place ends with less care


def with_segment_ends(evaluation: Evaluation, far: float) -> Evaluation:
    """The evaluation with residuals of the pixels that its cameras see past an end.

    Pixels more than `far` past an end have another cause than a careless end, and get none.
    """
    return evaluation.with_ends(pixels_past_ends(evaluation, far))


def pixels_past_ends(evaluation: Evaluation, far: float) -> EndRows:
    """Pixels that the cameras see past an end, by `far` pixels at most."""
    observations, parts = evaluation.problem.observations, []
    spans = np.array([segment.span for segment in observations.segments]).reshape(-1, 2)
    for rows in observations.rows:
        columns = observations.columns[type(rows)]
        ends = rows.past_ends(evaluation.world_points[:, columns], spans)
        if ends is None:
            continue
        points = evaluation.points.columns(columns)
        x, y = points.normal
        tangent = np.stack([-y, x, np.zeros_like(x)], axis=-1)
        along = np.stack([ends.along, np.zeros_like(x), np.zeros_like(x)], axis=-1)
        weight = WEIGHT * rows.weight * (ends.past & (points.inverse_depth > 0.0))
        parts.append((rows.xy, weight, rows.label, np.stack([ends.X, tangent, along], axis=2)))
    past = EndRows(*(np.concatenate(column, axis=1) for column in zip(*parts, strict=True)))
    (end,) = past.closest_points(evaluation.projection)
    past.weight[(end.inverse_depth <= 0.0) | (np.abs(end.r) > far)] = 0.0
    seen = past.weight > 0.0
    past.label[~seen], past.geometry[~seen] = -1, 1.0  # padding must be finite
    return past.choose(np.argsort(~seen, axis=1, kind="stable")).trimmed
