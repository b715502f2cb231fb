"""Which shots of a clip were taken from the same tripod, and their calibration together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fieldcalib._types import Array
from fieldcalib.assess.misfit import is_of_wrong_model
from fieldcalib.assess.sequence_calibration import SequenceCalibration
from fieldcalib.images.clip_keyframes import Keyframes
from fieldcalib.images.pieces import CameraModel, Pieces
from fieldcalib.images.solved_shots import SolvedShots
from fieldcalib.solve.options import CalibrationFlags

PLACE = ("x", "y", "z")
SIZE = ("length", "width")
SAME_PLATFORM, ELSEWHERE = 1.5, 15.0  # m: standard deviations of where other cameras stand
LEAST_LOG_RATIO = 1.0  # of the likelihoods: two places that are hardly known agree by chance
UNMODELLED = 0.1  # m: standard deviation of each coordinate beyond its covariance


class Tripod(NamedTuple):
    """Pieces of a clip from one tripod."""

    pieces: tuple[int, ...]
    calibration: SequenceCalibration
    """Calibration of their frames, in order."""


@dataclass(frozen=True, eq=False)
class SolvedTripods:
    """The tripods of a clip, each calibrated from the keyframes of its pieces."""

    keyframes: Keyframes
    pieces: Pieces
    tripods: tuple[Tripod, ...]
    """The tripod with most frames comes first."""
    notes: tuple[str, ...] = ()
    """Notes for the user on the clip."""


def solve_tripods(shots: SolvedShots) -> SolvedTripods:
    """Calibrate shots of one tripod together."""
    options, pieces = shots.keyframes.options, shots.pieces
    stands = "centre" in options.shared
    located = [piece for piece, shot in shots.calibrations.items() if shot.together]
    moving = [piece for piece in located if pieces.models.get(piece) is CameraModel.MOVING]
    cut_out = [piece for piece in located if pieces.models.get(piece) is CameraModel.CUT_OUT]
    if not stands:
        groups = [[piece] for piece in located]
    elif options.flags & CalibrationFlags.CALIB_FIX_POSITION:  # one place, as the user says
        groups = [located] if located else []
    else:
        standing = {piece: shot for piece, shot in shots.calibrations.items() if piece not in moving}
        groups = grouped_by_tripod({piece: shot for piece, shot in standing.items() if piece not in cut_out})
        if cut_out:  # these have another principal point
            groups += grouped_by_tripod({piece: standing[piece] for piece in cut_out})
        groups += [[piece] for piece in moving]
    groups += [[piece] for piece in shots.calibrations if pieces.models.get(piece) is CameraModel.ALONE]
    tripods = sorted(_consistent_tripods(shots, groups), key=lambda tripod: -len(tripod.calibration))
    if stands:
        tripods = _with_doubtful_pieces(shots.keyframes, pieces, tripods)
    return SolvedTripods(shots.keyframes, pieces, tuple(tripods), shots.notes)


def _consistent_tripods(shots: SolvedShots, groups: Sequence[Sequence[int]]) -> list[Tripod]:
    """The tripods of groups of pieces; pieces that turn out to have another camera make tripods of their own.

    A piece that hardly determines its place joins any group; solved together, its own lines may contradict the others.
    """
    found, left, keyframes = [], list(groups), shots.keyframes
    while left:
        members = left.pop(0)
        calibration = (
            shots.calibrations[members[0]]
            if len(members) == 1
            else keyframes.calibrate(shots.pieces, members, keyframes.accepted)
        )
        others = _contradicted(shots, members, calibration)
        if others:
            left.append([piece for piece in members if piece not in others])
            left += grouped_by_tripod({piece: shots.calibrations[piece] for piece in others})
        else:
            found.append(Tripod(tuple(members), calibration))
    return found


def _contradicted(shots: SolvedShots, members: Sequence[int], calibration: SequenceCalibration) -> list[int]:
    """Pieces whose lines fit their own tripod, but not that of all members; never all of them."""
    options, size = shots.keyframes.options, shots.keyframes.shots.image_size
    if len(members) == 1 or options.flags & CalibrationFlags.CALIB_FIX_POSITION:
        return []
    number = shots.pieces.number[shots.pieces.frames(members)]
    excess = {p: calibration.frames.misfit[number == p] for p in members}
    wrong = [
        p
        for p in members
        if is_of_wrong_model(excess[p], size) and not is_of_wrong_model(shots.calibrations[p].frames.misfit, size)
    ]
    return wrong if len(wrong) < len(members) else [max(wrong, key=lambda p: float(np.nanmedian(excess[p])))]


def _with_doubtful_pieces(keyframes: Keyframes, pieces: Pieces, tripods: Sequence[Tripod]) -> list[Tripod]:
    """Tripods with the pieces that have doubtful labels only, where these fit a camera on that tripod."""
    found = list(tripods)
    for k, tripod in enumerate(tripods):
        if pieces.models_of(tripod.pieces) == {CameraModel.ALONE}:
            continue
        taken = {piece for one in found for piece in one.pieces}
        doubtful = {t: labels for t, labels in keyframes.doubtful.items() if int(pieces.number[t]) not in taken}
        if not doubtful:
            break
        labels = {**keyframes.accepted, **doubtful}
        members = sorted({*tripod.pieces, *(int(pieces.number[t]) for t in doubtful)})
        accepted = keyframes.calibrate(pieces, members, labels).accepted
        number = pieces.number[pieces.frames(members)]
        fitting = tuple(p for p in members if np.any(accepted[number == p]))
        if set(fitting) > set(tripod.pieces):
            found[k] = Tripod(fitting, keyframes.calibrate(pieces, fitting, labels))
    return found


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


def grouped_by_tripod(shots: Mapping[int, SequenceCalibration]) -> list[list[int]]:
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
