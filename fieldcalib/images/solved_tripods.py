"""Shots of a clip that were taken from the same tripod, calibrated together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fieldcalib.assess.misfit import is_of_wrong_model
from fieldcalib.assess.sequence_calibration import SequenceCalibration
from fieldcalib.images.clip_keyframes import Keyframes
from fieldcalib.images.pieces import CameraModel, Pieces
from fieldcalib.images.same_tripod import grouped
from fieldcalib.images.solved_shots import SolvedShots
from fieldcalib.solve.options import CalibrationFlags


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
    if not stands:
        groups = [[piece] for piece in located]
    elif options.flags & CalibrationFlags.CALIB_FIX_POSITION:  # one place, as the user says
        groups = [located] if located else []
    else:
        groups = grouped({piece: shot for piece, shot in shots.calibrations.items() if piece not in moving})
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
            left += grouped({piece: shots.calibrations[piece] for piece in others})
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
