"""The known shared parameters of the frames of one camera, and the solution of further frames with them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from fieldcalib._types import Array
from fieldcalib.assess.level import Considered
from fieldcalib.assess.own_errors import OwnErrors, own_errors
from fieldcalib.fields.segments import ObjectSegments
from fieldcalib.problem.background import BackgroundPairs
from fieldcalib.problem.evaluation import Evaluation, evaluate
from fieldcalib.problem.levenberg_marquardt import levenberg_marquardt
from fieldcalib.problem.observations import Observations
from fieldcalib.problem.pixel_table import PixelTable
from fieldcalib.problem.prior import GaussianPrior
from fieldcalib.solve.initial_cameras import given_cameras
from fieldcalib.solve.options import Options

FOLLOWED = 1e-4  # relative decrease of the cost at which a further frame is done: a hundredth of a standard deviation


class PixelNoise(NamedTuple):
    """Noise of the labelled pixels (`fieldcalib.assess.noise`)."""

    sigma: float
    kappa: float


@dataclass(frozen=True, eq=False)
class SharedParameters:
    """Shared parameters of the frames of one camera, with their covariance."""

    options: Options
    """Options with the shared parameters as known and considered ones, and an object of the known size."""
    noise: PixelNoise

    @property
    def object_segments(self) -> ObjectSegments:
        """The calibration object, of the estimated size."""
        return self.options.object_segments

    @property
    def considered(self) -> Considered:
        """The shared parameters, with their covariance."""
        layout, covariance = self.options.layout, self.options.considered
        size = int(np.count_nonzero(layout.considered))
        return Considered(layout, np.zeros((size, size)) if covariance is None else covariance)

    def prior(self, theta: Array) -> GaussianPrior | None:
        """Prior of frames with cameras near theta (B, n); None without a prior."""
        return given_cameras(theta, self.options.stands).prior if self.options.use_prior else None

    def solved(
        self, theta: Array, pixels: PixelTable, pairs: BackgroundPairs, prior: GaussianPrior | None
    ) -> Evaluation:
        """Solve B frames from their labels and from the known cameras that they are tied to.

        Parameters
        ----------
        theta : (B, n) array
            Initial cameras.
        pixels : PixelTable
            Labelled pixels of the frames.
        pairs : BackgroundPairs
            Ties from known cameras to these frames, numbered from 0.
        """
        options = self.options
        observations = Observations.of(self.object_segments, pixels, options.image_size, options.motion)
        start = evaluate(replace(options.problem(observations, prior), background=pairs), theta)
        tolerance = max(options.tolerance, FOLLOWED)
        return levenberg_marquardt(start, max_iterations=options.max_iterations, tolerance=tolerance).evaluation

    def errors(self, solved: Evaluation, of_first: OwnErrors | None = None) -> OwnErrors:
        """Errors of solved frames; `of_first` are those of the first frame of each pair, if its camera is known."""
        return own_errors(solved, *self.noise, of_first)
