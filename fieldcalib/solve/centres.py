"""Where the frames of one camera have its centre: in the place that most of them agree on, or along a path.

Frames that have another one, as wrong labels or a wrong minimum give it, do not count.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from fieldcalib._types import Array, BoolArray, IntArray
from fieldcalib.assess.result import Calibration
from fieldcalib.problem.layout import CENTER
from fieldcalib.problem.prior import GaussianPrior
from fieldcalib.solve.frame_columns import FrameColumns

# Per frame of 25 a second: a camera on wires or a drone speeds up by 5 m/s^2, and does not fly faster than 10 m/s.
ACCELERATION = 0.008  # m per frame squared: standard deviation of a coordinate
SPEED = 0.4  # m per frame
AGREE = 7.8  # squared distance in standard deviations: 95 % of chi-squared with three degrees of freedom
NEAR = 0.1  # m: centres that are this near agree, however sure they are
NEIGHBOURS = 8  # frames around a frame whose centres must agree with its own


class Centres(NamedTuple):
    """Normal distributions of the centres of B frames."""

    mean: Array
    """(B, 3)"""
    sigma: Array
    """(B, 3)"""

    def of_prior(self, prior: GaussianPrior | None, size: int) -> GaussianPrior:
        """In place of what a prior (B, n) says of the centre; None is a prior of nothing."""
        if prior is None:
            prior = GaussianPrior(np.zeros((len(self.mean), size)), np.full((len(self.mean), size), np.inf))
        mean, sigma = prior.mean.copy(), prior.sigma.copy()
        mean[:, CENTER], sigma[:, CENTER] = self
        return GaussianPrior(mean, sigma)


def agreed_centre(calibrations: Sequence[Calibration]) -> Array | None:
    """The centre (3,) that most frames of one tripod agree on within their covariances; None without any."""
    voted = voted_centres(calibrations, 1)
    return voted[0] if voted else None


def voted_centres(calibrations: Sequence[Calibration], most: int) -> list[Array]:
    """Up to `most` centres (3,) that frames of one tripod agree on: of most of them, of most of the rest, and so on."""
    found: list[Array] = []
    C, V = _centres(calibrations)
    while len(C) and len(found) < most:
        distance = _squared(C[:, None] - C, V[:, None] + V, np.sqrt(2.0) * NEAR * np.ones(3))
        agree = distance[np.argmax(np.sum(distance < AGREE, axis=1))] < AGREE
        precision = np.linalg.inv(V[agree] + NEAR**2 * np.eye(3))
        mean = np.linalg.solve(np.sum(precision, axis=0), np.einsum("nij,nj->i", precision, C[agree]))
        found.append(np.asarray(mean))
        C, V = C[~agree], V[~agree]
    return found


def nearest_places(calibrations: Sequence[Calibration]) -> IntArray:
    """Which of the two places that frames vote for is nearer to each of B frames, (B,): all 0 where it is one only."""
    places = voted_centres(calibrations, 2)
    if len(places) < 2:
        return np.zeros(len(calibrations), dtype=np.intp)
    C, V = _centres(calibrations)
    distance = [_squared(C - place, V, NEAR * np.ones(3)) for place in places]
    return np.asarray(np.argmin(distance, axis=0))


def expected_centres(columns: FrameColumns, done: BoolArray, index: IntArray) -> Centres:
    """The centres of frames `index` (B,), from those (T,) that are done.

    Between two frames the centre is where an even motion has it, but for what an acceleration does in that time; before
    the first and after the last one it may go anywhere at its largest speed.
    """
    known = np.flatnonzero(done)
    C, sigma = columns.theta[known, CENTER], columns.centre_sigma(known)
    after = np.clip(np.searchsorted(known, index), 0, len(known) - 1)
    before = np.clip(np.searchsorted(known, index, side="right") - 1, 0, len(known) - 1)
    gap = np.abs(known[after] - known[before])
    share = np.divide(index - known[before], gap, out=np.zeros(len(index)), where=gap > 0)[:, None]
    beyond = np.where(gap == 0, np.abs(index - known[before]), 0)
    bend = 0.5 * ACCELERATION * (index - known[before]) * (known[after] - index)
    spread = np.where(gap > 0, bend, SPEED * beyond)[:, None]
    mean = (1.0 - share) * C[before] + share * C[after]
    return Centres(mean, np.hypot((1.0 - share) * sigma[before] + share * sigma[after], spread))


def on_path(found: Mapping[int, Calibration]) -> dict[int, Calibration]:
    """Without the frames whose centre most of the frames around them contradict: these are too far to go."""
    frames = np.array(sorted(found), dtype=np.intp)
    C, V = _centres([found[t] for t in frames.tolist()])
    way = SPEED * np.abs(frames[:, None] - frames)
    distance = _squared(C[:, None] - C, V[:, None] + V, np.hypot(way, NEAR)[..., None])
    near = np.argsort(way, axis=1, kind="stable")[:, 1 : NEIGHBOURS + 1]
    agree = np.take_along_axis(distance, near, axis=1) < AGREE
    kept = np.count_nonzero(agree, axis=1) >= 0.5 * agree.shape[1]
    return {t: found[t] for t in frames[kept].tolist()}


def near_path(found: Mapping[int, Calibration], columns: FrameColumns, done: BoolArray) -> dict[int, Calibration]:
    """Those whose centre is where frames (T,) that are done let it be."""
    frames = np.array(sorted(found), dtype=np.intp)
    mean, sigma = expected_centres(columns, done, frames)
    C, V = _centres([found[t] for t in frames.tolist()])
    return {t: found[t] for t in frames[_squared(C - mean, V, np.hypot(sigma, NEAR)) < AGREE].tolist()}


def _centres(calibrations: Sequence[Calibration]) -> tuple[Array, Array]:
    """Of N frames (N, 3), and their covariances (N, 3, 3)."""
    C = [calibration.uncertainty.theta[CENTER] for calibration in calibrations]
    V = [calibration.uncertainty.if_level.covariance[CENTER, CENTER] for calibration in calibrations]
    return np.reshape(C, (-1, 3)), np.reshape(V, (-1, 3, 3))


def _squared(difference: Array, covariance: Array, sigma: Array) -> Array:
    """Squared distances (...,) in standard deviations, with `sigma` (..., 3 or 1) besides a covariance (..., 3, 3)."""
    V = covariance + np.square(sigma)[..., None] * np.eye(3)
    return np.asarray(np.einsum("...i,...i->...", difference, np.linalg.solve(V, difference[..., None])[..., 0]))
