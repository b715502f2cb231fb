"""The ground that cameras see: ground points of pixels, and their derivatives by the parameters of the camera."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from fieldcalib._types import Array, BoolArray
from fieldcalib.fields.field import Field, terrain_of
from fieldcalib.problem.layout import CENTER, PRINCIPAL_POINT, Layout
from fieldcalib.problem.projection import Projection


def given_crown(covariance: Array, of_crown: BoolArray) -> Array:
    """Covariance (n, n) of parameters if the crown of the field were known; `of_crown` (n,) marks it, if any.

    Places of one camera are compared by it: an error of the crown moves all of them alike.

    Examples
    --------
    >>> given_crown(np.array([[2.0, 0.1], [0.1, 0.04]]), np.array([False, True])).round(2)
    array([[1.75, 0.  ],
           [0.  , 0.  ]])
    """
    by_crown, variance = covariance[:, of_crown], float(np.sum(covariance[of_crown][:, of_crown]))
    return np.asarray(covariance - by_crown @ by_crown.T / variance) if variance > 0.0 else covariance


class Considered(NamedTuple):
    """The parameters that a layout considers, with their joint covariance."""

    layout: Layout
    covariance: Array
    """Covariance of these parameters, (S, S)."""
    by_line: Mapping[str, Array] | None = None
    """Errors (S,) of these parameters, by label, if its line is misplaced by one standard deviation."""


def projection_on(field: Field | None, theta: Array, layout: Layout) -> Projection:
    """The projection of B cameras (B, n) that see a field on its ground; level ground without a field."""
    return Projection(theta, layout, layout.terrain(theta, terrain_of(field)))


def ground_of_pixels(projection: Projection, xy: Array) -> tuple[Array, BoolArray]:
    """Ground points (B, N, 3) of pixels (B, N, 2), and which pixels show the ground, (B, N)."""
    dx, dy = projection.observed_offset(xy)
    isotropic = np.array([dx, dy / projection.aspect])
    s = isotropic if projection.is_pinhole else projection.layout.lens.undistort(isotropic, projection.lens)
    with np.errstate(divide="ignore", invalid="ignore"):
        ray = np.stack([s[0] / projection.f, s[1] / projection.f, np.ones_like(s[0])], axis=-1) @ projection.R
        if projection.terrain is not None:
            X = projection.terrain.met_by_rays(projection.C, ray)
            return X, np.asarray(np.isfinite(X).all(axis=-1))
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

    ``pi(X, theta) = xy``, hence ``dX/dtheta = -(dpi/dX)^-1 dpi/dtheta``, with X on the ground: where that slopes, z
    follows x and y. For points that are not `known`, (B, N), the derivatives are finite and arbitrary.
    """
    ahead = projection.C + projection.R[:, None, 2]  # stands in for points that do not exist
    h = projection.points(np.where(known[..., None], X, ahead))
    s, inverse_depth = h[:2] / h[2], 1.0 / h[2]
    zero, one = np.zeros_like(inverse_depth), np.ones_like(inverse_depth)
    needed = some | projection.layout.is_centre
    across, down = (
        projection.derivatives(s, inverse_depth, n, needed) for n in (np.array([one, zero]), np.array([zero, one]))
    )
    columns, at = np.flatnonzero(needed), np.where(known[..., None], X, 0.0)
    x, y, z = np.searchsorted(columns, range(CENTER.start, CENTER.stop))
    if np.any(projection.layout.is_crown & needed):
        column = np.searchsorted(columns, projection.layout.crown_block.start)
        share = projection.layout.level(projection.theta).shares(at[..., 0], at[..., 1])[0]
        across[:, column], down[:, column] = share * across[:, z], share * down[:, z]  # the ground rises: z falls
    # moving a point is equivalent to moving the centre the other way: dpi/dX = -(a b; c d)
    hx, hy = (zero, zero) if projection.terrain is None else projection.terrain.slopes(at[..., 0], at[..., 1])
    a, b = (
        np.where(known, across[:, x] - hx * across[:, z], 1.0),
        np.where(known, across[:, y] - hy * across[:, z], 0.0),
    )
    c, d = np.where(known, down[:, x] - hx * down[:, z], 0.0), np.where(known, down[:, y] - hy * down[:, z], 1.0)
    across, down = (rows[:, some[needed]] / (a * d - b * c)[:, None] for rows in (across, down))
    moved = d[:, None] * across - b[:, None] * down, a[:, None] * down - c[:, None] * across
    return np.moveaxis(np.array(moved), (0, 2), (2, 3))
