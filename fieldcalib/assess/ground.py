"""The ground that cameras see: ground points of pixels, and their derivatives by the parameters of the camera.

The errors of a camera if the field were known to be level.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fieldcalib._types import Array, BoolArray
from fieldcalib.fields.crown import share_of_crown
from fieldcalib.problem.layout import CENTER, PRINCIPAL_POINT, Layout
from fieldcalib.problem.projection import Projection


def if_level(covariance: Array, of_crown: BoolArray) -> Array:
    """Covariance (n, n) of parameters if the field were known to be level; `of_crown` (n,) marks its crown, if any.

    Examples
    --------
    >>> if_level(np.array([[2.0, 0.1], [0.1, 0.04]]), np.array([False, True])).round(2)
    array([[1.75, 0.  ],
           [0.  , 0.  ]])
    """
    (index,) = np.flatnonzero(of_crown) if np.any(of_crown) else (0,)
    if not np.any(of_crown) or not covariance[index, index] > 0.0:
        return covariance
    by_crown = covariance[:, index]
    return np.asarray(covariance - np.outer(by_crown, by_crown) / covariance[index, index])


@dataclass(frozen=True, eq=False)
class Considered:
    """The parameters that a layout considers, with their joint covariance."""

    layout: Layout
    covariance: Array
    """Covariance of these parameters, (S, S)."""

    @cached_property
    def if_level(self) -> Array:
        """The covariance if the field were known to be level, (S, S)."""
        return if_level(self.covariance, self.layout.is_crown[self.layout.considered])


def ground_of_pixels(projection: Projection, xy: Array) -> tuple[Array, BoolArray]:
    """Ground points (B, N, 3) of pixels (B, N, 2), and which pixels show the ground, (B, N)."""
    dx, dy = projection.observed_offset(xy)
    isotropic = np.array([dx, dy / projection.aspect])
    s = isotropic if projection.is_pinhole else projection.layout.lens.undistort(isotropic, projection.lens)
    with np.errstate(divide="ignore", invalid="ignore"):
        ray = np.stack([s[0] / projection.f, s[1] / projection.f, np.ones_like(s[0])], axis=-1) @ projection.R
        depth = -projection.C[..., 2] / ray[..., 2]
        X = projection.C + depth[..., None] * ray
    X[..., 2] = 0.0
    return X, np.asarray(np.isfinite(X).all(axis=-1) & (depth > 0.0))


def pixels_of_points(projection: Projection, X: Array) -> tuple[Array, BoolArray]:
    """Pixels (B, N, 2) of world points (B, N, 3), and which points have a pixel, (B, N).

    A point has a pixel if it is in front of the camera and where the lens is monotone.
    """
    h = projection.points(X)
    seen = h[2] > 0.0
    s = h[:2] / np.where(seen, h[2], 1.0)
    if not projection.is_pinhole:
        seen &= projection.layout.lens.is_monotone(s, projection.lens)
    d = projection.real_offset(s)
    cx, cy = projection.theta[:, PRINCIPAL_POINT].T[..., None]
    return np.stack([d[0] + cx, d[1] + cy], axis=-1), np.asarray(seen)


def ground_derivatives(projection: Projection, X: Array, known: BoolArray, some: BoolArray) -> Array:
    """Derivatives (B, N, 2, P) of ground points (B, N, 3) by some parameters (n,) while their pixels are kept.

    ``pi(X, theta) = xy``, hence ``dX/dtheta = -(dpi/dX)^-1 dpi/dtheta``. For points that are not `known`, (B, N), the
    derivatives are finite and arbitrary.
    """
    ahead = projection.C + projection.R[:, None, 2]  # stands in for points that do not exist
    h = projection.points(np.where(known[..., None], X, ahead))
    s, inverse_depth = h[:2] / h[2], 1.0 / h[2]
    zero, one = np.zeros_like(inverse_depth), np.ones_like(inverse_depth)
    needed = some | projection.layout.is_centre
    across, down = (
        projection.derivatives(s, inverse_depth, n, needed) for n in (np.array([one, zero]), np.array([zero, one]))
    )
    x, y = np.searchsorted(np.flatnonzero(needed), [CENTER.start, CENTER.start + 1])
    # moving a point is equivalent to moving the centre the other way: dpi/dX = -(a b; c d)
    a, b = np.where(known, across[:, x], 1.0), np.where(known, across[:, y], 0.0)
    c, d = np.where(known, down[:, x], 0.0), np.where(known, down[:, y], 1.0)
    across, down = (rows[:, some[needed]] / (a * d - b * c)[:, None] for rows in (across, down))
    moved = d[:, None] * across - b[:, None] * down, a[:, None] * down - c[:, None] * across
    derivatives = np.moveaxis(np.array(moved), (0, 2), (2, 3))
    size = projection.layout.field_size
    if size is not None and np.any(some[projection.layout.crown_block]):
        derivatives[..., -1] = _by_crown(projection, np.where(known[..., None], X, 0.0), size.given[1])
    return derivatives


def _by_crown(projection: Projection, X: Array, width: float) -> Array:
    """Derivatives (B, N, 2) of ground points (B, N, 3) by the crown of the field, whose height shifts them."""
    towards = (projection.C[..., :2] - X[..., :2]) / np.abs(projection.C[..., 2:])
    return np.asarray(share_of_crown(X[..., 1], width)[..., None] * towards)
