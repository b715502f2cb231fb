"""Labels that lie: which segments of a frame carry a name that the others contradict, and which name would fit.

A few percent of annotated segments are called by a wrong name: a line of the other half, the other post, another
circle. Every camera explains each segment in the cheapest of three ways,

    the label is right      c                              c = 1/2 sum_i w_i rho(r_i^2) / noise^2 over its pixels
    another label is        c' + log((1 - e) / e) + log n  wrong with probability e, and then any of n others
    no label is             c(far) + log((1 - e) / e)      what a segment costs that is missed by `far` pixels

which are negative log-likelihoods up to one constant. A label whose segment is not in view where the pixels are is not
right, however close the infinite line runs. The sum over the segments, with that of the prior, is what a camera costs
as an explanation of its frame; the cheapest wins. A label is accused if every explanation that believes it is much
dearer, and its frame is calibrated again under the label that fits.

Only frames are looked into whose camera misses a segment by more than another label would cost. More cameras are tried,
each without one of the segments, only where the one at hand explains its frame worse than by giving up a segment.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import TypeAlias

import numpy as np

from fieldcalib._types import Array, BoolArray, IntArray
from fieldcalib.assess.result import SuspectLabel
from fieldcalib.assess.verdict import disagreement, implausibilities, segment_errors
from fieldcalib.fields.field import Field
from fieldcalib.fields.segments import ObjectSegments, Point
from fieldcalib.problem.labelled_pixels import Pixels, Shares
from fieldcalib.problem.observations import LEAST_DEPTH, Observations, pack
from fieldcalib.problem.parameters import GaussianPrior
from fieldcalib.problem.residuals import Feet, foot_points, world_points
from fieldcalib.problem.solver import IS_LENS, Finish, Problem, Solution, solve_batch

WRONG = 0.035  # share of labels that are wrong: 3 to 4 % of SoccerNet's test annotations
LOG_ODDS = float(np.log((1.0 - WRONG) / WRONG))
CERTAIN = float(np.log(20.0))  # of 20 accusations 19 shall be right
REACH = 1.0 / 40.0  # of what is in view: what annotators draw beyond the end of a segment, 1 m on a soccer field
TURNS = 3  # of solving without the labels that lie and asking again which ones do
ITERATIONS, TOLERANCE = 20, 1e-4  # of these solutions: they are compared, the last one is solved to the end
PIXELS = 8  # of a segment, compared with all other labels: densely labelled ones bring no more

Search: TypeAlias = Callable[[Observations], tuple[Array, GaussianPrior]]


@dataclass(frozen=True)
class Resolution:
    """T frames solved without the labels that lie."""

    frames: list[Pixels]
    """The pixels under the labels that they were solved with: suspects renamed, or absent if no label fits."""
    problem: Problem
    """What was solved: `frames`, each with the prior of the stand where its camera is."""
    solution: Solution
    prior: GaussianPrior
    """Means and sigmas (T, 12), also where `problem` has no prior."""
    suspects: list[tuple[SuspectLabel, ...]]
    """Of each frame, in the order of its labels."""


def resolve_labels(
    object_segments: ObjectSegments,
    frames: list[Pixels],
    shares: list[Shares | None],
    problem: Problem,
    solution: Solution,
    prior: GaussianPrior,
    far: float,
    search: Search,
    finish: Finish,
) -> Resolution:
    """Find the labels that lie and solve their frames again.

    Parameters
    ----------
    object_segments : mapping of str to segment
        The calibration object.
    frames : list of T dicts of str to (N, 2) array
        Pixels by label.
    shares : list of T dicts of str to (N,) array, or None
        What they weigh, as for `pack`.
    problem, solution : Problem, Solution
        The frames packed, and solved as if all labels were right.
    prior : GaussianPrior
        Of the stand that each camera belongs to, (T, 12).
    far : float
        Pixels beyond which a segment counts as missed.
    search : callable
        Best start for each of some observations, and the prior of its stand.
    finish : callable
        Solves a problem from such starts to the end.

    Returns
    -------
    Resolution
        What was given, where nothing contradicts.

    Examples
    --------
    A post of a goal under the name of the other one:

    >>> from fieldcalib import Camera, soccer
    >>> from fieldcalib.problem.losses import RobustLoss
    >>> from fieldcalib.fields.stands import MAIN_CENTER
    >>> from fieldcalib.problem.parameters import gaussian_prior, theta_from_camera
    >>> camera = Camera.from_angles(-0.7, 1.35, 0.0, 1600.0, (0.0, 68.0, -17.0), (960, 540))
    >>> labels = ("Side line left", "Side line top", "Big rect. left main", "Big rect. left top", "Circle left")
    >>> labels += ("Small rect. left main", "Small rect. left top", "Small rect. left bottom")
    >>> frame = {label: camera.project(soccer()[label].sample(3.0)) for label in labels}
    >>> frame["Goal left post left"] = camera.project(soccer()["Goal left post right"].sample())
    >>> theta, prior = theta_from_camera(camera)[None], gaussian_prior(MAIN_CENTER, (960, 540))
    >>> prior = GaussianPrior(prior.mean[None], prior.sigma[None])
    >>> problem = Problem(pack(soccer(), [frame], (960, 540)), np.arange(12) < 7, RobustLoss("cauchy", 6.0))
    >>> def finish(problem, theta):
    ...     return solve_batch(problem, theta, max_iterations=50, tolerance=1e-8)
    >>> def search(observations):
    ...     same = np.zeros(len(observations), dtype=int)
    ...     return theta[same], prior.take(same)
    >>> solution = finish(problem, theta)
    >>> resolution = resolve_labels(soccer(), [frame], [None], problem, solution, prior, 20.0, search, finish)
    >>> resolution.suspects[0][0].fits
    'Goal left post right'
    """
    prices = _Prices.of(object_segments, problem, far)
    doubtful = np.flatnonzero(np.any(prices.of_given(problem, solution.theta) > prices.renamed, axis=1))
    suspects: list[tuple[SuspectLabel, ...]] = [()] * len(frames)
    for t, found in zip(doubtful, _at_hand(prices, frames, problem, solution.theta, doubtful), strict=True):
        suspects[t] = _suspects(prices, frames[t], problem.take(np.array([t])), found, search)
    index = np.flatnonzero([bool(lying) for lying in suspects])
    if not len(index):
        return Resolution(frames, problem, solution, prior, suspects)

    # what is accused is calibrated from the beginning, as if it had been labelled so
    believed = [renamed(frame, lying) for frame, lying in zip(frames, suspects, strict=True)]
    their_shares = [share and renamed(share, lying) for share, lying in zip(shares, suspects, strict=True)]
    observations = pack(object_segments, believed, problem.observations.image_size, their_shares)
    start, priors = search(observations.take(index))
    mean, sigma = prior.mean.copy(), prior.sigma.copy()
    mean[index], sigma[index] = priors.mean, priors.sigma
    prior = GaussianPrior(mean, sigma)
    problem = replace(problem, observations=observations, prior=problem.prior and prior)
    again = finish(problem.take(index), start)
    return Resolution(believed, problem, solution.replaced(index, again), prior, suspects)


def renamed(frame: Pixels, suspects: Sequence[SuspectLabel]) -> Pixels:
    """A frame, or the weights of its pixels, under the labels that fit, without what none fits.

    Examples
    --------
    >>> renamed({"a": np.zeros((1, 2)), "b": np.ones((2, 2))}, [SuspectLabel("b", "a", 50.0)])["a"].shape
    (3, 2)
    """
    fits = {suspect.label: suspect.fits for suspect in suspects}
    parts: dict[str, list[Array]] = {}
    for given, xy in frame.items():
        label = fits.get(given, given)
        if label is not None:
            parts.setdefault(label, []).append(xy)
    return {label: np.concatenate(xy) for label, xy in parts.items()}


@dataclass(frozen=True)
class _Prices:
    """What the explanations of an object's L labels cost, in units of the solver's cost."""

    object_segments: ObjectSegments
    far: float
    renamed: Array
    """(L,) of another label, to which what its segment costs is added."""
    missed: float
    """Of no label."""

    @classmethod
    def of(cls, object_segments: ObjectSegments, problem: Problem, far: float) -> _Prices:
        """Prices under the loss and the noise of a problem."""
        is_point = np.array([isinstance(segment, Point) for segment in object_segments.values()])
        others = np.where(is_point, np.sum(is_point), np.sum(~is_point)) - 1
        rho, _ = problem.loss.evaluate(np.array(far**2))
        missed = LOG_ODDS + 0.5 * float(rho) / problem.noise**2
        return cls(object_segments, far, LOG_ODDS + np.log(np.maximum(others, 1)), missed)

    def of_given(self, problem: Problem, theta: Array) -> Array:
        """Costs of the labels as they were given, (B, L); 0 for labels that a frame does not have."""
        feet = foot_points(theta, problem.observations)
        # a segment that is elsewhere has no pixel here: at least as bad as one that is missed
        elsewhere = _share_on_segment(self.object_segments, theta, feet, problem) == 0.0
        return np.asarray(np.maximum(_costs(feet, problem), elsewhere * self.missed))


@dataclass(frozen=True)
class _Explanations:
    """K cameras that explain one frame with L labels."""

    theta: Array
    """(K, 12)."""
    cost: Array
    """(K,); infinite for what is no camera, or is too dear to matter."""
    given: Array
    """(K, L) if the label is believed."""
    cheapest: Array
    """(K, L)."""
    fits: IntArray
    """(K, L) label of the cheapest explanation, -1 if that is none."""

    @property
    def lies(self) -> BoolArray:
        """Which labels are not believed, (K, L)."""
        return np.asarray(self.cheapest < self.given)


def _at_hand(
    prices: _Prices, frames: list[Pixels], problem: Problem, theta: Array, doubtful: IntArray
) -> list[_Explanations]:
    """What the cameras at hand say of each doubtful frame, and say again when solved without what they say lies."""
    if not len(doubtful):
        return []
    alone = [problem.take(np.array([t])) for t in doubtful]
    found = [
        _explain(prices, frames[t], one, one.observations, theta[[t]]) for t, one in zip(doubtful, alone, strict=True)
    ]
    lies = np.concatenate([explanations.lies for explanations in found])
    whole = problem.take(doubtful)
    believed = replace(whole, observations=_without(whole.observations, lies))
    again = solve_batch(believed, theta[doubtful], max_iterations=ITERATIONS, tolerance=TOLERANCE).theta
    return [
        _joined(explanations, _explain(prices, frames[t], one, one.observations, again[[i]]))
        for i, (t, one, explanations) in enumerate(zip(doubtful, alone, found, strict=True))
    ]


def _suspects(
    prices: _Prices, frame: Pixels, problem: Problem, found: _Explanations, search: Search
) -> tuple[SuspectLabel, ...]:
    """The labels of one doubtful frame that lie, as is `found` by the camera at hand if that explains the rest well.

    Well means cheaper than to give up a segment. Otherwise it may be the wrong camera altogether: then others are
    searched for, without each label in turn that the rest can do without.
    """
    observations, unknowns = problem.observations, int(np.sum(problem.free & ~(IS_LENS & (problem.prior is not None))))
    number = {label: index for index, label in enumerate(observations.labels)}
    if not np.sum(found.cheapest[np.argmin(found.cost)]) <= prices.missed:
        spared = [
            number[label] for label in frame if disagreement(prices.object_segments, frame, [label], unknowns) is None
        ]
        if spared:
            lies = np.zeros((len(spared), len(number)), dtype=bool)
            lies[np.arange(len(spared)), spared] = True
            every = problem.take(np.zeros(len(spared), dtype=np.intp))
            theta, prior = search(_without(every.observations, lies))
            every = replace(every, prior=problem.prior and prior)
            found = _joined(found, _refined(prices, frame, every, theta, lies))
    best = int(np.argmin(found.cost))
    if not np.isfinite(found.cost[best]):
        return ()
    if_believed = np.min(found.cost[:, None] - found.cheapest + found.given, axis=0)
    accused = found.lies[best] & (if_believed > found.cost[best] + CERTAIN)
    names = [label for label in frame if accused[number[label]]]
    if disagreement(prices.object_segments, frame, names, unknowns) is not None:
        return ()
    ((errors, _),) = segment_errors(foot_points(found.theta[[best]], observations).r, observations, [frame])
    fits = {label: found.fits[best, number[label]] for label in names}
    return tuple(
        SuspectLabel(label, observations.labels[fit] if fit >= 0 else None, errors[label])
        for label, fit in fits.items()
    )


def _joined(*found: _Explanations) -> _Explanations:
    return _Explanations(*(np.concatenate([getattr(e, f.name) for e in found]) for f in fields(_Explanations)))


def _refined(prices: _Prices, frame: Pixels, problem: Problem, theta: Array, lies: BoolArray) -> _Explanations:
    """Explanations of one frame by K cameras that are solved without the labels `lies` (K, L), then without theirs."""
    for turn in range(TURNS):
        # the lens comes second: it would bend itself around what lies
        free = problem.free & ~IS_LENS if turn == 0 else problem.free
        believed = replace(problem, observations=_without(problem.observations, lies), free=free)
        theta = solve_batch(believed, theta, max_iterations=ITERATIONS, tolerance=TOLERANCE).theta
        found = _explain(prices, frame, problem, believed.observations, theta)
        kept = np.flatnonzero(np.isfinite(found.cost))
        if not len(kept) or (turn > 0 and np.array_equal(found.lies, lies)):
            break
        problem, theta, lies = problem.take(kept), theta[kept], found.lies[kept]
    return found


def _explain(prices: _Prices, frame: Pixels, problem: Problem, believed: Observations, theta: Array) -> _Explanations:
    """The cheapest explanation of every segment by each of K cameras."""
    given = prices.of_given(problem, theta)
    feet = foot_points(theta, believed)
    field = prices.object_segments if isinstance(prices.object_segments, Field) else None
    wrong = implausibilities(theta, feet, believed, far=prices.far, field=field)
    z = problem.prior_residuals(theta)
    own = 0.5 * np.sum(problem.prior_costs(np.square(z))[0], axis=1) if z.shape[1] else np.zeros(len(theta))
    own[np.any(list(wrong.values()), axis=0)] = np.inf

    # between these bounds the explanations end, whatever other labels cost: some are too dear to matter
    least = own + np.sum(np.minimum(given, prices.renamed), axis=1)
    most = own + np.sum(np.minimum(given, prices.missed), axis=1)
    matters = least <= np.min(most) + CERTAIN
    cheapest, fits = np.minimum(given, prices.missed), np.full(given.shape, -1)
    k, label = np.nonzero((given > prices.renamed) & matters[:, None])
    if len(k):
        other, name = _other_labels(prices, frame, problem, theta[k], label)
        weight = _by_label(np.ones_like(feet.r), problem.observations)[k, label]
        other = weight * other + prices.renamed[label]
        cheaper = other < cheapest[k, label]
        k, label = k[cheaper], label[cheaper]
        cheapest[k, label], fits[k, label] = other[cheaper], name[cheaper]
    cost = np.where(matters, own + np.sum(cheapest, axis=1), np.inf)
    return _Explanations(theta, cost, given, cheapest, fits)


def _other_labels(
    prices: _Prices, frame: Pixels, problem: Problem, theta: Array, label: IntArray
) -> tuple[Array, IntArray]:
    """The cheapest other label for the pixels of `label` (P,) under P cameras: its cost, infinite if none, and index.

    All pixels must lie on the other segment itself, not only on the line that prolongs it.
    """
    object_segments, labels = prices.object_segments, problem.observations.labels
    given, which = np.unique(label, return_inverse=True)
    as_all_others = []  # frames in which the pixels of one segment carry every other label
    for name in (labels[index] for index in given):
        xy = frame[name][np.linspace(0, len(frame[name]) - 1, min(len(frame[name]), PIXELS)).round().astype(int)]
        kind = isinstance(object_segments[name], Point)
        others = (a for a in labels if a != name and isinstance(object_segments[a], Point) == kind)
        as_all_others.append(dict.fromkeys(others, xy))
    packed = pack(object_segments, as_all_others, problem.observations.image_size).take(which)
    feet = foot_points(theta, packed)
    relabelled = replace(problem, observations=packed)
    cost = _costs(feet, relabelled)
    cost[_share_on_segment(object_segments, theta, feet, relabelled) != 1.0] = np.inf  # NaN for the given label
    best = np.argmin(cost, axis=1)
    return cost[np.arange(len(best)), best], best


def _share_on_segment(object_segments: ObjectSegments, theta: Array, feet: Feet, problem: Problem) -> Array:
    """Share of each label's pixels whose foot points are in front of the camera and on the segment, (B, L).

    On the segment is what lies within the box around it, larger by `REACH`; NaN for labels without pixels.
    """
    observations, reach = problem.observations, REACH * problem.scale
    label = observations.label
    low, high = np.full((2, len(observations.labels), 3), np.nan)
    for index in np.unique(label[label >= 0]):
        X = object_segments[observations.labels[index]].sample()
        low[index], high[index] = X.min(axis=0) - reach, X.max(axis=0) + reach
    X = world_points(theta, feet)
    on_segment = np.all((low[label] <= X) & (high[label] >= X), axis=-1) & (feet.inverse_depth > 0.0)
    count = _by_label(on_segment.astype(float), observations, weigh=False)
    with np.errstate(invalid="ignore"):
        return count / _by_label(np.ones(label.shape), observations, weigh=False)


def _costs(feet: Feet, problem: Problem) -> Array:
    """The data part of the solver's cost by label, (B, L)."""
    rho, _ = problem.loss.evaluate(np.square(feet.r))
    return 0.5 * _by_label(rho, problem.observations) / problem.noise**2


def _by_label(values: Array, observations: Observations, *, weigh: bool = True) -> Array:
    """Weighted sums of values (B, M) over the residuals of each label, (B, L)."""
    B, L = len(observations), len(observations.labels)
    seen = observations.label >= 0
    index = (observations.label + L * np.arange(B)[:, None])[seen]
    weighted = (values * observations.weight)[seen] if weigh else values[seen]
    return np.asarray(np.bincount(index, weighted, minlength=B * L), dtype=float).reshape(B, L)


def _without(observations: Observations, lies: BoolArray) -> Observations:
    """Observations in which the labels `lies` (B, L) weigh nothing."""
    frame = np.arange(len(observations))[:, None]
    kinds = {}
    for kind in LEAST_DEPTH:
        rows = getattr(observations, kind)
        kinds[kind] = replace(rows, weight=np.where(lies[frame, rows.label], 0.0, rows.weight))
    return replace(observations, **kinds)
