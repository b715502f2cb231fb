"""Frames that were solved one by one, as one problem with shared parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fieldcalib._types import Array, BoolArray
from fieldcalib.fields.field import Field
from fieldcalib.fields.segments import ObjectSegments
from fieldcalib.problem.evaluation import Evaluation, evaluate
from fieldcalib.problem.layout import Layout
from fieldcalib.problem.observations import pack
from fieldcalib.problem.prior import GaussianPrior


def put_together(
    object_segments: ObjectSegments,
    parts: Sequence[Evaluation],
    layout: Layout,
    theta: Array,
    prior: GaussianPrior | None,
    once: BoolArray,
) -> Evaluation:
    """T frames (of one each) as one group, at the cameras theta (T, n) of a layout.

    Pixels past the end of a segment are left out: annotators place ends with too little care to tell what is shared.
    The prior (T, n) of the parameters `once` (n,) counts once for all frames: what is known of the place of one camera
    is no news in the second frame.
    """
    count = len(parts)
    if prior is not None:
        prior = replace(prior, sigma=np.where(once, np.sqrt(count), 1.0) * prior.sigma)
    motion = None
    if isinstance(object_segments, Field) and layout.field_size is not None:
        motion = object_segments.motion
    frames, weights = zip(*(part.problem.observations.without_ends.unpacked(0) for part in parts), strict=True)
    problem = replace(
        parts[0].problem,
        observations=pack(object_segments, frames, layout.image_size, weights, motion),
        layout=layout,
        prior=prior,
        group=np.zeros(count, dtype=np.intp),
        considered=None,
    )
    return evaluate(problem, theta)
