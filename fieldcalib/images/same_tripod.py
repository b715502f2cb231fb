"""Which shots were taken from the same tripod."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fieldcalib._types import Array
from fieldcalib.assess.sequence import SequenceCalibration

BESIDE, ELSEWHERE = 1.5, 15.0  # m: where other cameras stand: on the same platform, or anywhere
LEAST_LOG_RATIO = 2.0  # of the likelihoods: two places that are hardly known agree by chance
UNMODELLED = 0.1  # m: standard deviation of each coordinate that a covariance does not know of


def same_tripod_log_ratio(difference: Array, covariance: Array) -> float:
    """Log likelihood ratio of one tripod to two, of centres that differ by (3,), with the sum of their covariances.

    On one tripod the difference is nothing but error. Otherwise the second camera stands beside the first one or
    somewhere else, as probably.

    Examples
    --------
    >>> sure = 0.01 * np.eye(3)
    >>> same_tripod_log_ratio(np.array([0.1, 0.0, 0.0]), sure) > 5.0 > 0.0 > same_tripod_log_ratio(np.ones(3), sure)
    True
    >>> same_tripod_log_ratio(np.ones(3), 1000.0 * sure) < 1.0  # who knows
    True
    """
    V = covariance + 2.0 * UNMODELLED**2 * np.eye(3)

    def log_density(sigma: float) -> float:
        W = V + sigma**2 * np.eye(3)
        return float(-0.5 * (difference @ np.linalg.solve(W, difference) + np.linalg.slogdet(W)[1]))

    return log_density(0.0) - float(np.logaddexp(log_density(BESIDE), log_density(ELSEWHERE)) - np.log(2.0))


def grouped(shots: Mapping[int, SequenceCalibration]) -> list[list[int]]:
    """The shots by their tripods; those whose place was not found are in no group.

    The most certain place comes first. Each shot joins the group that it most probably belongs to, which then is known
    better, or begins a new one.
    """
    found = {number: shot for number, shot in shots.items() if shot.names}
    order = sorted(found, key=lambda number: float(np.trace(found[number].covariance[:3, :3])))
    groups: list[list[int]] = []
    places: list[tuple[Array, Array]] = []  # mean and covariance
    for number in order:
        C, V = found[number].values[:3], found[number].covariance[:3, :3]
        ratios = [same_tripod_log_ratio(C - mean, V + covariance) for mean, covariance in places]
        best = int(np.argmax(ratios)) if ratios else -1
        if best < 0 or ratios[best] < LEAST_LOG_RATIO:
            groups.append([number])
            places.append((C, V))
            continue
        groups[best].append(number)
        mean, covariance = places[best]
        gain = covariance @ np.linalg.inv(covariance + V)
        places[best] = mean + gain @ (C - mean), covariance - gain @ covariance
    return [sorted(group) for group in groups]
