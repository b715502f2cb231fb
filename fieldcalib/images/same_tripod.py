"""Which shots were taken from the same tripod."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fieldcalib._types import Array
from fieldcalib.assess.sequence_calibration import SequenceCalibration

PLACE = ("x", "y", "z")
SIZE = ("length", "width")
SAME_PLATFORM, ELSEWHERE = 1.5, 15.0  # m: standard deviations of where other cameras stand
LEAST_LOG_RATIO = 1.0  # of the likelihoods: two places that are hardly known agree by chance
UNMODELLED = 0.1  # m: standard deviation of each coordinate beyond its covariance


def same_tripod_log_ratio(difference: Array, covariance: Array) -> float:
    """Log likelihood ratio of one tripod to two, from the difference (3 + k,) of two estimates and its covariance.

    The first three numbers are of the centre, the others of the size of the field, which is the same in any case. On
    one tripod the difference is nothing but error. Otherwise the second camera stands beside the first one or somewhere
    else, both with the same probability.

    Examples
    --------
    >>> sure = 0.01 * np.eye(3)
    >>> same_tripod_log_ratio(np.array([0.1, 0.0, 0.0]), sure) > 4.0 > 0.0 > same_tripod_log_ratio(np.ones(3), sure)
    True
    >>> same_tripod_log_ratio(np.ones(3), 10000.0 * sure) < LEAST_LOG_RATIO  # undecided
    True
    """
    is_place = np.arange(len(difference)) < len(PLACE)
    V = covariance + 2.0 * UNMODELLED**2 * np.eye(len(difference))

    def log_density(sigma: float) -> float:
        W = V + sigma**2 * np.diag(is_place)
        return float(-0.5 * (difference @ np.linalg.solve(W, difference) + np.linalg.slogdet(W)[1]))

    return log_density(0.0) - float(np.logaddexp(log_density(SAME_PLATFORM), log_density(ELSEWHERE)) - np.log(2.0))


def grouped(shots: Mapping[int, SequenceCalibration]) -> list[list[int]]:
    """Group shots by their tripods; those whose place was not found are in no group.

    The shot with the most certain place comes first. Each joins the group that it most probably belongs to, or begins a
    new one. The place of a group is that of its first shot.
    """
    found = {number: shot for number, shot in shots.items() if shot.names}
    groups: list[list[int]] = []
    for number in sorted(found, key=lambda number: float(np.trace(found[number].covariance_if_level[:3, :3]))):
        ratios = [_log_ratio(found[group[0]], found[number]) for group in groups]
        if ratios and max(ratios) >= LEAST_LOG_RATIO:
            groups[int(np.argmax(ratios))].append(number)
        else:
            groups.append([number])
    return [sorted(group) for group in groups]


def _log_ratio(one: SequenceCalibration, two: SequenceCalibration) -> float:
    names = [name for name in (*PLACE, *SIZE) if name in one.names and name in two.names]
    i, j = ([shot.names.index(name) for name in names] for shot in (one, two))
    V, W = one.covariance_if_level[np.ix_(i, i)], two.covariance_if_level[np.ix_(j, j)]
    return same_tripod_log_ratio(one.values[i] - two.values[j], V + W)
