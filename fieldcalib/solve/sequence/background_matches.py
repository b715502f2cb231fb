"""Ties between the frames of one tripod: matches of static points, thinned out to a few for each pair of frames.

Matches next to each other have similar errors of optical flow, lens and depth. So the picture is divided into cells,
the matches of one cell are averaged, and each cell counts as one observation.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib._types import Array, BoolArray, IntArray, is_number, listed, real_array
from fieldcalib.fields.field import Field, ObjectSegments
from fieldcalib.problem.evaluation import Problem, evaluate
from fieldcalib.problem.frame_ties import BackgroundPairs, BackgroundTerm
from fieldcalib.problem.layout import PRINCIPAL_POINT, GaussianPrior, Layout
from fieldcalib.problem.levenberg_marquardt import levenberg_marquardt
from fieldcalib.problem.losses import RobustLoss
from fieldcalib.problem.observations import pack
from fieldcalib.solve.request import Options
from fieldcalib.solve.solver_options import pixel_unit

# Lengths are in pixels of a 960 x 540 image and grow with the image.
CELLS = (10, 6)  # across and down the picture
NOISE = 0.75  # px: standard deviation of a coordinate of a cell; flow is off by 0.1 to 0.3, the zoom law by more
LOSS_SCALE = 2.5  # px: cells that are farther off are not background
DISAGREE = 6.0  # px: median distance above which the cameras of two frames contradict their tie
BEHIND_LINES = 10.0  # m from the lines of a field to the boards and stands around it
LEAST_CELLS = 5  # smallest number for a tie
APPROACHED = 1e-3  # relative decrease of the cost at which tied cameras are good enough as initial cameras
MOST_ITERATIONS = 50
POINT_MOVES = 0.1  # of width and height: motion of a window (its principal point) from a frame to a tied one
DAMPING = 1e-4  # share of the Hessian's diagonal
FROM_AFAR = RobustLoss("linear", 1.0)  # tied frames may be far apart, where a robust loss has no gradient

Matched = Mapping[tuple[int, int], tuple[ArrayLike, ArrayLike] | None]


@dataclass(frozen=True, eq=False)
class Ties:
    """Ties between pairs of T frames: pixels of static points that both see."""

    count: int
    """T, the number of all frames."""
    pairs: BackgroundPairs

    @classmethod
    def of(cls, object_segments: ObjectSegments, matches: Matched, count: int, image_size: tuple[int, int]) -> Ties:
        """Thin out matches between some of `count` frames, a mapping from pairs of frames to pixels.

        Raises
        ------
        ValueError
            If a frame does not exist, is matched with itself, or the pixels are not two arrays of one shape.
        """
        if not isinstance(matches, Mapping):
            raise ValueError(f"matches must be a mapping of pairs of frames to pixels, got {type(matches).__name__}")
        checked = {pair: _checked_match(pair, both, count) for pair, both in matches.items()}
        thin = {pair: cell_means(*both, image_size) for pair, both in checked.items() if both is not None}
        kept = {pair: both for pair, both in thin.items() if len(both[0]) >= LEAST_CELLS}
        unit, N = pixel_unit(image_size), max((len(p) for p, _ in kept.values()), default=0)
        pixels, weights = np.zeros((2, len(kept), N, 2)), np.zeros((len(kept), N))
        pixels[:] = np.divide(image_size, 2.0)  # padding must stay finite
        for k, both in enumerate(kept.values()):
            pixels[:, k, : len(both[0])], weights[k, : len(both[0])] = both, 1.0 / (NOISE * unit) ** 2
        first, second = np.array(list(kept), dtype=np.intp).reshape(-1, 2).T
        walls = None
        if isinstance(object_segments, Field):
            walls = np.array([object_segments.length, object_segments.width]) / 2.0 + BEHIND_LINES
        loss = RobustLoss("cauchy", LOSS_SCALE * unit)
        p, q = pixels
        return cls(count, BackgroundPairs(first, second, p, q, weights, loss, walls))

    def __len__(self) -> int:
        return len(self.pairs)

    @property
    def is_tied(self) -> BoolArray:
        """Mask (T,) of the frames that are in a pair."""
        return np.isin(np.arange(self.count), [self.pairs.first, self.pairs.second])

    def among(self, frames: IntArray) -> BackgroundPairs | None:
        """The pairs within some frames, renumbered by position in `frames`; None if there are none."""
        number = self._numbers(frames)
        first, second = number[self.pairs.first], number[self.pairs.second]
        inside = (first >= 0) & (second >= 0)
        return replace(self.pairs.at(inside), first=first[inside], second=second[inside]) if np.any(inside) else None

    def towards(self, frames: IntArray, theta: Array, known: BoolArray) -> BackgroundPairs:
        """The pairs from frames with `known` (T,) cameras theta (T, n) to `frames`, renumbered by position in these."""
        number = self._numbers(frames)
        ways = [one.at(known[one.first] & (number[one.second] >= 0)) for one in (self.pairs, self.pairs.swapped)]
        pairs = BackgroundPairs.joined(*ways)
        return replace(pairs, second=number[pairs.second], known=theta[pairs.first])

    def _numbers(self, frames: IntArray) -> IntArray:
        """Position of each of all frames, (T,), in `frames`; -1 for the others."""
        number = np.full(self.count, -1)
        number[frames] = np.arange(len(frames))
        return number

    def reached(self, known: BoolArray, left_out: BoolArray) -> IntArray:
        """Numbers of frames that are tied to a `known` one (T,), and are neither known nor left out (T,)."""
        found = np.zeros_like(known)
        found[self.pairs.second[known[self.pairs.first]]] = True
        found[self.pairs.first[known[self.pairs.second]]] = True
        return np.flatnonzero(found & ~known & ~left_out)

    def agreeing(self, theta: Array, known: BoolArray, layout: Layout) -> BoolArray:
        """Mask (T,) of frames with known cameras that agree with their ties.

        The frames with the most contradicted ties are left out one by one, until no tie is contradicted.
        """
        kept, frames = known.copy(), np.arange(len(known))
        pairs = self.among(frames[known])
        if pairs is None:
            return kept
        contradicts = disagreeing(BackgroundTerm(pairs, layout, theta[known]))
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


def _checked_match(
    pair: tuple[int, int], both: tuple[ArrayLike, ArrayLike] | None, count: int
) -> tuple[Array, Array] | None:
    if not (isinstance(pair, tuple) and len(pair) == 2 and all(map(is_number, pair))):
        raise ValueError(f"matches are between two frames, as {{(0, 1): (p, q)}}; got those of {pair!r}")
    i, j = pair
    if not (0 <= i < count and 0 <= j < count) or i == j:
        raise ValueError(f"matches are between two of {count} frames, from 0 on; got those of {i} and {j}")
    if both is None:
        return None
    if len(listed(both, "the pixels in both frames")) != 2:
        raise ValueError(f"matches of frames {i} and {j}: expected the pixels in both, got {len(both)} arrays")
    p, q = map(real_array, both)
    if p.shape != q.shape or p.ndim != 2 or p.shape[1] != 2 or not np.isfinite([p, q]).all():
        raise ValueError(
            f"matches of frames {i} and {j}: expected two arrays of finite pixels, of the same shape (N, 2), "
            f"got {p.shape} and {q.shape}"
        )
    return p, q


def cell_means(p: Array, q: Array, image_size: tuple[int, int]) -> tuple[Array, Array]:
    """Average matched pixels (N, 2) over the cells of the first frame; it is idempotent.

    Pixels of the second frame are averaged as residuals of a quadratic map between the frames, since the map is not
    linear within a cell.

    Examples
    --------
    >>> x, y = np.meshgrid(np.arange(5.0, 960.0, 10.0), np.arange(5.0, 540.0, 10.0))
    >>> p = np.stack([x, y], axis=-1).reshape(-1, 2)
    >>> cells, moved = cell_means(p, 1.1 * p + (3.0, -5.0), (960, 540))
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
    options: Options, ties: Ties, theta: Array, known: BoolArray, wanted: IntArray, layout: Layout
) -> tuple[Array, BoolArray]:
    """Add cameras of frames that are tied, directly or through other frames, to frames with known cameras.

    theta (T, n) are the cameras of all frames, `known` (T,) masks the known ones; new arrays of both are returned.

    Parameters
    ----------
    wanted : (B,) int array
        Frames to which cameras are added.
    layout : Layout
        Layout in which pan, tilt, roll and zoom are the frames' own and all other parameters are known.
    """
    theta, known, left_out = theta.copy(), known.copy(), np.ones_like(known)
    left_out[wanted] = False
    # layer by layer: each new frame starts at the camera of the nearest known frame that it is tied to
    while len(frames := ties.reached(known, left_out)):
        pairs = ties.towards(frames, theta, known)
        nearest = np.argsort(np.abs(pairs.first - frames[pairs.second]), kind="stable")
        _, one = np.unique(pairs.second[nearest], return_index=True)
        theta[frames] = theta[pairs.first[nearest[one]]]
        observations = pack(options.object_segments, [{}] * len(frames), layout.image_size)
        problem = Problem(
            observations, layout, pairs.loss, prior=_near_point(theta[frames], layout), scale=options.scale
        )
        for loss in (FROM_AFAR, pairs.loss):
            start = evaluate(replace(problem, background=replace(pairs, loss=loss)), theta[frames])
            found = levenberg_marquardt(start, max_iterations=MOST_ITERATIONS, tolerance=APPROACHED).evaluation
            theta[frames] = found.theta
        assert found.background is not None
        left_out[frames] = contradicted(found.background)
        known[frames] = ~left_out[frames]
    return theta, known


def _near_point(theta: Array, layout: Layout) -> GaussianPrior | None:
    """Prior that keeps principal points near those of cameras (B, n), None if frames have none of their own.

    Without it, static points would hardly distinguish a rotation of the camera from a shift of the principal point.
    """
    if not np.any(layout.free[PRINCIPAL_POINT]):
        return None
    sigma = np.full_like(theta, np.inf)
    sigma[:, PRINCIPAL_POINT] = POINT_MOVES * np.asarray(layout.image_size)
    return GaussianPrior(theta, sigma)


def stepped(pairs: BackgroundPairs, layout: Layout, theta: Array) -> tuple[Array, BoolArray]:
    """Move cameras (B, n) by one Gauss-Newton step; also returns whether most of each one's ties contradict it, (B,).

    Cameras may be off by a few pixels only, as distances after the step are taken from the linear model.
    """
    background = BackgroundTerm(pairs, layout, theta)
    hessian, diagonal = background.hessian.copy(), np.arange(background.hessian.shape[1])
    hessian[:, diagonal, diagonal] *= 1.0 + DAMPING
    step = -np.linalg.solve(hessian, background.gradient[..., None])[..., 0]
    moved = theta.copy()
    moved[:, layout.free] += step
    change = np.einsum("kpm,kp->km", background.by_second, step[pairs.second])
    r = background.r + np.stack(np.split(change, 2, axis=-1))
    return moved, _contradicted(pairs, _disagreeing(pairs, layout, r), len(theta))


def contradicted(background: BackgroundTerm) -> BoolArray:
    """Mask (B,) of the frames whose cameras are contradicted by most of their ties."""
    return _contradicted(background.pairs, disagreeing(background), len(background.theta))


def disagreeing(background: BackgroundTerm) -> BoolArray:
    """Mask (K,) of the pairs whose points do not coincide under the cameras of their frames."""
    return _disagreeing(background.pairs, background.layout, background.r)


def _contradicted(pairs: BackgroundPairs, disagreeing: BoolArray, count: int) -> BoolArray:
    bad, every = (np.bincount(pairs.second, some, minlength=count) for some in (disagreeing, None))
    return np.asarray(bad > 0.5 * every)


def _disagreeing(pairs: BackgroundPairs, layout: Layout, r: Array) -> BoolArray:
    distance = np.where(pairs.weight > 0.0, np.linalg.norm(r, axis=0), np.nan)
    return np.asarray(np.nanmedian(distance, axis=1) > DISAGREE * pixel_unit(layout.image_size))
