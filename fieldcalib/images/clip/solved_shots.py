"""Calibration of the shots of a clip from their keyframes: each shot by itself, then shots of one tripod together.

`solve_shots` chooses for each shot the camera model that best predicts labels and matches that are left out.
`solve_tripods` decides which shots were taken from the same tripod, by the likelihood ratio of one place to two, and
calibrates these together.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from fieldcalib._types import Array, IntArray
from fieldcalib.assess.label_errors import LEAST_FRAMES, LEAST_SHARE, is_contradicted, is_of_wrong_model
from fieldcalib.assess.sequence_calibration import SequenceCalibration
from fieldcalib.images.clip.clip_models import (
    ALONE,
    CAMERA_MODELS,
    CUT_OUT,
    CameraModel,
    HeldOut,
    Misprediction,
    Pieces,
    gain_note,
    misfit_note,
    parts,
)
from fieldcalib.images.clip.clip_shape import MAY_BE_OFF, OFF_MIDDLE, off_middle
from fieldcalib.images.clip.keyframes import Keyframes, witnesses_of
from fieldcalib.problem.picture_shape import is_whole_shape
from fieldcalib.solve.sequence.tripod_position import nearest_places
from fieldcalib.solve.solver_options import CalibrationFlags

PLACE = ("x", "y", "z")
SIZE = ("length", "width")
SAME_PLATFORM, ELSEWHERE = 1.5, 15.0  # m: standard deviations of the distance of another camera, nearby or anywhere
LEAST_LOG_RATIO = 1.0  # of one place to two: more than 0, as two places that are hardly known agree by chance
UNMODELLED = 0.1  # m: standard deviation of each coordinate in addition to its covariance


@dataclass(frozen=True, eq=False)
class SolvedShots:
    """The pieces of a clip, each calibrated by itself."""

    keyframes: Keyframes
    pieces: Pieces
    """The pieces of the keyframes, or parts of these, with their camera models."""
    calibrations: Mapping[int, SequenceCalibration]
    """Calibrations of the frames of each piece, in order."""
    notes: tuple[str, ...] = ()
    """Notes for the user on frames that no tripod explains."""


def solve_shots(keyframes: Keyframes, *, only_tripods: bool = False) -> SolvedShots:
    """Calibrate each piece by itself: on a tripod, or, if that fails, in parts or with another camera model.

    With `only_tripods` no other model is tried: labels that may still be wrong must not decide on the model.
    """
    solved = SolvedShots(keyframes, _with_loose_frames(keyframes), {})
    if only_tripods:
        pieces, labels = solved.pieces, keyframes.accepted
        return replace(solved, calibrations={p: keyframes.calibrate(pieces, [p], labels) for p in pieces.numbers})
    while left := [piece for piece in solved.pieces.numbers if piece > max(solved.calibrations, default=-1)]:
        solved = _with_next(solved, left[0])
    return solved


def _with_loose_frames(keyframes: Keyframes) -> Pieces:
    """Join loose frames at the end of a piece to it, unless the labels in them contradict it."""
    shots, pieces = keyframes.shots, keyframes.shots.pieces
    labelled = {int(pieces.number[t]) for t in keyframes.accepted}
    for piece in np.unique(pieces.number[shots.loose])[::-1].tolist():
        if piece not in labelled or (piece - 1 in labelled and _belongs(keyframes, pieces, piece)):
            pieces = pieces.joined(piece)
    return pieces


def _belongs(keyframes: Keyframes, pieces: Pieces, piece: int) -> bool:
    """Whether one place of the camera explains the labels both in a piece and in the one before."""
    both = [piece - 1, piece]
    frames, found = pieces.frames(both), keyframes.calibrate(pieces, both, keyframes.accepted)
    wrong = is_contradicted(found.frames.misfit, keyframes.shots.image_size) | ~found.usable
    labelled, is_own = np.isin(frames, list(keyframes.accepted)), pieces.number[frames] == piece
    return not np.any(wrong[labelled & is_own]) and bool(np.mean(wrong[labelled & ~is_own]) < LEAST_SHARE)


def _with_next(solved: SolvedShots, piece: int) -> SolvedShots:
    """Solve one more piece; if it is divided, its parts are numbered from its number on."""
    clip, pieces = solved.keyframes, solved.pieces
    how, size, frames = clip.how, clip.shots.image_size, pieces.frames([piece])
    calibration = clip.calibrate(pieces, [piece], clip.accepted)
    # the tripod is wrong if labels of keyframes, found without it, contradict its cameras; then other models are tried
    keyframes = np.array(sorted(witnesses_of(clip.labels, frames.tolist(), calibration)), dtype=np.intp)
    excess = calibration.frames.misfit[keyframes]
    labelled = np.count_nonzero(np.isin(frames, list(clip.accepted)))
    is_wrong = bool(labelled >= LEAST_FRAMES and is_of_wrong_model(excess, size))
    found = SolvedShots(clip, pieces, {piece: calibration})
    is_free = how.is_on_tripod and not how.task.chosen_flags & CalibrationFlags.CALIB_FIX_POSITION
    if is_free and calibration.together and (is_wrong or not is_whole_shape(size)):
        first: list[list[int]] = []
        if is_wrong:
            found = replace(found, notes=(misfit_note(clip.shots.begin + frames),))
            first = [parts(frames[keyframes], is_contradicted(excess, size)), _parts_of_two_places(found, piece)]
        found = _best_model(found, piece, _other_models(found, piece, first, is_wrong=is_wrong))
    if is_free and found.pieces.model_of([piece]).may_be_part:
        found = _cut_out(found, piece)
    return replace(
        found, calibrations={**solved.calibrations, **found.calibrations}, notes=(*solved.notes, *found.notes)
    )


def _cut_out(on_tripod: SolvedShots, piece: int) -> SolvedShots:
    """Free the principal point of a piece on a tripod, and keep this if it turns out to be far from the middle."""
    clip, how = on_tripod.keyframes, on_tripod.keyframes.how
    if how.task.given.camera_matrix is not None or off_middle(on_tripod.calibrations[piece], how) < MAY_BE_OFF:
        return on_tripod
    pieces = on_tripod.pieces.with_model(piece, CUT_OUT)
    found = clip.calibrate(pieces, [piece], clip.accepted)
    if not found.together or off_middle(found, how) < OFF_MIDDLE:
        return on_tripod
    x, y = (found.shared[name][0] for name in ("cx", "cy"))
    note = CUT_OUT.said(clip.shots.begin + pieces.frames([piece]), x=x, y=y)
    calibrations = {**on_tripod.calibrations, piece: found}
    return replace(on_tripod, pieces=pieces, calibrations=calibrations, notes=(*on_tripod.notes, note))


def _parts_of_two_places(solved: SolvedShots, piece: int) -> list[int]:
    """First keyframes of parts, if each keyframe by itself is assigned to the nearer of two places of the camera."""
    pieces = solved.pieces.with_model(piece, ALONE)
    alone = solved.keyframes.calibrate(pieces, [piece], solved.keyframes.accepted)
    keyframes = np.flatnonzero(alone.accepted)
    return parts(pieces.frames([piece])[keyframes], nearest_places([alone[k] for k in keyframes.tolist()]) > 0)


def _other_models(
    on_tripod: SolvedShots, piece: int, first: Sequence[Sequence[int]], *, is_wrong: bool
) -> Iterator[tuple[CameraModel, IntArray, Pieces]]:
    """Yield the other camera models for a piece, simplest first, with the frames to name to the user, and all pieces.

    `first` has the keyframes before which the piece may be divided into parts, in one or more ways. If the tripod is
    not wrong, only a window is tried.
    """
    pieces, frames = on_tripod.pieces, on_tripod.pieces.frames([piece])
    divided = [(np.array(some), pieces.divided(some)) for k, some in enumerate(first) if some and some not in first[:k]]
    for model in CAMERA_MODELS:
        if model.is_tried(on_tripod.keyframes.how.task, is_wrong=is_wrong):
            whole = frames, pieces.with_model(piece, model)
            yield from ((model, *one) for one in (divided if model.divides else [whole]))


def _best_model(
    on_tripod: SolvedShots, piece: int, models: Iterable[tuple[CameraModel, IntArray, Pieces]]
) -> SolvedShots:
    """Solve a piece with the camera model that predicts best: a tripod, unless another model is clearly better."""
    clip, best = on_tripod.keyframes, on_tripod
    left_out = _left_out(clip, on_tripod.pieces, piece)
    of_tripod = of_best = _misprediction(on_tripod, left_out)
    for model, frames, pieces in models:
        members = range(piece, piece + 1 + pieces.numbers[-1] - on_tripod.pieces.numbers[-1])
        tried = SolvedShots(clip, pieces, {p: clip.calibrate(pieces, [p], clip.accepted) for p in members})
        if not model.is_alone and not any(one.together for one in tried.calibrations.values()):
            continue
        score = _misprediction(tried, left_out)
        if model.is_preferred(score, of_best, of_tripod):
            note = gain_note(model, clip.shots.begin + frames, of_tripod, score)
            best, of_best = replace(tried, notes=(note,)), score
    return best


def _misprediction(solved: SolvedShots, left_out: HeldOut) -> Misprediction:
    """Solve pieces again without some labels and matches, and measure how well these are predicted."""
    clip, pieces = solved.keyframes, solved.pieces
    found = [
        (pieces.frames([p]), clip.calibrate(pieces, [p], left_out.kept, start, left_out.pairs))
        for p, start in solved.calibrations.items()
    ]
    return left_out.misprediction(clip.how.task.object_segments, found)


def _left_out(clip: Keyframes, pieces: Pieces, piece: int) -> HeldOut:
    """Choose labels and matches to leave out, among the keyframes of a piece."""
    keys = {key for key, _ in clip.shots.matches}
    labels = {t: one for t, one in clip.accepted.items() if pieces.number[t] == piece}
    between = {
        pair: cells for pair, cells in clip.shots.matches.items() if pair[1] in keys and pieces.number[pair[1]] == piece
    }
    return HeldOut.of(labels, between)


class Tripod(NamedTuple):
    """Pieces of a clip that were taken from one tripod."""

    pieces: tuple[int, ...]
    calibration: SequenceCalibration
    """Calibration of the frames of these pieces, in order."""


@dataclass(frozen=True, eq=False)
class SolvedTripods:
    """The tripods of a clip, each calibrated from the keyframes of its pieces."""

    keyframes: Keyframes
    pieces: Pieces
    tripods: tuple[Tripod, ...]
    """The tripod with most frames comes first."""
    notes: tuple[str, ...] = ()
    """Notes for the user on the clip."""


def solve_tripods(shots: SolvedShots, needed: Collection[int] | None = None) -> SolvedTripods:
    """Group shots by their tripod, and calibrate the shots of each group together.

    Pieces that have only doubtful labels are added if they are `needed`, by default all.
    """
    shots = _on_one_pitch(shots)
    how, pieces = shots.keyframes.how, shots.pieces
    stands = how.is_on_tripod
    located = [piece for piece, shot in shots.calibrations.items() if shot.together]
    if not stands:
        groups = [[piece] for piece in located]
    elif how.task.chosen_flags & CalibrationFlags.CALIB_FIX_POSITION:  # one place, as the user says
        groups = [located] if located else []
    else:
        models = {piece: pieces.model_of([piece]) for piece in shots.calibrations}
        groups = []
        for tripod in dict.fromkeys(model.tripod for model in CAMERA_MODELS if model.tripod):
            if some := {p: shots.calibrations[p] for p, model in models.items() if model.tripod == tripod}:
                groups += grouped_by_tripod(some)
        own = [piece for piece, model in models.items() if not model.tripod]
        groups += [[piece] for piece in sorted(own, key=lambda piece: CAMERA_MODELS.index(models[piece]))]
    tripods = sorted(_consistent_tripods(shots, groups), key=lambda tripod: -len(tripod.calibration))
    if stands:
        tripods = _with_doubtful_pieces(shots.keyframes, pieces, tripods, needed)
    return SolvedTripods(shots.keyframes, pieces, tuple(tripods), shots.notes)


def _on_one_pitch(shots: SolvedShots) -> SolvedShots:
    """Solve pieces that do not determine the size of the field again, on one of the size that others determine."""
    keyframes, pitch = shots.keyframes, shots.keyframes.how.task.field
    told = [(name, shot.shared[name]) for shot in shots.calibrations.values() for name in SIZE if name in shot.names]
    size = {name: value for name, (value, _) in sorted(told, key=lambda one: -one[1][1])}  # the surest one is the last
    left = [p for p, shot in shots.calibrations.items() if shot.together and not size.keys() <= set(shot.names)]
    if pitch is None or not left:
        return shots
    field = pitch.resized(size.get("length", pitch.length), size.get("width", pitch.width))
    keyframes = replace(keyframes, sized=dict.fromkeys(left, field))
    again = {piece: keyframes.calibrate(shots.pieces, [piece], keyframes.accepted) for piece in left}
    return replace(shots, keyframes=keyframes, calibrations={**shots.calibrations, **again})


def _consistent_tripods(shots: SolvedShots, groups: Sequence[Sequence[int]]) -> list[Tripod]:
    """Solve groups of pieces as tripods; pieces that turn out to have another camera are grouped among themselves.

    This happens because a piece that hardly determines its place can be put into any group. Solved together with the
    others, its lines may contradict theirs.
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
    """Pieces whose lines fit when solved alone, but not with the other members; never all of them."""
    how, size = shots.keyframes.how, shots.keyframes.shots.image_size
    if len(members) == 1 or how.task.chosen_flags & CalibrationFlags.CALIB_FIX_POSITION:
        return []
    number = shots.pieces.number[shots.pieces.frames(members)]
    excess = {p: calibration.frames.misfit[number == p] for p in members}
    wrong = [
        p
        for p in members
        if is_of_wrong_model(excess[p], size) and not is_of_wrong_model(shots.calibrations[p].frames.misfit, size)
    ]
    return wrong if len(wrong) < len(members) else [max(wrong, key=lambda p: float(np.nanmedian(excess[p])))]


def _with_doubtful_pieces(
    keyframes: Keyframes, pieces: Pieces, tripods: Sequence[Tripod], needed: Collection[int] | None
) -> list[Tripod]:
    """Add to tripods the needed pieces that have only doubtful labels, if these fit a camera on that tripod."""
    found = list(tripods)
    every = {t: one for t, one in keyframes.doubtful.items() if needed is None or int(pieces.number[t]) in needed}
    for k, tripod in enumerate(tripods):
        if pieces.model_of(tripod.pieces).is_alone:
            continue
        taken = {piece for one in found for piece in one.pieces}
        doubtful = {t: labels for t, labels in every.items() if int(pieces.number[t]) not in taken}
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

    The first three numbers are the centre, the others the size of the field, which is the same in both cases. On one
    tripod the difference is only error. Otherwise the second camera stands beside the first one (`SAME_PLATFORM`) or
    somewhere else (`ELSEWHERE`), with equal probability.

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
    """Group shots by their tripods; shots whose place was not found are in no group.

    Shots are taken in order of certainty of their place, the most certain first. Each joins the group that it most
    probably belongs to, or begins a new one. The place of a group is that of its first shot.
    """
    found = {number: shot for number, shot in shots.items() if shot.names}
    groups: list[list[int]] = []
    for number in sorted(found, key=lambda number: float(np.trace(found[number].covariance[:3, :3]))):
        ratios = [_log_ratio(found[group[0]], found[number]) for group in groups]
        if ratios and max(ratios) >= LEAST_LOG_RATIO:
            groups[int(np.argmax(ratios))].append(number)
        else:
            groups.append([number])
    return [sorted(group) for group in groups]


def _log_ratio(one: SequenceCalibration, two: SequenceCalibration) -> float:
    names = [name for name in (*PLACE, *SIZE) if name in one.names and name in two.names]
    i, j = ([shot.names.index(name) for name in names] for shot in (one, two))
    V, W = one.covariance[np.ix_(i, i)], two.covariance[np.ix_(j, j)]
    return same_tripod_log_ratio(one.values[i] - two.values[j], V + W)
