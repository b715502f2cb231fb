"""What ties the frames of one tripod to each other: matches of static points, thinned out to a few for each pair.

Matches next to each other err alike, as optical flow, lens and depth do. So the picture is divided into cells, those of
one cell are averaged, and each cell counts as one observation.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib._types import Array, BoolArray, IntArray
from fieldcalib.fields.field import Field
from fieldcalib.fields.segments import ObjectSegments
from fieldcalib.problem.background import BackgroundEvaluation, BackgroundPairs
from fieldcalib.problem.evaluation import Problem, evaluate
from fieldcalib.problem.layout import PRINCIPAL_POINT, Layout
from fieldcalib.problem.levenberg_marquardt import levenberg_marquardt
from fieldcalib.problem.losses import RobustLoss
from fieldcalib.problem.observations import pack
from fieldcalib.problem.prior import GaussianPrior
from fieldcalib.solve.options import pixel_unit

# Lengths are in pixels of a 960 x 540 image and grow with the image.
CELLS = (10, 6)  # across and down the picture
NOISE = 0.75  # px: standard deviation of a coordinate of a cell: flow errs by 0.1 to 0.3, the law of the lens by more
LOSS_SCALE = 2.5  # px: cells that are farther off are no background
DISAGREE = 6.0  # px: median distance at which the cameras of two frames contradict what ties them
BEHIND_LINES = 10.0  # m from the lines of a field to the boards and stands around it
LEAST_CELLS = 5  # that make a tie
APPROACHED = 1e-3  # of the cost: cameras that are tied are where others begin
MOST_ITERATIONS = 50
POINT_MOVES = 0.1  # of width and height: so far a window goes from a frame to one that is tied to it
DAMPING = 1e-4  # share of the diagonal
FROM_AFAR = RobustLoss("linear", 1.0)  # frames that are tied may be far apart: a loss that bends has no gradient there

Matched = Mapping[tuple[int, int], tuple[ArrayLike, ArrayLike] | None]


@dataclass(frozen=True, eq=False)
class Ties:
    """K pairs of frames, with the pixels of static points in both, padded to N points each."""

    count: int
    """T, of all frames."""
    first: IntArray
    """(K,)"""
    second: IntArray
    """(K,)"""
    p: Array
    """Pixels in the first frame, (K, N, 2)."""
    q: Array
    """Pixels in the second frame, (K, N, 2)."""
    weight: Array
    """One over the variance of a coordinate, (K, N); 0 where there is only padding."""
    loss: RobustLoss
    walls: Array | None
    """Half the length and width of what stands around the ground, metres; None for nothing."""

    @classmethod
    def of(cls, object_segments: ObjectSegments, matches: Matched, count: int, image_size: tuple[int, int]) -> Ties:
        """Of matches between some of `count` frames, a mapping of pairs of frames to their pixels.

        Raises
        ------
        ValueError
            If a frame does not exist, is matched with itself, or the pixels are no two arrays of one shape.
        """
        if not isinstance(matches, Mapping):
            raise ValueError(f"matches must be a mapping of pairs of frames to pixels, got {type(matches).__name__}")
        unit, kept = pixel_unit(image_size), []
        for (i, j), both in matches.items():
            if not (0 <= i < count and 0 <= j < count) or i == j:
                raise ValueError(f"matches are between two of {count} frames, from 0 on; got those of {i} and {j}")
            if both is None:
                continue
            p, q = (np.asarray(xy, dtype=float) for xy in both)
            if p.shape != q.shape or p.ndim != 2 or p.shape[1] != 2 or not np.isfinite([p, q]).all():
                raise ValueError(
                    f"matches of frames {i} and {j}: expected two arrays of finite pixels, of the same shape (N, 2), "
                    f"got {p.shape} and {q.shape}"
                )
            p, q = thinned(p, q, image_size)
            if len(p) >= LEAST_CELLS:
                kept.append((i, j, p, q))
        N = max((len(p) for *_, p, _ in kept), default=0)
        pixels, weights = np.zeros((2, len(kept), N, 2)), np.zeros((len(kept), N))
        pixels[:] = np.divide(image_size, 2.0)  # padding must stay finite
        for k, (_, _, p, q) in enumerate(kept):
            pixels[0, k, : len(p)], pixels[1, k, : len(p)], weights[k, : len(p)] = p, q, 1.0 / (NOISE * unit) ** 2
        first, second = np.array([(i, j) for i, j, *_ in kept], dtype=np.intp).reshape(-1, 2).T
        walls = None
        if isinstance(object_segments, Field):
            walls = np.array([object_segments.length, object_segments.width]) / 2.0 + BEHIND_LINES
        return cls(count, first, second, pixels[0], pixels[1], weights, RobustLoss("cauchy", LOSS_SCALE * unit), walls)

    def __len__(self) -> int:
        return len(self.first)

    @property
    def some_tie(self) -> BoolArray:
        """Which frames (T,) are in a pair."""
        found = np.zeros(self.count, dtype=bool)
        found[self.first] = found[self.second] = True
        return found

    def among(self, frames: IntArray) -> BackgroundPairs | None:
        """Those between some frames, which are numbered anew; None if there are none."""
        number = np.full(self.count, -1)
        number[frames] = np.arange(len(frames))
        inside = (number[self.first] >= 0) & (number[self.second] >= 0)
        if not np.any(inside):
            return None
        return BackgroundPairs(
            number[self.first[inside]],
            number[self.second[inside]],
            self.p[inside],
            self.q[inside],
            self.weight[inside],
            self.loss,
            self.walls,
        )

    def towards(self, frames: IntArray, theta: Array, known: BoolArray) -> tuple[BackgroundPairs, IntArray]:
        """Those from frames whose cameras theta (T, n) are `known` (T,) to some others, and the known ones' numbers."""
        number = np.full(len(theta), -1)
        number[frames] = np.arange(len(frames))
        ahead = known[self.first] & (number[self.second] >= 0)
        back = known[self.second] & (number[self.first] >= 0)
        first = np.concatenate([self.first[ahead], self.second[back]])
        pairs = BackgroundPairs(
            first,
            np.concatenate([number[self.second[ahead]], number[self.first[back]]]),
            np.concatenate([self.p[ahead], self.q[back]]),
            np.concatenate([self.q[ahead], self.p[back]]),
            np.concatenate([self.weight[ahead], self.weight[back]]),
            self.loss,
            self.walls,
            theta[first],
        )
        return pairs, first

    def reached(self, known: BoolArray, left_out: BoolArray) -> IntArray:
        """The frames that are tied to a known one (T,), not known themselves and not left out (T,)."""
        found = np.zeros_like(known)
        found[self.second[known[self.first]]] = True
        found[self.first[known[self.second]]] = True
        return np.flatnonzero(found & ~known & ~left_out)

    def agreeing(self, theta: Array, known: BoolArray, layout: Layout) -> BoolArray:
        """The frames (T,) with known cameras, without those that most of their ties contradict.

        The one with the most contradictions is left out, again and again.
        """
        kept, frames = known.copy(), np.arange(len(known))
        pairs = self.among(frames[known])
        if pairs is None:
            return kept
        contradicts = disagreeing(BackgroundEvaluation(pairs, layout, theta[known]))
        first, second = frames[known][pairs.first], frames[known][pairs.second]
        while True:
            alive = kept[first] & kept[second]
            bad, every = (
                np.bincount(first[some], minlength=len(kept)) + np.bincount(second[some], minlength=len(kept))
                for some in (alive & contradicts, alive)
            )
            worst = int(np.argmax(bad * bad / np.maximum(every, 1)))
            if bad[worst] == 0:
                return kept
            kept[worst] = False


def thinned(p: Array, q: Array, image_size: tuple[int, int]) -> tuple[Array, Array]:
    """Matched pixels (N, 2) averaged over the cells of the first frame; what is thinned already stays as it is.

    Points of the second frame are averaged about a quadratic map between the frames, which bends within a cell.

    Examples
    --------
    >>> x, y = np.meshgrid(np.arange(5.0, 960.0, 10.0), np.arange(5.0, 540.0, 10.0))
    >>> p = np.stack([x, y], axis=-1).reshape(-1, 2)
    >>> cells, moved = thinned(p, 1.1 * p + (3.0, -5.0), (960, 540))
    >>> cells.shape, bool(np.allclose(moved, 1.1 * cells + (3.0, -5.0)))
    ((60, 2), True)
    """
    if len(p) < LEAST_CELLS:
        return p[:0], q[:0]
    place = np.clip(np.floor(p / image_size * CELLS), 0, np.subtract(CELLS, 1)).astype(int)
    _, cell, number = np.unique(place[:, 0] + CELLS[0] * place[:, 1], return_inverse=True, return_counts=True)
    mean = np.stack([np.bincount(cell, values) for values in p.T], axis=1) / number[:, None]

    def terms(xy: Array) -> Array:
        x, y = ((xy - np.divide(image_size, 2.0)) / image_size[0]).T
        return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)

    map_, *_ = np.linalg.lstsq(terms(p), q, rcond=None)
    rest = q - terms(p) @ map_
    left = np.stack([np.bincount(cell, values) for values in rest.T], axis=1) / number[:, None]
    return mean, terms(mean) @ map_ + left


def with_tied(
    object_segments: ObjectSegments,
    ties: Ties,
    theta: Array,
    known: BoolArray,
    wanted: IntArray,
    layout: Layout,
    scale: float,
) -> tuple[Array, BoolArray]:
    """Cameras (T, n) with those of frames that are tied, directly or through others, to known ones (T,).

    Parameters
    ----------
    wanted : (B,) int array
        Only these frames are looked at.
    layout : Layout
        In which pan, tilt, roll and zoom are the frames' own and all the rest is known.
    scale : float
        Size of what is usually in view, metres.
    """
    theta, known, left_out = theta.copy(), known.copy(), np.ones_like(known)
    left_out[wanted] = False
    while len(frames := ties.reached(known, left_out)):
        pairs, first = ties.towards(frames, theta, known)
        nearest = np.argsort(np.abs(first - frames[pairs.second]), kind="stable")
        _, one = np.unique(pairs.second[nearest], return_index=True)
        theta[frames] = theta[first[nearest[one]]]
        observations = pack(object_segments, [{}] * len(frames), layout.image_size)
        prior = _near_point(theta[frames], layout)
        for loss in (FROM_AFAR, ties.loss):
            problem = Problem(
                observations, layout, loss, prior=prior, scale=scale, background=replace(pairs, loss=loss)
            )
            start = evaluate(problem, theta[frames])
            found = levenberg_marquardt(start, max_iterations=MOST_ITERATIONS, tolerance=APPROACHED)
            theta[frames] = found.theta
        background = found.evaluation.background
        assert background is not None
        left_out[frames] = contradicted(background)
        known[frames] = ~left_out[frames]
    return theta, known


def _near_point(theta: Array, layout: Layout) -> GaussianPrior | None:
    """Principal points near those of cameras (B, n): static points tell a turn from a shift of the picture hardly.

    None where frames have no principal point of their own.
    """
    if not np.any(layout.free[PRINCIPAL_POINT]):
        return None
    sigma = np.full_like(theta, np.inf)
    sigma[:, PRINCIPAL_POINT] = POINT_MOVES * np.asarray(layout.image_size)
    return GaussianPrior(theta, sigma)


def stepped(pairs: BackgroundPairs, layout: Layout, theta: Array) -> tuple[Array, BoolArray]:
    """Cameras (B, n) after a step towards known ones, and which of them most of their ties contradict, (B,).

    They must be off by some pixels only: what is left after the step is that of the linear model.
    """
    background = BackgroundEvaluation(pairs, layout, theta)
    hessian, diagonal = background.hessian.copy(), np.arange(background.hessian.shape[1])
    hessian[:, diagonal, diagonal] *= 1.0 + DAMPING
    step = -np.linalg.solve(hessian, background.gradient[..., None])[..., 0]
    moved = theta.copy()
    moved[:, layout.free] += step
    change = np.einsum("kpm,kp->km", background.by_second, step[pairs.second])
    r = background.r + np.stack(np.split(change, 2, axis=-1))
    return moved, _contradicted(pairs, _disagreeing(pairs, layout, r), len(theta))


def contradicted(background: BackgroundEvaluation) -> BoolArray:
    """Which of B frames most of their ties contradict, (B,)."""
    return _contradicted(background.pairs, disagreeing(background), len(background.theta))


def disagreeing(background: BackgroundEvaluation) -> BoolArray:
    """Which of K pairs the cameras of their frames contradict, (K,)."""
    return _disagreeing(background.pairs, background.layout, background.r)


def _contradicted(pairs: BackgroundPairs, disagreeing: BoolArray, count: int) -> BoolArray:
    bad, every = (np.bincount(pairs.second, some, minlength=count) for some in (disagreeing, None))
    return np.asarray(bad > 0.5 * every)


def _disagreeing(pairs: BackgroundPairs, layout: Layout, r: Array) -> BoolArray:
    distance = np.where(pairs.weight > 0.0, np.linalg.norm(r, axis=0), np.nan)
    return np.asarray(np.nanmedian(distance, axis=1) > DISAGREE * pixel_unit(layout.image_size))
