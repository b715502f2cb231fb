"""Cameras that were searched, pulled onto the stripes near the markings that they project.

At each point of a marking, the likeliest place for it is looked up at several distances across its projection; the
cameras are moved towards these places by least squares, regularised by how far cameras from search are usually off:
a step of Gauss and Newton, for all cameras at once, in a shrinking band. So hypotheses from few lines, from lines that
a lens has bent, or of a wrong focal length come near enough to be compared, and to be refined on the picture.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fieldcalib._types import Array
from fieldcalib.images.court_hypotheses import Cameras
from fieldcalib.images.stripe_likelihood import MarkingPoints, StripeMaps, projected

REACHES = (32.0, 20.0, 12.0, 8.0)  # px: half the band across each marking, in each step
PLACES = 13  # across it
FARTHER = 1.0  # log likelihood ratio by which a place at the border of the band is less likely than one in its middle
LEAST = 0.3  # log likelihood ratio of a place that pulls
OFF = 5.0  # px: standard deviation of places that pull
TURN, ZOOM = 30.0, 0.1  # standard deviations: px; of log f
UNKNOWNS = 9  # turn, zoom, place of the camera, principal point
DIFFERENCE = 1e-3  # of the parameters in these units, for derivatives


@dataclass(frozen=True)
class Freedom:
    """Standard deviations of what is known of cameras."""

    principal_point: float
    """In widths of the picture."""
    place: float = 0.1
    """In heights of the camera."""


def pulled(cameras: Cameras, maps: StripeMaps, points: MarkingPoints, freedom: Freedom) -> Cameras:
    """The cameras, moved onto the stripes near their markings."""
    for reach in REACHES if len(cameras) else ():
        cameras = _moved(cameras, _step(cameras, maps, points, reach, freedom), freedom)
    return cameras


def _step(cameras: Cameras, maps: StripeMaps, points: MarkingPoints, reach: float, freedom: Freedom) -> Array:
    """The step of Gauss and Newton (B, 9), in units of the standard deviations."""
    x, y, direction, _, seen = (one.astype(float) for one in projected(cameras.projections.astype(np.float32), points))
    nx, ny = -np.sin(direction), np.cos(direction)
    off = np.linspace(-reach, reach, PLACES)
    at = x[..., None] + off * nx[..., None], y[..., None] + off * ny[..., None]
    likely = maps.logarithms(*at, direction[..., None], seen[..., None]) - FARTHER * np.abs(off) / reach
    best = np.argmax(likely, axis=2)
    pulls = np.isfinite(x) & (np.take_along_axis(likely, best[..., None], axis=2)[..., 0] > LEAST)
    weight = np.where(pulls, 1.0 / OFF**2, 0.0)
    J = np.zeros((*x.shape, UNKNOWNS))
    for k in range(UNKNOWNS):
        delta = np.zeros((len(cameras), UNKNOWNS))
        delta[:, k] = DIFFERENCE
        P = _moved(cameras, delta, freedom).projections
        u, v, depth = np.moveaxis(P @ np.vstack([points.X.T, np.ones(len(points.X))]), 1, 0)
        with np.errstate(divide="ignore", invalid="ignore"):
            moved = (u / depth - x) * nx + (v / depth - y) * ny
        J[..., k] = np.where(pulls, moved / DIFFERENCE, 0.0)
    normal = np.einsum("bni,bn,bnj->bij", J, weight, J) + np.eye(UNKNOWNS)
    right = np.einsum("bni,bn->bi", J, weight * np.where(pulls, off[best], 0.0))
    return np.asarray(np.linalg.solve(normal, right[..., None])[..., 0])


def _moved(cameras: Cameras, delta: Array, freedom: Freedom) -> Cameras:
    """The cameras turned about their own axes, zoomed and moved by steps (B, 9)."""
    turn = _rotations(delta[:, :3] * (TURN / cameras.f)[:, None])
    move = delta[:, 4:7] * (freedom.place * np.abs(cameras.C[:, 2]))[:, None]
    f = cameras.f * np.exp(np.clip(ZOOM * delta[:, 3], -0.5, 0.5))
    c = cameras.c + freedom.principal_point * cameras.size[0] * delta[:, 7:]
    return replace(cameras, f=f, c=c, R=turn @ cameras.R, C=cameras.C + move)


def _rotations(w: Array) -> Array:
    """Rotations (B, 3, 3) by vectors (B, 3), by Rodrigues' formula."""
    angle = np.linalg.norm(w, axis=1)[:, None, None]
    x, y, z = w.T
    zero = np.zeros_like(x)
    K = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
    return np.asarray(np.eye(3) + np.sinc(angle / np.pi) * K + 0.5 * np.square(np.sinc(0.5 * angle / np.pi)) * (K @ K))
