"""The projection of B cameras with its derivatives, in arrays whose components come first.

Plane vectors are (2, B, N), vectors in space (3, B, N). Then ``x, y = s`` unpacks them, and contiguous components halve
the time. `np.array` joins components: on the small arrays of a single frame it takes a quarter of the time of
`np.stack`.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from fieldcalib._types import Array, BoolArray
from fieldcalib.fields.ground import Terrain
from fieldcalib.geometry.rotation import rotation_axes, rotation_from_angles
from fieldcalib.problem.layout import ANGLES, CENTER, LOG_ASPECT, LOG_F, PRINCIPAL_POINT, Layout, exp_of


class Projection:
    """The projection of B cameras.

    A world point X is projected in three steps, ``Xc = R (X - C)``, ``s = f (Xc / Zc, Yc / Zc)`` and
    ``xy = c + diag(1, aspect) distort(s)``. Scaled camera coordinates are (f Xc, f Yc, Zc): the ratio of their
    components is the ideal offset s. A point is represented by s and its inverse depth w, which is 0 at infinity and
    negative behind the camera.
    """

    def __init__(self, theta: Array, layout: Layout, terrain: Terrain | None = None) -> None:
        self._given = theta
        self.terrain = terrain
        self.theta, self.layout = layout.at_zoom(theta), layout
        theta = self.theta
        self.R = rotation_from_angles(theta[:, ANGLES])
        self.C = theta[:, None, CENTER]
        self.f = exp_of(theta, LOG_F)[:, None]
        self.aspect = exp_of(theta, LOG_ASPECT)[:, None]
        self.lens = layout.lens.at_focal_length(np.ascontiguousarray(theta[:, layout.lens_block].T)[..., None], self.f)
        # without lens and aspect real offsets are ideal ones, which halves the work
        self._is_square = not theta[:, LOG_ASPECT].any()
        self.is_pinhole = self._is_square and layout.lens.is_identity(self.lens)
        self._scaled_R = self.R.copy()
        self._scaled_R[:, :2] *= self.f[:, :, None]

    @cached_property
    def _zoom_jacobian(self) -> Array:
        return self.layout.zoom_jacobian(self._given)

    @cached_property
    def _axes(self) -> Array:
        return rotation_axes(self.theta[:, ANGLES], self.R)

    @property
    def down(self) -> Array:
        """The world's z axis in scaled camera coordinates, (3, B, 1)."""
        return np.ascontiguousarray(self._scaled_R[:, :, 2:].swapaxes(0, 1))

    @property
    def reach(self) -> float:
        """Length of ideal offsets up to which the lens is certainly one-to-one, pixels."""
        return self.layout.lens.rho

    def directions(self, d: Array) -> Array:
        """World directions (B, N, 3) in scaled camera coordinates, (3, B, N)."""
        return np.ascontiguousarray((self._scaled_R @ d.swapaxes(1, 2)).swapaxes(0, 1))

    def points(self, X: Array) -> Array:
        """World points (B, N, 3) in scaled camera coordinates, (3, B, N)."""
        return self.directions(X - self.C)

    def world_points(self, s: Array, inverse_depth: Array) -> Array:
        """World points (B, N, 3) of ideal offsets (2, B, N) and inverse depths; not finite at infinity."""
        with np.errstate(divide="ignore", invalid="ignore"):
            Xc = np.array([s[0] / self.f, s[1] / self.f, np.ones_like(s[0])]) / inverse_depth
            return np.asarray(self.C + np.moveaxis(Xc, 0, -1) @ self.R)

    def observed_offset(self, xy: Array) -> Array:
        """Observed pixels (B, N, 2) as real offsets from the principal point, (2, B, N)."""
        cx, cy = self.theta[:, PRINCIPAL_POINT].T
        return np.array([xy[..., 0] - cx[:, None], xy[..., 1] - cy[:, None]])

    def _stretched(self, v: Array) -> Array:
        """Vectors (2, B, N) with their second components times the aspect."""
        return v if self._is_square else np.array([v[0], self.aspect * v[1]])

    def _isotropic(self, d: Array) -> Array:
        """Real offsets (2, B, N) without the aspect."""
        return d if self._is_square else np.array([d[0], d[1] / self.aspect])

    def ideal_offset(self, d: Array) -> Array:
        """Ideal offsets of real ones (2, B, N); unchanged where no ray of the lens reaches them."""
        if self.is_pinhole:
            return d
        isotropic = self._isotropic(d)
        s = self.layout.lens.undistort(isotropic, self.lens)
        return np.where(np.isfinite(s), s, isotropic)

    def nearly_ideal_offset(self, d: Array) -> Array:
        """Approximate ideal offsets of real ones, to begin a search for closest points."""
        if self.is_pinhole:
            return d
        return self.layout.lens.nearly_undistort(self._isotropic(d), self.lens)

    def real_offset(self, s: Array) -> Array:
        """Real offsets of ideal ones (2, B, N): the lens, then the pixels' aspect."""
        if self.is_pinhole:
            return s
        return self._stretched(self.layout.lens.distort(s, self.lens))

    def push(self, s: Array, *steps: Array) -> tuple[Array, ...]:
        """Real offsets of ideal ones s, and the images ``dd_ds step`` of small steps there, (2, B, N) each."""
        if self.is_pinhole:
            return s, *steps
        return tuple(map(self._stretched, self.layout.lens.push(s, self.lens, *steps)))

    def follow(self, s: Array, ds: Array, dds: Array) -> tuple[Array, ...]:
        """Real offsets of points s of curves, and the first two derivatives there, from those of s, (2, B, N) each."""
        if self.is_pinhole:
            return s, ds, dds
        return tuple(map(self._stretched, self.layout.lens.follow(s, self.lens, ds, dds)))

    def pull(self, s: Array, n: Array) -> Array:
        """Real normals n (2, B, N) as derivatives by ideal offsets: ``n dd_ds``, the transpose of `push`."""
        if self.is_pinhole:
            return n
        return self.layout.lens.pull(s, self.lens, self._stretched(n))

    def derivatives(self, s: Array, inverse_depth: Array, n: Array, free: BoolArray) -> Array:
        """Derivatives of the images of points by the parameters, along directions of the image.

        With the point's camera coordinates ``Xc = (s / f, 1)``, its inverse depth w and ``g = n dxy_dXc``,

            n dxy_dangle = -axis . (Xc x g),    n dxy_dC = -w R^T g,    n dxy_dlog f = n dd_ds s

        and, for a lens that follows the zoom, that of the lens besides.

        Parameters
        ----------
        s : (2, B, N) array
            Ideal offsets of the points.
        inverse_depth : (B, N) array
        n : (2, B, N) array
            Directions of the image.
        free : (n,) bool array
            Mask of the parameters. Derivatives by the field's size are 0: it moves points, not the camera.

        Returns
        -------
        (B, P, N) array
            One row for each free parameter, in the order of theta.
        """
        if not free.any():
            return np.zeros((n.shape[1], 0, n.shape[2]))
        if self.layout.zoom_law is None:
            return self._derivatives(s, inverse_depth, n, free)
        camera = slice(self.layout.zoom_law_block.start)
        by_camera = self._derivatives(s, inverse_depth, n, np.arange(len(free)) < camera.stop)
        return np.asarray(np.swapaxes(self._zoom_jacobian[:, camera, free], 1, 2) @ by_camera)

    def _derivatives(self, s: Array, inverse_depth: Array, n: Array, free: BoolArray) -> Array:
        """`derivatives` of cameras without a zoom law."""
        layout = self.layout
        turned, moved, zoomed = pinhole_derivatives(s, inverse_depth, self.pull(s, n), self.f, self.R)
        J = np.zeros((len(turned), len(free), turned.shape[2]))  # each row contiguous
        J[:, ANGLES] = -(self._axes @ turned)
        J[:, CENTER] = moved
        J[:, LOG_F] = zoomed
        J[:, PRINCIPAL_POINT] = np.swapaxes(n, 0, 1)
        if free[LOG_ASPECT]:
            J[:, LOG_ASPECT] = n[1] * self.real_offset(s)[1]
        through = self._stretched(n)
        if layout.lens.follows_zoom:
            J[:, LOG_F] += layout.lens.pull_zoom(s, self.lens, through)
        if free[layout.lens_block].any():
            J[:, layout.lens_block] = np.swapaxes(layout.lens.pull_coefficients(s, self.lens, through), 0, 1)
        return J[:, free]


def pinhole_derivatives(s: Array, inverse_depth: Array, n: Array, f: Array, R: Array) -> tuple[Array, Array, Array]:
    """Derivatives of the ideal offsets of points along directions, by turns, centres and focal lengths.

    The terms of `Projection.derivatives`: with ``Xc = (s / f, 1)`` and ``g = n ds_dXc = (f n, -n . s)``, a small turn
    of the scene about an axis, ``dXc = axis x Xc``, moves the offset by ``axis . (Xc x g)``.

    Parameters
    ----------
    s : (2, B, N) array
        Ideal offsets.
    inverse_depth : (B, N) array
    n : (2, B, N) array
        Directions.
    f : (B, 1) array
    R : (B, 3, 3) array

    Returns
    -------
    turned : (B, 3, N) array
        By turns of the scene about the axes of the camera.
    moved : (B, 3, N) array
        By the centre of the camera.
    zoomed : (B, N) array
        By log f.
    """
    zoomed = n[0] * s[0] + n[1] * s[1]  # n times minus the third column of ds/dXc
    g = np.array([f * n[0], f * n[1], -zoomed])
    xc, yc = s / f
    moment = np.array([yc * g[2] - g[1], g[0] - xc * g[2], xc * g[1] - yc * g[0]])  # Xc x g
    moved = -(np.swapaxes(R, 1, 2) @ np.swapaxes(inverse_depth * g, 0, 1))
    return np.swapaxes(moment, 0, 1), moved, zoomed
