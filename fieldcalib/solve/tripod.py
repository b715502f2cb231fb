"""What the frames of one camera share, once it is known, and cameras of further frames from it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fieldcalib._types import Array, IntArray
from fieldcalib.assess.own_errors import OwnErrors, own_errors
from fieldcalib.assess.result import Calibration
from fieldcalib.assess.sequence import LARGEST_ERROR
from fieldcalib.fields.segments import ObjectSegments
from fieldcalib.problem.background import BackgroundPairs
from fieldcalib.problem.evaluation import Problem, evaluate
from fieldcalib.problem.labelled_pixels import Pixels, PixelWeights
from fieldcalib.problem.levenberg_marquardt import levenberg_marquardt
from fieldcalib.problem.observations import pack
from fieldcalib.solve.centres import Centres
from fieldcalib.solve.frame_columns import FrameColumns
from fieldcalib.solve.from_segments import NO_PIXELS
from fieldcalib.solve.initial_cameras import given_cameras
from fieldcalib.solve.options import Options

FOLLOWED = 1e-4  # of the cost, at which a frame that follows is done: a hundredth of its standard deviation

Labels = tuple[Pixels, PixelWeights]


class PixelNoise(NamedTuple):
    """Of the labelled pixels, as `fieldcalib.assess.noise` has it."""

    sigma: float
    kappa: float


@dataclass(frozen=True, eq=False)
class KnownTripod:
    """What the frames of a tripod share."""

    object_segments: ObjectSegments
    """Of the estimated size."""
    options: Options
    """In which what is shared is known, and considered."""
    noise: PixelNoise

    @property
    def considered(self) -> Array:
        """Covariance of what is shared, (S, S)."""
        shared = int(np.count_nonzero(self.options.layout.considered))
        return np.zeros((shared, shared)) if self.options.considered is None else self.options.considered

    def columns(self, count: int, largest_error: float = LARGEST_ERROR) -> FrameColumns:
        """Of frames to come; those whose field in view is not known to `largest_error` metres are not accepted."""
        return FrameColumns(count, tuple(self.object_segments), self.options, self.considered, NO_PIXELS, largest_error)

    def follow(
        self,
        columns: FrameColumns,
        index: IntArray,
        theta: Array,
        labels: Sequence[Labels],
        pairs: BackgroundPairs,
        of_first: OwnErrors,
        alone: Mapping[int, Calibration],
        centres: Centres | None = None,
    ) -> None:
        """Fill in frames `index` (B,) from their labels and from known cameras that they are tied to.

        Parameters
        ----------
        theta : (B, n) array
            Where their cameras begin.
        pairs : BackgroundPairs
            From known cameras to these frames, numbered from 0.
        of_first : OwnErrors
            Of the known cameras, one for each pair.
        alone : mapping of int to Calibration
            What some of them were by themselves.
        centres : Centres, optional
            Of a camera that moves.
        """
        options = self.options
        pixels, weights = zip(*labels, strict=True)
        prior = given_cameras(theta, options.stands).prior if options.use_prior else None
        if centres is not None:
            prior = centres.of_prior(prior, options.layout.size)
        problem = Problem(
            pack(self.object_segments, pixels, options.image_size, weights, options.motion),
            options.layout,
            options.loss,
            options.noise,
            prior,
            paint=options.paint,
            considered=options.considered,
            scale=options.scale,
            background=pairs,
        )
        solved = levenberg_marquardt(
            evaluate(problem, theta),
            max_iterations=options.max_iterations,
            tolerance=max(options.tolerance, FOLLOWED),
        ).evaluation
        errors = own_errors(solved, *self.noise, of_first)
        columns.fill(index, solved, errors, tied=np.isin(np.arange(len(index)), pairs.second), alone=alone)
