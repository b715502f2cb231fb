"""The segment reprojection residual and its analytic Jacobian, for many frames and starts at once.

Every observed pixel p belongs to a segment. Its residual is the signed distance, in pixels of the real (distorted)
image, to the image of that segment. One form serves all kinds: with X* the foot point of p on the segment and n the
unit normal of the segment's image at pi(X*),

    r = n . (p - pi(X*)),        dr/dtheta = -n . dpi(X*)/dtheta.

X* is stationary along the curve, so the derivative of the search drops out. A foot point is kept as the ideal offset s
of its image (`fieldcalib.geometry.lens`) and its inverse depth w: the homogeneous camera point (s / f, 1; w). At
infinity w is 0, behind the camera it is negative, and the image of the line is well defined all the same.

A point, or a pixel of an unordered cloud, has two residuals: n is then the x and the y axis.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from fieldcalib._types import Array, BoolArray, IntArray
from fieldcalib.geometry.lens import FOLD, lens_coefficients, undistort
from fieldcalib.geometry.rotation import rotation_axes, rotation_from_angles
from fieldcalib.problem.observations import Observations, Rows
from fieldcalib.problem.parameters import ANGLES, CENTER, LENS, LOG_ASPECT, LOG_F, PRINCIPAL_POINT

# Inside this module components come first: a plane vector of every row is (2, B, N), one in space (3, B, N). Then
# ``x, y = s`` unpacks it, and contiguous components halve the time. `np.array` joins them: on the small arrays of a
# single frame it takes a quarter of the time of `np.stack`.

BENDING = [LENS.start, LENS.start + 1, LOG_ASPECT]  # parameters under which the image of a line is no line
TINY = 1e-300  # keeps degenerate lengths from dividing by zero


def segment_residuals(theta: Array, observations: Observations) -> Array:
    """Signed distances of all observed pixels to the images of their segments.

    Parameters
    ----------
    theta : (B, 12) array
        One parameter vector a frame (`fieldcalib.problem.parameters`).
    observations : Observations
        B frames; to look at one frame from several cameras, repeat it with `Observations.take`.

    Returns
    -------
    (B, M) array
        Residuals in pixels, in the order of `Observations.weight`. Padding has values too: they weigh 0.

    Examples
    --------
    >>> from fieldcalib import Camera, soccer
    >>> from fieldcalib.problem.parameters import theta_from_camera
    >>> from fieldcalib.problem.observations import pack
    >>> camera = Camera.from_angles(0.0, 1.3, 0.0, 1500.0, (0.0, 60.0, -15.0), (960, 540))
    >>> level = camera.project(soccer()["Side line top"].sample(50.0)) + (7.0, 2.0)  # sliding along it costs nothing
    >>> observations = pack(soccer(), [{"Side line top": level}], (960, 540))
    >>> abs(segment_residuals(theta_from_camera(camera)[None], observations)).round(6)
    array([[2., 2., 2., 2.]])
    """
    return foot_points(theta, observations).r


def segment_residuals_with_jacobian(theta: Array, observations: Observations, free: BoolArray) -> tuple[Array, Array]:
    """The residuals and their derivatives with respect to the free parameters.

    With the foot point's camera coordinates ``Xc = (s / f, 1)``, its inverse depth w and ``g = n dpi/dXc``,

        dr/dangle = axis . (Xc x g),    dr/dC = w R^T g,    dr/dlog f = -n . dpi/ds s.

    Parameters
    ----------
    theta : (B, 12) array
    observations : Observations
    free : (12,) bool array
        Which parameters to differentiate by.

    Returns
    -------
    r : (B, M) array
        As `segment_residuals`.
    J : (B, M, P) array
        One column for each free parameter, in the order of theta.
    """
    view = View(theta, observations.image_size)
    feet = _feet(view, observations)
    return feet.r, _jacobian(view, feet, free)


@dataclass(frozen=True)
class Feet:
    """Foot points of B x M residuals."""

    r: Array
    """Signed distance of the observed pixel, (B, M)."""
    s: Array
    """Ideal offset of the foot point's image from the principal point, pixels, (2, B, M)."""
    inverse_depth: Array
    """0 at infinity, negative behind the camera, (B, M)."""
    normal: Array
    """Unit normal of the segment's real image at the foot point, (2, B, M)."""


def foot_points(theta: Array, observations: Observations) -> Feet:
    """The foot points that `segment_residuals` measures from."""
    return _feet(View(theta, observations.image_size), observations)


def end_points(theta: Array, ends: Rows, image_size: tuple[int, int]) -> Feet:
    """The ends of segments that `Observations.ends` are measured from."""
    return _end_feet(View(theta, image_size), ends)


def world_points(theta: Array, feet: Feet) -> Array:
    """Foot points in the world, (B, M, 3): not finite where they are at infinity."""
    with np.errstate(divide="ignore", invalid="ignore"):
        s = np.moveaxis(feet.s, 0, -1) / np.exp(theta[:, None, LOG_F, None])
        Xc = np.concatenate([s, np.ones_like(s[..., :1])], axis=-1) / feet.inverse_depth[..., None]
        return np.asarray(theta[:, None, CENTER] + Xc @ rotation_from_angles(theta[:, ANGLES]))


class View:
    """What the residuals need of B parameter vectors, computed once for all rows.

    Scaled camera coordinates are (f Xc, f Yc, Zc): the ratio of their components is the ideal offset.
    """

    def __init__(self, theta: Array, image_size: tuple[int, int]) -> None:
        self.theta = theta
        self.R = rotation_from_angles(theta[:, ANGLES])
        self.f = np.exp(theta[:, LOG_F, None])
        self.rho = float(np.hypot(*image_size) / 2.0)
        self.aspect = np.exp(theta[:, LOG_ASPECT, None])
        self.lens = lens_coefficients(theta[:, None, LENS])
        # without lens and aspect the real offset is the ideal one, and half of the work falls away
        self.bent = bool(np.any(theta[:, BENDING]))
        self._scaled_R = self.R.copy()
        self._scaled_R[:, :2] *= self.f[:, :, None]

    def directions(self, d: Array) -> Array:
        """World directions (B, N, 3) in scaled camera coordinates, (3, B, N)."""
        return np.ascontiguousarray(np.swapaxes(self._scaled_R @ np.swapaxes(d, 1, 2), 0, 1))

    def points(self, X: Array) -> Array:
        """World points (B, N, 3) in scaled camera coordinates, (3, B, N)."""
        return self.directions(X - self.theta[:, None, CENTER])

    def observed_offset(self, xy: Array) -> Array:
        """Observed pixels (B, N, 2) as real offsets from the principal point, (2, B, N)."""
        cx, cy = self.theta[:, PRINCIPAL_POINT].T
        return np.array([xy[..., 0] - cx[:, None], xy[..., 1] - cy[:, None]])

    def ideal_offset(self, d: Array) -> Array:
        """Real offsets (2, B, N) as ideal ones; unchanged where no ray of the lens reaches them."""
        if not self.bent:
            return d
        isotropic = np.stack([d[0], d[1] / self.aspect], axis=-1)
        s = undistort(isotropic, self.lens, self.rho)
        return _components(np.where(np.isfinite(s), s, isotropic))

    def nearly_ideal_offset(self, d: Array) -> Array:
        """The same by three fixed-point steps: good enough where a search for foot points begins."""
        if not self.bent:
            return d
        isotropic = np.array([d[0], d[1] / self.aspect])
        s = isotropic
        for _ in range(3):
            gain, _ = self._gain(s)
            s = isotropic / np.maximum(gain, 0.5)
        return s

    def _gain(self, s: Array) -> tuple[Array, Array]:
        """``1 + a1 q + a2 q^2`` at ideal offsets (2, B, N), and ``2 / rho^2`` times its derivative by q."""
        a1, a2 = self.lens[..., 0], self.lens[..., 1]
        q = _dot(s, s) / self.rho**2
        return 1.0 + q * (a1 + q * a2), 2.0 * (a1 + 2.0 * a2 * q) / self.rho**2

    def real_offset(self, s: Array) -> Array:
        """Ideal offsets (2, B, N) as real ones: the lens, then the pixels' aspect."""
        if not self.bent:
            return s
        gain, _ = self._gain(s)
        return np.array([gain * s[0], self.aspect * gain * s[1]])

    def images(self, s: Array, *steps: Array) -> tuple[Array, ...]:
        """Real offsets of ideal ones s, and images of small steps there, (2, B, N) each.

        The derivative of `real_offset`, ``dd/ds = diag(1, aspect) (gain I + slope s s^T)``, applied to the steps.
        """
        if not self.bent:
            return s, *steps
        gain, slope = self._gain(s)
        found = [np.array([gain * s[0], self.aspect * gain * s[1]])]
        for step in steps:
            bend = slope * _dot(s, step)
            found.append(np.array([gain * step[0] + bend * s[0], self.aspect * (gain * step[1] + bend * s[1])]))
        return tuple(found)

    def pulled_back(self, s: Array, n: Array) -> Array:
        """Real normals n (2, B, N) as derivatives by ideal offsets: ``n dd/ds``, the transpose of `images`."""
        if not self.bent:
            return n
        gain, slope = self._gain(s)
        m = np.array([n[0], self.aspect * n[1]])
        return np.asarray(gain * m + slope * _dot(s, m) * s)


def _feet(view: View, observations: Observations) -> Feet:
    """Foot points of all residuals, in the order of `Observations.weight`."""
    found: list[Feet] = []
    if observations.lines:
        found.append(_line_feet(view, observations.lines))
    if observations.arcs:
        found.append(_arc_feet(view, observations.arcs))
    if observations.curves:
        found.append(_sampled_curve_feet(view, observations.curves))
    if observations.points:
        found.extend(_point_feet(view, observations.points, observations.points.geometry[..., 0, :]))
    if observations.clouds:
        X, _ = _nearest_sample(view, observations.clouds)
        found.extend(_point_feet(view, observations.clouds, X))
    if observations.ends:
        found.append(_end_feet(view, observations.ends))
    if len(found) == 1:
        return found[0]
    names = ("r", "s", "inverse_depth", "normal")
    return Feet(*(np.concatenate([getattr(feet, name) for feet in found], axis=-1) for name in names))


def _line_feet(view: View, rows: Rows) -> Feet:
    """Foot points on infinite lines, in closed form; with a lens, refined along the line's curved image."""
    A, D = view.points(rows.geometry[:, :, 0]), view.directions(rows.geometry[:, :, 1])
    line = _cross(A, D)  # the image line: right even with an end behind the camera
    scale = 1.0 / (np.sqrt(_dot(line[:2], line[:2])) + TINY)
    normal = n = line[:2] * scale
    d = view.observed_offset(rows.xy)
    p = view.nearly_ideal_offset(d)
    r = _dot(n, p) + line[2] * scale
    s = p - r * n
    along = n[0] * p[1] - n[1] * p[0]  # the foot point's coordinate on the image line
    if view.bent:
        tangent = np.array([-n[1], n[0]])
        # steps contract by distance x curvature, 1e-2 at 50 px and a strong lens; bounded where the lens folds back
        for _ in range(6):
            real, T = view.images(s, tangent)
            step = _dot(d - real, T) / (_dot(T, T) + TINY)
            step = np.minimum(np.maximum(step, -view.rho), view.rho)
            s, along = s + step * tangent, along + step
            if (np.abs(step) * (rows.weight > 0.0)).max(initial=0.0) < 1e-7:
                break
        real, T = view.images(s, tangent)
        normal = _left_normal(T)
        r = _dot(normal, d - real)
    inverse_depth = (along * D[2] - n[0] * D[1] + n[1] * D[0]) * scale
    return Feet(r, s, inverse_depth, normal)


def _arc_feet(view: View, rows: Rows) -> Feet:
    """Foot points on whole circles ``A + cos(phi) U + sin(phi) V``, found by Newton's method on phi.

    The search starts at the angle under which the pixel's ray meets the circle's plane. The angle is kept as the unit
    vector (c, s), which a step turns without trigonometry.
    """
    A = view.points(rows.geometry[:, :, 0])
    U, V = view.directions(rows.geometry[:, :, 1]), view.directions(rows.geometry[:, :, 2])
    d = view.observed_offset(rows.xy)
    p = view.nearly_ideal_offset(d)
    # [U V A] (c, s, 1) ~ (p, 1) by Cramer's rule; the depth is not needed, so the horizon does no harm
    VA, AU = _cross(V, A), _cross(A, U)
    side = np.where(_dot(U[:2], VA[:2]) + U[2] * VA[2] < 0.0, -1.0, 1.0)
    c, s = _unit(side * np.array([_dot(VA[:2], p) + VA[2], _dot(AU[:2], p) + AU[2]]))

    search = Search(view, d, rows.weight)
    for _ in search.iterations:
        radius = c * U + s * V
        step = search.step(A + radius, c * V - s * U, -radius, largest=0.5)
        c, s = _unit(np.array([c - step * s, s + step * c]))
    return search.feet


def _sampled_curve_feet(view: View, rows: Rows) -> Feet:
    """Foot points on ordered clouds: on the parabola through the nearest sample and its two neighbours."""
    _, nearest = _nearest_sample(view, rows)
    # padding repeats the last sample: no parabola may reach into it
    own = np.any(rows.geometry != rows.geometry[:, :, -1:], axis=-1)
    last = rows.geometry.shape[2] - np.argmax(own[..., ::-1], axis=-1)
    middle = np.clip(nearest, 1, np.maximum(last - 1, 1))
    before, at, after = (
        view.points(np.take_along_axis(rows.geometry, (middle + i)[..., None, None], axis=2)[:, :, 0])
        for i in (-1, 0, 1)
    )
    slope, bend = (after - before) / 2.0, after - 2.0 * at + before
    t = (nearest - middle).astype(float)
    search = Search(view, view.observed_offset(rows.xy), rows.weight)
    for _ in search.iterations:
        t = t + search.step(at + t * (slope + 0.5 * t * bend), slope + t * bend, bend, largest=1.0)
    return search.feet


class Search:
    """Newton's method for the points of parametrised curves whose real images are nearest to observed pixels.

    A curve hands `step` its point and its first two derivatives in scaled camera coordinates, and moves its parameter
    by what comes back, until `iterations` ends; `feet` are then the last points seen.
    """

    def __init__(self, view: View, observed: Array, weight: Array) -> None:
        self.view = view
        self.observed = observed
        self.seen = weight > 0.0
        self.moved = np.inf

    @property
    def iterations(self) -> Iterator[int]:
        """At most ten; fewer when the largest step was so small that the next one would not change a digit."""
        for iteration in range(10):
            if self.moved < 1e-6:  # convergence is quadratic
                return
            yield iteration

    def step(self, point: Array, tangent: Array, bend: Array, largest: float) -> Array:
        """Change of the curve's parameter (B, N) towards the foot point, at most `largest`."""
        inverse_depth = 1.0 / _away_from_zero(point[2])
        s = point[:2] * inverse_depth
        ds = (tangent[:2] - s * tangent[2]) * inverse_depth
        dds = (bend[:2] - s * bend[2] - 2.0 * ds * tangent[2]) * inverse_depth
        real, T, dT = self.view.images(s, ds, dds)
        offset = self.observed - real
        TT = _dot(T, T) + TINY
        # the second derivative of half the squared distance, kept positive: never towards a maximum
        step = _dot(offset, T) / np.maximum(TT - _dot(offset, dT), 0.1 * TT)
        step = np.minimum(np.maximum(step, -largest), largest)  # np.clip is slower on small arrays
        self.moved = float((np.abs(step) * self.seen).max(initial=0.0))
        self.last = offset, T, s, inverse_depth
        return step

    @property
    def feet(self) -> Feet:
        """The foot points that the last step started from, less than that step from where it led."""
        offset, T, s, inverse_depth = self.last
        normal = _left_normal(T)
        return Feet(_dot(normal, offset), s, inverse_depth, normal)


def _point_feet(view: View, rows: Rows, X: Array) -> tuple[Feet, Feet]:
    """The x and the y residuals of pixels against the world points X (B, N, 3)."""
    h = view.points(X)
    inverse_depth = 1.0 / _away_from_zero(h[2])
    s = h[:2] * inverse_depth
    dx, dy = view.observed_offset(rows.xy) - view.real_offset(s)
    zero, one = np.zeros_like(dx), np.ones_like(dx)
    x, y = np.array([one, zero]), np.array([zero, one])
    return Feet(dx, s, inverse_depth, x), Feet(dy, s, inverse_depth, y)


def _end_feet(view: View, rows: Rows) -> Feet:
    """The residuals of pixels against ends of segments, along the image directions of the rows."""
    along = _components(rows.geometry[:, :, 1, :2])
    x, y = _point_feet(view, rows, rows.geometry[:, :, 0])
    return Feet(along[0] * x.r + along[1] * y.r, x.s, x.inverse_depth, along)


def _nearest_sample(view: View, rows: Rows) -> tuple[Array, IntArray]:
    """The sample (B, N, 3) of each row's cloud whose image is nearest to the pixel, and its index (B, N)."""
    B, N, S, _ = rows.geometry.shape
    h = view.points(rows.geometry.reshape(B, N * S, 3))
    image = view.real_offset(h[:2] / _away_from_zero(h[2])).reshape(2, B, N, S)
    distance = np.sum(np.square(image - view.observed_offset(rows.xy)[..., None]), axis=0)
    distance[h[2].reshape(B, N, S) < 0.0] += 1e12  # behind the camera only if nothing is in front
    nearest = np.argmin(distance, axis=-1)
    return np.take_along_axis(rows.geometry, nearest[..., None, None], axis=2)[:, :, 0], nearest


def _jacobian(view: View, feet: Feet, free: BoolArray) -> Array:
    """(B, M, P) derivatives of the residuals at their foot points, see `segment_residuals_with_jacobian`."""
    n, s = feet.normal, feet.s
    n_ds = view.pulled_back(s, n)  # n dpi/ds: the derivative of -r, the signs below see to it
    g = np.array([view.f * n_ds[0], view.f * n_ds[1], -_dot(s, n_ds)])  # n dpi/dXc

    column = {int(index): column for column, index in enumerate(np.flatnonzero(free))}  # of each free parameter
    angles, centre, lens, point = (
        [index for index in range(*part.indices(len(free))) if index in column]
        for part in (ANGLES, CENTER, LENS, PRINCIPAL_POINT)
    )
    J = np.empty((g.shape[1], len(column), g.shape[2]))  # each column contiguous
    if angles:
        xc, yc = s / view.f
        moment = np.array([yc * g[2] - g[1], g[0] - xc * g[2], xc * g[1] - yc * g[0]])  # Xc x g
        axes = rotation_axes(view.theta[:, ANGLES], view.R)[:, angles]
        J[:, column[angles[0]] : column[angles[-1]] + 1] = axes @ np.swapaxes(moment, 0, 1)
    if LOG_F in column:
        J[:, column[LOG_F]] = g[2]
    if centre:
        R_T = np.swapaxes(view.R, 1, 2)[:, [index - CENTER.start for index in centre]]
        J[:, column[centre[0]] : column[centre[-1]] + 1] = R_T @ np.swapaxes(feet.inverse_depth * g, 0, 1)
    if lens:
        q = _dot(s, s) / view.rho**2
        by_gain = -(n[0] * s[0] + view.aspect * n[1] * s[1])
        # gain = 1 + a1 q + a2 q^2 with a2 = b2 + FOLD min(a1, 0)^2
        dgain = (q * (1.0 + 2.0 * FOLD * np.minimum(view.lens[..., 0], 0.0) * q), q * q)
        for index in lens:
            J[:, column[index]] = by_gain * dgain[index - LENS.start]
    for index in point:
        J[:, column[index]] = -n[index - PRINCIPAL_POINT.start]
    if LOG_ASPECT in column:
        J[:, column[LOG_ASPECT]] = -n[1] * view.real_offset(s)[1]
    return np.swapaxes(J, 1, 2)


def _components(x: Array) -> Array:
    """(B, N, 2) to (2, B, N)."""
    return np.ascontiguousarray(np.moveaxis(x, -1, 0))


def _dot(a: Array, b: Array) -> Array:
    """Inner products of plane vectors."""
    return np.asarray(a[0] * b[0] + a[1] * b[1])


def _cross(a: Array, b: Array) -> Array:
    """Cross products of vectors in space."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def _unit(a: Array) -> Array:
    """Plane vectors scaled to length 1."""
    return np.asarray(a * (1.0 / (np.sqrt(_dot(a, a)) + TINY)))


def _left_normal(T: Array) -> Array:
    """Unit vectors a quarter turn from the tangents T: for a line's tangent (-ny, nx) its normal (nx, ny)."""
    return _unit(np.array([T[1], -T[0]]))


def _away_from_zero(depth: Array) -> Array:
    """Depths without an exact zero: a point in the camera's plane has no image, but must not stop the batch."""
    return np.where(np.abs(depth) < 1e-9, 1e-9, depth)
