"""Frames that were solved one by one, as one problem with shared parameters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fieldcalib._types import Array, BoolArray
from fieldcalib.fields.field import Field
from fieldcalib.fields.segments import ObjectSegments
from fieldcalib.problem.evaluation import Evaluation, Problem, evaluate
from fieldcalib.problem.observations import Observations
from fieldcalib.problem.pixel_table import PixelTable


def joint_evaluation(
    problem: Problem,
    object_segments: ObjectSegments,
    pixels: PixelTable,
    theta: Array,
    once: BoolArray,
) -> Evaluation:
    """Evaluate the labelled pixels of T frames as one group at the cameras theta (T, n).

    All but the observations is taken from `problem`. Pixels past the end of a segment get no second residual:
    annotators place ends too carelessly for estimates of shared parameters. The prior (T, n) of the parameters `once`
    (n,) counts once for all frames: the prior of one camera's position must not count again in every frame.
    """
    layout, prior, count = problem.layout, problem.prior, pixels.count
    if prior is not None:
        prior = replace(prior, sigma=np.where(once, np.sqrt(count), 1.0) * prior.sigma)
    motion = None
    if isinstance(object_segments, Field) and layout.field_size is not None:
        motion = object_segments.motion
    observations = Observations.of(object_segments, pixels, layout.image_size, motion)
    group = np.zeros(count, dtype=np.intp)
    return evaluate(replace(problem, observations=observations, prior=prior, group=group), theta)
