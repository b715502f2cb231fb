"""The parts of a long video joined: what they tell of tripods, lens and field then holds for all of them.

Parts are calibrated without one another (`fieldcalib.images.clip.from_video`). A tripod of a part gives its shared
parameters s, their covariance V, and how each frame's own parameters follow them (`assess.sequence_errors`). Tripods of
several parts that stand at one place (`grouped_by_tripod`) share everything, and all tripods share the pitch. Of each
tripod, linear combinations R s of its parameters are known as y with variances v, without what the prior tells, which
counts once and not in every part; a size that is not estimated tells nothing. They give all parameters u, of which
those of a tripod are s = P u, by least squares. The frames then follow to first order, since their shared parameters
move by about their errors.

A tripod that contradicts the others is left as it is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from operator import itemgetter

import numpy as np

from fieldcalib._types import Array, IntArray
from fieldcalib.assess.frame_table import ACCEPTED, IMPROBABLE, FrameTable
from fieldcalib.assess.ground import Considered
from fieldcalib.assess.sequence_calibration import SequenceCalibration
from fieldcalib.assess.sequence_errors import OwnErrors, ground_errors
from fieldcalib.assess.video import NO_TRIPOD, VideoCalibration
from fieldcalib.fields.field import Field, tolerance_of
from fieldcalib.images.clip.solved_shots import PLACE, SIZE, UNMODELLED, grouped_by_tripod
from fieldcalib.images.from_images import How
from fieldcalib.problem.layout import CROWN, GaussianPrior, Layout, gaussian_priors
from fieldcalib.solve.initial_cameras import given_cameras
from fieldcalib.solve.solver_options import CalibrationFlags

PITCH = (*SIZE, *CROWN)
LEAST_TOLD = 0.05  # share of the information on a combination that must not come from the prior
CONTRADICTED = 9.0  # mean squared deviation from the other tripods, in variances, from which one is left out
SIGMAS = 1e-6, 1e6  # least and largest standard deviation of a prior, in any unit

Key = tuple[int, str]
"""Group and name of a parameter; those of the pitch are of no group, -1."""


@dataclass(frozen=True, eq=False)
class TripodOfPart:
    """What a tripod of a part tells of the S parameters that it shares with those of other parts."""

    calibration: SequenceCalibration
    layout: Layout
    """Layout of the tripods of its group."""
    change: Array
    """Matrix from parameters in its own layout to those in that of its group, (n, n)."""
    group: int
    keys: tuple[Key, ...]
    told: frozenset[Key]
    """The parameters that it has estimated."""
    prior: GaussianPrior
    """A priori values of the parameters, (S,); of those that it has not estimated, its own ones."""
    combinations: Array
    """R, (Q, S)."""
    values: Array
    """y, (Q,)."""
    variances: Array
    """v, (Q,)."""

    @classmethod
    def of(cls, calibration: SequenceCalibration, group: int, reference: float, how: How) -> TripodOfPart:
        """Take the parameters of a tripod; `reference` is the log f at which those of its group have their lens."""
        assert calibration.layout is not None
        layout, change = calibration.layout.referred(reference)
        some = layout.considered
        names = np.array(layout.names)[some].tolist()
        s, V, prior = _shared(calibration), calibration.considered, _prior(calibration, how)
        is_told = np.isin(names, calibration.names)
        told, kept = np.flatnonzero(is_told), np.flatnonzero(~is_told)
        by_kept = V[np.ix_(told, kept)] @ np.linalg.pinv(V[np.ix_(kept, kept)])
        L = np.linalg.cholesky(V[np.ix_(told, told)] - by_kept @ V[np.ix_(kept, told)])
        share, axes = np.linalg.eigh(L.T @ (L / prior.sigma[told, None] ** 2))  # of the prior in the information
        ours = 1.0 - share > LEAST_TOLD
        A, odds = np.linalg.solve(L.T, axes[:, ours]), share[ours] / (1.0 - share[ours])
        R = np.zeros((A.shape[1], len(s)))
        R[:, told], R[:, kept] = A.T, -A.T @ by_kept
        y = R @ s + odds * (A.T @ (s - prior.mean)[told])
        sigma = np.where(is_told, prior.sigma, np.sqrt(np.diagonal(V)))
        keys = tuple((-1 if name in PITCH else group, name) for name in names)
        return cls(
            calibration,
            layout,
            change,
            group,
            keys,
            frozenset(keys[k] for k in told),
            GaussianPrior(np.where(is_told, prior.mean, s), np.clip(sigma, *SIGMAS)),
            R @ np.linalg.inv(change[np.ix_(some, some)]),
            y,
            1.0 + odds,
        )

    def off(self, s: Array) -> Array:
        """Differences of what it tells from parameters s (S,), (Q,)."""
        return np.asarray(self.values - self.combinations @ s)

    def deviation(self, s: Array, V: Array) -> float:
        """Mean squared deviation from parameters s (S,) of covariance V (S, S), in variances."""
        unmodelled = [2.0 * UNMODELLED**2 if name in (*PLACE, *SIZE) else 0.0 for _, name in self.keys]
        off = self.off(s)
        W = np.diag(self.variances) + self.combinations @ (V + np.diag(unmodelled)) @ self.combinations.T
        return float(off @ np.linalg.solve(W, off)) / max(len(off), 1)

    def on(self, s: Array, V: Array, told: frozenset[Key]) -> SequenceCalibration:
        """The calibration with other shared parameters s (S,), of covariance V (S, S); the frames follow them."""
        before, layout, frames = self.calibration, self.layout, self.calibration.frames
        some, own = np.flatnonzero(layout.considered), np.flatnonzero(layout.free)
        F = frames.following @ np.linalg.inv(self.change[np.ix_(some, some)])
        theta = frames.theta @ self.change.T
        theta[:, own] -= np.einsum("tos,ts->to", F, s - theta[:, some])
        theta[:, some] = np.where(np.isfinite(theta[:, some]), s, np.nan)
        layout, field = _on_pitch(layout, before, dict(zip(np.array(layout.names)[some].tolist(), s, strict=True)))
        has, considered = frames.has_camera, Considered(layout, V)
        metres, errors = frames.ground_error.copy(), OwnErrors(frames.own[has], F[has])
        metres[has] = ground_errors(theta[has], errors, considered, field)
        unsure = (frames.status == IMPROBABLE) & (frames.ground_error > tolerance_of(field))
        unsure[list(frames.notes)] = False  # these are improbable for another reason
        status = np.where(unsure & (metres <= tolerance_of(field)), ACCEPTED, frames.status)
        is_told = np.array([key in told for key in self.keys])
        return replace(
            before,
            frames=replace(frames, theta=theta, following=F, ground_error=metres, status=status),
            names=tuple(name for (_, name), one in zip(self.keys, is_told, strict=True) if one),
            values=s[is_told],
            covariance=V[np.ix_(is_told, is_told)],
            field=field,
            layout=layout,
            considered=V,
        ).seen_in_images(frames.markings)


def _shared(calibration: SequenceCalibration) -> Array:
    """The parameters that the layout considers, (S,): they are the same in all frames."""
    assert calibration.layout is not None
    theta = calibration.frames.theta
    return np.asarray(theta[np.argmax(np.isfinite(theta).all(axis=1)), calibration.layout.considered])


def _prior(calibration: SequenceCalibration, how: How) -> GaussianPrior:
    """The prior of the parameters that the layout considers, (S,)."""
    layout, theta = calibration.layout, calibration.frames.theta
    assert layout is not None
    options = how.task.options(layout.image_size)
    size = layout.field_size and options.layout.field_size  # around the given size, not the estimated one
    stands = gaussian_priors(options.distributions, replace(layout, field_size=size or layout.field_size))
    prior = given_cameras(theta[np.isfinite(theta).all(axis=1)][:1], stands).prior
    sigma = prior.sigma[0] if options.use_prior else np.full(layout.size, np.inf)
    return GaussianPrior(prior.mean[0, layout.considered], sigma[layout.considered])


def _on_pitch(layout: Layout, before: SequenceCalibration, s: Mapping[str, float]) -> tuple[Layout, Field | None]:
    """Layout and field of a calibration on a pitch of another size and ground, by name of the parameter."""
    field, block = before.field, layout.field_size
    if field is None or block is None:
        return layout, field
    length, width = (s.get(name, float(given)) for name, given in zip(SIZE, block.given, strict=True))
    height = s.get("crown", block.height)
    on = block._replace(given=np.array([length, width]), height=height)
    return replace(layout, field_size=on), block.resize(field, length, width, height)


@dataclass(frozen=True, eq=False)
class Together:
    """Estimates of the parameters of several tripods and of their pitch."""

    index: Mapping[Key, int]
    u: Array
    covariance: Array
    """Larger than that of independent errors by as much as the tripods differ more than these let them."""

    @classmethod
    def of(cls, tripods: Mapping[int, TripodOfPart], without: int | None = None) -> Together:
        """Estimate them, perhaps `without` what one tripod tells."""
        keys = dict.fromkeys(key for one in tripods.values() for key in one.keys)
        index, told = {key: k for k, key in enumerate(keys)}, [one.told for one in tripods.values()]
        priors = [_surest_prior([one for one in tripods.values() if key in one.keys], key) for key in keys]
        u, sigma = np.array(priors).T
        H, g = np.diag(sigma**-2.0), u * sigma**-2.0
        members = [one for number, one in tripods.items() if number != without]
        for one in members:
            some, W = [index[key] for key in one.keys], one.combinations.T / one.variances
            H[np.ix_(some, some)] += W @ one.combinations
            g[some] += W @ one.values
        # what no tripod has estimated keeps its value, and makes the others less certain
        is_told = np.array([any(key in some for some in told) for key in keys])
        a, k = np.flatnonzero(is_told), np.flatnonzero(~is_told)
        unit = np.sqrt(np.diagonal(H)[a])
        alone = np.linalg.inv(H[np.ix_(a, a)] / np.outer(unit, unit)) / np.outer(unit, unit)
        by_kept = -alone @ H[np.ix_(a, k)]
        u[a] = alone @ g[a] + by_kept @ u[k]
        found = cls(index, u, np.zeros_like(H))
        off = np.concatenate([one.off(found.of_tripod(one)[0]) / np.sqrt(one.variances) for one in members])
        V, K = found.covariance, np.diag(sigma[k] ** 2)
        V[np.ix_(a, a)] = max(1.0, float(off @ off) / max(len(off) - len(a), 1)) * alone + by_kept @ K @ by_kept.T
        V[np.ix_(a, k)], V[np.ix_(k, k)] = by_kept @ K, K
        V[np.ix_(k, a)] = V[np.ix_(a, k)].T
        return found

    def of_tripod(self, one: TripodOfPart) -> tuple[Array, Array]:
        """The parameters of a tripod, (S,), and their covariance, (S, S)."""
        some = [self.index[key] for key in one.keys]
        return self.u[some], self.covariance[np.ix_(some, some)]


def _surest_prior(tripods: Sequence[TripodOfPart], key: Key) -> tuple[float, float]:
    """Mean and standard deviation of a parameter a priori; if none has estimated it, those of the surest tripod."""
    of = [one for one in tripods if key in one.told] or tripods
    priors = ((one.prior, one.keys.index(key)) for one in of)
    return min(((float(prior.mean[k]), float(prior.sigma[k])) for prior, k in priors), key=itemgetter(1))


def joined_parts(parts: Sequence[VideoCalibration], how: How) -> VideoCalibration:
    """Join the calibrations of parts of a clip: one camera for each tripod, on one pitch."""
    video = VideoCalibration.joined(parts)
    tripods = _tripods(video, how) if len(parts) > 1 else {}
    while len(tripods) > 1:
        off = {k: one.deviation(*Together.of(tripods, k).of_tripod(one)) for k, one in tripods.items()}
        worst = max(off, key=lambda k: (off[k], k))  # tripods with more frames come first
        if off[worst] < CONTRADICTED:
            return _merged(video, tripods)
        del tripods[worst]
    return video


def _tripods(video: VideoCalibration, how: How) -> dict[int, TripodOfPart]:
    """The tripods of a clip that share parameters, in groups that stand at one place and have lenses of one kind."""
    kinds: dict[tuple[object, ...], dict[int, SequenceCalibration]] = {}
    for k, one in enumerate(video.tripods):
        if one.together and one.names and one.layout is not None and np.any(one.frames.has_camera):
            kind = one.layout.names, tuple(one.layout.roles), one.layout.image_size, type(one.layout.lens)
            kinds.setdefault(kind, {})[k] = one
    groups: list[list[int]] = []
    is_given = bool(how.task.chosen_flags & CalibrationFlags.CALIB_FIX_POSITION)
    for alike in kinds.values():
        of_one_place = [list(alike)] if is_given else grouped_by_tripod(alike)
        groups += of_one_place if how.is_on_tripod else [[k] for k in alike]
    found: dict[int, TripodOfPart] = {}
    for group, members in enumerate(groups):
        layout = video.tripods[members[0]].layout
        assert layout is not None
        reference = 0.0 if layout.zoom_law is None else layout.zoom_law.reference
        for k in members:
            with suppress(np.linalg.LinAlgError):  # of a singular covariance: nothing can be weighted by it
                found[k] = TripodOfPart.of(video.tripods[k], group, reference, how)
    return dict(sorted(found.items()))


def _merged(video: VideoCalibration, tripods: Mapping[int, TripodOfPart]) -> VideoCalibration:
    """Give the tripods their joint parameters, and make one tripod of each group."""
    together, told = Together.of(tripods), frozenset().union(*(one.told for one in tripods.values()))
    groups: dict[int, list[int]] = {}
    for k in range(len(video.tripods)):
        groups.setdefault(tripods[k].group if k in tripods else -1 - k, []).append(k)
    merged: list[tuple[IntArray, SequenceCalibration]] = []
    for members in groups.values():
        frames = [np.flatnonzero(video.tripod == k) for k in members]
        each = [
            tripods[k].on(*together.of_tripod(tripods[k]), told) if k in tripods else video.tripods[k] for k in members
        ]
        merged.append((np.concatenate(frames), _one_tripod(each)))
    merged.sort(key=lambda one: -len(one[0]))
    tripod, number = np.full(len(video), NO_TRIPOD), np.zeros(len(video), dtype=np.intp)
    calibrations = []
    for k, (index, calibration) in enumerate(merged):
        order = np.argsort(index)
        tripod[index], number[index[order]] = k, np.arange(len(index))
        calibrations.append(calibration._at(order))
    shots = tuple(shot._replace(tripod=int(tripod[shot.start])) for shot in video.shots)
    return replace(video, tripods=tuple(calibrations), tripod=tripod, number=number, shots=shots)


def _one_tripod(each: Sequence[SequenceCalibration]) -> SequenceCalibration:
    """Put the frames of calibrations with the same shared parameters together."""
    first = each[0]
    return (
        first
        if len(each) == 1
        else replace(
            first,
            frames=FrameTable.joined([one.frames for one in each]),
            together=sum(one.together for one in each),
            alternatives=np.zeros((0, 3)) if any(not len(one.alternatives) for one in each) else first.alternatives,
        )
    )
