"""Clips of one tripod: its cameras, and matches of the ground and of the stands around it."""

import numpy as np

from data_tools.synthetic.clips import background_matches
from fieldcalib.geometry.camera import Camera
from fieldcalib.problem.layout import ZoomLaw

SIZE = (960, 540)
CENTRE = (1.0, 66.0, -17.0)


def panned(count, first=-0.2, last=0.2, centre=CENTRE):
    """Cameras without a lens that pan, nod and zoom."""
    share = np.linspace(0.0, 1.0, count)
    return [
        Camera.from_angles(pan, 1.34 + 0.02 * np.sin(9.0 * s), 0.003, 1300.0 + 250.0 * s, centre, SIZE)
        for pan, s in zip(first + (last - first) * share, share, strict=True)
    ]


def stadium(rng, count=4000):
    """Points of the ground and of the stands behind three of its sides, (N, 3)."""
    ground = rng.uniform((-70.0, -50.0, 0.0), (70.0, 50.0, 0.0), (count, 3))
    far = rng.uniform((-75.0, -60.0, -20.0), (75.0, -45.0, -1.0), (count, 3))
    right = rng.uniform((58.0, -50.0, -15.0), (70.0, 50.0, -1.0), (count // 2, 3))
    return np.concatenate([ground, far, right, right * (-1.0, 1.0, 1.0)])


def matched(cameras, pairs, rng, noise=0.3, most=150):
    """What both frames of some pairs see of a stadium: up to so many points of each."""
    found = {}
    for match in background_matches(cameras, pairs, stadium(rng), rng, noise):
        some = rng.permutation(len(match.xy_first))[:most]
        found[match.first, match.second] = match.xy_first[some], match.xy_second[some]
    return found


def chain(count, *apart):
    """Pairs of frames of a clip that are so many frames apart."""
    return [(t, t + d) for d in apart or (1,) for t in range(count - d)]


def operated(rng, count, layout, offset=0.3):
    """Parameters (T, n) of a camera with a lens and a zoom law that turns and zooms, in a layout with one."""
    assert isinstance(layout.zoom_law, ZoomLaw)
    theta = np.tile(layout.theta(panned(1)[0]), (count, 1))
    theta[:, 0] = np.linspace(-0.15, 0.15, count)
    theta[:, 1:3] += rng.normal(scale=(0.01, 0.003), size=(count, 2))
    theta[:, 3] = layout.zoom_law.reference + np.cumsum(rng.normal(scale=0.03, size=count))
    theta[:, layout.lens_block.start] = 0.03
    theta[:, layout.zoom_law_block] = 4.0, -3.0, 0.01, 0.02, offset
    return theta


def far_off(camera, truth):
    """Pixels by which what a camera shows of the pitch is elsewhere than in truth, (N,)."""
    x, y = np.meshgrid(np.linspace(0.0, truth.image_size[0] - 1.0, 9), np.linspace(0.0, truth.image_size[1] - 1.0, 7))
    xy = np.stack([x, y], axis=-1).reshape(-1, 2)
    X = truth.image_to_field(xy)
    seen = np.isfinite(X).all(axis=1) & np.all(np.abs(X[:, :2]) < (52.5, 34.0), axis=1)
    return np.linalg.norm(camera.project(X[seen]) - xy[seen], axis=1)
