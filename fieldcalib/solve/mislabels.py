"""Mislabelled segments: which segments of a frame carry a name that the others contradict, and which name would fit.

A few percent of annotated segments are called by a wrong name: a line of the other half, the other post, another
circle. Every camera explains each segment in the cheapest of three ways,

    the label is right      c                              c = 1/2 sum_i w_i rho(r_i^2) / noise^2 over its pixels
    another label is        c' + log((1 - e) / e) + log n  wrong with probability e, and then any of n others
    no label is             c(far) + log((1 - e) / e)      what a segment costs that is missed by `far` pixels

which are negative log-likelihoods up to one constant. A label whose segment is not in view where the pixels are is not
right, however close the infinite line runs. The sum over the segments, with that of the prior, is what a camera costs
as an explanation of its frame; the cheapest wins. A label is suspect if every explanation that keeps it is much more
expensive, and its frame is calibrated again under the label that fits.

Only frames are looked into whose camera misses a segment by more than another label would cost. More cameras are tried,
each without one of the segments, only where the one at hand explains its frame worse than by giving up a segment. The
cameras of all such frames are solved together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from fieldcalib._types import Array, BoolArray, IntArray
from fieldcalib.assess.result import SuspectLabel
from fieldcalib.assess.verdict import disagreement, implausibilities
from fieldcalib.fields.field import Field
from fieldcalib.fields.segments import boxes
from fieldcalib.problem.evaluation import Evaluation, Problem, evaluate
from fieldcalib.problem.levenberg_marquardt import levenberg_marquardt
from fieldcalib.problem.observations import Observations
from fieldcalib.problem.pixel_table import PixelTable
from fieldcalib.problem.prior import GaussianPrior
from fieldcalib.solve.options import CERTAIN, Options
from fieldcalib.solve.search import find_cameras

WRONG = 0.035  # share of labels that are wrong: 3 to 4 % of SoccerNet's test annotations
LOG_ODDS = float(np.log((1.0 - WRONG) / WRONG))
OVERSHOOT = 1.0 / 40.0  # of what is in view: what annotators draw beyond the end of a segment, 1 m on a soccer field
ROUNDS = 3  # of solving without the mislabelled segments and asking again which ones they are
ITERATIONS, TOLERANCE = 20, 1e-4  # of these solutions: they are compared, the last one is solved to the end
PIXELS = 8  # of a segment, compared with all other labels: densely labelled ones bring no more


@dataclass(frozen=True, eq=False)
class Relabelled:
    """T frames solved without the mislabelled segments."""

    evaluation: Evaluation
    """Under the labels that were solved with: suspects renamed, or absent if no label fits."""
    prior: GaussianPrior
    """Means and sigmas (T, n) of the stand where each camera is, also where the problem has no prior."""
    suspects: list[tuple[SuspectLabel, ...]]
    """Mislabelled segments of each frame."""

    def take(self, index: IntArray, prior: GaussianPrior) -> Relabelled:
        """Some of the frames, under other priors."""
        return Relabelled(self.evaluation.take(index), prior, [self.suspects[t] for t in index])


def without_mislabels(evaluation: Evaluation, prior: GaussianPrior, options: Options) -> Relabelled:
    """Find the mislabelled segments, and the cameras of their frames again.

    Parameters
    ----------
    evaluation : Evaluation
        T frames, solved as if all labels were right.
    prior : GaussianPrior
        Of the stand that each camera belongs to, (T, n).
    options : Options
        What the frames were solved with.

    Returns
    -------
    Relabelled
        What was given, where nothing contradicts.

    Examples
    --------
    A post of a goal under the name of the other one:

    >>> from fieldcalib import Camera, calibrate_from_segments, soccer
    >>> camera = Camera.from_angles(-0.7, 1.35, 0.0, 1600.0, (0.0, 68.0, -17.0), (960, 540))
    >>> labels = ("Side line left", "Side line top", "Big rect. left main", "Big rect. left top", "Circle left")
    >>> labels += ("Small rect. left main", "Small rect. left top", "Small rect. left bottom")
    >>> frame = {label: camera.project(soccer()[label].sample(3.0)) for label in labels}
    >>> frame["Goal left post left"] = camera.project(soccer()["Goal left post right"].sample())
    >>> calibrate_from_segments(soccer(), frame, (960, 540)).suspect_labels[0].fits
    'Goal left post right'
    """
    costs = _Costs.of(evaluation, options)
    suspects: list[tuple[SuspectLabel, ...]] = [()] * len(evaluation.theta)
    doubtful = np.flatnonzero(np.any(costs.of_given(evaluation) > costs.renamed, axis=1))
    if len(doubtful):
        search = _Search(costs, evaluation.take(doubtful), options)
        for t, its_suspects in zip(doubtful, search.suspects(), strict=True):
            suspects[t] = its_suspects
    index = np.flatnonzero([bool(one) for one in suspects])
    if not len(index):
        return Relabelled(evaluation, prior, suspects)

    # frames with suspects are calibrated from the beginning, as if they had been labelled so
    observations = _without(evaluation.problem.observations, suspects)
    found = find_cameras(observations.take(index), options)
    solution = levenberg_marquardt(
        found.evaluation, max_iterations=options.max_iterations, tolerance=options.approach_tolerance
    )
    mean, sigma, theta = prior.mean.copy(), prior.sigma.copy(), evaluation.theta.copy()
    mean[index], sigma[index], theta[index] = found.prior.mean, found.prior.sigma, solution.theta
    prior = GaussianPrior(mean, sigma)
    problem = replace(
        evaluation.problem, observations=observations, prior=None if evaluation.problem.prior is None else prior
    )
    return Relabelled(evaluate(problem, theta), prior, suspects)


def _without(observations: Observations, suspects: Sequence[Sequence[SuspectLabel]]) -> Observations:
    """The pixels of suspects under the labels that fit, without those that none fits."""
    number = {label: index for index, label in enumerate(observations.labels)} | {None: -1}
    believed = np.tile(np.arange(len(observations.labels)), (len(observations), 1))
    for t, of_frame in enumerate(suspects):
        for suspect in of_frame:
            believed[t, number[suspect.label]] = number[suspect.fits]
    return observations.relabelled(believed[observations.pixels.frame, observations.pixels.label])


@dataclass(frozen=True, eq=False)
class _Costs:
    """Costs of the explanations of an object's L labels, in units of the solver's cost."""

    renamed: Array
    """(L,) of another label, to which what its segment costs is added."""
    missed: float
    """Cost of a segment that no label fits."""
    low: Array
    """Boxes around the segments, larger by what annotators overshoot, (L, 3) metres."""
    high: Array

    @classmethod
    def of(cls, evaluation: Evaluation, options: Options) -> _Costs:
        """Costs under the loss and the noise of a problem."""
        problem, object_segments = evaluation.problem, options.object_segments
        is_point = np.array([segment.is_point for segment in problem.observations.segments])
        others = np.where(is_point, np.sum(is_point), np.sum(~is_point)) - 1
        rho, _ = problem.loss.evaluate(np.array(options.wide_loss.scale**2))
        missed = LOG_ODDS + 0.5 * float(rho) / problem.noise**2
        reach = OVERSHOOT * problem.scale
        low, high = object_segments.boxes if isinstance(object_segments, Field) else boxes(object_segments)
        return cls(LOG_ODDS + np.log(np.maximum(others, 1)), missed, low - reach, high + reach)

    def of_given(self, evaluation: Evaluation) -> Array:
        """Costs of the labels as they were given, (B, L); 0 for labels that a frame does not have."""
        # a segment that is elsewhere has no pixel here: at least as bad as one that is missed
        elsewhere = self.share_on_segment(evaluation) == 0.0
        costs = evaluation.problem.observations.by_label(evaluation.costs)
        costs[np.isnan(costs)] = np.inf
        return np.asarray(np.maximum(costs, elsewhere * self.missed))

    def share_on_segment(self, evaluation: Evaluation) -> Array:
        """Share of each label's pixels whose closest points are in front of the camera and on the segment, (B, L).

        On the segment is what lies within the box around it; NaN for labels without pixels.
        """
        observations = evaluation.problem.observations
        X, label = evaluation.world_points, observations.label
        on_segment = np.all((self.low[label] <= X) & (self.high[label] >= X), axis=-1)
        on_segment &= evaluation.points.inverse_depth > 0.0
        with np.errstate(invalid="ignore"):
            return observations.by_label(on_segment.astype(float)) / observations.by_label(np.ones(label.shape))


@dataclass(frozen=True, eq=False)
class _Explanations:
    """K cameras that explain frames with L labels."""

    frame: IntArray
    """Frame that each camera explains, (K,)."""
    theta: Array
    """(K, n)."""
    cost: Array
    """(K,); infinite if the camera is implausible, or if it cannot become the cheapest of its frame."""
    given: Array
    """Cost of each label if it is kept, (K, L)."""
    cheapest: Array
    """Cost of the cheapest explanation of each label, (K, L)."""
    fits: IntArray
    """(K, L) label of the cheapest explanation, -1 if that is none."""
    errors: Array
    """Root mean square distance to the segment of the given label, (K, L) pixels."""

    @property
    def wrong(self) -> BoolArray:
        """Mask (K, L) of the labels that are not kept."""
        return np.asarray(self.cheapest < self.given)

    def take(self, index: IntArray | BoolArray) -> _Explanations:
        return _Explanations(*(getattr(self, name.name)[index] for name in fields(self)))

    @staticmethod
    def joined(parts: Sequence[_Explanations]) -> _Explanations:
        names = [name.name for name in fields(_Explanations)]
        return _Explanations(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


@dataclass(frozen=True, eq=False)
class _Search:
    """The explanations of doubtful frames."""

    costs: _Costs
    evaluation: Evaluation
    """The frames solved as if all labels were right."""
    options: Options

    @property
    def observations(self) -> Observations:
        """The labels of the frames as given."""
        return self.evaluation.problem.observations

    def __len__(self) -> int:
        return len(self.evaluation.theta)

    @np.errstate(over="ignore", invalid="ignore")  # labels that were left out may be where an absurd lens has no images
    def suspects(self) -> list[tuple[SuspectLabel, ...]]:
        """The mislabelled segments of each frame.

        By the camera at hand, if that explains the rest well: cheaper than to give up a segment. Otherwise it may be
        the wrong camera altogether: then others are searched for, without each label in turn that the rest can do
        without.
        """
        at_hand = self._at_hand()
        needy = []
        for t in range(len(self)):
            found = at_hand.take(at_hand.frame == t)
            if not np.sum(found.cheapest[np.argmin(found.cost)]) <= self.costs.missed:
                needy.append(t)
        every = _Explanations.joined([at_hand, *self._from_anew(needy)])
        return [self._suspects(t, every.take(every.frame == t)) for t in range(len(self))]

    def _at_hand(self) -> _Explanations:
        """Explanations by the cameras at hand, and by the same solved without the labels that these give up."""
        frame = np.arange(len(self))
        first = self._explained(frame, self.evaluation, self.evaluation)
        problem = self.evaluation.problem
        believed = replace(problem, observations=problem.observations.without_labels(first.wrong))
        again = self._solved(self.evaluation.of(believed))
        return _Explanations.joined([first, self._explained(frame, again.of(problem), again)])

    def _from_anew(self, needy: list[int]) -> list[_Explanations]:
        """Explanations of `needy` frames by cameras that are searched without one of their labels."""
        labels = self.observations.labels
        left_out = [
            (t, index)
            for t in needy
            for index in self.observations.in_order(t)
            if self._can_do_without(t, [labels[index]])
        ]
        if not left_out:
            return []
        frame, label = np.array(left_out).T
        wrong = np.zeros((len(frame), len(labels)), dtype=bool)
        wrong[np.arange(len(frame)), label] = True
        problem = self.evaluation.problem.take(frame)
        found = find_cameras(problem.observations.without_labels(wrong), self.options)
        prior = None if problem.prior is None else found.prior
        return self._refined(frame, replace(problem, prior=prior), found.evaluation.theta, wrong)

    def _can_do_without(self, t: int, labels: Sequence[str]) -> bool:
        """Whether the other labels of frame t are enough for a camera."""
        return disagreement(self.observations.labels_in(t), labels, self.options.unknowns) is None

    def _refined(self, frame: IntArray, problem: Problem, theta: Array, wrong: BoolArray) -> list[_Explanations]:
        """Explanations by K cameras, solved without labels `wrong` (K, L), then without those that these give up."""
        finished = []
        for turn in range(ROUNDS):
            # the lens comes second: a free lens would absorb mislabelled segments
            layout = problem.layout.fixed("lens", "principal point", "aspect") if turn == 0 else problem.layout
            believed = replace(problem, observations=problem.observations.without_labels(wrong), layout=layout)
            again = self._solved(evaluate(believed, theta)).of(replace(believed, layout=problem.layout))
            found = self._explained(frame, again.of(problem), again)
            possible = np.isfinite(found.cost)
            settled = np.all(found.wrong == wrong, axis=1) if turn > 0 else np.zeros(len(frame), dtype=bool)
            going_on = possible & ~settled & (turn < ROUNDS - 1)
            finished.append(found.take(~going_on))
            if not np.any(going_on):
                break
            kept = np.flatnonzero(going_on)
            frame, problem, theta, wrong = frame[kept], problem.take(kept), found.theta[kept], found.wrong[kept]
        return finished

    def _solved(self, start: Evaluation) -> Evaluation:
        return levenberg_marquardt(start, max_iterations=ITERATIONS, tolerance=TOLERANCE).evaluation

    def _explained(self, frame: IntArray, evaluation: Evaluation, believed: Evaluation) -> _Explanations:
        """The cheapest explanation of every segment by each of K cameras of some frames.

        `evaluation` has all labels, `believed` at the same cameras those that they were solved with.
        """
        costs, observations = self.costs, evaluation.problem.observations
        given = costs.of_given(evaluation)
        wrong = implausibilities(believed, far=self.options.wide_loss.scale, field=self.options.field)
        own = evaluation.prior_cost.copy()
        own[np.any(list(wrong.values()), axis=0)] = np.inf

        # between these bounds the explanations end, whatever other labels cost: some cannot become the cheapest
        least = own + np.sum(np.minimum(given, costs.renamed), axis=1)
        most = np.full(len(self), np.inf)
        np.minimum.at(most, frame, own + np.sum(np.minimum(given, costs.missed), axis=1))
        kept = least <= most[frame] + CERTAIN
        cheapest, fits = np.minimum(given, costs.missed), np.full(given.shape, -1)
        k, label = np.nonzero((given > costs.renamed) & kept[:, None])
        if len(k):
            other, name = self._other_labels(frame[k], evaluation.take(k), label)
            weight = observations.by_label(observations.weight)[k, label]
            other = weight * other + costs.renamed[label]
            cheaper = other < cheapest[k, label]
            k, label = k[cheaper], label[cheaper]
            cheapest[k, label], fits[k, label] = other[cheaper], name[cheaper]
        cost = np.where(kept, own + np.sum(cheapest, axis=1), np.inf)
        with np.errstate(invalid="ignore"):
            errors = np.sqrt(observations.by_label(np.square(evaluation.r)) / observations.pixels_by_label)
        return _Explanations(frame, evaluation.theta, cost, given, cheapest, fits, errors)

    def _other_labels(self, frame: IntArray, evaluation: Evaluation, label: IntArray) -> tuple[Array, IntArray]:
        """The cheapest other label for pixels of `label` (P,) under P cameras: its cost, infinite if none, and index.

        All pixels must lie on the other segment itself, not only on the line that prolongs it.
        """
        table, is_point = self.observations.pixels, np.array([one.is_point for one in self.observations.segments])
        pairs, which = np.unique(np.column_stack([frame, label]), axis=0, return_inverse=True)
        as_all_others = []  # frames in which the pixels of one segment carry every other label
        for t, index in pairs:
            own = np.flatnonzero((table.frame == t) & (table.label == index))
            some = own[np.linspace(0, len(own) - 1, min(len(own), PIXELS)).round().astype(int)]
            others = np.flatnonzero(is_point == is_point[index])
            others = np.repeat(others[others != index], len(some))
            xy = np.tile(table.xy[some], (len(others) // len(some), 1))
            weight = np.full(len(others), 1.0 / len(some))
            as_all_others.append(PixelTable(table.labels, 1, np.zeros(len(others), np.intp), others, xy, weight))
        packed = self.observations.with_pixels(PixelTable.joined(table.labels, as_all_others))
        problem = replace(evaluation.problem, observations=packed.take(which.ravel()))
        relabelled = evaluate(problem, evaluation.theta)
        cost = problem.observations.by_label(relabelled.costs)
        cost[self.costs.share_on_segment(relabelled) != 1.0] = np.inf  # NaN for the given label
        best = np.argmin(cost, axis=1)
        return cost[np.arange(len(best)), best], best

    def _suspects(self, t: int, found: _Explanations) -> tuple[SuspectLabel, ...]:
        """The mislabelled segments of one frame by its best explanation."""
        labels = self.observations.labels
        best = int(np.argmin(found.cost))
        if not np.isfinite(found.cost[best]):
            return ()
        if_kept = np.min(found.cost[:, None] - found.cheapest + found.given, axis=0)
        suspect = found.wrong[best] & (if_kept > found.cost[best] + CERTAIN)
        suspects = [index for index in self.observations.in_order(t) if suspect[index]]
        if not self._can_do_without(t, [labels[index] for index in suspects]):
            return ()
        fits = {index: found.fits[best, index] for index in suspects}
        return tuple(
            SuspectLabel(labels[index], labels[fit] if fit >= 0 else None, float(found.errors[best, index]))
            for index, fit in fits.items()
        )
