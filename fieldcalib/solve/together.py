"""Frames that were solved one by one, as one problem with shared parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fieldcalib._types import Array, BoolArray
from fieldcalib.fields.field import Field
from fieldcalib.fields.segments import ObjectSegments
from fieldcalib.problem.background import BackgroundPairs
from fieldcalib.problem.evaluation import Evaluation, Problem, evaluate
from fieldcalib.problem.labelled_pixels import Pixels, PixelWeights
from fieldcalib.problem.layout import Layout
from fieldcalib.problem.observations import pack
from fieldcalib.problem.prior import GaussianPrior
from fieldcalib.problem.smooth_path import SmoothPath


def put_together(
    object_segments: ObjectSegments,
    frames: Sequence[tuple[Pixels, PixelWeights]],
    like: Problem,
    layout: Layout,
    theta: Array,
    prior: GaussianPrior | None,
    once: BoolArray,
    background: BackgroundPairs | None = None,
    path: SmoothPath | None = None,
) -> Evaluation:
    """T frames, pixels and their weights, as one group, at the cameras theta (T, n) of a layout.

    Noise, loss and all else are those of a problem `like` theirs. Pixels past the end of a segment are not treated in a
    way of their own: annotators place ends with too little care to tell what is shared. The prior (T, n) of the
    parameters `once` (n,) counts once for all frames: what is known of the place of one camera is no news in the second
    frame.
    """
    count = len(frames)
    if prior is not None:
        prior = replace(prior, sigma=np.where(once, np.sqrt(count), 1.0) * prior.sigma)
    motion = None
    if isinstance(object_segments, Field) and layout.field_size is not None:
        motion = object_segments.motion
    pixels, weights = zip(*frames, strict=True)
    problem = replace(
        like,
        observations=pack(object_segments, pixels, layout.image_size, weights, motion),
        layout=layout,
        prior=prior,
        group=np.zeros(count, dtype=np.intp),
        considered=None,
        background=background,
        path=path,
    )
    return evaluate(problem, theta)


def labels_of(solved: Evaluation) -> tuple[Pixels, PixelWeights]:
    """The pixels of one frame and what they weigh, as they were solved with."""
    return solved.problem.observations.frame(0)
