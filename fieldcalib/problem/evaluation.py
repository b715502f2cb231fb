"""The estimation problem of B frames, and its evaluation at their cameras.

    cost(theta) = 1/2 sum_i w_i rho(r_i(theta)^2) / noise^2 + 1/2 sum_k ((theta_k - mean_k) / sigma_k)^2

The residual of an observed pixel p is its signed distance, in pixels of the real (distorted) image, to the image of its
segment: with X* the closest point and n the unit normal of the segment's image at pi(X*),

    r = n . (p - pi(X*)),        dr/dtheta = -n . dpi(X*)/dtheta.

r is stationary in the position of X* along the curve, so the derivative of the search drops out. The robust loss acts
on the data alone. Pixels and prior (`fieldcalib.problem.cost_term`) are terms of the cost
(`fieldcalib.problem.cost_term`). Others link frames of one camera: static points of the background
(`fieldcalib.problem.frame_ties`), and the smooth path of a camera that moves (`fieldcalib.problem.frame_ties`).

Ends of segments: pixels that lie past the end of their line or arc are pulled back to that end.

The residual of a pixel is its distance to the infinite line or the whole circle: smooth, and valid behind the camera,
but insensitive to a goal line that goes on beyond its corner. Once a camera is known, so are the pixels that it sees
past an end X. Each of them gets one more residual, along the unit tangent t of the segment's image at X,

    r = t . (p - pi(X)),

and the camera is solved again. Pixels, ends and tangents are chosen once, so this residual is as smooth as the others.
Pixels before the end get none: annotators stop early, and players hide ends.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, reduce

import numpy as np

from fieldcalib._types import Array, BoolArray, IntArray
from fieldcalib.fields.field import ObjectSegments
from fieldcalib.fields.ground import Terrain
from fieldcalib.fields.segments import EndRows
from fieldcalib.fields.segments.closest import ClosestPoints
from fieldcalib.fields.traits import SOCCER_SCALE
from fieldcalib.geometry.camera import Camera
from fieldcalib.geometry.lens import common_lens
from fieldcalib.problem.compilation import compiled_closest_points
from fieldcalib.problem.cost_term import CostTerm, Coupling, PriorTerm
from fieldcalib.problem.frame_ties import BackgroundPairs, BackgroundTerm, PathTerm, SmoothPath
from fieldcalib.problem.labelled_pixels import Pixels, PixelTable
from fieldcalib.problem.layout import LOG_F, GaussianPrior, Layout
from fieldcalib.problem.losses import RobustLoss
from fieldcalib.problem.observations import Observations
from fieldcalib.problem.projection import Projection

# Fields of view from 0.3 to 170 degrees: outside, fits collapse to a point or to a plane and overflow.
LOG_F_RANGE = (np.log(0.04), np.log(200.0))  # of f / width

HELD = 1e-6  # prior standard deviation, in any unit, that keeps a parameter at its value
AWAY = 1e9  # m: where points at infinity are taken to be
WEIGHT = 0.5  # of a pixel along its segment, relative to its weight across: annotators place ends with less care


@dataclass(frozen=True, eq=False)
class Problem:
    """B calibration problems that share a layout, a loss and a noise."""

    observations: Observations
    layout: Layout
    """The parameters, and which of them are estimated."""
    loss: RobustLoss
    noise: float = 1.0
    """Standard deviation of a segment of weight 1, pixels: it sets the weight of labels against the prior."""
    prior: GaussianPrior | None = None
    """Prior of each problem, (B, n); None without a prior."""
    group: IntArray | None = None
    """Group of each frame, (B,), ascending from 0: its frames share parameters. None if nothing is shared."""
    paint: float = 0.0
    """Standard deviation of the position of a painted line, metres; it enters the uncertainty only."""
    considered: Array | None = None
    """Covariance of the considered parameters; None for that of the prior distribution of the field's size."""
    scale: float = SOCCER_SCALE
    """Size of the scene, metres: the unit of steps of the camera's centre."""
    background: BackgroundPairs | None = None
    """Points of the background that tie frames of one camera; None without them."""
    path: SmoothPath | None = None
    """The path of the centre of a moving camera; None if frames share the centre, or each has its own."""

    def __len__(self) -> int:
        return len(self.observations)

    @property
    def free(self) -> BoolArray:
        """Mask of the estimated parameters, (n,)."""
        return self.layout.free

    def take(self, index: IntArray | slice) -> Problem:
        """The problems `index`, in that order, repeated where `index` repeats.

        Raises
        ------
        ValueError
            If frames are linked with one another.
        """
        if self.path is not None:
            raise ValueError("frames on one path cannot be taken apart")
        prior = None if self.prior is None else self.prior.take(index)
        group = None if self.group is None else self.group[index]
        background = None if self.background is None else self.background.take(np.arange(len(self))[index])
        return replace(
            self, observations=self.observations.take(index), prior=prior, group=group, background=background
        )

    def prior_residuals(self, theta: Array) -> Array:
        """z-scores of the free parameters, (B, P); (B, 0) without a prior."""
        if self.prior is None:
            return np.zeros((len(theta), 0))
        return self.prior.z_scores(theta)[:, self.free]

    def terrain(self, theta: Array) -> Terrain | None:
        """The ground at parameters (B, n); None where it is level (`Layout.terrain`)."""
        return self.layout.terrain(theta, self.observations.terrain)

    def is_possible(self, theta: Array) -> BoolArray:
        """Whether the focal lengths are in range, (B,): collapsing fits are stopped before they overflow."""
        log_f = theta[:, LOG_F] - np.log(self.layout.image_size[0])
        return np.asarray((log_f > LOG_F_RANGE[0]) & (log_f < LOG_F_RANGE[1]))


@dataclass(frozen=True, eq=False)
class Evaluation:
    """A problem evaluated at its cameras, with one search for the closest points.

    Examples
    --------
    >>> from fieldcalib import Camera, soccer
    >>> from fieldcalib.problem.layout import theta_from_camera
    >>> from fieldcalib.problem.observations import pack
    >>> camera = Camera.from_angles(0.0, 1.3, 0.0, 1500.0, (0.0, 60.0, -15.0), (960, 540))
    >>> level = camera.project(soccer()["Side line top"].sample(50.0)) + (7.0, 2.0)  # sliding along it costs nothing
    >>> observations = pack(soccer(), [{"Side line top": level}], (960, 540))
    >>> problem = Problem(observations, Layout.of((960, 540)), RobustLoss("linear", 1.0))
    >>> abs(evaluate(problem, theta_from_camera(camera)[None]).r).round(6)
    array([[2., 2., 2., 2.]])
    """

    problem: Problem
    theta: Array
    """Parameters of the cameras, (B, n)."""
    points: ClosestPoints
    known_projection: Projection | None = None
    """`projection`, if it was computed already."""

    @property
    def r(self) -> Array:
        """Signed distances of the observed pixels in pixels, (B, M), in the order of `Observations.weight`.

        Padding has values too, with weight 0.
        """
        return self.points.r

    @cached_property
    def projection(self) -> Projection:
        """The cameras."""
        return self.known_projection or Projection(self.theta, self.problem.layout, self.problem.terrain(self.theta))

    @cached_property
    def JT(self) -> Array:
        """Derivatives of the residuals, (B, P, M): one row for each free parameter, in the order of theta."""
        return self.derivatives(self.problem.free)

    def derivatives(self, free: BoolArray) -> Array:
        """Derivatives of the residuals by any of the parameters, (B, P, M)."""
        is_size = np.arange(len(free)) >= self.problem.layout.field_size_block.start  # length, width and crown
        by_camera = self._by_camera(free & ~is_size)
        if not (free & is_size).any():
            return by_camera
        # moving a segment is equivalent to moving the camera the other way
        moving = self.motion_of_points[..., free[is_size]]
        return np.concatenate([by_camera, -np.einsum("bcm,bmcs->bsm", self.by_centre, moving)], axis=1)

    @cached_property
    def by_centre(self) -> Array:
        """Derivatives of the residuals by the position of the camera, (B, 3, M)."""
        return self._by_camera(self.problem.layout.is_centre)

    def _by_camera(self, free: BoolArray) -> Array:
        """`derivatives` for a field of constant size."""
        points = self.points
        return -self.projection.derivatives(points.s, points.inverse_depth, points.normal, free)

    @cached_property
    def motion_of_points(self) -> Array:
        """Derivatives of the closest points by length, width and, if it is a parameter, crown, (B, M, 3, 2 or 3)."""
        motion, layout = self.problem.observations.motion_of_residuals, self.problem.layout
        terrain = self.projection.terrain
        if terrain is None and not np.any(layout.is_crown):
            return motion
        X = np.nan_to_num(self.world_points, nan=AWAY, posinf=AWAY, neginf=-AWAY)  # the ground is level there
        x, y = X[..., 0], X[..., 1]
        if terrain is not None:
            hx, hy = terrain.slopes(x, y)
            motion = motion.copy()
            rises = hx[..., None] * motion[..., 0, :] + hy[..., None] * motion[..., 1, :]
            motion[..., 2, :] -= rises + np.stack(terrain.by_size(x, y), axis=-1)  # z points down
        if not np.any(layout.is_crown):
            return motion
        raised = np.zeros((*motion.shape[:-1], 1))
        raised[..., 2, 0] = -layout.level(self.theta).shares(x, y)[0]
        return np.concatenate([motion, raised], axis=-1)

    @cached_property
    def _losses(self) -> tuple[Array, Array]:
        return self.problem.loss.evaluate(np.square(self.r))

    @cached_property
    def irls_weight(self) -> Array:
        """Weights of the residuals in the normal equations, ``w rho' / noise^2``, (B, M)."""
        return np.asarray(self.problem.observations.weight * self._losses[1] / self.problem.noise**2)

    @cached_property
    def costs(self) -> Array:
        """Cost of each residual, (B, M)."""
        return np.asarray(0.5 * self.problem.observations.weight * self._losses[0] / self.problem.noise**2)

    @property
    def pixels(self) -> PixelTerm:
        """The labelled pixels as a term of the cost."""
        return PixelTerm(self)

    @cached_property
    def prior(self) -> PriorTerm | None:
        """The prior as a term of the cost; None without a prior."""
        prior = self.problem.prior
        return None if prior is None else PriorTerm(prior, self.problem.layout, self.theta)

    @cached_property
    def background(self) -> BackgroundTerm | None:
        """The static points that tie frames as a term of the cost; None without them."""
        pairs = self.problem.background
        return None if pairs is None else BackgroundTerm(pairs, self.problem.layout, self.theta)

    @cached_property
    def links(self) -> tuple[CostTerm, ...]:
        """The terms that link frames with one another."""
        path = self.problem.path
        on_path = None if path is None else PathTerm(path, self.problem.layout, self.theta)
        return tuple(link for link in (self.background, on_path) if link is not None)

    @property
    def terms(self) -> tuple[CostTerm, ...]:
        """All terms of the cost."""
        return (self.pixels, *((self.prior,) if self.prior is not None else ()), *self.links)

    @cached_property
    def cost(self) -> Array:
        """Cost of each frame, (B,); infinite where it is not finite or the focal length out of range.

        Derivatives are meaningless where it is infinite.
        """
        cost = _sum([term.cost for term in self.terms])
        return np.where(np.isfinite(cost) & self.problem.is_possible(self.theta), cost, np.inf)

    @cached_property
    def gradient(self) -> Array:
        """Gradient of the cost, (B, P)."""
        return _sum([term.gradient for term in self.terms])

    @cached_property
    def information(self) -> Array:
        """Gauss-Newton Hessian of the pixels alone, (B, P, P)."""
        return self.information_of(slice(None))

    def information_of(self, residuals: slice) -> Array:
        """Gauss-Newton Hessian of some of the residuals, (B, P, P)."""
        JT = self.JT[:, :, residuals]
        return np.asarray((JT * self.irls_weight[:, None, residuals]) @ np.swapaxes(JT, 1, 2))

    @cached_property
    def hessian(self) -> Array:
        """Gauss-Newton approximation of the Hessian of the cost, (B, P, P)."""
        return _sum([term.hessian for term in self.terms])

    @cached_property
    def links_hessian(self) -> Array:
        """Hessian of the terms that link frames, (B, P, P)."""
        return _sum([np.zeros_like(self.information), *(link.hessian for link in self.links)])

    @cached_property
    def coupling(self) -> Coupling | None:
        """Hessian between the own parameters of different frames; None if they are independent."""
        found = [coupling for term in self.terms if (coupling := term.coupling) is not None]
        return Coupling(*map(np.concatenate, zip(*found, strict=True))) if found else None

    @cached_property
    def world_points(self) -> Array:
        """The closest points in the world, (B, M, 3): not finite where they are at infinity."""
        return self.projection.world_points(self.points.s, self.points.inverse_depth)

    def of(self, problem: Problem) -> Evaluation:
        """The evaluation of another problem, with the same pixels, at the same cameras."""
        return Evaluation(problem, self.theta, self.points)

    def held(self, some: BoolArray, theta: Array) -> Evaluation:
        """The evaluation with a prior that holds the parameters in a mask (n,) at their values in theta (T, n)."""
        prior = self.problem.prior or GaussianPrior(theta, np.full_like(theta, np.inf))
        prior = GaussianPrior(np.where(some, theta, prior.mean), np.where(some, HELD, prior.sigma))
        return self.of(replace(self.problem, prior=prior))

    def with_ends(self, ends: EndRows) -> Evaluation:
        """The evaluation with other ends of segments."""
        observations = self.problem.observations.with_ends(ends)
        problem = replace(self.problem, observations=observations)
        points = self.points.columns(slice(0, self.r.shape[1] - self.problem.observations.ends.xy.shape[1]))
        if ends:
            points = ClosestPoints.joined([points, *ends.closest_points(self.projection)])
        return Evaluation(problem, self.theta, points)

    def take(self, index: IntArray | slice) -> Evaluation:
        """The evaluations `index`, in that order, repeated where `index` repeats."""
        return Evaluation(self.problem.take(index), self.theta[index], self.points.take(index))

    @property
    def trimmed(self) -> Evaluation:
        """The evaluation without the padding that all frames have."""
        observations = self.problem.observations
        kept = np.flatnonzero(np.any(observations.label >= 0, axis=0))
        return Evaluation(
            replace(self.problem, observations=observations.trimmed), self.theta, self.points.columns(kept)
        )

    def __reduce__(self) -> tuple[type[Evaluation], tuple[Problem, Array, ClosestPoints]]:
        return Evaluation, (self.problem, self.theta, self.points)  # all else is computed from these again

    def replaced(self, index: IntArray, theta: Array, points: ClosestPoints) -> Evaluation:
        """The evaluation with other cameras of the frames `index`, and their closest points."""
        new = self.theta.copy()
        new[index] = theta
        return Evaluation(self.problem, new, self.points.replaced(index, points))


@dataclass(frozen=True, eq=False)
class PixelTerm(CostTerm):
    """The labelled pixels of an evaluation as a term of its cost."""

    evaluation: Evaluation

    @property
    def cost(self) -> Array:
        """Cost of the pixels of each frame, (B,)."""
        return np.asarray(np.sum(self.evaluation.costs, axis=1))

    @property
    def gradient(self) -> Array:
        """Gradient by the free parameters, (B, P)."""
        of = self.evaluation
        return np.asarray((of.JT @ (of.irls_weight * of.r)[..., None])[..., 0])

    @property
    def hessian(self) -> Array:
        """Gauss-Newton Hessian, (B, P, P)."""
        return self.evaluation.information


def _sum(parts: Sequence[Array]) -> Array:
    return np.asarray(reduce(np.add, parts))


def evaluate(problem: Problem, theta: Array) -> Evaluation:
    """Search the closest points of B problems at their cameras theta (B, n)."""
    terrain = problem.terrain(theta)
    points = compiled_closest_points(theta, problem.layout, problem.observations, terrain)
    if points is not None:
        return Evaluation(problem, theta, points)
    projection = Projection(theta, problem.layout, terrain)
    observations, size = problem.observations, problem.layout.field_size
    if size is not None and problem.layout.has_free_size:
        observations = observations.moved(theta[:, problem.layout.field_size_block] - size.given)
    return Evaluation(problem, theta, observations.closest_points(projection), projection)


def evaluate_camera(camera: Camera, object_segments: ObjectSegments, frame: Pixels) -> Evaluation:
    """Evaluate the labels of one frame at a camera, without prior and robust loss."""
    return evaluate_cameras([camera], object_segments, PixelTable.of(object_segments, [frame]))


def evaluate_cameras(cameras: Sequence[Camera], object_segments: ObjectSegments, pixels: PixelTable) -> Evaluation:
    """Evaluate the labels of frames of one size, each at its camera, without prior and robust loss."""
    size = cameras[0].image_size
    layout = Layout.of(size, common_lens([camera.lens for camera in cameras]))
    problem = Problem(Observations.of(object_segments, pixels, size), layout, RobustLoss("linear", 1.0))
    return evaluate(problem, np.array([layout.theta(camera) for camera in cameras]))


def with_segment_ends(evaluation: Evaluation, far: float) -> Evaluation:
    """The evaluation with residuals of the pixels that its cameras see past an end.

    Pixels more than `far` past an end have another cause than a careless end, and get none.
    """
    return evaluation.with_ends(pixels_past_ends(evaluation, far))


def pixels_past_ends(evaluation: Evaluation, far: float) -> EndRows:
    """Pixels that the cameras see past an end, by `far` pixels at most."""
    observations, parts = evaluation.problem.observations, []
    spans = np.array([segment.span for segment in observations.segments]).reshape(-1, 2)
    terrain = evaluation.projection.terrain
    X = evaluation.world_points if terrain is None else terrain.lowered(evaluation.world_points)
    for rows in observations.rows:
        columns = observations.columns[type(rows)]
        ends = rows.past_ends(X[:, columns], spans)
        if ends is None:
            continue
        points = evaluation.points.columns(columns)
        x, y = points.normal
        tangent = np.stack([-y, x, np.zeros_like(x)], axis=-1)
        along = np.stack([ends.along, np.zeros_like(x), np.zeros_like(x)], axis=-1)
        weight = WEIGHT * rows.weight * (ends.past & (points.inverse_depth > 0.0))
        parts.append((rows.xy, weight, rows.label, np.stack([ends.X, tangent, along], axis=2)))
    past = EndRows(*(np.concatenate(column, axis=1) for column in zip(*parts, strict=True)))
    (end,) = past.closest_points(evaluation.projection)
    past.weight[(end.inverse_depth <= 0.0) | (np.abs(end.r) > far)] = 0.0
    seen = past.weight > 0.0
    past.label[~seen], past.geometry[~seen] = -1, 1.0  # padding must be finite
    return past.choose(np.argsort(~seen, axis=1, kind="stable")).trimmed
