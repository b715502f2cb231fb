"""Centre of one camera from frames that were calibrated by themselves: the position on which most agree, or a path.

Frames with wrong labels, or whose fit ended in a wrong minimum, have other centres and are outvoted.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from fieldcalib._types import Array, BoolArray, IntArray
from fieldcalib.assess.frame_table import FrameTable
from fieldcalib.assess.ground import Considered, given_crown
from fieldcalib.assess.result import Calibration
from fieldcalib.problem.layout import CENTER, GaussianPrior

# At 25 frames per second: cameras on wires and drones accelerate by 5 m/s^2 and fly at up to 10 m/s.
ACCELERATION = 0.008  # m per frame squared: standard deviation of a coordinate
SPEED = 0.4  # m per frame
AGREE = 7.8  # squared distance in standard deviations: 95 % of chi-squared with three degrees of freedom
NEAR = 0.1  # m: centres that are this near agree, however small their errors
NEIGHBOURS = 8  # frames around a frame whose centres must agree with its own


class Centres(NamedTuple):
    """Normal distributions of the centres of B frames."""

    mean: Array
    """Means, (B, 3)."""
    sigma: Array
    """Standard deviations, (B, 3)."""

    def of_prior(self, prior: GaussianPrior | None, size: int) -> GaussianPrior:
        """Replace the centre in a prior (B, n) by these; None is a prior without information."""
        if prior is None:
            prior = GaussianPrior(np.zeros((len(self.mean), size)), np.full((len(self.mean), size), np.inf))
        mean, sigma = prior.mean.copy(), prior.sigma.copy()
        mean[:, CENTER], sigma[:, CENTER] = self
        return GaussianPrior(mean, sigma)


class KnownCentres(NamedTuple):
    """Centres of K solved frames of a camera that moves."""

    time: IntArray
    """Numbers of the frames, (K,) ascending."""
    C: Array
    """Centres, (K, 3)."""
    sigma: Array
    """Standard deviations, (K, 3)."""

    @classmethod
    def of(cls, frames: FrameTable, some: BoolArray, considered: Considered) -> KnownCentres:
        """Take the centres of some frames (T,) of a table, and their errors."""
        layout, V = considered.layout, considered.covariance
        centre = layout.is_centre[layout.free]
        E, F = frames.own[some], frames.following[some][:, centre]
        variance = np.diagonal(E, axis1=1, axis2=2)[:, centre] + np.einsum("bij,jk,bik->bi", F, V, F)
        return cls(np.flatnonzero(some), frames.theta[some, CENTER], np.sqrt(variance))


def voted_centres(calibrations: Sequence[Calibration], most: int) -> list[Array]:
    """Find up to `most` centres (3,): the one on which most frames agree, then that of most of the rest, and so on."""
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
    """Index, 0 or 1, of the nearer of the two centres that frames vote for, (B,); 0 if they vote for only one."""
    places = voted_centres(calibrations, 2)
    if len(places) < 2:
        return np.zeros(len(calibrations), dtype=np.intp)
    C, V = _centres(calibrations)
    return np.asarray(np.argmin([_squared(C - place, V, NEAR * np.ones(3)) for place in places], axis=0))


def expected_centres(known: KnownCentres, index: IntArray) -> Centres:
    """Interpolate the centres of frames `index` (B,) from the centres of known frames.

    Between two known frames a uniform motion is expected, with the uncertainty of an acceleration during that time;
    before the first and after the last known frame the centre may move in any direction at its largest speed.
    """
    time, C, sigma = known
    after = np.clip(np.searchsorted(time, index), 0, len(time) - 1)
    before = np.clip(np.searchsorted(time, index, side="right") - 1, 0, len(time) - 1)
    gap = np.abs(time[after] - time[before])
    share = np.divide(index - time[before], gap, out=np.zeros(len(index)), where=gap > 0)[:, None]
    beyond = np.where(gap == 0, np.abs(index - time[before]), 0)
    bend = 0.5 * ACCELERATION * (index - time[before]) * (time[after] - index)
    spread = np.where(gap > 0, bend, SPEED * beyond)[:, None]
    mean = (1.0 - share) * C[before] + share * C[after]
    return Centres(mean, np.hypot((1.0 - share) * sigma[before] + share * sigma[after], spread))


def on_path(found: Mapping[int, Calibration]) -> dict[int, Calibration]:
    """Keep the frames whose centre can be reached from at least half of the frames around them at the largest speed."""
    frames = np.array(sorted(found), dtype=np.intp)
    C, V = _centres([found[t] for t in frames.tolist()])
    way = SPEED * np.abs(frames[:, None] - frames)
    distance = _squared(C[:, None] - C, V[:, None] + V, np.hypot(way, NEAR)[..., None])
    near = np.argsort(way, axis=1, kind="stable")[:, 1 : NEIGHBOURS + 1]
    agree = np.take_along_axis(distance, near, axis=1) < AGREE
    kept = np.count_nonzero(agree, axis=1) >= 0.5 * agree.shape[1]
    return {t: found[t] for t in frames[kept].tolist()}


def near_path(found: Mapping[int, Calibration], known: KnownCentres) -> dict[int, Calibration]:
    """Keep the frames whose centre agrees with the centre expected from known frames."""
    frames = np.array(sorted(found), dtype=np.intp)
    mean, sigma = expected_centres(known, frames)
    C, V = _centres([found[t] for t in frames.tolist()])
    return {t: found[t] for t in frames[_squared(C - mean, V, np.hypot(sigma, NEAR)) < AGREE].tolist()}


def _centres(calibrations: Sequence[Calibration]) -> tuple[Array, Array]:
    """Centres of N frames (N, 3), and their covariances if the crown, which they share, were known (N, 3, 3)."""
    errors = [calibration.uncertainty for calibration in calibrations]
    C = [one.theta[CENTER] for one in errors]
    V = [given_crown(one.covariance, one.layout.is_crown)[CENTER, CENTER] for one in errors]
    return np.reshape(C, (-1, 3)), np.reshape(V, (-1, 3, 3))


def _squared(difference: Array, covariance: Array, sigma: Array) -> Array:
    """Squared distances (...,) in standard deviations; `sigma` (..., 3 or 1) adds to the covariance (..., 3, 3)."""
    V = covariance + np.square(sigma)[..., None] * np.eye(3)
    return np.asarray(np.einsum("...i,...i->...", difference, np.linalg.solve(V, difference[..., None])[..., 0]))
