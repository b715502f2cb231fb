"""Mislabelled segments: segments whose label the rest of their frame contradicts, and the label that would fit.

A few percent of annotated segments have a wrong label: a line of the other half, the other post, another circle. Every
camera explains each segment in the cheapest of three ways,

    the label is right      c                              c = 1/2 sum_i w_i rho(r_i^2) / noise^2 over its pixels
    another label is        c' + log((1 - e) / e) + log n  wrong with probability e, and then any of n others
    no label is             c(far) + log((1 - e) / e)      the cost of a segment that is missed by `far` pixels

with costs that are negative log-likelihoods up to a common constant. A label is not right if its segment does not
extend to the pixels, however near the infinite line is. The cost of a camera as an explanation of its frame is the sum
over the segments and the cost of the prior; the cheapest camera wins. A label is suspect if every explanation that
keeps it is much more expensive; its frame is then calibrated again with the label that fits.

Only frames are examined whose camera misses a segment by more than the cost of another label. Further cameras, each
without one of the segments, are tried only if the present one explains its frame worse than giving up a segment would.
The cameras of all such frames are solved together. Frames with more than `MOST_LABELS` labels are not examined: each
label is compared with every other one, and among so many the robust loss suffices against a few wrong ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from fieldcalib._types import Array, BoolArray, IntArray
from fieldcalib.assess.findings import SuspectLabel
from fieldcalib.assess.verdict import disagreement, implausibilities, may_blame
from fieldcalib.fields.field import Field
from fieldcalib.fields.segments import boxes
from fieldcalib.problem.evaluation import Evaluation, Problem, evaluate
from fieldcalib.problem.labelled_pixels import PixelTable
from fieldcalib.problem.layout import GaussianPrior
from fieldcalib.problem.levenberg_marquardt import levenberg_marquardt
from fieldcalib.problem.observations import Observations
from fieldcalib.solve.request import Options
from fieldcalib.solve.search import find_cameras
from fieldcalib.solve.solver_options import CERTAIN

WRONG = 0.035  # share of labels that are wrong: 3 to 4 % of SoccerNet's test annotations
LOG_ODDS = float(np.log((1.0 - WRONG) / WRONG))
OVERSHOOT = 1.0 / 40.0  # of the scale: how far annotators draw beyond the end of a segment, 1 m on a soccer field
ROUNDS = 3  # of solving without the mislabelled segments and searching for these again
ITERATIONS, TOLERANCE = 20, 1e-4  # of these solutions: good enough to compare; the last one is solved to the end
MOST_LABELS = 200  # of a frame that is examined: time and memory grow with the square; fields have fewer
PIXELS = 8  # of a segment, compared with all other labels: more pixels add nothing


@dataclass(frozen=True, eq=False)
class Relabelled:
    """T frames solved without the mislabelled segments."""

    evaluation: Evaluation
    """The frames with the labels that they were solved with: suspects are renamed, or left out if no label fits."""
    prior: GaussianPrior
    """Means and sigmas (T, n) of the stand where each camera is, even if the problem has no prior."""
    suspects: list[tuple[SuspectLabel, ...]]
    """Mislabelled segments of each frame."""

    def take(self, index: IntArray, prior: GaussianPrior) -> Relabelled:
        """Some of the frames, under other priors."""
        return Relabelled(self.evaluation.take(index), prior, [self.suspects[t] for t in index])


def without_mislabels(evaluation: Evaluation, prior: GaussianPrior, options: Options) -> Relabelled:
    """Find the mislabelled segments, and solve their frames again.

    Parameters
    ----------
    evaluation : Evaluation
        T frames, solved as if all labels were right.
    prior : GaussianPrior
        Prior of the stand that each camera belongs to, (T, n).
    options : Options
        Options with which the frames were solved.

    Returns
    -------
    Relabelled
        Frames without mislabelled segments are unchanged.

    Examples
    --------
    A goal post with the label of the other one:

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
    is_small = np.sum(evaluation.problem.observations.rank >= 0, axis=1) <= MOST_LABELS
    doubtful = np.flatnonzero(is_small & np.any(costs.of_given(evaluation) > costs.renamed, axis=1))
    if len(doubtful):
        search = _Search(costs, evaluation.take(doubtful), options)
        for t, its_suspects in zip(doubtful, search.suspects(), strict=True):
            suspects[t] = its_suspects
    index = np.flatnonzero([bool(one) for one in suspects])
    if not len(index):
        return Relabelled(evaluation, prior, suspects)

    # frames with suspects are calibrated from the beginning with the new labels
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
    """The observations with suspects under the labels that fit; those that no label fits are left out."""
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
    """Cost of renaming each label, (L,), to be added to the cost under the new label."""
    missed: float
    """Cost of a segment that no label fits."""
    low: Array
    """Least coordinates of boxes around the segments, enlarged by the annotators' overshoot, (L, 3) metres."""
    high: Array
    """Largest coordinates of these boxes, (L, 3) metres."""

    @classmethod
    def of(cls, evaluation: Evaluation, options: Options) -> _Costs:
        """The costs for the loss and the noise of a problem."""
        problem, object_segments = evaluation.problem, options.object_segments
        is_point = np.array([segment.is_point for segment in problem.observations.segments])
        others = np.where(is_point, np.sum(is_point), np.sum(~is_point)) - 1
        rho, _ = problem.loss.evaluate(np.array(options.wide_loss.scale**2))
        missed = LOG_ODDS + 0.5 * float(rho) / problem.noise**2
        reach = OVERSHOOT * problem.scale
        low, high = object_segments.boxes if isinstance(object_segments, Field) else boxes(object_segments)
        return cls(LOG_ODDS + np.log(np.maximum(others, 1)), missed, low - reach, high + reach)

    def of_given(self, evaluation: Evaluation) -> Array:
        """Costs of the given labels, (B, L); 0 for labels that a frame does not have."""
        # a segment that does not extend to the pixels costs at least as much as a missed one
        elsewhere = self.share_on_segment(evaluation) == 0.0
        costs = evaluation.problem.observations.by_label(evaluation.costs)
        costs[np.isnan(costs)] = np.inf
        return np.asarray(np.maximum(costs, elsewhere * self.missed))

    def share_on_segment(self, evaluation: Evaluation) -> Array:
        """Share of each label's pixels whose closest points are in front of the camera and on the segment, (B, L).

        Points within the box around a segment count as on it; NaN for labels without pixels.
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
    """Parameters of the cameras, (K, n)."""
    cost: Array
    """Cost of each camera, (K,); infinite if it is implausible, or cannot become the cheapest of its frame."""
    given: Array
    """Cost of each label if it is kept, (K, L)."""
    cheapest: Array
    """Cost of the cheapest explanation of each label, (K, L)."""
    fits: IntArray
    """Label of the cheapest explanation, (K, L); -1 if no label fits."""
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
    """The frames, solved as if all labels were right."""
    options: Options

    @property
    def observations(self) -> Observations:
        """The labels of the frames as given."""
        return self.evaluation.problem.observations

    def __len__(self) -> int:
        return len(self.evaluation.theta)

    @np.errstate(over="ignore", invalid="ignore")  # pixels of left-out labels may be where an extreme lens has no image
    def suspects(self) -> list[tuple[SuspectLabel, ...]]:
        """The mislabelled segments of each frame.

        The present camera decides if it explains the rest more cheaply than by giving up a segment. Otherwise it may be
        wrong altogether: then others are searched without one label at a time, if the rest suffices for a camera.
        """
        present = self._by_present_cameras()
        unexplained = []
        for t in range(len(self)):
            found = present.take(present.frame == t)
            if not np.sum(found.cheapest[np.argmin(found.cost)]) <= self.costs.missed:
                unexplained.append(t)
        every = _Explanations.joined([present, *self._by_new_cameras(unexplained)])
        return [self._suspects(t, every.take(every.frame == t)) for t in range(len(self))]

    def _by_present_cameras(self) -> _Explanations:
        """Explanations by the present cameras, and by these solved again without the labels that they give up."""
        frame = np.arange(len(self))
        first = self._explained(frame, self.evaluation, self.evaluation)
        problem = self.evaluation.problem
        believed = replace(problem, observations=problem.observations.without_labels(first.wrong))
        again = self._solved(self.evaluation.of(believed))
        return _Explanations.joined([first, self._explained(frame, again.of(problem), again)])

    def _by_new_cameras(self, unexplained: list[int]) -> list[_Explanations]:
        """Explanations of the frames `unexplained` by cameras that are searched without one of the labels."""
        labels = self.observations.labels
        left_out = [
            (t, index)
            for t in unexplained
            for index in self.observations.in_order[t]
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
        present, unknowns = self.observations.labels_in(t), self.options.unknowns
        return disagreement(present, labels, unknowns) is None and may_blame(present, labels, unknowns)

    def _refined(self, frame: IntArray, problem: Problem, theta: Array, wrong: BoolArray) -> list[_Explanations]:
        """Explanations by K cameras, solved without the labels `wrong` (K, L), then without those that they give up."""
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

        `evaluation` has all labels, `believed` only those that the cameras were solved with.
        """
        costs, observations = self.costs, evaluation.problem.observations
        given = costs.of_given(evaluation)
        wrong = implausibilities(believed, far=self.options.wide_loss.scale, field=self.options.field)
        own = np.zeros(len(given)) if evaluation.prior is None else evaluation.prior.cost.copy()
        own[np.any(list(wrong.values()), axis=0)] = np.inf

        # bounds of the final costs, whatever other labels cost: some cameras cannot become the cheapest
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

        All pixels must lie on the other segment itself, not only on its infinite line.
        """
        table, is_point = self.observations.pixels, np.array([one.is_point for one in self.observations.segments])
        pairs, which = np.unique(np.column_stack([frame, label]), axis=0, return_inverse=True)
        as_all_others = []  # frames in which the pixels of one segment have every other label
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
        """The mislabelled segments of one frame according to its best explanation."""
        labels = self.observations.labels
        best = int(np.argmin(found.cost))
        if not np.isfinite(found.cost[best]):
            return ()
        if_kept = np.min(found.cost[:, None] - found.cheapest + found.given, axis=0)
        suspect = found.wrong[best] & (if_kept > found.cost[best] + CERTAIN)
        suspects = [index for index in self.observations.in_order[t] if suspect[index]]
        if not self._can_do_without(t, [labels[index] for index in suspects]):
            return ()
        fits = {index: found.fits[best, index] for index in suspects}
        return tuple(
            SuspectLabel(labels[index], labels[fit] if fit >= 0 else None, float(found.errors[best, index]))
            for index, fit in fits.items()
        )
